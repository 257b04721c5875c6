"""Reading a motion: the values of any quantity at states (q, v), one or many; needs no Pinocchio."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.model.coordinates import Kinematics, Layout, SegmentIndex, kinematics
from vlmb.model.names import POINTS, Quantity
from vlmb.scene.scene import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Postures:
    """Where every point of a mechanism is, and how it moves: q (..., nq), v (..., nv); leading axes are samples."""

    scene: Scene
    layout: Layout
    q: Array
    v: Array

    @cached_property
    def motion(self) -> Kinematics:
        """Frames and angular velocities of the links."""
        return kinematics(self.layout, self.q, self.v)

    def distance(self, link: int, point: str) -> Array:
        """Distance (...) [m] of a point of a link from its hinge: 0, a, a + l or a + l + b."""
        return self._along(link, point)[0]

    def position(self, link: int, point: str) -> Array:
        """Position (..., 3) [m] of a point in the surface frame."""
        return self._point(link, point)[0]

    def velocity(self, link: int, point: str) -> Array:
        """Velocity (..., 3) [m/s] of a point in the surface frame."""
        return self._point(link, point)[1]

    @cached_property
    def base(self) -> tuple[Array, Array]:
        """Position and velocity (..., 3) of the first hinge."""
        at, rate = (np.zeros((*self.q.shape[:-1], 3)) for _ in range(2))
        if self.layout.base == "ski":
            (ahead, left), v = self._ski, self.v
            at[..., :2] = self.q[..., :2]
            rate += v[..., :1] * ahead + v[..., 1:2] * left
        elif self.layout.base == "free":
            axes, size = [0, 2] if self.layout.plane else [0, 1, 2], self.layout.base_size
            at[..., axes], rate[..., axes] = self.q[..., :size], self.v[..., :size]
        return at, rate

    @cached_property
    def centre_of_mass(self) -> tuple[Array, Array]:
        """Position and velocity (..., 3) of the centre of mass of the whole mechanism, its base included."""
        at, rate = (np.zeros((*self.q.shape[:-1], 3)) for _ in range(2))
        base, total = self.scene.base, 0.0

        def add(mass: float, place: Array, speed: Array) -> None:
            nonlocal at, rate, total
            at, rate, total = at + mass * place, rate + mass * speed, total + mass

        place, speed = self.base
        if base.mass and self.layout.base == "ski":
            ahead, left = self._ski
            add(base.mass, place + base.com_offset * ahead, speed + base.com_offset * self.v[..., 2:3] * left)
        elif base.mass:
            add(base.mass, place, speed)
        for i, link in enumerate(self.scene.links):
            hinge, distance = self._point(i, "hinge"), self._along(i, "rod_start")
            add(link.rod.mass, *self._out(i, hinge, (distance[0] + link.rod.centre, distance[1])))
            if link.tip_mass:
                add(link.tip_mass, *self._point(i, "tip"))
        return at / total, rate / total

    def read(self, quantity: Quantity, values: Array, rates: Array) -> Array:
        """Return a quantity (...); `values` and `rates` (..., N) are the coordinates, whose angles have a branch."""
        if quantity.kind == "speed":
            return self.v[..., 0]
        if quantity.kind == "com":
            return self.centre_of_mass[quantity.rate][..., quantity.axis]
        if quantity.kind == "length":
            return self._along(quantity.link, "tip")[quantity.rate]
        if quantity.kind == "direction":
            vectors = self.motion.direction_rates if quantity.rate else self.motion.directions
            return vectors[..., quantity.link, quantity.axis]
        if quantity.kind == "point":
            return self._point(quantity.link, quantity.point)[quantity.rate][..., quantity.axis]
        at = self.layout.place(quantity.kind, quantity.link, quantity.segment)
        return (rates if quantity.rate else values)[..., at]

    @cached_property
    def _ski(self) -> tuple[Array, Array]:
        """Unit vectors (..., 3) ahead and to the left of the ski."""
        zero, norm = np.zeros(self.q.shape[:-1]), np.hypot(self.q[..., 2], self.q[..., 3])
        cosine, sine = self.q[..., 2] / norm, self.q[..., 3] / norm
        return np.stack([cosine, sine, zero], axis=-1), np.stack([-sine, cosine, zero], axis=-1)

    @cached_property
    def _points(self) -> dict[tuple[int, str], tuple[Array, Array]]:
        """Position and velocity of every point of every link, outwards from the base."""
        found: dict[tuple[int, str], tuple[Array, Array]] = {}
        for i in self.layout.order:
            link = self.layout.links[i]
            hinge = self.base if link.parent < 0 else found[link.parent, link.point]
            for point in POINTS:
                found[i, point] = self._out(i, hinge, self._along(i, point))
        return found

    def _point(self, link: int, point: str) -> tuple[Array, Array]:
        return self._points[link, point]

    def _out(self, link: int, hinge: tuple[Array, Array], along: tuple[Array, Array]) -> tuple[Array, Array]:
        """Position and velocity at a distance along a link: h + s d, h' + s' d + s d'."""
        (at, speed), (s, growth) = hinge, (part[..., None] for part in along)
        d, turning = self.motion.directions[..., link, :], self.motion.direction_rates[..., link, :]
        return at + s * d, speed + growth * d + s * turning

    def _along(self, link: int, point: str) -> tuple[Array, Array]:
        """Distance of a point from the hinge and its rate (...)."""
        index = self.layout.links[link]
        zero = np.zeros(self.q.shape[:-1])
        if point == "hinge":
            return zero, zero
        lower = self._length(index.lower)
        if point == "rod_start":
            return lower
        end = lower[0] + index.rod_length, lower[1]
        if point == "rod_end":
            return end
        upper = self._length(index.upper)
        return end[0] + upper[0], end[1] + upper[1]

    def _length(self, segment: SegmentIndex) -> tuple[Array, Array]:
        if segment.joint:
            return self.q[..., segment.q], self.v[..., segment.v]
        return np.full(self.q.shape[:-1], segment.length), np.zeros(self.q.shape[:-1])


def postures(scene: Scene, layout: Layout, q: Any, v: Any = None) -> Postures:
    """Make the postures of states; without v they rest."""
    places = np.asarray(q, float)
    speeds = np.zeros((*places.shape[:-1], layout.nv)) if v is None else np.asarray(v, float)
    return Postures(scene, layout, places, speeds)


