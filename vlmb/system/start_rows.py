"""Rows at the start: what was not given is moved, as little as needed, until they hold."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, SingularError
from vlmb.model.mechanism import Mechanism
from vlmb.scene.by_phase import programme_at
from vlmb.system.constrained import SIDEWAYS
from vlmb.system.frames import LinkFrames
from vlmb.system.row_sets import RowSet
from vlmb.system.start_azimuths import require_azimuths, shared_azimuths, turn_azimuths
from vlmb.system.start_search import HELD, LEAN, Posture, Search
from vlmb.system.system import System

Array = NDArray[np.float64]

LOUD = "MOVED FAR"  # before what a start says of a given value or a length that is no longer near what it was
ALIKE = 1e-5  # rows whose directions differ by less are told: a little below, the dynamics take them for one
ROUNDED, TINY = 1e-10, 1e-300  # of the largest gradient of all rates: below it is rounding


def given_values(mechanism: Mechanism) -> dict[str, float]:
    """Values of the scene's `[start]` by coordinate and rate, aliases resolved."""
    return mechanism.names.canonical(mechanism.scene.start, "start")


def row_sets(system: System, t: float = 0.0) -> list[RowSet]:
    """Return the rows of a scene that a start at t [s] is to meet: the ideal ones, then those of its programme."""
    scene, rows = system.mechanism.scene, system.constraints
    if rows is None:
        return []
    programme, frames = programme_at(scene), LinkFrames(system.mechanism)
    ideal, servo = len(scene.constraints), len(programme.constraints) if programme else 0
    made = [RowSet(rows, frames, range(ideal), True, t), RowSet(rows, frames, range(ideal, ideal + servo), False, t)]
    return [entry for entry in made if entry.numbers]


def gradients(system: System, rows: RowSet, coordinates: dict[str, float], rates: dict[str, float]) -> Array:
    """Return the rows W over v of what may move: the sideways motion of a ski and prescribed lengths are taken out."""
    jacobian = rows.values(coordinates, rates).jacobian
    jacobian[:, [at.v for at in system.prescribed]] = 0.0
    if system.mechanism.layout.edged:
        jacobian[:, SIDEWAYS] = 0.0
    return jacobian


def rank_of(system: System, rows: RowSet, coordinates: dict[str, float], rates: dict[str, float]) -> int:
    """Rank of rows on what may move."""
    jacobian = gradients(system, rows, coordinates, rates)
    sizes = np.linalg.norm(jacobian, axis=1)
    unit = jacobian[sizes > 0.0] / sizes[sizes > 0.0, None]
    return int(np.linalg.matrix_rank(unit, tol=ALIKE)) if unit.size else 0


def meet_positions(
    mechanism: Mechanism, followed: set[str], coordinates: dict[str, float], sets: list[RowSet]
) -> list[str]:
    """Solve the holonomic rows for the coordinates that were not given; then, for ideal rows, for all.

    Angles move before lengths, lengths before the place. Every attempt begins from what was given. A posture in which a length
    or a given angle has moved far is taken only if no other attempt finds one. A link at the vertical is leaned towards its
    azimuth only if no attempt finds one without.
    """
    if not any(entry.holonomic.any() for entry in sets):
        return []
    names = [name for name in mechanism.layout.names if name not in followed]
    given = given_values(mechanism)
    still = {"z"} if mechanism.layout.lifts else set()  # a ski stays on the snow, or above it
    unset = [name for name in names if name not in {*given, *still}]
    search = Search(mechanism, dict(coordinates))
    start = dict(coordinates)
    turn_azimuths(given, start, sets)
    search.given.update({name: start[name] for name in shared_azimuths(sets) - given.keys()})
    try:
        search.residual(sets, start)
    except SingularError:
        for name in unset:  # an azimuth needs a link off the pole
            if name.startswith("psi"):
                start[name] -= LEAN
    loud = {name for name in names if name in given or name.startswith("xi")}
    ideal = [entry for entry in sets if entry.ideal and entry.holonomic.any()]
    some = _stages(mechanism, unset, sets)
    found = _attempts(search, sets, some, start, loud, [] if len(sets) > len(ideal) else _stages(mechanism, names, sets))
    if found is None and ideal:
        found = _attempts(search, ideal, some, start, loud, _stages(mechanism, names, sets))
        if found is None:
            lacking = np.abs([search.residual(ideal, start), search.solve(ideal, names, start, 1)[1]])
            raise _no_posture(ideal, lacking.max(axis=0))  # where a whole search ends, at a pole, what is left may look small
    posture, leaned = found or (start, [])
    require_azimuths(posture, ideal)
    coordinates.update(posture)
    moved = [name for name in names if abs(coordinates[name] - search.given[name]) > HELD]
    adjustments = []
    for name in moved:
        far = search.far(name, coordinates[name]) if name in loud else ""
        adjustments.append(_moved(name, coordinates[name], search.given[name] if name in given else None, far))
    adjustments.sort(key=lambda text: LOUD not in text)
    adjustments += [_chose_side(mechanism, name, coordinates) for name in leaned]
    for entry in sets:
        if not entry.ideal and entry.holonomic.any():
            error = np.abs(search.residual([entry], coordinates))
            texts = [text for text, flag in zip(entry.texts, entry.holonomic, strict=True) if flag]
            off = [(text, e) for text, e in zip(texts, error, strict=True) if e > HELD]
            adjustments += [f"start: {text!r} is off by {e:.3g}; the error decays" for text, e in off]
    return adjustments


def _stages(mechanism: Mechanism, names: list[str], sets: list[RowSet]) -> list[list[str]]:
    """What moves first, and what with it if that does not do: angles, lengths, the place; a heading with it that no row names."""
    known = mechanism.names
    read = {known.find(name).kind for entry in sets for row in entry.info for name in row.names if name in known}
    place = {"x", "y", "z"} if "phi0" in read else {"x", "y", "z", "phi0"}
    inner = [name for name in names if name not in place]
    stages = ([name for name in inner if not name.startswith("xi")], inner, names)
    return [stage for at, stage in enumerate(stages) if stage and stage not in stages[:at]]


def _attempts(
    search: Search, chosen: list[RowSet], some: list[list[str]], start: Posture, loud: set[str], every: list[list[str]]
) -> tuple[Posture, list[str]] | None:
    """Return the first posture that meets the rows with nothing moved far, and the links that were leaned.

    Else the first one without a length at its limit, else the first.
    If none does, a programme has the nearest that moves no length far and holds the ideal rows; ideal rows alone have None.
    """
    if np.abs(search.residual(chosen, start)).max() <= HELD:
        return start, []
    ideal = [entry for entry in chosen if entry.ideal and entry.holonomic.any()]
    second, limited, near, least = None, False, None, math.inf
    for leaning in (False, True):
        for free in (*some, *every):
            begin = dict(start)
            leaned = search.off_poles(chosen, free, begin) if leaning else []
            if leaning and not leaned:
                continue
            posture, error = search.solve(chosen, free, begin)
            quiet = not any(search.far(name, posture[name]) for name in loud)
            if np.abs(error).max() <= HELD:
                if quiet:
                    return posture, leaned
                at_limit = search.at_limit(posture)
                if second is None or (limited and not at_limit):
                    second, limited = (posture, leaned), at_limit
                continue
            nearer = len(chosen) > len(ideal) and quiet and np.linalg.norm(error) < least * (1.0 - 1e-6)
            if nearer and (not ideal or np.abs(search.residual(ideal, posture)).max() <= HELD):
                near, least = (posture, leaned), float(np.linalg.norm(error))
    return second or near


def _chose_side(mechanism: Mechanism, psi: str, coordinates: Posture) -> str:
    phi = psi.replace("psi", "phi")
    side = "x" if mechanism.layout.plane else f"its azimuth, {phi} = {coordinates[phi]:.6g}"
    return f"start: at the vertical the equations choose no side for {psi}: the link leans towards {side}"


def _no_posture(ideal: list[RowSet], error: Array) -> SceneError:
    texts = [text for entry in ideal for text, flag in zip(entry.texts, entry.holonomic, strict=True) if flag]
    worst = " and ".join(f"{text!r} (off by {e:.3g})" for text, e in zip(texts, error, strict=True) if e > 0.1 * error.max())
    return SceneError(
        f"start: no posture near it meets the constraints {', '.join(map(repr, texts))} together: {worst}; "
        "give a start nearer to them, or drop one that contradicts another"
    )


def meet_rates(
    mechanism: Mechanism, followed: set[str], coordinates: dict[str, float], rates: dict[str, float], sets: list[RowSet]
) -> list[str]:
    """Solve z' = 0, affine in the rates, for those not given; then, for ideal rows, for all."""
    if not sets:
        return []
    layout, given = mechanism.layout, given_values(mechanism)
    along = layout.edged or (layout.lifts and not {"x_dot", "y_dot"} & given.keys())  # a ski goes along itself
    places = {"x_dot", "y_dot"} if along else set()  # the speed stands for them
    names = [name for name in rates if name.removesuffix("_dot") not in followed and name not in places]
    speed_given = any(name in given for name in ("speed", "x_dot", "y_dot"))
    if along:
        names = ["speed", *names]
    still = {"speed"} if speed_given else set()
    unset = [name for name in names if name not in {*given, *still, *(("z_dot",) if layout.lifts else ())}]
    before = dict(rates)
    cosine, sine = (math.cos(coordinates["phi0"]), math.sin(coordinates["phi0"])) if along else (0.0, 0.0)

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
        gradient = np.column_stack([residual(chosen, {name: 1.0}) - error for name in names])
        matrix = gradient[:, [names.index(name) for name in free]]
        own, full = (float(np.linalg.norm(part, 2)) for part in (matrix, gradient))
        change = -np.linalg.pinv(matrix, ROUNDED * full / max(own, TINY)) @ error  # what is rounding does not serve rows
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


def _moved(name: str, value: float, given: float | None, far: str = "") -> str:
    said = f"start: {name} = {value:.9g} so that the equations hold" + ("" if given is None else f" (given: {given:.9g})")
    return f"{said}: {LOUD}, {far}" if far else said
