"""The figure of the way: a ski's track from above with the rider's lean, or the tips of a chain from above and from the side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Union

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import VlmbError
from vlmb.simulation.trajectory import Trajectory
from vlmb.system.stops import StopPoint
from vlmb.views.reference_path import course
from vlmb.views.style import BLACK, DASHES, GREY, PALETTE, finish, legend_beside, link_colour, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Runs = Union[Trajectory, Sequence[Trajectory]]  # noqa: UP007 - evaluated, and Python 3.10 lacks the other form here
POSTURES = 21  # postures drawn along a motion
ABOVE, SIDE = (0, 1), (0, 2)


@styled
def path(trajectory: Runs, labels: Sequence[str] | None = None) -> Figure:
    """Draw the track of a ski from above with the rider's lean and centre of mass, and the lean over time.

    Without a ski: the paths of the tips from above and from the side, with postures in between.
    """
    runs = listed(trajectory)
    if all(run.mechanism.layout.on_snow for run in runs):
        return _track(runs, labels)
    return _tips(runs, labels)


def _track(runs: Sequence[Trajectory], labels: Sequence[str] | None) -> Figure:
    riders = any(run.scene.links for run in runs)
    spans = [np.ptp(np.concatenate([_everything(run)[..., axis].ravel() for run in runs])) + 1e-3 for axis in (0, 1)]
    height = float(np.clip(8.0 * spans[1] / spans[0], 2.2, 6.5))
    figure = new_figure(runs, 9.5, height + 1.3 + 1.9 * riders, "Track from above")
    rows = figure.subplots(1 + riders, 1, squeeze=False, height_ratios=[height, 1.7][: 1 + riders])[:, 0]
    ax = rows[0]
    for k, run in enumerate(runs):
        alone, dashes = len(runs) == 1, DASHES[k % len(DASHES)]
        colour = BLACK if alone else PALETTE[k % len(PALETTE)]
        ax.plot(run["x"], run["y"], color=colour, linestyle=dashes, linewidth=1.6, label="ski" if alone else "_", zorder=3)
        ax.plot(run["x"][:1], run["y"][:1], "o", color=colour, markersize=5, label="start" if alone else "_", zorder=4)
        way = course(run.scene, run.t, run["speed"], (run["x"][0], run["y"][0], run["phi0"][0]))
        if way is not None and alone:
            ax.plot(way[:, 0], way[:, 1], color=PALETTE[2], linestyle=DASHES[1], linewidth=1.2, label="course", zorder=3.5)
        if run.scene.links:
            centre, when = centre_of_mass(run), _even_times(run)
            lean = PALETTE[0] if alone else colour
            ax.plot(centre[:, 0], centre[:, 1], color=lean, linewidth=1.0, label="centre of mass" if alone else "_")
            _postures(ax, run, when, ABOVE, GREY if alone else colour, "links" if alone else "_")
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel("$x$ [m]")
    ax.set_ylabel("$y$ [m]")
    if any(run.scene.slope for run in runs):
        _fall_line(ax)
    if len(runs) == 1:
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=5, borderaxespad=0.2)
    if riders:
        _lean(rows[1], runs)
    return finish(figure, runs, labels, by_link=False)


def _lean(ax: Axes, runs: Sequence[Trajectory]) -> None:
    """Draw how far the centre of mass leans from the surface normal over the ski: to the left, and, for one run, forward."""
    for k, run in enumerate(runs):
        if not run.scene.links:
            continue
        offset = centre_of_mass(run) - np.stack([run["x"], run["y"], np.zeros(len(run))], axis=1)
        heading = run["phi0"]
        left = -np.sin(heading) * offset[:, 0] + np.cos(heading) * offset[:, 1]
        forward = np.cos(heading) * offset[:, 0] + np.sin(heading) * offset[:, 1]
        alone, run_colour = len(runs) == 1, PALETTE[k % len(PALETTE)]
        both = [(left, PALETTE[1] if alone else run_colour, "to the left"), (forward, PALETTE[2], "forward")]
        for values, colour, name in both if alone else both[:1]:
            lean = np.degrees(np.unwrap(np.arctan2(values, offset[:, 2])))
            ax.plot(run.t, lean, color=colour, linestyle=DASHES[k % len(DASHES)], label=name if alone else "_")
    ax.axhline(0.0, color="#999999", linewidth=0.8, zorder=0.5)
    ax.set_xlim(min(run.t[0] for run in runs), max(run.t[-1] for run in runs) or 1.0)
    ax.set_xlabel("$t$ [s]")
    ax.set_ylabel("lean [deg]" if len(runs) == 1 else "lean to the left [deg]")
    if len(runs) == 1:
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)


def _tips(runs: Sequence[Trajectory], labels: Sequence[str] | None) -> Figure:
    flat = all(run.scene.plane for run in runs)
    views = [(ABOVE, "from above", "$y$ [m]"), (SIDE, "from the side", "$z$ [m]")][flat:]
    figure = new_figure(runs, 1.4 + 4.6 * len(views), 5.4, "Paths of the tips")
    axes = figure.subplots(1, len(views), squeeze=False)[0]
    links = max(len(run.scene.links) for run in runs)
    for ax, (plane, title, across) in zip(axes, views, strict=True):
        for k, run in enumerate(runs):
            _postures(ax, run, _even_times(run), plane, "#b9b9b9" if len(runs) == 1 else PALETTE[k % len(PALETTE)], "_")
            for i, link in enumerate(run.scene.links):
                tip = run.position(link.name, "tip")
                alone = len(runs) > 1 and links == 1
                colour = PALETTE[k % len(PALETTE)] if alone else link_colour(i, links)
                ax.plot(tip[:, plane[0]], tip[:, plane[1]], color=colour, linestyle=DASHES[k % len(DASHES)], linewidth=1.0,
                        label="tip" if alone else f"tip of {link.name}")  # fmt: skip
                ax.plot(tip[:1, plane[0]], tip[:1, plane[1]], "o", color=colour, markersize=4, label="_")
            if run.mechanism.layout.base == "free" and run.scene.base.mass:
                place = np.stack([run[axis] if axis in run.names else np.zeros(len(run)) for axis in "xyz"], axis=1)
                label = "base" if len(runs) == 1 or not links else "_"
                ax.plot(place[:, plane[0]], place[:, plane[1]], color=BLACK if len(runs) == 1 else PALETTE[k % len(PALETTE)],
                        linestyle=DASHES[k % len(DASHES)], linewidth=1.0, label=label)  # fmt: skip
            stood = footholds(run)
            if len(stood):
                ax.plot(stood[:, plane[0]], stood[:, plane[1]], "v", color=GREY, markersize=4, label="_", zorder=1.2)
            if run.mechanism.layout.base == "pivot":
                ax.plot([0.0], [0.0], "^", color=BLACK, markersize=7, label="_", zorder=5)
        ax.set_aspect("equal", adjustable="datalim")
        ax.set_title(title)
        ax.set_xlabel("$x$ [m]")
        ax.set_ylabel(across)
    legend_beside(axes[-1])
    return finish(figure, runs, labels)


def footholds(run: Trajectory) -> Array:
    """Return the places (n, 3) [m] at which contacts and legs came down and stayed."""
    found = dict.fromkeys(
        stretch.footings[point.index].place
        for stretch in run.stretches for point in run.system.points
        if point.closed(stretch.footings[point.index]) and not isinstance(point, StopPoint) and point.edge is None
    )  # fmt: skip
    return np.array(list(found)).reshape(-1, 3)


def _postures(ax: Axes, run: Trajectory, when: Array, plane: tuple[int, int], colour: Any, label: str) -> None:
    """Draw the links at some instants, seen along the axis that `plane` leaves out."""
    from matplotlib.collections import LineCollection

    lines: list[Any] = []
    for link in run.scene.links:
        ends = np.stack([run.position(link.name, "hinge")[when], run.position(link.name, "tip")[when]], axis=1)
        lines += list(ends[:, :, plane])
    ax.add_collection(LineCollection(lines, colors=[colour], linewidths=0.7, alpha=0.75, label=label, zorder=1.5))
    ax.autoscale_view()


def _fall_line(ax: Axes) -> None:
    ax.annotate("", xy=(0.11, 1.04), xytext=(0.0, 1.04), xycoords="axes fraction", annotation_clip=False,
                arrowprops={"arrowstyle": "-|>", "color": "#555555", "shrinkA": 0, "shrinkB": 0})  # fmt: skip
    ax.text(0.12, 1.04, "fall line", transform=ax.transAxes, va="center", color="#555555")


def _even_times(run: Trajectory) -> Array:
    """Return indices of samples at even times."""
    times = np.linspace(run.t[0], run.t[-1], POSTURES)
    return np.unique(np.clip(np.searchsorted(run.t, times), 0, len(run) - 1))


def _everything(run: Trajectory) -> Array:
    """Points (samples, points, 3) that a picture must hold."""
    points = [run.position(link.name, "tip") for link in run.scene.links]
    if run.mechanism.layout.on_snow:
        points.append(np.stack([run["x"], run["y"], np.zeros(len(run))], axis=1))
    return np.stack(points, axis=1)


def centre_of_mass(run: Trajectory) -> Array:
    """Centre of mass (N, 3) [m] of the whole mechanism in the surface frame."""
    return np.stack([run[f"com.{axis}"] for axis in "xyz"], axis=1)


def listed(trajectory: Runs) -> list[Trajectory]:
    """Return the runs as a list; VlmbError when there are none."""
    runs = [trajectory] if isinstance(trajectory, Trajectory) else list(trajectory)
    if not runs or not all(len(run) for run in runs):
        raise VlmbError("nothing to plot: no run, or a run without samples")
    return runs
