"""Sampling: configurations of a motion at even times, and smooth ways through them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

Array = NDArray[np.float64]


def at_times(model: Any, t: Array, q: Array, when: Array) -> Array:
    """Configurations at times between samples: joints stay joined because q, not positions, is interpolated."""
    after = np.clip(np.searchsorted(t, when), 1, len(t) - 1)
    width = t[after] - t[after - 1]  # 0 between the two samples of an event
    share = np.where(width > 0.0, (when - t[after - 1]) / np.where(width > 0.0, width, 1.0), 1.0)[:, None]
    first, second = q[after - 1], q[after].copy()
    for joint in model.joints[1:]:
        name = joint.shortname()
        if "Spherical" in name or "FreeFlyer" in name:
            part = slice(joint.idx_q + joint.nq - 4, joint.idx_q + joint.nq)
            second[:, part] *= np.where(np.sum(first[:, part] * second[:, part], axis=1) < 0.0, -1.0, 1.0)[:, None]
    return np.array([pin.normalize(model, row) for row in (1.0 - share) * first + share * second])


def smooth(points: Array, half: int = 15) -> Array:
    """Moving average over frames, for a camera that does not shake."""
    half = min(half, (len(points) - 1) // 2)
    if half < 1:
        return points
    padded = np.concatenate([2 * points[:1] - points[half:0:-1], points, 2 * points[-1:] - points[-2 : -half - 2 : -1]])
    sums = np.cumsum(np.concatenate([np.zeros((1, 3)), padded]), axis=0)
    return np.asarray((sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1))
