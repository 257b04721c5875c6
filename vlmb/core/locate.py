"""When the indicators of a step cross 0: roots on the dense output."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from vlmb.core.calls import state_at
from vlmb.core.driver import DIRECTION, HIT, RATE, RATE_BEFORE, SIDE, T_NEW, TIME_BEFORE, VALUE, VALUE_BEFORE, Array, Driver, H
from vlmb.core.indicators import leaves, sign, turning_points

LOOKS = 8  # evenly spaced looks at an indicator in the step, besides those where its cubic turns
NEAREST = 1e-8  # of a turning point, relative to the larger of t and the step: its value is then right to rounding
PLAIN = 1e-3  # of the distance to 0: a search that gains less does not reach it
BESIDE = 20.0  # times that distance: where a turning point is looked for anew, once rounding has hidden its place
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
    side, found = float(column[SIDE]), []
    looks = with_turns(_looks(driver, column, value), value)
    for (before, earlier), (t, now) in itertools.pairwise(looks):
        if leaves(side, sign(now), column[DIRECTION]):
            crossed = sign(earlier) * sign(now) < 0.0
            found.append(Crossing(root(value, before, t, earlier, now) if crossed else before, index, int(sign(now))))
        side = sign(now) or side
    return found


def _looks(driver: Driver, column: Array, value: Callable[[float], float]) -> list[tuple[float, float]]:
    """Times in the step and an indicator's values there: both ends, even spaces, and where its cubic turns."""
    t0, t1, h = float(driver.real[TIME_BEFORE]), float(driver.real[T_NEW]), driver.real[H]
    turns = turning_points(column[VALUE_BEFORE], h * column[RATE_BEFORE], column[VALUE], h * column[RATE])
    inside = {float(t0 + x * h) for x in (*turns, *np.linspace(0.0, 1.0, LOOKS + 1)) if 0.0 < x < 1.0}
    between = [(t, value(t)) for t in sorted(inside) if t0 < t < t1]
    return [(t0, float(column[VALUE_BEFORE])), *between, (t1, float(column[VALUE]))]


def with_turns(looks: list[tuple[float, float]], value: Callable[[float], float]) -> list[tuple[float, float]]:
    """Add where an indicator is nearest to 0 between three looks that have one sign, the middle one the nearest."""
    found = list(looks)
    for (a, at_a), (b, at_b), (c, at_c) in zip(looks, looks[1:], looks[2:], strict=False):
        side = sign(at_b)
        if side * at_a > 0.0 and side * at_c > 0.0 and side * at_b <= min(side * at_a, side * at_c):
            turn = least(value, (a, b, c), (at_a, at_b, at_c), side)
            found.append(_closer(value, turn, (a, c), min(abs(at_a), abs(at_c)), side))
    return sorted(found)


def _closer(
    value: Callable[[float], float], turn: tuple[float, float], ends: tuple[float, float], size: float, side: float
) -> tuple[float, float]:
    """Look again beside a turning point so near to 0 that the values at the ends, of a size, hid its place by their rounding."""
    b, at_b = turn
    shift = BESIDE * NEAREST * max(abs(b), ends[1] - ends[0])
    if not (0.0 < side * at_b < NEAREST * size and ends[0] < b - shift and b + shift < ends[1]):
        return turn
    at_a, at_c = value(b - shift), value(b + shift)
    for t, found in ((b - shift, at_a), (b + shift, at_c)):
        if side * found <= side * at_b:
            return t, found
    return least(value, (b - shift, b, b + shift), (at_a, at_b, at_c), side, TOLERANCE * abs(b))


def least(
    value: Callable[[float], float], times: tuple[float, float, float], values: tuple[float, float, float], side: float,
    width: float | None = None,
) -> tuple[float, float]:  # fmt: skip
    """Where side * value is least between three times, the middle one the best so far, and the value there.

    By parabolas through the three best times, or a part of the wider side where these do not move; ends where the sign changes,
    where it is plain that it does not, and where the times are within a width [s].
    """
    (a, b, c), (at_a, at_b, at_c) = times, values
    width = NEAREST * max(abs(b), c - a) if width is None else max(width, NEAREST * (c - a))
    for k in range(30):
        left, right = (b - a) * (at_b - at_c), (b - c) * (at_b - at_a)
        rest = 2.0 * (left - right)
        t = b - ((b - a) * left - (b - c) * right) / rest if rest != 0.0 and k % 3 != 2 else b
        shift = NEAREST * (c - a)
        if not a < t < c or abs(t - b) < shift:
            t = b + (max(shift, 0.4 * (c - b)) if c - b > b - a else -max(shift, 0.4 * (b - a)))
        at_t = value(t)
        if side * at_t < 0.0:
            return t, at_t
        gain = side * (at_b - at_t)
        if gain > 0.0:
            (a, at_a), (c, at_c) = ((b, at_b), (c, at_c)) if t > b else ((a, at_a), (b, at_b))
            b, at_b = t, at_t
        elif t > b:
            c, at_c = t, at_t
        else:
            a, at_a = t, at_t
        if c - a < width or (k > 2 and 0.0 <= gain < PLAIN * abs(at_b)):
            break
    return b, at_b


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
