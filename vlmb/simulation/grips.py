"""A ski with friction that stands or slides: from when on it does which, and how a run begins anew with it."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from vlmb.core.calls import begin, resume
from vlmb.core.driver import HIT, Driver
from vlmb.simulation.engine import Engine
from vlmb.system.events import FALLING

Array = NDArray[np.float64]

AT_LIMIT = 1e-9  # of the most that friction can hold: a ski that is held by this much less may slip at once
HAIR, FAR = 4e-16, 1e-10  # [s] at t = 0 to 1, over t beyond: how far ahead it is looked for, each time twice as far


def take_hold(engine: Engine, y: Array, t: float, until: float, again: bool = False) -> tuple[float, float]:
    """Let a ski stand or slide from (t, y) on; return the time [s] from which it does, and the side that it slides to.

    At the very limit of what holds it rounding decides: there it slips if it would a hair later. From an instant that comes
    `again`, as rounding may have it, it goes on beyond that hair.
    """
    size = max(1.0, abs(t))
    t = min(t + FAR * size, until) if again else t
    hold, hair = engine.settle(t, y), HAIR * size
    while hold.side == 0.0 and hold.left < AT_LIMIT and hair < FAR * size and t + hair < until:
        ahead = engine.settle(t + hair, y)
        if ahead.side:
            return t + hair, ahead.side
        hair *= 2.0
    if hair > HAIR * size:
        engine.settle(t, y)
    return t, hold.side


def set_out(
    grips: Collection[tuple[int, float]], driver: Driver, t: float, until: float, side: float = 0.0, resumed: bool = False
) -> None:
    """Go on from (t, `point`), as `begin` or `resume` does, with a ski that slides to a side or, at 0, stands.

    What holds it counts as not passed, and its speed as of that side: neither a law that jumped nor rounding may have it slip, or
    turn, unseen. `grips`: its events, and their directions.
    """
    if not resumed:
        driver.indicators[HIT] = 0.0
    for k, direction in grips:
        driver.indicators[HIT, k] = 1.0 if direction == FALLING else side
    (resume if resumed or grips else begin)(driver, t, until)
