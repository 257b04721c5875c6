"""Work and precision of scenes as a table and as JSON, and the machine they were measured on."""

from __future__ import annotations

import importlib.metadata
import math
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vlmb.simulation.methods import find_method
from vlmb.studies.work_precision import QUANTITIES, Entry, Measured, cost_at, front

ERRORS = (1e-3, 1e-6, 1e-9)  # [m] the table's columns
SHOWN = 1e-6  # [m] each variant's errors are shown at its cheapest run that is this near
PACKAGES = ("pin", "numpy", "scipy")


def section(found: Measured, heading: str = "##") -> str:
    """Markdown of one scene: costs at three errors, then all errors of one run of each variant."""
    groups: dict[str, list[Entry]] = {}
    for entry in found.entries:
        groups.setdefault(entry.variant.label, []).append(entry)
    rows, details, failures = [], [], []
    for label, entries in groups.items():
        cells = [label]
        for cost in ("seconds", "evaluations", "steps"):
            for error in ERRORS:
                value = cost_at([(getattr(entry, cost), entry.position) for entry in entries], error)
                cells.append("-" if math.isnan(value) else f"{1e3 * value:.3g}" if cost == "seconds" else f"{value:.0f}")
        rows.append(cells)
        details.append(_detail(label, entries))
        failures += [f"{label} at {entry.setting:.2g}: {entry.failure}" for entry in entries if entry.failure]
    header = ["method", *(f"{what} {error:g} m" for what in ("ms to", "rhs to", "steps to") for error in ERRORS)]
    names = _columns(next((entry.errors for entry in found.entries if entry.errors), {}))
    units = [f"{name} [{QUANTITIES.get(name, _unit(name))}]" for name in names]
    known = {name: pair[1] for name, pair in found.uncertainty.items() if name in QUANTITIES}
    own = ", ".join(f"{name} {value:.0e} {QUANTITIES[name]}" for name, value in known.items())
    lines = [
        f"{heading} {found.name}, {found.duration:g} s",
        "",
        f"Reference: {found.reference}; its own error (max): {own}. Cost at a final position error, between two runs on their "
        "log-log line; '-': not reached.",
        "",
        table(header, rows),
        "",
        f"Errors, final / max over time, of the cheapest run within {SHOWN:g} m, else of the nearest one:",
        "",
        table(["method", "setting", *units], details),
    ]
    notes = [*(f"* failed: {text}" for text in failures), *(f"* left out: {text}" for text in found.left_out)]
    return "\n".join([*lines, *(["", *notes] if notes else [])])


def _columns(errors: Mapping[str, object]) -> list[str]:
    """Leave the rows of a programme to the JSON: they are servo errors, the same for every method."""
    return [name for name in errors if not name.startswith("programme, ")]


def _unit(name: str) -> str:
    if name == "knife_edge: velocity":
        return "m/s"
    return "own unit" if name.endswith("position") else "own unit/s"


def _detail(label: str, entries: Sequence[Entry]) -> list[str]:
    good = [entry for entry in entries if entry.errors]
    if not good:
        return [label, "failed"]
    near = [entry for entry in good if entry.position <= SHOWN]
    chosen = min(near, key=lambda entry: entry.seconds) if near else min(good, key=lambda entry: entry.position)
    errors = ["{:.0e} / {:.0e}".format(*chosen.errors[name]) for name in _columns(chosen.errors)]
    kind = "rtol" if find_method(chosen.variant.method).adaptive else "step"
    return [label, f"{kind} {chosen.setting:.1g}", *errors]


def as_data(found: Measured) -> dict[str, Any]:
    """Everything measured as plain data; what is not finite as null."""
    return {
        "scene": found.name, "duration": found.duration, "reference": found.reference, "reference error": found.uncertainty,
        "left out": found.left_out,
        "runs": [
            {
                "method": entry.variant.method, "knife_edge": entry.variant.knife_edge, "gain": entry.variant.gain,
                "setting": entry.setting, "seconds": entry.seconds if math.isfinite(entry.seconds) else None,
                "evaluations": entry.evaluations, "steps": entry.steps, "failure": entry.failure,
                "errors": {name: [x if math.isfinite(x) else None for x in pair] for name, pair in entry.errors.items()},
            }
            for entry in found.entries
        ],
    }  # fmt: skip


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Markdown table; the first column is aligned to the left, the others to the right. Short rows are filled up."""
    lines = ["| " + " | ".join(header) + " |", "| --- |" + " ---: |" * (len(header) - 1)]
    lines += ["| " + " | ".join([*map(str, cells), *[""] * (len(header) - len(cells))]) + " |" for cells in rows]
    return "\n".join(lines)


def footer(packages: Sequence[str] = PACKAGES) -> str:
    """One line: machine, system, and versions of Python and of the packages that are installed."""
    versions = []
    for name in packages:
        try:
            versions.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            versions.append(f"{name} not installed")
    threads = os.environ.get("OMP_NUM_THREADS", "?")
    system = f"{platform.system()} {platform.machine()}; Python {platform.python_version()}"
    return f"{_processor()}, {os.cpu_count()} cores, {threads} BLAS thread; {system}, {', '.join(versions)}."


def _processor() -> str:
    try:
        with Path("/proc/cpuinfo").open(encoding="utf-8") as lines:
            for line in lines:
                if line.startswith("model name"):
                    return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def ratios(ours: Sequence[tuple[float, float]], theirs: Sequence[tuple[float, float]]) -> list[float]:
    """Time ratios to reach each of ERRORS; nan where one of the two does not."""
    return [cost_at(front(ours), error) / cost_at(front(theirs), error) for error in ERRORS]
