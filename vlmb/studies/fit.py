"""Fits: numbers of a scene from a measured motion, with their intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, SimulationError, StudyError, finite
from vlmb.scene.names import listed
from vlmb.scene.scene import Scene, as_scene
from vlmb.simulation.trajectory import Trajectory
from vlmb.studies.runs import Runs, value_at
from vlmb.studies.sensitivities import derivatives

Array = NDArray[np.float64]

LEVEL = 0.95  # of the intervals
LOST = 1e4  # residual, in sigmas, of a run that ends before the last sample
NUDGE = 1e-4  # of a range, for the derivatives on the way: runs are exact to 1e-12


@dataclass(frozen=True, eq=False)
class Fit:
    """What fits: `values` by key, 95 % `intervals`, `residuals` (measured less computed) as the data, the `trajectory`.

    `correlation` (keys, keys) tells which numbers the data hardly tell apart; `sigma` is by column, estimated where not given.
    """

    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    residuals: Any
    trajectory: Trajectory
    correlation: Array
    sigma: dict[str, float]
    evaluations: int
    message: str

    @property
    def scene(self) -> Scene:
        """The scene with the fitted values."""
        return self.trajectory.scene

    def __repr__(self) -> str:
        shown = [f"{key} = {value:.6g} ({low:.6g} to {high:.6g})" for (key, value), (low, high) in
                 zip(self.values.items(), self.intervals.values(), strict=True)]  # fmt: skip
        return f"<Fit: {listed(shown)}; {self.message}>"


def fit(
    scene: Scene | str | Path | Mapping[str, Any],
    free: Mapping[str, tuple[float, float]],
    data: Any,
    sigma: Mapping[str, float] | None = None,
) -> Fit:
    """Find numbers of a scene by least squares, so that its run is nearest to measured histories.

    The search begins at the scene's own values. Tolerances and steps of derivatives are the fit's business: runs are exact to
    1e-12 whatever [run] says.

    Parameters
    ----------
    free : {key path: (low, high)}
    data : a DataFrame whose index is t [s] and whose columns are names of histories, nan where a sample is missing, as
        `trajectory.to_pandas()` gives it
    sigma : {column: standard deviation}; without it that of the residuals, the same for all columns

    Raises SceneError for wrong keys and data, StudyError where the data do not determine the numbers.
    """
    from scipy.optimize import least_squares
    from scipy.stats import norm, t

    scene = as_scene(scene)
    times, names, measured = _measured(data)
    low, high = _bounds(free)
    begin = np.clip([value_at(scene, key) for key in free], low + 1e-3 * (high - low), high - 1e-3 * (high - low))
    weights = _weights(names, sigma)
    known = np.isfinite(measured)
    runs = Runs(scene, list(free), names, times)
    count = 0

    def residual(z: Array) -> Array:
        nonlocal count
        count += 1
        try:
            off = (runs.histories(low + (high - low) * z) - measured) / weights[:, None]
        except SimulationError:
            return np.full(int(known.sum()), LOST)
        return np.asarray(off[known])

    def slopes(z: Array) -> Array:
        nudges = NUDGE * np.eye(len(z))
        return np.array([(residual(z + nudge) - residual(z - nudge)) / (2.0 * NUDGE) for nudge in nudges]).T

    found = least_squares(
        residual, (begin - low) / (high - low), slopes, (0.0, 1.0), xtol=1e-12, ftol=1e-14, gtol=1e-14, max_nfev=200
    )
    values = low + (high - low) * found.x
    matrix = derivatives(runs, values)[0]  # (N, names, keys)
    weighted = (np.moveaxis(matrix, 0, 1) / weights[:, None, None])[known]
    sizes = np.linalg.norm(weighted, axis=0)
    unit = weighted / np.where(sizes > 0.0, sizes, 1.0)
    if not (sizes > 0.0).all() or np.linalg.matrix_rank(unit, tol=1e-7) < len(free):
        names_of = " and ".join(_untold(list(free), unit, sizes))
        raise StudyError(f"fit: the data do not depend on {names_of}, or do not tell them apart")
    inverse = np.linalg.inv(unit.T @ unit)
    freedom = int(known.sum()) - len(free)
    if freedom < 1:
        raise StudyError(f"fit: {int(known.sum())} samples for {len(free)} numbers; more are needed")
    off = residual(found.x)
    scatter = 1.0 if sigma is not None else math.sqrt(float(off @ off) / freedom)
    spread = scatter * np.sqrt(np.diag(inverse)) / sizes
    half = spread * float((norm if sigma is not None else t(freedom)).ppf(0.5 + 0.5 * LEVEL))
    trajectory = runs.trajectory(values)
    at_edge = [key for key, z in zip(free, found.x, strict=True) if not 1e-6 < z < 1.0 - 1e-6]
    message = found.message + (f" At a bound: {', '.join(at_edge)}." if at_edge else "")
    left = measured - runs.histories(values)
    frame = type(data)(left.T, index=data.index, columns=list(names))
    own = np.sqrt(np.diag(inverse))
    return Fit(
        dict(zip(free, values.tolist(), strict=True)),
        {key: (v - h, v + h) for key, v, h in zip(free, values.tolist(), half.tolist(), strict=True)},
        frame, trajectory, inverse / np.outer(own, own),
        {name: scatter * float(weight) for name, weight in zip(names, weights, strict=True)}, count, message,
    )  # fmt: skip


def _measured(data: Any) -> tuple[Array, tuple[str, ...], Array]:
    """Return times (N,), names, and histories (names, N) of a DataFrame."""
    if not (hasattr(data, "columns") and hasattr(data, "index")):
        raise SceneError(f"fit: data = {data!r:.80}: must be a DataFrame over t [s] with a column for each history")
    times, values = np.asarray(data.index, float), np.asarray(data, float).T
    if len(times) < 2 or not np.isfinite(times).all() or (np.diff(times) <= 0.0).any() or times[0] < 0.0:
        raise SceneError("fit: data: its index must be times [s] that ascend from 0 on")
    return times, tuple(map(str, data.columns)), values


def _bounds(free: Mapping[str, tuple[float, float]]) -> tuple[Array, Array]:
    if not isinstance(free, Mapping) or not free:
        raise SceneError(f"fit: free = {free!r:.80}: must be {{key path: (low, high)}}")
    found = np.array([[finite(f"fit: {key}", value) for value in bounds] for key, bounds in free.items()])
    if found.shape[1:] != (2,) or not (found[:, 0] < found[:, 1]).all():
        raise SceneError("fit: free: every key needs bounds (low, high), the first below the second")
    return found[:, 0], found[:, 1]


def _weights(names: tuple[str, ...], sigma: Mapping[str, float] | None) -> Array:
    if sigma is None:
        return np.ones(len(names))
    missing = [name for name in names if name not in sigma]
    if missing:
        raise SceneError(f"fit: sigma: has no {', '.join(missing)}; give the standard deviation of every column")
    found = np.array([finite(f"fit: sigma: {name}", sigma[name]) for name in names])
    if not (found > 0.0).all():
        raise SceneError("fit: sigma: standard deviations must be positive")
    return found


def _untold(keys: list[str], unit: Array, sizes: Array) -> list[str]:
    """Return the keys that the data do not determine."""
    if not (sizes > 0.0).all():
        return [key for key, size in zip(keys, sizes, strict=True) if not size > 0.0]
    weakest = np.abs(np.linalg.svd(unit)[2][-1])
    return [key for key, share in zip(keys, weakest, strict=True) if share > 0.1 * weakest.max()]
