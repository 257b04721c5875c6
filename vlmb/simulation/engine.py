"""What the loop of a run asks of an engine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vlmb.core.driver import Driver
from vlmb.errors import VlmbError
from vlmb.system.events import Event
from vlmb.system.friction import Hold
from vlmb.system.worth import RowState

Array = NDArray[np.float64]


class Engine(Protocol):
    """What the loop asks of an engine."""

    @property
    def name(self) -> str:
        """`core` or `pinocchio`."""
        ...

    @property
    def size(self) -> int:
        """Numbers in a state."""
        ...

    @property
    def first_slice(self) -> int:
        """Evaluations that take some hundredths of a second at most, however slow: the first look at signals comes then."""
        ...

    @property
    def events(self) -> Sequence[Event]:
        """What is looked for after every step."""
        ...

    def run(self, driver: Driver, bounds: Array, h_max: float) -> int:
        """Go on to the next thing that only the caller can answer."""
        ...

    def indicators(self, t: float, y: Array) -> Array:
        """Return the indicators of all events and their rates (2, e)."""
        ...

    def in_line(self, event: Event, t: float, y: Array) -> float:
        """Return the sine of the angle between the directions of a line-up."""
        ...

    def failure(self, driver: Driver) -> VlmbError | None:
        """Return the first failure of an evaluation that led to the end of a run."""
        ...

    def why(self, t: float, y: Array) -> str:
        """Add what is known of a place where a run failed."""
        ...

    def note(self, t: float, y: Array) -> None:
        """Record what acts from outside at a state that is kept beside the samples."""
        ...

    @property
    def dependent(self) -> int:
        """Which event is that the ideal rows lose their independence; -1 where none is."""
        ...

    @property
    def velocities(self) -> slice:
        """Where the velocities stand in a state."""
        ...

    def settle(self, t: float, y: Array) -> Hold:
        """Let a ski slide or stand from (t, y) on, as friction has it there."""
        ...

    def look_at(self, worth: float) -> None:
        """Let that event happen where a row is worth so little."""
        ...

    def evaluate(self, t: float, y: Array) -> Array:
        """Return y' at (t, y)."""
        ...

    def rows(self, t: float, y: Array) -> RowState:
        """Return the ideal rows at (t, y)."""
        ...

    def moved(self, t: float, y: Array, change: Array) -> Array:
        """Return y with its positions moved as velocities would move them in a second."""
        ...

    def tidied(self, y: Array) -> Array:
        """Return a copy of y with what has unit length brought back to it."""
        ...

    def raised(self, error: BaseException) -> bool:
        """Whether an error is one that the control raised."""
        ...
