"""Given functions of time, polynomials of degree 5 in pieces: derivatives at a time, and what they can be in an interval.

Rows of `series` are pieces: where one begins, then the coefficients of (t - begin)^k. The row after the last says where it ends.
"""

from __future__ import annotations

from vlmb.core.jit import inner, kernel
from vlmb.core.scalars import NAN
from vlmb.core.tree import Array

FIRST, END, ORDER = range(3)  # columns of `signal`: its pieces are the rows FIRST <= row < END; which derivative it is
KNOT, LOWEST = range(2)  # columns of `series`
DEGREE, WIDTH = 5, 7
SLACK = 1e-9  # of the whole time: a time that is as far outside counts as rounding


@kernel
def piece_at(series: Array, first: int, end: int, t: float) -> int:
    """Return the row of the piece that a time lies in; the first or last one for times outside."""
    low, high = first, end - 1
    while low < high:
        middle = (low + high + 1) // 2
        if series[middle, KNOT] <= t:
            low = middle
        else:
            high = middle - 1
    return low


@kernel
def derivative(series: Array, row: int, u: float, order: int) -> float:
    """Return a derivative of a piece at a distance from where it begins."""
    total = 0.0
    for k in range(DEGREE, order - 1, -1):
        factor = 1.0
        for j in range(order):
            factor *= k - j
        total = total * u + factor * series[row, LOWEST + k]
    return total


@kernel
def outside(series: Array, first: int, end: int, t: float) -> bool:
    """Tell whether a time lies outside what is given, by more than rounding."""
    slack = SLACK * (series[end, KNOT] - series[first, KNOT])
    return not (series[first, KNOT] - slack <= t <= series[end, KNOT] + slack)


@kernel
def signal_jet(series: Array, first: int, end: int, order: int, t: float) -> tuple[float, float, float]:
    """Return the derivatives `order` (0, 1 or 2) and the next two at a time; nan outside what is given."""
    if outside(series, first, end, t):
        return NAN, NAN, NAN
    row = piece_at(series, first, end, t)
    u, c2, c3 = t - series[row, KNOT], series[row, LOWEST + 2], series[row, LOWEST + 3]
    c4, c5 = series[row, LOWEST + 4], series[row, LOWEST + 5]
    second = 2.0 * c2 + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5))
    if order == 2:
        return second, 6.0 * c3 + u * (24.0 * c4 + u * 60.0 * c5), 24.0 * c4 + u * 120.0 * c5
    first_one = series[row, LOWEST + 1] + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))
    if order == 1:
        return first_one, second, 6.0 * c3 + u * (24.0 * c4 + u * 60.0 * c5)
    return series[row, LOWEST] + u * (series[row, LOWEST + 1] + u * (c2 + u * (c3 + u * (c4 + u * c5)))), first_one, second


@inner
def widen_box(series: Array, row: int, order: int, low: float, high: float, box: Array) -> None:
    """Widen `box` (6,) by the derivatives `order` and the next two of a piece for low <= t <= high, by Taylor's sums."""
    radius, middle = 0.5 * (high - low), 0.5 * (low + high) - series[row, KNOT]
    for j in range(3):
        centre, spread, weight = derivative(series, row, middle, order + j), 0.0, 1.0
        for k in range(1, DEGREE + 1 - order - j):
            weight *= radius / k
            spread += weight * abs(derivative(series, row, middle, order + j + k))
        box[2 * j] = min(box[2 * j], centre - spread)
        box[2 * j + 1] = max(box[2 * j + 1], centre + spread)


@kernel
def signal_box(series: Array, first: int, end: int, order: int, low: float, high: float, box: Array) -> None:
    """Write what the derivatives `order` and the next two can be for low <= t <= high; outside what is given they stay."""
    low = min(max(low, series[first, KNOT]), series[end, KNOT])
    high = min(max(high, series[first, KNOT]), series[end, KNOT])
    row = piece_at(series, first, end, low)
    u = low - series[row, KNOT]
    for j in range(3):
        box[2 * j] = box[2 * j + 1] = derivative(series, row, u, order + j)
    while row < end and (series[row, KNOT] < high or row == first):
        widen_box(series, row, order, max(low, series[row, KNOT]), min(high, series[row + 1, KNOT]), box)
        row += 1
