"""Bodies: the shapes of a scenery, each with its way over the frames."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vlmb.views.shapes import Lines, Mesh

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Body:
    """A shape and where it is relative to the body its path hangs on: constant, or frame by frame (N first)."""

    path: str
    shape: Mesh | Lines | None
    colour: str
    position: Array = field(default_factory=lambda: np.zeros(3))  # (3,) or (N, 3) [m]
    rotation: Array = field(default_factory=lambda: np.eye(3))  # (3, 3) or (N, 3, 3)
    scale: Array = field(default_factory=lambda: np.ones(3))  # (3,) or (N, 3)
    grows: bool = False  # a way: as long as what lies behind
    keeps: float = math.inf  # [s] of a way that stay visible
    shadow: bool = True
    in_front: bool = False  # drawn over everything
    fits: bool = True  # a camera has it in its picture

    def pose(self, frame: int) -> Array:
        """4 x 4 matrix in the parent's frame at a frame."""
        pose = np.eye(4)
        scale = self.scale[frame] if self.scale.ndim == 2 else self.scale
        pose[:3, :3] = (self.rotation[frame] if self.rotation.ndim == 3 else self.rotation) * scale
        pose[:3, 3] = self.position[frame] if self.position.ndim == 2 else self.position
        return pose
