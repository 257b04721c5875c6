"""What a programme adds to the right-hand side of its scene, where that goes, and how fast the slalom runs.

Usage: python benchmarks/programme_cost.py

The shipped slalom scenes with the first rows of their programmes, beside the same scenes without one, at a state of their own
motion. Seconds are the fastest of batches taken in turn; read them as ratios. Limit: four rows on the one-link skier add 1.5
times the right-hand side without them; ten seconds of the slalom at rtol 1e-8 in a fiftieth of that time.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from common import interleaved, save_figure, table, write_report

# isort: split
import numpy as np
from scipy.linalg import lapack

import vlmb
from vlmb.model.mechanism import build
from vlmb.system.dynamics import Dynamics
from vlmb.views.style import GREY, PALETTE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MODELS = Path(__file__).resolve().parents[1] / "models"
SCENES = {
    "one link": "skier_slalom.toml",
    "two links": "skier_slalom_two_links.toml",
    "whole body": "skier_slalom_whole_body.toml",
}
BARE = "one link, nothing else acting"
ROWS = (1, 2, 4)
AT = 1.5  # [s] of the motion
ADDED, REAL_TIME = 1.5, 50.0
DURATION, RTOL, ATOL = 10.0, 1e-8, 1e-10
RUNS = 5


def variants(scene: vlmb.Scene, bare: bool) -> dict[str, vlmb.Scene]:
    """Return the scene without a programme, with the first rows of it and as many controls, with all controls, and whole.

    `bare`: without its applied forces and dampers.
    """
    data = scene.to_dict()
    programme = data.pop("programme")
    if bare:
        data.pop("forces", None)
        for link in data["links"]:
            for side in ("lower", "upper"):
                link.get(side, {}).pop("damping", None)
    rows, controls = programme["constraints"], programme["controls"]
    found = {"none": vlmb.Scene.from_dict(data)}
    for count in sorted({*(n for n in ROWS if n <= len(rows)), len(rows)}):
        for given in sorted({count, len(controls)}):
            servo = {**programme, "constraints": rows[:count], "controls": controls[:given]}
            servo.pop("secondary", None)
            if isinstance(servo.get("frequency"), (list, tuple)):
                servo["frequency"] = list(servo["frequency"])[:count]
            servo["weights"] = {name: value for name, value in servo.get("weights", {}).items() if name in controls[:given]}
            name = f"{count} row{'s' * (count > 1)}, {given} control{'s' * (given > 1)}"
            found[name] = vlmb.Scene.from_dict({**data, "programme": servo})
    return found


def sides(scene: vlmb.Scene, bare: bool) -> tuple[dict[str, Dynamics], dict[str, np.ndarray[Any, Any]]]:
    """Return the dynamics of every variant, all at one state of the controlled motion."""
    whole = vlmb.simulate(scene, duration=AT, t_eval=[0.0, AT])
    if whole.status != "finished":
        raise SystemExit(f"{scene.name}: {whole.message}")
    dynamics, states = {}, {}
    for name, variant in variants(scene, bare).items():
        mechanism = build(variant)
        one = Dynamics(mechanism, run=variant.run)
        one.reference = [float(whole[coordinate][-1]) for coordinate in mechanism.coordinate_names]
        state = np.zeros(one.size)
        state[: one.nq], state[one.nq : one.nq + one.nv] = whole.q[-1], whole.v[-1]
        dynamics[name], states[name] = one, state
    return dynamics, states


def parts(dynamics: Dynamics, y: np.ndarray[Any, Any]) -> dict[str, Callable[[], object]]:
    """Split what a programme adds: each part alone, at the same state."""
    system, nq, nv = dynamics.system, dynamics.nq, dynamics.nv
    rows, programme = system.rows, system.programme
    assert rows is not None and programme is not None
    dynamics.rhs(AT, y)
    q, v = y[:nq].copy(), y[nq : nq + nv].copy()
    read = rows.motion.numbers(AT, q, v, dynamics.reference)
    numbers, mass, right = rows.numbers(AT, q, v, dynamics.reference), np.asfortranarray(np.eye(nv)), system.right.copy(order="F")
    effect, beta = np.asfortranarray(programme.effect), np.ones(len(programme.texts))
    answer = np.asfortranarray(np.ones(right.shape))
    return {
        "read q, v, axes and angles": lambda: rows.motion.numbers(AT, q, v, dynamics.reference),
        "straight-line code of rows and controls": lambda: np.array(rows.function(*read)),
        "place the entries, apply the gains": lambda: (system.memory.put(system.places, numbers), system.law.dot(numbers)),
        "M^-1 of b and the controls": lambda: lapack.dposv(mass, right),
        "M^-1 of b alone (without a programme)": lambda: lapack.dposv(mass, v),
        "G and beta": lambda: answer.T.dot(system.jacobian),
        "G u = beta": lambda: programme.solve(AT, effect, beta),
        "accelerations": lambda: answer.dot(system.shares),
        "powers of the controls": lambda: system.powers(v),
    }


def draw(figure: Figure, data: dict[str, Any]) -> None:
    """Bars of what programmes add, by scene, and the limit."""
    axes = figure.add_subplot()
    names, values, colours = [], [], []
    for colour, label in zip(PALETTE, (*SCENES, BARE), strict=False):
        for name, value in data[label]["added"].items():
            names.append(f"{label}: {name}")
            values.append(value)
            colours.append(colour)
    places = range(len(names))
    axes.barh(places, values, color=colours)
    axes.set_yticks(places, names)
    axes.invert_yaxis()
    axes.axvline(ADDED, color=GREY, linestyle="--")
    axes.set_xlabel("added by the programme, in right-hand sides of the scene without it")


def main() -> None:
    """Measure and write benchmarks/results/programme_cost.md and .json."""
    lines: list[list[str]] = []
    data: dict[str, Any] = {}
    split, added = "", {}
    for label in (*SCENES, BARE):
        scene = vlmb.load_scene(MODELS / SCENES.get(label, SCENES["one link"]))
        dynamics, states = sides(scene, label == BARE)
        seconds = interleaved({name: (lambda d=one, y=states[name]: d.rhs(AT, y)) for name, one in dynamics.items()}, 60)
        plain = seconds["none"]
        for name in dynamics:
            lines.append([f"{label}: {name}", f"{1e6 * seconds[name]:.1f}", f"{seconds[name] / plain - 1.0:.2f}"])
        added[label] = seconds[list(dynamics)[-1]] / plain - 1.0
        data[label] = {"seconds": seconds, "added": {name: seconds[name] / plain - 1.0 for name in seconds if name != "none"}}
        if label == "one link":
            full = list(dynamics)[-1]
            own = interleaved(parts(dynamics[full], states[full]), 60)
            split = table(["part", "share of the right-hand side without a programme"],
                          [[name, f"{value / plain:.2f}"] for name, value in own.items()])  # fmt: skip
            data["parts"] = {name: value / plain for name, value in own.items()}
    runs = []
    for label, file in SCENES.items():
        scene = vlmb.load_scene(MODELS / file)
        found = [vlmb.simulate(scene, duration=DURATION, rtol=RTOL, atol=ATOL) for _ in range(RUNS)]
        last = found[-1]
        cpu = min(run.stats["cpu_time"] for run in found)
        speed = last.t[-1] / cpu
        runs.append([label, last.status, f"{last.t[-1]:.3g}", last.stats["rhs_evaluations"], f"{speed:.0f}"])
        data[label]["times_real_time"] = speed
        if label == "one link":
            slalom = speed
    met = {False: "not met", True: "met"}
    verdict = (
        f"Four rows on the one-link skier add {added['one link']:.2f} times the right-hand side of its scene without them (limit "
        f"{ADDED:g}: {met[added['one link'] <= ADDED]}), and {added[BARE]:.2f} times where neither applied forces nor dampers "
        f"make that side slower. Ten seconds of its slalom run {slalom:.0f} times faster than real time (limit {REAL_TIME:g}: "
        f"{met[slalom >= REAL_TIME]})."
    )
    page = [
        "# Cost of a programme",
        verdict,
        "What a programme adds to one evaluation, as a multiple of the same scene without it (both with the scene's applied "
        "forces and dampers). With fewer rows than controls the controls are the least ones.",
        table(["scene and programme", "microseconds", "added"], lines),
        "Where it goes, four rows and four controls on the one-link skier, each part alone:",
        split,
        "The right-hand side without a programme is Pinocchio's compiled code but for a few calls; what a programme adds is "
        "mostly the cost of calling, from Python, about twenty small operations, each of 0.1 to 1 microsecond, and of one "
        "function of scalar arithmetic in generated Python.",
        f"Runs of {DURATION:g} s at rtol {RTOL:g} (processor time of the march, fastest of {RUNS}; output is not included):",
        table(["scene", "status", "seconds reached", "evaluations", "times real time"], runs),
    ]
    picture = save_figure("programme_cost", lambda figure: draw(figure, data), 8.0, 6.5)
    page.insert(-2, f"![what programmes add, by scene]({picture.name})")
    for file in (*write_report("programme_cost", "\n\n".join(page), data), picture):
        print(file)
    print("\n\n".join(page))


if __name__ == "__main__":
    main()
