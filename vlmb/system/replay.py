"""The evaluation of the core replayed as plain Python, on numbers of any arithmetic: with derivatives, or with 50 digits.

Nothing is compiled for it and no text is written twice: every kernel is copied with a module of its own around it, in which the
kernels that it calls are such copies as well, and its functions of mathematics those of `jets`.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from vlmb.core import evaluation
from vlmb.core import quantities as core_quantities
from vlmb.core.constraints import SIDEWAYS
from vlmb.core.row_arrays import sizes_of, view
from vlmb.system import jets
from vlmb.system.core_engine import CoreEngine
from vlmb.system.jets import Numbers

FUNCTIONS = (
    "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "hypot", "floor",
    "reciprocal", "least_squares",
)  # fmt: skip
CORE = evaluation.__package__ or ""

_modules: dict[str, dict[str, Any]] = {}
_alone = threading.RLock()  # while modules are copied


def plain(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """Return a kernel as plain Python that takes numbers of any arithmetic, in arrays of objects."""
    function = getattr(kernel, "py_func", kernel)
    with _alone:
        found: Callable[..., Any] = _module(sys.modules[function.__module__])[function.__name__]
    return found


def _module(module: ModuleType) -> dict[str, Any]:
    """Return what a module of the core holds, with plain kernels."""
    if module.__name__ in _modules:
        return _modules[module.__name__]
    found = _modules[module.__name__] = dict(vars(module))
    for name, value in vars(module).items():
        function = getattr(value, "py_func", value)
        if name in FUNCTIONS:
            found[name] = getattr(jets, name)
        elif isinstance(value, ModuleType) and value.__name__.startswith(CORE):
            found[name] = SimpleNamespace(**_module(value))
        elif isinstance(function, FunctionType) and function.__module__ == module.__name__:
            found[name] = FunctionType(function.__code__, found, name, function.__defaults__, function.__closure__)
        elif isinstance(function, FunctionType) and function.__module__.startswith(CORE):
            found[name] = plain(function)
    return found


def lifted(part: Any) -> Any:
    """Return arrays, in tuples of them, copied so that they take numbers of any arithmetic; those of integers as they are."""
    if isinstance(part, tuple):
        return type(part)(*map(lifted, part))
    if isinstance(part, np.ndarray) and part.dtype == np.float64:
        return part.astype(object)
    return part


class Replayed(NamedTuple):
    """What an evaluation found: y', and of every ideal row what it lacks and the rate of that."""

    slope: Numbers
    z: Numbers
    rate: Numbers


class Replay:
    """Evaluations of an engine on other numbers: as it stands, its branches of angles and what slides included."""

    def __init__(self, engine: CoreEngine) -> None:
        self.engine, self.plant = engine, lifted(engine.plan.plant)
        self.evaluation, self.measure = plain(evaluation.evaluate), plain(core_quantities.measure)
        self.sizes, self.view = plain(sizes_of), plain(view)

    def evaluate(self, t: Any, y: Numbers, inputs: Numbers | None = None) -> Replayed:
        """Evaluate at (t, y), with forces from outside if any. Raises what the engine does."""
        memory, plant, y = lifted(self.engine.memory), self.plant, y.astype(object)
        if inputs is not None:
            memory.inputs[:] = inputs
        slope = np.zeros(len(y), object)
        code = self.evaluation(plant, memory, t, y, slope)
        if code:
            raise self.engine.fault(int(code))
        if not len(plant.rows.table):
            return Replayed(slope, slope[:0], slope[:0])
        sizes = self.sizes(plant.rows)
        residual, held = self.view(sizes, memory.rows).residual, int(sizes.held)
        z, rate = np.zeros(int(sizes.ideal), object), np.zeros(int(sizes.ideal), object)
        z[held:], rate[held:] = residual[: len(z) - held, 0], residual[: len(z) - held, 1]
        if held:
            rate[0] = y[self.engine.plan.positions + SIDEWAYS]
        return Replayed(slope, z, rate)
