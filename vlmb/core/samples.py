"""The state within a step, by the dense output of its method; samples."""

from __future__ import annotations

from vlmb.core.adams import interpolate_adams
from vlmb.core.dop853 import interpolate_dop853
from vlmb.core.driver import (
    ADAMS,
    DOP853,
    METHOD,
    NEXT_SAMPLE,
    RADAU,
    T_NEW,
    TIME_BEFORE,
    Y_NEW,
    Array,
    Driver,
    Y,
)
from vlmb.core.fixed import interpolate_cubic
from vlmb.core.jit import inner, kernel
from vlmb.core.radau import interpolate_radau


@inner
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


@inner
def sample_inside(driver: Driver, until: float) -> bool:
    """Whether the next sample is within the step and not at its end."""
    k = driver.counts[NEXT_SAMPLE]
    return k < driver.times.shape[0] and driver.times[k] <= until and driver.times[k] < driver.real[T_NEW]


@inner
def write_samples(driver: Driver, until: float) -> None:
    """Write all samples up to a time, by the dense output if it is ready."""
    count, times = driver.counts, driver.times
    while count[NEXT_SAMPLE] < times.shape[0] and times[count[NEXT_SAMPLE]] <= until:
        k = count[NEXT_SAMPLE]
        state_at(driver, times[k], driver.samples[k])
        count[NEXT_SAMPLE] = k + 1


@kernel
def state_at(driver: Driver, t: float, y: Array) -> None:
    """Write y(t) within the step under way: its ends as they are, the dense output between them."""
    inside = driver.real[TIME_BEFORE] < t < driver.real[T_NEW]
    if inside:
        interpolate(driver, t, y)
        return
    row = Y if t <= driver.real[TIME_BEFORE] else Y_NEW
    for j in range(y.shape[0]):
        y[j] = driver.rows[row, j]
