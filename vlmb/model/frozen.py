"""Frozen things: arrays that nobody writes into, and objects that pickle as what they were made of."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Frozen = TypeVar("Frozen")
Arrays = TypeVar("Arrays", bound=tuple[Any, ...])


def read_only(values: Array) -> Array:
    """Return a view of an array into which nothing can be written."""
    view = np.asarray(values)[...]
    view.setflags(write=False)
    return view


def copied(what: Frozen, **values: Any) -> Frozen:
    """Return a frozen dataclass with other values of some fields, and what it has computed since, which these do not change."""
    made = object.__new__(type(what))
    made.__dict__.update(what.__dict__, **values)
    return made


def fresh(arrays: Arrays) -> Arrays:
    """Return copies of the arrays in a named tuple, and in those within it; one that holds no numbers serves all."""
    return arrays._make([_fresh(part) for part in arrays])  # type: ignore[attr-defined]


def _fresh(part: Any) -> Any:
    return fresh(part) if type(part) is not np.ndarray else part.copy() if part.size else part


class Remade:
    """A frozen dataclass that is pickled and copied by its fields alone: what it has computed since is left behind."""

    def __reduce__(self) -> tuple[Any, ...]:
        fields = dataclasses.fields(self)  # type: ignore[arg-type]
        return type(self), tuple(getattr(self, field.name) for field in fields)
