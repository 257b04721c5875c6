"""Figures of programme control: how well a programme is met, what its controls do, and whether a body could."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vlmb.model.names import force_symbol, plain
from vlmb.scene.by_phase import programmes_of
from vlmb.scene.rows import Row, rows_of
from vlmb.simulation.trajectory import Trajectory
from vlmb.views.biomechanics import STRENGTHS, both_legs, joint_moments
from vlmb.views.panels import ZERO, Panel, power_reader, stacked, work_reader
from vlmb.views.paths import Runs, listed
from vlmb.views.style import (
    DASHES,
    GREY,
    PALETTE,
    Series,
    align,
    decades,
    draw,
    empty_figure,
    finish,
    legend_beside,
    new_figure,
    styled,
    whole,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

PAIRED = 4  # rows drawn as they are and by size; of more the size alone
MOST = 6  # controls drawn in a panel


@styled
def deviations(trajectory: Runs, labels: Sequence[str] | None = None) -> Figure:
    """Draw the deviation from each equation of a programme over time, as it is and its size: the paper's figures 7 and 8."""
    runs = listed(trajectory)
    rows = {row.name: row for run in runs for row in rows_of(run.scene).servo}
    if not rows:
        return empty_figure(runs, "Deviations", "the scene has no programme")
    if len(rows) > PAIRED:
        return _sizes(runs, list(rows.values()), labels)
    figure = new_figure(runs, 10.5, 1.2 + 2.1 * len(rows), "Deviations from the programme")
    axes = figure.subplots(len(rows), 2, sharex=True, squeeze=False)
    for pair, row in zip(axes, rows.values(), strict=True):
        for ax, size in zip(pair, (False, True), strict=True):
            draw(ax, runs, [Series("_", 0, error_reader(row.name, size))], by_run=True)
            ax.set_ylabel(f"{'|deviation|' if size else 'deviation'}\n[unit of the row]")
        pair[0].set_title(_title(row, 78), loc="left", fontsize=8)
        pair[0].axhline(0.0, color="#999999", linewidth=0.8, zorder=0.5)
        _log(pair[1])
    for ax in axes[-1]:
        ax.set_xlabel("$t$ [s]")
    align(figure.axes)
    return finish(figure, runs, labels, by_link=False)


def _sizes(runs: Sequence[Trajectory], rows: Sequence[Row], labels: Sequence[str] | None) -> Figure:
    """Draw the sizes of the deviations from many rows, a small panel each, so that a screen holds them."""
    columns = 3 if len(rows) <= 15 else 4
    high = -(-len(rows) // columns)
    figure = new_figure(runs, 13.0, 1.2 + 1.5 * high, "Size of the deviations from the programme [unit of the row]")
    places: dict[str, float] = {}
    if len(runs) == 1:  # panels of one kind need no measuring
        figure.set_layout_engine("none")
        places = {"left": 0.05, "right": 0.98, "top": 0.89, "bottom": 0.07, "hspace": 0.58, "wspace": 0.17}
    grid = figure.add_gridspec(high, columns, **places)
    for k, row in enumerate(rows):
        ax = figure.add_subplot(grid[k // columns, k % columns])
        draw(ax, runs, [Series("_", 0, error_reader(row.name, True))], by_run=True)
        ax.set_title(_title(row, 198 // columns), loc="left", fontsize=7)
        _log(ax)
        if k + columns >= len(rows):
            ax.set_xlabel("$t$ [s]")
        else:
            ax.tick_params(labelbottom=False)
    return finish(figure, runs, labels, by_link=False)


def _title(row: Row, width: int) -> str:
    return whole(f"{row.name}: {row.equation}" if row.named else row.equation, width)


def _log(ax: Axes) -> None:
    sizes = np.concatenate([np.asarray(line.get_ydata(), float) for line in ax.lines])
    sizes = sizes[np.isfinite(sizes)]  # rows are none while their programme does not act
    decades(ax, *((float(np.percentile(sizes, 2.0)), float(sizes.max())) if sizes.size else (ZERO, ZERO)))


def error_reader(name: str, size: bool) -> Callable[[Trajectory], Array | None]:
    """Read the error of a row, of its rate where it has a rate alone; or its size, for a log axis."""

    def read(run: Trajectory) -> Array | None:
        if name not in run.residuals:
            return None
        position, velocity = run.residuals[name].position, run.residuals[name].velocity
        values = velocity if position is None else position
        return np.maximum(np.abs(values), ZERO) if size else values

    return read


@styled
def power(trajectory: Runs, labels: Sequence[str] | None = None) -> Figure:
    """Draw the power of each control, of a programme and of other forces apart, and the work they have done."""
    runs = listed(trajectory)
    names = list(dict.fromkeys(name for run in runs for name in run.controls))
    if not names:
        return empty_figure(runs, "Power", "the scene has no controls")
    asked = {name for run in runs for _, programme in programmes_of(run.scene) for name in programme.controls}
    peaks = {name: max(float(np.abs(run.power(name)).max()) for run in runs if name in set(run.controls)) for name in names}
    groups = {"programme": [n for n in names if n in asked], "forces": [n for n in names if n not in asked]}

    def label(name: str) -> str:
        if len(runs) > 1:
            return force_symbol(name)
        return f"{force_symbol(name)}: up to {peaks[name]:.3g} W, mean {np.abs(runs[0].power(name)).mean():.3g} W"

    panels: list[Panel] = []
    for what, group in groups.items():
        shown = [name for name in group if name in sorted(group, key=lambda name: -peaks[name])[:MOST]]
        which = what if len(shown) == len(group) else f"{what}, {MOST} largest"
        which = force_symbol(group[0]) if len(group) == 1 else which
        where = f"\n({which})" if asked else ""
        if group:
            watts = [Series(label(name), k, power_reader(name)) for k, name in enumerate(shown)]
            joules = [Series(force_symbol(name), k, work_reader(name)) for k, name in enumerate(shown)]
            panels += [(f"power [W]{where}", watts), (f"work [J]{where}", joules)]
    return stacked(runs, "Power and work of the controls", panels, labels, by_link=False)


@styled
def strengths(trajectory: Runs, labels: Sequence[str] | None = None) -> Figure:
    """Draw the moments at ankle, knee and hip over published strengths of both legs, mean and standard deviation as bands.

    Strength is isometric, at the joint's best angle, of young men (Anderson, Madigan and Nussbaum 2007).
    """
    runs = listed(trajectory)
    moments = [joint_moments(run) for run in runs]
    joints = [joint for joint in STRENGTHS if any(joint in entry for entry in moments)]
    if not joints:
        return empty_figure(runs, "Joint moments", "no link of the scene is called legs, shin, thigh, trunk or lower_trunk")
    figure = new_figure(runs, 9.5, 1.2 + 2.1 * len(joints), "Joint moments of both legs and published strengths")
    for ax, joint in zip(figure.subplots(len(joints), 1, sharex=True, squeeze=False)[:, 0], joints, strict=True):
        for strength, colour in zip(STRENGTHS[joint], ("#009E73", "#CC79A7"), strict=True):
            mean, deviation = both_legs(strength)
            ax.axhspan(mean - deviation, mean + deviation, color=colour, alpha=0.18, linewidth=0.0)
            ax.axhline(mean, color=colour, linewidth=1.0, label=strength.way)
        first = next(k for k, entry in enumerate(moments) if joint in entry)  # names the lines of all
        for k, (run, entry) in enumerate(zip(runs, moments, strict=True)):
            if joint in entry:
                forwards, right = entry[joint]
                dashes = DASHES[k % len(DASHES)]
                ax.plot(run.t, forwards, color=PALETTE[k % len(PALETTE)], linestyle=dashes, label="moment" if k == first else "_")
                if right.any():
                    ax.plot(run.t, right, color=GREY, linewidth=0.9, linestyle=dashes, label="sideways" if k == first else "_")
        ax.axhline(0.0, color="#999999", linewidth=0.8, zorder=0.5)
        ax.set_xlim(min(run.t[0] for run in runs), max(run.t[-1] for run in runs) or 1.0)
        ax.set_ylabel(f"{joint} [N m]")
        legend_beside(ax)
    figure.axes[-1].set_xlabel(
        "$t$ [s]\nmoments about the ski's left, positive forwards; sideways: to its right, no strength quoted\n"
        "strengths: isometric, best angle, men of 18 to 25 years, mean and standard deviation (Anderson et al. 2007)"
    )
    align(figure.axes)
    return finish(figure, runs, labels, by_link=False)


@styled
def convergence(curves: Mapping[str, tuple[Sequence[float], Sequence[float]]], title: str, what: str) -> Figure:
    """Draw errors over the step, [s], of several methods on log axes, with the slopes of the fitted lines."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter

    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    figure.suptitle(plain(title), fontsize=10.5)
    ax = figure.subplots()
    for k, (name, (steps, errors)) in enumerate(curves.items()):
        colour = PALETTE[k % len(PALETTE)]
        fit = np.polyfit(np.log(steps), np.log(errors), 1)
        ax.loglog(steps, errors, "o", color=colour, markersize=5)
        ax.loglog(steps, np.exp(np.polyval(fit, np.log(steps))), color=colour, label=f"{name}: slope {fit[0]:.2f}")
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.set_xlabel("step [s]")
    ax.set_ylabel(what)
    ax.legend()
    return figure
