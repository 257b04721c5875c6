"""Sub-chains: a long chain cut at hinges into pieces with a Pinocchio model each, joined by point rows.

    M_s a_s + h_s = tau_s + J_b^T f_s - J_t^T f_(s+1)          piece s: b its first hinge, t its tip
    J_t a_s + drift_s = J_b a_(s+1)                            the tip of s is the hinge of s + 1

With M_s = L L^T, the columns of L^-1 (tau_s - h_s, J_b^T, -J_t^T) multiplied with each other leave a symmetric
block-tridiagonal system for the forces f in the hinges: banded, so that time and memory grow with the number of links. The
state stays that of the one chain, so nothing drifts. Each piece moves in the axes of the link before it, in a frame that falls
freely with its hinge: there the hinge has neither place, velocity nor weight, and only the angular velocity and acceleration of
that link come in.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.linalg import blas, lapack

from vlmb.constrained import SIDEWAYS
from vlmb.coordinates import kinematics
from vlmb.cuts import PIECE, cuts, obstacle, part
from vlmb.errors import SceneError, SingularError
from vlmb.mechanism import Mechanism, build
from vlmb.springs import free_segments, rest_length

Array = NDArray[np.float64]
WORLD, LOCAL = pin.Convention.WORLD, pin.ReferenceFrame.LOCAL
SIGNS = np.array([[1.0], [-1.0]])


class _Piece:
    """One sub-chain: its model, its right sides, and live views of what it hands on to the next."""

    def __init__(self, mechanism: Mechanism, flies: bool, joined: bool) -> None:
        layout, self.model, self.data = mechanism.layout, mechanism.model, mechanism.data
        width, first = 2 if layout.plane else 3, layout.links[0]
        self.whole, self.mass, self.joined = mechanism, self.data.M, joined
        self.tip = mechanism.frames[f"{layout.links[-1].name}.tip"]
        frame = self.model.frames[self.tip]
        self.reach = float(frame.placement.translation[0])
        last = frame.parentJoint if hasattr(frame, "parentJoint") else frame.parent
        self.motion, self.drift = self.data.v[last].vector, self.data.a_gf[last].vector  # of the last link, in its axes
        self.spin, self.turning = self.motion[3:], self.drift[3:]
        self.hinge = slice(first.v, first.v + (1 if layout.plane else 3))
        # from the axes of the link before to what the hinge turns about: in a plane, -y
        self.turn = np.array([[0.0, -1.0, 0.0]]) if layout.plane else self.data.liMi[first.joint].rotation.T
        self.right = np.zeros((layout.nv, 1 + 2 * width), order="F")  # tau - h, J_b^T, -J_t^T
        self.load, self.ends = self.right[:, 0], self.right[:, 1 + width :].T
        for k in range(width if flies else 0):
            self.right[k, 1 + k] = 1.0
        self.factor, self.half = self.mass, self.right  # L; L^-1 of the right sides
        self.angular = np.zeros((3, layout.nv))  # how the last link turns

    def share(self, q: Array, v: Array, tau: Array, found: Array) -> None:
        """Take its places in the chain's buffers."""
        self.q, self.v, self.tau, self.found, self.spinning = q, v, tau, found, v[self.hinge]

    def exchange(self, gram: Array, motion: Array, drift: Array, carried: Array, turning: Array, turned: Array) -> None:
        """Take its rows of what pieces hand to each other."""
        self.gram, self.tip_motion, self.tip_drift = gram, motion, drift
        self.carried, self.tip_turning, self.turned = carried, turning, turned


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
        self.width, self.axes = 2 if layout.plane else 3, slice(0, 3, 2 if layout.plane else 1)
        self.sliding = layout.base == "ski" and reduced
        self.pieces = [_Piece(build(part(scene, a, b)), a > 0, b < len(scene.links)) for a, b in cuts(scene, size)]
        segments = list(free_segments(mechanism))
        self.slots_q = np.array([at.q for _, at in segments], dtype=np.intp)
        self.slots_v = np.array([at.v for _, at in segments], dtype=np.intp)
        self.stiffness = np.array([segment.stiffness for segment, _ in segments])
        self.damping = np.array([segment.damping for segment, _ in segments])
        self.rest = np.array([rest_length(segment) for segment, _ in segments])
        self.tau, self.vdot = np.zeros(layout.nv), np.zeros(layout.nv)
        self._prepare_band()
        self._prepare_buffers()

    def _prepare_buffers(self) -> None:
        """One buffer of each kind for all pieces, where hinges that fly keep zeros, and where the chain's entries sit in it."""
        sizes = np.array([(piece.model.nq, piece.model.nv) for piece in self.pieces])
        ends, count, turns = sizes.cumsum(axis=0), len(self.pieces), 1 if self.plane else 3
        self.q, self.v, self.forces, self.found = (np.zeros(ends[-1, k]) for k in (0, 1, 1, 1))
        for piece, (q, v), (nq, nv) in zip(self.pieces, ends, sizes, strict=True):
            at = slice(v - nv, v)
            piece.share(self.q[q - nq : q], self.v[at], self.forces[at], self.found[at])
        flying = ends[:-1, :, None] + np.arange(self.width)
        self.in_q, self.in_v = (np.delete(np.arange(ends[-1, k]), flying[:, k]) for k in (0, 1))
        hinges = (ends - sizes)[1:, 1:] + self.width
        self.hinges, self.cyclic = hinges + np.arange(turns), hinges + np.arange(5) % turns  # x y z; x y z x y
        self.reach = np.array([(piece.reach, -piece.reach) for piece in self.pieces]).T
        self.motion, self.drift = np.zeros((6, count)), np.zeros((6, count))  # of tips
        self.carried, turning, self.turned = np.zeros((count, 5)), np.zeros((count, 3)), np.zeros((count, turns))
        given = zip(self.gram, self.motion.T, self.drift.T, self.carried[:, :turns], turning, self.turned, strict=True)
        for piece, rows in zip(self.pieces, given, strict=True):
            piece.exchange(*rows)

    def _prepare_band(self) -> None:
        """Where the entries of the joint system come from: of its lower band, column after column, band[i - j, j] = a_ij.

        Each is the sum of two products of right sides, or one and a zero.
        """
        width, joints, side = self.width, len(self.pieces) - 1, 1 + 2 * self.width
        products = np.zeros(len(self.pieces) * side**2 + 1)  # the last is the zero
        self.products, self.gram = products, products[:-1].reshape(-1, side, side)
        at = np.arange(products.size - 1).reshape(self.gram.shape)
        self.first, self.second = np.full((2, joints * width, 2 * width), products.size - 1)
        for column in range(joints * width):
            joint, k = divmod(column, width)
            self.first[column, : width - k] = at[joint, 1 + width + k, 1 + width + k :]
            self.second[column, : width - k] = at[joint + 1, 1 + k, 1 + k : 1 + width]
            if joint + 1 < joints:
                self.first[column, width - k : 2 * width - k] = at[joint + 1, 1 + k, 1 + width :]
        self.weights = np.zeros((len(self.pieces), side))
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
        self.q[self.in_q], self.v[self.in_v], self.forces[self.in_v] = q, v, self.springs(q, v)
        self._evaluate()
        if len(self.pieces) > 1:
            self._join()
        return self._collect()

    def _evaluate(self) -> None:
        """Factor the mass matrix of each piece, in the axes of the link before it; multiply its right sides with each other."""
        before: _Piece | None = None
        for piece in self.pieces:
            model, data, mass, right = piece.model, piece.data, piece.mass, piece.right
            pin.crba(model, data, piece.q, WORLD)
            if before is not None:
                piece.turn.dot(before.spin, piece.carried)
                piece.spinning += piece.carried
            np.subtract(piece.tau, pin.nonLinearEffects(model, data, piece.q, piece.v), piece.load)
            if piece.joined:
                jacobian = pin.getFrameJacobian(model, data, piece.tip, LOCAL)
                np.negative(jacobian[self.axes], piece.ends)
                piece.angular = jacobian[3:]
                piece.tip_motion[...], piece.tip_drift[...] = piece.motion, piece.drift
            if before is None and self.sliding:
                mass[SIDEWAYS], mass[:, SIDEWAYS], right[SIDEWAYS] = 0.0, 0.0, 0.0
                mass[SIDEWAYS, SIDEWAYS] = 1.0
            piece.factor, info = lapack.dpotrf(mass, 1, 0, 1)  # lower, in place
            if info:
                names = [link.name for link in piece.whole.layout.links]
                raise SingularError(
                    f"the mass matrix is singular in the piece {names[0]} to {names[-1]} of the chain: a hinge there can move "
                    f"without inertia. {' '.join(self.mechanism.warnings)}".rstrip()
                )
            piece.half = half = blas.dtrsm(1.0, piece.factor, right, 0, 1)
            half.T.dot(half, piece.gram)
            before = piece

    def _join(self) -> None:
        """Solve the banded system for the forces in the cut hinges."""
        gram, width = self.gram, self.width
        band = self.products.take(self.first)
        band += self.products.take(self.second)
        right = self._tip_drift()
        right -= gram[:-1, 1 + width :, 0]
        right -= gram[1:, 1 : 1 + width, 0]
        _, forces, info = lapack.dpbsv(band.T, right.ravel(), 1, overwrite_ab=1, overwrite_b=1)
        if info:
            at = (info - 1) // width
            name = self.pieces[at].whole.layout.links[-1].name
            raise SingularError(f"the hinge at the tip of {name!r} can move without inertia; give {name!r} a tip_mass")
        forces = forces.reshape(-1, width)
        self.weights[1:, 1 : 1 + width] = forces
        self.weights[:-1, 1 + width :] = forces

    def _tip_drift(self) -> Array:
        """Accelerations of the tips at vdot = 0, less gravity, in the last links' axes: a + alpha x r + w x (v + w x r)."""
        forward, velocity, spin = self.motion[0], self.motion[1:3], self.motion[5:3:-1]
        velocity += self.reach * spin
        found = self.drift[:3].copy()
        sideways = found[1:]
        sideways += self.reach * self.drift[5:3:-1]
        sideways += SIGNS * (spin * forward - self.motion[3] * velocity[::-1])
        found[0] += spin[1] * velocity[1] - spin[0] * velocity[0]
        return found[self.axes, :-1].T

    def _collect(self) -> Array:
        """Accelerations of all pieces; a ball's, relative to the link before: wdot - R^T wdot_p + w x R^T w_p."""
        before: _Piece | None = None
        for piece, weights in zip(self.pieces, self.weights, strict=True):
            piece.half.dot(weights, piece.found)
            blas.dtrsv(piece.factor, piece.found, 1, 0, 1, 1, 0, 1)  # in place: L^-T
            if before is not None:
                piece.turn.dot(before.tip_turning, piece.turned)
            if piece.joined:
                piece.angular.dot(piece.found, piece.tip_turning)
                piece.tip_turning += piece.turning
            before = piece
        self.found[self.hinges] -= self.turned[1:]
        if not self.plane:
            spin, carried = self.v.take(self.cyclic), self.carried
            carried[:, 3:] = carried[:, :2]
            self.found[self.hinges] += spin[:, 1:4] * carried[1:, 2:] - spin[:, 2:] * carried[1:, 1:4]
        return self.found.take(self.in_v, out=self.vdot, mode="clip")

    def conditioning(self, q: Array) -> tuple[float, list[str]]:
        """Condition number of the worst piece's mass matrix, scaled to a unit diagonal, and its first and last link."""
        worst, names = 0.0, ["every coordinate"]
        self.q[self.in_q] = q
        for piece in self.pieces:
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
