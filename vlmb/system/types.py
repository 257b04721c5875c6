"""Types that files of this folder share."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rhs = Callable[[float, Array], Array]


class Evaluation(NamedTuple):
    """One instant: accelerations and every force by name."""

    vdot: Array
    tau: Array  # (nv,) springs, dampers, applied forces and controls
    controls: dict[str, float]  # applied forces, controls of the programme, forces of prescribed segments
    knife_edge: float | None  # [N], positive to the ski's left
    reactions: dict[str, float]  # multipliers of the ideal rows, by equation
    residuals: dict[str, tuple[float, float]]  # z and z' of every row, by equation
    powers: dict[str, float]  # rates of the work states [W]
    ground: Array  # (3,) [N] of the ground on a planted base, 0 on any other
