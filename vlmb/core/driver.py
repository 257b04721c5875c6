"""The arrays of an integration method between two calls, the codes it answers with, and how one is made.

A method never calls anybody. It asks: `march` returns EVALUATE, the caller writes f(t, y) where it is wanted and calls again. So
one compiled text serves a compiled right-hand side, a Python function and another engine alike, and all that a method remembers
stands in arrays: a run may rest after any call and go on later.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.core.jit import kernel
from vlmb.core.lanes import LANES

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# What `march` answers with. Negative: it cannot go on.
DONE = 0  # `end` is reached: TIME, `point` and `slope` hold t, y and f there
EVALUATE = 1  # wants f(TIME, `point`) in `slope`; a trial that has no answer: a code other than 0 in FAILURE
INDICATE = 2  # wants the indicators and their rates (or nan) at (TIME, `point`), where f is `slope`, in rows VALUE and RATE
CROSSING = 3  # those with HIT may have crossed 0 between TIME_BEFORE and TIME: GO_ON or STOP in ANSWER, the time in STOP_TIME
SLICE = 4  # the evaluations of a slice are used up: look at signals and call again
STOPPED = 5  # by the indicator with HIT: TIME and `point` hold t and y there
# steps too small; f has no answer; not finite; no stages at this step size; the noise of f keeps steps short
STUCK, FAILED, NOT_FINITE, DIVERGED, NOISY = -1, -2, -3, -4, -5

# What a method answers to the march, and what the march says for it where f has no answer
ACCEPTED, REJECTED, READY, REFUSED = 10, 11, 12, 13
# What a caller asks of `run` beside these, at (TIME, `point`)
LOOK, ACCEPT = 6, 7  # the indicators alone; that the branches of angles are those there
# Phases of the march: what the next call goes on with
AT_START, FIRST_SLOPE, FIRST_INDICATORS, PROBED, TRIAL, STAGES, INDICATED, SUSPECTED, SAMPLING, HEARD, OVER = range(11)
GO = 100  # go on without asking
# What STAGE asks a method for before its own stages, which count from 0
BEGIN, BEGIN_DENSE = -1, -2

EULER, RK4, GAUSS, DOP853, ADAMS, RADAU = range(6)
LAST_FIXED = GAUSS  # methods of fixed steps come first
METHODS = {"euler": EULER, "rk4": RK4, "gauss": GAUSS, "dop853": DOP853, "adams": ADAMS, "radau": RADAU}

# Columns of `counts`: for the caller
FAILURE, ANSWER, SLICE_SIZE, PATIENCE, EVALUATIONS, STEPS, REJECTIONS, FIRST_FAILURE, NEXT_SAMPLE = range(9)
# of the march
METHOD, PHASE, SLICE_USED, TRIALS, LAST, DENSE, RETRY, STEP_INDEX, STEP_COUNT, RESUMED, AFTER_DENSE = range(9, 20)
# of a method
STAGE, ORDER, NEXT_ORDER, LAST_ORDER, EQUAL_STEPS, RAISING, ITERATION, JACOBIAN, FACTORED, REFUSALS = range(20, 30)
PIVOTS = 32  # from here on
GO_ON, STOP = range(2)  # answers to CROSSING

# Columns of `real`: for the caller, times in s
TIME, STOP_TIME, TIME_BEFORE, FIRST_STEP_SIZE, H_MAX, H_NEXT, LEAST_PROGRESS, RTOL, ATOL = range(9)
# of the march and the methods
START, END, T_NEW, H, H_LAST, H_PLANNED, WINDOW = range(9, 16)
# of a method
ERROR, CHANGE, CHANGE_OF_FIRST, RATE_OF_CHANGE, FACTORED_H, ERROR_LAST, ERROR_LOWER = range(16, 23)
# of crawl.py
WINDOW_SHORT, PACE, NOISE = range(23, 26)

# Rows of `rows` common to all methods: y and f at both ends of the step under way
Y, F, Y_NEW, F_NEW, OWN = range(5)

# Rows of `indicators`: from the caller
VALUE, RATE, DIRECTION, ZERO, ZERO_RATE = range(5)  # ZERO: a start this near to 0 is on it, and stops if it goes below
# of the march: values and rates at the start of the step, the side of 0 (-1, 0 if open, 1) it counts as being on, suspects, and
# values at the start of the step before
VALUE_BEFORE, RATE_BEFORE, SIDE, HIT, VALUE_EARLIER = range(5, 10)

TABLE_WIDTH = 16


class Driver(NamedTuple):
    """All that a method remembers; n states, m indicators, N samples."""

    counts: Integers  # (32 + 2 n,)
    real: Array  # (26,)
    rows: Array  # (rows of the method, n); of dop853 and adams with zeros up to a multiple of LANES
    table: Array  # (12, 16) coefficients that change from step to step
    point: Array  # (n,) y of a request
    slope: Array  # (n,) f of its answer
    times: Array  # (N,) ascending [s]
    samples: Array  # (N, n) y at `times`, as far as NEXT_SAMPLE
    indicators: Array  # (10, m)


def make_driver(
    method: str,
    size: int,
    times: Array | None = None,
    directions: Array | None = None,
    *,
    rtol: float = 1e-6,
    atol: float = 1e-9,
    step: float = 0.0,
    h_max: float = np.inf,
    slice_size: int = 2**62,
) -> Driver:
    """Make the arrays of a method for `size` states.

    Parameters
    ----------
    times : ascending times [s] of samples
    directions : of the indicators: 1 wants rising ones, -1 falling ones, 0 both
    step : [s] of euler, rk4 and gauss; the first one of the others, 0 lets them choose
    slice_size : evaluations after which `march` returns SLICE
    """
    wanted = np.zeros(0) if times is None else np.ascontiguousarray(times, dtype=float)
    watched = np.zeros(0) if directions is None else np.asarray(directions, dtype=float)
    blank = _blank(METHODS[method], size, len(watched))
    driver = Driver(
        counts=blank.counts.copy(), real=blank.real.copy(), rows=blank.rows.copy(), table=blank.table.copy(),
        point=blank.point.copy(), slope=blank.slope.copy(), times=wanted, samples=np.zeros((len(wanted), size)),
        indicators=blank.indicators.copy(),
    )  # fmt: skip
    driver.counts[SLICE_SIZE] = slice_size
    driver.real[RTOL], driver.real[ATOL], driver.real[FIRST_STEP_SIZE], driver.real[H_MAX] = rtol, atol, step, h_max
    driver.indicators[DIRECTION] = watched
    return driver


@lru_cache(maxsize=4)
def _blank(kind: int, size: int, indicators: int) -> Driver:
    """Make a driver without samples, to be copied: runs of an ensemble are alike."""
    own_rows = (0, 3, 5, 21, 36, 4 * size + 15)[kind]
    width = -(-size // LANES) * LANES if kind in (DOP853, ADAMS) else size
    blank = Driver(
        counts=np.zeros(PIVOTS + 2 * size, dtype=np.int64),
        real=np.zeros(26),
        rows=np.zeros((OWN + own_rows, width)),
        table=np.zeros((12, TABLE_WIDTH)),
        point=np.zeros(size),
        slope=np.zeros(size),
        times=np.zeros(0),
        samples=np.zeros((0, size)),
        indicators=np.zeros((10, indicators)),
    )
    blank.counts[METHOD], blank.counts[PATIENCE], blank.real[LEAST_PROGRESS] = kind, 20_000, 1e-3
    return blank


@kernel
def begin(driver: Driver, t: float, end: float) -> None:
    """Start from (t, `point`) towards `end`; counters and samples go on.

    FIRST_STEP_SIZE: length [s] of the first step, or of all fixed steps; 0 for choosing it.
    The sides of 0 that indicators are on are read afresh; `resume` keeps them.
    """
    count, real = driver.counts, driver.real
    for j in range(driver.point.shape[0]):
        driver.rows[Y, j] = driver.point[j]
        driver.rows[Y_NEW, j] = driver.point[j]
    for column in (PHASE, FAILURE, FIRST_FAILURE, TRIALS, RETRY, STEP_INDEX, DENSE, RESUMED, LAST):
        count[column] = 0
    for column in (START, TIME_BEFORE, TIME, T_NEW, WINDOW, WINDOW_SHORT):
        real[column] = t
    real[END] = end
    real[NOISE] = 0.0
    real[H_NEXT] = real[FIRST_STEP_SIZE]


@kernel
def resume(driver: Driver, t: float, end: float) -> None:
    """Start as `begin` does where an indicator stopped the run: one with a HIT is on that side of 0 and does not fire at once."""
    begin(driver, t, end)
    driver.counts[RESUMED] = 1
