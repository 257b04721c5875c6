"""Panels over time, and how their lines are read from a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vlmb.model.layout import Coordinate
from vlmb.simulation.trajectory import Trajectory
from vlmb.views.style import Series, align, draw, finish, label_size, legend_beside, new_figure, reveal

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Panel = tuple[str, list[Series]]  # label of the y axis, lines

ZERO = 1e-18  # where an exact zero, and anything smaller than this, is drawn on a log axis


def stacked(
    runs: Sequence[Trajectory], title: str, panels: Sequence[Panel], labels: Sequence[str] | None,
    heights: Sequence[float] | None = None, by_link: bool = True, zero_line: Sequence[str] = (), legends_above: bool = False,
) -> Figure:  # fmt: skip
    """Draw panels over a common time axis; a legend above that all panels share is drawn once."""
    listed = max(sum(line.label.count("\n") + 1 for line in lines) for _, lines in panels) if legends_above else 0
    figure = new_figure(runs, 9.0, 1.0 + 0.08 * listed + 1.9 * (sum(heights) if heights else len(panels)), title)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    shares = [height / sum(heights) for height in heights] if heights else [1.0 / len(panels)] * len(panels)
    for ax, (name, lines), share in zip(axes, panels, shares, strict=True):
        links = None if by_link else 1 + max((line.link for line in lines), default=0)
        draw(ax, runs, lines, links=links, by_run=all(len(entries) == 1 for _, entries in panels))
        ax.set_ylabel(name, fontsize=label_size(name, share * (figure.get_figheight() - 1.0 - 0.08 * listed)))
        if name.startswith(tuple(zero_line)) and zero_line:
            ax.axhline(0.0, color="#999999", linewidth=0.8, zorder=0.5, label="_")
        if len(runs) == 1 and not legends_above:
            reveal(ax)
    fullest = max(range(len(panels)), key=lambda k: len(panels[k][1]))
    known = {line.label for line in panels[fullest][1]}
    shared = legends_above and all({line.label for line in lines} <= known for _, lines in panels)
    for k, ax in enumerate(axes):
        if not shared:
            legend_beside(ax, above=legends_above)
        elif k == 0:
            legend_beside(ax, above=True, of=axes[fullest])
    axes[-1].set_xlabel("$t$ [s]")
    align(figure.axes)
    return finish(figure, runs, labels, by_link)


def all_coordinates(runs: Sequence[Trajectory]) -> list[Coordinate]:
    """Return the coordinates of all runs, each once."""
    return list(dict.fromkeys(c for run in runs for c in run.mechanism.layout.coordinates))


def colour_number(coordinate: Coordinate) -> int:
    """Return a coordinate's link; -1, -2, -3 for x, y, z of the base."""
    return {"y": -2, "z": -3}.get(coordinate.kind, coordinate.link)


def reader(name: str) -> Callable[[Trajectory], Array | None]:
    """Read a named quantity, None from a run that has no such coordinate."""

    def read(run: Trajectory) -> Array | None:
        return run[name] if name in run.names else None

    return read


def residual_reader(name: str, level: str) -> Callable[[Trajectory], Array | None]:
    """Read the size of a residual at a level, zeros lifted onto the log axis."""

    def read(run: Trajectory) -> Array | None:
        values = getattr(run.residuals[name], level) if name in set(run.residuals) else None
        return None if values is None else np.maximum(np.abs(values), ZERO)

    return read


def mapped_reader(mapping: str, name: str) -> Callable[[Trajectory], Array | None]:
    """Read a control or a reaction."""

    def read(run: Trajectory) -> Array | None:
        found = getattr(run, mapping)
        return np.asarray(found[name]) if name in set(found) else None

    return read


def contact_reader(name: str) -> Callable[[Trajectory], Array | None]:
    """Read the size of the force of a contact."""

    def read(run: Trajectory) -> Array | None:
        return np.asarray(np.linalg.norm(run.reactions[name], axis=1)) if name in set(run.reactions) else None

    return read


def hinge_reader(link: str) -> Callable[[Trajectory], Array | None]:
    """Read the size of the force in a link's hinge."""

    def read(run: Trajectory) -> Array | None:
        if link not in {entry.name for entry in run.scene.links}:
            return None
        return np.asarray(np.linalg.norm(run.hinge_force(link), axis=1))

    return read


def power_reader(name: str) -> Callable[[Trajectory], Array | None]:
    """Read the power [W] of a control."""
    return lambda run: run.power(name) if name in set(run.controls) else None


def work_reader(name: str) -> Callable[[Trajectory], Array | None]:
    """Read the work [J] of a control since the start."""
    return lambda run: run.work_by_force[name] if name in set(run.controls) else None
