"""Figures of a run with robots: joints over time, energy, efforts over their limits, errors of rows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import VlmbError
from vlmb.scene.names import ENERGIES
from vlmb.simulation.robot_trajectory import RobotTrajectory
from vlmb.views.style import new_figure, style, write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

MANY = 12  # lines that a legend names: of more those that vary most
ZERO = 1e-18  # where an exact zero is drawn on a log axis


def save_robot_plots(run: Any, folder: str | Path) -> list[Path]:
    """Write the figures of a run as PNG files into a folder and return their paths. Raises VlmbError without matplotlib."""
    if not isinstance(run, RobotTrajectory):
        raise VlmbError("runs of robots and of links alone share no figure: plot them one after the other")
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    return [write(figure, folder / f"{name}.png") for name, figure in _figures(run).items()]


def _figures(run: RobotTrajectory) -> dict[str, Figure]:
    names = run.mechanism.names
    with style():
        found = {"joints": _lines(run, {q.name: run[q.name] for q in names.coordinates}, "coordinates [rad, m]")}
        found["rates"] = _lines(run, {q.name: run[f"{q.name}_dot"] for q in names.coordinates}, "rates [rad/s, m/s]")
        found["energy"] = _lines(run, {name: run[name] for name in ENERGIES if name != "balance"}, "energy [J]")
        if run.controls:
            limits = {name.partition(":")[2]: share for name, share in run.shares.items() if name.startswith("effort:")}
            found["controls"] = _lines(run, _shares(run.controls, limits), "controls / limits of the URDF")
        errors = {f"{name}{end}": values for name, residual in run.residuals.items()
                  for end, values in (("", residual.position), ("'", residual.velocity)) if values is not None}  # fmt: skip
        if errors:
            sizes = {name: np.maximum(np.abs(values), ZERO) for name, values in errors.items()}
            found["residuals"] = _lines(run, sizes, "errors of rows", log=True)
    return found


def _shares(controls: Mapping[str, Array], limits: Mapping[str, float]) -> dict[str, Array]:
    """Controls over their limits."""
    found = {}
    for name, values in controls.items():
        most = float(np.fmax.reduce(np.abs(values)))
        found[name] = values * (limits[name] / most) if name in limits and most > 0.0 else values
    return found


def _lines(run: RobotTrajectory, lines: Mapping[str, Array], label: str, log: bool = False) -> Figure:
    figure = new_figure([run], 9.0, 4.2, label)
    ax = figure.subplots()
    spread = {name: float(np.fmax.reduce(values) - np.fmin.reduce(values)) for name, values in lines.items()}
    named = sorted(lines, key=lambda name: -spread[name])[:MANY]
    for name, values in lines.items():
        known = name in named
        ax.plot(run.t, values, label=name if known else "_", linewidth=1.4 if known else 0.6, alpha=1.0 if known else 0.4)
    if log:
        ax.set_yscale("log")
    ax.set_xlabel("$t$ [s]")
    ax.set_ylabel(label)
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small")
    return figure
