"""Constraint rows written as equations: residual z, rate z', its Jacobian W in v, and its drift.

Holonomic rows g(q, t): z = g, z' = W v + dg/dt. Velocity rows g'(q, v, t): z' = g'. In both z'' = W vdot + drift with
drift = (dz'/db) b' + (dz'/db') b''(vdot = 0) + dz'/dt (the paper's chi without W a).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, SimulationError
from vlmb.model.mechanism import Mechanism
from vlmb.scene.expressions import Equation, parse_equation
from vlmb.scene.rows import Row, read_row
from vlmb.scene.symbolic import compile_scalar, to_sympy
from vlmb.system.frames import LinkFrames
from vlmb.system.observables import Motion, Symbols, allowed_names

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Constraint:
    """What is known of a row before any motion."""

    text: str  # its key in results: its name, else its equation
    holonomic: bool
    angle: bool  # z is a difference of angles: wrapped to (-pi, pi]
    names: frozenset[str]
    working: bool  # W v is not z': as an ideal constraint it does work, because it moves with time or asks for a rate
    azimuths: tuple[str, str] | None = None  # of an ideal row in its regular form
    swings: frozenset[int] = frozenset()  # links whose azimuth it reads: none of them may stand at the pole


class RowValues(NamedTuple):
    """Rows at one instant: z (r,) with 0 for velocity rows, z' (r,), W (r, nv), drift (r,)."""

    z: Array
    rate: Array
    jacobian: Array
    drift: Array


class ConstraintSet:
    """Compiled rows, and the forces conjugate to coordinates; never changed. Evaluating needs up-to-date frames.

    Ideal rows that equate two azimuths are taken in their regular form, cos psi sin(phi_i - phi_j) = 0 through the
    directions, which has no pole. `pushed` are (coordinate, scale): their rows of L times the scale stand below W.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        texts: Sequence[tuple[str, str, bool]],
        pushed: Sequence[tuple[str, float]] = (),
    ) -> None:
        """Compile (text, key path, ideal) rows."""
        names = allowed_names(mechanism)
        rows = [read_row(text, key) for text, key, _ in texts]
        equations = [parse_equation(row.equation, row.key, names) for row in rows]
        symbols = Symbols(mechanism)
        ideals = [ideal for _, _, ideal in texts]
        residuals = list(map(partial(_residual, symbols), equations, ideals))
        self.info = tuple(map(partial(_classify, symbols), rows, equations, residuals, ideals))
        self.texts = tuple(info.text for info in self.info)
        self.count = len(self.info)
        self.holonomic = np.array([info.holonomic for info in self.info], dtype=bool)
        used = _used(symbols, residuals)
        self.motion = Motion(symbols, [*used, *(name for name, _ in pushed if name not in used)])
        self.function, self.places, self.constants = _compile(symbols, residuals, self.info, used, self.motion, pushed)
        self.matrix = np.zeros((self.count + len(pushed), mechanism.layout.nv))  # with the entries that never change
        for place, value in self.constants.items():
            self.matrix[place] = value
        self.matrix.flags.writeable = False
        self.size = 3 * self.count + len(self.places)
        self.varying = np.array([row * mechanism.layout.nv + at for row, at in self.places], dtype=np.intp)

    def numbers(self, frames: LinkFrames, t: float, q: Array, v: Array, branch: Sequence[float]) -> Array:
        """Return z, z', drift of z' (3 r), then the entries at `places`, (row, velocity), of W and what stands below it.

        Entries that never change are in `constants`. All is nan where an equation has no value.
        """
        return np.fromiter(self.function(*self.motion.numbers(frames, t, q, v, branch)), float, self.size)

    def evaluate(
        self, frames: LinkFrames, t: float, q: Array, v: Array, branch: Sequence[float], rows: Sequence[int] | None = None
    ) -> RowValues:
        """Evaluate all rows, or some by number, at a state whose frames are up to date; angles near `branch`.

        Raises SimulationError where an equation has no finite value, SingularError where one reads an azimuth at the pole.
        """
        chosen, count = list(range(self.count) if rows is None else rows), self.count
        needed: frozenset[int] = frozenset().union(*(self.info[k].swings for k in chosen))
        read = self.motion.numbers(frames, t, q, v, branch, needed)
        numbers = np.fromiter(self.function(*read), float, self.size)
        self.require_finite(numbers, chosen)
        matrix = self.matrix.copy()
        matrix.put(self.varying, numbers[3 * count :])
        z, rate, drift = numbers[: 3 * count].reshape(3, -1)[:, chosen]
        return RowValues(z, rate, matrix[chosen], drift)

    def require_finite(self, numbers: Array, rows: Sequence[int] | None = None) -> None:
        """Raise SimulationError naming the rows, of all or of some by number, without a finite value."""
        if not np.isfinite(numbers).all():
            bad = np.flatnonzero(~np.isfinite(numbers[: 3 * self.count]).reshape(3, -1).all(axis=0)).tolist()
            entries = zip(self.places, numbers[3 * self.count :].tolist(), strict=True)
            bad += [row for (row, _), entry in entries if not math.isfinite(entry)]
            if rows is not None and not set(rows).intersection(bad):
                return
            asked = range(self.count) if rows is None else rows
            named = " and ".join(repr(self.texts[k]) for k in sorted(set(bad).intersection(asked)))
            raise SimulationError(f"the equation {named or ', '.join(map(repr, self.texts))} has no finite value here")


def _residual(symbols: Symbols, equation: Equation, ideal: bool) -> Any:
    azimuths = _azimuths(symbols, equation) if ideal else None
    if azimuths is not None:
        (ax, ay), (bx, by) = (_flat(symbols, name) for name in azimuths)
        return ay * bx - ax * by
    left = to_sympy(equation.left, symbols.table(sorted(equation.left.names)))
    right = to_sympy(equation.right, symbols.table(sorted(equation.right.names)))
    return left - right


def _azimuths(symbols: Symbols, equation: Equation) -> tuple[str, str] | None:
    """Names of the two azimuths of an equation such as `phi1 = phi0`; None for any other."""
    sides = equation.left.text.strip(), equation.right.text.strip()
    heads = [name for name, b in symbols.variables.items() if b.kind in ("phi", "phi0")]
    return (sides[0], sides[1]) if sides[0] in heads and sides[1] in heads and sides[0] != sides[1] else None


def _flat(symbols: Symbols, name: str) -> tuple[Any, Any]:
    variable = symbols.variables[name]
    if variable.kind == "phi0":
        heading = symbols.value[name]
        return symbols.sympy.cos(heading), symbols.sympy.sin(heading)
    x, y, _ = symbols.direction(variable.link)
    return x, y


def _classify(symbols: Symbols, row: Row, equation: Equation, residual: Any, ideal: bool) -> Constraint:
    free = residual.free_symbols
    values = {symbols.value[name] for name in symbols.value}
    rates = {symbols.rate[name] for name in symbols.rate}
    if not free & (values | rates):
        raise SceneError(f"{row.key}: {equation.text!r} contains no coordinate or rate: nothing can make it true or false")
    holonomic = not free & rates
    turning = {symbols.value[name] for name, b in symbols.variables.items() if b.kind in ("phi", "psi", "phi0")}
    angle = holonomic and free & values <= turning and all(abs(residual.diff(s)) == 1 for s in free & values)
    azimuths = _azimuths(symbols, equation) if ideal else None
    driven = residual.diff(symbols.time) if holonomic else residual - sum(residual.diff(rate) * rate for rate in free & rates)
    working = symbols.sympy.expand(driven) != 0
    read = {name for name in symbols.variables if {symbols.value[name], symbols.rate[name]} & free}
    swings = {symbols.variables[name].link for name in read if symbols.variables[name].kind == "phi"}
    return Constraint(row.name, holonomic, bool(angle), equation.names, working, azimuths, frozenset(swings))


def _used(symbols: Symbols, residuals: Sequence[Any]) -> list[str]:
    free = set().union(*(residual.free_symbols for residual in residuals)) if residuals else set()
    return [name for name in symbols.variables if symbols.value[name] in free or symbols.rate[name] in free]


def _compile(
    symbols: Symbols, residuals: Sequence[Any], info: Sequence[Constraint], used: Sequence[str], motion: Motion,
    pushed: Sequence[tuple[str, float]],
) -> tuple[Callable[..., tuple[float, ...]], list[tuple[int, int]], dict[tuple[int, int], float]]:  # fmt: skip
    """One scalar function giving z, z', drift of z' and the varying entries of W; their places; the constant entries."""
    sympy, b, rate = symbols.sympy, symbols.value, symbols.rate
    z, speeds, drift, covectors = [], [], [], []
    for residual, row in zip(residuals, info, strict=True):
        speed = residual
        if row.holonomic:
            speed = sum((residual.diff(b[name]) * rate[name] for name in used), residual.diff(symbols.time))
        slopes = {name: slope for name in used if (slope := speed.diff(rate[name])) != 0}
        curve = speed.diff(symbols.time)
        for name in used:
            curve += speed.diff(b[name]) * rate[name] + slopes.get(name, 0) * motion.drifts[name]
        wrapped = sympy.Function("remainder")(residual, sympy.Float(math.tau)) if row.angle else residual
        z.append(wrapped if row.holonomic else sympy.Integer(0))
        speeds.append(speed)
        drift.append(curve)
        covectors.append(motion.covector(slopes))
    for name, scale in pushed:
        covectors.append({at: scale * entry for at, entry in motion.covector({name: sympy.Integer(1)}).items()})
    entries = {(row, at): entry for row, covector in enumerate(covectors) for at, entry in covector.items()}
    constants = {place: float(entry) for place, entry in entries.items() if entry.is_Number}
    varying = {place: entry for place, entry in entries.items() if place not in constants}
    function = compile_scalar([*z, *speeds, *drift, *varying.values()], motion.arguments, motion.steps)
    return function, list(varying), constants
