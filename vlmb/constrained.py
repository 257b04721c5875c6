"""The constrained equations: ideal rows with their multipliers, and a programme with its controls, solved together.

    M vdot = b + J^T lambda + B u,   J vdot = gamma,   W vdot = H z + K z' - drift

M^-1 (b, J^T, B) by one Cholesky; what remains is as small as the number of rows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from vlmb.constraints import RowInfo, Rows
from vlmb.errors import SceneError, SingularError
from vlmb.forces import column
from vlmb.frames import LinkFrames
from vlmb.gains import largest_stable_step
from vlmb.mechanism import Mechanism
from vlmb.programme import ProgrammeControl, control_channels
from vlmb.scene import DEFAULT_STEP, FIXED_STEP, Run

Array = NDArray[np.float64]

EMPTY = 1e-18  # of J M^-1 J^T over |J|^2 [1/kg]: a row that moves nothing
REPEATED = 1e-12  # of a Cholesky pivot squared over the diagonal: a row that others repeat
SIDEWAYS = 1  # index of the ski's sideways velocity in v


class ConstrainedSystem:
    """Rows and controls of a scene. `held`: the knife edge is the first ideal row (Routh's multiplier)."""

    def __init__(self, mechanism: Mechanism, frames: LinkFrames, run: Run, held: bool, gain: float) -> None:
        scene, nv = mechanism.scene, mechanism.layout.nv
        self.mechanism, self.frames, self.held, self.gain = mechanism, frames, held, gain
        programme = scene.programme
        texts = [(text, f"constraints[{k}]", True) for k, text in enumerate(scene.constraints)]
        self.ideal = len(texts)
        if programme is not None:
            texts += [(text, f"programme.constraints[{k}]", False) for k, text in enumerate(programme.constraints)]
        self.servo = len(texts) - self.ideal
        if programme is not None:
            texts += [(text, f"programme.secondary[{k}]", False) for k, text in enumerate(programme.secondary)]
        channels = control_channels(mechanism)
        self.rows = Rows(mechanism, frames, texts, [c.coordinate for c in channels if c.coordinate]) if texts else None
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
        if programme is not None:
            split = self.ideal + self.servo
            self.programme = ProgrammeControl(mechanism, info[self.ideal : split], info[split:], run)
        names = self.rows.motion.names if self.rows else ()
        self.direct = [(s, names.index(c.coordinate)) for s, c in enumerate(channels) if c.coordinate]
        self.bent = [(s, c) for s, c in enumerate(channels) if not c.coordinate]
        self.take = np.array([k for _, k in self.direct], dtype=np.intp)
        self.multipliers = np.zeros(held + self.ideal)
        self.controls = np.zeros(len(channels))
        self.columns = np.zeros((len(channels), nv))  # B^T
        self.right = np.zeros((nv, 1 + held + self.ideal + len(channels)), order="F")
        self.apart = [0, *range(1 + held + self.ideal, self.right.shape[1])]  # columns of b and of the controls
        self.jacobian = np.zeros((held + len(info), nv))
        if held:
            self.jacobian[0, SIDEWAYS] = 1.0
        holonomic = np.array([row.holonomic for row in info[: self.ideal]], dtype=bool)
        self.damping = np.where(holonomic, 2.0 * gain, gain)

    @property
    def needed(self) -> bool:
        """Whether there is anything to solve for beside the accelerations."""
        return self.held or self.rows is not None

    def write_columns(self, reference: Sequence[float]) -> Array:
        """Return B^T (S, nv): tau of a unit of each control; the rows must have been evaluated here."""
        if self.rows is not None and self.direct:
            if self.bent:
                self.columns[[s for s, _ in self.direct]] = self.rows.motion.map[self.take]
            else:
                self.rows.motion.map.take(self.take, axis=0, out=self.columns)
        for s, channel in self.bent:
            column(channel, self.frames, reference, self.columns[s])
        return self.columns

    def solve(self, t: float, q: Array, v: Array, b: Array, known: Sequence[int], reference: Sequence[float]) -> Array | None:
        """Return vdot, None where M (crossed already, overwritten) is singular; leaves `multipliers` and `controls`.

        Raises SingularError for contradicting rows, and for a programme that cannot be met.
        """
        held, ideal, count = self.held, self.ideal, self.held + self.ideal
        right, jacobian, multipliers = self.right, self.jacobian, self.multipliers
        right[:, 0] = b
        if self.rows is not None:
            values = self.rows.evaluate(t, q, v, reference)
            if held:
                jacobian[held:] = values.jacobian
            else:
                self.jacobian = jacobian = values.jacobian
        if count:
            right[:, 1 : 1 + count] = jacobian[:count].T
        if self.programme is not None:
            right[:, 1 + count :] = self.write_columns(reference).T
        for k in known:
            right[k, 1:] = 0.0
        _, answer, info = lapack.dposv(self.mechanism.data.M, right, overwrite_a=1)
        if info:
            return None
        moved = jacobian.dot(answer)  # every row's acceleration by b, by each multiplier, by each control
        if count:
            gamma = np.zeros(count)
            if held:
                gamma[0] = -self.gain * v.item(SIDEWAYS)
            if ideal:
                gamma[held:] = -values.drift[:ideal] - self.damping * values.rate[:ideal] - self.gain**2 * values.z[:ideal]
            top = moved[:count]
            top[:, 0] -= gamma
            solved = self._schur(top[:, 1 : 1 + count], top[:, self.apart])
        if self.programme is None:
            multipliers[:] = -solved[:, 0]
            vdot: Array = answer[:, 0] + answer[:, 1:].dot(multipliers)
            return vdot
        first, last = ideal, ideal + self.servo
        rows = moved[held + first :]
        if count:
            rows = rows[:, self.apart] - rows[:, 1 : 1 + count].dot(solved)
        programme, servo = self.programme, self.servo
        beta = programme.wanted(values.z[first:last], values.rate[first:last], values.drift[first:last])
        beta -= rows[:servo, 0]
        second = None
        if len(rows) > servo:
            aim = programme.wanted_second(values.z[last:], values.rate[last:], values.drift[last:])
            second = rows[servo:, 1:], aim - rows[servo:, 0]
        self.controls[:] = u = programme.solve(t, rows[:servo, 1:], beta, second)
        if count:
            multipliers[:] = -solved[:, 0] - solved[:, 1:].dot(u)
            return answer.dot(np.concatenate([[1.0], multipliers, u]))
        result: Array = answer[:, 1:].dot(u)
        result += answer[:, 0]
        return result

    def generalized(self) -> Array:
        """Return J^T lambda + B u (nv,) of the last solution."""
        answer: Array = self.multipliers.dot(self.jacobian[: len(self.multipliers)]) + self.controls.dot(self.columns)
        return answer

    def _schur(self, matrix: Array, right: Array) -> Array:
        """Solve (J M^-1 J^T) x = right; the least x where rows repeat each other, SingularError where they contradict."""
        names = (("knife_edge",) if self.held else ()) + tuple(row.text for row in self.info[: self.ideal])
        diagonal = np.diag(matrix).copy()
        empty = diagonal <= EMPTY * (self.jacobian[: len(names)] ** 2).sum(axis=1)
        if empty.any():  # rows that act on known accelerations alone
            if np.abs(right[empty, 0]).max() > 1e-6:
                worst = [repr(names[k]) for k in np.flatnonzero(empty)]
                raise SingularError(f"{', '.join(worst)} asks for what is known otherwise here: drop it")
            matrix, right = matrix.copy(), right.copy()
            matrix[empty], matrix[:, empty], right[empty] = 0.0, 0.0, 0.0
            matrix[empty, empty] = 1.0
            diagonal[empty] = 1.0
        factor, answer, info = lapack.dposv(matrix, right)
        if not info and (np.diag(factor) ** 2 > REPEATED * diagonal).all():
            return answer
        scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        answer = np.linalg.lstsq(matrix / np.outer(scale, scale), right / scale[:, None], rcond=1e-10)[0] / scale[:, None]
        error = np.abs(matrix @ answer - right)
        if not error.max() <= 1e-6 * max(1.0, np.abs(right).max()):
            worst = [repr(names[k]) for k in np.flatnonzero(error.max(axis=1) > 0.1 * error.max())]
            raise SingularError(f"the ideal constraints {', '.join(worst)} contradict each other here: drop one of them")
        return answer
