"""What is kept of a run, or of a phase of one."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vlmb.simulation.loop import Recorded

Array = NDArray[np.float64]


class Samples(NamedTuple):
    """As a trajectory stores them."""

    t: Array  # (N,)
    states: Array  # (N, size)
    inputs: Array  # (N, S) forces of a control
    branch: Array  # (1 or N, coordinates) near which angles are read


class Storing(Protocol):
    """What of an engine keeps its samples."""

    def stored(self, t: Array, states: Array) -> Array: ...  # noqa: D102
    def sampled(self, t: Array, states: Array) -> tuple[Array, Array]: ...  # noqa: D102


def samples_of(engine: Storing, recorded: Recorded) -> Samples:
    """Return the samples of a loop."""
    return Samples(recorded.t, engine.stored(*recorded), *engine.sampled(*recorded))
