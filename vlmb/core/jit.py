"""The one decorator of all kernels, and the functions of mathematics they call.

`VLMB_JIT=0` in the environment leaves kernels plain Python: they then run on arrays of any numbers (mpmath), under coverage and
in a debugger. `VLMB_JIT=bounds` compiles with checks of every index.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from typing import Any, TypeVar, cast, overload

from vlmb.core import cache

Function = TypeVar("Function", bound=Callable[..., Any])

MODE = os.environ.get("VLMB_JIT", "1")
COMPILED = MODE != "0"
# No nnan and no ninf: a state that is not finite must come out as such. Kernels only borrow their arrays: counting references
# to them would take several times as long as the mechanics.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True, "fastmath": {"contract", "nsz", "arcp"}, "_nrt": False}
PARTS: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


@overload
def kernel(function: Function) -> Function: ...
@overload
def kernel(*, inline: bool = False, allocates: bool = False, copied: bool = False) -> Callable[[Function], Function]: ...
def kernel(
    function: Function | None = None, *, inline: bool = False, allocates: bool = False, copied: bool = False
) -> Function | Callable[[Function], Function]:
    """Compile a function on its first call, once on this machine; `inner` is for those that only kernels call.

    `inline` makes it a part of every kernel that calls it, and leaves it plain Python for Python: for small functions.
    `allocates` lets it make arrays. `copied` puts its text into kernels that call it, so that it may return parts of arrays.
    """
    options = OPTIONS | {"_nrt": allocates, "boundscheck": MODE == "bounds"}

    def decorate(function: Function) -> Function:
        if not COMPILED:
            return function
        if copied:
            import numba

            return cast(Function, numba.njit(inline="always", **options)(function))
        if inline:
            from numba.extending import register_jitable

            return register_jitable(forceinline=True, **PARTS, **options)(function)
        if MODE == "bounds":
            return cache.compiled_anew(function, options)
        return cache.compiled(function, options)

    return decorate if function is None else decorate(function)


def inner(function: Function) -> Function:
    """Compile a function with the kernels that call it, and in no other form: Python sees it as it is written.

    What Python would call takes a second of compiling for a function that is handed a mechanism and its memory.
    """
    if not COMPILED:
        return function
    from numba.extending import register_jitable

    return cast(Function, register_jitable(**PARTS, **OPTIONS, boundscheck=MODE == "bounds")(function))


def _of_any_number(name: str) -> Callable[..., Any]:
    """Find a function for Python's floats and for numbers that bring a context of functions (mpmath)."""
    plain = getattr(math, name)

    def function(*values: Any) -> Any:
        for value in values:
            if hasattr(value, "context"):
                return getattr(value.context, name)(*values)
        return plain(*values)

    function.__name__ = name
    function.__doc__ = plain.__doc__
    return function


@kernel(inline=True)
def reciprocal(x: float) -> float:
    """1 / x; Python would raise at 0 where a kernel is about to return a fault."""
    return 1.0 / x


# typed once for both modes
sqrt: Callable[..., float]
sin: Callable[..., float]
cos: Callable[..., float]
tan: Callable[..., float]
asin: Callable[..., float]
acos: Callable[..., float]
atan: Callable[..., float]
atan2: Callable[..., float]
sinh: Callable[..., float]
cosh: Callable[..., float]
tanh: Callable[..., float]
exp: Callable[..., float]
log: Callable[..., float]
hypot: Callable[..., float]
floor: Callable[..., float]
if COMPILED:
    from math import acos, asin, atan, atan2, cos, cosh, exp, floor, hypot, log, sin, sinh, sqrt, tan, tanh
else:
    divide = reciprocal

    def reciprocal(x: float) -> float:
        """1 / x, and 0 at 0, where a kernel is about to return a fault."""
        return divide(x) if x != 0 else 0.0 * x

    sqrt, sin, cos, tan, asin = (_of_any_number(name) for name in ("sqrt", "sin", "cos", "tan", "asin"))
    acos, atan, atan2, sinh, cosh = (_of_any_number(name) for name in ("acos", "atan", "atan2", "sinh", "cosh"))
    tanh, exp, log, hypot, floor = (_of_any_number(name) for name in ("tanh", "exp", "log", "hypot", "floor"))
