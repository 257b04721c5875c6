"""Constraint rows written as equations: residual z, rate z', its Jacobian W in v, and its drift.

Holonomic rows g(q, t): z = g, z' = W v + dg/dt. Velocity rows g'(q, v, t): z' = g'. In both z'' = W vdot + drift with
drift = (dz'/db) b' + (dz'/db') b''(vdot = 0) + dz'/dt (the paper's chi without W a).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.core.joints import rows_of_joints
from vlmb.core.quantities import AZIMUTH
from vlmb.errors import SceneError, SimulationError, SingularError, VlmbError
from vlmb.model.forms import RowFacts
from vlmb.model.laws import tape_breaks
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import GeneralizedForce
from vlmb.model.quantities import allowed_names
from vlmb.scene.by_phase import numbers_of
from vlmb.scene.expressions import Equation, Expression, parse_equation
from vlmb.scene.rows import Row, read_row
from vlmb.system.azimuth_rows import AzimuthRow, azimuth_row, regular_form, with_given_azimuths
from vlmb.system.frames import LinkFrames
from vlmb.system.readings import make_readings, no_direction

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Constraint:
    """What is known of a row before any motion."""

    text: str  # its key in results: its name, else its equation
    holonomic: bool
    angle: bool  # z is a difference of angles: wrapped to [-pi, pi)
    names: frozenset[str]
    working: bool  # W v is not z': as an ideal constraint it does work, because it moves with time or asks for a rate
    regular: AzimuthRow | None = None  # what an ideal row says of azimuths
    worker: int = -1  # whose work its multiplier does, by number; -1: nobody's
    unbounded: bool = False  # W grows without bound: that of an azimuth towards the pole
    of_forces: bool = False  # it is one of forces of contacts, and has no W


NO_FORCES: Mapping[str, Equation] = MappingProxyType({})
STEEP = 30.0  # size of the row of an azimuth [1/rad] whose link stands next to the pole


class RowValues(NamedTuple):
    """Rows at one instant: z (r,) with 0 for velocity rows, z' (r,), W (r, nv), drift (r,)."""

    z: Array
    rate: Array
    jacobian: Array
    drift: Array


class ConstraintSet:
    """Compiled rows, and the forces of controls; never changed. Evaluating needs up-to-date frames.

    Ideal rows that say what an azimuth is, or the sum or difference of two, are taken in their regular form. `pushed` are
    (force, scale): what a force of that size is over v stands above W.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        texts: Sequence[tuple[str, str, bool]],
        pushed: Sequence[tuple[GeneralizedForce, float]] = (),
        behind: Sequence[Expression] = (),
        rests: Mapping[str, Equation] = NO_FORCES,
    ) -> None:
        """Compile (text, key path, ideal) rows, and what else shall be read with them.

        rests : of rows that name forces, by key path, what stands beside these
        """
        names = allowed_names(mechanism.names, numbers_of(mechanism.scene), mechanism.signals)
        rows = [read_row(text, key) for text, key, _ in texts]
        equations = [rests.get(row.key) or parse_equation(row.equation, row.key, names) for row in rows]
        of_forces = [row.key in rests for row in rows]
        written = [azimuth_row(mechanism, row, k) if texts[k][2] else None for k, row in enumerate(equations)]
        regular = with_given_azimuths(mechanism, written)
        made = [regular_form(mechanism, row) if row else equation for row, equation in zip(regular, equations, strict=True)]
        self.roots = (*made, *behind)  # as they are compiled
        self.behind = tuple(behind)
        forces, scales = [force for force, _ in pushed], [scale for _, scale in pushed]
        self.readings = make_readings(mechanism, self.roots, forces, scales, len(rows), np.flatnonzero(of_forces))
        kinds = [row[0] for row in self.readings.table.rows]
        unbounded = [any(kinds[at] == AZIMUTH for at in self.readings.read(root)) for root in range(len(rows))]
        facts = self.readings.compiled.rows[: len(rows)]
        self.info = tuple(map(_classify, range(len(rows)), rows, equations, facts, regular, unbounded, of_forces))
        self.texts = tuple(info.text for info in self.info)
        self.count, self.pushed, self.nv = len(self.info), len(pushed), mechanism.layout.nv
        self.holonomic = np.array([info.holonomic for info in self.info], dtype=bool)
        self._mechanism, self._written = mechanism, dict[int, ConstraintSet]()

    def evaluate(
        self, frames: LinkFrames, t: float, q: Array, v: Array, branch: Sequence[float] | Array,
        rows: Sequence[int] | None = None,
    ) -> RowValues:  # fmt: skip
        """Evaluate all rows, or some by number, at a state whose frames are up to date; angles near `branch`.

        Raises SimulationError where an equation has no finite value, SingularError where one reads an azimuth at the pole.
        """
        buffers, near, known = self.readings.buffers(), np.array(branch, float), np.zeros(self.nv, np.int64)
        out, matrix = np.empty((3, len(self.roots))), np.empty((1, self.pushed + self.count, self.nv))
        fine = rows_of_joints(self.readings.integers, buffers, t, q, v, frames.turning, near, known, self.pushed, out, matrix)
        jacobian, chosen = matrix[0, self.pushed :], list(range(self.count) if rows is None else rows)
        if not fine:
            failure = self.failure(buffers, out, jacobian, chosen)
            if failure is not None:
                raise failure
        z, rate, drift = out[:, chosen]
        return RowValues(z, rate, jacobian[chosen], drift)

    def errors(self, frames: LinkFrames, t: Array, q: Array, v: Array, branch: Array, count: int) -> Array:
        """Return z and z' (2, N, count) of the first rows at many samples; nan where a row has no value there."""
        buffers, known = self.readings.buffers(), np.zeros(self.nv, np.int64)
        out, matrix = np.empty((3, len(self.roots))), np.empty((1, self.pushed + self.count, self.nv))
        found = np.empty((2, len(t), count))
        for i, time in enumerate(t.tolist()):
            frames.update(q[i])
            here = q[i], v[i], frames.turning, branch[i]
            rows_of_joints(self.readings.integers, buffers, time, *here, known, self.pushed, out, matrix)
            found[:, i] = out[:2, :count]
        return found

    def as_written(self, k: int) -> ConstraintSet:
        """Return row k, which is taken in its regular form, as it is written; compiled when it is first asked for."""
        if k not in self._written:
            row = self.info[k].regular
            assert row is not None
            self._written[k] = ConstraintSet(self._mechanism, [(row.equation.text, row.equation.left.key, False)])
        return self._written[k]

    def breaks(self, start: float, end: float) -> tuple[float, ...]:
        """Return the times in (start, end) where an equation switches in time. Raises SceneError for too many."""
        return tape_breaks(self.readings.compiled, self.readings.parameters, start, end, ", ".join(self.texts))

    def failure(
        self, buffers: Array, out: Array, jacobian: Array, rows: Sequence[int] | None = None, columns: Array | None = None
    ) -> VlmbError | None:
        """Return the error of an evaluation that was not fine: of rows, all or some by number, or of the forces' `columns`."""
        sizes = np.abs(out[:, : self.count]).sum(axis=0) + np.abs(jacobian).sum(axis=1)
        bad = [k for k in (range(self.count) if rows is None else rows) if not np.isfinite(sizes[k])]
        if bad:
            obstacle = self.readings.obstacle(buffers, bad)
            named = " and ".join(repr(self.texts[k]) for k in sorted(bad))
            reach = self.readings.table.signals.reach(named)
            return obstacle or SimulationError(f"the equation {named} has no finite value here{reach}")
        for force, column in zip(self.readings.forces, () if columns is None else columns, strict=False):
            if not np.isfinite(column).all():
                return no_direction(force, self.readings.layout)
        return None


def contradiction(names: Sequence[str], steep: Sequence[bool]) -> SingularError:
    """Make the error of ideal rows that cannot be met together. `steep`: those of an azimuth next to the pole."""
    listed = ", ".join(map(repr, names))
    if not any(steep):
        return SingularError(f"the ideal constraints {listed} contradict each other here: drop one of them")
    azimuths = ", ".join(repr(name) for name, row in zip(names, steep, strict=True) if row)
    return SingularError(
        f"the ideal constraints {listed} cannot be met together here: {azimuths} goes by an azimuth, and a link stands next to "
        "the pole, where an azimuth magnifies what the others leave open; drop it if the others say the same, or write it with "
        "direction.x and direction.y"
    )


def _classify(
    number: int, row: Row, equation: Equation, facts: RowFacts, regular: AzimuthRow | None, unbounded: bool, of_forces: bool
) -> Constraint:
    if of_forces:
        return Constraint(row.name, False, False, equation.names, False, of_forces=True)
    if not facts.moves:
        raise SceneError(f"{row.key}: {equation.text!r} contains no coordinate or rate: nothing can make it true or false")
    working, worker = facts.working, number if facts.working else -1
    if regular:
        working, worker = number in regular.timed, next(iter(regular.timed), -1)
    return Constraint(row.name, facts.position, facts.angle, equation.names, working, regular, worker, unbounded)
