"""Intervals (low, high) as tuples: what a function can be while its argument is anywhere in one.

Ends are rounded as numbers are, not outwards: good for finding where something may happen, no proof.
A part of an interval outside a function's domain is left out.
"""

from __future__ import annotations

import math

from vlmb.core.jit import inner, kernel
from vlmb.core.scalars import TAU, acos, asin, atan2, cos, floor, sin, sqrt, tan

Interval = tuple[float, float]
INFINITE = math.inf


@kernel(inline=True)
def whole_line() -> Interval:
    """Return everything."""
    return -INFINITE, INFINITE


@inner
def hull(x: Interval, z: Interval) -> Interval:
    """Return the interval around two."""
    return min(x[0], z[0]), max(x[1], z[1])


@kernel
def plus(x: Interval, z: Interval) -> Interval:
    """Return x + z."""
    return x[0] + z[0], x[1] + z[1]


@inner
def minus(x: Interval, z: Interval) -> Interval:
    """Return x - z."""
    return x[0] - z[1], x[1] - z[0]


@inner
def product(x: float, z: float) -> float:
    """Return the product of two ends: 0 times infinity is 0."""
    return 0.0 if x == 0.0 or z == 0.0 else x * z


@kernel
def times(x: Interval, z: Interval) -> Interval:
    """Return x z."""
    a, b, c, d = product(x[0], z[0]), product(x[0], z[1]), product(x[1], z[0]), product(x[1], z[1])
    return min(min(a, b), min(c, d)), max(max(a, b), max(c, d))


@kernel
def scaled(k: float, x: Interval) -> Interval:
    """Return k x."""
    return times((k, k), x)


@inner
def reciprocal(x: Interval) -> Interval:
    """Return 1 / x; everything where x contains 0 inside."""
    if x[0] < 0.0 < x[1] or (x[0] == 0.0 and x[1] == 0.0):
        return whole_line()
    return (1.0 / x[1] if x[1] != 0.0 else -INFINITE), (1.0 / x[0] if x[0] != 0.0 else INFINITE)


@inner
def squared(x: Interval) -> Interval:
    """Return x^2."""
    a, b = x[0] * x[0], x[1] * x[1]
    return (0.0 if x[0] <= 0.0 <= x[1] else min(a, b)), max(a, b)


@inner
def rooted(x: Interval) -> Interval:
    """Return the square root."""
    return sqrt(max(x[0], 0.0)), sqrt(max(x[1], 0.0))


@kernel
def raised(x: Interval, exponent: float) -> Interval:
    """Return x^e; of exponents that are not whole where x is not negative."""
    if exponent < 0.0:
        return reciprocal(raised(x, -exponent))
    if exponent == 0.0:
        return 1.0, 1.0
    if exponent != floor(exponent):
        return max(x[0], 0.0) ** exponent, max(x[1], 0.0) ** exponent
    a, b = x[0] ** int(exponent), x[1] ** int(exponent)
    if exponent % 2.0 == 1.0:
        return a, b
    return (0.0 if x[0] <= 0.0 <= x[1] else min(a, b)), max(a, b)


@inner
def sine(x: Interval) -> Interval:
    """Return sin x: its ends, and 1 or -1 where a crest or a trough lies inside."""
    if not x[1] - x[0] < TAU:
        return -1.0, 1.0
    a, b = sin(x[0]), sin(x[1])
    crest = floor(x[1] / TAU - 0.25) > floor(x[0] / TAU - 0.25)
    trough = floor(x[1] / TAU + 0.25) > floor(x[0] / TAU + 0.25)
    return (-1.0 if trough else min(a, b)), (1.0 if crest else max(a, b))


@inner
def cosine(x: Interval) -> Interval:
    """Return cos x."""
    if not x[1] - x[0] < TAU:
        return -1.0, 1.0
    a, b = cos(x[0]), cos(x[1])
    crest = floor(x[1] / TAU) > floor(x[0] / TAU)
    trough = floor(x[1] / TAU + 0.5) > floor(x[0] / TAU + 0.5)
    return (-1.0 if trough else min(a, b)), (1.0 if crest else max(a, b))


@inner
def tangent(x: Interval) -> Interval:
    """Return tan x; everything where a pole lies inside."""
    if not x[1] - x[0] < 0.5 * TAU or floor(x[1] / (0.5 * TAU) + 0.5) > floor(x[0] / (0.5 * TAU) + 0.5):
        return whole_line()
    return tan(x[0]), tan(x[1])


@inner
def arcsine(x: Interval) -> Interval:
    """Return asin x within [-1, 1]."""
    return asin(min(max(x[0], -1.0), 1.0)), asin(min(max(x[1], -1.0), 1.0))


@inner
def arccosine(x: Interval) -> Interval:
    """Return acos x within [-1, 1]."""
    return acos(min(max(x[1], -1.0), 1.0)), acos(min(max(x[0], -1.0), 1.0))


@kernel
def turn(y: Interval, x: Interval) -> Interval:
    """Return atan2(y, x): its corners, or a full turn where the box meets the negative x axis."""
    if x[0] <= 0.0 and y[0] <= 0.0 <= y[1]:
        return -0.5 * TAU, 0.5 * TAU
    a, b, c, d = atan2(y[0], x[0]), atan2(y[0], x[1]), atan2(y[1], x[0]), atan2(y[1], x[1])
    return min(min(a, b), min(c, d)), max(max(a, b), max(c, d))


@inner
def absolute(x: Interval) -> Interval:
    """Return |x|."""
    a, b = abs(x[0]), abs(x[1])
    return (0.0 if x[0] <= 0.0 <= x[1] else min(a, b)), max(a, b)


@inner
def largest(x: Interval) -> float:
    """Return the largest |x|; infinite where unknown."""
    size = max(abs(x[0]), abs(x[1]))
    return size if size == size else INFINITE
