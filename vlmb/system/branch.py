"""The branch that angles are read on: coordinates of an accepted state, near which the next ones are looked for."""

from __future__ import annotations

import math
from collections.abc import Container, Sequence

import numpy as np
from numpy.typing import NDArray

from vlmb.core.run import ON_POLE, TURN, meets_pole
from vlmb.model.coordinates import read_angles
from vlmb.system.frames import LinkFrames

Array = NDArray[np.float64]

TINY = 1e-300


def next_branch(
    frames: LinkFrames, q: Array, v: Array, branch: Sequence[float], angled: Container[int]
) -> tuple[list[float], float]:
    """Return the branch at a state near the one before, and the time [s] for which it serves.

    Near the pole an azimuth swings round within the time that the link needs for its distance from there, unless the link is
    on its way through it; `angled` are the links whose angles matter. Leaves the frames at q, unless in a plane.
    """
    layout, found, time = frames.layout, list(branch), math.inf
    if layout.headed:
        found[2] += math.remainder(math.atan2(q[3], q[2]) - found[2], math.tau)
    if layout.plane:
        return found, time
    frames.update(q)
    for i, omega in enumerate(frames.all_omegas(v)[: len(layout.links)]):
        at = layout.index[f"psi{i + 1}"]
        direction = frames.direction(i)
        found[at - 1 : at + 1] = read_angles(direction, (found[at - 1], found[at]))
        if i in angled:
            (dx, dy, dz), (wx, wy, wz) = direction, omega
            off_pole = max(math.hypot(dx, dy), ON_POLE)
            if not meets_pole((dx, dy, dz), (wy * dz - wz * dy, wz * dx - wx * dz, wx * dy - wy * dx)):
                time = min(time, TURN * off_pole / max(math.hypot(*omega), TINY))
    return found, time
