"""Where contacts press together."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import TrajectoryError, nearest
from vlmb.system.contacts import ContactPoint, Footing

Array = NDArray[np.float64]


def contacts_named(points: Sequence[ContactPoint], names: Sequence[str]) -> list[ContactPoint]:
    """Return contacts by name, or by a pattern as "left_*". Raises TrajectoryError for names that are none."""
    known = [point for point in points if any(fnmatch.fnmatchcase(point.name, name) for name in names)]
    for name in names:
        if not any(fnmatch.fnmatchcase(point.name, name) for point in known):
            raise TrajectoryError(f"no contact {name!r:.80}; {nearest(name, [point.name for point in points])}")
    return known


def centre_of_pressure(
    points: Sequence[ContactPoint], t: Array, place_of: Callable[[ContactPoint], Array], reactions: Mapping[str, Array],
    plane: bool,
) -> Array:  # fmt: skip
    """Return where contacts press together (N, 3) [m], by their forces along their normals; nan where none does."""
    places = [place_of(point) for point in points]
    presses = []
    for point, every in zip(points, places, strict=True):
        frames = [point.frame(at, place, plane, Footing())[0] for at, place in zip(t.tolist(), every, strict=True)]
        presses.append(np.maximum(np.sum(_force(reactions[point.name], frames), axis=1), 0.0))
    total = np.sum(presses, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        found: Array = np.sum([press[:, None] * place for press, place in zip(presses, places, strict=True)], axis=0)
        return np.where(total[:, None] > 0.0, found / total[:, None], np.nan)


def _force(force: Array, frames: Sequence[Array]) -> Array:
    """Return a force (N, 3) times the normals."""
    found: Array = force * np.array([frame[2] for frame in frames])
    return found
