"""What a run came to, as plain data: for `vlmb run --json`, tables of results and programs that read them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from vlmb.simulation.trajectory import Trajectory


class Extent(NamedTuple):
    """A column's values at the start and the end, the least and the largest; nan where unknown."""

    name: str
    unit: str
    start: float
    end: float
    least: float
    largest: float


def extents(trajectory: Trajectory) -> Iterator[Extent]:
    """Yield the extent of every column of `run.csv` but the time."""
    found = trajectory.columns()
    next(found)
    for name, unit, values in found:
        ends = float(values[0]), float(values[-1])
        yield Extent(name, unit, *ends, float(np.fmin.reduce(values)), float(np.fmax.reduce(values)))


def facts(trajectory: Trajectory) -> dict[str, Any]:
    """Return what a run came to as plain data that JSON can hold: None for what is unknown, units beside the numbers."""
    stats = trajectory.stats
    balance = np.abs(trajectory["balance"])
    return {
        "scene": trajectory.scene.name,
        "status": trajectory.status,
        "message": trajectory.message,
        "doubts": list(trajectory.doubts),
        "notes": list(trajectory.adjustments),
        "time": {"start": float(trajectory.t[0]), "end": float(trajectory.t[-1]), "samples": len(trajectory), "unit": "s"},
        "method": {"name": trajectory.run.method, "rtol": float(trajectory.run.rtol), "atol": float(trajectory.run.atol)},
        "engine": trajectory.engine,
        "cost": {"steps": stats["steps"], "evaluations": stats["rhs_evaluations"], "wall_time": stats["wall_time"], "unit": "s"},
        "energy_balance": {"largest": _known(float(np.fmax.reduce(balance))), "unit": "J"},
        "columns": {
            entry.name: {
                "unit": entry.unit, "start": _known(entry.start), "end": _known(entry.end), "least": _known(entry.least),
                "largest": _known(entry.largest),
            }
            for entry in extents(trajectory)
        },
        "versions": dict(trajectory.versions),
    }  # fmt: skip


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
