"""Figures of work and precision: error against cost, log-log."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from vlmb.simulation.files import replacing
from vlmb.simulation.methods import METHODS
from vlmb.studies.work_precision import QUANTITIES, Entry, Measured
from vlmb.views.style import BLACK, GREY, PALETTE, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COSTS = {"seconds": "CPU time [s]", "evaluations": "right-hand sides", "steps": "steps"}
MARKERS = dict(zip(METHODS, "vsDo^<>", strict=True))
COLOURS = dict(zip(METHODS, (GREY, *PALETTE), strict=True))


def save(found: Sequence[Measured], path: Path) -> Path:
    """Draw error against each cost, a row a scene, into a file."""
    with style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(11.0, 3.6 * len(found) + 0.6), layout="constrained")
        panels = figure.subplots(len(found), len(COSTS), squeeze=False)
        for row, entry in zip(panels, found, strict=True):
            for axes, cost in zip(row, COSTS, strict=True):
                draw(axes, entry, cost)
        legend(figure, [axes for row in panels for axes in row])
        with replacing(path) as file:
            figure.savefig(file, dpi=130, metadata={"Software": None})
    return path


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
