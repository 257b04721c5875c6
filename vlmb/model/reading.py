"""Reading a motion: the values of any quantity at states (q, v), one or many; needs no Pinocchio."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.core import along
from vlmb.core.calls import direct
from vlmb.errors import SceneError
from vlmb.model.coordinates import kinematics
from vlmb.model.layout import Layout, LinkIndex
from vlmb.model.names import AXES, POINTS, Quantity
from vlmb.scene.scene import Scene

Array = NDArray[np.float64]

angles_along = direct(along.angles_along)


@dataclass(frozen=True, eq=False)
class Postures:
    """Where every point of a mechanism is, and how it moves; leading axes are samples. Needs no Pinocchio and no angles."""

    scene: Scene
    layout: Layout
    place: Array  # (..., 3) [m] of the first hinge, a ski's point A
    velocity_of_place: Array  # (..., 3) [m/s]
    heading: Array  # (...) [rad] of a ski, 0 for another base
    turning: Array  # (...) [rad/s] its rate
    directions: Array  # (..., n, 3)
    direction_rates: Array  # (..., n, 3) [1/s]
    lengths: Array  # (..., n, 2) [m] of lower and upper segments
    length_rates: Array  # (..., n, 2) [m/s]

    def as_samples(self) -> Postures:
        """Return one posture as a motion of one sample."""
        arrays = (self.place, self.velocity_of_place, np.asarray(self.heading), np.asarray(self.turning), self.directions,
                  self.direction_rates, self.lengths, self.length_rates)  # fmt: skip
        return Postures(self.scene, self.layout, *(entry[None] for entry in arrays))

    def sample(self, at: int) -> Postures:
        """Return one of many postures."""
        arrays = (self.place, self.velocity_of_place, self.heading, self.turning, self.directions, self.direction_rates,
                  self.lengths, self.length_rates)  # fmt: skip
        return Postures(self.scene, self.layout, *(entry[at] for entry in arrays))

    @property
    def speed(self) -> Array:
        """Velocity (...) [m/s] along the ski."""
        ahead, _ = self._ski
        return np.einsum("...k,...k->...", ahead, self.velocity_of_place)

    def distance(self, link: int, point: str) -> Array:
        """Distance (...) [m] of a point of a link from its hinge: 0, a, a + l or a + l + b."""
        return self._along(link, point)[0]

    def position(self, link: int, point: str) -> Array:
        """Position (..., 3) [m] of a point in the surface frame."""
        return self._points[link, point][0]

    def velocity(self, link: int, point: str) -> Array:
        """Velocity (..., 3) [m/s] of a point in the surface frame."""
        return self._points[link, point][1]

    @cached_property
    def centre_of_mass(self) -> tuple[Array, Array]:
        """Position and velocity (..., 3) of the centre of mass of the whole mechanism, its base included."""
        base, total = self.scene.base, 0.0
        at, rate = np.zeros_like(self.place), np.zeros_like(self.place)

        def add(mass: float, place: Array, speed: Array) -> None:
            nonlocal at, rate, total
            at, rate, total = at + mass * place, rate + mass * speed, total + mass

        ahead, left = self._ski
        lever = base.com_offset
        if base.mass:
            add(base.mass, self.place + lever * ahead, self.velocity_of_place + lever * self.turning[..., None] * left)
        for i, link in enumerate(self.scene.links):
            start, growth = self._along(i, "rod_start")
            add(link.rod.mass, *self._out(i, self._points[i, "hinge"], (start + link.rod.centre, growth)))
            if link.tip_mass:
                add(link.tip_mass, *self._points[i, "tip"])
        return at / total, rate / total

    def read(self, quantity: Quantity, values: Array, rates: Array) -> Array:
        """Return a quantity (...); `values` and `rates` (..., N) are the coordinates, whose angles have a branch."""
        if quantity.kind == "speed":
            return self.speed
        if quantity.kind == "com":
            return self.centre_of_mass[quantity.rate][..., quantity.axis]
        if quantity.kind == "length":
            return self._along(quantity.link, "tip")[quantity.rate]
        if quantity.kind == "direction":
            vectors = self.direction_rates if quantity.rate else self.directions
            return vectors[..., quantity.link, quantity.axis]
        if quantity.kind == "point":
            return self._points[quantity.link, quantity.point][quantity.rate][..., quantity.axis]
        if quantity.kind == "leg":
            raise SceneError(f"{quantity.name}: equations and trajectories read this; take the point that the leg is from")
        at = self.layout.place(quantity.kind, quantity.link, quantity.segment)
        return (rates if quantity.rate else values)[..., at]

    @cached_property
    def _ski(self) -> tuple[Array, Array]:
        """Unit vectors (..., 3) ahead and to the left of the ski."""
        cosine, sine, zero = np.cos(self.heading), np.sin(self.heading), np.zeros_like(self.heading)
        return np.stack([cosine, sine, zero], axis=-1), np.stack([-sine, cosine, zero], axis=-1)

    @cached_property
    def _points(self) -> dict[tuple[int, str], tuple[Array, Array]]:
        """Position and velocity of every point of every link, outwards from the base."""
        found: dict[tuple[int, str], tuple[Array, Array]] = {}
        for i in self.layout.order:
            link = self.layout.links[i]
            hinge = self._anchored(link.anchor) if link.parent < 0 else self._hung(link, found)
            for point in POINTS:
                found[i, point] = self._out(i, hinge, self._along(i, point))
        return found

    def _anchored(self, anchor: tuple[float, float, float]) -> tuple[Array, Array]:
        """Position and velocity of a place of the base: r_A + R r, v_A + phi0' z x R r."""
        forward, left = self._ski
        ahead, aside, up = anchor
        flat, across = ahead * forward + aside * left, ahead * left - aside * forward
        return self.place + flat + np.array([0.0, 0.0, up]), self.velocity_of_place + self.turning[..., None] * across

    def _hung(self, link: LinkIndex, found: dict[tuple[int, str], tuple[Array, Array]]) -> tuple[Array, Array]:
        """Position and velocity of the place where a link hangs on its parent."""
        if link.point == "tip":
            at, speed = found[link.parent, "tip"]
        else:
            start, growth = self._along(link.parent, "rod_start")
            at, speed = self._out(link.parent, found[link.parent, "hinge"], (start + link.on_rod, growth))
        return at + np.array(link.anchor), speed

    def _out(self, link: int, hinge: tuple[Array, Array], along: tuple[Array, Array]) -> tuple[Array, Array]:
        """Position and velocity at a distance along a link: h + s d, h' + s' d + s d'."""
        (at, speed), (s, growth) = hinge, (part[..., None] for part in along)
        d, turning = self.directions[..., link, :], self.direction_rates[..., link, :]
        return at + s * d, speed + growth * d + s * turning

    def _along(self, link: int, point: str) -> tuple[Array, Array]:
        """Distance of a point from the hinge and its rate (...)."""
        lengths, rates = self.lengths[..., link, :], self.length_rates[..., link, :]
        if point == "hinge":
            return np.zeros_like(lengths[..., 0]), np.zeros_like(lengths[..., 0])
        rod = 0.0 if point == "rod_start" else self.layout.links[link].rod_length
        if point == "tip":
            return lengths[..., 0] + rod + lengths[..., 1], rates[..., 0] + rates[..., 1]
        return lengths[..., 0] + rod, rates[..., 0]


def postures(scene: Scene, layout: Layout, q: Any, v: Any = None) -> Postures:
    """Make the postures of Pinocchio's states q (..., nq), v (..., nv); without v they rest."""
    q = np.asarray(q, float)
    v = np.zeros((*q.shape[:-1], layout.nv)) if v is None else np.asarray(v, float)
    shape, motion = q.shape[:-1], kinematics(layout, q, v)
    place, velocity = np.zeros((*shape, 3)), np.zeros((*shape, 3))
    heading, turning = np.zeros(shape), np.zeros(shape)
    if layout.base == "ski":
        norm = np.hypot(q[..., 2], q[..., 3])
        cosine, sine, forward, left = q[..., 2] / norm, q[..., 3] / norm, v[..., 0], v[..., 1]
        heading, turning = np.arctan2(q[..., 3], q[..., 2]), v[..., 2]
        place[..., :2] = q[..., :2]
        velocity[..., 0], velocity[..., 1] = cosine * forward - sine * left, sine * forward + cosine * left
        if layout.lifts:
            place[..., 2], velocity[..., 2] = q[..., 4], v[..., 3]
    elif layout.base == "free":
        axes, size = [0, 2] if layout.plane else [0, 1, 2], layout.base_size
        place[..., axes], velocity[..., axes] = q[..., :size], v[..., :size]
    lengths, rates = np.zeros((*shape, len(layout.links), 2)), np.zeros((*shape, len(layout.links), 2))
    for i, link in enumerate(layout.links):
        for side, segment in enumerate((link.lower, link.upper)):
            lengths[..., i, side] = q[..., segment.q] if segment.joint else segment.length
            if segment.joint:
                rates[..., i, side] = v[..., segment.v]
    directions, turns = motion.directions, motion.direction_rates
    return Postures(scene, layout, place, velocity, heading, turning, directions, turns, lengths, rates)


def read_along(seen: Postures, t: Array, branch: Array) -> tuple[Array, Array]:
    """Read the coordinates and rates (samples, N) of a motion at the times t (samples,).

    Angles are read on the branch nearest to their row of `branch` (samples, N); after a single row (1, N) they go on
    continuously. Rates that can be trusted tell how far an angle has gone since the last sample: fast turns are counted.
    """
    layout, count = seen.layout, len(t)
    values, rates = np.zeros((count, len(layout.names))), np.zeros((count, len(layout.names)))
    for at, c in enumerate(layout.coordinates):
        if c.kind == "xi":
            values[:, at], rates[:, at] = seen.lengths[:, c.link, c.segment - 1], seen.length_rates[:, c.link, c.segment - 1]
        elif c.kind in AXES:
            values[:, at], rates[:, at] = seen.place[:, AXES.index(c.kind)], seen.velocity_of_place[:, AXES.index(c.kind)]
    places = np.array([layout.place("psi", i) for i in range(len(layout.links))], np.int64)
    t, heading, turning, directions, turns, branch = (
        np.array(entry, float, order="C")
        for entry in (t, seen.heading, seen.turning, seen.directions, seen.direction_rates, branch)
    )
    angles_along(
        t, heading, turning, directions, turns, branch, places, layout.plane, layout.base == "ski",
        np.zeros(len(layout.names)), values, rates,
    )  # fmt: skip
    return values, rates
