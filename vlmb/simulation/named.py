"""What a trajectory hands out by name: mappings that compute at the first look, and residuals."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import TrajectoryError, nearest
from vlmb.scene.names import listed

Array = NDArray[np.float64]
Value = TypeVar("Value")


@dataclass(frozen=True, eq=False)
class Residual:
    """Error of a constraint along a motion: `position, velocity = residual`, or by name."""

    position: Array | None  # (N,) of its equation; None where it has a rate alone
    velocity: Array  # (N,) of its rate
    equation: str = ""  # its text; none for the knife edge

    def __iter__(self) -> Iterator[Array | None]:
        return iter((self.position, self.velocity))

    def __repr__(self) -> str:
        error = "" if self.position is None else f"up to {largest(self.position):.3g}, "
        of = f" of {self.equation!r}" if self.equation else ""
        return f"<Residual{of}: {len(self.velocity)} samples, {error}its rate up to {largest(self.velocity):.3g}>"


class Named(Mapping[str, Value]):
    """A mapping whose values are computed at the first look, and whose missing names are explained."""

    def __init__(self, what: str, names: tuple[str, ...], compute: Callable[[str], Value]) -> None:
        self.what, self.names, self.compute = what, names, compute

    def __getitem__(self, name: str) -> Value:
        if name not in self.names:
            raise TrajectoryError(f"this trajectory has no {self.what} {name!r}; {nearest(name, self.names)}")
        return self.compute(name)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def get(self, name: str, default: Value | None = None) -> Value | None:  # type: ignore[override]
        """Return the value of a name, or the default where there is none."""
        return self[name] if name in self.names else default

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    def __repr__(self) -> str:
        return f"<{self.what}s: {listed(self.names) or 'none'}>"

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.names)


def largest(values: Array) -> float:
    """Largest size among the values that are known; nan where none is."""
    return float(np.fmax.reduce(np.abs(values)))
