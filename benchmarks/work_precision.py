"""Work and precision of the committed scenes: every method, every form of the knife edge, and a plain Pinocchio loop.

Usage: python benchmarks/work_precision.py [SCENE ...] [--repeats N] [--nearby]

Without arguments all scenes are measured and benchmarks/results is written. Other engines: benchmarks/engines.py.
"""

from __future__ import annotations

import argparse
import importlib
import math
from collections.abc import Sequence
from typing import Any

from common import MODELS, save_figure, table, write_report

# isort: split
import numpy as np
from peers.chain import UnsupportedError
from rivals import BASELINE, NEARBY, SAMPLED, Rival, end_of, ours, ratios_nearby

from vlmb.scene.scene import Scene, load_scene
from vlmb.simulation.simulate import simulate
from vlmb.studies.bench import ERRORS, as_data, section
from vlmb.studies.work_precision import TIGHT, Array, Measured, Motion, cost_at, measure
from vlmb.views.style import BLACK, GREY, PALETTE
from vlmb.views.work_precision_plots import COSTS, draw, legend

TARGETS = {"one link": 0.02, "two links": 0.03, "skier, spring link": 0.015, "eight links": 0.06, "fifty links": 0.06}

LEG = {"rod": {"length": 0.5, "mass": 30.0}, "tip_mass": 40.0, "name": "legs"}
SKIER = {
    "base": {"kind": "ski", "mass": 5.0, "inertia": 0.6}, "slope": 0.2,
    "links": [{**LEG, "lower": {"length": 0.25, "stiffness": 2e4}, "upper": {"length": 0.2, "stiffness": 1.5e4}}],
    "start": {"phi0": 0.46, "phi0_dot": 0.5, "phi1": 1.9, "psi1": 1.25, "psi1_dot": 0.3, "speed": 8.0},
    "run": {"fall": False},
}  # fmt: skip
FIFTY = {"rod": {"length": 0.06, "mass": 0.15}, "tip_mass": 0.05, "lower": {"length": 0.02, "stiffness": 5e4},
         "upper": {"length": 0.02, "stiffness": 5e4}}  # fmt: skip


def model(name: str, **changes: Any) -> dict[str, Any]:
    """Read a scene of models/ as a dict, without the method that it asks for: the default is measured, or methods by name."""
    scene = load_scene(MODELS / f"{name}.toml").to_dict()
    run = {key: value for key, value in scene.get("run", {}).items() if key != "method"}
    return {**scene, "run": run, "expect": {}, **changes}


def scenes() -> dict[str, tuple[dict[str, Any], float, dict[str, Any]]]:
    """Scenes, durations [s] and options of `measure`."""
    return {
        "one link": (model("one_link"), 5.0, {}),
        "two links": (model("two_links"), 3.0, {}),
        "eight links": (model("chain"), 2.0, {}),
        "fifty links": (
            {"base": {"kind": "pivot"}, "links": [FIFTY] * 50, "start": {"psi1": 0.3}}, 0.5,
            {"methods": ["rk4", "dop853", "adams"], "repeats": 1, "budget": 1.5},
        ),
        "skate on a slope": (model("skate_on_slope"), 10.0, {"exact": skate}),
        "skier, spring link": (SKIER, 1.0, {}),
        "programme skier": (model("skier_slalom"), 1.0, {"repeats": 1}),
        "stiff skier": (model("stiff_skier"), 1.0, {"repeats": 1, "methods": ["rk4", "dop853", "adams", "bdf", "radau"]}),
        "one link, long": (model("one_link"), 60.0, {"repeats": 1, "budget": 1.0}),
    }  # fmt: skip


def skate(t: Array) -> Motion:
    """Exact motion of models/skate_on_slope.toml.

    x = G sin^2(wt)/(2 w^2), y = G (wt - sin(2wt)/2)/(2 w^2), edge force 2 m G sin(wt), G = g sin(slope).
    """
    m, w, slope, g = 75.0, 1.5, 0.3, 9.81
    pull, turn, zero = g * math.sin(slope), w * t, np.zeros(len(t))
    x, y = pull * np.sin(turn) ** 2 / (2 * w**2), pull * (turn - np.sin(2 * turn) / 2) / (2 * w**2)
    snow = np.column_stack([zero, 2 * m * pull * np.sin(turn), zero + m * g * math.cos(slope)])
    heading = np.column_stack([np.cos(turn), np.sin(turn), zero])
    return Motion(np.column_stack([x, y, zero])[:, None], heading[:, None], snow[:, None])


def one_scene(name: str, peers: Sequence[str] = (), **changes: Any) -> tuple[Measured, dict[str, Any]]:
    """Measure one scene and its rivals: modules of peers/ beside the plain loop. `changes` are options of `measure`."""
    scene, duration, options = scenes()[name]
    scene = {**scene, "name": name, "run": {**scene.get("run", {}), "duration": duration}}
    options = {"budget": 0.2, "repeats": 3, **options, **changes}
    method, rtol = TIGHT[0]
    truth = end_of(simulate(Scene.from_dict(scene), duration, method, rtol, atol=0.1 * rtol, t_eval=[duration]))
    rivals: dict[str, Rival] = {}
    notes: list[str] = []
    for peer in (BASELINE, *peers):
        try:
            module = importlib.import_module(f"peers.{peer}")
            for label, (settings, run) in module.prepare(scene, duration).items():
                rivals[label] = Rival(label, run, settings, truth, options["budget"])
                notes += rivals[label].failures
        except ImportError as error:
            notes.append(f"{peer}: not installed ({error.name})")
        except UnsupportedError as error:
            notes.append(f"{peer}: {error}")
    runs = {label: (tuple(rival.errors), rival.timed) for label, rival in rivals.items()}
    own: dict[str, dict[float, float]] = {}
    if rivals:
        for label, sampled in (("vlmb", False), ("vlmb, sampled", True)):
            settings, run, own[label] = ours(scene, duration, sampled, truth)
            runs[label] = (settings, run)
    found, seconds = measure(Scene.from_dict(scene), duration, rivals=runs, progress=lambda text: None, **options)
    points = {
        label: [(seconds[label][s], (rivals[label].errors if label in rivals else own[label])[s], s) for s in seconds[label]]
        for label in runs
    }
    return found, {"points": points, "notes": notes}


def nearby_rows(name: str, found: dict[str, list[list[float]]]) -> list[list[str]]:
    """Median of the ratios over the starts, with the least and the largest."""
    rows = []
    for label, ratios in found.items():
        row = [f"{name}: {label}"]
        for values in zip(*ratios, strict=True):
            reached, target = [value for value in values if math.isfinite(value)], TARGETS[name]
            middle = float(np.median(reached))
            verdict = "met" if middle <= target else "missed"
            fewer = f" of {len(reached)}" if len(reached) < len(values) else ""
            row.append(f"{middle:.4f}, {min(reached):.4f} to {max(reached):.4f}{fewer} ({verdict}: {target:g})")
        rows.append(row)
    return rows


def ratio_rows(name: str, points: dict[str, list[Any]], base: str, base_sampled: str) -> list[list[str]]:
    """Times over the baseline's with the same outputs, and whether a target is met."""
    rows = []
    for label, values in points.items():
        if label in (base, base_sampled):
            continue
        other = base_sampled if label.endswith("sampled") else base
        row = [f"{name}: {label}"]
        for error in ERRORS:
            mine = cost_at([value[:2] for value in values], error)
            ratio = mine / cost_at([value[:2] for value in points[other]], error)
            target = TARGETS.get(name) if label.startswith("vlmb") else None
            verdict = "" if target is None or math.isnan(ratio) else f" ({'met' if ratio <= target else 'missed'}: {target:g})"
            row += ["-" if math.isnan(ratio) else f"{ratio:.{2 if ratio >= 0.1 else 3}f}{verdict}"]
        rows.append(row)
    return rows


def page(found: dict[str, tuple[Measured, dict[str, Any]]]) -> str:
    """Write the report."""
    rows, notes, near = [], [], []
    for name, (_, extra) in found.items():
        if extra.get("nearby"):
            near += nearby_rows(name, extra["nearby"])
        if extra["points"]:
            rows += ratio_rows(name, extra["points"], "plain loop", "plain loop, sampled")
        notes += [f"* {name}: {note}" for note in extra["notes"]]
    header = ["scene: engine", *(f"{error:g} m" for error in ERRORS)]
    return "\n".join(
        [
            "# Work and precision",
            "",
            "Errors against processor time, right-hand sides and steps. Setup is excluded, runs are taken in turn, the fastest "
            "of the repeats counts. atol = rtol / 10 everywhere.",
            "",
            "![final position error against time](work_precision.png)",
            "",
            "## Time over the plain Pinocchio loop",
            "",
            "Time to a final position error, divided by the time of a plain Pinocchio loop with quaternions and SciPy's DOP853 "
            "(`benchmarks/peers/plain_pinocchio.py`). Both give the same outputs: the end alone, or (*sampled*) "
            f"{SAMPLED:g} samples a second. In brackets the target and whether it is met.",
            "",
            table(header, rows),
            "",
            *notes,
            "",
            f"Where one start alone decides, chance does too: a run's error may happen to be small. So the scenes with a target "
            f"were run from {NEARBY} starts near their own; median of the ratios, least and largest, of those that reach the "
            "error on both sides:",
            "",
            table(header, near),
            "",
            *(f"{section(entry)}\n" for entry, _ in found.values()),
            "![forms of the knife edge](work_precision_knife_edge.png)",
            "",
            "![right-hand sides](work_precision_evaluations.png)",
            "",
            "![steps](work_precision_steps.png)",
        ]
    )


def pictures(found: dict[str, tuple[Measured, dict[str, Any]]]) -> None:
    """Draw error against each cost for all scenes, and the forms of the knife edge on the skier."""
    for cost in COSTS:

        def grid(figure: Any, cost: str = cost) -> None:
            axes = list(np.ravel(figure.subplots(math.ceil(len(found) / 3), 3, squeeze=False)))
            for panel, (entry, extra) in zip(axes, found.values(), strict=False):
                draw(panel, entry, cost)
                if cost == "seconds":
                    others = [label for label in extra["points"] if not label.startswith("vlmb") and "sampled" not in label]
                    for k, label in enumerate(others):
                        line = sorted((a, max(b, 1e-16)) for a, b, _ in extra["points"][label] if math.isfinite(b))
                        colour = BLACK if k == 0 else (GREY, *PALETTE)[k % 7]
                        panel.loglog(*zip(*line, strict=True), color=colour, linestyle="--", linewidth=1.1, label=label)
            for panel in axes[len(found) :]:
                panel.remove()
            legend(figure, axes[: len(found)])

        name = "work_precision" + ("" if cost == "seconds" else f"_{cost}")
        save_figure(name, grid, 11.0, 3.2 * math.ceil(len(found) / 3) + 0.6)

    def forms(figure: Any) -> None:
        axes = list(figure.subplots(1, 3))
        entry = found["skier, spring link"][0]
        kept = [e for e in entry.entries if e.variant.method == "dop853"]
        only = Measured(entry.name, entry.duration, entry.reference, entry.uncertainty, kept, [])
        for panel, quantity in zip(axes, ("position", "reaction", "energy"), strict=True):
            draw(panel, only, "seconds", quantity, forms=True)
        legend(figure, axes)

    if "skier, spring link" in found:
        save_figure("work_precision_knife_edge", forms, 11.0, 3.8)


def main() -> None:
    """Measure; write reports and pictures when all scenes were measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", help=f"default: all of {', '.join(scenes())}")
    parser.add_argument("--repeats", type=int, default=None)
    parser.add_argument("--nearby", action="store_true", help="only the ratios from starts near the scenes' own")
    args = parser.parse_args()
    if args.nearby:
        for name in args.scenes or TARGETS:
            for row in nearby_rows(name, ratios_nearby(*scenes()[name][:2], args.repeats or 3)):
                print("; ".join(row), flush=True)
        return
    found = {}
    for name in args.scenes or scenes():
        found[name] = one_scene(name, **({"repeats": args.repeats} if args.repeats else {}))
        if name in TARGETS:
            found[name][1]["nearby"] = ratios_nearby(*scenes()[name][:2])
        print(f"{name}: done", flush=True)
    if args.scenes:
        print(page(found))
        return
    pictures(found)
    write_report("work_precision", [page(found)], {name: {**as_data(entry), **extra} for name, (entry, extra) in found.items()})


if __name__ == "__main__":
    main()
