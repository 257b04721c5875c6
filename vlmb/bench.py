"""The command `vlmb bench`: work and precision of scenes as a table, JSON and log-log plots."""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import math
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vlmb.errors import VlmbError
from vlmb.integrate import METHODS, find_method
from vlmb.scene import load_scene
from vlmb.style import BLACK, GREY, PALETTE, style
from vlmb.work_precision import QUANTITIES, Entry, Measured, cost_at, front, measure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ERRORS = (1e-3, 1e-6, 1e-9)  # [m] the table's columns
COSTS = {"seconds": "CPU time [s]", "evaluations": "right-hand sides", "steps": "steps"}
SHOWN = 1e-6  # [m] each variant's errors are shown at its cheapest run that is this near
MARKERS = dict(zip(METHODS, "vsDo^<>", strict=True))
COLOURS = dict(zip(METHODS, (GREY, *PALETTE), strict=True))
PACKAGES = ("pin", "numpy", "scipy")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `vlmb bench`."""
    parser.add_argument("scenes", nargs="+", metavar="SCENE", help="scene files (.toml)")
    parser.add_argument("--duration", type=float, help="[s]")
    parser.add_argument("--methods", nargs="+", choices=METHODS, help="default: all")
    parser.add_argument("--repeats", type=int, default=5, help="turns through all runs; the fastest counts")
    parser.add_argument("--budget", type=float, default=1.0, help="[s] a sweep ends after a run that took longer")
    parser.add_argument("-o", "--output", type=Path, default=Path("results/bench"), help="folder for bench.md, .json and .png")


def run(args: argparse.Namespace) -> int:
    """Measure scenes and write bench.md, bench.json and bench.png."""
    if args.repeats < 1 or not args.budget > 0.0:
        raise VlmbError("bench: --repeats must be at least 1 and --budget positive")
    found = [
        measure(load_scene(path), args.duration, args.methods, repeats=args.repeats, budget=args.budget, progress=print)[0]
        for path in args.scenes
    ]
    args.output.mkdir(parents=True, exist_ok=True)
    where = footer()
    page = "\n\n".join(["# Work and precision", *(section(entry) for entry in found)])
    files = [args.output / f"bench.{end}" for end in ("md", "json", "png")]
    files[0].write_text(f"{page}\n\nMeasured by `vlmb bench` on {where}\n", encoding="utf-8")
    data = {"scenes": [as_data(entry) for entry in found], "machine": where}
    files[1].write_text(json.dumps(data, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    with style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(11.0, 3.6 * len(found) + 0.6), layout="constrained")
        panels = figure.subplots(len(found), len(COSTS), squeeze=False)
        for row, entry in zip(panels, found, strict=True):
            for axes, cost in zip(row, COSTS, strict=True):
                draw(axes, entry, cost)
        legend(figure, [axes for row in panels for axes in row])
        figure.savefig(files[2], dpi=130, metadata={"Software": None})
    print(page)
    print("wrote " + ", ".join(map(str, files)))
    return 0


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


def draw(axes: Axes, found: Measured, cost: str = "seconds", quantity: str = "position", forms: bool = False) -> None:
    """Draw final error against cost, log-log, a line a method, or a line a variant; the reference's own error as a level."""
    groups: dict[str, list[Entry]] = {}
    for entry in found.entries:
        if entry.errors and (forms or entry.variant.knife_edge == "reduction"):
            groups.setdefault(entry.variant.label, []).append(entry)
    for number, (label, entries) in enumerate(groups.items()):
        points = sorted((getattr(entry, cost), max(entry.errors[quantity][0], 1e-16)) for entry in entries)
        method = entries[0].variant.method
        colour = PALETTE[number % len(PALETTE)] if forms else COLOURS[method]
        axes.loglog(*zip(*points, strict=True), color=colour, marker=MARKERS[method], markersize=3.5, label=label)
    level = found.uncertainty.get(quantity, (0.0, 0.0))[0]
    if level > 0.0:
        axes.axhline(level, color=BLACK, linestyle=":", linewidth=0.9)
    axes.set(xlabel=COSTS[cost], ylabel=f"final {quantity} error [{QUANTITIES[quantity]}]")
    axes.set_title(f"{found.name}, {found.duration:g} s")


def _plain_ticks(axes: Axes) -> None:
    """Label whole decades alone; on an axis with fewer than two of them 2 and 5 as well."""
    from matplotlib.ticker import LogFormatterSciNotation, LogLocator, NullFormatter

    low, high = axes.get_xlim()
    if math.floor(math.log10(high)) - math.ceil(math.log10(low)) >= 1:
        axes.xaxis.set_minor_formatter(NullFormatter())
    else:
        axes.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        axes.xaxis.set_minor_formatter(LogFormatterSciNotation(minor_thresholds=(10.0, 10.0)))


def legend(figure: Figure, panels: Sequence[Axes]) -> None:
    """Put one legend for all panels below them, each name once; call it when all lines are drawn, since it sets the ticks."""
    for axes in panels:
        _plain_ticks(axes)
    entries = {str(line.get_label()): line for axes in panels for line in axes.lines if str(line.get_label())[0] != "_"}
    figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=min(len(entries), 7))


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
