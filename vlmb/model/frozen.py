"""Frozen things: arrays that nobody writes into, and objects that pickle as what they were made of."""

from __future__ import annotations

import dataclasses
from typing import Any, Generic, TypeVar

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


class Blank(Generic[Arrays]):
    """A named tuple of arrays, and of such tuples, that is copied again and again; what holds no numbers serves all copies."""

    def __init__(self, arrays: Arrays) -> None:
        self.arrays, self.parts = arrays, [at for at, part in enumerate(arrays) if _holds_numbers(part)]

    def copy(self) -> Arrays:
        """Return a copy whose arrays may be written into."""
        found = list(self.arrays)
        for at in self.parts:
            found[at] = _copy(found[at])
        return self.arrays._make(found)  # type: ignore[attr-defined]


def _holds_numbers(part: Any) -> bool:
    return part.size > 0 if isinstance(part, np.ndarray) else any(map(_holds_numbers, part))


def _copy(part: Any) -> Any:
    return part.copy() if type(part) is np.ndarray else part._make(map(_copy, part))


class Remade:
    """A frozen dataclass that is pickled and copied by its fields alone: what it has computed since is left behind."""

    def __reduce__(self) -> tuple[Any, ...]:
        fields = dataclasses.fields(self)  # type: ignore[arg-type]
        return type(self), tuple(getattr(self, field.name) for field in fields)
