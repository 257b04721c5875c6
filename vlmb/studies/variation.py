"""What a sweep varies: a grid of values by key path, or a table with a row for each run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from vlmb.errors import SceneError
from vlmb.scene.keys import changed_data
from vlmb.scene.scene import Scene

RUN = "run"  # the dimension of a table


@dataclass(frozen=True)
class Variation:
    """The runs of a study: values of the keys, in the order of `keys`, for every run."""

    keys: tuple[str, ...]
    axes: tuple[tuple[Any, ...], ...]  # of a grid the values along each dimension; of a table its columns
    grid: bool
    seed: int | None = None  # of a sample

    def __len__(self) -> int:
        return int(np.prod([len(axis) for axis in self.axes], dtype=int)) if self.grid else len(self.axes[0])

    @property
    def shape(self) -> tuple[int, ...]:
        """Runs along each dimension."""
        return tuple(len(axis) for axis in self.axes) if self.grid else (len(self),)

    @property
    def dimensions(self) -> tuple[str, ...]:
        """The keys of a grid; `run` of a table."""
        return self.keys if self.grid else (RUN,)

    def rows(self) -> list[tuple[Any, ...]]:
        """Values of every run; of a grid the last key moves first."""
        return list(product(*self.axes)) if self.grid else list(zip(*self.axes, strict=True))

    def as_data(self) -> dict[str, Any]:
        """Return plain data for study.json."""
        return {"keys": list(self.keys), "grid": self.grid, "axes": [list(axis) for axis in self.axes], "seed": self.seed}


def variation_of(scene: Scene, vary: Any) -> Variation:
    """Read what to vary: {key path: values}, or a DataFrame with a column for each key path and a row for each run.

    Raises SceneError naming a key that leads nowhere, and values that are no list.
    """
    if isinstance(vary, Mapping):
        keys, grid, seed = list(vary), True, None
        axes = [_values(key, vary[key]) for key in keys]
    elif hasattr(vary, "columns") and hasattr(vary, "attrs"):
        keys, grid, seed = list(vary.columns), False, vary.attrs.get("seed")
        axes = [_values(str(key), vary[key].tolist()) for key in keys]
    else:
        raise SceneError(f"vary = {vary!r:.80}: must be {{key path: values}}, or a DataFrame with a column for each key path")
    if not keys:
        raise SceneError("vary: names no key; give {key path: values}, such as {'start.speed': [6.0, 7.0, 8.0]}")
    changed_data(scene, {key: axis[0] for key, axis in zip(keys, axes, strict=True)})
    return Variation(tuple(keys), tuple(axes), grid, seed)


def _values(key: str, values: Any) -> tuple[Any, ...]:
    """Return values as plain numbers, texts and lists."""
    if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, (Sequence, np.ndarray)):
        raise SceneError(f"vary: {key} = {values!r:.80}: must be a list of values")
    if not len(values):
        raise SceneError(f"vary: {key}: an empty list varies nothing")
    return tuple(value.item() if isinstance(value, np.generic) else value for value in values)
