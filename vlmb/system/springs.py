"""Spring-dampers: along the segments, and on the angle between two directions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, SingularError, nearest
from vlmb.model.layout import Layout, SegmentIndex
from vlmb.model.mechanism import Mechanism
from vlmb.scene.tables import BASE, Segment
from vlmb.system.events import BOTH_WAYS, FALLING, RISING
from vlmb.system.frames import LinkFrames, Vector, between, cross

Array = NDArray[np.float64]
Write = Callable[[Array, Array], None]

FEW = 8  # segments that are faster one by one than all at once
HEADING = "heading"  # the base's horizontal direction in `between`; "base" is the surface normal


class SegmentSprings:
    """Forces of the free segments' spring-dampers, F = -k (xi - rest) - c xidot, written into a buffer."""

    def __init__(self, segments: Sequence[tuple[Segment, SegmentIndex]], nq: int) -> None:
        self.nq = nq
        self.dampers = [(nq + at.v, segment.damping) for segment, at in segments if segment.damping]
        self.write = self._one_by_one(segments) if len(segments) <= FEW else self._at_once(segments)

    def dissipation(self, y: Array) -> float:
        """Power lost in the dampers [W]."""
        return sum(damping * y.item(at) ** 2 for at, damping in self.dampers)

    def _one_by_one(self, segments: Sequence[tuple[Segment, SegmentIndex]]) -> Write:
        """Scalars, a fraction of numpy's time for few segments; tau is left as it is elsewhere."""
        damped = [(at - self.nq, at, damping) for at, damping in self.dampers]
        few = [(at.q, at.v, segment.stiffness, segment.stiffness * segment.rest_length) for segment, at in segments]

        def write(y: Array, tau: Array) -> None:
            item = y.item
            for q, v, k, preload in few:
                tau[v] = preload - k * item(q)
            for v, rate, c in damped:
                tau[v] -= c * item(rate)

        return write

    def _at_once(self, segments: Sequence[tuple[Segment, SegmentIndex]]) -> Write:
        """The same by numpy for many."""
        q, v = (np.array([getattr(at, name) for _, at in segments], dtype=np.intp) for name in "qv")
        minus_k = np.array([-segment.stiffness for segment, _ in segments])
        preload = np.array([segment.stiffness * segment.rest_length for segment, _ in segments])
        rates, damped = self.nq + v, bool(self.dampers)
        minus_c = np.array([-segment.damping for segment, _ in segments])
        forces, losses, multiply, add = np.zeros(len(v)), np.zeros(len(v)), np.multiply, np.add

        def write(y: Array, tau: Array) -> None:
            y.take(q, None, forces, "clip")
            multiply(forces, minus_k, forces)
            add(forces, preload, forces)
            if damped:
                y.take(rates, None, losses, "clip")
                multiply(losses, minus_c, losses)
                add(forces, losses, forces)
            tau[v] = forces

        return write


def spring_energy(mechanism: Mechanism, q: Array) -> Array:
    """Energy [J] of the segment springs, sum k (xi - rest)^2 / 2, for q (..., nq)."""
    energy = np.zeros(np.shape(q)[:-1])
    for segment, at in free_segments(mechanism):
        energy = energy + 0.5 * segment.stiffness * (q[..., at.q] - segment.rest_length) ** 2
    return energy


def free_segments(mechanism: Mechanism) -> Iterator[tuple[Segment, SegmentIndex]]:
    """Yield every segment that is a free coordinate, with its indices."""
    for link, indices in zip(mechanism.scene.links, mechanism.layout.links, strict=True):
        for segment, at in ((link.lower, indices.lower), (link.upper, indices.upper)):
            if at.joint and at.motion == "free":
                yield segment, at


@dataclass(frozen=True)
class DirectionSpring:
    """Spring-damper between two directions: torque -k (theta - rest) on the angle theta between them.

    The damper between two links takes the power c theta'^2. Where one end is the base, of the angular velocity w, it takes
    c |d' - w x d|^2: isotropic, and regular in every posture. In a plane theta of two links is the signed angle of the second
    over the first, which no line-up disturbs.
    """

    first: int  # link, -1 base normal, -2 heading
    second: int
    stiffness: float
    damping: float
    rest: float
    name: str

    @property
    def on_base(self) -> bool:
        """Whether one end is the base."""
        return min(self.first, self.second) < 0

    def signed(self, layout: Layout) -> bool:
        """Whether the angle is a signed one."""
        return layout.plane and not self.on_base

    def singular_line_up(self, layout: Layout) -> float | None:
        """Return the way that the rate of cos(theta) crosses 0 at a line-up with a torque: down at 0, up at pi, or both.

        None where there is none: a signed angle, or an undamped spring at rest there.
        """
        damped = self.damping > 0.0 and not self.on_base
        if self.signed(layout) or not (self.stiffness or damped):
            return None
        if damped or self.rest not in (0.0, math.pi):
            return BOTH_WAYS
        return RISING if self.rest == 0.0 else FALLING

    def angle(self, frames: LinkFrames, q: Array) -> float:
        """Theta [rad] at a configuration, where the frames are up to date."""
        if self.signed(frames.layout):
            return _elevation(frames.layout, self.second, q) - _elevation(frames.layout, self.first, q)
        directions = frames.all_directions()
        _, sine, cosine = between(directions[self.first], directions[self.second])
        return math.atan2(sine, cosine)

    def spring_torque(self, angle: float, sine: float) -> float:
        """Torque of the spring [N m]. Raises SingularError where it has no axis to turn about."""
        off = angle - self.rest
        if sine < 1e-9 and abs(off) * self.stiffness > 1e-6 * self.stiffness:
            raise SingularError(
                f"{self.name}: the two directions line up (angle {angle:.3g} rad), where a spring with rest = "
                f"{self.rest:g} has no axis to turn about; start elsewhere or use rest = 0"
            )
        return -self.stiffness * off

    def energy(self, frames: LinkFrames, q: Array) -> float:
        """k (theta - rest)^2 / 2 [J]."""
        return 0.5 * self.stiffness * (self.angle(frames, q) - self.rest) ** 2


def _elevation(layout: Layout, link: int, q: Array) -> float:
    """Elevation of a link in a plane, full turns counted: the sum of the hinges' angles."""
    return float(sum(q.item(layout.links[i].q) for i in layout.path(link)))


def direction_springs(mechanism: Mechanism) -> tuple[DirectionSpring, ...]:
    """Collect the springs between directions; SceneError for an unknown link or a base that cannot answer."""
    names = {link.name: i for i, link in enumerate(mechanism.layout.links)} | {BASE: -1, HEADING: -2}
    springs = []
    for index, force in enumerate(mechanism.scene.forces):
        if force.between is None:
            continue
        key = f"forces[{index}].between"
        for name in force.between:
            if name not in names:
                raise SceneError(f"{key}: unknown link {name!r}; {nearest(name, names)}")
        first, second = (names[name] for name in force.between)
        if first == second or max(first, second) < 0:
            raise SceneError(f"{key}: needs two different directions, at least one of them a link's")
        if mechanism.layout.base == "free" and min(first, second) < 0:
            raise SceneError(f"{key}: a flying mechanism has no base to push against; name two links")
        springs.append(DirectionSpring(first, second, force.stiffness, force.damping, force.rest, f"forces[{index}]"))
    return tuple(springs)


def apply_springs(springs: Sequence[DirectionSpring], frames: LinkFrames, q: Array, v: Array, tau: Array) -> float:
    """Add the torques of all springs to tau, equal and opposite on their two; return the power lost in dampers [W], >= 0."""
    directions, omegas = frames.all_directions(), frames.all_omegas(v)
    moments = [[0.0, 0.0, 0.0] for _ in directions]
    lost = 0.0

    def push(spring: DirectionSpring, torque: float, axis: Vector) -> None:
        for k in range(3):
            moments[spring.first][k] -= torque * axis[k]
            moments[spring.second][k] += torque * axis[k]

    for spring in springs:
        first, second = spring.first, spring.second
        (ax, ay, az), (bx, by, bz) = omegas[first], omegas[second]
        if spring.signed(frames.layout):
            hx, hy, _ = frames.heading()
            axis = hy, -hx, 0.0  # an elevation grows about it
            rate = (bx - ax) * hy - (by - ay) * hx
            push(spring, -spring.stiffness * (spring.angle(frames, q) - spring.rest) - spring.damping * rate, axis)
            lost += spring.damping * rate * rate
            continue
        axis, sine, cosine = between(directions[first], directions[second])
        torque = spring.spring_torque(math.atan2(sine, cosine), sine)
        if spring.on_base:
            lost += _damp_on_base(spring, directions, omegas, moments)
        else:
            rate = (bx - ax) * axis[0] + (by - ay) * axis[1] + (bz - az) * axis[2]
            torque, lost = torque - spring.damping * rate, lost + spring.damping * rate * rate
        push(spring, torque, axis)
    frames.all_torques(moments, tau)
    return lost


def _damp_on_base(
    spring: DirectionSpring, directions: Sequence[Vector], omegas: Sequence[Sequence[float]], moments: list[list[float]]
) -> float:
    """Add the torque -c d x (d' - w x d) on a link and its reaction on the base; return the power lost [W]."""
    link = max(spring.first, spring.second)
    d, omega, (_, _, yaw) = directions[link], omegas[link], omegas[-1]
    turning = cross((omega[0], omega[1], omega[2] - yaw), d)  # d' - w x d
    torque = cross(d, turning)
    for k in range(3):
        moments[link][k] -= spring.damping * torque[k]
        moments[-1][k] += spring.damping * torque[k]
    return spring.damping * (turning[0] ** 2 + turning[1] ** 2 + turning[2] ** 2)
