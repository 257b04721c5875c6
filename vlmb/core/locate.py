"""When the indicators of a step cross 0: roots on the dense output."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from vlmb.core.driver import DIRECTION, HIT, RATE, RATE_BEFORE, SIDE, T_NEW, TIME_BEFORE, VALUE, VALUE_BEFORE, Array, Driver, H
from vlmb.core.indicators import leaves, sign, turning_points
from vlmb.core.samples import state_at

LOOKS = 8  # evenly spaced looks at an indicator in the step, besides those where its cubic turns
TOLERANCE = 4.0 * np.finfo(float).eps  # of a root, relative to the larger of t and the step


class Crossing(NamedTuple):
    """An indicator crossed 0."""

    t: float  # [s]
    indicator: int
    direction: int  # 1 rising, -1 falling


def crossings(driver: Driver, values: Callable[[float, Array], Array]) -> list[Crossing]:
    """Return the watched crossings of the step under way in order of time, at CROSSING.

    `values(t, y)` gives all indicators.
    """
    y = np.empty_like(driver.point)

    def at(t: float) -> Array:
        state_at(driver, t, y)
        return np.array(values(t, y), dtype=float)

    def value_of(indicator: int, t: float) -> float:
        return float(at(t)[indicator])

    suspects = [i for i in range(driver.indicators.shape[1]) if driver.indicators[HIT, i] != 0.0]
    found = [crossing for i in suspects for crossing in _crossings_of(driver, i, partial(value_of, i))]
    return sorted(found)


def _crossings_of(driver: Driver, index: int, value: Callable[[float], float]) -> list[Crossing]:
    """Watched crossings of one indicator: between looks at which its sign differs."""
    column = driver.indicators[:, index]
    before, now, side = float(driver.real[TIME_BEFORE]), float(column[VALUE_BEFORE]), float(column[SIDE])
    found = []
    for t in _times_to_look(driver, column):
        earlier, now = now, (float(column[VALUE]) if t == driver.real[T_NEW] else value(t))
        if leaves(side, sign(now), column[DIRECTION]):
            crossed = sign(earlier) * sign(now) < 0.0
            found.append(Crossing(root(value, before, t, earlier, now) if crossed else before, index, int(sign(now))))
        side, before = sign(now) or side, t
    return found


def _times_to_look(driver: Driver, column: Array) -> list[float]:
    """Times after the start of the step, up to its end."""
    t0, t1, h = driver.real[TIME_BEFORE], driver.real[T_NEW], driver.real[H]
    turns = turning_points(column[VALUE_BEFORE], h * column[RATE_BEFORE], column[VALUE], h * column[RATE])
    inside = {float(t0 + x * h) for x in (*turns, *np.linspace(0.0, 1.0, LOOKS + 1)) if 0.0 < x < 1.0}
    return [*sorted(t for t in inside if t0 < t < t1), float(t1)]


def root(value: Callable[[float], float], a: float, b: float, at_a: float, at_b: float) -> float:
    """Zero of a function between a < b where its signs differ, by false position that halves the weight of an end that stays.

    Bisection where that is slow. Returns the end of the last interval that has the sign of b: what crossed has crossed there.
    """
    width, stays = TOLERANCE * max(abs(a), abs(b), b - a), 0
    for step in range(200):
        if b - a <= width or at_b == 0.0:
            break
        t = b - at_b * (b - a) / (at_b - at_a) if step % 3 != 2 else 0.5 * (a + b)
        t = min(max(t, a + 0.5 * width), b - 0.5 * width)
        at_t = value(t)
        if math.copysign(1.0, at_t) == math.copysign(1.0, at_b) or at_t == 0.0:
            b, at_b, at_a, stays = t, at_t, (0.5 * at_a if stays < 0 else at_a), -1
        else:
            a, at_a, at_b, stays = t, at_t, (0.5 * at_b if stays > 0 else at_b), 1
    return b
