"""Rows at the start: what was not given is moved, as little as needed, until they hold."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, SimulationError, SingularError
from vlmb.model.mechanism import Mechanism
from vlmb.system.constrained import SIDEWAYS
from vlmb.system.constraints import Constraint, ConstraintSet, RowValues
from vlmb.system.frames import LinkFrames
from vlmb.system.system import System

Array = NDArray[np.float64]

HELD = 1e-9  # a residual below this counts as zero
ITERATIONS, NUDGE = 60, 1e-6
ALIKE = 1e-5  # rows whose directions differ by less are told: a little below, the dynamics take them for one
FAR = 1.0  # [rad] between two azimuths that shall be equal
LEAN = 0.3  # [rad] where the search begins for a link whose azimuth matters and whose elevation is not given


class RowSet(NamedTuple):
    """Some rows of a scene, and the frames they are evaluated in."""

    rows: ConstraintSet
    frames: LinkFrames
    numbers: range  # which rows
    ideal: bool
    t: float = 0.0  # [s]

    @property
    def info(self) -> list[Constraint]:
        """What is known of each."""
        return [self.rows.info[k] for k in self.numbers]

    @property
    def texts(self) -> list[str]:
        """Their equations."""
        return [row.text for row in self.info]

    @property
    def holonomic(self) -> NDArray[np.bool_]:
        """Which are rows of positions."""
        return np.array([row.holonomic for row in self.info], dtype=bool)

    def at(self, q: Array, v: Array, branch: Sequence[float]) -> RowValues:
        """Evaluate them at a state."""
        self.frames.update(q)
        return self.rows.evaluate(self.frames, self.t, q, v, branch, self.numbers)

    def values(self, coordinates: dict[str, float], rates: dict[str, float]) -> RowValues:
        """Evaluate them at a posture given by names."""
        q, v = self.frames.mechanism.state(coordinates, rates)
        return self.at(q, v, [coordinates[name] for name in self.frames.layout.names])


def given_values(mechanism: Mechanism) -> dict[str, float]:
    """Values of the scene's `[start]` by coordinate and rate, aliases resolved."""
    return mechanism.names.canonical(mechanism.scene.start, "start")


def _equated_azimuths(sets: list[RowSet]) -> list[tuple[str, str]]:
    """Pairs of azimuths that ideal rows such as `phi1 = phi0` equate."""
    return [row.azimuths for entry in sets if entry.ideal for row in entry.info if row.azimuths]


def share_azimuths(mechanism: Mechanism, coordinates: dict[str, float], sets: list[RowSet]) -> None:
    """Give an unset azimuth the value of the one an ideal row equates it with: at the pole the row alone cannot."""
    given = given_values(mechanism)
    for pair in _equated_azimuths(sets):
        for name, other in (pair, pair[::-1]):
            if name not in given and other in given:
                coordinates[name] = coordinates[other]


def row_sets(system: System, t: float = 0.0) -> list[RowSet]:
    """Return the rows of a scene that a start at t [s] is to meet: the ideal ones, then those of its programme."""
    scene, frames = system.mechanism.scene, LinkFrames(system.mechanism)
    ideal, servo = len(scene.constraints), len(scene.programme.constraints) if scene.programme else 0
    rows = system.constraints
    if rows is None:
        return []
    made = [RowSet(rows, frames, range(ideal), True, t), RowSet(rows, frames, range(ideal, ideal + servo), False, t)]
    return [entry for entry in made if entry.numbers]


def rank_of(system: System, rows: RowSet, coordinates: dict[str, float], rates: dict[str, float]) -> int:
    """Rank of rows on what may move: the sideways motion of a ski and prescribed lengths are taken out."""
    jacobian = rows.values(coordinates, rates).jacobian
    jacobian[:, [at.v for at in system.prescribed]] = 0.0
    if system.mechanism.layout.base == "ski":
        jacobian[:, SIDEWAYS] = 0.0
    sizes = np.linalg.norm(jacobian, axis=1)
    unit = jacobian[sizes > 0.0] / sizes[sizes > 0.0, None]
    return int(np.linalg.matrix_rank(unit, tol=ALIKE)) if unit.size else 0


def _bring_azimuths_near(coordinates: dict[str, float], sets: list[RowSet]) -> None:
    """Move azimuths that an ideal row equates halfway to each other, where a search from so far apart may end elsewhere."""
    for first, second in _equated_azimuths(sets):
        gap = math.remainder(coordinates[first] - coordinates[second], math.tau)
        if abs(gap) > FAR:
            coordinates[first] -= 0.5 * gap
            coordinates[second] += 0.5 * gap


def meet_positions(
    mechanism: Mechanism, followed: set[str], coordinates: dict[str, float], sets: list[RowSet]
) -> list[str]:
    """Solve the holonomic rows for the coordinates that were not given; then, for ideal rows, for all."""
    if not any(entry.holonomic.any() for entry in sets):
        return []
    names = [name for name in mechanism.layout.names if name not in followed]
    unset = [name for name in names if name not in given_values(mechanism)]
    before = dict(coordinates)
    _bring_azimuths_near(coordinates, sets)

    def residual(chosen: list[RowSet]) -> Array:
        parts = [entry.values(coordinates, {}).z[entry.holonomic] for entry in chosen]
        return np.concatenate(parts)

    try:
        residual(sets)
    except SingularError:
        for name in unset:  # an azimuth needs a link off the pole
            if name.startswith("psi"):
                coordinates[name] -= LEAN
    for free in ([name for name in unset if name not in "xyz"], unset):  # the place moves only if nothing else can
        if free and np.abs(residual(sets)).max() > HELD:
            _solve(mechanism, coordinates, free, lambda: residual(sets))
    ideal = [entry for entry in sets if entry.ideal]
    if ideal and np.abs(residual(ideal)).max(initial=0.0) > HELD:
        least = np.abs(residual(ideal))  # what is left may look small where the search ends, at a pole
        _solve(mechanism, coordinates, names, lambda: residual(ideal))
        if np.abs(residual(ideal)).max() > HELD:
            texts = [text for entry in ideal for text, flag in zip(entry.texts, entry.holonomic, strict=True) if flag]
            off = [(text, e) for text, e in zip(texts, least, strict=True) if e > 0.1 * least.max()]
            worst = " and ".join(f"{text!r} (off by {e:.3g})" for text, e in off)
            raise SceneError(
                f"start: no posture near it meets the constraints {', '.join(map(repr, texts))} together: {worst}; "
                "give a start nearer to them, or drop one that contradicts another"
            )
    adjustments = [
        _moved(name, coordinates[name], None if name in unset else before[name])
        for name in names
        if abs(coordinates[name] - before[name]) > HELD
    ]
    servo = [entry for entry in sets if not entry.ideal]
    if servo:
        error = np.abs(residual(servo))
        texts = [text for entry in servo for text, flag in zip(entry.texts, entry.holonomic, strict=True) if flag]
        off = [(text, e) for text, e in zip(texts, error, strict=True) if e > HELD]
        adjustments += [f"start: {text!r} is off by {e:.3g}; the error decays" for text, e in off]
    return adjustments


def _solve(mechanism: Mechanism, coordinates: dict[str, float], names: list[str], residual: Callable[[], Array]) -> None:
    """Move named coordinates as little as needed to make a residual zero: Gauss-Newton of least norm, shortened where needed."""
    lengths = [c for c in mechanism.layout.coordinates if c.kind == "xi"]
    bounds = {c.name: mechanism.segment(c).bounds for c in lengths}

    def at(point: Array) -> Array:
        for name, value in zip(names, point.tolist(), strict=True):
            low, high = bounds.get(name, (-math.inf, math.inf))
            coordinates[name] = min(max(value, low), high)
        try:
            return residual()
        except (SingularError, SimulationError):
            return error * 10.0

    point = np.array([coordinates[name] for name in names])
    error = residual()
    for _ in range(ITERATIONS):
        size = float(np.linalg.norm(error))
        if size < 1e-14:
            break
        matrix = np.column_stack([(at(point + h) - at(point - h)) / (2.0 * NUDGE) for h in NUDGE * np.eye(len(names))])
        step = np.linalg.lstsq(matrix, -error, rcond=1e-8)[0]
        for share in (1.0, 0.5, 0.25, 0.1, 0.02):
            trial = at(point + share * step)
            if np.linalg.norm(trial) < size:
                point, error = np.array([coordinates[name] for name in names]), trial
                break
        else:
            break
    at(point)


def meet_rates(
    mechanism: Mechanism, followed: set[str], coordinates: dict[str, float], rates: dict[str, float], sets: list[RowSet]
) -> list[str]:
    """Solve z' = 0, affine in the rates, for those not given; then, for ideal rows, for all."""
    if not sets:
        return []
    layout, given = mechanism.layout, given_values(mechanism)
    places = {"x_dot", "y_dot"} if layout.base == "ski" else set()  # the speed stands for them
    names = [name for name in rates if name.removesuffix("_dot") not in followed and name not in places]
    speed_given = any(name in given for name in ("speed", "x_dot", "y_dot"))
    if layout.base == "ski":
        names = ["speed", *names]
    unset = [name for name in names if name not in given and not (name == "speed" and speed_given)]
    before = dict(rates)
    cosine, sine = (math.cos(coordinates["phi0"]), math.sin(coordinates["phi0"])) if layout.base == "ski" else (0.0, 0.0)

    def moved(changes: dict[str, float]) -> dict[str, float]:
        result = dict(rates)
        for name, change in changes.items():
            if name == "speed":
                result["x_dot"] += change * cosine
                result["y_dot"] += change * sine
            else:
                result[name] += change
        return result

    def residual(chosen: list[RowSet], changes: dict[str, float]) -> Array:
        return np.concatenate([entry.values(coordinates, moved(changes)).rate for entry in chosen])

    for chosen, free in ((sets, unset), ([entry for entry in sets if entry.ideal], names)):
        if not chosen or not free:
            continue
        error = residual(chosen, {})
        if np.abs(error).max(initial=0.0) <= HELD:
            continue
        matrix = np.column_stack([residual(chosen, {name: 1.0}) - error for name in free])
        change = -np.linalg.lstsq(matrix, error, rcond=1e-10)[0]
        rates.update(moved(dict(zip(free, change.tolist(), strict=True))))
    ideal = [entry for entry in sets if entry.ideal]
    if ideal and np.abs(residual(ideal, {})).max() > 1e-7:
        texts = [text for entry in ideal for text in entry.texts]
        errors = np.abs(residual(ideal, {}))
        worst = " and ".join(repr(text) for text, e in zip(texts, errors, strict=True) if e > 0.1 * errors.max())
        raise SceneError(f"start: no rates meet the constraint {worst} at this posture; give other start values")
    adjustments = [
        _moved(name, rates[name], before[name] if name in given else None)
        for name in rates
        if abs(rates[name] - before[name]) > HELD
    ]
    for entry in sets:
        if not entry.ideal:
            values = entry.values(coordinates, rates).rate
            off = [(text, e) for text, e in zip(entry.texts, values, strict=True) if abs(e) > HELD]
            adjustments += [f"start: the rate of {text!r} is off by {e:.3g}; the error decays" for text, e in off]
    return adjustments


def _moved(name: str, value: float, given: float | None) -> str:
    return f"start: {name} = {value:.9g} so that the equations hold" + ("" if given is None else f" (given: {given:.9g})")
