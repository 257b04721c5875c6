"""Gains of the perturbation equations (5.5), and whether a step is small enough for them (paper.md 5b).

dz/dt = z', dz'/dt = H z + K z': with Z = (z, z') the matrix P = [[0, (I 0)], [H, K]]. Entries of H and K, weights and u0 with its
border may be expressions of the motion.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, SimulationError
from vlmb.scene.by_phase import keyed
from vlmb.scene.expressions import Expression, evaluate, parse
from vlmb.scene.tables import DEFAULT_STEP, FIXED_STEP, Programme, Run

Array = NDArray[np.float64]

Numbers = Mapping[str, float]
NOTHING: Numbers = MappingProxyType({})

AUTO_RATIO = 3.0  # gains = "auto": this many times faster than the motion itself
AUTO_STEP = 0.5  # and never faster than this over the step of a fixed-step method


class Entry(NamedTuple):
    """An entry of `h`, `k` or a weight that the motion gives."""

    kind: str  # h, k, weights, force
    row: int  # -1 of a weight; of a force among the rows of the programme and the secondary ones
    column: int  # of a weight: which control; of a force: which ideal row; else counted from the first row of its programme
    law: Expression
    first: int = 0  # row of its programme, where several are united


@dataclass(frozen=True)
class MovingGains:
    """What of a programme the motion gives: u0, entries of h and k, weights, factors of forces, and the border of (5.6)."""

    free: Expression | None = None
    entries: tuple[Entry, ...] = ()
    border: tuple[tuple[Expression, ...], ...] = ()

    @cached_property
    def laws(self) -> tuple[Expression, ...]:
        """All of them: u0, entries, the border by rows."""
        free = () if self.free is None else (self.free,)
        return (*free, *(entry.law for entry in self.entries), *(law for row in self.border for law in row))

    @property
    def first_entry(self) -> int:
        """Place of the first entry among the laws."""
        return int(self.free is not None)

    def failure(self, which: int, value: float, reach: str = "") -> SimulationError:
        """Make the error of a law, by its place, without a value that serves."""
        law, entry = self.laws[which], which - self.first_entry
        if 0 <= entry < len(self.entries) and self.entries[entry].kind == "weights" and value <= 0.0:
            return SimulationError(f"{law.key} = {law.text!r} is {value:g} here: a weight is above 0; change its law")
        return SimulationError(f"{law.key} = {law.text!r} has no finite value here{reach}")


def moving_gains(programme: Programme, controls: Sequence[str], allowed: Collection[str], parameters: Numbers) -> MovingGains:
    """Read what of a programme depends on the motion or on time. Raises ExpressionError, SceneError."""
    entries, first = list[Entry](), 0
    for key, part in keyed(programme):
        for kind, matrix in (("h", part.h), ("k", part.k)):
            for i, row in enumerate(matrix or ()):
                for j, text in enumerate(row):
                    law = parse(text, f"{key}.{kind}[{i}][{j}]", allowed)
                    if law.names - parameters.keys():
                        entries.append(Entry(kind, first + i, j, law, first))
        first += len(part.constraints)
    for name, text in programme.weights.items():
        law = parse(text, f"programme.weights.{name}", allowed)
        if law.names - parameters.keys() and name in controls:
            entries.append(Entry("weights", -1, controls.index(name), law))
    free = None if programme.u0 is None else parse(programme.u0, "programme.u0", allowed)
    border = tuple(
        tuple(parse(text, f"programme.border[{i}][{j}]", allowed) for j, text in enumerate(row))
        for i, row in enumerate(programme.border)
    )
    return MovingGains(free, tuple(entries), border)


def fixed_number(text: float | str, key: str, parameters: Numbers) -> float | None:
    """Return the value of an entry of parameters alone; None for one that the motion gives."""
    law = parse(text, key)
    return None if law.names - parameters.keys() else evaluate(law, parameters)


def gain_matrices(
    programme: Programme, holonomic: Sequence[bool], own_rate: float, step: float | None, parameters: Numbers = NOTHING
) -> tuple[Array, Array]:
    """Return H (r, m) and K (r, r) of (5.5); columns of H are the holonomic rows in order, entries that vary are 0.

    frequency w and damping ratio d: h = -w^2, k = -2 d w for a holonomic row, k = -w for a velocity row.
    `own_rate` [rad/s] is the motion's own, for gains = "auto". gains = "none": H = K = 0. Raises SceneError.
    """
    count, positions = len(holonomic), [k for k, flag in enumerate(holonomic) if flag]
    if programme.h is not None or programme.k is not None:
        return _explicit(programme, count, len(positions), parameters)
    if programme.gains is not None and programme.frequency is not None:
        raise SceneError(f"programme: gains = {programme.gains!r} and frequency exclude each other; remove one")
    if programme.gains == "none":
        return np.zeros((count, len(positions))), np.zeros((count, count))
    if programme.gains == "auto":
        limit = math.inf if step is None else AUTO_STEP / step
        frequency = np.full(count, min(AUTO_RATIO * own_rate, limit))
    elif programme.frequency is None:
        raise SceneError('programme: give frequency [rad/s], or gains = "auto", or h and k, or gains = "none"')
    else:
        frequency = _per_row(programme.frequency, count, "frequency")
    damping = _per_row(programme.damping_ratio, count, "damping_ratio")
    h, k = np.zeros((count, len(positions))), np.zeros((count, count))
    for row in range(count):
        if holonomic[row]:
            h[row, positions.index(row)] = -(frequency[row] ** 2)
            k[row, row] = -2.0 * damping[row] * frequency[row]
        else:
            k[row, row] = -frequency[row]
    return h, k


def _explicit(programme: Programme, count: int, holonomic: int, parameters: Numbers) -> tuple[Array, Array]:
    if programme.frequency is not None or programme.gains is not None:
        raise SceneError("programme: give either h and k, or frequency, or gains")
    h, k = (_fixed(matrix, f"programme.{key}", parameters) for key, matrix in (("h", programme.h), ("k", programme.k)))
    if holonomic == 0 and any(isinstance(text, str) for row in programme.h or () for text in row):
        raise SceneError("programme.h: its columns are the rows of positions, and there is none; drop it, gains of rates are `k`")
    h = np.zeros((count, holonomic)) if not programme.h or holonomic == 0 else h
    k = np.zeros((count, count)) if not programme.k else k
    if h.shape != (count, holonomic) or k.shape != (count, count):
        raise SceneError(
            f"programme: h must be {count} x {holonomic} (rows x holonomic rows) and k {count} x {count}; "
            f"found {h.shape} and {k.shape}"
        )
    return h, k


def _fixed(matrix: Sequence[Sequence[float | str]] | None, key: str, parameters: Numbers) -> Array:
    """Return a matrix with 0 where the motion gives an entry. Raises SceneError for rows of different lengths."""
    rows = [
        [fixed_number(text, f"{key}[{i}][{j}]", parameters) or 0.0 for j, text in enumerate(row)]
        for i, row in enumerate(matrix or ())
    ]
    if len({len(row) for row in rows}) > 1:
        raise SceneError(f"{key}: its rows have {', '.join(str(len(row)) for row in rows)} entries; give as many in each")
    return np.array(rows, float)


def _per_row(value: float | Sequence[float], count: int, key: str) -> Array:
    values = np.atleast_1d(np.array(value, dtype=float))
    if len(values) == 1:
        values = np.repeat(values, count)
    if len(values) != count:
        raise SceneError(f"programme.{key}: {len(values)} values for {count} rows; give one, or one each")
    return values


def perturbation_matrix(h: Array, k: Array, holonomic: Sequence[bool]) -> Array:
    """Return P (m + r, m + r) of dZ/dt = P Z."""
    count, positions = len(k), [row for row, flag in enumerate(holonomic) if flag]
    size = len(positions)
    matrix = np.zeros((size + count, size + count))
    for column, row in enumerate(positions):
        matrix[column, size + row] = 1.0
    matrix[size:, :size], matrix[size:, size:] = h, k
    return matrix


def largest_stable_step(eigenvalues: NDArray[np.complex128], method: str) -> float:
    """Largest step [s] for which a fixed-step method damps every mode; 0 if none does, inf for an adaptive method.

    Euler: tau < -2 Re(lambda) / |lambda|^2, for a holonomic row the same as k < tau h, 4 + 2 tau k - tau^2 h > 0.
    """
    if method not in ("euler", "rk4"):
        return math.inf  # adaptive, or Gauss: stable at every step
    if (eigenvalues.real >= 0.0).any():
        return 0.0
    if method == "euler":
        return float((-2.0 * eigenvalues.real / np.abs(eigenvalues) ** 2).min())
    return min(_rk4_limit(complex(value)) for value in eigenvalues)


def _rk4_limit(value: complex) -> float:
    """Step at which |R(tau lambda)| = 1 for the classical method, R(z) = 1 + z + z^2/2 + z^3/6 + z^4/24."""

    def growth(tau: float) -> float:
        z = tau * value
        return abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24)

    low, high = 0.0, 1e-3 / abs(value)
    while growth(high) < 1.0 and high * abs(value) < 10.0:
        low, high = high, high * 1.05
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if growth(middle) < 1.0 else (low, middle)
    return low


def require_decay(run: Run) -> None:
    """Refuse a gain under which errors of ideal rows would grow at the step of a fixed-step method."""
    if not run.gain > 0.0 or run.method not in FIXED_STEP:
        return
    limit, step = largest_stable_step(np.array([-run.gain], dtype=complex), run.method), run.step or DEFAULT_STEP
    if step >= limit:
        raise SceneError(
            f"run.gain = {run.gain:g} 1/s: with method {run.method!r} errors of ideal rows grow at step "
            f"{step:g} s; the largest stable step is {limit:.6g} s: reduce gain or step"
        )


VARY = "gains vary with the motion: no decay of errors is promised"


def stability_report(h: Array, k: Array, holonomic: Sequence[bool], method: str, step: float, gains: str | None = None) -> str:
    """Say how errors decay under constant gains; SceneError with the largest stable step where they would grow.

    Not for gains = "none".
    """
    if gains == "none":
        return "no stabilization: errors of the start and of the method stay, and those of rates add up"
    eigenvalues = np.linalg.eigvals(perturbation_matrix(h, k, holonomic)).astype(complex)
    if (eigenvalues.real >= 0.0).any():
        worst = eigenvalues[np.argmax(eigenvalues.real)]
        raise SceneError(
            f"programme: the perturbation equations are not stable (eigenvalue {worst:.4g}): errors of the constraints would not "
            "decay; every holonomic row needs h < 0 and k < 0, every velocity row k < 0; or run without any: gains = 'none'"
        )
    limit = largest_stable_step(eigenvalues, method)
    if step >= limit:
        raise SceneError(
            f"programme: with method {method!r} the constraint errors grow at step {step:g} s; the largest stable step is "
            f"{limit:.6g} s (4 + 2 tau k - tau^2 h > 0 and k < tau h for Euler): reduce run.step or the gains"
        )
    slowest = float(-eigenvalues.real.max())
    step_limit = f"; largest stable step {limit:.4g} s" if math.isfinite(limit) else ""
    return f"errors decay at least as exp(-{slowest:.4g} t){step_limit}"
