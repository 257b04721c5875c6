"""What commands print: tables with units, and the files they wrote."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from vlmb.simulation.facts import extents
from vlmb.simulation.trajectory import Trajectory

ROWS = 14  # of a table of results
NOISE = 1e-12  # [m, rad] shown as 0


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Set rows of texts under a header; the first two columns to the left, numbers to the right."""
    lines = [header, *rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(header))]
    sides = ["<" if k < 2 else ">" for k in range(len(header))]
    return "\n".join(
        "  " + "  ".join(f"{text:{side}{width}}" for text, side, width in zip(line, sides, widths, strict=True)).rstrip()
        for line in lines
    )


def results(trajectory: Trajectory) -> str:
    """Return a table of a run's coordinates: where each begins and ends, and between which values it goes."""
    known = set(trajectory.mechanism.coordinate_names)
    found = [entry for entry in extents(trajectory) if entry.name in known]
    rows = [[entry.name, entry.unit, *map(_shown, entry[2:])] for entry in found]
    more = [f"  ... and {len(rows) - ROWS} more in run.csv"] if len(rows) > ROWS else []
    return "\n".join([table(("coordinate", "unit", "start", "end", "least", "largest"), rows[:ROWS]), *more])


def _shown(number: float) -> str:
    return "0" if abs(number) < NOISE else f"{number:.4g}"


def wrote(files: Sequence[Path]) -> str:
    """List written files, many of one folder by their names."""
    folders = {file.parent for file in files}
    if len(files) < 4 or len(folders) > 1:
        return "wrote " + ", ".join(str(file) for file in files)
    return f"wrote into {folders.pop()}: " + ", ".join(file.name for file in files)
