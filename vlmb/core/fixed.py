"""Methods of fixed steps: Euler, classical Runge-Kutta, Gauss-Legendre; cubic Hermite values between the steps."""

from __future__ import annotations

from vlmb.core.driver import (
    ACCEPTED,
    BEGIN,
    CHANGE,
    CHANGE_OF_FIRST,
    DIVERGED,
    EULER,
    EVALUATE,
    F_NEW,
    ITERATION,
    METHOD,
    OWN,
    READY,
    RK4,
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
from vlmb.core.jit import inner, kernel

K2, K3, K4 = OWN, OWN + 1, OWN + 2  # rows of the slopes of RK4
NEW_STATE = 4  # the stage whose slope is that of the new state, for all three methods
ROOT = 3.0**0.5 / 6.0  # of the Gauss-Legendre nodes 1/2 -+ sqrt(3)/6
FIRST, SECOND = 0, 1  # stages of the Gauss method
K, LAST_K = OWN, OWN + 2  # rows of its two slopes, and of those of the step before
LOST = OWN + 4  # row of what rounding lost of y
MOST_ITERATIONS, ROUNDING, STALLED, GOOD_ENOUGH = 60, 1e-16, 1e-14, 1e-10  # changes of a stage, relative to the largest state


@kernel
def _begin(driver: Driver) -> int:
    """Begin a step of length H; f at its start is known."""
    method = driver.counts[METHOD]
    if method == EULER:
        return _ask_new(driver, F, driver.real[H], True)
    if method == RK4:
        return _ask_from_start(driver, 1, F, 0.5)
    return begin_gauss(driver)


@inner
def next_fixed(driver: Driver) -> int:
    """Take a slope and ask for the next."""
    stage = driver.counts[STAGE]
    if stage < 0:
        return _begin(driver) if stage == BEGIN else READY  # a cubic needs nothing more
    if stage == NEW_STATE:
        _copy(driver.slope, driver.rows[F_NEW])
        return ACCEPTED
    if driver.counts[METHOD] == RK4:
        return _next_rk4(driver, stage)
    return next_gauss(driver, stage)


@inner
def _next_rk4(driver: Driver, stage: int) -> int:
    """y1 = y0 + h (k1 + 2 k2 + 2 k3 + k4) / 6."""
    rows, h = driver.rows, driver.real[H]
    _copy(driver.slope, rows[OWN + stage - 1])
    if stage < 3:
        return _ask_from_start(driver, stage + 1, OWN + stage - 1, 0.5 if stage == 1 else 1.0)
    for j in range(driver.point.shape[0]):
        total = rows[F, j] + 2.0 * (rows[K2, j] + rows[K3, j]) + rows[K4, j]
        rows[Y_NEW, j] = rows[Y, j] + h / 6.0 * total
    return _ask_new(driver, F, 0.0, False)


@inner
def _ask_from_start(driver: Driver, stage: int, slope: int, share: float) -> int:
    """Ask for f(t + share h, y + share h k), k in the row `slope`."""
    real = driver.real
    driver.counts[STAGE] = stage
    for j in range(driver.point.shape[0]):
        driver.point[j] = driver.rows[Y, j] + share * real[H] * driver.rows[slope, j]
    real[TIME] = real[T_NEW] if share == 1.0 else real[TIME_BEFORE] + share * real[H]
    return EVALUATE


@kernel
def _ask_new(driver: Driver, slope: int, h: float, make: bool) -> int:
    """Ask for f at the new state, which is first made as y0 + h k if it is to be."""
    driver.counts[STAGE] = NEW_STATE
    driver.real[TIME] = driver.real[T_NEW]
    for j in range(driver.point.shape[0]):
        if make:
            driver.rows[Y_NEW, j] = driver.rows[Y, j] + h * driver.rows[slope, j]
        driver.point[j] = driver.rows[Y_NEW, j]
    return EVALUATE


@inner
def begin_gauss(driver: Driver) -> int:
    """Guess both stages by the parabola through the three slopes of the step before; ask for the first."""
    rows = driver.rows
    for j in range(driver.point.shape[0]):
        rows[K, j] = rows[F, j]
        rows[K + 1, j] = rows[F, j]
    if driver.counts[STEP_INDEX] > 0:
        _extrapolate(rows, 0.5 - ROOT, rows[K])
        _extrapolate(rows, 0.5 + ROOT, rows[K + 1])
    driver.counts[ITERATION] = 0
    driver.real[CHANGE] = 0.0
    return _ask_gauss(driver, FIRST)


@inner
def _extrapolate(rows: Array, x: float, guess: Array) -> None:
    """Slope at x steps after the start by those at 0 and at -1/2 -+ sqrt(3)/6 of it, which the step before left."""
    a, b = -0.5 - ROOT, -0.5 + ROOT
    at_start = (x - a) * (x - b) / (a * b)
    at_first = x * (x - b) / (a * (a - b))
    at_second = x * (x - a) / (b * (b - a))
    for j in range(guess.shape[0]):
        guess[j] = at_start * rows[F, j] + at_first * rows[LAST_K, j] + at_second * rows[LAST_K + 1, j]


@inner
def _ask_gauss(driver: Driver, stage: int) -> int:
    """Ask for the slope of a stage: f(t + c h, y + h (a1 k1 + a2 k2))."""
    rows, real, h = driver.rows, driver.real, driver.real[H]
    node = 0.5 - ROOT if stage == FIRST else 0.5 + ROOT
    a1 = 0.25 if stage == FIRST else 0.25 + ROOT
    a2 = 0.25 - ROOT if stage == FIRST else 0.25
    driver.counts[STAGE] = stage
    for j in range(driver.point.shape[0]):
        driver.point[j] = rows[Y, j] + h * (a1 * rows[K, j] + a2 * rows[K + 1, j])
    real[TIME] = real[TIME_BEFORE] + node * h
    return EVALUATE


@inner
def next_gauss(driver: Driver, stage: int) -> int:
    """Take the slope of a stage; go on until neither changes by more than rounding."""
    rows, real, slope = driver.rows, driver.real, driver.slope
    change, size = 0.0, 1.0
    for j in range(slope.shape[0]):
        change = max(change, abs(slope[j] - rows[K + stage, j]))
        size = max(size, abs(rows[Y, j]))
        rows[K + stage, j] = slope[j]
    if stage == FIRST:
        real[CHANGE_OF_FIRST] = change
        return _ask_gauss(driver, SECOND)
    change = real[H] * max(change, real[CHANGE_OF_FIRST])
    before = real[CHANGE]
    real[CHANGE] = change
    driver.counts[ITERATION] += 1
    stalls = driver.counts[ITERATION] > 1 and change >= before and change <= STALLED * size
    if change <= ROUNDING * size or stalls:
        return _finish_gauss(driver)
    if driver.counts[ITERATION] < MOST_ITERATIONS and change == change:
        return _ask_gauss(driver, FIRST)
    return _finish_gauss(driver) if change <= GOOD_ENOUGH * size else DIVERGED


@inner
def _finish_gauss(driver: Driver) -> int:
    """y1 = y0 + h (k1 + k2) / 2; what rounding loses of it is added to the next step."""
    rows, h = driver.rows, driver.real[H]
    for j in range(driver.point.shape[0]):
        rows[LAST_K, j] = rows[K, j]
        rows[LAST_K + 1, j] = rows[K + 1, j]
        rise = 0.5 * h * (rows[K, j] + rows[K + 1, j]) + (rows[LOST, j] if driver.counts[STEP_INDEX] > 0 else 0.0)
        rows[Y_NEW, j] = rows[Y, j] + rise
        rows[LOST, j] = rise - (rows[Y_NEW, j] - rows[Y, j])
    return _ask_new(driver, F, 0.0, False)


@inner
def _copy(source: Array, target: Array) -> None:
    for j in range(source.shape[0]):
        target[j] = source[j]


@inner
def interpolate_cubic(driver: Driver, t: float, y: Array) -> None:
    """Cubic through y and f at both ends of the step."""
    rows, h = driver.rows, driver.real[H]
    x = (t - driver.real[TIME_BEFORE]) / h
    for j in range(y.shape[0]):
        rise = rows[Y_NEW, j] - rows[Y, j]
        m0, m1 = h * rows[F, j], h * rows[F_NEW, j]
        y[j] = rows[Y, j] + x * (m0 + x * (3.0 * rise - 2.0 * m0 - m1 + x * (m0 + m1 - 2.0 * rise)))
