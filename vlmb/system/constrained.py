"""The constrained equations: ideal rows with their multipliers, and a programme with its controls, solved together.

    M vdot = b + J^T lambda + B u,   J vdot = gamma,   W vdot = H z + K z' - drift

M^-1 (b, J^T, B) by one Cholesky; what remains is as small as the number of rows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from vlmb.errors import SceneError, SingularError
from vlmb.model.mechanism import Mechanism
from vlmb.scene.tables import DEFAULT_STEP, FIXED_STEP, Run
from vlmb.system.constraints import RowInfo, Rows
from vlmb.system.forces import column
from vlmb.system.frames import LinkFrames
from vlmb.system.gains import largest_stable_step
from vlmb.system.programme import ProgrammeControl, control_channels, control_scales

Array = NDArray[np.float64]

EMPTY = 1e-18  # of J M^-1 J^T over |J|^2 [1/kg]: a row that moves nothing
REPEATED = 1e-12  # of a Cholesky pivot squared over the diagonal: a row that others repeat
SIDEWAYS = 1  # index of the ski's sideways velocity in v
NOTHING = np.zeros(1)


class ConstrainedSystem:
    """Rows and controls of a scene. `held`: the knife edge is the first ideal row (Routh's multiplier).

    `table` holds, one below the other, the forces of the controls in their scales, b, and the rows: J with the
    knife edge first, W, secondary. The first three are the right sides of one Cholesky, all rows are what its answers are
    multiplied with. Columns of known accelerations stand apart in a second layer.
    """

    def __init__(
        self, mechanism: Mechanism, frames: LinkFrames, run: Run, held: bool, gain: float, known: Sequence[int] = ()
    ) -> None:
        scene, nv = mechanism.scene, mechanism.layout.nv
        self.mechanism, self.frames, self.held, self.gain, self.known = mechanism, frames, held, gain, list(known)
        programme = scene.programme
        texts = [(text, f"constraints[{k}]", True) for k, text in enumerate(scene.constraints)]
        self.ideal = len(texts)
        if programme is not None:
            texts += [(text, f"programme.constraints[{k}]", False) for k, text in enumerate(programme.constraints)]
        self.servo = len(texts) - self.ideal
        if programme is not None:
            texts += [(text, f"programme.secondary[{k}]", False) for k, text in enumerate(programme.secondary)]
        given = control_channels(mechanism)
        self.scales = control_scales(mechanism, given)
        direct = [s for s, channel in enumerate(given) if channel.coordinate]
        self.bent = [(s, channel) for s, channel in enumerate(given) if not channel.coordinate]
        pushed = [(given[s].coordinate, self.scales.item(s)) for s in direct]
        self.rows = Rows(mechanism, frames, texts, pushed) if texts else None
        info: tuple[RowInfo, ...] = self.rows.info if self.rows else ()
        self.info = info[: self.ideal + self.servo]
        if (held or self.ideal) and gain > 0.0 and run.method in FIXED_STEP:
            limit = largest_stable_step(np.array([-gain], dtype=complex), run.method)
            if (run.step or DEFAULT_STEP) >= limit:
                raise SceneError(
                    f"run.gain = {gain:g} 1/s: with method {run.method!r} errors of ideal rows grow at step "
                    f"{run.step or DEFAULT_STEP:g} s; the largest stable step is {limit:.6g} s: reduce gain or step"
                )
        self.programme: ProgrammeControl | None = None
        law = np.zeros((held + len(info), 3 * len(info) + len(self.rows.places if self.rows else ())))
        holonomic = np.array([row.holonomic for row in info], dtype=bool)
        h, k = np.diag(-(gain**2) * holonomic), np.diag(np.where(holonomic, -2.0 * gain, -gain))
        if programme is not None:
            split = self.ideal + self.servo
            self.programme = ProgrammeControl(mechanism, info[self.ideal : split], info[split:], run)
            servo, second = slice(self.ideal, split), slice(split, None)
            h[servo, servo], k[servo, servo] = self.programme.gains()
            h[second, second], k[second, second] = self.programme.secondary_gains()
        law[held:, : 3 * len(info)] = np.hstack([h, k, -np.eye(len(info))])
        self.law = law  # (z, z', drift, entries) -> what W vdot shall be
        self.count, self.acting = held + self.ideal, len(given)
        self.names = (("knife_edge",) if held else ()) + tuple(row.text for row in info[: self.ideal])
        down = self.acting + 1 + held + len(info)
        self.memory = np.zeros(2 * down * nv + 3 * len(info))  # the table; and where z, z' and drift go when entries are put
        self.table = self.memory[: 2 * down * nv].reshape(2, down, nv)
        self.free, self.apart = self.table
        self.right = self.free[: self.acting + 1 + self.count].T
        self.load, self.columns = self.free[self.acting], self.free[: self.acting]
        self.jacobian = self.free[self.acting + 1 :].T
        if held:
            self.jacobian[SIDEWAYS, 0] = 1.0
        self.numbers = NOTHING
        self.shares = np.ones(self.acting + 1 + self.count)  # controls in their scales, 1 (of b), multipliers
        self.scaled = self.shares[: self.acting]
        if self.rows is not None:
            places = [self._place(direct, *place) for place in self.rows.places]
            self.places = np.array([*range(2 * down * nv, len(self.memory)), *places], dtype=np.intp)
            for place, value in self.rows.constants.items():
                self.table.flat[self._place(direct, *place)] = value
        self.working = np.array([held + k for k, row in enumerate(info[: self.ideal]) if row.working], dtype=np.intp)
        self.working_names = tuple(self.names[k] for k in self.working)

    def _place(self, direct: Sequence[int], row: int, at: int) -> int:
        """Flat place in `table` of an entry of the rows, or of the forces of `direct` controls that stand below them."""
        assert self.rows is not None
        down = self.acting + 1 + self.held + row if row < self.rows.count else direct[row - self.rows.count]
        return ((at in self.known) * len(self.free) + down) * self.free.shape[1] + at

    @property
    def needed(self) -> bool:
        """Whether there is anything to solve for beside the accelerations."""
        return self.held or self.rows is not None

    @property
    def controls(self) -> Array:
        """Controls u (S,) of the last solution."""
        return self.shares[: self.acting] * self.scales

    @property
    def multipliers(self) -> Array:
        """Multipliers of the last solution, the knife edge's first where it is one."""
        return self.shares[self.acting + 1 :]

    def solve(self, t: float, q: Array, v: Array, b: Array, given: Array | None, reference: Sequence[float]) -> Array | None:
        """Return vdot, None where M (crossed already, overwritten) is singular; leaves `shares`.

        `given` (nv,) are known accelerations, None if all are 0. Raises SingularError for contradicting rows, and for a
        programme that cannot be met.
        """
        count, acting, shares, rows = self.count, self.acting, self.shares, self.rows
        self.load[:] = b
        wanted = NOTHING
        if rows is not None:
            self.numbers = numbers = rows.numbers(t, q, v, reference)
            self.memory[self.places] = numbers
            wanted = self.law.dot(numbers)
        if self.held:
            wanted[0] = -self.gain * v.item(SIDEWAYS)
        if self.bent:
            self._bend(reference)
        if given is not None:
            wanted -= self.apart[acting + 1 :].dot(given)
        _, answer, info = lapack.dposv(self.mechanism.data.M, self.right, 0, 1)  # M overwritten
        if info:
            return None
        moved = answer.T.dot(self.jacobian)  # accelerations of the rows by each control, by b, by each multiplier
        lacking = moved[acting]
        np.subtract(wanted, lacking, lacking)
        if count:
            solved = self._schur(moved[acting + 1 :, :count].T, moved[: acting + 1, :count].T)
            moved = moved[: acting + 1, count:] - solved.T.dot(moved[acting + 1 :, count:])
        if self.programme is not None:
            self.scaled[:] = self.programme.solve(t, moved[:acting].T, moved[acting])
        if count:
            shares[acting + 1 :] = solved[:, acting] - solved[:, :acting].dot(shares[:acting])
        result: Array = answer.dot(shares)
        return result

    def require_finite(self) -> None:
        """Raise SimulationError naming the rows without a finite value at the last solution."""
        if self.rows is not None:
            self.rows.require_finite(self.numbers)

    def forces(self) -> Array:
        """Return B u (nv,) of the last solution."""
        both: Array = self.shares[: self.acting].dot(self.free[: self.acting] + self.apart[: self.acting])
        return both

    def on_known(self) -> Array:
        """Return J^T lambda + B u (nv,) of the last solution on known accelerations, 0 elsewhere."""
        both: Array = self.shares.dot(self.apart[: len(self.shares)])
        return both

    def powers(self, v: Array) -> Array:
        """Return the powers [W] of the controls, then of the ideal rows that work, at the last solution."""
        acting = self.acting
        powers: Array = self.columns.dot(v)
        powers *= self.scaled
        if self.working.size:
            at = self.working + acting + 1
            powers = np.concatenate([powers, (self.free[at] + self.apart[at]).dot(v) * self.shares[at]])
        return powers

    def _bend(self, reference: Sequence[float]) -> None:
        """Write the forces of hinge torques."""
        for s, channel in self.bent:
            column(channel, self.frames, reference, self.free[s])
            self.free[s] *= self.scales[s]
            self.apart[s, self.known] = self.free[s, self.known]
            self.free[s, self.known] = 0.0

    def _schur(self, matrix: Array, right: Array) -> Array:
        """Solve (J M^-1 J^T) x = right; the least x where rows repeat each other, SingularError where they contradict.

        The last column of `right` is what the rows lack.
        """
        first = self.acting + 1
        sizes = np.einsum("lij,lij->i", *[self.table[:, first : first + self.count]] * 2).tolist()
        diagonal = matrix.diagonal().tolist()
        empty = [k for k, (own, size) in enumerate(zip(diagonal, sizes, strict=True)) if own <= EMPTY * size]
        if empty:  # rows that act on known accelerations alone
            if np.abs(right[empty, -1]).max() > 1e-6:
                worst = [repr(self.names[k]) for k in empty]
                raise SingularError(f"{', '.join(worst)} asks for what is known otherwise here: drop it")
            matrix, right = matrix.copy(), right.copy()
            matrix[empty], matrix[:, empty], right[empty] = 0.0, 0.0, 0.0
            matrix[empty, empty] = 1.0
            diagonal = matrix.diagonal().tolist()
        factor, answer, info = lapack.dposv(matrix, right)
        pivots = factor.diagonal().tolist()
        if not info and all(pivot * pivot > REPEATED * own for pivot, own in zip(pivots, diagonal, strict=True)):
            return answer
        if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
            self.require_finite()
            raise SingularError("the ideal constraints have no finite values here")
        scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        answer = np.linalg.lstsq(matrix / np.outer(scale, scale), right / scale[:, None], rcond=1e-10)[0] / scale[:, None]
        error = np.abs(matrix @ answer - right)
        if not error.max() <= 1e-6 * max(1.0, np.abs(right).max()):
            worst = [repr(self.names[k]) for k in np.flatnonzero(error.max(axis=1) > 0.1 * error.max())]
            raise SingularError(f"the ideal constraints {', '.join(worst)} contradict each other here: drop one of them")
        return answer
