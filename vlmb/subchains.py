"""Sub-chains: a long chain cut at hinges into pieces with a Pinocchio model each, joined by point rows.

    M_s a_s + h_s = tau_s + J_b^T f_s - J_t^T f_(s+1)          piece s: b its first hinge, t its tip
    J_t a_s + drift_s = J_b a_(s+1)                            the tip of s is the hinge of s + 1

M_s^-1 of (tau_s - h_s, J_b^T, J_t^T) by one Cholesky a piece leaves a symmetric block-tridiagonal system for the forces f in
the hinges: banded, so that time and memory grow with the number of links. The state stays that of the one chain, so nothing
drifts. Each piece moves in the axes of the link before it, in a frame that falls freely with its hinge: there the hinge has
neither place, velocity nor weight, and only the angular velocity and acceleration of that link come in.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.linalg import lapack

from vlmb.constrained import SIDEWAYS
from vlmb.coordinates import kinematics
from vlmb.cuts import PIECE, cuts, obstacle, part
from vlmb.errors import SceneError, SingularError
from vlmb.mechanism import Mechanism, build
from vlmb.springs import free_segments, rest_length

Array = NDArray[np.float64]

class _Piece:
    """One sub-chain: its model, its buffers, and live views of what it hands on to the next."""

    def __init__(self, mechanism: Mechanism, start: int, at: int, width: int) -> None:
        layout, self.model, self.data = mechanism.layout, mechanism.model, mechanism.data
        self.whole = mechanism
        free = width if start else 0  # velocities of the hinge that flies
        self.q, self.v = np.zeros(layout.nq), np.zeros(layout.nv)
        self.inner_q, self.inner_v = self.q[free:], self.v[free:]
        self.in_q, self.in_v = slice(start, start + layout.nq - free), slice(at, at + layout.nv - free)
        self.turn = slice(free, free + (1 if layout.plane else 3))
        self.tip = mechanism.frames[f"{layout.links[-1].name}.tip"]
        frame = self.model.frames[self.tip]
        self.reach = float(frame.placement.translation[0])
        joint = frame.parentJoint if hasattr(frame, "parentJoint") else frame.parent
        velocity, drift = self.data.v[joint], self.data.a_gf[joint]
        self.velocity, self.spin = velocity.linear, velocity.angular  # of the last link, in its axes
        self.drift, self.turning = drift.linear, drift.angular
        self.right = np.zeros((layout.nv, 1 + 2 * width), order="F")  # tau - h, J_b^T, J_t^T
        for k in range(free):
            self.right[k, 1 + k] = 1.0
        self.load, self.ends = self.right[:, 0], self.right[:, 1 + width :]
        self.jacobian = np.zeros((6, layout.nv))
        self.answer = self.right
        self.mass = self.data.M


class SubChains:
    """Accelerations of a long chain through its pieces. Holds buffers: one thread at a time.

    Raises SceneError for a scene that cannot be cut.
    """

    def __init__(self, mechanism: Mechanism, size: int = PIECE, reduced: bool = True) -> None:
        scene, layout = mechanism.scene, mechanism.layout
        why = obstacle(scene)
        if why is not None:
            raise SceneError(f"the route 'subchains' does not serve {why}; use 'dense'")
        self.mechanism, self.plane = mechanism, layout.plane
        self.width = 2 if layout.plane else 3
        self.axes = (0, 2) if layout.plane else (0, 1, 2)
        self.sliding = layout.base == "ski" and reduced
        self.pieces: list[_Piece] = []
        for first, last in cuts(scene, size):
            start, at = (layout.links[first].q, layout.links[first].v) if first else (0, 0)
            self.pieces.append(_Piece(build(part(scene, first, last)), start, at, self.width))
        segments = list(free_segments(mechanism))
        self.slots_q = np.array([at.q for _, at in segments], dtype=np.intp)
        self.slots_v = np.array([at.v for _, at in segments], dtype=np.intp)
        self.stiffness = np.array([segment.stiffness for segment, _ in segments])
        self.damping = np.array([segment.damping for segment, _ in segments])
        self.rest = np.array([rest_length(segment) for segment, _ in segments])
        self.tau, self.vdot = np.zeros(layout.nv), np.zeros(layout.nv)
        self._prepare_band()

    def _prepare_band(self) -> None:
        """Where the entries of the blocks sit in the band, lower form: band[i - j, j] = a_ij."""
        width, count = self.width, max(len(self.pieces) - 1, 0)
        self.gram = np.zeros((len(self.pieces), 1 + 2 * width, 1 + 2 * width))
        self.tip_drift = np.zeros((count, width))
        self.band = np.zeros((2 * width, max(count, 1) * width))
        self.base, self.tips = slice(1, 1 + width), slice(1 + width, 1 + 2 * width)
        self.lower, self.columns = np.tril_indices(width)
        rows, columns = (grid.ravel() for grid in np.indices((width, width)))
        starts = width * np.arange(count)[:, None]
        self.diagonal = (self.lower - self.columns) * self.band.shape[1] + starts + self.columns
        self.below = (width + rows - columns) * self.band.shape[1] + starts[: max(count - 1, 0)] + columns
        self.weights = np.zeros((len(self.pieces), 1 + 2 * width))
        self.weights[:, 0] = 1.0

    def springs(self, q: Array, v: Array) -> Array:
        """Forces (nv,) of the segment springs and dampers, F = -k (xi - rest) - c xidot."""
        self.tau[self.slots_v] = self.stiffness * (self.rest - q[self.slots_q]) - self.damping * v[self.slots_v]
        return self.tau

    def dissipation(self, v: Array) -> float:
        """Power lost in the dampers [W]."""
        return float(self.damping.dot(v[self.slots_v] ** 2))

    def accelerations(self, q: Array, v: Array) -> Array:
        """Return vdot (nv,), a buffer, of the whole chain at a normalized q under its springs and its weight.

        Raises SingularError naming the links of a piece with a motion without inertia.
        """
        tau, last = self.springs(q, v), len(self.pieces) - 1
        gram, drift, sliding = self.gram, self.tip_drift, self.sliding
        before: _Piece | None = None
        for s, piece in enumerate(self.pieces):
            self._evaluate(piece, before, q, v, tau, s < last)
            if sliding and s == 0:
                piece.mass[SIDEWAYS], piece.mass[:, SIDEWAYS], piece.right[SIDEWAYS] = 0.0, 0.0, 0.0
                piece.mass[SIDEWAYS, SIDEWAYS] = 1.0
            if s < last:
                drift[s] = self._tip_drift(piece)
            _, piece.answer, info = lapack.dposv(piece.mass, piece.right, overwrite_a=1)
            if info:
                names = [link.name for link in piece.whole.layout.links]
                raise SingularError(
                    f"the mass matrix is singular in the piece {names[0]} to {names[-1]} of the chain: a hinge there can move "
                    f"without inertia. {' '.join(self.mechanism.warnings)}".rstrip()
                )
            np.dot(piece.right.T, piece.answer, out=gram[s])
            before = piece
        if last > 0:
            self._join()
        return self._collect()

    def _evaluate(self, piece: _Piece, before: _Piece | None, q: Array, v: Array, tau: Array, joined: bool) -> None:
        """Mass matrix, tau - h and the tip's Jacobian of one piece, in the axes of the link before it."""
        piece.inner_q[:] = q[piece.in_q]
        piece.inner_v[:] = v[piece.in_v]
        if before is not None:
            piece.v[piece.turn] += self._carried(piece, before.spin)
        pin.crba(piece.model, piece.data, piece.q, pin.Convention.WORLD)
        if joined:
            piece.jacobian = pin.getFrameJacobian(piece.model, piece.data, piece.tip, pin.ReferenceFrame.LOCAL)
            for k, axis in enumerate(self.axes):
                piece.ends[:, k] = piece.jacobian[axis]
        bias = pin.nonLinearEffects(piece.model, piece.data, piece.q, piece.v)
        np.negative(bias, piece.load)
        piece.load[len(bias) - len(piece.inner_v) :] += tau[piece.in_v]

    def _carried(self, piece: _Piece, vector: Array) -> Array:
        """Turn a vector of the link before into the axes of this piece's first link: R^T w; in a plane its part along -y."""
        if self.plane:
            return -vector[1:2]
        x, y, z, w = piece.q[3:7].tolist()
        a, b, c = vector.tolist()
        d, e, f = 2.0 * (c * y - b * z), 2.0 * (a * z - c * x), 2.0 * (b * x - a * y)
        return np.array([a - w * d + f * y - e * z, b - w * e + d * z - f * x, c - w * f + e * x - d * y])

    def _tip_drift(self, piece: _Piece) -> Array:
        """Acceleration of the tip at vdot = 0, less gravity, in the last link's axes: a + alpha x r + omega x (v + omega x r)."""
        reach = piece.reach
        (vx, vy, vz), (wx, wy, wz) = piece.velocity.tolist(), piece.spin.tolist()
        (ax, ay, az), (_, alpha_y, alpha_z) = piece.drift.tolist(), piece.turning.tolist()
        vy, vz = vy + wz * reach, vz - wy * reach
        found = (
            ax + wy * vz - wz * vy,
            ay + alpha_z * reach + wz * vx - wx * vz,
            az - alpha_y * reach + wx * vy - wy * vx,
        )
        return np.array([found[axis] for axis in self.axes])

    def _join(self) -> None:
        """Solve the banded system for the forces in the cut hinges."""
        gram, base, tips, flat = self.gram, self.base, self.tips, self.band.ravel()
        blocks = gram[:-1, tips, tips] + gram[1:, base, base]
        flat[self.diagonal] = blocks[:, self.lower, self.columns]
        flat[self.below] = -gram[1:-1, tips, base].reshape(self.below.shape)
        right = self.tip_drift + gram[:-1, tips, 0] - gram[1:, base, 0]
        _, forces, info = lapack.dpbsv(self.band, right.ravel(), lower=1)
        if info:
            at = (info - 1) // self.width
            name = self.pieces[at].whole.layout.links[-1].name
            raise SingularError(f"the hinge at the tip of {name!r} can move without inertia; give {name!r} a tip_mass")
        forces = forces.reshape(-1, self.width)
        self.weights[1:, base] = forces
        self.weights[:-1, tips] = -forces

    def _collect(self) -> Array:
        """Accelerations of all pieces; a ball's, relative to the link before: wdot - R^T wdot_p + w x R^T w_p."""
        before: _Piece | None = None
        turning = np.zeros(3)
        for piece, weights in zip(self.pieces, self.weights, strict=True):
            found = piece.answer.dot(weights)
            last_turning = piece.jacobian[3:].dot(found) + piece.turning
            if before is not None:
                found[piece.turn] -= self._carried(piece, turning)
                if not self.plane:
                    (a, b, c), (x, y, z) = piece.v[3:6].tolist(), self._carried(piece, before.spin).tolist()
                    found[3:6] += (b * z - c * y, c * x - a * z, a * y - b * x)
            self.vdot[piece.in_v] = found[len(found) - len(piece.inner_v) :]
            turning, before = last_turning, piece
        return self.vdot

    def conditioning(self, q: Array) -> tuple[float, list[str]]:
        """Condition number of the worst piece's mass matrix, scaled to a unit diagonal, and its first and last link."""
        worst, names = 0.0, ["every coordinate"]
        for piece in self.pieces:
            piece.inner_q[:] = q[piece.in_q]
            mass = np.array(pin.crba(piece.model, piece.data, piece.q, pin.Convention.WORLD))
            if not np.isfinite(mass).all():
                return np.inf, names
            scale = np.sqrt(np.maximum(np.diag(mass), 1e-300))
            values = np.linalg.eigvalsh(mass / np.outer(scale, scale))
            condition = float(values[-1] / values[0]) if values[0] > 0.0 else np.inf
            if condition > worst:
                links = piece.whole.layout.links
                worst, names = condition, [f"a hinge or segment between {links[0].name} and {links[-1].name}"]
        return worst, names


def chain_energies(mechanism: Mechanism, q: Array, v: Array) -> tuple[Array, Array]:
    """Kinetic and potential energy (N,) [J] of a chain at states q (N, nq), v (N, nv), from the points of its links."""
    scene, layout, motion = mechanism.scene, mechanism.layout, kinematics(mechanism.layout, q, v)
    d, rate = motion.directions, motion.direction_rates
    gravity, base = np.array(scene.surface_gravity), scene.base
    at, velocity = np.zeros((len(q), 3)), np.zeros((len(q), 3))
    kinetic, potential = np.zeros(len(q)), np.zeros(len(q))
    if layout.base == "free":
        axes = [0, 2] if layout.plane else [0, 1, 2]
        at[:, axes], velocity[:, axes] = q[:, : layout.base_size], v[:, : layout.base_size]
    elif layout.base == "ski":
        ahead = np.stack([q[:, 2], q[:, 3], np.zeros(len(q))], axis=1)
        left = np.stack([-q[:, 3], q[:, 2], np.zeros(len(q))], axis=1)
        at[:, :2], velocity = q[:, :2], v[:, :1] * ahead + v[:, 1:2] * left
        kinetic += 0.5 * base.inertia * v[:, 2] ** 2

    def add(mass: float, place: Array, speed: Array) -> None:
        nonlocal kinetic, potential
        kinetic, potential = kinetic + 0.5 * mass * (speed**2).sum(axis=1), potential - mass * place @ gravity

    if layout.base == "ski":
        add(base.mass, at + base.com_offset * ahead, velocity + base.com_offset * v[:, 2:3] * left)
    elif base.mass:
        add(base.mass, at, velocity)
    for i, (link, entry) in enumerate(zip(scene.links, layout.links, strict=True)):
        (lower, lower_rate), (upper, upper_rate) = (
            (q[:, [side.q]], v[:, [side.v]]) if side.joint else (side.length, 0.0) for side in (entry.lower, entry.upper)
        )
        centre = lower + link.rod.centre
        add(link.rod.mass, at + centre * d[:, i], velocity + lower_rate * d[:, i] + centre * rate[:, i])
        kinetic += 0.5 * link.rod.transverse_inertia * (rate[:, i] ** 2).sum(axis=1)
        whole = lower + link.rod.length + upper
        at, velocity = at + whole * d[:, i], velocity + (lower_rate + upper_rate) * d[:, i] + whole * rate[:, i]
        add(link.tip_mass, at, velocity)
    return kinetic, potential
