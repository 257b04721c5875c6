"""The one decorator of all kernels: compiled by numba, or plain Python where VLMB_JIT=0."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

COMPILED = os.environ.get("VLMB_JIT", "1") != "0"
OPTIONS: dict[str, Any] = {
    "cache": True, "error_model": "numpy", "nogil": True, "fastmath": {"contract", "nsz", "arcp"},
}  # fmt: skip


def kernel(function: Function) -> Function:
    """Compile a function on its first call, for every caller of this machine."""
    if not COMPILED:
        return function
    import numba

    return numba.njit(**OPTIONS)(function)  # type: ignore[no-any-return]
