"""The dense output of the method that a driver's arrays belong to."""

from __future__ import annotations

from vlmb.core.adams import interpolate_adams
from vlmb.core.dop853 import interpolate_dop853
from vlmb.core.driver import ADAMS, DOP853, METHOD, RADAU, Array, Driver
from vlmb.core.fixed import interpolate_cubic
from vlmb.core.jit import kernel
from vlmb.core.radau import interpolate_radau


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
