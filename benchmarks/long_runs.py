"""Long runs: energy and angular momentum over 1e5 steps of fixed-step methods on a scene that keeps both.

And the drift of the energy over 100 s at a tight tolerance.

Usage: python benchmarks/long_runs.py [--steps N]
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from common import MODELS, table, write_report

# isort: split
import numpy as np
import pinocchio as pin

from vlmb.model.mechanism import Mechanism, build
from vlmb.model.memory import make_data
from vlmb.scene.scene import load_scene
from vlmb.simulation.simulate import simulate
from vlmb.views.style import PALETTE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STEPS = 100_000
STEP = 0.02  # [s], 20 to 30 a period of the spring
SAMPLES = 1000
KEPT = ("first tenth", "last tenth", "drift", "steps", "evaluations", "seconds", "status")
RUNS: dict[str, dict[str, Any]] = {
    "rk4": {"method": "rk4", "step": STEP},
    "gauss": {"method": "gauss", "step": STEP},
    "adams, rtol 1e-6": {"method": "adams", "rtol": 1e-6, "atol": 1e-7},
    "adams, rtol 1e-10": {"method": "adams", "rtol": 1e-10, "atol": 1e-11},
}
TIGHT = {"duration": 100.0, "rtol": 1e-10, "atol": 1e-11}
DRIFTING = ("adams", "dop853")


def drift(mechanism: Mechanism, method: str) -> dict[str, Any]:
    """Largest energy error over the largest kinetic energy of a run at a tight tolerance, and its cost."""
    trajectory = simulate(mechanism, method=method, **TIGHT)
    return {
        "status": trajectory.status, "energy": float(np.abs(trajectory["balance"]).max() / trajectory["kinetic"].max()),
        "steps": trajectory.stats["steps"], "evaluations": trajectory.stats["rhs_evaluations"],
    }  # fmt: skip


def one_run(mechanism: Mechanism, options: dict[str, Any], steps: int) -> dict[str, Any]:
    """Energy error over the start's kinetic energy, error of the angular momentum about the vertical, and cost."""
    times = np.linspace(0.0, steps * STEP, SAMPLES + 1)
    trajectory = simulate(mechanism, float(times[-1]), t_eval=times, **options)
    data = make_data(mechanism.model)
    turn = np.array([_about_vertical(mechanism, data, q, v) for q, v in zip(trajectory.q, trajectory.v, strict=True)])
    scale = float(trajectory["kinetic"][0])
    energy = trajectory["balance"] / scale
    length = len(energy) // 10
    return {
        "status": trajectory.status, "t": trajectory.t, "energy": energy, "momentum": turn / turn[0] - 1.0,
        "first tenth": float(np.abs(energy[: length + 1]).max()), "last tenth": float(np.abs(energy[-length:]).max()),
        "drift": float(np.mean(energy[-length:]) - np.mean(energy[: length + 1])),
        "steps": trajectory.stats["steps"], "evaluations": trajectory.stats["rhs_evaluations"],
        "seconds": trajectory.stats["cpu_time"],
    }  # fmt: skip


def _about_vertical(mechanism: Mechanism, data: Any, q: Any, v: Any) -> float:
    """Angular momentum [kg m^2/s] about the vertical through the pivot."""
    pin.computeCentroidalMomentum(mechanism.model, data, q, v)
    centre, momentum = data.com[0], data.hg
    return float(momentum.angular[2] + np.cross(centre, momentum.linear)[2])


def draw(figure: Figure, results: dict[str, dict[str, Any]]) -> None:
    """Energy error over time, signed (left) and its size (right)."""
    left, right = figure.subplots(1, 2)
    for (name, run), colour in zip(results.items(), PALETTE, strict=False):
        left.plot(run["t"], run["energy"], color=colour, linewidth=0.8, label=name)
        right.semilogy(run["t"], np.maximum(np.abs(run["energy"]), 1e-17), color=colour, linewidth=0.8, label=name)
    kept = max(abs(results["gauss"]["energy"]).max(), 1e-15)
    left.set_ylim(-20 * kept, 20 * kept)
    left.set(xlabel="t [s]", ylabel="energy error / first kinetic energy", title="Energy error, near zero")
    right.set(xlabel="t [s]", ylabel="|energy error| / first kinetic energy", title="Its size")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4)


def report(results: dict[str, dict[str, Any]], drifts: dict[str, dict[str, Any]], steps: int) -> str:
    """Markdown."""
    rows = [
        [name, *(f"{run[key]:.1e}" for key in ("first tenth", "last tenth", "drift")), f"{np.abs(run['momentum']).max():.1e}",
         run["steps"], run["evaluations"], f"{run['seconds'] / results['rk4']['seconds']:.2f}"]
        for name, run in results.items()
    ]  # fmt: skip
    tight = [[name, f"{run['energy']:.1e}", run["steps"], run["evaluations"]] for name, run in drifts.items()]
    header = ["method", "energy, first tenth", "last tenth", "drift of the mean", "momentum", "steps", "rhs", "time / rk4"]
    return "\n".join(
        [
            "# Long runs",
            "",
            f"`models/one_link.toml` (a pivoted spring link: energy and the angular momentum about the vertical are kept), "
            f"{steps} steps of {STEP:g} s. Largest energy error of the first and the last tenth of the run and the change of its "
            "mean between them, over the first kinetic energy; largest relative error of the angular momentum.",
            "",
            table(header, rows),
            "",
            "![energy error](long_runs.png)",
            "",
            "An error that does not grow from the first tenth to the last is bounded; one that grows with time drifts. `gauss` "
            "is symmetric and keeps quadratic invariants; its cost is the iteration of its stages.",
            "",
            "## At a tight tolerance",
            "",
            f"The same scene for {TIGHT['duration']:g} s at rtol {TIGHT['rtol']:g}: largest energy error over the largest "
            "kinetic energy.",
            "",
            table(["method", "energy", "steps", "rhs"], tight),
        ]
    )


def main() -> None:
    """Run, write the report and the picture."""
    parser = argparse.ArgumentParser(description="Follow energy and angular momentum over long runs.")
    parser.add_argument("--steps", type=int, default=STEPS, help="of the fixed-step methods")
    steps = parser.parse_args().steps
    mechanism = build(load_scene(MODELS / "one_link.toml"))
    results = {name: one_run(mechanism, options, steps) for name, options in RUNS.items()}
    drifts = {method: drift(mechanism, method) for method in DRIFTING}
    data = {name: {key: run[key] for key in KEPT} for name, run in results.items()} | {"tight": drifts}
    write_report("long_runs", [report(results, drifts, steps)], data, picture=(lambda figure: draw(figure, results), 10.0, 4.0))


if __name__ == "__main__":
    main()
