"""Which method a driver's arrays belong to."""

from __future__ import annotations

from vlmb.core.adams import interpolate_adams, next_adams
from vlmb.core.dop853 import interpolate_dop853, next_dop853
from vlmb.core.driver import ADAMS, DOP853, METHOD, RADAU, Array, Driver
from vlmb.core.fixed import interpolate_cubic, next_fixed
from vlmb.core.jit import kernel
from vlmb.core.radau import interpolate_radau, next_radau


@kernel
def next_stage(driver: Driver) -> int:
    """Go on with a step, or with its dense output, by the answer to the last stage; STAGE is BEGIN or BEGIN_DENSE at first.

    Returns EVALUATE; ACCEPTED with the rows Y_NEW and F_NEW, and H_NEXT; REJECTED with H_NEXT; READY: the dense output may be
    asked; DIVERGED.
    """
    method = driver.counts[METHOD]
    if method == DOP853:
        return next_dop853(driver)
    if method == ADAMS:
        return next_adams(driver)
    if method == RADAU:
        return next_radau(driver)
    return next_fixed(driver)


@kernel
def interpolate(driver: Driver, t: float, y: Array) -> None:
    """Write y(t) by the dense output of the step under way."""
    method = driver.counts[METHOD]
    if method == DOP853:
        interpolate_dop853(driver, t, y)
    elif method == ADAMS:
        interpolate_adams(driver, t, y)
    elif method == RADAU:
        interpolate_radau(driver, t, y)
    else:
        interpolate_cubic(driver, t, y)
