"""Accelerations of robots under their rows and by a programme's controls.

Without a programme M^-1 is Pinocchio's, and the rows J are solved for their multipliers. With one see `vlmb.core.driven`: what
its rows leave free serves its secondary rows, then the posture; what is left is the least weighted control.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import scipy
from numpy.typing import NDArray

from vlmb.core import driven
from vlmb.core.bodies import AT_V, Bodies
from vlmb.core.calls import direct
from vlmb.core.driven import CHOICES, DEMANDS, LOADS, REPEATING, SHARED, Driven, make_driven
from vlmb.core.readings import COORDINATE, LENGTH
from vlmb.errors import SingularError
from vlmb.scene.names import listed
from vlmb.system.core_rows import moving_places
from vlmb.system.programme import RANK, ProgrammeControl, cross, out_of_reach
from vlmb.system.robot_system import RobotSystem

Array = NDArray[np.float64]

drive = direct(driven.drive)

REPEATED = 1e-12  # of a Cholesky pivot squared over the diagonal: a row that others repeat
NO_VALUES = "the ideal constraints, welds or edges have no finite values here"
BEYOND = 1e8  # controls over their scales, together, of which it is asked whether they reach what they are for
ROUNDED = 1e-11  # of what controls move in all joints: what is left of it in a row by rounding
LOOSE = 1e-8  # relative size below which a direction of joints counts as out of reach of the controls


class RobotSolving:
    """What of a run's buffers solves; the rows, forces and laws of an instant are written before."""

    system: RobotSystem
    model: Any
    data: Any
    bodies: Bodies
    nv: int
    rows: int
    eliminated: int
    count: int  # of controls
    first_control: int
    matrix: Array  # (rows + forces, nv)
    columns: Array  # its forces
    out: Array  # (3, rows) z, z', drift
    tau: Array  # (nv,) forces beside those of `columns`
    values: Array  # (forces,)
    multipliers: Array
    laws: Array  # values of all laws: forces, then what of a programme the motion gives
    posed_v: NDArray[np.int64]
    posed_weights: Array
    q: Array  # of the last evaluation

    def prepare(self) -> None:
        """Make what a programme needs."""
        system = self.system
        self.programme = None if system.plan is None else ProgrammeControl(system.plan)
        self.scales = np.zeros(0) if system.plan is None else system.plan.scales.copy()
        self.gains, self.second = system.gains, self.rows - self.eliminated - system.servo
        self.pulled = np.zeros((0, self.nv))  # accelerations by each control in its scale, at the last look
        self.beside: tuple[Array, NDArray[np.int64]] = (np.zeros((0, self.nv)), np.zeros(0, np.int64))  # what sliding pushes on
        self.moving = [] if system.plan is None else moving_places(system.info, system.plan, self.eliminated)
        if self.moving:
            self.gains = system.gains.copy()
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

    def held(self, inverse: Array, b: Array) -> Array:
        """Return vdot under held rows alone, from M^-1 and the forces b (nv,)."""
        jacobian, a = self.matrix[: self.eliminated], inverse.dot(b)
        answers = self.pushes().dot(inverse)
        self.multipliers = self.schur(jacobian.dot(answers.T), (self.wanted() - jacobian.dot(a))[:, None])[:, 0]
        a += self.multipliers.dot(answers)
        return a

    def pushes(self) -> Array:
        """Return what the multipliers of held rows push on (held, nv): the rows themselves, and friction of those that slide."""
        beside, rows = self.beside
        if not len(rows):
            return self.matrix[: self.eliminated]
        found = self.matrix[: self.eliminated].copy()
        np.add.at(found, rows, beside)
        return found

    def controlled(self, mass: Array, bias: Array, back: Array) -> Array:
        """Return vdot (written again by the next call) under all rows, those of the programme by its controls."""
        if self.moving:
            self._take_gains()
        free = self.system.plan is not None and self.system.plan.moving.free is not None
        extra = self._free_controls() if free else None
        given = (
            *self.room, mass, bias, self.tau, self.matrix, self.values, self.scales, self.gains, self.out, self.first_control,
            *self.beside, back, self.multipliers,
        )  # fmt: skip
        code = REPEATING if self.second else drive(*given, 0)
        if code == REPEATING:
            drive(*given, 1)
            self._make_independent()
            code = drive(*given, 2)
        if code == SHARED:
            self._least_multipliers()
        if not np.abs(self.values[self.first_control :]).dot(1.0 / self.scales) < BEYOND:
            self._require_reach()
        if extra is not None:
            self.values[self.first_control :] += extra
        return self.room.moved[1]

    def _require_reach(self) -> None:
        """Raise SingularError where controls beyond all measure hide that none of them reaches some row."""
        assert self.system.plan is not None
        g, lacks = self.effects()
        rows = self.matrix[self.eliminated : self.eliminated + len(g)]
        nothing = ROUNDED * float(np.abs(rows).dot(np.abs(self.pulled).T).max(initial=0.0))
        if len(g) and not np.linalg.svd(g, compute_uv=False)[-1] > nothing:
            raise out_of_reach(self.system.plan, np.where(np.abs(g) < nothing, 0.0, g), lacks)

    def _take_gains(self) -> None:
        """Take the gains and weights that the motion gives here. Raises SimulationError for a weight that is not above 0."""
        plan = self.system.plan
        assert plan is not None
        behind, first = self.laws[self.system.laws :], plan.moving.first_entry
        for which, (row, column) in enumerate(self.moving, first):
            if row >= 0:
                self.gains[row, column] = behind[which]
            elif not behind[which] > 0.0:
                raise plan.moving.failure(which, float(behind[which]))
            else:
                self.scales[column] = behind[which] ** -0.5

    def _free_controls(self) -> Array:
        """Return u0 u_tau of (5.6), which the rows do not see; its force is among the others from here on."""
        plan = self.system.plan
        assert plan is not None
        g, _ = self.effects()
        behind = self.laws[self.system.laws :][: len(plan.moving.laws)]
        border = behind[len(behind) - sum(map(len, plan.moving.border)) :].reshape(-1, self.count) * self.scales
        extra: Array = self.scales * (behind[0] / self.scales.prod() * cross(np.vstack([g, border])))
        self.tau += extra.dot(self.columns[self.first_control :])
        return extra

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
            return SingularError(NO_VALUES)
        held = table[: self.eliminated]
        if len(held) and independent(held) is None:
            nearest = np.linalg.lstsq(held[:, :-1], held[:, -1], rcond=RANK)[0]
            return self._contradicting(np.abs(held[:, :-1] @ nearest - held[:, -1]))
        assert self.system.plan is not None
        return out_of_reach(self.system.plan, *self.effects())

    def _contradicting(self, error: Array) -> SingularError:
        """Make the error of held rows that contradict, by what each is off (held,)."""
        names = [row.text for row in self.system.info]
        worst = list(dict.fromkeys(repr(names[k]) for k in np.flatnonzero(error > 0.1 * error.max())))
        return SingularError(f"{', '.join(worst)} contradict each other here: drop one of them")

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
            answers = self.pushes().dot(inverse)
            right = np.column_stack([wanted[:e] - jacobian.dot(a), -jacobian.dot(pulled.T)])
            solved = self.schur(jacobian.dot(answers.T), right)
            pulled, a = pulled + solved[:, 1:].T.dot(answers), a + solved[:, 0].dot(answers)
        self.pulled, rows = pulled, self.matrix[servo]
        self.programme.control_matrix = rows.dot(pulled.T)
        self.programme.repeating = self.programme.rank(self.programme.control_matrix)[0] < self.system.servo
        return self.programme.control_matrix, wanted[servo] - rows.dot(a)

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
        """Solve (J M^-1 P^T) x = right; the least x where rows repeat each other. Raises SingularError where they contradict."""
        own = matrix.diagonal()
        if not len(self.beside[1]):
            factor, answer, info = scipy.linalg.lapack.dposv(matrix, right)
            pivots = factor.diagonal()
            if not info and bool((pivots * pivots > REPEATED * own).all()):
                return answer
        if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
            raise SingularError(NO_VALUES)
        scale = np.sqrt(np.maximum(own, 1e-300))
        answer = np.linalg.lstsq(matrix / np.outer(scale, scale), right / scale[:, None], rcond=1e-10)[0] / scale[:, None]
        error = np.abs(matrix @ answer - right)
        if not error.max() <= 1e-6 * max(1.0, np.abs(right).max()):
            raise self._contradicting(error.max(axis=1))
        return np.asarray(answer, dtype=np.float64)


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
