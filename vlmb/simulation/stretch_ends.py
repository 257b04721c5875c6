"""The ends of a stretch of a run: its start, and the breaks of laws, over which no law is asked for its other side."""

from __future__ import annotations

import contextlib
from collections.abc import Collection
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.core.driver import ATOL, NEXT_SAMPLE, RTOL, Driver
from vlmb.errors import SceneError, SimulationError, VlmbError
from vlmb.simulation.engine import Engine
from vlmb.simulation.switches import over
from vlmb.system.events import FALL, GRIP, Event

Array = NDArray[np.float64]

INSIDE = 1e-12  # relative distance kept from a break of a law
COUNTS, STEEP = 10.0, 1.9  # tolerances that a gap may take; how much a pole grows from twice the gap to it
UNDER = 1e-12  # [m, m/s] what counts as nothing at the start: a point under the snow, the way to a limit


class Looked(NamedTuple):
    """What a run looks for."""

    directions: Array  # (e,) of events
    near: Array  # (2, e) what counts as 0 of indicators and rates at a start
    kinds: frozenset[int]
    grips: tuple[tuple[int, float], ...]  # which events are of a ski that stops or slips, and their directions


@lru_cache(maxsize=4)
def looked_for(events: tuple[Event, ...]) -> Looked:
    """Return what is looked for; runs of an ensemble have the same."""
    near = [(event.slack, UNDER) if event.ends else (0.0, 0.0) for event in events]
    directions = np.array([event.direction for event in events])
    grips = tuple((k, event.direction) for k, event in enumerate(events) if event.kind == GRIP)
    return Looked(directions, np.array(near).reshape(-1, 2).T.copy(), frozenset(event.kind for event in events), grips)


def refuse_start(engine: Engine, t: float, y: Array) -> None:
    """Raise SceneError for a start with a point under the snow, where falls are looked for."""
    watched = [(k, event) for k, event in enumerate(engine.events) if event.kind == FALL]
    heights = engine.indicators(t, y)[0]
    for k, event in watched:
        if heights[k] < -UNDER:
            raise SceneError(
                f"start: {event.name} is {-heights[k]:.3g} m under the snow; raise psi (in radians), or set run.fall = false"
            )


def gap_at(t: float, breaks: Collection[float], duration: float) -> float:
    """Return the distance [s] that is kept from t where a law breaks there, so that no law is asked for its other side."""
    return INSIDE * (abs(t) or min(1.0, duration)) if t in breaks else 0.0


def leave(engine: Engine, driver: Driver, t: float, gap: float, begins: bool) -> None:
    """Go from t, where a run begins or a law breaks, over the gap that is kept from the break, by the law beyond it.

    A start that is exactly on a switch of the state goes a hair's breadth beyond: what counts is where the motion leads.
    Raises VlmbError where a run begins at a break at which a law has no value, or where one comes from infinity.
    """
    point = driver.point
    if not gap:
        with contextlib.suppress(VlmbError):  # the next step says it
            found = over(engine, t, point, on=True) if begins else None
            if found is not None:
                take_samples(engine, driver, t)
                point[:] = found.y
        return
    y = np.array(point)
    if begins:
        engine.evaluate(t, y)
    slope = np.zeros_like(y)
    with contextlib.suppress(VlmbError):  # the next step says it
        if begins:
            take_samples(engine, driver, t)
        slope = engine.evaluate(t + gap, y)
        point[:] = y + gap * slope
    _refuse_pole(engine, driver, y, slope, (t, t + 2.0 * gap, gap))


def arrive(engine: Engine, driver: Driver, t: float, gap: float) -> None:
    """Go over the gap before a break at t; the samples there are taken.

    Raises VlmbError where a law has no value at the end, or grows without bound towards the break.
    """
    if gap:
        _refuse_pole(engine, driver, np.array(driver.point), np.array(driver.slope), (t, t - 2.0 * gap, gap))
        driver.point[:] += gap * driver.slope
        if t == driver.times[-1]:
            engine.evaluate(t, np.array(driver.point))
            take_samples(engine, driver, t)


def _refuse_pole(engine: Engine, driver: Driver, y: Array, slope: Array, at: tuple[float, float, float]) -> None:
    """Raise VlmbError where y' grows as 1/s towards a break: what it does in the gap beside it does not fade with the gap.

    at : the break, twice the gap from it, and the gap [s], at which y' is `slope`
    """
    t, further, gap = at
    k = int(np.argmax(np.abs(slope)))
    if gap * abs(slope[k]) > COUNTS * (driver.real[ATOL] + driver.real[RTOL] * abs(y[k])):
        with contextlib.suppress(VlmbError):
            if abs(slope[k]) < STEEP * abs(engine.evaluate(further, y)[k]):
                return
        engine.evaluate(t, y)
        raise SimulationError(f"a law grows without bound towards t = {t:.6g} s, and its impulse with it")


def take_samples(engine: Engine, driver: Driver, t: float) -> None:
    """Take the samples up to t [s], of the state as it is."""
    for k in range(int(driver.counts[NEXT_SAMPLE]), int(np.searchsorted(driver.times, t, side="right"))):
        driver.samples[k] = driver.point
        driver.counts[NEXT_SAMPLE] = k + 1
        engine.note(float(driver.times[k]), driver.samples[k])
