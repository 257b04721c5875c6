"""Functions of one number for kernels: those of libm, or of the number's own arithmetic where kernels are plain Python.

Outside a domain the answer is nan, never an exception.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from vlmb.core.jit import COMPILED, inner

NAN, TAU = math.nan, math.tau

Function = Callable[..., Any]
sin: Function = math.sin
cos: Function = math.cos
tan: Function = math.tan
asin: Function = math.asin
acos: Function = math.acos
atan: Function = math.atan
atan2: Function = math.atan2
exp: Function = math.exp
log: Function = math.log
sqrt: Function = math.sqrt
floor: Function = math.floor


def _careful(name: str) -> Function:
    """Make a function for floats and for mpmath's numbers, nan outside its domain."""

    def function(*values: Any) -> Any:
        owner = next((value.context for value in values if hasattr(value, "context")), math)
        try:
            result = getattr(owner, name)(*values)
        except (ValueError, ZeroDivisionError, OverflowError):
            return NAN
        return NAN if hasattr(result, "imag") and result.imag != 0 else result

    return function


if not COMPILED:
    sin, cos, tan, asin, acos, atan, atan2 = map(_careful, ("sin", "cos", "tan", "asin", "acos", "atan", "atan2"))
    exp, log, sqrt, floor = map(_careful, ("exp", "log", "sqrt", "floor"))


@inner
def quotient(x: float, y: float) -> float:
    """Return x / y; nan where y is 0."""
    return NAN if y == 0.0 else x / y


@inner
def finite(x: float) -> bool:
    """Tell whether a number is neither infinite nor nan."""
    return x - x == 0.0


@inner
def wrapped(angle: float) -> float:
    """Return the angle [rad] of [-pi, pi) that differs by whole turns."""
    return angle - TAU * floor(angle / TAU + 0.5)


@inner
def nearest_turn(angle: float, reference: float) -> float:
    """Return what differs from an angle by whole turns and is nearest to a reference [rad]."""
    return reference + wrapped(angle - reference)
