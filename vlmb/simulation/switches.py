"""Switches of laws on the way of a run: which comes first in a step, and over one that no step gets over."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.core.calls import state_at
from vlmb.core.driver import DIRECTION, HIT, SIDE, TIME_BEFORE, VALUE_BEFORE, Driver
from vlmb.core.indicators import leaves, sign
from vlmb.core.locate import TOLERANCE, Crossing, root
from vlmb.errors import VlmbError
from vlmb.simulation.engine import Engine
from vlmb.system.events import FALL, LIMIT, SWITCH

Array = NDArray[np.float64]

WATCHED = (LIMIT, FALL, SWITCH)  # kinds of events whose side of 0 is known at every instant
LEAST, NEAREST = 1e-17, 1e-10  # [s] at t = 0 to 1, over t beyond: how far ahead of a state a switch is looked for
SAME = 1e-9  # [s] switches within this time, many times over, drive back to the switch
HOPELESS = 1e-6  # of a run: as many within this part of it would never end
TOO_MANY = 40


class Over(NamedTuple):
    """The far side of a switch."""

    t: float  # [s]
    y: Array
    event: int  # which
    way: float  # 1 rising, -1 falling


def earliest(engine: Engine, driver: Driver, found: Crossing) -> Crossing:
    """Return the first crossing of the step under way up to one that was found.

    Looks at an indicator alone may pass over a narrow dip, as of abs(x) - 1e-6; but the state at another event may lie in it.
    """
    g, began = driver.indicators, float(driver.real[TIME_BEFORE])
    events, y = engine.events, np.empty_like(driver.point)

    def value(index: int, t: float) -> float:
        state_at(driver, t, y)
        return float(engine.indicators(t, y)[0][index])

    for _ in events:
        state_at(driver, found.t, y)
        now = engine.indicators(found.t, y)[0].tolist()
        passed = [k for k, event in enumerate(events) if event.kind in WATCHED and k != found.indicator and g[SIDE, k] != 0.0]
        other = next((k for k in passed if leaves(g[SIDE, k], sign(now[k]), g[DIRECTION, k])), None)
        if other is None or not g[VALUE_BEFORE, other] * now[other] < 0.0:
            break
        t = root(partial(value, other), began, found.t, float(g[VALUE_BEFORE, other]), now[other])
        if not t < found.t - TOLERANCE * max(abs(found.t), found.t - began):
            break
        found = Crossing(t, other, int(sign(now[other])))
    return found


def over(engine: Engine, t: float, y: Array, on: bool = False) -> Over | None:
    """Return the far side of a switch that a state stands a hair's breadth before, where one side's law shows no step its end.

    on : only of switches that the state is exactly on. None where none is so near. Raises VlmbError where y' has no answer.
    """
    switches = [k for k, event in enumerate(engine.events) if event.kind == SWITCH]
    if not switches:
        return None
    size, before = max(1.0, abs(t)), engine.indicators(t, y)[0].tolist()
    watched = [k for k in switches if before[k] == 0.0 or not on]
    slope, ahead = engine.evaluate(t, y) if watched else y, LEAST * size
    while watched and ahead <= NEAREST * size:
        at, beyond = t + ahead, y + ahead * slope
        now = engine.indicators(at, beyond)[0].tolist()
        for k in watched:
            if now[k] * before[k] < 0.0 or (before[k] == 0.0 and now[k] != 0.0):
                return Over(at, beyond, k, sign(now[k]))
        ahead *= 2.0
    return None


def drives_back(times: Sequence[float], duration: float) -> bool:
    """Whether the last switches of a run of a duration [s] come so fast that both sides must drive back to them."""
    return len(times) > TOO_MANY and times[-1] - times[0] <= max(SAME * max(1.0, times[-1]), HOPELESS * duration)


def go_beyond(engine: Engine, driver: Driver, t: float) -> float | None:
    """Go from a state that steps cannot leave to beyond the switch before it; return the time there, None where none is near."""
    with contextlib.suppress(VlmbError):
        found = over(engine, t, np.array(driver.point))
        if found is not None:
            driver.point[:] = found.y
            driver.indicators[HIT] = 0.0
            driver.indicators[HIT, found.event] = found.way
            return found.t
    return None
