"""Draw the paper's figures: 1 to 6, its mechanisms; 7 and 8, deviations from (7.5) and (8.2), by step, stabilization, method."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from _schemes import schemes

import vlmb
from vlmb.views.plots import save_all
from vlmb.views.programme_plots import convergence

ROOT = Path(__file__).resolve().parent.parent
TILT = 0.01  # [rad] off the vertical at the start
SWAY = "psi1 = pi/2 - 0.2 + 0.1*sin(2*t)"  # what the free scalar serves: a lean that goes to and fro, so that (8.2) has to act
SETTLED = 1.0  # [s] after which the largest deviation counts as the floor
EULER = (0.016, 0.008, 0.004, 0.002)  # [s]
RK4 = (0.04, 0.028, 0.02, 0.014)
ADAMS = 1e-10  # rtol


def run(name: str, method: str, step: float | None = None, stabilized: bool = True, tilt: float = TILT) -> vlmb.Trajectory:
    """Simulate a scene of the paper's programme from a start that meets it."""
    data: dict[str, Any] = vlmb.load_scene(ROOT / "models" / f"{name}.toml").to_dict()
    data["start"] = {"speed": 3.0, "psi1": math.pi / 2 - tilt}
    data["run"] = {"duration": data["run"]["duration"], "method": method, "samples": 200}
    data["run"] |= {"step": step} if step else {"rtol": ADAMS, "atol": 1e-2 * ADAMS}
    if "secondary" in data["programme"]:
        data["programme"]["secondary"] = [SWAY]
    changed = ["speed 3 m/s", f"tilt {tilt:g} rad", *data["programme"].get("secondary", [])]
    data["name"] = f"{name}.toml with {', '.join(changed)}"  # titles say what was run
    if not stabilized:
        del data["programme"]["frequency"]
        data["programme"]["gains"] = "none"
    return vlmb.simulate(vlmb.Scene.from_dict(data))


def floor(trajectory: vlmb.Trajectory, text: str) -> float:
    """Largest deviation from an equation after the start."""
    error = trajectory.residuals[text].position
    assert error is not None and trajectory.status == "finished", trajectory.message
    return float(np.abs(error[trajectory.t >= SETTLED]).max())


def passed(trajectory: vlmb.Trajectory, degrees: float) -> float:
    """Time at which the rider's tilt passes an angle; inf if it does not."""
    over = np.abs(np.degrees(trajectory["psi1"]) - 90.0) >= degrees
    return float(trajectory.t[np.argmax(over)]) if over.any() else math.inf


def main() -> int:
    """Simulate, draw, print what was measured."""
    parser = argparse.ArgumentParser(prog="scripts/reproduce_figures", description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "results" / "figures", help="default: results/figures")
    folder = parser.parse_args().folder
    texts = vlmb.load_scene(ROOT / "models" / "skier_paper.toml").programme.constraints  # type: ignore[union-attr]
    numbers = dict(zip(texts, ("(7.5)", "(8.2)"), strict=True))
    written = schemes(folder)

    def draw(name: str, runs: dict[str, vlmb.Trajectory], only: str = "deviations") -> None:
        (path,) = save_all(list(runs.values()), folder, [only], list(runs))
        written.append(path.rename(folder / f"{name}.png"))

    print("The paper's set of controls, skier_paper.toml")
    for tilt in (TILT, 0.0):
        tipping = run("skier_paper", "euler", 1e-3, tilt=tilt)
        worst = ", ".join(f"{numbers[t]} {np.abs(tipping.residuals[t].position).max():.1e}" for t in texts)
        print(f"  tilt {math.degrees(tilt):.2f} deg at the start: 10 deg after {passed(tipping, 10.0):.2f} s")
        print(f"    {tipping.message} Deviations up to {worst}")
    tipping = run("skier_paper", "euler", 1e-3)
    draw("tipping_over", {"skier_paper": tipping}, "coordinates")
    draw("tipping_over_deviations", {"skier_paper": tipping})

    print(f"With the free scalar on psi1, skier_paper_balanced.toml ({SWAY})")
    balanced = "skier_paper_balanced"
    euler = {step: run(balanced, "euler", step, tilt=0.2) for step in EULER}
    free = {step: run(balanced, "euler", step, stabilized=False, tilt=0.2) for step in EULER}
    rk4 = {step: run(balanced, "rk4", step, tilt=0.2) for step in RK4}
    adams = run(balanced, "adams", tilt=0.2)
    lean = 90.0 - np.degrees(adams["psi1"])
    print(f"  lean {lean.min():.1f} to {lean.max():.1f} deg over {adams.t[-1]:g} s")
    draw("figures_7_and_8", {f"Euler, step {step:g} s": euler[step] for step in EULER})
    two = EULER[0], EULER[-1]
    both = {f"step {step:g} s, {word}": runs[step] for runs, word in ((euler, "stabilized"), (free, "not")) for step in two}
    draw("stabilization", both)
    draw("methods", {"Euler, 0.002 s": euler[0.002], "RK4, 0.04 s": rk4[0.04], f"Adams, rtol {ADAMS:g}": adams})
    from vlmb.views.style import style, write

    for text in texts:
        curves = {
            name: (list(runs), [floor(entry, text) for entry in runs.values()])
            for name, runs in (("Euler", euler), ("Euler without stabilization", free), ("RK4", rk4))
        }
        path = folder / f"floor_{numbers[text].strip('()').replace('.', '_')}.png"
        figure = convergence(curves, f"Largest deviation after {SETTLED:g} s from {text}", "largest deviation")
        with style():
            written.append(write(figure, path))
        for name, (steps, errors) in curves.items():
            slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
            values = ", ".join(f"{error:.1e}" for error in errors)
            sizes = ", ".join(f"{step:g}" for step in steps)
            print(f"  {numbers[text]} {name}: deviations {values} at steps {sizes} s: slope {slope:.2f}")
        print(f"  {numbers[text]} Adams at rtol {ADAMS:g}: {floor(adams, text):.1e}")
    print("wrote " + ", ".join(str(path) for path in written))
    return 0


if __name__ == "__main__":
    sys.exit(main())
