"""Constraint rows written as equations: residual z, rate z', its Jacobian W in v, and its drift.

Holonomic rows g(q, t): z = g, z' = W v + dg/dt. Velocity rows g'(q, v, t): z' = g'. In both z'' = W vdot + drift with
drift = (dz'/db) b' + (dz'/db') b''(vdot = 0) + dz'/dt (the paper's chi without W a).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, SimulationError
from vlmb.expressions import Equation, compile_scalar, parse_equation, to_sympy
from vlmb.frames import LinkFrames
from vlmb.mechanism import Mechanism
from vlmb.observables import Motion, Symbols, allowed_names

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RowInfo:
    """What is known of a row before any motion."""

    text: str
    holonomic: bool
    angle: bool  # z is a difference of angles: wrapped to (-pi, pi]
    names: frozenset[str]
    azimuths: tuple[str, str] | None = None  # of an ideal row in its regular form


class RowValues(NamedTuple):
    """Rows at one instant: z (r,) with 0 for velocity rows, z' (r,), W (r, nv), drift (r,)."""

    z: Array
    rate: Array
    jacobian: Array
    drift: Array


class Rows:
    """Compiled rows. `evaluate` needs up-to-date frames (crba in WORLD convention).

    Ideal rows that equate two azimuths are taken in their regular form, cos psi sin(phi_i - phi_j) = 0 through the
    directions, which has no pole. `extra` names variables that `motion` shall follow beside those of the rows.
    """

    def __init__(
        self, mechanism: Mechanism, frames: LinkFrames, texts: Sequence[tuple[str, str, bool]], extra: Sequence[str] = ()
    ) -> None:
        """Compile (text, key path, ideal) rows."""
        names = allowed_names(mechanism)
        equations = [parse_equation(text, key, names) for text, key, _ in texts]
        symbols = Symbols(mechanism)
        residuals = [_residual(symbols, equation, ideal) for equation, (_, _, ideal) in zip(equations, texts, strict=True)]
        self.info = tuple(
            _classify(symbols, e, z, key, ideal) for e, z, (_, key, ideal) in zip(equations, residuals, texts, strict=True)
        )
        self.texts = tuple(info.text for info in self.info)
        self.count = len(self.info)
        self.holonomic = np.array([info.holonomic for info in self.info], dtype=bool)
        self.angles = [k for k, info in enumerate(self.info) if info.angle]
        used = _used(symbols, residuals)
        self.motion = Motion(mechanism, frames, [*used, *(name for name in extra if name not in used)])
        self.function, self.places = _compile(symbols, residuals, self.info, self.motion.names)
        self.coefficients = np.zeros((self.count, self.motion.size))

    def evaluate(self, t: float, q: Array, v: Array, reference: Sequence[float]) -> RowValues:
        """Evaluate all rows at a state. Raises SimulationError where an equation has no finite value."""
        motion, count = self.motion, self.count
        values, rates, drifts = motion.evaluate(q, v, reference)
        answer = self.function(t, *values, *rates, *drifts)
        if not math.isfinite(sum(answer)):
            raise self._not_finite(answer)
        numbers = np.array(answer)
        z = numbers[:count]
        for k in self.angles:
            z[k] = math.remainder(answer[k], math.tau)
        self.coefficients.put(self.places, numbers[3 * count :])
        return RowValues(z, numbers[count : 2 * count], self.coefficients.dot(motion.map), numbers[2 * count : 3 * count])

    def _not_finite(self, answer: tuple[float, ...]) -> SimulationError:
        count = self.count
        bad = [k for k in range(count) if not all(map(math.isfinite, (answer[k], answer[count + k], answer[2 * count + k])))]
        named = " and ".join(repr(self.texts[k]) for k in bad) or ", ".join(map(repr, self.texts))
        return SimulationError(f"the equation {named} has no finite value here")


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


def _classify(symbols: Symbols, equation: Equation, residual: Any, key: str, ideal: bool) -> RowInfo:
    free = residual.free_symbols
    values = {symbols.value[name] for name in symbols.value}
    rates = {symbols.rate[name] for name in symbols.rate}
    if not free & (values | rates):
        raise SceneError(f"{key}: {equation.text!r} contains no coordinate or rate: nothing can make it true or false")
    holonomic = not free & rates
    turning = {symbols.value[name] for name, b in symbols.variables.items() if b.kind in ("phi", "psi", "phi0")}
    angle = holonomic and free & values <= turning and all(abs(residual.diff(s)) == 1 for s in free & values)
    azimuths = _azimuths(symbols, equation) if ideal else None
    return RowInfo(equation.text, holonomic, bool(angle), equation.names, azimuths)


def _used(symbols: Symbols, residuals: Sequence[Any]) -> list[str]:
    free = set().union(*(residual.free_symbols for residual in residuals)) if residuals else set()
    return [name for name in symbols.variables if symbols.value[name] in free or symbols.rate[name] in free]


def _compile(
    symbols: Symbols, residuals: Sequence[Any], info: Sequence[RowInfo], used: Sequence[str]
) -> tuple[Callable[..., tuple[float, ...]], NDArray[np.intp]]:
    """One scalar function of (t, b, b', drift of b) giving z, z', drift of z', and the nonzero dz'/db'."""
    sympy = symbols.sympy
    drifts = {name: sympy.Symbol(f"a{k}", real=True) for k, name in enumerate(used)}
    b, rate = symbols.value, symbols.rate
    z = [residual if row.holonomic else sympy.Integer(0) for residual, row in zip(residuals, info, strict=True)]
    speeds, drift, coefficients, places = [], [], [], []
    for k, (residual, row) in enumerate(zip(residuals, info, strict=True)):
        speed = residual
        if row.holonomic:
            speed = sum((residual.diff(b[name]) * rate[name] for name in used), residual.diff(symbols.time))
        curve = speed.diff(symbols.time)
        for j, name in enumerate(used):
            slope = speed.diff(rate[name])
            curve += speed.diff(b[name]) * rate[name] + slope * drifts[name]
            if slope != 0:
                coefficients.append(slope)
                places.append(k * len(used) + j)
        speeds.append(speed)
        drift.append(curve)
    arguments = [symbols.time, *(b[name] for name in used), *(rate[name] for name in used), *drifts.values()]
    return compile_scalar([*z, *speeds, *drift, *coefficients], arguments), np.array(places, dtype=np.intp)
