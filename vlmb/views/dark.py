"""Figures on a dark ground: every colour of a finished figure by its counterpart."""

from __future__ import annotations

import colorsys
from typing import TYPE_CHECKING, Any

import numpy as np

from vlmb.views.style import BANDS, PALETTE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GROUND, INK = "#14181d", "#e6e8ea"
GRID = "#333a42"
BRIGHT = ("#4FB0F0", "#FF8A45", "#2CC99A", "#F2B632", "#E693C4", "#9AD4FF")  # PALETTE, as it reads on a dark ground


def darkened(figure: Figure) -> Figure:
    """Put a figure on a dark ground, as it is: grey tones are turned over, the colours of links and runs brightened."""
    from matplotlib.collections import Collection, QuadMesh
    from matplotlib.colors import to_rgb
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.text import Text

    for artist in {id(entry): entry for entry in figure.findobj()}.values():
        if isinstance(artist, (Line2D, Text)):
            artist.set_color(counterpart(artist.get_color()))
        elif isinstance(artist, (Patch, Collection)) and (band := _band(artist.get_facecolor())):
            artist.set_facecolor((*_deep(to_rgb(band)), 0.35))
        elif isinstance(artist, Patch):
            artist.set_facecolor(counterpart(artist.get_facecolor()))
            artist.set_edgecolor(counterpart(artist.get_edgecolor()))
        elif isinstance(artist, Collection) and not isinstance(artist, QuadMesh) and artist.get_array() is None:
            artist.set_facecolor([counterpart(colour) for colour in artist.get_facecolor()])
            artist.set_edgecolor([counterpart(colour) for colour in artist.get_edgecolor()])
    for ax in figure.axes:
        ax.tick_params(which="both", colors=INK, grid_color=GRID)
    return figure


def _deep(colour: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return a pale colour of the same hue as it is told from others on a dark ground."""
    hue, _, saturation = colorsys.rgb_to_hls(*colour)
    return colorsys.hls_to_rgb(hue, 0.45, 0.6 if saturation > 0.0 else 0.0)


def _band(colours: Any) -> str | None:
    """Return the colour of a band of phases, where it is one."""
    from matplotlib.colors import to_hex

    found = np.atleast_2d(colours)
    return next((band for band in BANDS if len(found) == 1 and to_hex(found[0]) == band), None)


def counterpart(colour: Any) -> Any:
    """Return what a colour becomes on a dark ground; none stays none."""
    from matplotlib.colors import to_hex, to_rgb, to_rgba

    if isinstance(colour, str) and colour.lower() == "none":
        return colour
    opacity = to_rgba(colour)[3]
    shown = to_hex(colour).upper()
    known = {entry.upper(): bright for entry, bright in zip(PALETTE, BRIGHT, strict=True)}
    if shown in known:
        return (*to_rgb(known[shown]), opacity)
    hue, light, saturation = colorsys.rgb_to_hls(*to_rgb(colour))
    if saturation > 0.15:
        return (*colorsys.hls_to_rgb(hue, max(light, 0.55), saturation), opacity)
    ground, ink = to_rgb(GROUND), to_rgb(INK)
    return (*(light * dark + (1.0 - light) * bright for dark, bright in zip(ground, ink, strict=True)), opacity)
