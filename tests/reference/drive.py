"""A run by right-hand sides and indicators that are Python functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from vlmb.core.driver import (
    ANSWER,
    CROSSING,
    DONE,
    EVALUATE,
    EVALUATIONS,
    FAILURE,
    FIRST_FAILURE,
    GO_ON,
    HIT,
    INDICATE,
    NEXT_SAMPLE,
    RATE,
    STEPS,
    STOP,
    STOP_TIME,
    STOPPED,
    TIME,
    VALUE,
    Array,
    Driver,
    begin,
    make_driver,
)
from vlmb.core.locate import Crossing, crossings
from vlmb.core.march import march
from vlmb.core.samples import state_at

Rhs = Callable[[float, Array], Array]
Indicate = Callable[[float, Array, Array], tuple[Array, Array]]


@dataclass
class Drive:
    """What became of a run: where it ended, its samples, and the crossings on its way with the states there."""

    code: int  # DONE, STOPPED, or why it could not go on
    t: float  # [s]
    y: Array
    times: Array  # (N,) of the samples [s]
    samples: Array  # (N, n)
    driver: Driver = field(repr=False)
    crossings: list[tuple[Crossing, Array]] = field(default_factory=list)
    error: Exception | None = None  # of the right-hand side, the first that led to the end

    @property
    def evaluations(self) -> int:
        """Of the right-hand side."""
        return int(self.driver.counts[EVALUATIONS])

    @property
    def steps(self) -> int:
        """Accepted steps."""
        return int(self.driver.counts[STEPS])


def drive(
    f: Rhs,
    t: float,
    y: Array,
    end: float,
    method: str = "dop853",
    times: Sequence[float] | Array | None = None,
    indicate: Indicate | None = None,
    directions: Sequence[float] = (),
    terminal: Sequence[bool] = (),
    *,
    rtol: float = 1e-6,
    atol: float = 1e-9,
    step: float = 0.0,
    h_max: float = np.inf,
    failures: tuple[type[Exception], ...] = (),
) -> Drive:
    """Integrate y' = f(t, y) from t to `end`, or to the first crossing of a terminal indicator.

    Parameters
    ----------
    times : ascending times [s] of samples
    indicate : (t, y, y') to the values and rates of all indicators
    directions : of the indicators: 1 rising, -1 falling, 0 both
    failures : exceptions of f that make a trial step be tried again, shorter; others go through
    """
    wanted = None if times is None else np.asarray(times, dtype=float)
    driver = make_driver(method, len(y), wanted, np.asarray(directions), rtol=rtol, atol=atol, step=step, h_max=h_max)
    driver.point[:] = y
    begin(driver, t, end)
    result = Drive(DONE, t, np.array(y, dtype=float), driver.times, driver.samples, driver)
    with np.errstate(all="ignore"):  # what is not finite is found and named
        while (code := march(driver)) > DONE and code != STOPPED:
            if code == EVALUATE:
                _evaluate(f, driver, failures, result)
            elif code == INDICATE and indicate is not None:
                values, rates = indicate(float(driver.real[TIME]), driver.point, driver.slope)
                driver.indicators[VALUE], driver.indicators[RATE] = values, rates
            elif code == CROSSING and indicate is not None:
                _decide(indicate, driver, terminal, result)
    written = driver.counts[NEXT_SAMPLE]
    result.code, result.times, result.samples = code, driver.times[:written], driver.samples[:written]
    result.t, result.y = float(driver.real[TIME]), driver.point.copy()
    return result


def _evaluate(f: Rhs, driver: Driver, failures: tuple[type[Exception], ...], result: Drive) -> None:
    try:
        driver.slope[:] = f(float(driver.real[TIME]), driver.point)
    except failures as error:
        if driver.counts[FIRST_FAILURE] == 0:
            result.error = error
        driver.counts[FAILURE] = 1


def _decide(indicate: Indicate, driver: Driver, terminal: Sequence[bool], result: Drive) -> None:
    """Note the crossings of the step up to the first terminal one, and answer."""
    slope = driver.slope.copy()
    found = crossings(driver, lambda t, y: indicate(t, y, slope)[0])
    driver.indicators[HIT] = 0.0
    driver.counts[ANSWER] = GO_ON
    for crossing in found:
        y = np.empty_like(driver.point)
        state_at(driver, crossing.t, y)
        result.crossings.append((crossing, y))
        if terminal[crossing.indicator]:
            driver.indicators[HIT, crossing.indicator] = crossing.direction
            driver.counts[ANSWER], driver.real[STOP_TIME] = STOP, crossing.t
            return
