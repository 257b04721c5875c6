"""Frozen things: arrays that nobody writes into, and objects that pickle as what they were made of."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def read_only(values: Array) -> Array:
    """Return a view of an array into which nothing can be written."""
    view = np.asarray(values).view()
    view.flags.writeable = False
    return view


class Remade:
    """A frozen dataclass that is pickled and copied by its fields alone: what it has computed since is left behind."""

    def __reduce__(self) -> tuple[Any, ...]:
        fields = dataclasses.fields(self)  # type: ignore[arg-type]
        return type(self), tuple(getattr(self, field.name) for field in fields)
