"""Pinocchio's scratch space: what it takes, and that it fits."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import pinocchio as pin

from vlmb.errors import VlmbError

SMALL = 2**20  # [bytes] what is always there: to look for it takes longer than to make it


def make_data(model: Any) -> Any:
    """Make a pinocchio.Data for a generated model: scratch space of whoever computes, one thread at a time.

    Raises VlmbError where it does not fit in memory.
    """
    refuse_what_does_not_fit(model.nv)
    data = pin.Data(model)
    if not model.check(data):
        raise VlmbError("internal: joints are not depth-first; crba would be wrong")
    return data


def data_bytes(nv: int) -> int:
    """Memory [bytes] that pinocchio.Data takes: about 4 nv^3 doubles."""
    return 32 * nv**3


def fits(nv: int) -> bool:
    """Whether a pinocchio.Data of nv velocities is worth its memory for a look beside the run: 1 GiB at most, if it is free."""
    if data_bytes(nv) < SMALL:
        return True
    available = _available_memory()
    return data_bytes(nv) < min(2**30, 0.8 * available if available else math.inf)


def refuse_what_does_not_fit(nv: int) -> None:
    """Raise VlmbError where a pinocchio.Data of nv velocities is larger than the memory that is free."""
    if data_bytes(nv) < SMALL:
        return
    available = _available_memory()
    if available and data_bytes(nv) > 0.8 * available:
        raise VlmbError(
            f"{nv} velocities need about {data_bytes(nv) / 2**30:.1f} GiB (pinocchio.Data holds 4 nv^3 doubles), "
            f"and {available / 2**30:.1f} GiB are free: fix segments that need not move, use plane = true, or use fewer links"
        )


def _available_memory() -> int:
    try:
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (ValueError, OSError, AttributeError):
        return 0  # not known on this system: let the allocation itself decide
