"""Samples of a space of parameters: Sobol sequences, Latin hypercubes, independent uniform numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from vlmb.errors import SceneError, nearest
from vlmb.studies.packages import need

METHODS = ("sobol", "latin", "halton", "uniform")


def sample(method: str, ranges: Mapping[str, tuple[float, float]], *, runs: int, seed: int = 0) -> Any:
    """Return a DataFrame of `runs` points, a column for each key path, evenly spread over the ranges (low, high).

    Parameters
    ----------
    method : "sobol" (scrambled; even for powers of two), "latin" (hypercube), "halton" (scrambled) or "uniform" (independent)
    ranges : {key path: (low, high)}
    seed : the same seed gives the same points; it is in `attrs["seed"]`, and a sweep's study.json

    Raises SceneError for a wrong method, range or number, StudyError without pandas (extra `studies`).
    """
    if method not in METHODS:
        raise SceneError(f"sample: method = {method!r:.80}: no such method; {nearest(str(method), METHODS)}")
    if isinstance(runs, bool) or not isinstance(runs, (int, np.integer)) or runs < 1:
        raise SceneError(f"sample: runs = {runs!r:.80}: must be a whole number of points, 1 at least")
    if not isinstance(ranges, Mapping) or not ranges:
        raise SceneError(f"sample: ranges = {ranges!r:.80}: must be a dict of key paths and their ranges (low, high)")
    low, high = np.array([_range(key, found) for key, found in ranges.items()]).T
    points = low + (high - low) * _unit(method, len(ranges), int(runs), seed)
    frame = need("pandas").DataFrame(points, columns=list(ranges))
    frame.attrs.update(method=method, seed=seed)
    return frame


def _range(key: str, found: Any) -> tuple[float, float]:
    try:
        low, high = (float(value) for value in found)
    except (TypeError, ValueError):
        raise SceneError(f"sample: {key} = {found!r:.80}: must be a range (low, high)") from None
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise SceneError(f"sample: {key} = ({low:g}, {high:g}): must be finite, the first below the second")
    return low, high


def _unit(method: str, dimensions: int, runs: int, seed: int) -> Any:
    """Return points (runs, dimensions) of the unit cube."""
    if method == "uniform":
        return np.random.default_rng(seed).random((runs, dimensions))
    from scipy.stats import qmc

    if method == "sobol":
        exponent = max(runs - 1, 0).bit_length()
        return qmc.Sobol(dimensions, rng=np.random.default_rng(seed)).random_base2(exponent)[:runs]
    made = qmc.LatinHypercube if method == "latin" else qmc.Halton
    return made(dimensions, rng=np.random.default_rng(seed)).random(runs)
