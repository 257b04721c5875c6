"""What is kept of a run: one number of a history, by name, or of a whole trajectory, by a function."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, VlmbError
from vlmb.scene.names import ENERGIES, kind_of
from vlmb.simulation.trajectory import Trajectory

Array = NDArray[np.float64]

REDUCTIONS = ("last", "first", "min", "max", "absmax", "mean", "rms")
ERROR, ERROR_RATE = "residual:", "residual_dot:"


class Read(Protocol):
    """A function of a whole trajectory that gives a number."""

    def __call__(self, trajectory: Trajectory, /) -> float:
        """Return what is kept."""
        ...


class Kept(NamedTuple):
    """One number of a run: a reduction of a quantity, or a function."""

    name: str
    quantity: str = ""
    reduction: str = ""
    function: Read | None = None

    def of(self, trajectory: Trajectory) -> float:
        """Return it of a run."""
        if self.function is not None:
            return float(self.function(trajectory))
        return reduced(self.reduction, trajectory.t, history(trajectory, self.quantity))

    @property
    def told(self) -> str:
        """A text that differs where something else is kept: of a function its source, where there is one."""
        if self.function is None:
            return f"{self.quantity}:{self.reduction}"
        try:
            text = inspect.getsource(self.function)
        except (OSError, TypeError):
            code = getattr(self.function, "__code__", None)
            text = repr(self.function) if code is None else f"{code.co_code!r}{code.co_consts!r}{code.co_names!r}"
        where = f"{getattr(self.function, '__module__', '')}.{getattr(self.function, '__qualname__', '')}"
        return f"function {where} {hashlib.sha256(text.encode()).hexdigest()[:16]}"


def kept_of(keep: Any) -> tuple[Kept, ...]:
    """Read what to keep: {name: "QUANTITY:reduction" or a function of the trajectory}, or a list of the first kind.

    Raises SceneError for what is neither.
    """
    if keep is None:
        return ()
    if isinstance(keep, Mapping):
        return tuple(_one(str(name), what) for name, what in keep.items())
    if isinstance(keep, str) or not isinstance(keep, Sequence):
        raise SceneError(f"keep = {keep!r:.80}: must be a dict of names and reductions such as 'psi1:last', or a list of these")
    return tuple(_one(str(what), what) for what in keep)


def _one(name: str, what: Any) -> Kept:
    if callable(what):
        return Kept(name, function=what)
    if not isinstance(what, str):
        raise SceneError(f"keep: {name} = {what!r:.80}: must be 'QUANTITY:reduction' or a function of the trajectory")
    quantity, _, reduction = what.rpartition(":")
    if not quantity:
        raise SceneError(f"keep: {name} = {what!r}: say how it is reduced, such as '{what}:last'; one of {', '.join(REDUCTIONS)}")
    if reduction not in REDUCTIONS:
        raise SceneError(f"keep: {name} = {what!r}: no such reduction {reduction!r}; allowed: {', '.join(REDUCTIONS)}")
    return Kept(name, quantity, reduction)


def history(trajectory: Trajectory, name: str) -> Array:
    """Return a history (N,) by name: what `trajectory[...]` knows, a control, a reaction, `residual:NAME`, `residual_dot:NAME`.

    Raises VlmbError for an unknown name.
    """
    for prefix, entry in ((ERROR, 0), (ERROR_RATE, 1)):
        if name.startswith(prefix):
            error, rate = trajectory.residuals[name.removeprefix(prefix)]
            found = (error, rate)[entry]
            if found is None:
                raise SceneError(f"{name}: this row is one of rates; {ERROR_RATE}{name.removeprefix(prefix)} is its error")
            return found
    if kind_of(name) not in ("a coordinate", "an energy"):
        for named in (trajectory.reactions, trajectory.controls):
            if name in named:
                return named[name]
    try:
        return trajectory[name]
    except VlmbError as error:
        others = [*trajectory.reactions, *trajectory.controls, *(f"{ERROR_RATE}{row}" for row in trajectory.residuals)]
        raise type(error)(f"{error}; or {', '.join(others[:12])}" if others else str(error)) from None


def history_at(trajectory: Trajectory, name: str, times: Array) -> Array:
    """Return a history (N,) at samples that were asked for.

    Contacts have samples of their own at the instants of events, before and after: at such a time it is the one after.
    """
    return history(trajectory, name)[np.searchsorted(trajectory.t, times, side="right") - 1]


def require_known(kept: Sequence[Kept], histories: Sequence[str], names: Any, others: Callable[[], Sequence[str]]) -> None:
    """Raise SceneError for a quantity that the scene does not have."""
    for name in [*(entry.quantity for entry in kept if entry.function is None), *histories]:
        if name in ("t", *ENERGIES) or name in names:
            continue
        also = [*others()]
        if name.removeprefix(ERROR).removeprefix(ERROR_RATE) not in also:
            others_too = f"; or {', '.join(also)}" if also else ""
            raise SceneError(f"keep: this scene has no {name!r:.80}; {names.hint(name)}{others_too}")


def reduced(reduction: str, t: Array, values: Array) -> float:
    """Reduce a history (N,) at the times t (N,); mean and rms are over time, by the trapezoidal rule."""
    if reduction in ("last", "first"):
        return float(values[-1 if reduction == "last" else 0])
    if reduction in ("min", "max"):
        return float(values.min() if reduction == "min" else values.max())
    if reduction == "absmax":
        return float(np.abs(values).max())
    powers = values if reduction == "mean" else values * values
    span = float(t[-1] - t[0])
    mean = float(powers[0]) if span == 0.0 else float((0.5 * (powers[1:] + powers[:-1]) * np.diff(t)).sum()) / span
    return mean if reduction == "mean" else float(np.sqrt(mean))
