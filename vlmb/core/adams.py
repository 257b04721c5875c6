"""Adams' method of variable order and step: predict, evaluate, correct, evaluate.

The past is kept as modified divided differences phi_1 ... phi_(k+1) of f (Shampine and Gordon, Computer Solution of Ordinary
Differential Equations, chapters 5 to 7), which a change of step only scales. A trial changes none of them, so that it may be
given up at any time.
"""

from __future__ import annotations

import math

from vlmb.core.adams_tables import ERROR_CONSTANTS, HIGHEST, NODES, POWERS_OF_TWO, WEIGHTS
from vlmb.core.driver import (
    ACCEPTED,
    ATOL,
    BEGIN,
    EQUAL_STEPS,
    ERROR,
    ERROR_LOWER,
    EVALUATE,
    F_NEW,
    H_LAST,
    H_NEXT,
    LAST_ORDER,
    NEXT_ORDER,
    ORDER,
    OWN,
    RAISING,
    READY,
    REFUSALS,
    REJECTED,
    RETRY,
    RTOL,
    STAGE,
    STEP_INDEX,
    T_NEW,
    TIME,
    Y_NEW,
    Array,
    Driver,
    F,
    H,
    Y,
)
from vlmb.core.first_step import is_finite
from vlmb.core.jit import inner
from vlmb.core.lanes import LANES, by_fours, side_by_side, sum_of, wide

PHI = OWN  # rows PHI + i, i = 1 ... k + 2
PREDICTED = OWN + 16  # rows of the same differences at the new time, by the predictor
SCALE = OWN + 30  # row of 1 / (atol + rtol |y|) at the start of the step
INSIDE = OWN + 31  # row of a state within the step
ALPHA, BETA, SIGMA, G, PSI, NEW_PSI, G_INSIDE = range(7)  # rows of the table, columns from 1; the last for the interpolation
PREDICTION, CORRECTION = 0, 1  # which slope is asked for
SLOWEST, FASTEST, COLLAPSE = 0.5, 0.9, 0.1  # factors of a shorter step


@inner
def _begin(driver: Driver) -> int:
    """Predict y at T_NEW by all differences of the order; ask for f there."""
    count, real = driver.counts, driver.real
    if count[RETRY]:
        count[RAISING] = 0
    if count[STEP_INDEX] == 0:
        _forget(driver)
    if real[H] == real[H_LAST] and count[STEP_INDEX] > 0:
        count[EQUAL_STEPS] = min(count[EQUAL_STEPS], count[LAST_ORDER]) + 1
    else:
        count[EQUAL_STEPS] = 1
    if not (count[ORDER] == count[LAST_ORDER] and count[EQUAL_STEPS] > count[ORDER]):  # else they are those of the last step
        _make_coefficients(driver.table, real[H], count[ORDER])
    _predict(driver, count[ORDER])
    return _ask_new(driver, PREDICTION)


@inner
def _forget(driver: Driver) -> None:
    """Begin with order 1, to be raised at every step until that fails."""
    count = driver.counts
    count[ORDER] = 1
    count[LAST_ORDER] = 0
    if not count[RETRY]:
        count[RAISING] = 1
        count[REFUSALS] = 0
    for j in range(driver.point.shape[0]):
        driver.rows[PHI + 1, j] = driver.rows[F, j]
        driver.rows[PHI + 2, j] = 0.0


@inner
def _ask_new(driver: Driver, stage: int) -> int:
    """Ask for f(T_NEW, Y_NEW)."""
    driver.counts[STAGE] = stage
    driver.real[TIME] = driver.real[T_NEW]
    for j in range(driver.point.shape[0]):
        driver.point[j] = driver.rows[Y_NEW, j]
    return EVALUATE


@inner
def _make_coefficients(table: Array, h: float, k: int) -> None:
    """Lengths psi_i of the last i steps, their ratios alpha, beta, sigma, and integrals g_i of i-th differences over the step."""
    table[NEW_PSI, 1], table[ALPHA, 1], table[BETA, 1], table[SIGMA, 1], table[SIGMA, 2] = h, 1.0, 1.0, 1.0, 1.0
    for i in range(2, k + 1):
        table[NEW_PSI, i] = table[PSI, i - 1] + h
        table[BETA, i] = table[BETA, i - 1] * (table[NEW_PSI, i - 1] / table[PSI, i - 1])
        table[ALPHA, i] = h / table[NEW_PSI, i]
        table[SIGMA, i + 1] = i * table[ALPHA, i] * table[SIGMA, i]
    _integrate(table, G, NEW_PSI, h, k + 1)


@inner
def _integrate(table: Array, row: int, lengths: int, s: float, count: int) -> None:
    """g_i = integral over u = 0 ... 1 of the product over j < i of (s u + psi_(j-1)) / length_j, psi_0 = 0, by Gauss."""
    nodes, weights = wide(NODES), wide(WEIGHTS)
    one, two = weights[0], weights[1]  # times the products, at four nodes each
    table[row, 1] = 1.0
    for i in range(2, count + 1):
        inverse = 1.0 / table[lengths, i - 1]
        slope, start = s * inverse, table[PSI, i - 2] * inverse
        one, two = one * (slope * nodes[0] + start), two * (slope * nodes[1] + start)
        table[row, i] = sum_of(one + two)


@inner
def _predict(driver: Driver, k: int) -> None:
    """y1 = y0 + h sum g_i beta_i phi_i; the i-th difference at the new time is the sum of all beta phi from i on."""
    states, table, h = by_fours(driver.rows), driver.table, driver.real[H]
    rtol, atol = driver.real[RTOL], driver.real[ATOL]
    for m in range(driver.rows.shape[1] // LANES):
        states[SCALE, m] = 1.0 / (atol + rtol * abs(states[Y, m]))
        scaled = table[BETA, k] * states[PHI + k, m]
        difference, new = scaled, states[Y, m] + (h * table[G, k]) * scaled
        states[PREDICTED + k, m] = difference
        for i in range(k - 1, 0, -1):
            scaled = table[BETA, i] * states[PHI + i, m]
            difference, new = difference + scaled, new + (h * table[G, i]) * scaled
            states[PREDICTED + i, m] = difference
        states[Y_NEW, m] = new


@inner
def next_adams(driver: Driver) -> int:
    """Judge the prediction by f there and correct it; or take f of the corrected state and choose the next order and step."""
    stage = driver.counts[STAGE]
    if stage < 0:
        return _begin(driver) if stage == BEGIN else READY  # the differences are the dense output
    if stage == PREDICTION:
        return _correct(driver)
    if not is_finite(driver.slope):
        driver.real[H_NEXT] = COLLAPSE * driver.real[H]
        return REJECTED
    _update_differences(driver)
    _choose_next(driver)
    return ACCEPTED


@inner
def _correct(driver: Driver) -> int:
    """y1 + h g_(k+1) (f - predicted f), if the error h (g_k - g_(k+1)) |f - predicted f| is below the tolerance."""
    count, real, rows, table = driver.counts, driver.real, driver.rows, driver.table
    k, h = count[ORDER], real[H]
    _keep_slope(driver)
    miss, lower, lowest = _norms(driver, k)
    lower = h * table[SIGMA, k] * ERROR_CONSTANTS[k - 1] * lower if k > 1 else 0.0
    lowest = h * table[SIGMA, k - 1] * ERROR_CONSTANTS[k - 2] * lowest if k > 2 else 0.0
    error = h * miss * table[SIGMA, k + 1] * ERROR_CONSTANTS[k]
    lowers = max(lower, lowest) <= error if k > 2 else (k == 2 and lower <= 0.5 * error)
    count[NEXT_ORDER] = k - 1 if lowers else k
    real[ERROR], real[ERROR_LOWER] = error, lower
    if not h * miss * (table[G, k] - table[G, k + 1]) <= 1.0:
        return _reject(driver, miss)
    count[REFUSALS] = 0
    states, weight = by_fours(rows), h * table[G, k + 1]
    for m in range(rows.shape[1] // LANES):
        states[Y_NEW, m] += weight * (states[F_NEW, m] - states[PREDICTED + 1, m])
    return _ask_new(driver, CORRECTION)


@inner
def _keep_slope(driver: Driver) -> None:
    """Take the answer into the rows."""
    for j in range(driver.slope.shape[0]):
        driver.rows[F_NEW, j] = driver.slope[j]


@inner
def _norms(driver: Driver, k: int) -> tuple[float, float, float]:
    """Norms of what f differs from its prediction, alone and with the predicted k-th and (k-1)-th differences."""
    states, total = by_fours(driver.rows), side_by_side(0.0, 0.0, 0.0, 0.0)
    lower, lowest = total, total
    for m in range(driver.rows.shape[1] // LANES):
        scale, miss = states[SCALE, m], states[F_NEW, m] - states[PREDICTED + 1, m]
        one, two, three = miss, miss + states[PREDICTED + k, m], miss + states[PREDICTED + k - 1, m]  # k = 1: nobody reads three
        one, two, three = one * scale, two * scale, three * scale
        total, lower, lowest = total + one * one, lower + two * two, lowest + three * three
    share = 1.0 / driver.slope.shape[0]
    return math.sqrt(share * sum_of(total)), math.sqrt(share * sum_of(lower)), math.sqrt(share * sum_of(lowest))


@inner
def _reject(driver: Driver, miss: float) -> int:
    """Halve the step; from the third refusal on, start again with order 1."""
    count, real = driver.counts, driver.real
    count[RAISING] = 0
    count[REFUSALS] += 1
    factor = 0.5
    if count[REFUSALS] > 3 and real[ERROR] > 2.0:
        factor = math.sqrt(0.5 / real[ERROR])
    if not miss < 1e300:
        factor = COLLAPSE
    if count[REFUSALS] >= 3 or not miss < 1e300:
        count[NEXT_ORDER] = 1
    count[ORDER] = count[NEXT_ORDER]
    real[H_NEXT] = factor * real[H]
    return REJECTED


@inner
def _update_differences(driver: Driver) -> None:
    """phi_i at the new time: the predicted ones plus what f differs from its prediction; of order k + 2 that of equal steps."""
    table, k = driver.table, driver.counts[ORDER]
    _keep_slope(driver)
    for i in range(1, k + 1):
        table[PSI, i] = table[NEW_PSI, i]
    states = by_fours(driver.rows)
    for m in range(driver.rows.shape[1] // LANES):
        miss = states[F_NEW, m] - states[PREDICTED + 1, m]
        states[PHI + k + 2, m] = miss - states[PHI + k + 1, m]
        states[PHI + k + 1, m] = miss
        for i in range(1, k + 1):
            states[PHI + i, m] = states[PREDICTED + i, m] + miss
    driver.counts[LAST_ORDER] = k


@inner
def _choose_next(driver: Driver) -> None:
    """Raise or lower the order to where the error is least; double the step or shorten it only where that gains."""
    count, real = driver.counts, driver.real
    k, error = count[ORDER], real[ERROR]
    if count[NEXT_ORDER] < k or k == HIGHEST:
        count[RAISING] = 0
    if count[RAISING]:
        k, error = k + 1, 0.0
    elif count[NEXT_ORDER] < k:
        k, error = k - 1, real[ERROR_LOWER]
    elif k + 1 <= count[EQUAL_STEPS]:
        higher = real[H] * ERROR_CONSTANTS[k + 1] * _norm(driver, PHI + k + 2)
        if k > 1 and real[ERROR_LOWER] <= min(error, higher):
            k, error = k - 1, real[ERROR_LOWER]
        elif k < HIGHEST and higher < (error if k > 1 else 0.5 * error):
            k, error = k + 1, higher
    count[ORDER] = k
    real[H_NEXT] = real[H] * _factor(error, k, count[RAISING] != 0)


@inner
def _norm(driver: Driver, row: int) -> float:
    """Norm of a row over the tolerance."""
    states, total = by_fours(driver.rows), side_by_side(0.0, 0.0, 0.0, 0.0)
    for m in range(driver.rows.shape[1] // LANES):
        scaled = states[row, m] * states[SCALE, m]
        total = total + scaled * scaled
    return math.sqrt(sum_of(total) / driver.slope.shape[0])


@inner
def _factor(error: float, k: int, raising: bool) -> float:
    """Factor of the next step: 2, 1, or at least a half."""
    if raising or error * POWERS_OF_TWO[k + 1] <= 0.5:
        return 2.0
    if error <= 0.5:
        return 1.0
    return max(SLOWEST, min(FASTEST, (0.5 / error) ** (1.0 / (k + 1))))


@inner
def interpolate_adams(driver: Driver, t: float, y: Array) -> None:
    """y(t) = y1 + s sum g_i phi_i, s = t - t1 <= 0: the polynomial of the k + 1 newest slopes, integrated from the step's end."""
    rows, table = driver.rows, driver.table
    s, k = t - driver.real[T_NEW], driver.counts[LAST_ORDER] + 1
    _integrate(table, G_INSIDE, PSI, s, k)
    states = by_fours(rows)
    for m in range(rows.shape[1] // LANES):
        total = table[G_INSIDE, k] * states[PHI + k, m]
        for i in range(k - 1, 0, -1):
            total = total + table[G_INSIDE, i] * states[PHI + i, m]
        states[INSIDE, m] = states[Y_NEW, m] + s * total
    for j in range(y.shape[0]):
        y[j] = rows[INSIDE, j]
