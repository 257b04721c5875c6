"""Pinocchio's state as the core's, one at a time: by Pinocchio's own kinematics, a fraction of numpy's time."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.core import tree as columns
from vlmb.model.arrays import BASE_SIZES, Arrays, in_upright_plane
from vlmb.system.frames import LinkFrames

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class CoreReading:
    """Reads directions, lengths and their rates, as `Arrays.pack` does, into one buffer y (positions + velocities,).

    turning: whether directions are needed; without them lengths and the base alone are read.
    """

    def __init__(self, arrays: Arrays, frames: LinkFrames, turning: bool = True) -> None:
        self.frames, self.model = frames, frames.mechanism.model
        layout, first = arrays.layout, arrays.positions
        self.y = np.zeros(first + arrays.velocities)
        kind = int(arrays.tree.shape[columns.BASE_KIND])
        self.on_ski, self.lifts, self.upright = layout.headed, layout.lifts, arrays.upright
        axes = [0, 2] if layout.plane and layout.base == "free" else range(BASE_SIZES[kind][0])
        numbers = [0, 2] if kind == columns.SKI else range(layout.base_size)  # which velocities the core keeps of a base
        places = () if self.on_ski else zip(axes, range(layout.base_size), strict=True)
        rates = [0, 2] if len(axes) == 2 and not self.on_ski else range(len(numbers))
        copied = [*places]
        moved = [(first + at, v) for at, v in zip(rates, numbers, strict=True)]
        self.turns = []  # joint of a link, and where its direction and rate stand
        for row, i in enumerate(arrays.order):
            index = layout.links[i]
            at_p, at_v = (int(arrays.tree.link[row, column]) for column in (columns.AT_P, columns.AT_V))
            if turning:
                self.turns.append((index.joint, slice(at_p, at_p + 3), slice(first + at_v, first + at_v + 3)))
            for number, segment in ((1, index.lower), (2, index.upper)):
                if segment.motion == "free" and segment.joint:
                    length, rate = arrays.length_at(i, number)
                    copied.append((length, segment.q))
                    moved.append((rate, segment.v))
        self.to_q, self.from_q = _columns(copied)
        self.to_v, self.from_v = _columns(moved)

    def read(self, q: Array, v: Array) -> Array:
        """Return the core's state of q (nq,), normalized, and v (nv,): a buffer that the next call writes again."""
        y, data = self.y, self.frames.data
        if self.turns:
            pin.forwardKinematics(self.model, data, q, v)
        poses, spatial = data.oMi, data.v
        if self.on_ski:
            y[0], y[1], y[2] = q[0], q[1], math.atan2(q[3], q[2])
            if self.lifts:
                y[3] = q[4]
        y[self.to_q] = q[self.from_q]
        y[self.to_v] = v[self.from_v]
        for joint, at, rate in self.turns:
            rotation, omega = poses[joint].rotation, spatial[joint].angular
            y[at] = rotation[:, 0]
            y[rate] = omega[2] * rotation[:, 1] - omega[1] * rotation[:, 2]
            if self.upright:
                y[at], y[rate] = in_upright_plane(y[at], y[2]), in_upright_plane(y[rate], y[2])
        return y


def _columns(pairs: list[tuple[int, int]]) -> tuple[Indices, Indices]:
    """Where numbers go, and where they come from."""
    both = np.array(pairs, dtype=np.intp).reshape(-1, 2)
    return both[:, 0], both[:, 1]
