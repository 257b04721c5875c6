"""The equations of a mechanism with robots at one instant: the buffers of one run.

M vdot + h = tau + J^T lambda + B u,   J vdot = gamma,   W vdot = H z + K z' - drift

Without a programme M^-1 is Pinocchio's, and the rows J are solved for their multipliers. With one, what its rows leave free
serves its secondary rows, then the posture, q'' = w^2 (q0 - q) - 2 d w q'; what is left is the least weighted control.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.linalg import lapack

from vlmb.core import driven, frame_rows
from vlmb.core.bodies import AT_V, COUNT, TYPE
from vlmb.core.calls import direct
from vlmb.core.driven import CHOICES, DEMANDS, LOADS, REPEATING, SHARED, Driven, make_driven
from vlmb.core.readings import COORDINATE, LENGTH
from vlmb.errors import SimulationError, SingularError
from vlmb.model.memory import make_data
from vlmb.scene.names import DAMPERS, listed
from vlmb.system.programme import RANK, ProgrammeControl, out_of_reach
from vlmb.system.robot_system import RobotSystem

Array = NDArray[np.float64]

rows_of_frames, drive = direct(frame_rows.rows_of_frames), direct(driven.drive)

SIDEWAYS = 1  # the ski's velocity that its knife edge forbids
REPEATED = 1e-12  # of a Cholesky pivot squared over the diagonal: a row that others repeat
LOOSE = 1e-8  # relative size below which a direction of joints counts as out of reach of the controls
HUGE = 1e100
NOTHING = np.zeros(0)
NONE_BESIDE = (np.zeros((0, 0)), np.zeros(0, np.int64))


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
        self.multipliers = np.zeros(self.eliminated)
        self.gains, self.second = system.gains, rows - system.eliminated - system.servo
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
        if self.count:
            self.room = self._driven()

    def _driven(self) -> Driven:
        """Say which controls act in a velocity of their own, and make the room to solve in."""
        kinds, joints, own = self.system.readings.kind, self.bodies.joint, dict[int, int]()
        for slot, at in enumerate(self.system.along[self.first_control :].tolist()):
            kind, first, component, second = kinds[at].tolist()
            if kind == COORDINATE or (kind == LENGTH and min(first, second) <= 0):
                joint = first if kind == COORDINATE else max(first, second)
                own.setdefault(int(joints[joint, AT_V]) + component * (kind == COORDINATE), slot)
        others = [slot for slot in range(self.count) if slot not in own.values()]
        return make_driven(
            self.nv, self.rows, self.eliminated, np.array([*own], np.int64), np.array([*own.values(), *others], np.int64),
            len(others), self.posed_v, 1.0 / self.posed_weights,
        )  # fmt: skip

    def _take_posture(self) -> None:
        """Note which joints the posture of a programme goes by, where to, and how."""
        system, names = self.system, self.system.mechanism.names
        entries = [e for e in names.entries if e.row[0] == COORDINATE and f"T_{e.name}" in names.forces]
        joints = [self.model.joints[entry.joint] for entry in entries]
        self.posed_q = np.array([joint.idx_q for joint in joints], np.int64)
        self.posed_v = np.array([joint.idx_v for joint in joints], np.int64)
        self.posture = np.array([system.mechanism.reference[entry.name] for entry in entries])
        if system.posture is not None:
            weights = [system.posture.weights.get(entry.name, 1.0) for entry in entries]
            self.posed_weights = np.array(weights, float)
            frequency = system.posture.frequency
            self.posed_gains = frequency**2, 2.0 * system.posture.damping_ratio * frequency

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
        tau, segments = self.tau, self.system.segments
        tau.fill(0.0)
        self.lost = 0.0
        if len(segments.q):
            rates = v[segments.v]
            np.add.at(tau, segments.v, -segments.stiffness * (q[segments.q] - segments.rest) - segments.damping * rates)
            self.lost = float(segments.damping.dot(rates * rates))
        self.q = q
        if self.count:
            back = self.back(q, v) if len(self.posed_q) else NOTHING
            return self.controlled(pin.crba(model, data, q), pin.nonLinearEffects(model, data, q, v), back)
        if self.first_control:
            tau += self.values.dot(self.columns)
        if self.free:
            answer: Array = pin.aba(model, data, q, v, tau)
            return answer
        bias = pin.nonLinearEffects(model, data, q, v)
        return self.held(pin.computeMinverse(model, data, q), tau - bias)

    def held(self, inverse: Array, b: Array) -> Array:
        """Return vdot under held rows alone, from M^-1 and the forces b (nv,)."""
        jacobian = self.matrix[: self.eliminated]
        answers, a = jacobian.dot(inverse), inverse.dot(b)
        right = self.wanted() - jacobian.dot(a)
        self.multipliers = self.schur(answers.dot(jacobian.T), right[:, None])[:, 0]
        a += self.multipliers.dot(answers)
        return a

    def controlled(self, mass: Array, bias: Array, back: Array) -> Array:
        """Return vdot under all rows, those of the programme by its controls: see `vlmb.core.driven`."""
        given = (
            *self.room, mass, bias, self.tau, self.matrix, self.values, self.scales, self.gains, self.out, self.first_control,
            *NONE_BESIDE, back, self.multipliers,
        )  # fmt: skip
        code = REPEATING if self.second else drive(*given, 0)
        if code == REPEATING:
            drive(*given, 1)
            self._make_independent()
            code = drive(*given, 2)
        if code == SHARED:
            self._least_multipliers()
        return self.room.moved[1]

    def wanted(self) -> Array:
        """Return what W vdot shall be (rows,)."""
        found: Array = self.gains.dot(self.out.ravel())
        return found

    def _make_independent(self) -> None:
        """Put rows that do not repeat each other in the place of C and d. Raises SingularError where rows contradict."""
        room, first = self.room, self.rows - self.second
        table = room.demands[: int(room.counts[DEMANDS])]
        rows = independent(np.delete(table, slice(first, self.rows), axis=0))
        if rows is None:
            raise self._contradiction(table)
        if self.second:  # as near as the others let them, in their own units
            basis, x = rows[:, :-1], rows[:, -1]
            second = self.matrix[first : self.rows][:, np.concatenate([room.rest, room.posed])]
            seen = second.dot(basis.T)
            left, asked = second - seen.dot(basis), self.wanted()[first:] - seen.dot(x)
            turn, sizes, ways = np.linalg.svd(left, full_matrices=False)
            kept = sizes > LOOSE * max(1.0, float(np.abs(second).max()))
            rows = np.vstack([rows, np.column_stack([ways[kept], turn.T.dot(asked)[kept] / sizes[kept]])])
        room.demands[: len(rows)], room.counts[DEMANDS] = rows, len(rows)

    def _contradiction(self, table: Array) -> Exception:
        """Make the error of rows that cannot hold together: held ones among themselves, or some that no control reaches."""
        if not np.isfinite(table).all():
            return SingularError("the ideal constraints, welds or edges have no finite values here")
        held, names = table[: self.eliminated], [row.text for row in self.system.info]
        if len(held) and independent(held) is None:
            error = np.abs(held[:, :-1] @ np.linalg.lstsq(held[:, :-1], held[:, -1], rcond=RANK)[0] - held[:, -1])
            worst = list(dict.fromkeys(repr(names[k]) for k in np.flatnonzero(error > 0.1 * error.max())))
            return SingularError(f"{', '.join(worst)} contradict each other here: drop one of them")
        assert self.system.plan is not None
        return out_of_reach(self.system.plan, *self.effects())

    def _least_multipliers(self) -> None:
        """Take the least of the multipliers that make the same motion by the same controls."""
        room, e = self.room, self.eliminated
        count, rank = int(room.counts[CHOICES]), int(room.counts[LOADS])
        order, loads = room.order[1, :count], room.loads[:rank, :count]
        free = np.vstack([-np.linalg.solve(loads[:, :rank], loads[:, rank:]), np.eye(count - rank)])
        ways = free.T.dot(room.choices[order, :e])
        self.multipliers -= ways.T.dot(np.linalg.lstsq(ways.T, self.multipliers, rcond=LOOSE)[0])

    def effects(self) -> tuple[Array, Array]:
        """Return G (r, S) of the programme's rows by the controls over their scales, and what they lack without any (r,).

        Of the last evaluation; all held rows in. Leaves what every control moves in `pulled`.
        """
        assert self.programme is not None
        e, servo = self.eliminated, slice(self.eliminated, self.eliminated + self.system.servo)
        inverse = pin.computeMinverse(self.model, self.data, self.q)
        controls, wanted = self.columns[self.first_control :] * self.scales[:, None], self.wanted()
        pulled, a = controls.dot(inverse), inverse.dot(self.room.moved[0])
        if e:
            jacobian = self.matrix[:e]
            answers = jacobian.dot(inverse)
            right = np.column_stack([wanted[:e] - jacobian.dot(a), -answers.dot(controls.T)])
            solved = self.schur(answers.dot(jacobian.T), right)
            pulled, a = pulled + solved[:, 1:].T.dot(answers), a + solved[:, 0].dot(answers)
        self.pulled, rows = pulled, self.matrix[servo]
        self.programme.control_matrix = rows.dot(pulled.T)
        self.programme.repeating = self.programme.rank(self.programme.control_matrix)[0] < self.system.servo
        return self.programme.control_matrix, wanted[servo] - rows.dot(a)

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
        dy = self.rhs(t, y)
        if self.count:
            self.effects()
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


def independent(table: Array) -> Array | None:
    """Return rows (C, d) that ask the same of x as those of a table and do not repeat each other; None where they contradict."""
    if not np.isfinite(table).all():
        return None
    turn, sizes, ways = np.linalg.svd(table[:, :-1], full_matrices=False)
    kept = sizes > RANK * sizes.max(initial=0.0)
    x = turn[:, kept].T.dot(table[:, -1])
    error = np.abs(turn[:, kept].dot(x) - table[:, -1]).max(initial=0.0)
    if not error <= 1e-6 * max(1.0, float(np.abs(table[:, -1]).max(initial=0.0))):
        return None
    return np.column_stack([ways[kept], x / sizes[kept]])
