"""Figures of contacts: what the ground is asked for beside what it gives, and where it pushes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vlmb.scene.tables import Contact
from vlmb.simulation.trajectory import Trajectory
from vlmb.views.panels import Panel, stacked
from vlmb.views.paths import Runs, listed
from vlmb.views.style import Series, empty_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Reader = Callable[[Trajectory], "Array | None"]

LIGHT = 1e-6  # of the largest normal force: below it a contact pushes nowhere, and asks for no friction
USUAL = 95.0  # per cent of the samples that stay below what is taken for usual
FLAT = "z"  # the surface on which a centre of pressure lies
BELOW = "#999999"  # of what the ground gives, and of where feet stand


@styled
def contacts(trajectory: Runs, labels: Sequence[str] | None = None) -> Figure:
    """Draw normal forces of contacts, the friction that each needs beside what the ground gives, and the centre of pressure.

    Friction needed is |F_t| / F_n, of a contact that holds or slides. The centre of pressure is that of all contacts with the
    ground z = 0; grey lines are the feet that are closed.
    """
    runs = listed(trajectory)
    found = {contact.name: contact for run in runs for contact in run.scene.contacts}
    if not found:
        return empty_figure(runs, "Contacts", "the scene has no contacts")
    rough = [name for name, contact in found.items() if contact.friction != 0.0]
    panels: list[Panel] = [("normal force [N]", [Series(name, k, normal_reader(name)) for k, name in enumerate(found)])]
    if rough:
        needed = [Series(name, k, needed_reader(name)) for k, name in enumerate(rough)]
        panels.append(("friction needed\n$|F_t|/F_n$ [1]", needed))
    flat = [name for name, contact in found.items() if contact.surface.strip() == FLAT]
    axes = [axis for axis in "xy" if flat and not (axis == "y" and all(run.scene.plane for run in runs))]
    panels += [(f"centre of pressure\n${axis}$ [m]", [Series("_", 0, pressure_reader(flat, axis))]) for axis in axes]
    figure = stacked(runs, "Contacts", panels, labels, by_link=False, legends_above=True)
    if rough:
        _limits(figure.axes[1], [found[name] for name in rough])
    for ax, axis in zip(figure.axes[len(panels) - len(axes) :], axes, strict=True):
        _feet(ax, runs, found, flat, "xyz".index(axis))
    return figure


def normal_reader(name: str) -> Reader:
    """Read the normal force [N] of a contact."""
    return lambda run: run.reactions[name][:, 2] if name in set(run.reactions) else None


def needed_reader(name: str) -> Reader:
    """Read the ratio of friction to normal force of a contact; nan where it does not push."""

    def read(run: Trajectory) -> Array | None:
        if name not in set(run.reactions):
            return None
        force = run.reactions[name]
        across, normal = np.linalg.norm(force[:, :2], axis=1), force[:, 2]
        pushes = normal > LIGHT * max(float(normal.max()), 1e-300)
        return np.where(pushes, across / np.where(pushes, normal, 1.0), np.nan)

    return read


def pressure_reader(names: Sequence[str], axis: str) -> Reader:
    """Read the centre of pressure [m] of contacts with the ground; nan where none pushes."""

    def read(run: Trajectory) -> Array | None:
        own = [contact for contact in run.scene.contacts if contact.name in names]
        if not own:
            return None
        found: Array = run.centre_of_pressure(*(contact.name for contact in own))[:, "xyz".index(axis)]
        return found

    return read


def _limits(ax: Axes, found: Sequence[Contact]) -> None:
    """Draw what the ground gives as dashes, and leave out of the scale what lies far above."""
    gives = {float(limit) for contact in found if (limit := _given(contact)) is not None and math.isfinite(limit)}
    for limit in gives:
        ax.axhline(limit, color=BELOW, linestyle="--", linewidth=1.0, zorder=0.5, label="_")
    needed = [np.asarray(line.get_ydata(), float) for line in ax.lines]
    shown = np.concatenate([values[np.isfinite(values)] for values in needed if len(values) > 2] or [np.zeros(1)])
    usual = 1.5 * float(np.percentile(shown, USUAL)) if len(shown) else 0.0  # just before it lifts a foot needs any friction
    ax.set_ylim(0.0, 1.25 * max(gives) if gives else max(min(float(shown.max(initial=0.0)) * 1.05, usual), 0.1))


def _given(contact: Contact) -> float | None:
    """Return the coefficient of friction of a contact at rest; None where it is rough."""
    given = contact.friction if contact.friction_static is None else contact.friction_static
    return None if isinstance(given, str) else given


def _feet(ax: Axes, runs: Sequence[Trajectory], found: dict[str, Contact], names: Sequence[str], axis: int) -> None:
    """Draw where feet stand that are closed."""
    for run in runs:
        for name in names:
            if name not in set(run.reactions):
                continue
            point = found[name].point
            place = run[f"{point}.{'xyz'[axis]}" if "." in point else "xyz"[axis]]
            stands = np.where(np.linalg.norm(run.reactions[name], axis=1) > 0.0, place, np.nan)
            ax.plot(run.t, stands, color=BELOW, linewidth=3.0, alpha=0.6, zorder=0.5, label="_")
