"""Figures of a run with robots: joints and rates by their units, energy, controls over their limits, reactions, residuals."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import VlmbError, nearest
from vlmb.scene.names import ENERGIES
from vlmb.simulation.robot_trajectory import RobotTrajectory
from vlmb.views.dark import darkened
from vlmb.views.style import BLACK, DASHES, PALETTE, align, decades, draw_phases, finish, legend_beside, new_figure, style, write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

MANY = 12  # lines that a legend names: of more those that vary most
ZERO = 1e-18  # where an exact zero is drawn on a log axis
DOTTED = {"rad": "rad/s", "m": "m/s"}
KINDS = {"rad": "angles", "m": "positions", "N": "forces", "N m": "torques"}


class Panel(NamedTuple):
    """Lines over time under one label; on a log axis if they are sizes of errors."""

    label: str
    lines: Mapping[str, Array]
    log: bool = False


def save_robot_plots(run: Any, folder: str | Path, only: Iterable[str] | None = None, dark: bool = False) -> list[Path]:
    """Write the figures of a run as PNG files into a folder and return their paths; `only` some of them, by name.

    Raises VlmbError for an unknown name, for runs without robots, and without matplotlib.
    """
    if not isinstance(run, RobotTrajectory):
        raise VlmbError("runs with robots and runs of links alone share no figure: plot each run by itself")
    wanted = list(FIGURES) if only is None else list(dict.fromkeys(only))
    for name in wanted:
        if name not in FIGURES:
            raise VlmbError(f"no plot {name!r} of a run with robots; {nearest(name, FIGURES)}")
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    with style():
        for name in wanted:
            title, read = FIGURES[name]
            panels = [panel for panel in read(run) if panel.lines]
            if panels:
                figure = _stacked(run, title, panels)
                written.append(write(darkened(figure) if dark else figure, folder / f"{name}.png"))
            elif only is not None:
                raise VlmbError(f"the plot {name!r} would be empty: this run has nothing of the kind")
    return written


def _joints(run: RobotTrajectory) -> list[Panel]:
    units = {quantity.name: quantity.unit for quantity in run.mechanism.names.coordinates}
    return [Panel(f"{KINDS[unit]} [{unit}]", {name: run[name] for name in units if units[name] == unit}) for unit in DOTTED]


def _rates(run: RobotTrajectory) -> list[Panel]:
    units = {quantity.name: quantity.unit for quantity in run.mechanism.names.coordinates}
    return [
        Panel(f"rates [{dotted}]", {name: run[f"{name}_dot"] for name in units if units[name] == unit})
        for unit, dotted in DOTTED.items()
    ]


def _energy(run: RobotTrajectory) -> list[Panel]:
    lines = {("total" if name == "energy" else name): run[name] for name in ENERGIES if name != "balance"}
    return [Panel("energy [J]", {name: line for name, line in lines.items() if line.any()}),
            Panel("balance [J]", {"balance": run["balance"]})]  # fmt: skip


def _controls(run: RobotTrajectory) -> list[Panel]:
    """Controls over the limits of the URDF where it has any, the others in their units."""
    limits = {name.partition(":")[2]: share for name, share in run.shares.items() if name.startswith("effort:")}
    shares: dict[str, Array] = {}
    others: dict[str, dict[str, Array]] = {}
    units = {column.name: column.unit for column in run.columns()}
    for name, values in run.controls.items():
        most = float(np.fmax.reduce(np.abs(values)))
        if name in limits and most > 0.0:
            shares[name] = values * (limits[name] / most)
        else:
            others.setdefault(units.get(name, ""), {})[name] = values
    labelled = [Panel(f"{KINDS.get(unit, 'controls')} [{unit}]", lines) for unit, lines in others.items()]
    return [Panel("controls over the limits\nof the URDF", shares), *labelled]


def _reactions(run: RobotTrajectory) -> list[Panel]:
    forces: dict[str, Array] = {}
    moments: dict[str, Array] = {}
    for name, values in run.reactions.items():
        if name in ("roll_moment", "pitch_moment"):
            moments[name] = values
        elif values.ndim == 1:
            forces[name] = values
        else:
            forces[name] = np.linalg.norm(values[:, :3], axis=1)
            if values.shape[1] == 6:
                moments[name] = np.linalg.norm(values[:, 3:], axis=1)
    return [Panel("reactions [N, N m]", forces), Panel("moments [N m]", moments)]


def _residuals(run: RobotTrajectory) -> list[Panel]:
    def sizes(level: str) -> dict[str, Array]:
        found = {name: getattr(residual, level) for name, residual in run.residuals.items()}
        return {name: np.maximum(np.abs(values), ZERO) for name, values in found.items() if values is not None}

    return [Panel("|error|", sizes("position"), log=True), Panel("|rate of error|", sizes("velocity"), log=True)]


FIGURES: dict[str, tuple[str, Callable[[RobotTrajectory], list[Panel]]]] = {
    "joints": ("Joints", _joints), "rates": ("Rates of the joints", _rates), "energy": ("Energy account", _energy),
    "controls": ("Controls", _controls), "reactions": ("Reactions", _reactions),
    "residuals": ("Constraint residuals", _residuals),
}  # fmt: skip


def _stacked(run: RobotTrajectory, title: str, panels: list[Panel]) -> Figure:
    figure = new_figure([run], 9.0, 1.0 + 2.9 * len(panels), title)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for ax, panel in zip(axes, panels, strict=True):
        spread = {name: float(np.fmax.reduce(values) - np.fmin.reduce(values)) for name, values in panel.lines.items()}
        named = sorted(panel.lines, key=lambda name: -spread[name])[:MANY]
        rank = {name: k for k, name in enumerate(name for name in panel.lines if name in named)}
        for name, values in panel.lines.items():
            if name not in rank:
                ax.plot(run.t, values, color="#bbbbbb", linewidth=0.6, label="_", zorder=1.5)
                continue
            look = {"color": PALETTE[rank[name] % len(PALETTE)], "linestyle": DASHES[rank[name] // len(PALETTE) % len(DASHES)]}
            ax.plot(run.t, values, label=name, **(look if len(panel.lines) > 1 else {"color": BLACK}))
        if panel.log:
            sizes = np.concatenate([values[np.isfinite(values)] for values in panel.lines.values()])
            if sizes.size:
                decades(ax, float(sizes.min()), float(sizes.max()))
        ax.set_xlim(run.t[0], run.t[-1] if run.t[-1] > run.t[0] else run.t[0] + 1.0)
        ax.set_ylabel(panel.label)
        draw_phases(ax, run)
        legend_beside(ax)
    axes[-1].set_xlabel("$t$ [s]")
    align(figure.axes)
    return finish(figure, [run], None, by_link=False)
