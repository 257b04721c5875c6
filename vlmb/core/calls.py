"""What Python calls of the core in a run, straight to the machine code.

numba looks at the type of every array before every call: with the sixty of a run that takes six microseconds of seven. The
arrays of a run are made once, by `make_plant`, `make_memory` and `make_driver`, and never change their kinds; states handed over
are contiguous arrays of floats. So only the first call is looked at.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from vlmb.core import driver, plant, samples
from vlmb.core import march as marching
from vlmb.core import run as running

Function = TypeVar("Function", bound=Callable[..., Any])


def direct(kernel: Function) -> Function:
    """Return a call of a kernel whose arguments are of the same kinds whenever it is called, looked at the first time only."""
    if not hasattr(kernel, "overloads"):  # plain Python
        return kernel
    entry: Callable[..., Any] | None = None

    def call(*arguments: Any) -> Any:
        nonlocal entry
        if entry is not None:
            return entry(*arguments)
        answer, compiled = kernel(*arguments), list(cast(Any, kernel).overloads.values())
        entry = compiled[0].entry_point if len(compiled) == 1 else kernel
        return answer

    call.__doc__ = kernel.__doc__
    return cast(Function, call)


begin, resume, state_at = direct(driver.begin), direct(driver.resume), direct(samples.state_at)
march, run = direct(marching.march), direct(running.run)
onto_edge = direct(plant.onto_edge)
