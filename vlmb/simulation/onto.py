"""A step of its own onto an event: dense output is an order lower than the step, and bends where a law has switched within it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vlmb.core.calls import begin, state_at
from vlmb.core.driver import (
    ATOL,
    DONE,
    EVALUATIONS,
    FIRST_STEP_SIZE,
    HIT,
    LAST_FIXED,
    METHOD,
    METHODS,
    RTOL,
    SLICE_SIZE,
    T_NEW,
    TIME_BEFORE,
    Driver,
    H,
    Y,
    make_driver,
)  # fmt: skip
from vlmb.errors import VlmbError
from vlmb.simulation.engine import Engine
from vlmb.system.events import FALL, LIMIT, NAMED, SWITCH

Array = NDArray[np.float64]

STEPPED = (LIMIT, FALL, SWITCH, NAMED)  # kinds of events at which all forces have values
ROUNDS, STEADY = 8, 1e-15  # of the search, and the change of the time, over the step, that ends it
NEAR = 0.05  # of the step: how far the event may move
NOISE = 1e3  # times STEADY: the way from which a slope is taken
FEW = 400  # evaluations of one way there, in a motion that may be stiff
SHORT = 1e-4  # of the step: of a difference quotient, and the least that is stepped


def step_onto(engine: Engine, driver: Driver, k: int, t: float) -> float:
    """Return the time [s] of event k, which dense output has at t, by steps that end there; write the state into `point`.

    Where that does not come to rest, what dense output has stays.
    """
    if driver.counts[METHOD] <= LAST_FIXED or engine.events[k].kind not in STEPPED:
        return t
    began, last = float(driver.real[TIME_BEFORE]), float(driver.real[T_NEW])
    h = min(float(driver.real[H]), (t - began) / NEAR)  # a long step sees nothing of a window that it begins with
    low, high = max(t - NEAR * h, began + SHORT * h), min(t + NEAR * h, last)
    if not (h > 0.0 and low < t):
        return t
    slope = _slope(engine, driver, k, t, SHORT * h)
    if slope == 0.0:
        return t
    at, y, way, beyond = t, np.array(driver.point), float(driver.indicators[HIT, k]), 1.0
    before, change, least = (t, math.nan), math.inf, STEADY * (h + abs(t))
    try:
        for _ in range(ROUNDS):
            y = _stepped(engine, driver, began, at)
            value = float(engine.indicators(at, y)[0][k])
            if abs(at - before[0]) > NOISE * least:  # dense output may have its slope from another law
                slope = (value - before[1]) / (at - before[0]) or slope
            before, change = (at, value), value / slope
            if not low <= at - change <= high:
                return t
            if abs(change) > least:
                at -= change
            elif value < 0.0 and engine.events[k].ends:  # what ends a run is not passed, not even by rounding
                at -= 2.0 * least
            elif engine.events[k].kind == SWITCH and not value * way > 0.0:  # and what switches a law is passed, if by rounding
                beyond *= 2.0
                at = min(at + beyond * least, last)
            else:
                break
        kept = value * way > 0.0 if engine.events[k].kind == SWITCH else value >= 0.0 or not engine.events[k].ends
        if kept and abs(change) <= NOISE * least:
            driver.point[:], t = y, before[0]
    except VlmbError:
        return t
    return t


def _slope(engine: Engine, driver: Driver, k: int, t: float, step: float) -> float:
    """Return the rate of an indicator by dense output."""
    values, y = [], np.empty_like(driver.point)
    for at in (t - step, t + step):
        state_at(driver, at, y)
        values.append(float(engine.indicators(at, y)[0][k]))
    return (values[1] - values[0]) / (2.0 * step)


def _stepped(engine: Engine, driver: Driver, t: float, end: float) -> Array:
    """Return the state at `end` by steps from the start of the last one. Raises VlmbError where they do not come there."""
    single = make_driver("dop853", len(driver.point), rtol=float(driver.real[RTOL]), atol=float(driver.real[ATOL]))
    single.point[:] = driver.rows[Y, : len(single.point)]
    single.real[FIRST_STEP_SIZE] = end - t
    if driver.counts[METHOD] == METHODS["radau"]:
        single.counts[SLICE_SIZE] = FEW
    begin(single, t, end)
    code = engine.run(single, np.zeros((0, 3)), np.inf)
    driver.counts[EVALUATIONS] += single.counts[EVALUATIONS]
    if code != DONE:
        raise engine.failure(single) or VlmbError("no step ends there")
    return np.array(single.point)
