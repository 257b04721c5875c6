"""From `begin` to the first step: f there, samples, indicators, the length of the step."""

from __future__ import annotations

import math

from vlmb.core.driver import (
    AT_START,
    DONE,
    END,
    EVALUATE,
    F_NEW,
    FAILED,
    FAILURE,
    FIRST_FAILURE,
    FIRST_INDICATORS,
    FIRST_SLOPE,
    GO,
    H_NEXT,
    INDICATE,
    LAST_FIXED,
    METHOD,
    NOT_FINITE,
    OVER,
    PHASE,
    PROBED,
    START,
    STEP_COUNT,
    STOPPED,
    TRIAL,
    Driver,
    F,
)
from vlmb.core.first_step import ask_probe, is_finite, step_from_probe
from vlmb.core.indicators import leaves_at_start, note_start
from vlmb.core.jit import inner
from vlmb.core.samples import write_samples

NO_STEP = 1e-9  # of a fixed step, which is rounding


@inner
def go_on_with_start(driver: Driver) -> int:
    """From `begin` to the first step."""
    count, real = driver.counts, driver.real
    phase = count[PHASE]
    if phase == AT_START:
        count[PHASE] = FIRST_SLOPE
        return EVALUATE
    if phase == FIRST_SLOPE:
        return _take_first_slope(driver)
    if phase == FIRST_INDICATORS:
        note_start(driver)
        if leaves_at_start(driver):
            count[PHASE] = OVER
            return STOPPED
        return _choose_first_step(driver)
    if phase == PROBED:
        real[H_NEXT] = step_from_probe(driver)
        count[FAILURE] = 0
        count[PHASE] = TRIAL
        return GO
    return DONE


@inner
def _take_first_slope(driver: Driver) -> int:
    """Keep f at the start, write samples there."""
    count, real = driver.counts, driver.real
    if count[FAILURE]:
        count[FIRST_FAILURE] = count[FAILURE]
        return FAILED
    if not (is_finite(driver.slope) and is_finite(driver.point)):
        return NOT_FINITE
    for j in range(driver.slope.shape[0]):
        driver.rows[F, j] = driver.slope[j]
        driver.rows[F_NEW, j] = driver.slope[j]
    write_samples(driver, real[START])
    if not real[START] < real[END]:
        count[PHASE] = OVER
        return DONE
    if driver.indicators.shape[1]:
        count[PHASE] = FIRST_INDICATORS
        return INDICATE
    return _choose_first_step(driver)


@inner
def _choose_first_step(driver: Driver) -> int:
    """Take the step asked for, or probe for one; fixed steps divide the way evenly."""
    count, real = driver.counts, driver.real
    count[PHASE] = TRIAL
    if count[METHOD] <= LAST_FIXED:
        way = real[END] - real[START]
        count[STEP_COUNT] = max(1, math.ceil(way / real[H_NEXT] - NO_STEP))
        real[H_NEXT] = way / count[STEP_COUNT]
        return GO
    if real[H_NEXT] > 0.0:
        return GO
    ask_probe(driver)
    count[PHASE] = PROBED
    return EVALUATE
