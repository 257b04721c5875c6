"""Draw the figures of docs/stability.md: the map of stable running, of steady turns, modes of a turn and its eigenvalues."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import vlmb

ROOT = Path(__file__).resolve().parent.parent
IMAGES = ROOT / "docs" / "images"
GRAVITY = 9.81
SPEEDS, CUTS = np.linspace(3.0, 16.0, 27), np.linspace(0.03, 0.2, 18)
TURN_SPEEDS, RADII = np.linspace(4.0, 16.0, 8), np.geomspace(8.0, 60.0, 8)
SKIERS = {"skier_one_link": "one link", "skier_two_links": "two links", "skier_whole_body": "whole body"}
BOOTS = [
    {"between": ["base", "legs"], "stiffness": 4000.0, "damping": 500.0},
    {"between": ["heading", "legs"], "stiffness": 1500.0, "damping": 150.0, "rest": math.pi / 2},
]  # of the one-link skier; the others have their own
SUPPORTS = {"none": "no boots", "boots": "boots", "cut": "side cut"}
SHOWN = (("skier_one_link", "none", 1), ("skier_two_links", "boots", 4), ("skier_two_links", "boots", 6))  # modes
LEAN = "(cos(phi0)*{0}.direction.y - sin(phi0)*{0}.direction.x)"


def skier(model: str, support: str, speed: float, cut: float | None = None) -> vlmb.Scene:
    """A skier on the level with springs in his hips, and what supports him: none, boots, or boots fore and aft and a side cut."""
    scene = vlmb.load_scene(ROOT / "models" / f"{model}.toml")
    own: list[dict[str, Any]] = [force for force in scene.to_dict().get("forces", []) if force.get("between")]
    forces = []
    for force in own if model != "skier_one_link" else BOOTS:
        ends = list(force["between"])
        if {"none": {"base", "heading"}, "cut": {"base"}}.get(support, set()) & {*ends}:
            continue
        forces.append({key: value for key, value in force.items() if key != "rest" or "base" not in ends})
    scene = scene.changed(slope=0.0, forces=forces, start=None, parameters=None, expect=None, run={"fall": False})
    if cut is not None:
        row = f"carve: phi0_dot = kappa*speed*{LEAN.format(scene.links[0].name)}"
        scene = scene.changed(parameters={"kappa": cut}, constraints=[row])
    return scene.changed(start={"speed": speed})


def straight(cut: float, speed: float) -> float:
    """Growth [1/s] of deviations from a straight run of the one-link skier with a side cut."""
    return vlmb.linearize(vlmb.steady(skier("skier_one_link", "cut", speed, cut), {"speed": speed})).growth


def turn(model: str, support: str, speed: float, radius: float) -> vlmb.studies.steady.Steady:
    """A steady turn; with a side cut its row is left out, which the turn keeps by the cut that it needs."""
    scene, lean, rate = skier(model, support, speed), math.atan(speed**2 / (GRAVITY * radius)), speed / radius
    guess = {"phi0_dot": rate}
    for number in range(1, len(scene.links) + 1):
        psi = math.pi / 2 - lean * (support != "boots")
        guess |= {f"phi{number}": math.pi / 2, f"psi{number}": psi, f"phi{number}_dot": rate}
    return vlmb.steady(scene, {"speed": speed, "radius": radius}, guess=guess)


def growth(model: str, support: str, speed: float, radius: float) -> tuple[float, float]:
    """Growth [1/s] of deviations from a steady turn, and the radius [m] of the side cut that it needs, or nan."""
    try:
        found = turn(model, support, speed, radius)
        if support != "cut":
            return vlmb.linearize(found).growth, math.nan
        at = found.coordinates
        lean = math.cos(at["psi1"]) * math.sin(at["phi1"] - at["phi0"])
        scene = skier(model, support, speed, 1.0 / (radius * lean))
        return vlmb.linearize(scene, found.coordinates, found.rates).growth, radius * lean
    except vlmb.VlmbError as error:
        print(f"{model}, {support}, {speed:g} m/s, {radius:g} m: {error}")
        return math.nan, math.nan


def draw_straight(file: Path) -> None:
    """Draw the map of stable running of a skier whose ski has a side cut."""
    figure = Figure(figsize=(5.4, 3.8), layout="constrained")
    ax = figure.subplots()
    found = np.array([[straight(cut, speed) for speed in SPEEDS] for cut in CUTS])
    limit = float(np.abs(found).max())
    filled = ax.contourf(SPEEDS, CUTS, found, np.linspace(-limit, limit, 21), cmap="RdBu_r")
    figure.colorbar(filled, ax=ax, label="growth [1/s]")
    ax.plot(np.sqrt(GRAVITY / CUTS), CUTS, "k", label=r"$\kappa v^2 = g$")
    ax.set(xlabel="speed [m/s]", ylabel=r"side cut $\kappa$ [1/m]", title="straight run", xlim=SPEEDS[[0, -1]])
    ax.legend()
    figure.savefig(file, dpi=120)
    print(f"wrote {file}")


def draw_turns(file: Path) -> None:
    """Draw the map of steady turns over speed and radius: three skiers, three supports."""
    figure = Figure(figsize=(9.6, 8.2), layout="constrained")
    axes = figure.subplots(len(SUPPORTS), len(SKIERS), sharex=True, sharey=True)
    for row, (support, told) in zip(axes, SUPPORTS.items(), strict=True):
        maps = {model: np.array([[growth(model, support, v, r) for v in TURN_SPEEDS] for r in RADII]) for model in SKIERS}
        limit = max(float(np.nanmax(np.abs(found[..., 0]))) for found in maps.values())
        for ax, (model, found) in zip(row, maps.items(), strict=True):
            grows, cuts = found[..., 0], found[..., 1]
            filled = ax.contourf(TURN_SPEEDS, RADII, grows, np.linspace(-limit, limit, 25), cmap="RdBu_r")
            if np.nanmin(grows) < 0.0 < np.nanmax(grows):
                ax.contour(TURN_SPEEDS, RADII, grows, [0.0], colors="k", linewidths=1.5)
            if support == "cut":
                lines = ax.contour(TURN_SPEEDS, RADII, cuts, [3.0, 6.0, 10.0, 15.0, 20.0], colors="#555555", linewidths=0.7)
                ax.clabel(lines, fmt="%g m", fontsize=7)
            ax.set_yscale("log")
            ax.set_yticks([8, 15, 30, 60], ["8", "15", "30", "60"])
            ax.set_yticks([], minor=True)
            ax.set_title(f"{SKIERS[model]}, {told}: {np.nanmin(grows):+.2f} to {np.nanmax(grows):+.2f}", fontsize=8)
            print(f"{model}, {support}: {np.nanmin(grows):.4f} to {np.nanmax(grows):.4f} 1/s")
        figure.colorbar(filled, ax=row.tolist(), label="growth [1/s]")
        row[0].set_ylabel("radius [m]")
    for ax in axes[-1]:
        ax.set_xlabel("speed [m/s]")
    figure.savefig(file, dpi=120)
    print(f"wrote {file}")


def draw_modes(file: Path) -> None:
    """Paint how a skier without boots falls sideways, and how one with boots sways, in a turn of 7 m/s and 15 m."""
    whole = Image.new("RGB", (1220, 420), "white")
    for at, (model, support, number) in enumerate(SHOWN):
        mode = vlmb.linearize(turn(model, support, 7.0, 15.0)).mode(number)
        print(f"{model}, {support}: {mode!r}")
        whole.paste(vlmb.view.picture(mode, size=(400, 420)), (410 * at, 0))
    whole.save(file)
    print(f"wrote {file}")


def draw_eigenvalues(file: Path) -> None:
    """Draw how the eigenvalues of a turn of 15 m move with its speed: a skier of two links with boots."""
    speeds = np.linspace(3.0, 16.0, 79)
    found = [vlmb.linearize(turn("skier_two_links", "boots", speed, 15.0)) for speed in speeds]
    vlmb.plots.eigenvalues(found, speeds.tolist(), "speed [m/s]").savefig(file, dpi=100)
    print(f"wrote {file}")


def main() -> None:
    """Compute and draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=IMAGES)
    parser.add_argument("--only", choices=("straight", "turns", "modes", "eigenvalues"))
    args = parser.parse_args()
    drawn = {"straight": draw_straight, "turns": draw_turns, "modes": draw_modes, "eigenvalues": draw_eigenvalues}
    for name, draw in drawn.items():
        if args.only in (None, name):
            draw(args.folder / {"straight": "stability.png"}.get(name, f"stability_{name}.png"))


if __name__ == "__main__":
    main()
