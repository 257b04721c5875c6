"""What is kept of a run, or of a phase of one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.simulation.loop import Recorded
from vlmb.system.core_engine import CoreEngine
from vlmb.system.pinocchio_engine import PinocchioEngine

Array = NDArray[np.float64]


class Samples(NamedTuple):
    """As a trajectory stores them."""

    t: Array  # (N,)
    states: Array  # (N, size)
    inputs: Array  # (N, S) forces of a control
    branch: Array  # (1 or N, coordinates) near which angles are read


def samples_of(engine: CoreEngine | PinocchioEngine, recorded: Recorded) -> Samples:
    """Return the samples of a loop."""
    return Samples(recorded.t, engine.stored(*recorded), *engine.sampled(*recorded))
