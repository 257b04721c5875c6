"""The equations of a mechanism with robots at one instant: the buffers of one run.

M vdot + h = tau + J^T lambda + B u,   J vdot = gamma,   W vdot = H z + K z' - drift

M^-1 is Pinocchio's. With a = M^-1 (tau - h) and the rows J out of the way, vdot = a1 + N u and G = W N. What the rows of a
programme leave free serves its secondary rows, then the posture, q'' = w^2 (q0 - q) - 2 d w q'; what is left is the least
weighted control.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.linalg import lapack

from vlmb.core import frame_rows
from vlmb.core.bodies import AT_V, COUNT, TYPE
from vlmb.core.calls import direct
from vlmb.core.readings import COMPONENT, COORDINATE, FIRST, KIND
from vlmb.errors import SimulationError, SingularError
from vlmb.model.memory import make_data
from vlmb.scene.names import DAMPERS, listed
from vlmb.system.programme import RANK, ProgrammeControl
from vlmb.system.robot_posture import JointSpace
from vlmb.system.robot_system import RobotSystem

Array = NDArray[np.float64]

rows_of_frames = direct(frame_rows.rows_of_frames)

SIDEWAYS = 1  # the ski's velocity that its knife edge forbids
REPEATED = 1e-12  # of a Cholesky pivot squared over the diagonal: a row that others repeat
LOOSE = 1e-8  # relative size below which a direction of joints counts as out of reach of the controls
HUGE = 1e100
MOST = 300  # velocities of what is solved in the accelerations of its joints


class Instant(NamedTuple):
    """One instant: accelerations and all forces."""

    vdot: Array
    tau: Array  # (nv,) forces by law and springs
    values: Array  # (forces,) as in the system's `forces`
    multipliers: Array  # (eliminated,)
    residuals: Array  # (3, rows) z, z', drift
    powers: Array  # (work,) rates of the work states [W]
    matrix: Array  # (rows + forces, nv)


class RobotWorkspace:
    """The buffers of one run. One thread at a time."""

    def __init__(self, system: RobotSystem) -> None:
        mechanism = system.mechanism
        self.system, self.model = system, mechanism.model
        self.data = make_data(self.model)
        self.nq, self.nv, self.size = int(self.model.nq), int(self.model.nv), system.size
        self.end = self.nq + self.nv
        rows, forces = len(system.info), len(system.forces)
        self.rows, self.free = rows, bool(rows == 0)
        self.bodies = mechanism.table.bodies()
        self.readings = system.readings._replace(reference=np.zeros((len(system.readings.kind), 2)))
        self.buffers = system.packed.reals.copy()
        self.out, self.matrix = np.zeros((3, rows)), np.zeros((rows + forces, self.nv))
        self.values = np.zeros(forces)
        self.eliminated, self.count = system.eliminated, 0 if system.plan is None else len(system.plan.names)
        self.first_control = forces - self.count
        self.columns = self.matrix[rows:]
        self.sideways = SIDEWAYS if system.on_ski else -1
        self.crossed = system.on_ski and system.run.knife_edge == "reduction"
        self.joints = mechanism.table.joints
        self.plain = all(kind in (0, 1) for kind in self.bodies.joint[1 : self.joints, TYPE].tolist()) and bool(
            (self.bodies.joint[1 : self.joints, COUNT] == 1).all()
        )
        self.scales = np.zeros(0) if system.plan is None else system.plan.scales
        self.programme = None if system.plan is None else ProgrammeControl(system.plan)
        self.multipliers, self.diagonal = np.zeros(self.eliminated), np.zeros(self.eliminated)
        self.repeating = False
        self.pulled = np.zeros((0, self.nv))  # accelerations by each control in its scale, at the last solution
        self.evaluations = 0
        self.lost = 0.0
        self.dy = np.zeros(self.size)
        self.tau = np.zeros(self.nv)
        self.arguments = (
            system.packed.integers, self.buffers, *self.bodies, *self.readings, system.welds, system.edges, system.along,
            self.joints, self.sideways,
        )  # fmt: skip
        self._take_posture()
        self._take_powers()
        self.joint_space = self._joint_space()
        self.looking = False  # at one instant, with the effect of every control

    def _joint_space(self) -> JointSpace | None:
        """Return the accelerations of the joints where these alone say what the controls do."""
        system, kinds = self.system, self.system.readings.kind
        along = system.along[self.first_control :]
        own = all(kinds[at, KIND] == COORDINATE for at in along.tolist())
        if not self.count or self.settled or self.nv > MOST or len(system.info) > self.eliminated + system.servo or not own:
            return None
        joints = self.bodies.joint
        return JointSpace(self, np.array([joints[kinds[at, FIRST], AT_V] + kinds[at, COMPONENT] for at in along], np.intp))

    def _take_posture(self) -> None:
        """Note which joints the posture of a programme goes by, where to, and how."""
        system, names = self.system, self.system.mechanism.names
        entries = [e for e in names.entries if e.row[0] == COORDINATE and f"T_{e.name}" in names.forces]
        joints = [self.model.joints[entry.joint] for entry in entries]
        self.posed_q = np.array([joint.idx_q for joint in joints], np.intp)
        self.posed_v = np.array([joint.idx_v for joint in joints], np.intp)
        self.posture = np.array([system.mechanism.reference[entry.name] for entry in entries])
        if system.posture is not None:
            weights = [system.posture.weights.get(entry.name, 1.0) for entry in entries]
            self.posed_weights = np.sqrt(np.array(weights))
            frequency = system.posture.frequency
            self.posed_gains = frequency**2, 2.0 * system.posture.damping_ratio * frequency
        self.settled = system.posture is None or not entries

    def _take_powers(self) -> None:
        """Note where in the work states each force stands; -1 for springs, whose work is their energy."""
        names, springs = self.system.work_names, dict(self.system.elastic)
        self.slots = np.array([-1 if k in springs else names.index(f.name) for k, f in enumerate(self.system.forces)], np.intp)
        self.apart = len({*self.slots.tolist()} - {-1}) == len(self.slots)
        first = self.eliminated - len(self.system.mechanism.scene.constraints)
        ideal = list(enumerate(self.system.info[: self.eliminated]))[first:]
        self.working = [(k, names.index(row.text)) for k, row in ideal if row.working]
        self.damped = DAMPERS in names

    @property
    def reference(self) -> Array:
        """Angles near which quantities are read (count, 2), to write into."""
        return self.readings.reference

    def start_posture(self, q: Array) -> None:
        """Take the joints of a configuration as the posture that a programme comes back to."""
        self.posture = np.array(q[self.posed_q])

    def rhs(self, t: float, y: Array) -> Array:
        """Return y' at (t, y); the array is written again by the next call. Raises SingularError, SimulationError."""
        nq, end, dy = self.nq, self.end, self.dy
        self.evaluations += 1
        vdot = self.solve(t, y)
        dy[nq:end] = vdot
        if self.crossed:
            dy[nq + SIDEWAYS] = 0.0
        if self.size > end:
            self.powers(y)
        if not -HUGE < float(vdot.sum()) < HUGE:
            raise SingularError(
                "the mass matrix is singular here, or a force is not finite: some motion has no inertia; a link of a robot "
                "without mass at the end of a chain, or a hinge without mass between free segments"
            )
        return dy

    def solve(self, t: float, y: Array) -> Array:
        """Return vdot; leaves forces and multipliers of this instant, and q' in `dy`."""
        nq, model, data = self.nq, self.model, self.data
        q, v = y[:nq], y[nq : self.end]
        fine = rows_of_frames(*self.arguments, t, q, v, self.dy[:nq], self.out, self.matrix, self.values)
        if not fine:
            raise self.not_finite()
        if not self.plain:
            q = pin.normalize(model, q)
        tau = self.tau
        if self.first_control:
            np.dot(self.values[: self.first_control], self.columns[: self.first_control], tau)
        else:
            tau.fill(0.0)
        segments = self.system.segments
        self.lost = 0.0
        if len(segments.q):
            rates = v[segments.v]
            np.add.at(tau, segments.v, -segments.stiffness * (q[segments.q] - segments.rest) - segments.damping * rates)
            self.lost = float(segments.damping.dot(rates * rates))
        if self.free:
            answer: Array = pin.aba(model, data, q, v, tau)
            return answer
        b = tau - pin.nonLinearEffects(model, data, q, v)
        if self.joint_space is not None and not self.looking:
            wanted = self.system.gains.dot(self.out.ravel())
            mass = pin.crba(model, data, q)
            found = self.joint_space.solve(mass, b, self.matrix[: self.rows], wanted, self.back(q, v))
            if found is not None:
                return found
        inverse = pin.computeMinverse(model, data, q)
        return self.constrained(t, q, v, inverse, inverse.dot(b))

    def constrained(self, t: float, q: Array, v: Array, inverse: Array, a: Array) -> Array:
        """Return vdot under all rows, from M^-1 and the accelerations a (nv,) without them."""
        e, rows = self.eliminated, self.matrix[: self.rows]
        wanted = self.system.gains.dot(self.out.ravel())
        controls = self.columns[self.first_control :] * self.scales[:, None]
        pulled = controls.dot(inverse) if self.count else None  # (S, nv)
        if e:
            jacobian = rows[:e]
            answers = jacobian.dot(inverse)  # (e, nv)
            right = wanted[:e] - jacobian.dot(a)
            if pulled is not None:
                solved = self.schur(answers.dot(jacobian.T), np.column_stack([right, -answers.dot(controls.T)]))
                multipliers, given = solved[:, 0], solved[:, 1:]
                pulled = pulled + given.T.dot(answers)
            else:
                multipliers = self.schur(answers.dot(jacobian.T), right[:, None])[:, 0]
            a = a + multipliers.dot(answers)
        if pulled is not None:
            u = self.controls(q, v, rows[e:], wanted[e:], pulled, a)
            self.values[self.first_control :] = u * self.scales
            a = a + u.dot(pulled)
            if e:
                multipliers = multipliers + given.dot(u)
        if e:
            self.multipliers = multipliers
        return a

    def controls(self, q: Array, v: Array, w: Array, wanted: Array, pulled: Array, a: Array) -> Array:
        """Return the controls over their scales (S,): for the programme, then secondary rows, then the posture."""
        assert self.programme is not None
        servo, self.pulled = self.system.servo, pulled
        g, beta = w.dot(pulled.T), wanted - w.dot(a)
        self.programme.control_matrix = g[:servo]
        u = self.programme.least(g[:servo], beta[:servo])
        free = null_space(g[:servo])
        if len(w) > servo and free.shape[1]:
            there = g[servo:].dot(free)
            u = u + free.dot(least(there, beta[servo:] - g[servo:].dot(u)))
            free = free.dot(null_space(there))
        if self.settled or not free.shape[1]:
            return u
        back = self.back(q, v) - a[self.posed_v]
        reach = pulled[:, self.posed_v].T * self.posed_weights[:, None]
        return u + free.dot(least(reach.dot(free), self.posed_weights * back - reach.dot(u)))

    def back(self, q: Array, v: Array) -> Array:
        """Return the accelerations of joints that lead back to the posture."""
        stiffness, damping = self.posed_gains
        found: Array = stiffness * (self.posture - q[self.posed_q]) - damping * v[self.posed_v]
        return found

    def unreached(self) -> list[str]:
        """Say which joints a posture does not reach, and which controls only load what is held, at the last look."""
        system, told = self.system, list[str]()
        if system.plan is None:
            return told
        controlled = {force.name for force in system.forces[self.first_control :]}
        passive = [f.along for f in system.mechanism.names.forces.values() if f.joint and f.name not in controlled]
        if passive:
            told.append(f"posture: {listed(passive)} have no control and move as the others let them")
        sizes = np.linalg.svd(self.pulled, compute_uv=False)
        idle = self.count - int((sizes > LOOSE * sizes.max(initial=0.0)).sum()) if len(sizes) else 0
        if idle:
            told.append(
                f"programme: {self.count} controls move {self.count - idle} rates: {idle} combinations only load what is welded, "
                "and the motion does not determine them: the least weighted control is taken"
            )
        return told

    def schur(self, matrix: Array, right: Array) -> Array:
        """Solve (J M^-1 J^T) x = right; the least x where rows repeat each other. Raises SingularError where they contradict."""
        factor, answer, info = lapack.dposv(matrix, right)
        pivots, own = factor.diagonal(), matrix.diagonal()
        if not info and bool((pivots * pivots > REPEATED * own).all()):
            return answer
        if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
            raise SingularError("the ideal constraints, welds or edges have no finite values here")
        self.repeating = True
        scale = np.sqrt(np.maximum(own, 1e-300))
        answer = np.linalg.lstsq(matrix / np.outer(scale, scale), right / scale[:, None], rcond=1e-10)[0] / scale[:, None]
        error = np.abs(matrix @ answer - right)
        if not error.max() <= 1e-6 * max(1.0, np.abs(right).max()):
            names = [row.text for row in self.system.info]
            worst = list(dict.fromkeys(repr(names[k]) for k in np.flatnonzero(error.max(axis=1) > 0.1 * error.max())))
            raise SingularError(f"{', '.join(worst)} contradict each other here: drop one of them")
        return np.asarray(answer, dtype=np.float64)

    def not_finite(self) -> Exception:
        """Make the error of rows or forces without a finite value."""
        sizes = np.abs(self.out).sum(axis=0) + np.abs(self.matrix[: self.rows]).sum(axis=1)
        names = [row.text for row in self.system.info]
        bad = list(dict.fromkeys(repr(names[k]) for k in np.flatnonzero(~np.isfinite(sizes))))
        bad += [repr(f.name) for f, value in zip(self.system.forces, self.values, strict=True) if not math.isfinite(value)]
        what = " and ".join(bad[:4]) or "an equation"
        return SimulationError(f"{what} has no finite value here: at a pole, or outside a domain")

    def powers(self, y: Array) -> None:
        """Write the rates of the work states of the last solution into `dy`."""
        v, work = y[self.nq : self.end], self.dy[self.end :]
        work.fill(0.0)
        rates = self.columns.dot(v)
        lost = self.lost
        if self.apart:
            work[self.slots] = self.values * rates
        else:
            np.add.at(work, self.slots[self.slots >= 0], (self.values * rates)[self.slots >= 0])
        for k, spring in self.system.elastic:
            length = self.spring_length(spring.quantity)
            taut = length > spring.rest or not spring.rope
            lost -= (float(self.values[k]) + spring.stiffness * (length - spring.rest) * taut) * float(rates[k])
        for k, slot in self.working:
            work[slot] += self.multipliers[k] * float(self.matrix[k].dot(v))
        if self.damped:
            work[-1] = lost

    def spring_length(self, quantity: int) -> float:
        """Return the length [m] of a spring at the last evaluation."""
        _, first, _, second = self.readings.kind[quantity].tolist()
        ends = []
        for frame in (first, second):
            body, place = self.bodies.state[self.readings.frame[frame]], self.readings.place[frame]
            ends.append(body[:9].reshape(3, 3) @ place[9:] + body[9:12])
        return float(np.linalg.norm(ends[1] - ends[0]))

    def evaluate(self, t: float, y: Array, inputs: Sequence[float] | Array | None = None) -> Instant:
        """Return accelerations and forces of one instant; `inputs` are the forces from outside."""
        if inputs is not None:
            self.take_inputs(inputs)
        self.looking = True
        try:
            dy = self.rhs(t, y)
        finally:
            self.looking = False
        return Instant(
            np.array(dy[self.nq : self.end]), self.tau.copy(), self.values.copy(), np.array(self.multipliers), self.out.copy(),
            np.array(dy[self.end :]), self.matrix.copy(),
        )  # fmt: skip

    def take_inputs(self, inputs: Sequence[float] | Array) -> None:
        """Take forces from outside, by the names of the system."""
        self.values[self.system.laws : self.first_control] = inputs

    def energies(self, q: Array, v: Array) -> tuple[float, float, float]:
        """Return kinetic energy, gravity's and that of springs [J]."""
        segments = self.system.segments
        spring = 0.5 * float(segments.stiffness.dot((q[segments.q] - segments.rest) ** 2)) if len(segments.q) else 0.0
        if self.system.elastic:
            from vlmb.core.bodies import move

            move(self.bodies, q, v)
            for _, entry in self.system.elastic:
                stretch = self.spring_length(entry.quantity) - entry.rest
                spring += 0.5 * entry.stiffness * (max(stretch, 0.0) if entry.rope else stretch) ** 2
        kinetic = float(pin.computeKineticEnergy(self.model, self.data, q, v))
        return kinetic, float(pin.computePotentialEnergy(self.model, self.data, q)), spring


def least(matrix: Array, right: Array) -> Array:
    """Return the least x among those that come nearest to matrix x = right."""
    rows, columns = matrix.shape
    room = np.zeros(max(rows, columns))
    room[:rows] = right
    _, answer, _, _, _ = lapack.dgelsy(matrix, room, np.zeros(columns, np.int32), LOOSE, 4 * (rows + columns) + 128)
    return np.asarray(answer[:columns], dtype=np.float64)


def null_space(g: Array) -> Array:
    """Return an orthonormal basis (S, any) of what G (r, S) does not see."""
    rows, columns = g.shape
    if not rows:
        return np.eye(columns)
    factor, _, tau, _, _ = lapack.dgeqp3(g.T)
    sizes = np.abs(factor.diagonal())
    rank = int((sizes > RANK * max(float(sizes[0]), 1e-300)).sum())
    whole = np.zeros((columns, columns))
    whole[:, : min(rows, columns)] = factor[:, : min(rows, columns)]
    basis, _, _ = lapack.dorgqr(whole, tau, lwork=64 * columns)
    return np.asarray(basis[:, rank:], dtype=np.float64)
