"""What stops a run that does not get on: steps lost in rounding, and steps that the noise of f keeps short.

A method whose error estimate is noise shortens its steps until noise times step is about the tolerance, and then crawls on. Where
so many trials remain that this counts, f is asked again at the start of a step, at a state moved by its last digit: what a smooth
f changes by then is nothing beside the tolerance. Neither stiffness nor a long run makes noise.
"""

from __future__ import annotations

from vlmb.core.driver import (
    END,
    EVALUATE,
    FAILURE,
    GO,
    H_NEXT,
    HEARD,
    LEAST_PROGRESS,
    NOISE,
    NOISY,
    PACE,
    PATIENCE,
    PHASE,
    RTOL,
    START,
    STUCK,
    TIME,
    TIME_BEFORE,
    TRIAL,
    TRIALS,
    WINDOW,
    WINDOW_SHORT,
    Driver,
    F,
    Y,
)
from vlmb.core.first_step import scaled_norm
from vlmb.core.jit import inner

ROUNDING, TINIEST = 16.0 / 2**52, 1e-20  # least step over |t|, and over the way from start to end
TOGETHER, TOO_MANY = 500, 1e6  # trials over which the pace is taken; trials to the end from which on noise is looked for
LAST_DIGIT = 1.0 / 2**52
LOUD, STIFF = 0.01, 50.0  # a noisy f: its change times the step, over the tolerance; digits that a stiff one may change by then
FADING, TOO_LOUD = 0.8, 2.0  # noise heard before counts that much less; what stops a run


@inner
def look_at_progress(driver: Driver) -> int:
    """Before a trial of an adaptive method: GO, STUCK, or EVALUATE to listen for noise."""
    count, real = driver.counts, driver.real
    t, h = real[TIME_BEFORE], real[H_NEXT]
    if not (h > ROUNDING * abs(t) and h > TINIEST * (real[END] - real[START])) and t + h < real[END]:
        return STUCK
    count[TRIALS] += 1
    if count[TRIALS] % TOGETHER == 0:
        real[PACE] = (t - real[WINDOW_SHORT]) / TOGETHER
        real[WINDOW_SHORT] = t
        if real[END] - t > TOO_MANY * real[PACE]:
            return _listen(driver)
    if count[TRIALS] < count[PATIENCE]:
        return GO
    slow = t - real[WINDOW] < min(real[LEAST_PROGRESS], 1e-4 * (real[END] - real[START]))
    count[TRIALS] = 0
    real[WINDOW] = t
    return STUCK if slow else GO


@inner
def _listen(driver: Driver) -> int:
    """Ask for f at the state before the step, every other number a digit up, the others down."""
    real = driver.real
    for j in range(driver.point.shape[0]):
        driver.point[j] = driver.rows[Y, j] * (1.0 + (LAST_DIGIT if j % 2 else -LAST_DIGIT))
    real[TIME] = real[TIME_BEFORE]
    driver.counts[PHASE] = HEARD
    return EVALUATE


@inner
def judge_noise(driver: Driver) -> int:
    """NOISY where f changed more than the tolerance allows, time and again; else GO on with the trial."""
    count, real = driver.counts, driver.real
    count[PHASE] = TRIAL
    change = driver.slope
    for j in range(change.shape[0]):
        change[j] -= driver.rows[F, j]
    noise = real[PACE] * scaled_norm(driver, change)
    loud = count[FAILURE] == 0 and noise > LOUD + STIFF * LAST_DIGIT / real[RTOL]
    count[FAILURE] = 0
    real[NOISE] = FADING * real[NOISE] + (1.0 if loud else 0.0)
    return NOISY if real[NOISE] > TOO_LOUD else GO
