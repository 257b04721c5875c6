"""Figure of measured data: the samples, the curve through them, and its second derivative."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from vlmb.model.names import plain
from vlmb.views.paths import Runs, listed
from vlmb.views.style import BLACK, GREY, PALETTE, calm, empty_figure, finish, legend_beside, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST = 8  # columns that are drawn
POINTS = 1000


@styled
def data(trajectory: Runs, labels: Sequence[str] | None = None) -> Figure:
    """Draw each column of measured data over the run: samples and curve, and the curve's second derivative beside them.

    Ends, where derivatives rest on samples of one side, are shaded. The data are those of the first run that has some.
    """
    runs = listed(trajectory)
    run = next((entry for entry in runs if entry.mechanism.signals), None)
    if run is None:
        return empty_figure(runs, "Measured data", "the scene has no measured data")
    columns = run.mechanism.signals.columns[:MOST]
    figure = new_figure([run], 10.0, 1.0 + 1.75 * len(columns), "Measured data")
    axes = figure.subplots(len(columns), 2, sharex=True, squeeze=False)
    for row, column in zip(axes, columns, strict=True):
        begin, end = max(column.span[0], float(run.t[0])), min(column.span[1], float(run.t[-1]))
        times = np.linspace(begin, max(end, begin), POINTS)
        shown = (column.time >= begin) & (column.time <= end)
        row[0].plot(column.time[shown], column.samples[shown], ".", color=GREY, markersize=3, label="samples")
        row[0].plot(times, column.values(times), color=BLACK, label="curve")
        row[1].plot(times, column.values(times, 2), color=PALETTE[0], label="_")
        unit = column.unit or "1"
        row[0].set_ylabel(f"{plain(column.name)} [{unit}]")
        row[1].set_ylabel(f"its 2nd derivative\n[{unit}/s²]")
        for ax in row:
            for low, high in column.ends:
                if high > begin and low < end:
                    ax.axvspan(max(low, begin), min(high, end), color="#eeeeee", zorder=0.1)
            calm(ax)
        legend_beside(row[0], above=True)
    for ax in axes[-1]:
        ax.set_xlabel("$t$ [s]")
    figure.align_ylabels()
    return finish(figure, [run], labels)
