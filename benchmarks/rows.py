"""Rows, programmes and forms of the knife edge beside the frozen baseline: evaluations, runs, set-ups.

Usage: python benchmarks/rows.py

Every number is processor time of this vlmb over that of the frozen baseline in the same run (see baseline.py). An evaluation of
this vlmb runs in a compiled loop, as its drivers call it; the baseline's is a Python call, as its drivers call it. Runs have
default events and outputs.
"""

from __future__ import annotations

from typing import Any

from baseline import COMMIT, SHORT, compare
from common import table, write_report

COUNT = 200  # evaluations in a compiled loop
STATE = """
import numpy as np
path, form = {scene!r}, {form!r}
scene = vlmb.load_scene(path) if isinstance(path, str) else vlmb.Scene.from_dict(path)
mechanism = vlmb.build(scene)
run = vlmb.simulate(mechanism, duration=0.02, knife_edge=form)
q, v = run.q[-1], run.v[-1]
near = [float(run[name][-1]) for name in mechanism.layout.names]
"""
OLD_EVALUATION = STATE + """
from vlmb.dynamics import Dynamics
made = Dynamics(mechanism, form or scene.run.knife_edge, scene.run.gain)
made.reference = near
y = np.concatenate([q, v, np.zeros(len(made.work_names))])
def once():
    made.rhs(0.02, y)
"""
NEW_EVALUATION = STATE + """
import numba
from vlmb.core.cache import lean
from vlmb.core.evaluation import evaluate
from vlmb.core.jit import OPTIONS
from vlmb.system.engines import make_engine
from vlmb.system.system import make_system
system = make_system(mechanism, **({{"knife_edge": form}} if form else {{}}))
engine = make_engine(system, near, engine="core")
y = engine.pack(vlmb.State(q, v))
dy = np.zeros(len(y))
plant, memory = engine.plan.plant, engine.memory
@numba.njit(**OPTIONS)
def loop(plant, memory, y, dy):
    bad = 0
    for _ in range({count}):
        bad += evaluate(plant, memory, 0.02, y, dy)
    return bad
with lean():
    assert loop(plant, memory, y, dy) == 0
def once():
    loop(plant, memory, y, dy)
"""
RUN = """
mechanism = vlmb.build(vlmb.load_scene({scene!r}))
def once():
    assert vlmb.simulate(mechanism, duration={duration}, rtol={rtol}, atol={rtol}).status == "finished"
"""
LOOP = """
scene = {scene!r}
run = vlmb.simulate(vlmb.Scene.from_dict(scene), duration=0.01)
for name in run.mechanism.coordinate_names:  # a start that holds, with nothing to solve
    scene["start"][name], scene["start"][name + "_dot"] = float(run[name][0]), float(run[name + "_dot"][0])
mechanism = vlmb.build(vlmb.Scene.from_dict(scene))
def once():
    assert vlmb.simulate(mechanism, duration={duration}, rtol={rtol}, atol={rtol}).status == "finished"
"""
SET_UP = """
data = vlmb.load_scene({scene!r}).to_dict()
data["expect"] = {{}}
if not {whole}:
    data["programme"] = None
    data.pop("programme")
scene = vlmb.Scene.from_dict(data)
def once():
    vlmb.simulate(scene, duration=1e-4, t_eval=[1e-4])
"""
RIGID = {"lower": {"motion": "fixed", "length": 0.0}, "upper": {"motion": "fixed", "length": 0.0}}
FOUR_BAR: dict[str, Any] = {
    "name": "four-bar", "base": {"kind": "pivot"}, "plane": True,
    "links": [
        {"name": "crank", "rod": {"length": 0.4, "mass": 1.0}, **RIGID},
        {"name": "coupler", "parent": "crank", "rod": {"length": 0.9, "mass": 2.0}, **RIGID},
        {"name": "rocker", "parent": "coupler", "rod": {"length": 0.7, "mass": 1.5}, **RIGID},
    ],
    "constraints": ["rocker.tip.x = 0.8", "rocker.tip.z = 0.0"],
    "start": {"psi1": 1.2, "psi2": 0.3, "psi3": -1.2, "psi1_dot": 2.0}, "run": {"duration": 5.0},
}  # fmt: skip
SOFT = {"lower": {"motion": "fixed", "length": 0.2}, "upper": {"length": 0.2, "stiffness": 2e4, "damping": 50.0}}
TWO_FEET: dict[str, Any] = {
    "name": "two feet", "base": {"kind": "pivot"},
    "links": [
        {"name": "left", "rod": {"length": 0.5, "mass": 10.0}, **SOFT},
        {"name": "right", "parent": "left", "rod": {"length": 0.5, "mass": 10.0}, **SOFT},
        {"name": "trunk", "parent": "left", "rod": {"length": 0.6, "mass": 40.0}, **RIGID},
    ],
    "forces": [{"between": ["left", "trunk"], "stiffness": 400.0}],
    "constraints": ["right.tip.x = 0.5", "right.tip.y = 0.0", "right.tip.z = 0.0"],
    "start": {"psi1": 1.28, "psi2": -1.28, "psi3": 1.5, "phi1_dot": 0.3}, "run": {"duration": 2.0},
}  # fmt: skip


def evaluation(scene: Any, form: str | None = None) -> dict[str, float]:
    """One evaluation of a scene, or of a form of its knife edge."""
    values = {"scene": scene, "form": form, "count": COUNT}
    found = compare(NEW_EVALUATION.format(**values), OLD_EVALUATION.format(**values))
    new = found["new"] / COUNT
    return {"old": found["old"], "new": new, "ratio": new / found["old"]}


def set_up(scene: str) -> dict[str, float]:
    """What a programme adds to a start, on each side."""
    whole, bare = (compare(SET_UP.format(scene=scene, whole=whole), repeats=5) for whole in (True, False))
    old, new = (whole[side] - bare[side] for side in ("old", "new"))
    return {"old": old, "new": new, "ratio": new / old}


def main() -> None:
    """Measure everything and write the report."""
    found = {
        "evaluation, slalom of one link (4 rows)": evaluation("models/skier_slalom.toml"),
        "evaluation, slalom of the whole body": evaluation("models/skier_slalom_whole_body.toml"),
        "evaluation, skier, knife edge by a multiplier": evaluation("models/skier_one_link.toml", "multiplier"),
        "evaluation, skier, knife edge by projection": evaluation("models/skier_one_link.toml", "projection"),
        "evaluation, four-bar": evaluation(FOUR_BAR),
        "evaluation, two feet": evaluation(TWO_FEET),
        "10 s of slalom, one link, rtol 1e-8": compare(RUN.format(scene="models/skier_slalom.toml", duration=10.0, rtol=1e-8)),
        "10 s of slalom, whole body, rtol 1e-8": compare(
            RUN.format(scene="models/skier_slalom_whole_body.toml", duration=10.0, rtol=1e-8), repeats=5
        ),
        "5 s of the four-bar, rtol 1e-8": compare(LOOP.format(scene=FOUR_BAR, duration=5.0, rtol=1e-8)),
        "2 s on two feet, rtol 1e-8": compare(LOOP.format(scene=TWO_FEET, duration=2.0, rtol=1e-8)),
        "what a programme adds to a start": set_up("models/skier_slalom.toml"),
    }  # fmt: skip
    rows = [
        (name, *(f"{1e6 * entry[side]:.4g}" for side in ("old", "new")), f"1/{1.0 / entry['ratio']:.1f}")
        for name, entry in found.items()
    ]
    parts = [
        "# Rows and programmes beside the frozen baseline",
        f"Processor time of this vlmb over that of commit {SHORT}, taken in turn.",
        table(("what", "old, us", "new, us", "new / old"), rows),
    ]
    write_report("rows", parts, {"commit": COMMIT, "found": found})


if __name__ == "__main__":
    main()
