"""Some rows of a scene at a start."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.system.constraints import Constraint, ConstraintSet, RowValues
from vlmb.system.frames import LinkFrames

Array = NDArray[np.float64]


class RowSet(NamedTuple):
    """Some rows of a scene, and the frames they are evaluated in."""

    rows: ConstraintSet
    frames: LinkFrames
    numbers: range  # which rows
    ideal: bool
    t: float = 0.0  # [s]

    @property
    def info(self) -> list[Constraint]:
        """What is known of each."""
        return [self.rows.info[k] for k in self.numbers]

    @property
    def texts(self) -> list[str]:
        """Their equations."""
        return [row.text for row in self.info]

    @property
    def holonomic(self) -> NDArray[np.bool_]:
        """Which are rows of positions."""
        return np.array([row.holonomic for row in self.info], dtype=bool)

    def at(self, q: Array, v: Array, branch: Sequence[float]) -> RowValues:
        """Evaluate them at a state."""
        self.frames.update(q)
        return self.rows.evaluate(self.frames, self.t, q, v, branch, self.numbers)

    def values(self, coordinates: dict[str, float], rates: dict[str, float]) -> RowValues:
        """Evaluate them at a posture given by names."""
        q, v = self.frames.mechanism.state(coordinates, rates)
        return self.at(q, v, [coordinates[name] for name in self.frames.layout.names])
