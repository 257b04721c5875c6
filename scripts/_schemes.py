"""Draw the paper's figures 1 to 6: its mechanisms, from scenes that are built, with the names of points, angles and lengths."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

import vlmb
from vlmb.model.names import quantity_of
from vlmb.views.style import BLACK, GREY, PALETTE, style, write

LINK = {"rod": {"length": 0.55, "mass": 10.0}, "lower": {"length": 0.3}, "upper": {"length": 0.25}}
SKI = {"kind": "ski", "mass": 5.0, "inertia": 0.6}


class Scheme(NamedTuple):
    """A figure of the paper: its number, what it shows, links, base, posture in degrees."""

    number: int
    caption: str
    base: dict[str, Any]
    links: list[dict[str, Any]]
    phi: list[float]
    psi: list[float]
    heading: float = 0.0
    names: tuple[str, ...] = ()


def _links(*changes: dict[str, Any]) -> list[dict[str, Any]]:
    return [{**LINK, **entry} for entry in changes]


BODY = ("shins", "thighs", "trunk", "trunk", "neck, head")
SCHEMES = (
    Scheme(1, "one link of variable length", {"kind": "pivot"}, _links({}), [50], [48]),
    Scheme(2, "two links of variable length", {"kind": "pivot"}, _links({}, {}), [70, 105], [62, 35]),
    Scheme(3, "n links, the phase of single support (drawn: 4)", {"kind": "pivot"}, _links({}, {}, {}, {}), [95, 60, 100, 55],
           [68, 80, 60, 78]),
    Scheme(4, "a ski and one link: legs, and the trunk as a point mass", SKI, _links({"tip_mass": 40.0}), [115], [66], 60,
           ("legs",)),
    Scheme(5, "a ski and two links: legs and trunk, and the head as a point mass", SKI, _links({}, {"tip_mass": 5.0}), [115, 80],
           [66, 76], 60, ("legs", "trunk")),
    Scheme(6, "a ski and n links (drawn: 5, without arms), and a point mass", SKI, _links({}, {}, {}, {}, {"tip_mass": 1.0}),
           [85, 250, 80, 75, 80], [62, 66, 60, 76, 82], 60, BODY),
)  # fmt: skip


def project(points: Any) -> Any:
    """Oblique view (..., 2) of points (..., 3): y to the right, z up, x towards the reader."""
    points = np.asarray(points, float)
    return np.stack([points[..., 1] - 0.5 * points[..., 0], points[..., 2] - 0.36 * points[..., 0]], axis=-1)


def draw(scheme: Scheme, folder: Path) -> Path:
    """Build the mechanism of a figure and write its picture."""
    start = {f"{name}{i + 1}": math.radians(angle) for name in ("phi", "psi") for i, angle in enumerate(getattr(scheme, name))}
    if scheme.base["kind"] == "ski":
        start["phi0"] = math.radians(scheme.heading)
    scene = vlmb.Scene.from_dict({"name": scheme.caption, "base": scheme.base, "links": scheme.links, "start": start})
    mechanism, begin = vlmb.check(scene)
    with style():
        figure = Figure(figsize=(6.4, 6.4 if len(scheme.links) < 3 else 7.8), layout="constrained")
        ax = figure.subplots()
        ax.set_aspect("equal")
        ax.set_axis_off()
        _axes(ax, 0.9 if len(scheme.links) == 1 else 1.1)
        places = {
            (i, point): np.asarray(mechanism.position(begin.state, link.name, point))
            for i, link in enumerate(scene.links)
            for point in ("hinge", "rod_start", "rod_end", "tip")
        }
        if scheme.base["kind"] == "ski":
            _ski(ax, start["phi0"])
        for i in range(len(scene.links)):
            _link(ax, scheme, i, places, start)
        if scheme.base["kind"] == "ski":
            mass = project(places[len(scene.links) - 1, "tip"])
            ax.plot(*mass, "o", color=PALETTE[3], markersize=17, zorder=2)
            ax.annotate("$m_B$", mass, (14, 8), textcoords="offset points", fontsize=13)
        symbols = ", ".join(quantity_of(c).symbol for c in mechanism.layout.coordinates)
        count = len(mechanism.layout.coordinates)
        ax.set_title(f"Figure {scheme.number}: {scheme.caption}", fontsize=12)
        figure.supxlabel(f"{count} coordinates: {symbols}", fontsize=11 if count < 12 else 8.5)
        ax.margins(0.08)
        return write(figure, folder / f"figure_{scheme.number}.png")


def _axes(ax: Any, size: float) -> None:
    for axis, name in enumerate("xyz"):
        end = project(size * np.eye(3)[axis])
        ax.annotate("", end, (0, 0), arrowprops={"arrowstyle": "-|>", "color": GREY, "linewidth": 1.0})
        ax.annotate(f"${name}$", end, (5, 3), textcoords="offset points", fontsize=13, color=GREY)
    ax.plot(*project(1.1 * size * np.eye(3)).T, alpha=0.0)  # annotations alone widen no limits


def _ski(ax: Any, heading: float) -> None:
    ahead, left = np.array([math.cos(heading), math.sin(heading), 0.0]), np.array([-math.sin(heading), math.cos(heading), 0.0])
    outline = [0.85 * ahead, 0.72 * ahead + 0.06 * left, -0.6 * ahead + 0.06 * left, -0.6 * ahead - 0.06 * left,
               0.72 * ahead - 0.06 * left]  # fmt: skip
    ax.fill(*project(outline).T, facecolor=PALETTE[1], alpha=0.55, edgecolor=PALETTE[1], zorder=1)
    _arc(ax, 0.45, 0.0, heading, r"$\varphi_0$")
    ax.annotate("$m_0, I_0$", project(-0.6 * ahead), (-34, -12), textcoords="offset points", fontsize=13)


def _link(ax: Any, scheme: Scheme, i: int, places: dict[Any, Any], start: dict[str, float]) -> None:
    """Massless segments thin and dashed, the rod thick; names beside them."""
    hinge, low, high, tip = (places[i, point] for point in ("hinge", "rod_start", "rod_end", "tip"))
    n, colour = len(scheme.links), PALETTE[i % len(PALETTE)]
    ax.plot(*project([hinge, tip]).T, color=BLACK, linestyle=(0, (3, 2)), linewidth=1.3, zorder=2)
    ax.plot(*project([low, high]).T, color=colour, linewidth=7.0, solid_capstyle="butt", zorder=3)
    ax.plot(*project([hinge, tip]).T, "o", color=BLACK, markerfacecolor="white", markersize=5, zorder=4)
    along = project(tip) - project(hinge)
    right = np.array([along[1], -along[0]]) / np.linalg.norm(along)
    one = n == 1
    points = {"hinge": "A" if one else f"A_{i + 1}", "rod_start": "C" if one else f"B_{i + 1}",
              "rod_end": "D" if one else f"C_{i + 1}"}  # fmt: skip
    points |= {"tip": "B" if one else f"A_{i + 2}"} if i == n - 1 else {}
    for point, name in points.items():
        ax.annotate(f"${name}$", project(places[i, point]), -15 * right, textcoords="offset points", ha="center", va="center",
                    fontsize=11)  # fmt: skip
    for first, last, name in ((hinge, low, rf"\xi_{{{i + 1}1}}"), (low, high, f"l_{i + 1}"), (high, tip, rf"\xi_{{{i + 1}2}}")):
        middle = project(0.5 * (first + last))
        ax.annotate(f"${name}$", middle, 15 * right, textcoords="offset points", ha="center", va="center", fontsize=12)
    if scheme.names:
        ax.annotate(scheme.names[i], project(0.5 * (low + high)), 58 * right, textcoords="offset points", ha="center",
                    va="center", color=colour, fontsize=10)  # fmt: skip
    if n < 3:  # the azimuth in the level of the hinge, the elevation above it
        phi, psi = start[f"phi{i + 1}"], start[f"psi{i + 1}"]
        level = hinge + 0.62 * np.array([math.cos(phi), math.sin(phi), 0.0])
        ax.plot(*project([hinge, level]).T, color=GREY, linewidth=0.8)
        ax.plot(*project([hinge, hinge + np.array([0.5, 0.0, 0.0])]).T, color=GREY, linewidth=0.8)
        ski = scheme.base["kind"] == "ski" and not i
        _arc(ax, 0.3 if ski else 0.4, 0.0, phi, rf"$\varphi_{i + 1}$", hinge, (10, 2) if ski else (2, -12))
        rise = np.linspace(0.0, psi, 30)
        curve = hinge + 0.38 * np.stack([np.cos(phi) * np.cos(rise), np.sin(phi) * np.cos(rise), np.sin(rise)], axis=1)
        ax.plot(*project(curve).T, color=PALETTE[2], linewidth=1.0)
        ax.annotate(rf"$\psi_{i + 1}$", project(curve[12]), (9, 3), textcoords="offset points", fontsize=13, color=PALETTE[2])


def _arc(
    ax: Any, radius: float, first: float, last: float, name: str, about: Any = (0.0, 0.0, 0.0), at: tuple[int, int] = (2, -12)
) -> None:
    turn = np.linspace(first, last, 30)
    curve = np.asarray(about) + radius * np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    ax.plot(*project(curve).T, color=PALETTE[0], linewidth=1.0)
    ax.annotate(name, project(curve[15]), at, textcoords="offset points", fontsize=13, color=PALETTE[0])


def schemes(folder: Path) -> list[Path]:
    """Write figures 1 to 6 into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    return [draw(scheme, folder) for scheme in SCHEMES]
