"""Eigenvalues of linearizations in the complex plane: of one with its modes numbered, of several along what was varied."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import VlmbError
from vlmb.model.names import plain
from vlmb.studies.linearize import DEFECTIVE, FAMILY, Linear
from vlmb.studies.modes import GROWS
from vlmb.views.dark import darkened
from vlmb.views.style import BANDS, BLACK, GREY, PALETTE, style, styled, write

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

STABLE = BANDS[2]
WIDE = 20.0  # ratio of the largest to the smallest eigenvalue beyond which axes are logarithmic
ROOM, LETTER, LINE = 4.0, 5.4, 9.0  # [pt] beside a point, and of its number
SPOTS = (
    (1.0, 0.5), (1.0, -0.5), (-1.0, 0.5), (-1.0, -0.5), (0.0, 1.0), (0.0, -1.0),
    (1.0, 1.4), (-1.0, 1.4), (1.0, -1.4), (-1.0, -1.4),
)  # fmt: skip
MARGIN = 0.12  # of the span of the points
MARKS: dict[str, dict[str, Any]] = {
    "decays": {"marker": "o", "color": PALETTE[0]},
    "stays": {"marker": "o", "color": GREY},
    "grows": {"marker": "o", "color": PALETTE[1]},
    FAMILY: {"marker": "o", "color": BLACK, "markerfacecolor": "none"},
    DEFECTIVE: {"marker": "x", "color": PALETTE[1], "markeredgewidth": 1.6},
}


@styled
def eigenvalues(
    linear: Linear | Sequence[Linear], values: Sequence[float] | None = None, varied: str = ""
) -> Figure:
    """Draw eigenvalues in the complex plane, the stable half shaded; modes have the numbers of `linear.eigenvalues`.

    Of several linearizations it is the locus of the roots, coloured by what was varied.

    Parameters
    ----------
    values : (N,) of what was varied, one for each linearization; default: their places in the list
    varied : its name, beside the scale of colours

    Raises VlmbError where there is no eigenvalue, or not one value for each linearization.
    """
    from matplotlib.figure import Figure

    several = [linear] if isinstance(linear, Linear) else list(linear)
    if not sum(len(entry.eigenvalues) for entry in several):
        raise VlmbError("eigenvalues: this motion has none: nothing in it can deviate")
    if values is not None and len(values) != len(several):
        raise VlmbError(f"eigenvalues: {len(values)} values for {len(several)} linearizations; give one for each")
    figure = Figure(figsize=(7.0, 4.8), layout="constrained")
    ax = figure.subplots()
    points = np.concatenate([entry.eigenvalues for entry in several])
    _scale(ax, points)
    if isinstance(linear, Linear):
        _draw_modes(ax, linear)
        told = f"{linear.scene.name}: {linear.stability}"
    else:
        _draw_locus(figure, ax, several, np.arange(len(several), dtype=float) if values is None else np.asarray(values, float))
        figure.axes[-1].set_ylabel(plain(varied))
        told = several[0].scene.name
    ax.axvspan(ax.get_xlim()[0], 0.0, color=STABLE, linewidth=0.0, zorder=0.05)
    for line in (ax.axvline, ax.axhline):
        line(0.0, color="#999999", linewidth=0.8, zorder=0.5)
    ax.set(xlabel="growth [1/s]", ylabel="swing [rad/s]")
    figure.suptitle(plain(f"Eigenvalues: {told}"), fontsize=10.5)
    return figure


def save_eigenvalues(linear: Linear, path: str | Path, dark: bool = False) -> Path:
    """Write the figure of a linearization's eigenvalues as a PNG file; `dark` puts it on a dark ground."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure = eigenvalues(linear)
    with style():
        return write(darkened(figure) if dark else figure, path)


def _kind(value: complex, label: str, size: float) -> str:
    """Say what a mode does: one of MARKS."""
    if label:
        return label
    return "stays" if abs(value.real) <= GROWS * size else "grows" if value.real > 0.0 else "decays"


def _draw_modes(ax: Axes, linear: Linear) -> None:
    size = max(1.0, float(np.abs(linear.eigenvalues).max()))
    kinds = [_kind(value, label, size) for value, label in zip(linear.eigenvalues, linear.labels, strict=True)]
    for kind, mark in MARKS.items():
        own = [value for value, its in zip(linear.eigenvalues, kinds, strict=True) if its == kind]
        if own:
            ax.plot(np.real(own), np.imag(own), linestyle="none", markersize=6.5, label=kind, **mark)
    _number(ax, linear.eigenvalues, size)
    ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.02), borderaxespad=0.0)


def _number(ax: Axes, values: NDArray[np.complex128], size: float) -> None:
    """Write the numbers of modes beside their points, both of a pair above; where all is taken, none."""
    numbers: dict[tuple[float, float], list[int]] = {}
    for k, value in enumerate(values):
        place = round(value.real / size, 4) + 0.0, abs(round(value.imag / size, 4))
        numbers.setdefault(place, []).append(k)
    points = ax.transData.transform(np.column_stack([values.real, values.imag])) * 72.0 / ax.figure.dpi
    taken = [(x - ROOM, y - ROOM, x + ROOM, y + ROOM) for x, y in points]
    for found in numbers.values():
        upper = max(found, key=lambda k: values[k].imag)
        text, (x, y) = ", ".join(map(str, found)), points[upper]
        width = LETTER * len(text)
        for across, up in SPOTS:
            dx = across * (ROOM + 1.0) - (width if across < 0.0 else 0.5 * width if across == 0.0 else 0.0)
            dy = up * (ROOM + LINE) - 0.5 * LINE
            box = x + dx, y + dy, x + dx + width, y + dy + LINE
            if any(box[0] < b[2] and b[0] < box[2] and box[1] < b[3] and b[1] < box[3] for b in taken):
                continue
            taken.append(box)
            ax.annotate(text, (values[upper].real, values[upper].imag), (dx, dy), textcoords="offset points", fontsize=8.0)
            break


def _draw_locus(figure: Figure, ax: Axes, several: Sequence[Linear], values: Array) -> None:
    colours = np.concatenate([np.full(len(entry.eigenvalues), value) for entry, value in zip(several, values, strict=True)])
    points = np.concatenate([entry.eigenvalues for entry in several])
    drawn = ax.scatter(points.real, points.imag, c=colours, cmap="viridis", s=14.0, zorder=2.0)
    figure.colorbar(drawn, ax=ax)


def _scale(ax: Axes, points: NDArray[np.complex128]) -> None:
    """Let all points be seen with some room, and the axis of growth with both halves; logarithmic where they differ widely."""
    sizes = np.abs(points)
    largest = max(float(sizes.max()), 1e-3)
    least = float(min(sizes[sizes > 1e-6 * largest], default=largest))
    wide = largest > WIDE * least
    for numbers, scale, limit in ((points.real, ax.set_xscale, ax.set_xlim), (points.imag, ax.set_yscale, ax.set_ylim)):
        low, high = min(float(numbers.min()), 0.0), max(float(numbers.max()), 0.0)
        if wide:
            even = 10.0 ** np.floor(np.log10(least))  # up to here the axis is linear
            scale("symlog", linthresh=even)
            limit(2.0 * low - even, 2.0 * high + even)
        else:
            room = MARGIN * max(high - low, 0.2 * largest)
            limit(low - 2.0 * room, high + 2.0 * room)
