"""Which method a driver's arrays belong to: every part of a step that the march asks for, by the method's number."""

from __future__ import annotations

from vlmb.core.adams import begin_adams, interpolate_adams, next_adams
from vlmb.core.dop853 import begin_dense_dop853, begin_dop853, interpolate_dop853, next_dense_dop853, next_dop853
from vlmb.core.driver import ADAMS, DOP853, METHOD, READY, Array, Driver
from vlmb.core.fixed import begin_fixed, interpolate_cubic, next_fixed
from vlmb.core.jit import kernel


@kernel
def begin_trial(driver: Driver) -> int:
    """Begin a step of length H; return what it asks for."""
    method = driver.counts[METHOD]
    if method == DOP853:
        return begin_dop853(driver)
    if method == ADAMS:
        return begin_adams(driver)
    return begin_fixed(driver)


@kernel
def next_stage(driver: Driver) -> int:
    """Take an answer; return EVALUATE, ACCEPTED with `Y_NEW`, `F_NEW` and H_NEXT, REJECTED with H_NEXT, or DIVERGED."""
    method = driver.counts[METHOD]
    if method == DOP853:
        return next_dop853(driver)
    if method == ADAMS:
        return next_adams(driver)
    return next_fixed(driver)


@kernel
def begin_dense(driver: Driver) -> int:
    """Begin what the dense output needs besides the step; return EVALUATE or READY."""
    if driver.counts[METHOD] == DOP853:
        return begin_dense_dop853(driver)
    return READY


@kernel
def next_dense(driver: Driver) -> int:
    """Take an answer for the dense output; return EVALUATE or READY."""
    return next_dense_dop853(driver)


@kernel
def interpolate(driver: Driver, t: float, y: Array) -> None:
    """Write y(t) by the dense output of the step under way: at CROSSING, and after STOPPED or DONE."""
    method = driver.counts[METHOD]
    if method == DOP853:
        interpolate_dop853(driver, t, y)
    elif method == ADAMS:
        interpolate_adams(driver, t, y)
    else:
        interpolate_cubic(driver, t, y)
