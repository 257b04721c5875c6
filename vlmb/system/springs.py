"""Spring-dampers: along the segments, and on the angle between two directions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, SingularError, nearest
from vlmb.model.coordinates import SegmentIndex
from vlmb.model.mechanism import Mechanism
from vlmb.scene.tables import BASE, Segment
from vlmb.system.frames import LinkFrames, Vector, between

Array = NDArray[np.float64]
Write = Callable[[Array, Array], None]

FADE = 0.02  # [rad] angle below which a damper between directions fades
FEW = 8  # segments that are faster one by one than all at once
NEAR = 0.2  # of the range of a length: one that comes so near to a limit is told
HEADING = "heading"  # the base's horizontal direction in `between`; "base" is the surface normal


class SegmentSprings:
    """Forces of the free segments' spring-dampers, F = -k (xi - rest) - c xidot, written into a buffer.

    `guarded`: whether every evaluation looks at the lengths, so that `near` tells when one came near its limits or left them.
    `few`: indices into y and tau, stiffness, preload and near limits of each, where there are few.
    """

    def __init__(self, segments: Sequence[tuple[Segment, SegmentIndex]], nq: int) -> None:
        self.near = False
        self.dampers = [(nq + at.v, segment.damping) for segment, at in segments if segment.damping]
        self.guarded, self.nq = len(segments) <= FEW, nq
        self.segments = segments
        self.few: list[tuple[int, int, float, float, float, float]] = []
        self.watch()
        self.write = self._one_by_one() if self.guarded else self._at_once(segments)

    def watch(self, y: Array | None = None) -> None:
        """Forget what was near, and tell from now on of lengths within NEAR of their range from a limit.

        The range is that between two limits, else the way to the one from the farthest of length, rest and the length in y.
        """
        self.near, self.few[:] = False, []
        for segment, at in self.segments if self.guarded else ():
            k, (low, high) = segment.stiffness, segment.bounds
            known = [at.length, segment.rest_length, *([] if y is None else [y.item(at.q)])]
            room = high - low if math.isfinite(high - low) else max(abs(x - (low if math.isfinite(low) else high)) for x in known)
            zone = NEAR * room if math.isfinite(room) else 0.0
            self.few.append((at.q, at.v, k, k * segment.rest_length, low + zone, high - zone))

    def dissipation(self, y: Array) -> float:
        """Power lost in the dampers [W]."""
        return sum(damping * y.item(at) ** 2 for at, damping in self.dampers)

    def _one_by_one(self) -> Write:
        """Scalars, a fraction of numpy's time for few segments; tau is left as it is elsewhere."""
        few, damped = self.few, [(at - self.nq, at, damping) for at, damping in self.dampers]

        def write(y: Array, tau: Array) -> None:
            item = y.item
            for q, v, k, preload, low, high in few:
                xi = item(q)
                tau[v] = preload - k * xi
                if not low < xi < high:
                    self.near = True
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
    """Spring-damper on the angle theta between two directions: torque -k (theta - rest) - c theta' s.

    theta' has no direction where the two line up; s = sin^2 / (sin^2 + FADE^2) lets the damper fade there.
    """

    first: int  # link, -1 base normal, -2 heading
    second: int
    stiffness: float
    damping: float
    rest: float
    name: str

    def angle(self, frames: LinkFrames) -> tuple[Vector, float, float]:
        """Axis, sine and cosine of the angle between the two directions now."""
        return between(_reference_direction(self.first, frames), _reference_direction(self.second, frames))

    def torque(
        self, axis: Vector, sine: float, cosine: float, first: Sequence[float], second: Sequence[float]
    ) -> tuple[float, float]:
        """Torque about the axis on the second [N m], for angular velocities of both; and the power lost in the damper [W]."""
        angle = math.atan2(sine, cosine)
        if sine < 1e-9:
            if abs(angle - self.rest) * self.stiffness > 1e-6 * self.stiffness:
                raise SingularError(
                    f"{self.name}: the two directions line up (angle {angle:.3g} rad), where a spring with rest = "
                    f"{self.rest:g} has no axis to turn about; start elsewhere or use rest = 0"
                )
            return 0.0, 0.0
        (x, y, z), (ax, ay, az), (bx, by, bz) = axis, first, second
        rate = (bx - ax) * x + (by - ay) * y + (bz - az) * z
        damping = self.damping * sine * sine / (sine * sine + FADE * FADE)
        return -self.stiffness * (angle - self.rest) - damping * rate, damping * rate * rate

    def energy(self, frames: LinkFrames) -> float:
        """k (theta - rest)^2 / 2 [J]."""
        _, sine, cosine = self.angle(frames)
        return 0.5 * self.stiffness * (math.atan2(sine, cosine) - self.rest) ** 2


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


def apply_springs(springs: Sequence[DirectionSpring], frames: LinkFrames, v: Array, tau: Array) -> float:
    """Add the torques of all springs to tau, equal and opposite on their two; return the power lost in dampers [W], >= 0."""
    directions, omegas = frames.all_directions(), frames.all_omegas(v)
    moments = [[0.0, 0.0, 0.0] for _ in directions]
    lost = 0.0
    for spring in springs:
        first, second = spring.first, spring.second
        axis, sine, cosine = between(directions[first], directions[second])
        torque, power = spring.torque(axis, sine, cosine, omegas[first], omegas[second])
        lost += power
        for k in range(3):
            moments[first][k] -= torque * axis[k]
            moments[second][k] += torque * axis[k]
    frames.all_torques(moments, tau)
    return lost


def _reference_direction(which: int, frames: LinkFrames) -> Vector:
    if which >= 0:
        return frames.direction(which)
    return (0.0, 0.0, 1.0) if which == -1 else frames.heading()
