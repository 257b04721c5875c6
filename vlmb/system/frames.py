"""The link frames of one posture: directions, angular velocities, torques, in scratch space of their own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.model.mechanism import Mechanism
from vlmb.model.memory import make_data

Array = NDArray[np.float64]
Vector = tuple[float, float, float]


class LinkFrames:
    """Link directions and Jacobians at the posture of the last `update`, or crba in WORLD convention, in `data`.

    That pinocchio.Data is made when first needed: a chain cut into sub-chains runs without it.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism, self.layout = mechanism, mechanism.layout
        self.balls = np.array([link.v for link in self.layout.links], dtype=np.intp)

    @cached_property
    def data(self) -> Any:
        """Scratch space. Raises VlmbError where it does not fit in memory."""
        return make_data(self.mechanism.model)

    def update(self, q: Array) -> Any:
        """Go to a posture (nq,); return its mass matrix, upper half."""
        return pin.crba(self.mechanism.model, self.data, q, pin.Convention.WORLD)

    @cached_property
    def _axes(self) -> Array:
        """The world's Jacobian (6, nv); of a single velocity it comes flat."""
        axes: Array = self.data.J.reshape(6, -1, order="F")
        return axes

    @cached_property
    def angular(self) -> Array:
        """Axes of all velocities in the surface frame (3, nv)."""
        angular: Array = self._axes[3:6]
        return angular

    @cached_property
    def turning(self) -> Array:
        """The world's Jacobian, transposed (nv, 6): the last three columns are what each velocity turns about."""
        turning: Array = self._axes.T
        return turning

    @cached_property
    def axes(self) -> list[Array]:
        """Rotations of the links' hinges."""
        return [self.data.oMi[link.joint].rotation for link in self.layout.links]

    @cached_property
    def ski(self) -> Array:
        """Rotation of the ski; the identity for another base."""
        ski: Array = self.data.oMi[1].rotation if self.layout.headed else np.eye(3)
        return ski

    @cached_property
    def supports(self) -> Array:
        """1 where a velocity turns a link (n, nv)."""
        layout = self.layout
        supports, turning = np.zeros((len(layout.links), layout.nv)), np.zeros(layout.nv)
        if layout.headed:
            turning[2] = 1.0
        width = 1 if layout.plane else 3
        for i in range(len(layout.links)):
            supports[i] = turning
            for k in layout.path(i):
                at = layout.links[k].v
                supports[i, at : at + width] = 1.0
        return supports

    def direction(self, i: int) -> Vector:
        """d_i in the surface frame."""
        x, y, z = self.axes[i][:, 0].tolist()
        return x, y, z

    def heading(self) -> Vector:
        """The ski's heading; the x axis for another base."""
        x, y, z = self.ski[:, 0].tolist()
        return x, y, z

    def torque(self, i: int, moment: Vector, tau: Array) -> None:
        """Add J_i^T N for a torque N [N m] on link i; -1 is the base, which takes it as far as it can turn."""
        if i >= 0:
            tau += self.supports[i] * np.dot(moment, self.angular)
        elif self.layout.headed:
            tau[2] += moment[2]

    def all_directions(self) -> list[Vector]:
        """Directions of all links, then the heading and the surface normal: [-2] and [-1]."""
        if self.layout.plane:
            found = [self.direction(i) for i in range(len(self.axes))]
        else:  # the first axis of a ball is its link
            found = [(x, y, z) for x, y, z in self.angular.T[self.balls].tolist()]
        return [*found, self.heading(), (0.0, 0.0, 1.0)]

    def all_omegas(self, v: Array) -> list[Sequence[float]]:
        """Absolute angular velocities [rad/s] of all links, then twice of the base: [-2] and [-1]."""
        base = (0.0, 0.0, v.item(2) if self.layout.headed else 0.0)
        return [*(self.supports * v).dot(self.angular.T).tolist(), base, base]

    def all_torques(self, moments: Sequence[Sequence[float]], tau: Array) -> None:
        """Add torques [N m] on all links, then on the base by [-2] and [-1], to tau."""
        count = len(self.axes)
        tau += (np.array(moments[:count]).dot(self.angular) * self.supports).sum(axis=0)
        if self.layout.headed:
            tau[2] += moments[-2][2] + moments[-1][2]


def between(first: Vector, second: Vector) -> tuple[Vector, float, float]:
    """Return the unit axis first x second, the sine and the cosine of the angle between two directions."""
    ax, ay, az = first
    bx, by, bz = second
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 1.0 / sine if sine > 0.0 else 0.0
    return (x * scale, y * scale, z * scale), sine, ax * bx + ay * by + az * bz


def cross(first: Vector, second: Vector) -> Vector:
    """Return the cross product of two vectors."""
    (ax, ay, az), (bx, by, bz) = first, second
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
