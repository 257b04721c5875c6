"""Figures of one run or of several in comparison, and their files. Matplotlib is imported when a figure is made."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import VlmbError, nearest
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import force_symbol, panel_label, quantity_of
from vlmb.views.contact_plots import contacts
from vlmb.views.dark import darkened
from vlmb.views.data_plots import data
from vlmb.views.eigenvalue_plots import eigenvalues as eigenvalues
from vlmb.views.panels import (
    ZERO,
    Panel,
    all_coordinates,
    colour_number,
    contact_reader,
    hinge_reader,
    mapped_reader,
    reader,
    residual_reader,
    stacked,
)
from vlmb.views.paths import Runs, listed, path
from vlmb.views.programme_plots import deviations, power, strengths
from vlmb.views.style import (
    Series,
    align,
    calm,
    decades,
    draw,
    empty_figure,
    finish,
    legend_beside,
    new_figure,
    reveal,
    style,
    styled,
    whole,
    write,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

KINDS = (("x", "y", "z"), ("phi0", "phi"), ("psi",), ("xi",))


@styled
def coordinates(trajectory: Runs, labels: Sequence[str] | None = None) -> Figure:
    """Draw the paper's coordinates over time, one panel a kind, and their rates beside them."""
    runs = listed(trajectory)
    groups = []
    for kinds in KINDS:
        for segment in (1, 2) if kinds == ("xi",) else (0,):
            group = [c for c in all_coordinates(runs) if c.kind in kinds and c.segment == segment]
            groups += [group] if group else []
    figure = new_figure(runs, 10.0, 1.0 + 1.75 * len(groups), "Coordinates and rates")
    axes = figure.subplots(len(groups), 2, sharex=True, squeeze=False)
    for row, group in zip(axes, groups, strict=True):
        for ax, dot in zip(row, (False, True), strict=True):
            series = [Series(quantity_of(c).symbol, colour_number(c), reader(quantity_of(c, dot).name)) for c in group]
            draw(ax, runs, series, by_run=all(len(entries) == 1 for entries in groups))
            ax.set_ylabel(panel_label(quantity_of(c, dot) for c in group))
            calm(ax)
        if len(runs) == 1:
            reveal(*row)
        legend_beside(row[1])
    for ax in axes[-1]:
        ax.set_xlabel("$t$ [s]")
    align(figure.axes)
    return finish(figure, runs, labels)


@styled
def energy(trajectory: Runs, labels: Sequence[str] | None = None) -> Figure:
    """Draw the energy account, and its balance (energy - start - work + dissipated) on an axis of its own."""
    runs = listed(trajectory)
    names = {"kinetic": 0, "potential": 1, "spring": 2, "energy": -1, "work": 3, "dissipated": 4}
    always = ("kinetic", "potential", "energy")
    shown = [name for name in names if name in always or any(np.any(run[name]) for run in runs)]
    lines = [Series({"energy": "total"}.get(name, name), names[name], reader(name)) for name in shown]
    return stacked(
        runs, "Energy account", [("energy [J]", lines), ("balance [J]", [Series("balance", -1, reader("balance"))])], labels,
        heights=(2.2, 1.0), by_link=False,
    )  # fmt: skip


@styled
def residuals(trajectory: Runs, labels: Sequence[str] | None = None) -> Figure:
    """Draw the constraint errors on log axes, of the equations (position level) and of their rates (velocity level)."""
    runs = listed(trajectory)
    names = list(dict.fromkeys(name for run in runs for name in run.residuals))
    panels: list[Panel] = []
    for level in ("position", "velocity"):
        lines = [
            Series("knife edge" if name == "knife_edge" else whole(name), i, residual_reader(name, level))
            for i, name in enumerate(names)
        ]
        lines = [line for line in lines if any(line.read(run) is not None for run in runs)]
        what = "m/s" if [line.label for line in lines] == ["knife edge"] else "unit of the row" + "/s" * (level == "velocity")
        panels += [(f"{level} level\n|{lines[0].label if len(lines) == 1 else 'residual'}| [{what}]", lines)] if lines else []
    if not panels:
        return empty_figure(runs, "Residuals", "the scene has no constraints")
    figure = stacked(runs, "Constraint residuals", panels, labels, by_link=False, legends_above=True)
    for ax in figure.axes:
        values = np.concatenate([np.asarray(line.get_ydata(), float) for line in ax.lines])
        values = values[np.isfinite(values)]  # rows of a programme are none while it does not act
        low, high = (float(values.min()), float(values.max())) if values.size else (ZERO, ZERO)
        decades(ax, low, high)
        if low == ZERO:
            ax.axhline(ZERO, color="#bbbbbb", linewidth=0.8, zorder=0.5)
            where: tuple[str, str] = ("axes fraction", "data")
            text = rf"$\leq 10^{{{round(np.log10(ZERO))}}}$"
            ax.annotate(text, (1.0, ZERO), (3, 0), where, "offset points", va="center", fontsize=8)
    return figure


@styled
def reactions(trajectory: Runs, labels: Sequence[str] | None = None) -> Figure:
    """Draw the snow's edge and normal forces and moments on the ski, other constraint forces, and the hinge forces."""
    runs = listed(trajectory)
    names = list(dict.fromkeys(name for run in runs for name in run.reactions))
    moments = [name for name in names if name.endswith("_moment")]
    touching = list(dict.fromkeys(name for run in runs for name in run.scene.touching))
    others = [name for name in names if name not in ("knife_edge", "normal", "ski", *moments, *touching)]

    def lines(which: Iterable[str]) -> list[Series]:
        return [
            Series(name.replace("_", " ") if name in names[:4] else whole(name, 40), i - 1, mapped_reader("reactions", name))
            for i, name in enumerate(which)
        ]

    panels: list[Panel] = []
    panels += [("edge force [N]", lines(["knife_edge"]))] if "knife_edge" in names else []
    panels += [("normal force [N]", lines(["normal"]))] if "normal" in names else []
    panels += [("moments of the snow\n[N m]", lines(moments))] if moments else []
    panels += [("reactions\n[N, N m]", lines(others))] if others else []
    forces = [Series(name, i, contact_reader(name)) for i, name in enumerate(touching)]
    panels += [("contact force [N]", forces)] if forces else []
    links = list(dict.fromkeys(link.name for run in runs for link in run.scene.links))
    panels += [("hinge force [N]", [Series(name, i, hinge_reader(name)) for i, name in enumerate(links)])] if links else []
    if not panels:
        return empty_figure(runs, "Reactions", "the scene has no reactions")
    figure = stacked(runs, "Reactions", panels, labels, zero_line=("edge force", "normal force"))
    weight = max((float(np.abs(run.reactions["normal"]).max()) for run in runs if "normal" in set(run.reactions)), default=0.0)
    for ax in figure.axes:
        values = [np.abs(np.asarray(line.get_ydata(), float)).max() for line in ax.lines]
        if values and max(values) < 1e-9 * weight:
            ax.set_ylim(-1.0, 1.0)  # rounding errors are not worth a scale
    return figure


@styled
def controls(trajectory: Runs, labels: Sequence[str] | None = None) -> Figure:
    """Draw the applied forces and moments, and the forces of prescribed segments."""
    runs = listed(trajectory)
    names = list(dict.fromkeys(name for run in runs for name in run.controls))
    if not names:
        return empty_figure(runs, "Controls", "the scene has no controls")
    moments = [name for name in names if name[0] in "MT"]
    forces = [name for name in names if name not in moments]
    panels: list[Panel] = []
    for what, group, newton in (("force", forces, "N"), ("moment", moments, "N m")):
        lines = [Series(force_symbol(name), k, mapped_reader("controls", name)) for k, name in enumerate(group)]
        panels += [(f"{force_symbol(group[0]) if len(group) == 1 else what} [{newton}]", lines)] if group else []
    return stacked(runs, "Controls", panels, labels, by_link=False)


@styled
def phase(trajectory: Runs, labels: Sequence[str] | None = None) -> Figure:
    """Draw phase portraits: elevations and segment lengths against their rates, a dot at the start."""
    runs = listed(trajectory)
    known = all_coordinates(runs)
    groups = [[c for c in known if c.kind == "psi"], *([c for c in known if c.segment == which] for which in (1, 2))]
    groups = [group for group in groups if group]
    if not groups:
        return empty_figure(runs, "Phase portraits", "the scene has no elevations and no free segments")
    figure = new_figure(runs, 1.2 + 4.0 * len(groups), 4.4, "Phase portraits")
    for ax, group in zip(figure.subplots(1, len(groups), squeeze=False)[0], groups, strict=True):
        across = [reader(c.name) for c in group]
        draw(ax, runs, [Series(quantity_of(c).symbol, c.link, reader(quantity_of(c, True).name)) for c in group], across,
             by_run=all(len(entries) == 1 for entries in groups))  # fmt: skip
        for line in list(ax.lines):
            ax.plot(*(data[:1] for data in line.get_data()), "o", color=line.get_color(), markersize=4, label="_")
        ax.set_xlabel(panel_label(quantity_of(c) for c in group))
        ax.set_ylabel(panel_label(quantity_of(c, True) for c in group))
        calm(ax, also_x=True)
        ax.locator_params(axis="x", nbins=6)
        legend_beside(ax, above=True)
    return finish(figure, runs, labels)


PLOTS: dict[str, Callable[..., Figure]] = {
    "coordinates": coordinates, "path": path, "energy": energy, "residuals": residuals,
    "reactions": reactions, "controls": controls, "power": power, "deviations": deviations, "strengths": strengths,
    "contacts": contacts, "phase": phase, "data": data,
}  # fmt: skip


def save_all(
    trajectory: Runs, folder: str | Path, only: Iterable[str] | None = None, labels: Sequence[str] | None = None,
    dark: bool = False,
) -> list[Path]:  # fmt: skip
    """Write the figures as PNG files into a folder and return their paths; several runs share each figure.

    `dark` puts them on a dark ground.

    Figures that would be empty are skipped; one that is asked for by name and would be empty is an error.
    Raises VlmbError for an unknown name in `only`, or when matplotlib is not installed.
    """
    runs = listed(trajectory)
    if any(not isinstance(run.mechanism, Mechanism) for run in runs):
        from vlmb.views.robot_plots import save_robot_plots

        if len(runs) > 1:
            raise VlmbError("figures of robots show one run: plot each run by itself, into a folder of its own")
        return save_robot_plots(runs[0], folder, only, dark)
    wanted = list(PLOTS) if only is None else list(dict.fromkeys(only))
    for name in wanted:
        if name not in PLOTS:
            raise VlmbError(f"no plot {name!r}; {nearest(name, PLOTS)}")
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    collects = gc.isenabled()
    gc.disable()  # a figure is thousands of small things that live until it is written
    try:
        for name in wanted:
            figure = PLOTS[name](runs, labels)
            if figure.axes:
                with style():
                    written.append(write(darkened(figure) if dark else figure, folder / f"{name}.png"))
            elif only is not None:
                raise VlmbError(f"the plot {name!r} would be empty: {figure.texts[-1].get_text()}")
    finally:
        if collects:
            gc.enable()
    return written
