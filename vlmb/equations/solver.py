"""Solving equations of motion for accelerations, and naming the coordinates that cannot be solved for."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from vlmb.errors import SceneError, SingularError, finite, nearest
from vlmb.model.layout import Layout, segment_of
from vlmb.model.names import force_along

Array = NDArray[np.float64]

NEAR_POLE = 1e-6  # a cosine below which a singular matrix is blamed on an angle's pole


class Solution(NamedTuple):
    """Accelerations and the forces that come with them."""

    accelerations: Array  # (N,) in the order of `names`
    knife_edge: float | None  # [N], positive to the ski's left; the full form of a ski alone has it
    forces: dict[str, float]  # of each known acceleration, beyond the force applied: F1_1 [N], M_psi1 [N m]


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """Equations M a + h = reduce(Q) + row^T lambda, and what their names mean."""

    layout: Layout
    names: tuple[str, ...]
    mass: Array  # (N, N)
    bias: Array  # (N,)
    reduce: Callable[[Array], Array]  # forces (N_full,) of all coordinates -> (N,)
    inertias: Array  # (N,) what each coordinate's inertia is away from the poles
    coordinates: Mapping[str, float]
    edge: tuple[Array, float] | None  # knife edge: row (N,) and row @ a
    warnings: tuple[str, ...]
    still: tuple[str, ...] = ()  # coordinates that the snow holds


def condition_number(matrix: Array) -> float:
    """Condition number of a symmetric matrix: largest over smallest size of an eigenvalue; inf where it is not finite."""
    if not np.isfinite(matrix).all():
        return math.inf
    sizes = np.abs(np.linalg.eigvalsh(matrix)) if matrix.size else np.ones(1)
    return float(sizes.max() / sizes.min()) if sizes.min() > 0.0 else math.inf


def solve(system: LinearSystem, forces: ArrayLike | Mapping[str, float] | None, known: Mapping[str, float]) -> Solution:
    """Solve for the accelerations that are not known; see `EquationsOfMotion.solve`."""
    given = _known(system, known)
    free = np.array([at for at in range(len(system.names)) if at not in given], dtype=np.intp)
    accelerations = np.zeros(len(system.names))
    accelerations[list(given)] = list(given.values())
    right = _force_vector(system, forces) - system.bias
    inner = system.mass[np.ix_(free, free)]
    target = (right - system.mass @ accelerations)[free]
    edge = None
    if system.edge is None:
        accelerations[free] = _positive_solve(system, inner, free, target[:, None])[:, 0]
    else:
        row, value = system.edge[0][free], system.edge[1]
        motion, unit = _positive_solve(system, inner, free, np.column_stack([target, row])).T
        edge = float((value - row @ motion) / (row @ unit))
        accelerations[free] = motion + edge * unit
    missing = system.mass @ accelerations - right
    coordinates = {coordinate.name: coordinate for coordinate in system.layout.coordinates}
    kept = {force_along(coordinates[system.names[at]]): float(missing[at]) for at in given}
    return Solution(accelerations, edge, kept)


def _known(system: LinearSystem, known: Mapping[str, float]) -> dict[int, float]:
    """Positions among `names` and values of the known accelerations."""
    layout = system.layout
    allowed = [coordinate.name for coordinate in layout.coordinates if coordinate.kind not in "xyz"]
    given = {}
    for name, value in known.items():
        if name not in allowed:
            raise SceneError(f"known accelerations: {name!r} cannot be given; {nearest(name, allowed)}")
        given[system.names.index(name)] = finite(f"known acceleration of {name}", value)
    given |= {system.names.index(name): 0.0 for name in system.still}
    for coordinate in layout.coordinates:
        name = coordinate.name
        if coordinate.kind == "xi" and segment_of(layout, coordinate).motion == "prescribed" and name not in known:
            raise SceneError(
                f"{name} of {layout.links[coordinate.link].name!r} is prescribed: give its acceleration [m/s^2], "
                f"known={{{name!r}: ...}}; the force that it takes is part of the result"
            )
    return given


def _force_vector(system: LinearSystem, forces: ArrayLike | Mapping[str, float] | None) -> Array:
    """Generalized forces (N,) in the order of `names`."""
    layout, size = system.layout, len(system.names)
    if forces is None:
        return np.zeros(size)
    if isinstance(forces, Mapping):
        places = {force_along(coordinate): at for at, coordinate in enumerate(layout.coordinates)} | layout.index
        full = np.zeros(len(layout.names))
        for name, value in forces.items():
            if name not in places:
                raise SceneError(f"unknown force {name!r}; {nearest(name, places)}")
            full[places[name]] += finite(f"the force {name}", value)
        return system.reduce(full)
    try:
        vector = np.asarray(forces, dtype=float)
    except (TypeError, ValueError):
        raise SceneError(f"generalized forces {forces!r}: must be numbers") from None
    if vector.shape != (size,):
        raise SceneError(f"generalized forces: shape {vector.shape}, must be ({size},): {', '.join(system.names)}")
    bad = [system.names[at] for at in np.flatnonzero(~np.isfinite(vector))]
    if bad:
        raise SceneError(f"the generalized force of {', '.join(bad)} is not finite")
    return vector


def _positive_solve(system: LinearSystem, matrix: Array, free: NDArray[np.intp], columns: Array) -> Array:
    """Solve for the free coordinates (N, k) with a positive definite matrix, scaled to a unit diagonal.

    Refuses a motion whose inertia cannot be told from rounding. Inertias are compared with what they are away from the poles:
    an azimuth's with its elevation's, x with the whole mass.
    """
    if not np.isfinite(matrix).all():
        raise SingularError("the mass matrix is not finite at this posture: an angle or length is too large")
    if not matrix.size:
        return np.zeros(columns.shape)
    scale = 1.0 / np.sqrt(np.maximum(system.inertias[free], 1e-300))
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    weak = values <= 4.0 * math.sqrt(len(free)) * np.finfo(float).eps * values[-1]
    if weak.any():
        raise _singular(system, free, np.abs(vectors[:, weak]).max(axis=1))
    scale = 1.0 / np.sqrt(np.diag(matrix))
    _, answer, info = scipy.linalg.lapack.dposv(matrix * np.outer(scale, scale), columns * scale[:, None])
    if info:
        raise _singular(system, free, np.abs(vectors[:, 0]))
    value: Array = answer * scale[:, None]
    return value


def _singular(system: LinearSystem, free: NDArray[np.intp], motion: Array) -> SingularError:
    """Name the coordinates of a motion without inertia."""
    moving = [system.names[free[at]] for at in np.flatnonzero(motion > 0.1 * motion.max())]
    if _across(system):
        moving = ["x"]
    shown = ", ".join(_owned(system.layout, name) for name in moving[:8]) + (", ..." if len(moving) > 8 else "")
    return SingularError(
        f"the mass matrix in the paper's coordinates is singular (condition {condition_number(system.mass):.1e}) and cannot be "
        f"solved for the acceleration of {shown}: {_advice(system, moving)}"
    )


def _across(system: LinearSystem) -> bool:
    """Whether the form is Chaplygin's and the ski points across x, where x does not describe its motion."""
    return "x" in system.names and "y" not in system.names and abs(math.cos(system.coordinates["phi0"])) < NEAR_POLE


def _advice(system: LinearSystem, moving: list[str]) -> str:
    """Say which pole or alignment makes the matrix singular, and what to use instead."""
    layout, at = system.layout, system.coordinates
    poles = [f"psi{i + 1}" for i in range(len(layout.links)) if abs(math.cos(at[f"psi{i + 1}"])) < NEAR_POLE]
    advice = []
    if _across(system):
        advice.append("the ski points across x, where the chaplygin form fails; use form='speed' or form='full'")
    if poles and any(name.startswith("phi") for name in moving):
        advice.append(f"{', '.join(poles[:8])} at 90 deg, where a link has no azimuth; the state (q, v) has no such pole")
    if any(name.startswith("xi") for name in moving):
        advice += system.warnings[:2] or ["lengths along one line; fix a segment or give the hinge between them a mass"]
    return "; ".join(advice) or "a motion of theirs has no inertia that could be told from rounding"


def _owned(layout: Layout, name: str) -> str:
    at = layout.index.get(name)
    link = layout.coordinates[at].link if at is not None else -1
    return f"{name} of {layout.links[link].name!r}" if link >= 0 else name
