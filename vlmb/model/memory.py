"""Whether a model fits in memory."""

from __future__ import annotations

import os
from pathlib import Path

from vlmb.errors import VlmbError


def data_bytes(nv: int) -> int:
    """Memory [bytes] that pinocchio.Data takes: about 4 nv^3 doubles."""
    return 32 * nv**3


def refuse_what_does_not_fit(nv: int) -> None:
    """Raise VlmbError where pinocchio.Data of so many velocities is larger than the memory that is free."""
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
