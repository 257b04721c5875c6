"""Sensitivities: how histories of a run change with numbers of its scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, SimulationError, StudyError
from vlmb.model.mechanism import build
from vlmb.scene.scene import Scene, as_scene
from vlmb.simulation.simulate import sample_times
from vlmb.studies.beside import slope
from vlmb.studies.packages import need
from vlmb.studies.runs import Runs, value_at

Array = NDArray[np.float64]


def sensitivities(
    scene: Scene | str | Path | Mapping[str, Any],
    to: Sequence[str],
    of: Sequence[str],
    *,
    t_eval: Sequence[float] | Array | None = None,
) -> Any:
    """Return the derivatives of histories by numbers of a scene as an xarray.Dataset: a variable for each of `of`.

    Each has the dimensions `parameter` (the keys `to`) and t. They are differences of runs with tight tolerances, extrapolated
    to none; `attrs["error"]` is what is left, relative to the largest of a history. They go through events, breaks and switches,
    whose times change with a number as well: runs are compared event by event. At an event it is the derivative after it.

    Parameters
    ----------
    to : key paths of numbers: links.legs.lower.stiffness, parameters.k, start.psi1
    of : names of histories, as in `sweep`
    t_eval : (N,) [s]; default: the samples of the scene's run

    Raises SceneError for wrong names; StudyError for a run that ends early, for an event that grazes or comes together with
    another, by name, and where a history is no smooth function of a number.
    """
    xarray, scene = need("xarray"), as_scene(scene)
    for what, names in (("to", to), ("of", of)):
        if isinstance(names, str) or not names:
            raise SceneError(f"sensitivities: {what} = {names!r:.80}: must be a list of names")
    times = sample_times(scene.run, t_eval)
    matrix, error = derivatives(Runs(scene, to, of, times), np.array([value_at(scene, key) for key in to]))
    known = build(scene).names
    units = {name: known.find(name).unit if name in known else "" for name in of}
    dims = "parameter", "t"
    variables = {name: (dims, matrix[:, at].T, {"units": f"{units[name]} / parameter's"}) for at, name in enumerate(of)}
    return xarray.Dataset(variables, {"parameter": list(to), "t": ("t", times, {"units": "s"})}, {"error": error})


def derivatives(runs: Runs, values: Array) -> tuple[Array, float]:
    """Return the derivatives (N, names, keys) of histories at values (keys,), and their relative error."""
    try:
        middle = runs.ran(values)
    except SimulationError as ended:
        raise StudyError(f"sensitivities: {ended}") from None
    slopes = [slope(runs, values, k, middle) for k in range(len(values))]
    return np.array([found for found, _ in slopes]).transpose(2, 1, 0), max(error for _, error in slopes)
