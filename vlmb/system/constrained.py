"""The constrained equations: ideal rows with their multipliers, and a programme with its controls, solved together.

    M vdot = b + J^T lambda + B u,   J vdot = gamma,   W vdot = H z + K z' - drift

M^-1 (b, J^T, B) by one Cholesky; what remains is as small as the number of rows.

Where rows hold what has no mass, M has no inverse, but M + J^T W J has: with b + J^T W gamma in the place of b the same vdot and
lambda solve the equations, for any weights W >= 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from vlmb.core.joints import rows_of_joints
from vlmb.core.row_arrays import OF_WEIGHT
from vlmb.errors import SingularError
from vlmb.model.mechanism import Mechanism
from vlmb.system.constraints import STEEP, ConstraintSet, contradiction
from vlmb.system.core_rows import gain_table, moving_places
from vlmb.system.frames import LinkFrames
from vlmb.system.programme import ProgrammeControl, ProgrammePlan, control_channels, control_scales
from vlmb.system.slips import Slips

Array = NDArray[np.float64]

EMPTY = 1e-18  # of J M^-1 J^T over |J|^2 [1/kg]: a row that moves nothing
REPEATED = 1e-12  # of a Cholesky pivot squared over the diagonal, a pivot over the largest entry: a row that others repeat
REPEATING = 1e-10  # of the largest singular value of J M^-1 J^T in its scale: below it rows repeat each other
LOST = 1e-13  # of a diagonal entry: a Cholesky pivot squared below this part of it is rounding
TINIEST = 1e-300
SIDEWAYS = 1  # index of the ski's sideways velocity in v
NOTHING = np.zeros(1)


class ConstraintSolver:
    """Rows and controls of a scene at one instant. `held`: the knife edge is the first ideal row (Routh's multiplier).

    `table` holds, one below the other, the forces of the controls in their scales, b, and the rows: J with the
    knife edge first, W, secondary. The first three are the right sides of one Cholesky, all rows are what its answers are
    multiplied with. Columns of prescribed accelerations stand apart in a second layer.
    """

    def __init__(
        self, mechanism: Mechanism, frames: LinkFrames, rows: ConstraintSet | None, plan: ProgrammePlan | None,
        held: bool, gain: float, prescribed_dofs: Sequence[int] = (), slips: Slips | None = None,
    ) -> None:  # fmt: skip
        scene, nv = mechanism.scene, mechanism.layout.nv
        self.frames, self.rows, self.held, self.gain = frames, rows, held, gain
        self.prescribed_dofs = list(prescribed_dofs)
        self.slips = slips if slips is not None and slips.sliding else None
        self.ideal = len(scene.constraints)
        self.servo = 0 if plan is None else len(plan.texts)
        given = control_channels(mechanism)
        self.scales = control_scales(mechanism, given)
        info = rows.info if rows else ()
        self.info = info[: self.ideal + self.servo]
        self.programme = None if plan is None else ProgrammeControl(plan)
        width = len(rows.roots) if rows else 0
        law = np.zeros((held + len(info), 3, width))
        h, k = gain_table(info, plan, self.ideal, gain)
        law[held:, 0, : len(info)], law[held:, 1, : len(info)], law[held:, 2, : len(info)] = h, k, -np.eye(len(info))
        self.law = law.reshape(held + len(info), 3 * width)  # (z, z', drift) -> what W vdot shall be
        self.named = list[tuple[int, int, int]]()  # row beyond the ideal ones, multiplier that it names, by which value behind
        self.varying = list[tuple[int, int, int]]()  # row and column of the law that the motion gives, by which value behind
        for at, (row, column) in enumerate(moving_places(info, plan, self.ideal)):
            if plan is not None and row < OF_WEIGHT:
                self.named.append((OF_WEIGHT - 1 - row, held + column, len(info) + plan.moving.first_entry + at))
            if plan is not None and row >= 0:
                order, of = divmod(column, len(info))
                self.varying.append((held + row, order * width + of, len(info) + plan.moving.first_entry + at))
        self.count, self.n_controls = held + self.ideal, len(given)
        self.names = (("knife_edge",) if held else ()) + tuple(row.text for row in info[: self.ideal])
        down = self.n_controls + 1 + held + len(info)
        self.table = np.zeros((2, down, nv))
        self.free, self.apart = self.table
        self.right = self.free[: self.n_controls + 1 + self.count].T
        self.load, self.columns = self.free[self.n_controls], self.free[: self.n_controls]
        self.jacobian = self.free[self.n_controls + 1 :].T
        if held:
            self.jacobian[SIDEWAYS, 0] = 1.0
        self.shares = np.ones(self.n_controls + 1 + self.count)  # controls in their scales, 1 (of b), multipliers
        self.scaled = self.shares[: self.n_controls]
        self.first = self.n_controls + 1 + held  # of the rows in the table
        self.layers = np.zeros(nv, np.int64)
        self.layers[self.prescribed_dofs] = 1
        self.numbers = np.zeros((3, width))
        self.behind = self.numbers[0, len(info) :]
        self.numbers[1:, len(info) :] = 0.0
        self.wanted = self.numbers.ravel()
        if rows is not None:
            self.integers, self.buffers = rows.readings.integers, rows.readings.buffers()
        self.answers, self.worth = self.table[0, :0], 1.0  # M^-1 J^T, and what the ideal rows are worth, at the last solution
        self.largest = self.diagonal = [0.0] * self.count  # diagonal of J M^-1 J^T: its largest at accepted steps, and the last
        weak = mechanism.massless or mechanism.warnings  # of a motion that may have no inertia
        self.inertias = _inertias(mechanism) if weak and scene.constraints else None
        self.weights = np.zeros(self.count)  # W at the last solution
        self.bounded = [not (k >= held and info[k - held].unbounded) for k in range(self.count)]
        self.working = np.array([held + k for k, row in enumerate(info[: self.ideal]) if row.worker >= 0], dtype=np.intp)

    @property
    def needed(self) -> bool:
        """Whether there is anything to solve for beside the accelerations."""
        return self.held or self.rows is not None

    @property
    def controls(self) -> Array:
        """Controls u (S,) of the last solution."""
        return self.shares[: self.n_controls] * self.scales

    @property
    def multipliers(self) -> Array:
        """Multipliers of the last solution, the knife edge's first where it is one."""
        return self.shares[self.n_controls + 1 :]

    def solve(self, t: float, q: Array, v: Array, b: Array, given: Array | None, branch: Array) -> Array | None:
        """Return vdot, None where M (crossed already, overwritten) is singular; leaves `shares`.

        `given` (nv,) are prescribed accelerations, None if all are 0. Raises SingularError for contradicting rows, and for a
        programme that cannot be met.
        """
        count, n_controls, shares, rows = self.count, self.n_controls, self.shares, self.rows
        self.load[:] = b
        wanted = NOTHING
        if rows is not None:
            turning, places = self.frames.turning, (self.layers, self.first)
            if not rows_of_joints(self.integers, self.buffers, t, q, v, turning, branch, *places, self.numbers, self.table):
                self.require_finite()
            for row, column, at in self.varying:
                self.law[row, column] = self.numbers[0, at]
            wanted = self.law.dot(self.wanted)
        if self.held:
            wanted[0] = -self.gain * v.item(SIDEWAYS)
        if given is not None:
            wanted -= self.apart[n_controls + 1 :].dot(given)
        mass, least = self.frames.data.M, 0.0
        if self.inertias is not None:
            self.weights[:] = 1.0 / np.maximum((self.jacobian[:, :count] ** 2).T @ (1.0 / self.inertias), TINIEST)
            mass += self.added()
            self.load += self.jacobian[:, :count] @ (self.weights * wanted[:count])
            least = LOST * mass.diagonal()
        right = self.right if self.slips is None else self._with_friction(self.slips, t, q, v, branch)
        factor, answer, info = scipy.linalg.lapack.dposv(mass, right, 0, 1)  # M overwritten
        if info or (self.inertias is not None and (factor.diagonal() ** 2 <= least).any()):
            return None
        self.answers = answer.T[n_controls + 1 :]
        moved = answer.T.dot(self.jacobian)  # accelerations of the rows by each control, by b, by each multiplier
        lacking = moved[n_controls]
        np.subtract(wanted, lacking, lacking)
        if count:
            solved = self._schur(moved[n_controls + 1 :, :count].T, moved[: n_controls + 1, :count].T)
            moved = moved[: n_controls + 1, count:] - solved.T.dot(moved[n_controls + 1 :, count:])
            for row, of, at in self.named:
                moved[:, row] -= self.numbers[0, at] * solved[of]
        if self.programme is not None:
            self.scaled[:] = self.programme.solve(moved[:n_controls].T, moved[n_controls], self.behind)
        if count:
            shares[n_controls + 1 :] = solved[:, n_controls] - solved[:, :n_controls].dot(shares[:n_controls])
        result: Array = answer.dot(shares)
        return result

    def added(self) -> Array | float:
        """Return J^T W J (nv, nv) of the last rows, which stands beside M where a motion may have no inertia; else 0."""
        if self.inertias is None:
            return 0.0
        rows = self.jacobian[:, : self.count]
        answer: Array = (rows * self.weights) @ rows.T
        return answer

    def note_largest(self) -> None:
        """Take the last solution as one of an accepted step: by the largest diagonal it is judged what a row is still worth."""
        pairs = zip(self.largest, self.diagonal, self.bounded, strict=True)
        self.largest = [max(largest, own) if bounded else 0.0 for largest, own, bounded in pairs]

    def _with_friction(self, slips: Slips, t: float, q: Array, v: Array, branch: Array) -> Array:
        """Return the right sides with what sliding contacts push on, on accelerations that are free."""
        right = self.right.copy()
        for slide in slips.evaluate(self.frames, t, q, v, branch):
            extra = slide.extra.copy()
            extra[self.prescribed_dofs] = 0.0
            right[:, self.n_controls + 1 + self.held + slide.row] += extra
        return right

    def friction(self) -> Array:
        """Return the friction of sliding contacts (nv,) of the last solution."""
        slides = self.slips.slides if self.slips is not None else ()
        found = np.zeros(len(self.load))
        for slide in slides:
            found += self.multipliers[self.held + slide.row] * slide.extra
        return found

    def friction_powers(self) -> dict[str, float]:
        """Return what friction takes, and what it carries along with moving surfaces, by work state [W]."""
        found: dict[str, float] = {}
        for slide in self.slips.slides if self.slips is not None else ():
            force = slide.share * float(self.multipliers[self.held + slide.row])
            found[f"friction {slide.name}"] = force * slide.speed
            found[f"surface {slide.name}"] = force * slide.carried
        return found

    def require_finite(self) -> None:
        """Raise SimulationError, SingularError naming the rows or the control without a finite value at the last solution."""
        if self.rows is not None:
            both = self.free + self.apart
            failure = self.rows.failure(self.buffers, self.numbers, both[self.first :], columns=both[: self.n_controls])
            if failure is not None:
                raise failure
            for which in np.flatnonzero(~np.isfinite(self.behind)):
                assert self.programme is not None
                moving = self.programme.plan.moving
                reach = self.rows.readings.table.signals.reach(moving.laws[which].text)
                raise moving.failure(int(which), float(self.behind[which]), reach)

    def forces(self) -> Array:
        """Return B u (nv,) of the last solution."""
        both: Array = self.shares[: self.n_controls].dot(self.free[: self.n_controls] + self.apart[: self.n_controls])
        return both

    def on_prescribed(self) -> Array:
        """Return J^T lambda + B u (nv,) of the last solution on prescribed accelerations, 0 elsewhere."""
        both: Array = self.shares.dot(self.apart[: len(self.shares)])
        if self.slips is not None:
            both[self.prescribed_dofs] += self.friction()[self.prescribed_dofs]
        return both

    def powers(self, v: Array) -> Array:
        """Return the powers [W] of the controls, then of the ideal rows that work, at the last solution."""
        n_controls = self.n_controls
        powers: Array = (self.columns + self.apart[:n_controls]).dot(v)
        powers *= self.scaled
        if self.working.size:
            at = self.working + n_controls + 1
            powers = np.concatenate([powers, (self.free[at] + self.apart[at]).dot(v) * self.shares[at]])
        return powers

    def _schur(self, matrix: Array, right: Array) -> Array:
        """Solve (J M^-1 J^T) x = right; the least x where rows repeat each other, SingularError where they contradict.

        The last column of `right` is what the rows lack.
        """
        first = self.n_controls + 1
        sizes = np.einsum("lij,lij->i", *[self.table[:, first : first + self.count]] * 2).tolist()
        diagonal = matrix.diagonal().tolist()
        pairs = enumerate(zip(diagonal, sizes, strict=True))
        empty = [k for k, (own, size) in pairs if abs(own) <= EMPTY * size]  # friction may make it negative
        if empty:  # rows that act on prescribed accelerations alone
            if np.abs(right[empty, -1]).max() > 1e-6:
                asking = [repr(self.names[k]) for k in empty]
                raise SingularError(f"{', '.join(asking)} asks for what is known otherwise here: drop it")
            matrix, right = matrix.copy(), right.copy()
            matrix[empty], matrix[:, empty], right[empty] = 0.0, 0.0, 0.0
            matrix[empty, empty] = 1.0
            diagonal = matrix.diagonal().tolist()
        self.worth = 1.0
        if self.slips is not None:  # friction makes it unsymmetric
            factor, order, info = scipy.linalg.lapack.dgetrf(matrix)
            if not info and np.abs(factor.diagonal()).min() > REPEATED * np.abs(matrix).max():
                return np.asarray(scipy.linalg.lapack.dgetrs(factor, order, right)[0], float)
        else:
            factor, answer, info = scipy.linalg.lapack.dposv(matrix, right)
            pivots = factor.diagonal().tolist()
            if not info and all(pivot * pivot > REPEATED * own for pivot, own in zip(pivots, diagonal, strict=True)):
                shares = zip(pivots, diagonal, self.largest, strict=True)
                self.worth = min(pivot / math.sqrt(max(own, largest)) for pivot, own, largest in shares)
                self.diagonal = diagonal
                return answer
        if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
            self.require_finite()
            raise SingularError("the ideal constraints have no finite values here")
        scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        answer = np.linalg.lstsq(matrix / np.outer(scale, scale), right / scale[:, None], rcond=REPEATING)[0] / scale[:, None]
        bound = np.sqrt(np.maximum(scale**2, self.largest))
        values = np.linalg.svd(matrix / np.outer(bound, bound), compute_uv=False)
        self.worth, self.diagonal = math.sqrt(values[values > REPEATING * values[0]][-1]), diagonal
        error = np.abs(matrix @ answer - right)
        if not error.max() <= 1e-6 * max(1.0, np.abs(right).max()):
            astray = [int(k) for k in np.flatnonzero(error.max(axis=1) > 0.1 * error.max())]
            steep = [not self.bounded[k] and sizes[k] > STEEP**2 for k in astray]
            raise contradiction([self.names[k] for k in astray], steep)
        return answer


def _inertias(mechanism: Mechanism) -> Array:
    """An inertia (nv,) for every velocity [kg, kg m^2] that is of the size of the mechanism's: of its mass at its reach."""
    scene, layout = mechanism.scene, mechanism.layout
    mass = scene.base.mass + sum(link.rod.mass + link.tip_mass for link in scene.links) or 1.0
    reach = sum(e.lower.length + e.rod_length + e.upper.length for e in layout.links) / len(layout.links) or 1.0
    found = np.full(layout.nv, mass)
    for e in layout.links:
        found[e.v : e.v + (1 if layout.plane else 3)] = mass * reach**2
    return found
