"""The march of a method from a time to an end: steps, samples, indicators, slices and what stops it; see `driver` for the codes.

A caller's loop, compiled or not:

    begin(driver, t, end)  # y in driver.point
    code = march(driver)
    while code > DONE and code != STOPPED:
        if code == EVALUATE:
            driver.counts[FAILURE] = f(driver.real[TIME], driver.point, driver.slope)
        elif code == INDICATE: ...
        elif code == CROSSING: ...
        code = march(driver)
"""

from __future__ import annotations

from vlmb.core.adams import next_adams
from vlmb.core.crawl import judge_noise, look_at_progress
from vlmb.core.dop853 import next_dop853
from vlmb.core.driver import (
    ACCEPTED,
    ADAMS,
    AFTER_DENSE,
    ANSWER,
    BEGIN,
    BEGIN_DENSE,
    CROSSING,
    DENSE,
    DONE,
    DOP853,
    END,
    EVALUATE,
    EVALUATIONS,
    F_NEW,
    FAILED,
    FAILURE,
    FIRST_FAILURE,
    GO,
    GO_ON,
    H_LAST,
    H_MAX,
    H_NEXT,
    H_PLANNED,
    HEARD,
    INDICATE,
    INDICATED,
    LAST,
    LAST_FIXED,
    METHOD,
    NOT_FINITE,
    OVER,
    PHASE,
    RADAU,
    READY,
    REFUSED,
    REJECTED,
    REJECTIONS,
    RETRY,
    SAMPLING,
    SLICE,
    SLICE_SIZE,
    SLICE_USED,
    STAGE,
    STAGES,
    START,
    STEP_COUNT,
    STEP_INDEX,
    STEPS,
    STOP,
    STOP_TIME,
    STOPPED,
    SUSPECTED,
    T_NEW,
    TIME,
    TIME_BEFORE,
    TRIAL,
    Y_NEW,
    Driver,
    F,
    H,
    Y,
)
from vlmb.core.first_step import is_finite
from vlmb.core.fixed import next_fixed
from vlmb.core.indicators import find_suspects, note_step
from vlmb.core.jit import inner, kernel
from vlmb.core.radau import next_radau
from vlmb.core.samples import sample_inside, state_at, write_samples
from vlmb.core.start import go_on_with_start

NEARLY = 0.99  # a step that comes this near to the end goes to the end
AFTER_FAILURE = 0.25  # factor of a step where f has no answer


@kernel
def march(driver: Driver) -> int:
    """Go on to the next thing that is asked of the caller; return its code."""
    return march_here(driver)


@kernel(inline=True)
def march_here(driver: Driver) -> int:
    """`march` within a kernel: to hand over the arrays of a driver takes as long as a stage of dop853.

    A method answers EVALUATE; ACCEPTED with the rows Y_NEW and F_NEW, and H_NEXT; REJECTED with H_NEXT; READY: its dense output
    may be asked; DIVERGED.
    """
    code = GO
    while code == GO:
        phase = driver.counts[PHASE]
        if phase == STAGES:
            method = driver.counts[METHOD]
            if driver.counts[FAILURE]:
                code = REFUSED
            elif method == DOP853:
                code = next_dop853(driver)
            elif method == ADAMS:
                code = next_adams(driver)
            elif method == RADAU:
                code = next_radau(driver)
            else:
                code = next_fixed(driver)
            if code >= ACCEPTED:
                code = _settle(driver, code)
        elif phase == TRIAL:
            code = _begin_step(driver)
        elif phase == INDICATED:
            code = _judge(driver)
        elif phase in (SUSPECTED, SAMPLING):
            code = _finish_step(driver)
        elif phase == HEARD:
            code = judge_noise(driver)
        else:
            code = go_on_with_start(driver)
    if code < DONE:
        _show_start_of_step(driver)
    if code == EVALUATE:
        driver.counts[EVALUATIONS] += 1
        driver.counts[SLICE_USED] += 1
    return code


@inner
def _begin_step(driver: Driver) -> int:
    """Begin a trial step that ends at `end` at the latest; say SLICE, or what stops the run, where it is time to."""
    count, real = driver.counts, driver.real
    if count[SLICE_USED] >= count[SLICE_SIZE]:
        count[SLICE_USED] = 0
        return SLICE
    t, end = real[TIME_BEFORE], real[END]
    if count[METHOD] <= LAST_FIXED:
        count[LAST] = 1 if count[STEP_INDEX] + 1 >= count[STEP_COUNT] else 0
        real[T_NEW] = end if count[LAST] else real[START] + (count[STEP_INDEX] + 1) * real[H_NEXT]
        real[H] = real[H_NEXT]
    else:
        progress = look_at_progress(driver)
        if progress != GO:
            return progress
        real[H_PLANNED] = min(real[H_NEXT], real[H_MAX])
        count[LAST] = 1 if t + real[H_PLANNED] >= end - (1.0 - NEARLY) * real[H_PLANNED] else 0
        real[T_NEW] = end if count[LAST] else t + real[H_PLANNED]
        real[H] = end - t if count[LAST] else real[H_PLANNED]
    count[DENSE] = 0
    count[STAGE] = BEGIN
    count[PHASE] = STAGES
    return GO


@inner
def _settle(driver: Driver, code: int) -> int:
    """Act on what a method says of its step or its dense output."""
    if code == ACCEPTED:
        return _accept(driver)
    if code == READY:
        return _have_dense(driver)
    return _retry(driver) if code == REJECTED else _refuse(driver)


@inner
def _accept(driver: Driver) -> int:
    """An accepted step goes to the indicators, or straight to the samples; one that is not finite is none."""
    if not (is_finite(driver.rows[Y_NEW]) and is_finite(driver.rows[F_NEW])):
        return _refuse(driver)
    if driver.indicators.shape[1]:
        driver.counts[PHASE] = INDICATED
        return INDICATE
    driver.counts[PHASE] = SAMPLING
    return GO


@inner
def _refuse(driver: Driver) -> int:
    """Try a shorter step where f had no answer; keep the first reason. Fixed steps cannot."""
    count, real = driver.counts, driver.real
    if count[FIRST_FAILURE] == 0:
        count[FIRST_FAILURE] = count[FAILURE]
    failed = count[FAILURE] != 0
    count[FAILURE] = 0
    if count[METHOD] <= LAST_FIXED:
        count[PHASE] = OVER
        return FAILED if failed else NOT_FINITE
    real[H_NEXT] = AFTER_FAILURE * real[H]
    return _retry(driver)


@inner
def _retry(driver: Driver) -> int:
    count = driver.counts
    count[REJECTIONS] += 1
    count[RETRY] = 1
    count[PHASE] = TRIAL
    return GO


@inner
def _judge(driver: Driver) -> int:
    """Look at the indicators; suspects want the dense output and the caller's verdict."""
    driver.counts[ANSWER] = GO_ON
    if not find_suspects(driver):
        driver.counts[PHASE] = SAMPLING
        return GO
    return _want_dense(driver, SUSPECTED)


@inner
def _want_dense(driver: Driver, then: int) -> int:
    """Make the dense output of this step ready, then go on with a phase."""
    driver.counts[AFTER_DENSE] = then
    driver.counts[STAGE] = BEGIN_DENSE
    driver.counts[PHASE] = STAGES
    return GO


@inner
def _have_dense(driver: Driver) -> int:
    """Show suspects to the caller, or go back to the samples."""
    count = driver.counts
    count[DENSE] = 1
    count[PHASE] = count[AFTER_DENSE]
    if count[PHASE] == SUSPECTED:
        _show_new_state(driver)
        return CROSSING
    return GO


@inner
def _show_new_state(driver: Driver) -> None:
    """Put the end of the step where the caller reads it."""
    driver.real[TIME] = driver.real[T_NEW]
    for j in range(driver.point.shape[0]):
        driver.point[j] = driver.rows[Y_NEW, j]
        driver.slope[j] = driver.rows[F_NEW, j]


@inner
def _show_start_of_step(driver: Driver) -> None:
    """Put the last good state where the caller reads it."""
    driver.real[TIME] = driver.real[TIME_BEFORE]
    for j in range(driver.point.shape[0]):
        driver.point[j] = driver.rows[Y, j]


@inner
def _finish_step(driver: Driver) -> int:
    """Write the samples of the step, then go on from its end, or stop within it."""
    count, real = driver.counts, driver.real
    stops = driver.indicators.shape[1] > 0 and count[ANSWER] == STOP
    until = min(max(real[STOP_TIME], real[TIME_BEFORE]), real[T_NEW]) if stops else real[T_NEW]
    if count[DENSE] == 0 and sample_inside(driver, until):
        return _want_dense(driver, SAMPLING)
    write_samples(driver, until)
    count[STEPS] += 1
    if stops:
        real[TIME] = until
        state_at(driver, until, driver.point)
        count[PHASE] = OVER
        return STOPPED
    if driver.indicators.shape[1]:
        note_step(driver)
    return _step_on(driver)


@inner
def _step_on(driver: Driver) -> int:
    """Make the end of the step the start of the next."""
    count, real, rows = driver.counts, driver.real, driver.rows
    if real[T_NEW] >= real[END]:
        _show_new_state(driver)
        real[H_NEXT] = max(real[H_NEXT], real[H_PLANNED])  # the last step may have been cut
        count[PHASE] = OVER
        return DONE
    real[TIME_BEFORE] = real[T_NEW]
    real[H_LAST] = real[H]
    for j in range(driver.point.shape[0]):
        rows[Y, j] = rows[Y_NEW, j]
        rows[F, j] = rows[F_NEW, j]
    count[STEP_INDEX] += 1
    count[RETRY] = 0
    count[FIRST_FAILURE] = 0
    count[PHASE] = TRIAL
    return GO
