"""The march of a run whose evaluations Python answers: a control's, and those of Pinocchio."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vlmb.core.calls import march
from vlmb.core.driver import AT_START, EVALUATE, FAILURE, INDICATE, NEXT_SAMPLE, PHASE, TIME, Driver
from vlmb.errors import VlmbError

Array = NDArray[np.float64]


class Answering(Protocol):
    """What the march asks of an engine."""

    asked: list[Any]  # what was noted, sample by sample
    errors: list[VlmbError]  # of evaluations since the last accepted step

    def accept(self, t: float, y: Array) -> None:
        """Take a state as the one near which angles are read."""
        ...

    def note(self, t: float, y: Array) -> None:
        """Record what acts from outside at a sample."""
        ...

    def answer(self, driver: Driver, bounds: Array, h_max: float) -> None:
        """Write f(TIME, `point`) into `slope`."""
        ...

    def look(self, driver: Driver, bounds: Array, h_max: float) -> None:
        """Write the indicators of an accepted step, and how long the next may be."""
        ...


def march_answered(engine: Answering, driver: Driver, bounds: Array, h_max: float) -> int:
    """Go on to the next thing that only the caller can answer; each sample written is noted once."""
    counts, real = driver.counts, driver.real
    if counts[PHASE] == AT_START:
        engine.accept(float(real[TIME]), driver.point)
    while True:
        code = march(driver)
        while len(engine.asked) < counts[NEXT_SAMPLE]:
            at = len(engine.asked)
            engine.note(float(driver.times[at]), driver.samples[at])
        if code == EVALUATE:
            try:
                engine.answer(driver, bounds, h_max)
            except VlmbError as error:
                engine.errors.append(error)
                counts[FAILURE] = len(engine.errors)
        elif code == INDICATE:
            engine.errors.clear()
            engine.look(driver, bounds, h_max)
        else:
            return int(code)
