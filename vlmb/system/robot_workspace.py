"""The equations of a mechanism with robots at one instant: the buffers of one run.

M vdot + h = tau + J^T lambda + B u,   J vdot = gamma,   W vdot = H z + K z' - drift

Without a programme M^-1 is Pinocchio's, and the rows J are solved for their multipliers. With one, what its rows leave free
serves its secondary rows, then the posture, q'' = w^2 (q0 - q) - 2 d w q'; what is left is the least weighted control. Lengths
that follow laws are known: q and q' of a state are overwritten by them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.core import frame_rows
from vlmb.core.bodies import COUNT, TYPE
from vlmb.core.calls import direct
from vlmb.core.readings import COORDINATE
from vlmb.errors import SimulationError, SingularError
from vlmb.model.memory import make_data
from vlmb.scene.names import DAMPERS
from vlmb.system.robot_contacts import RobotContacts
from vlmb.system.robot_forces import DRAG
from vlmb.system.robot_ski import RubbedSki, Snow
from vlmb.system.robot_solving import RobotSolving
from vlmb.system.robot_system import RobotSystem

Array = NDArray[np.float64]

rows_of_frames = direct(frame_rows.rows_of_frames)

SIDEWAYS = 1  # the ski's velocity that its knife edge forbids
HUGE = 1e100
NOTHING = np.zeros(0)


class Instant(NamedTuple):
    """One instant: accelerations and all forces."""

    vdot: Array
    tau: Array  # (nv,) forces by law and springs
    values: Array  # (forces,) as in the system's `forces`
    multipliers: Array  # (eliminated,)
    residuals: Array  # (3, rows) z, z', drift
    powers: Array  # (work,) rates of the work states [W]
    matrix: Array  # (rows + forces, nv)
    snow: Array  # (4,) normal force, roll and pitch moment, friction of a ski; nan without one


class RobotWorkspace(RobotSolving):
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
        self.multipliers = np.zeros(self.eliminated)
        behind = (0 if system.plan is None else len(system.plan.moving.laws)) + len(system.events)
        self.laws = np.zeros(system.laws + behind) if behind else self.values
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
        self.prepare()
        self.snow = Snow(self) if system.on_ski else None
        self.friction = None if self.snow is None else self.snow.friction
        self.contacts = None if system.contacts is None else RobotContacts(self, system.contacts, system.seen)
        self.slides = self.contacts is not None and bool(self.contacts.sliding)
        self.q, self.v = np.zeros(self.nq), np.zeros(self.nv)

    def _take_posture(self) -> None:
        """Note which joints the posture of a programme goes by, where to, and how."""
        system, names = self.system, self.system.mechanism.names
        posed = system.posture is not None
        entries = [e for e in names.entries if posed and e.row[0] == COORDINATE and f"T_{e.name}" in names.forces]
        joints = [self.model.joints[entry.joint] for entry in entries]
        self.posed_q = np.array([joint.idx_q for joint in joints], np.int64)
        self.posed_v = np.array([joint.idx_v for joint in joints], np.int64)
        self.posture = np.array([system.mechanism.reference[entry.name] for entry in entries])
        self.posed_weights = np.zeros(0)
        if system.posture is not None:
            weights = [system.posture.weights.get(entry.name, 1.0) for entry in entries]
            self.posed_weights = np.array(weights, float)
            frequency = system.posture.frequency
            self.posed_gains = frequency**2, 2.0 * system.posture.damping_ratio * frequency

    def _take_powers(self) -> None:
        """Note where in the work states each force stands; -1 for springs, whose work is their energy."""
        names, springs = self.system.work_names, dict(self.system.elastic)
        apart = [k in springs or force.name == DRAG for k, force in enumerate(self.system.forces)]
        slots = [-1 if own else names.index(f.name) for own, f in zip(apart, self.system.forces, strict=True)]
        self.slots = np.array(slots, np.intp)
        self.drag = [k for k, force in enumerate(self.system.forces) if force.name == DRAG]
        self.apart = len({*self.slots.tolist()} - {-1}) == len(self.slots)
        first = self.eliminated - len(self.system.mechanism.scene.constraints)
        ideal = list(enumerate(self.system.info[: self.eliminated]))[first:]
        own = {} if self.system.contacts is None else self.system.contacts.work_of()
        self.working = [(k, names.index(own.get(row.text, row.text))) for k, row in ideal if row.working]
        drives = enumerate(self.system.drives, self.system.first_drive)
        self.working += [(k, names.index(drive.force)) for k, drive in drives]
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
        nq, model = self.nq, self.model
        q, v = y[:nq], y[nq : self.end]
        if self.system.drives:
            q, v = self.driven_state(t, q, v)
        fine = rows_of_frames(*self.arguments, t, q, v, self.dy[:nq], self.out, self.matrix, self.laws)
        if not fine:
            raise self.not_finite()
        if self.laws is not self.values:
            self.values[: self.system.laws] = self.laws[: self.system.laws]
        if not self.plain:
            q = pin.normalize(model, q)
        tau, segments = self.tau, self.system.segments
        tau.fill(0.0)
        self.lost = 0.0
        if len(segments.q):
            rates = v[segments.v]
            np.add.at(tau, segments.v, -segments.stiffness * (q[segments.q] - segments.rest) - segments.damping * rates)
            self.lost = float(segments.damping.dot(rates * rates))
        self.q, self.v = q, v
        if self.slides and self.contacts is not None:
            self.beside = self.contacts.slide(t, q, v)
        return self.accelerations() if self.friction is None else self.rubbed(self.friction)

    def driven_state(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return q and v with the lengths that laws give."""
        q, v = np.array(q), np.array(v)
        for drive in self.system.drives:
            q[drive.q], v[drive.v], _ = drive.law.jet(t)
        return q, v

    def accelerations(self) -> Array:
        """Return vdot of what was written last; the array may be written again by the next call."""
        q, v, model, data = self.q, self.v, self.model, self.data
        if self.count:
            back = self.back(q, v) if len(self.posed_q) else NOTHING
            return self.controlled(pin.crba(model, data, q), pin.nonLinearEffects(model, data, q, v), back)
        tau = self.tau + self.values.dot(self.columns) if self.first_control else self.tau
        if self.free:
            answer: Array = pin.aba(model, data, q, v, tau)
            return answer
        bias = pin.nonLinearEffects(model, data, q, v)
        return self.held(pin.computeMinverse(model, data, q), tau - bias)

    def rubbed(self, friction: RubbedSki) -> Array:
        """Return vdot with the friction under the ski, from two answers without it."""
        own, edge = self.tau.copy(), self.system.knife_edge

        def answer(force: float) -> tuple[float, float, float]:
            assert self.snow is not None
            self.tau[:] = own
            self.tau[0] += force
            vdot = self.accelerations()
            along, across = float(vdot[0]), float(self.multipliers[edge]) if friction.carves else 0.0
            return float(self.snow.bears(self.q, self.v, vdot)[0]), across, along

        friction.solve(float(self.v[0]), answer)
        self.tau[:] = own
        self.tau[0] += friction.force
        vdot = self.accelerations()
        if friction.stands:
            vdot[0] = 0.0
        self.lost -= friction.force * float(self.v[0])
        return vdot

    def back(self, q: Array, v: Array) -> Array:
        """Return the accelerations of joints that lead back to the posture."""
        stiffness, damping = self.posed_gains
        found: Array = stiffness * (self.posture - q[self.posed_q]) - damping * v[self.posed_v]
        return found

    def not_finite(self) -> Exception:
        """Make the error of rows or forces without a finite value."""
        sizes = np.abs(self.out).sum(axis=0) + np.abs(self.matrix[: self.rows]).sum(axis=1)
        names = [row.text for row in self.system.info]
        bad = list(dict.fromkeys(repr(names[k]) for k in np.flatnonzero(~np.isfinite(sizes))))
        for k, value in enumerate(self.laws[: len(self.system.compiled.rows)].tolist()):
            if math.isfinite(value):
                continue
            at = k - len(self.laws) + len(self.system.events)
            if k >= self.system.laws and at >= 0:
                bad.append(repr(self.system.events[at].name))
                continue
            if k >= self.system.laws and self.system.plan is not None:
                return self.system.plan.moving.failure(k - self.system.laws, value)
            bad.append(repr(self.system.forces[k].name))
        what = " and ".join(bad[:4]) or "an equation"
        return SimulationError(f"{what} has no finite value here: at a pole, or outside a domain")

    def powers(self, y: Array) -> None:
        """Write the rates of the work states of the last solution into `dy`."""
        v, work = self.v, self.dy[self.end :]
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
        for k in self.drag:
            lost -= float(self.values[k]) * float(rates[k])
        if self.slides and self.contacts is not None:
            self.contacts.add_powers(self.multipliers, work)
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
        vdot = np.array(dy[self.nq : self.end])
        if self.count:
            self.effects()
        snow = np.full(4, np.nan)
        if self.snow is not None:
            snow[:3] = self.snow.bears(self.q, self.v, vdot)
            snow[3] = 0.0 if self.friction is None else self.friction.force
        return Instant(
            vdot, self.tau.copy(), self.values.copy(), np.array(self.multipliers), self.out.copy(), np.array(dy[self.end :]),
            self.matrix.copy(), snow,
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
