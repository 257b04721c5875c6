"""Norms, and the length of a first step."""

from __future__ import annotations

import math

from vlmb.core.driver import ATOL, END, FAILURE, H_MAX, METHOD, RTOL, TIME, TIME_BEFORE, Array, Driver, F, H, Y
from vlmb.core.jit import inner

SHARE, TINY, ORDERS = 0.01, 1e-6, (1, 4, 4, 7, 2, 3)  # of the error estimates, by method


@inner
def is_finite(values: Array) -> bool:
    """Whether no entry is infinite or not a number."""
    one, two, three, four = 0.0, 0.0, 0.0, 0.0  # not a number if any is infinite or none; four sums wait less for each other
    fours = values.shape[0] // 4
    for j in range(fours):
        one += 0.0 * values[4 * j]
        two += 0.0 * values[4 * j + 1]
        three += 0.0 * values[4 * j + 2]
        four += 0.0 * values[4 * j + 3]
    for j in range(4 * fours, values.shape[0]):
        one += 0.0 * values[j]
    return one + two + (three + four) == 0.0


@inner
def scaled_norm(driver: Driver, values: Array) -> float:
    """Root mean square of values over atol + rtol |y|, y at the start of the step."""
    y, count, rtol, atol, total = driver.rows[Y], driver.point.shape[0], driver.real[RTOL], driver.real[ATOL], 0.0
    for j in range(count):
        total += (values[j] / (atol + rtol * abs(y[j]))) ** 2
    return math.sqrt(total / max(1, count))


@inner
def ask_probe(driver: Driver) -> None:
    """Ask for f at the end of an Euler step so short that it changes y by a hundredth."""
    real, rows = driver.real, driver.rows
    size = scaled_norm(driver, rows[Y])
    slope = scaled_norm(driver, rows[F])
    h = TINY if size < 1e-5 or slope < 1e-5 else SHARE * size / slope
    real[H] = min(h, real[H_MAX], real[END] - real[TIME_BEFORE])
    for j in range(driver.point.shape[0]):
        driver.point[j] = rows[Y, j] + real[H] * rows[F, j]
    real[TIME] = min(real[TIME_BEFORE] + real[H], real[END])


@inner
def step_from_probe(driver: Driver) -> float:
    """Step [s] by the size of f and of its change, for an error of a hundredth: (0.01 / max(|f|, |f'|))^(1 / (order + 1))."""
    real, rows, change = driver.real, driver.rows, driver.slope
    if driver.counts[FAILURE] or not is_finite(change):
        return SHARE * real[H]
    order = ORDERS[driver.counts[METHOD]]
    slope = scaled_norm(driver, rows[F])
    for j in range(change.shape[0]):
        change[j] -= rows[F, j]
    bend = scaled_norm(driver, change) / real[H]
    largest = max(slope, bend)
    h = max(TINY, 1e-3 * real[H]) if largest <= 1e-15 else (SHARE / largest) ** (1.0 / (order + 1.0))
    return min(100.0 * real[H], h)
