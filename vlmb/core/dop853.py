"""DOP853: Runge-Kutta of order 8 by Dormand and Prince with step control by orders 5 and 3, and dense output of order 7."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vlmb.core.dop853_tables import DENSE, ERRORS, NODES, STAGES
from vlmb.core.driver import (
    ACCEPTED,
    ATOL,
    BEGIN,
    BEGIN_DENSE,
    ERROR,
    EVALUATE,
    F_NEW,
    H_NEXT,
    OWN,
    READY,
    REJECTED,
    RETRY,
    RTOL,
    STAGE,
    T_NEW,
    TIME,
    TIME_BEFORE,
    Y_NEW,
    Array,
    Driver,
    F,
    H,
    Integers,
    Y,
)
from vlmb.core.first_step import is_finite
from vlmb.core.jit import inner, kernel
from vlmb.core.lanes import LANES, by_fours

NEW_STATE, EXTRA = 12, 13  # the stage that is the new state, the first of those for the dense output alone
WIDTH = 4  # slopes added in one pass over the state
POWERS = OWN + 14  # rows of the seven coefficients of the dense output
TRIAL = POWERS  # where states of stages are summed up before
SAFETY, SHRINK, GROW, EXPONENT = 0.85, 0.2, 10.0, -1.0 / 8.0
# After an accepted step the next goes half the way to what the error asks for, in exponents: errors swing with the springs, and a
# step that follows them is refused every third time. On chains and skiers that saves 15 to 25 % of the time to an error.
DAMPED = 0.5 * EXPONENT


def _row(stage: int) -> int:
    """Row in which the slope of a stage is kept."""
    return {0: F, NEW_STATE: F_NEW}.get(stage, OWN + stage - (1 if stage < NEW_STATE else 2))


def _blocks(combinations: Sequence[dict[int, float]]) -> tuple[Integers, Integers, Array]:
    """Lay out sums of slopes in blocks of WIDTH: first block of each, rows and weights of each block."""
    first, rows, weights = [0], [], []
    for combination in combinations:
        terms = [(_row(stage), weight) for stage, weight in combination.items()]
        terms += [(F, 0.0)] * (-len(terms) % WIDTH)
        for at in range(0, len(terms), WIDTH):
            rows.append([row for row, _ in terms[at : at + WIDTH]])
            weights.append([weight for _, weight in terms[at : at + WIDTH]])
        first.append(len(rows))
    return np.array(first, dtype=np.int64), np.array(rows, dtype=np.int64), np.array(weights)


FIRST, ROWS, WEIGHTS = _blocks([*STAGES, *ERRORS, *DENSE])
NODE = np.array(NODES)
FIFTH, THIRD, HIGH_POWERS = len(STAGES), len(STAGES) + 1, len(STAGES) + 2  # further combinations


@inner
def add_slopes(rows: Array, combination: int, scale: float, total: int) -> None:
    """Add scale sum_s weight_s k_s to a row."""
    states = by_fours(rows)
    for block in range(FIRST[combination], FIRST[combination + 1]):
        i, j, k, l = ROWS[block, 0], ROWS[block, 1], ROWS[block, 2], ROWS[block, 3]  # noqa: E741
        a, b, c, d = scale * WEIGHTS[block, 0], scale * WEIGHTS[block, 1], scale * WEIGHTS[block, 2], scale * WEIGHTS[block, 3]
        for m in range(rows.shape[1] // LANES):
            states[total, m] += (a * states[i, m] + b * states[j, m]) + (c * states[k, m] + d * states[l, m])


@inner
def _ask(driver: Driver, stage: int) -> int:
    """Ask for the slope of a stage: f(t + c h, y + h sum a k)."""
    real, rows, point = driver.real, driver.rows, driver.point
    for m in range(rows.shape[1]):
        rows[TRIAL, m] = rows[Y, m]
    add_slopes(rows, stage, real[H], TRIAL)
    for m in range(point.shape[0]):
        point[m] = rows[TRIAL, m]
    driver.counts[STAGE] = stage
    at_end = stage == NEW_STATE or stage == NEW_STATE - 1
    real[TIME] = real[T_NEW] if at_end else min(real[TIME_BEFORE] + NODE[stage] * real[H], real[T_NEW])
    return EVALUATE


@inner
def next_dop853(driver: Driver) -> int:
    """Take the slope of a stage and ask for the next, until the step is accepted or not, or its dense output ready."""
    stage = driver.counts[STAGE]
    if stage >= 0:
        _keep(driver.rows, _row_of(stage), driver.slope)
    if stage == NEW_STATE:
        driver.real[H_NEXT] = driver.real[H] * _growth(driver)
        return ACCEPTED
    if stage == EXTRA + 2:
        _make_powers(driver)
        if is_finite(driver.rows[POWERS + 6]):
            return READY
        driver.real[H_NEXT] = SHRINK * driver.real[H]
        return REJECTED
    code = _ask(driver, 1 if stage == BEGIN else EXTRA if stage == BEGIN_DENSE else stage + 1)
    return code if driver.counts[STAGE] != NEW_STATE else _judge(driver, code)


@kernel
def _judge(driver: Driver, code: int) -> int:
    """Keep the new state; its slope, which `code` asks for, is wanted only if the error is below the tolerance."""
    _keep(driver.rows, Y_NEW, driver.point)
    error = _error(driver)
    driver.real[ERROR] = error
    if error < 1.0:
        return code
    shrink = max(SHRINK, SAFETY * error**EXPONENT) if error < 1e30 else SHRINK  # not a number: SHRINK
    driver.real[H_NEXT] = driver.real[H] * shrink
    return REJECTED


@inner
def _row_of(stage: int) -> int:
    if stage == NEW_STATE:
        return F_NEW
    return OWN + stage - (1 if stage < NEW_STATE else 2)


@inner
def _keep(rows: Array, row: int, values: Array) -> None:
    for m in range(values.shape[0]):
        rows[row, m] = values[m]


@inner
def _error(driver: Driver) -> float:
    """Norm of the error over the tolerance: |h| e5^2 / sqrt(e5^2 + 0.01 e3^2), which is of order 8."""
    rows, n = driver.rows, driver.point.shape[0]
    fifth, third = rows[POWERS], rows[POWERS + 1]
    fifth[:] = 0.0
    third[:] = 0.0
    add_slopes(rows, FIFTH, 1.0, POWERS)
    add_slopes(rows, THIRD, 1.0, POWERS + 1)
    e5, e3 = 0.0, 0.0
    for m in range(n):
        weight = 1.0 / (driver.real[ATOL] + driver.real[RTOL] * max(abs(rows[Y, m]), abs(rows[Y_NEW, m])))
        e5 += (fifth[m] * weight) ** 2
        e3 += (third[m] * weight) ** 2
    if e5 == 0.0 and e3 == 0.0:
        return 0.0
    return abs(driver.real[H]) * e5 / math.sqrt((e5 + 0.01 * e3) * n)


@inner
def _growth(driver: Driver) -> float:
    """Factor of the next step; it does not grow straight after a refusal."""
    error = driver.real[ERROR]
    growth = GROW if error == 0.0 else min(GROW, SAFETY * error**DAMPED)
    return min(1.0, growth) if driver.counts[RETRY] else growth


@inner
def _make_powers(driver: Driver) -> None:
    """Coefficients of the dense output, from all slopes of the step."""
    rows, h = driver.rows, driver.real[H]
    for m in range(driver.point.shape[0]):
        rise = rows[Y_NEW, m] - rows[Y, m]
        rows[POWERS, m] = rise
        rows[POWERS + 1, m] = h * rows[F, m] - rise
        rows[POWERS + 2, m] = 2.0 * rise - h * (rows[F_NEW, m] + rows[F, m])
    for power in range(4):
        rows[POWERS + 3 + power][:] = 0.0
        add_slopes(rows, HIGH_POWERS + power, h, POWERS + 3 + power)


@inner
def interpolate_dop853(driver: Driver, t: float, y: Array) -> None:
    """y(t) = y0 + x (q0 + (1 - x) (q1 + x (q2 + ...))), x = (t - t0) / h in [0, 1]."""
    rows = driver.rows
    x = (t - driver.real[TIME_BEFORE]) / driver.real[H]
    for m in range(y.shape[0]):
        value = rows[POWERS + 6, m]
        for power in range(5, -1, -1):
            value = rows[POWERS + power, m] + (x if power % 2 else 1.0 - x) * value
        y[m] = rows[Y, m] + x * value
