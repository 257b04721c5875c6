"""Radau IIA of order 5 with three stages for stiff motions (Hairer and Wanner, vol. II, section IV.8).

Simplified Newton iterations on the stages; the Jacobian by differences, which are asked for as evaluations, and kept as long as
the iterations converge well; the factors kept as long as the step stays. Dense output by the collocation polynomial.
"""

from __future__ import annotations

import math

from vlmb.core.driver import (
    ACCEPTED,
    ATOL,
    BEGIN,
    CHANGE,
    ERROR,
    ERROR_LAST,
    EVALUATE,
    F_NEW,
    FACTORED,
    FACTORED_H,
    H_LAST,
    H_NEXT,
    ITERATION,
    JACOBIAN,
    OWN,
    PIVOTS,
    RATE_OF_CHANGE,
    READY,
    REJECTED,
    RETRY,
    RTOL,
    STAGE,
    STEP_INDEX,
    T_NEW,
    TIME,
    TIME_BEFORE,
    Y_NEW,
    Array,
    Driver,
    F,
    H,
    Y,
)
from vlmb.core.first_step import is_finite
from vlmb.core.jit import inner, kernel
from vlmb.core.linear import factor, factor_complex, solve, solve_complex
from vlmb.core.radau_tables import ERROR as ERROR_WEIGHTS
from vlmb.core.radau_tables import FROM_STAGES, IM, NODES, POLYNOMIAL, RE, REAL, TO_STAGES

LAST_STAGE, NEW_STATE, REFINED, COLUMN = 2, 3, 4, 5  # stages: 0, 1, 2 of the method, then what else is asked for
ROUNDS, ERROR_WANTED = 6, 7  # what is to be done before the next is asked for
W, Z, K, Q, R = OWN, OWN + 3, OWN + 6, OWN + 9, OWN + 12  # rows, three each: transformed stages, stages, slopes, cubic, residuals
MATRICES = OWN + 15  # rows, n each: Jacobian, transposed; real matrix; real and imaginary part of the complex one
WANTED, FRESH, OLD = range(3)  # states of the Jacobian
F_AGAIN = -1  # its column before the first: f where it is taken, since a control may have moved on by trials ahead
MOST_ITERATIONS = 6
SAFETY, SHRINK, GROW, HALF, KEEP = 0.9, 0.2, 10.0, 0.5, 1.2
SLOW = 1e-3  # rate of convergence from which a new Jacobian pays
DIFFERENCE, SMALL = 2.0**-52, 1e-5


@inner
def next_radau(driver: Driver) -> int:
    """Take an answer and go on: the Jacobian's columns, rounds of three stages, the error, f at the new state."""
    stage = driver.counts[STAGE]
    wanted = _take(driver, stage)
    if wanted == ERROR_WANTED:
        wanted = _judge(driver, stage == REFINED)
    if wanted == ROUNDS:
        _prepare_rounds(driver)
        wanted = 0
    return wanted if wanted >= ACCEPTED else _ask(driver, wanted)


@inner
def _take(driver: Driver, stage: int) -> int:
    """Take an answer; return the stage wanted next, or a code."""
    if stage < 0:
        return _begin(driver) if stage == BEGIN else READY
    if stage == COLUMN:
        return _take_column(driver)
    if stage == REFINED:
        return ERROR_WANTED
    if stage == NEW_STATE:
        return _take_new(driver)
    for j in range(driver.slope.shape[0]):
        driver.rows[K + stage, j] = driver.slope[j]
    return stage + 1 if stage < LAST_STAGE else _iterate(driver)


@kernel
def _begin(driver: Driver) -> int:
    """Want a Jacobian, or go straight to the stages."""
    count = driver.counts
    first = count[STEP_INDEX] == 0 and not count[RETRY]
    if first:
        count[JACOBIAN] = WANTED
        driver.real[ERROR_LAST] = 0.0
    if count[JACOBIAN] != WANTED:
        return ROUNDS
    count[ITERATION] = F_AGAIN if first else 0
    return COLUMN


@kernel
def _ask(driver: Driver, stage: int) -> int:
    """Ask for f at a stage y + z, at y plus the error, or with one state moved a little."""
    rows, real = driver.rows, driver.real
    driver.counts[STAGE] = stage
    if stage <= NEW_STATE:
        shift, share = Z + min(stage, LAST_STAGE), 1.0
        real[TIME] = real[TIME_BEFORE] + NODES[stage] * real[H] if stage < LAST_STAGE else real[T_NEW]
    else:
        shift, share = R, 1.0 if stage == REFINED else 0.0
        real[TIME] = real[TIME_BEFORE]
    for j in range(driver.point.shape[0]):
        driver.point[j] = rows[Y, j] + share * rows[shift, j] if share != 0.0 else rows[Y, j]
    if stage == COLUMN:
        column = driver.counts[ITERATION]
        if column != F_AGAIN:
            driver.point[column] += _increment(driver.point[column], rows[F, column])
    return EVALUATE


@inner
def _increment(y: float, rate: float) -> float:
    """Difference in a state: the square root of rounding for states of about 1. Ahead: a law may have switched just before."""
    return math.copysign(math.sqrt(DIFFERENCE * max(SMALL, abs(y))), rate)


@inner
def _take_column(driver: Driver) -> int:
    """Row MATRICES + j is the derivative of f by state j."""
    rows, column = driver.rows, driver.counts[ITERATION]
    if column == F_AGAIN:
        for j in range(driver.slope.shape[0]):
            rows[F, j] = driver.slope[j]
        driver.counts[ITERATION] = 0
        return COLUMN
    moved = driver.point[column] - rows[Y, column]
    for j in range(driver.slope.shape[0]):
        rows[MATRICES + column, j] = (driver.slope[j] - rows[F, j]) / moved
    driver.counts[ITERATION] = column + 1
    if column + 1 < driver.point.shape[0]:
        return COLUMN
    driver.counts[JACOBIAN] = FRESH
    driver.counts[FACTORED] = 0
    return ROUNDS


@kernel
def _factor(driver: Driver) -> None:
    """Factors of gamma / h - J and of (alpha - i beta) / h - J."""
    rows, h, n = driver.rows, driver.real[H], driver.point.shape[0]
    real, re, im = rows[MATRICES + n : MATRICES + 2 * n], rows[MATRICES + 2 * n : MATRICES + 3 * n], rows[MATRICES + 3 * n :]
    for i in range(n):
        for j in range(n):
            entry = -rows[MATRICES + j, i]
            real[i, j] = entry
            re[i, j] = entry
            im[i, j] = 0.0
        real[i, i] += REAL / h
        re[i, i] += RE / h
        im[i, i] = -IM / h
    factor(real, driver.counts[PIVOTS : PIVOTS + n])
    factor_complex(re, im, driver.counts[PIVOTS + n :])
    driver.counts[FACTORED] = 1
    driver.real[FACTORED_H] = h


@inner
def _prepare_rounds(driver: Driver) -> None:
    """Factor what is not factored; guess the stages by the cubic of the step before, of a first step by its slope.

    Without that slope they would stay behind a switch that moves with time and has just been passed.
    """
    count, real, rows = driver.counts, driver.real, driver.rows
    if count[FACTORED] == 0 or real[FACTORED_H] != real[H]:
        _factor(driver)
    for stage in range(3):
        x = 1.0 + NODES[stage] * real[H] / real[H_LAST] if count[STEP_INDEX] > 0 else 0.0
        for j in range(driver.point.shape[0]):
            # the cubic starts at the state before this one: less its value at this one
            q0, q1, q2 = rows[Q, j], rows[Q + 1, j], rows[Q + 2, j]
            guess = x * (q0 + x * (q1 + x * q2)) - (q0 + q1 + q2)
            rows[Z + stage, j] = guess if count[STEP_INDEX] > 0 else NODES[stage] * real[H] * rows[F, j]
    _transform(rows, Z, W, FROM_STAGES)
    count[ITERATION] = 0
    real[CHANGE] = 0.0
    real[RATE_OF_CHANGE] = 0.0


@inner
def _transform(rows: Array, source: int, target: int, matrix: Array) -> None:
    """Three rows from three rows."""
    for i in range(3):
        a, b, c = matrix[i, 0], matrix[i, 1], matrix[i, 2]
        for j in range(rows.shape[1]):
            rows[target + i, j] = a * rows[source, j] + b * rows[source + 1, j] + c * rows[source + 2, j]


@inner
def _iterate(driver: Driver) -> int:
    """One Newton step on all stages; go on, finish, or give up by how fast the changes get smaller."""
    count, real = driver.counts, driver.real
    before = real[CHANGE]
    change = _newton_step(driver)
    count[ITERATION] += 1
    left = MOST_ITERATIONS - count[ITERATION]
    tolerance = max(10.0 * DIFFERENCE / real[RTOL], min(0.03, math.sqrt(real[RTOL])))
    rate = change / before if before > 0.0 else 0.0
    real[CHANGE], real[RATE_OF_CHANGE] = change, rate
    first = count[ITERATION] == 1
    if not (math.isfinite(change) and rate < 1.0) or (not first and rate**left / (1.0 - rate) * change > tolerance):
        return _give_up(driver)
    if change == 0.0 or (not first and rate / (1.0 - rate) * change < tolerance):
        return _converge(driver)
    return 0 if left > 0 else _give_up(driver)


@inner
def _newton_step(driver: Driver) -> float:
    """W += dW with (mu / h - J) dW = T^-1 f - mu W / h, Z = T W; return the norm of dW."""
    rows, real, n = driver.rows, driver.real, driver.point.shape[0]
    gamma, alpha, beta = REAL / real[H], RE / real[H], IM / real[H]
    _transform(rows, K, R, FROM_STAGES)
    for j in range(n):
        w1, w2 = rows[W + 1, j], rows[W + 2, j]
        rows[R, j] -= gamma * rows[W, j]
        rows[R + 1, j] -= alpha * w1 + beta * w2
        rows[R + 2, j] -= alpha * w2 - beta * w1
    re, im = rows[MATRICES + 2 * n : MATRICES + 3 * n], rows[MATRICES + 3 * n :]
    solve(rows[MATRICES + n : MATRICES + 2 * n], driver.counts[PIVOTS : PIVOTS + n], rows[R])
    solve_complex(re, im, driver.counts[PIVOTS + n :], rows[R + 1], rows[R + 2])
    total = 0.0
    for i in range(3):
        for j in range(n):
            total += (rows[R + i, j] / (real[ATOL] + real[RTOL] * abs(rows[Y, j]))) ** 2
            rows[W + i, j] += rows[R + i, j]
    _transform(rows, W, Z, TO_STAGES)
    return math.sqrt(total / (3 * n))


@inner
def _give_up(driver: Driver) -> int:
    """Iterate again with a Jacobian of this place, or with half the step."""
    if driver.counts[JACOBIAN] != FRESH:
        driver.counts[ITERATION] = F_AGAIN
        return COLUMN
    driver.real[H_NEXT] = HALF * driver.real[H]
    return REJECTED


@inner
def _converge(driver: Driver) -> int:
    """Take the last stage for the new state; its error is wanted, first with f of the start."""
    rows = driver.rows
    for j in range(driver.point.shape[0]):
        rows[Y_NEW, j] = rows[Y, j] + rows[Z + LAST_STAGE, j]
        driver.slope[j] = rows[F, j]
    return ERROR_WANTED


@kernel
def _error(driver: Driver) -> float:
    """Norm of the error (gamma / h - J)^-1 (f + e Z / h) over the tolerance; f is the slope, the error stays in row R."""
    rows, real, slope, n = driver.rows, driver.real, driver.slope, driver.point.shape[0]
    a, b, c = ERROR_WEIGHTS[0] / real[H], ERROR_WEIGHTS[1] / real[H], ERROR_WEIGHTS[2] / real[H]
    for j in range(n):
        rows[R, j] = slope[j] + a * rows[Z, j] + b * rows[Z + 1, j] + c * rows[Z + 2, j]
    solve(rows[MATRICES + n : MATRICES + 2 * n], driver.counts[PIVOTS : PIVOTS + n], rows[R])
    total = 0.0
    for j in range(n):
        total += (rows[R, j] / (real[ATOL] + real[RTOL] * max(abs(rows[Y, j]), abs(rows[Y_NEW, j])))) ** 2
    return math.sqrt(total / n)


@kernel
def _judge(driver: Driver, refined: bool) -> int:
    """Want f at the new state, or refuse the step; a second refusal only with f at y plus the error."""
    count, real = driver.counts, driver.real
    error = _error(driver)
    real[ERROR] = error
    if error <= 1.0:
        return NEW_STATE
    if not refined and (count[RETRY] or count[STEP_INDEX] == 0):
        return REFINED
    real[H_NEXT] = real[H] * max(SHRINK, _factor_by_error(driver)) if math.isfinite(error) else SHRINK * real[H]
    return REJECTED


@inner
def _factor_by_error(driver: Driver) -> float:
    """Factor of the next step by the last two errors (Gustafsson), less where the iterations were many."""
    real, spent = driver.real, driver.counts[ITERATION]
    if real[ERROR] == 0.0:
        return GROW
    trend = 1.0
    if real[ERROR_LAST] > 0.0 and driver.counts[STEP_INDEX] > 0:
        trend = real[H] / real[H_LAST] * (real[ERROR_LAST] / real[ERROR]) ** 0.25
    most = 2 * MOST_ITERATIONS + 1
    return SAFETY * most / (most - 1 + spent) * min(1.0, trend) * real[ERROR] ** -0.25


@inner
def _take_new(driver: Driver) -> int:
    """Keep f at the new state and the cubic; choose the next step, and what of Jacobian and factors is kept."""
    count, real, rows = driver.counts, driver.real, driver.rows
    if not is_finite(driver.slope):
        real[H_NEXT] = SHRINK * real[H]
        return REJECTED
    for j in range(driver.slope.shape[0]):
        rows[F_NEW, j] = driver.slope[j]
    _transform(rows, Z, Q, POLYNOMIAL)
    growth = min(GROW, _factor_by_error(driver))
    slow = count[ITERATION] > 2 and real[RATE_OF_CHANGE] > SLOW
    if not slow and growth < KEEP:
        growth = 1.0
    count[JACOBIAN] = WANTED if slow else OLD
    real[H_NEXT] = growth * real[H]
    real[ERROR_LAST] = real[ERROR]
    return ACCEPTED


@inner
def interpolate_radau(driver: Driver, t: float, y: Array) -> None:
    """y(t) = y0 + x (q0 + x (q1 + x q2)), x = (t - t0) / h."""
    rows = driver.rows
    x = (t - driver.real[TIME_BEFORE]) / driver.real[H]
    for j in range(y.shape[0]):
        y[j] = rows[Y, j] + x * (rows[Q, j] + x * (rows[Q + 1, j] + x * rows[Q + 2, j]))
