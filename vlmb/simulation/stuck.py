"""Why a method could not go on: its codes as sentences."""

from __future__ import annotations

import math

from vlmb.core.driver import ATOL, DIVERGED, END, FAILED, NOISY, NOT_FINITE, PACE, RTOL, TIME_BEFORE, Driver

STUCK_TEXT = "the steps became too small to go on: the motion is too stiff, or singular, here"
NOISY_TEXT = (
    "the steps became too small to go on: the tolerance is below the noise of the accelerations here, as where masses are nearly "
    "singular or equations nearly dependent"
)
ENOUGH, LOOSE = 1e5, 1e-2  # trials that a run may well take; a relative tolerance that is no advice


def why_stuck(code: int, driver: Driver, adaptive: bool) -> str:
    """Return the sentence of a code below DONE where no evaluation says more."""
    if code == NOT_FINITE:
        return f"the state is no longer finite{'' if adaptive else ': the step is too large for this motion; reduce `step`'}"
    if code == DIVERGED:
        return "the stages of the Gauss method do not converge: the step is too large for this motion; reduce it"
    if code == FAILED:
        return "an evaluation has no answer here"
    return NOISY_TEXT + _advice(driver) if code == NOISY else STUCK_TEXT


def _advice(driver: Driver) -> str:
    """Name tolerances that should take some ENOUGH trials: where noise rules, steps are as long as the tolerance is wide."""
    rtol, atol, t, end, pace = (float(driver.real[k]) for k in (RTOL, ATOL, TIME_BEFORE, END, PACE))
    if not pace > 1e-30 * (end - t):
        return ""
    wider = 10.0 ** math.ceil(math.log10((end - t) / pace / ENOUGH))
    return f"; rtol = {wider * rtol:.0e} and atol = {wider * atol:.0e} are above it" if wider * rtol < LOOSE else ""
