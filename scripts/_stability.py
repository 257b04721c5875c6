"""Draw the map of stable running of a skier whose ski has a side cut, and the turns that he could run: docs/stability.md."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import vlmb

ROOT = Path(__file__).resolve().parent.parent
GRAVITY = 9.81
SPEEDS, CUTS = np.linspace(3.0, 16.0, 27), np.linspace(0.03, 0.2, 18)
BOOT = {"between": ["heading", "legs"], "stiffness": 1500.0, "damping": 150.0, "rest": math.pi / 2}
CARVE = "carve: phi0_dot = kappa*speed*(cos(phi0)*legs.direction.y - sin(phi0)*legs.direction.x)"


def skier(cut: float, speed: float) -> vlmb.Scene:
    """The one-link skier on the level with boots that hold him fore and aft, and a side cut [1/m]."""
    scene = vlmb.load_scene(ROOT / "models" / "skier_one_link.toml")
    scene = scene.changed(slope=0.0, forces=[BOOT], start=None, parameters=None, expect=None, run={"fall": False})
    return scene.changed(parameters={"kappa": cut}, constraints=[CARVE], start={"speed": speed})


def growth(cut: float, speed: float, lean: float = 0.0) -> float:
    """Growth [1/s] of deviations from a straight run, or from the turn near a lean."""
    turning = cut * speed * math.sin(lean)
    guess = {"phi0_dot": turning, "phi1": math.pi / 2, "psi1": math.pi / 2 - lean, "phi1_dot": turning} if lean else None
    return vlmb.linearize(vlmb.steady(skier(cut, speed), {"speed": speed}, guess=guess)).growth


def main() -> None:
    """Compute and draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", nargs="?", type=Path, default=ROOT / "docs" / "images" / "stability.png")
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    found = np.array([[growth(cut, speed) for speed in SPEEDS] for cut in CUTS])
    limit = float(np.abs(found).max())
    filled = left.contourf(SPEEDS, CUTS, found, np.linspace(-limit, limit, 21), cmap="RdBu_r")
    figure.colorbar(filled, ax=left, label="growth [1/s]")
    left.plot(np.sqrt(GRAVITY / CUTS), CUTS, "k", label=r"$\kappa v^2 = g$")
    left.set(xlabel="speed [m/s]", ylabel=r"side cut $\kappa$ [1/m]", title="straight run", xlim=SPEEDS[[0, -1]])
    left.legend()
    for cut in (0.05, 0.1, 0.2):
        speeds = SPEEDS[cut * SPEEDS**2 > 1.02 * GRAVITY]
        leans = np.arccos(GRAVITY / (cut * speeds**2))
        grows = [growth(cut, speed, lean) for speed, lean in zip(speeds.tolist(), leans.tolist(), strict=True)]
        right.plot(speeds, grows, ".-", label=rf"$\kappa$ = {cut:g} 1/m")
    right.axhline(0.0, color="k", linewidth=0.8)
    right.set(xlabel="speed [m/s]", ylabel="growth [1/s]", title="carved turn of that speed")
    right.legend()
    file = parser.parse_args().file
    figure.savefig(file, dpi=120)
    print(f"wrote {file}")


if __name__ == "__main__":
    main()
