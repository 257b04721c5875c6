"""How fast walkers walk: whole runs of models beside the time that they simulate (some seconds).

Usage: python benchmarks/walkers.py

Processor time of `vlmb.simulate` with everything that it makes of a scene, from a file that is read already, in one thread: the
fastest of several runs. Real time over it is how many times faster than its clock a walker walks.

A chain hangs from a foot that the ground holds, and from a pivot: the ratio of their times. An evaluation is one of 200 in a
compiled loop; runs are of one mechanism at rtol 1e-8, the first of which has compiled its phases.
"""

from __future__ import annotations

from typing import Any

from common import MODELS, interleaved, table, write_report
from model_only import evaluations

# isort: split
import numpy as np

import vlmb
from vlmb.system.contacts import HELD
from vlmb.system.core_engine import CoreEngine
from vlmb.system.engines import make_engine
from vlmb.system.start import consistent_start
from vlmb.system.system import make_system

WALKERS = ("figure_walker", "figure_walker_hops", "compass_gait", "simplest_walker", "slip_walker", "slip_runner")
LINKS, DURATIONS = (1, 2, 3, 6), (1.0, 10.0, 100.0)  # [s]
PART = {
    "rod": {"length": 0.8, "mass": 3.0}, "tip_mass": 1.0,
    "lower": {"length": 0.2, "motion": "free", "stiffness": 4000.0, "damping": 3.0},
}  # fmt: skip


def chain(links: int, on_foot: bool) -> vlmb.Scene:
    """A sprung chain in space that swings below its root."""
    start = {f"psi{i}": -1.4 + 0.03 * i for i in range(1, links + 1)} | {f"phi{i}_dot": 0.2 for i in range(1, links + 1)}
    root = {"base": {"kind": "free", "mass": 5.0}, "contacts": [{"point": "base"}]} if on_foot else {"base": {"kind": "pivot"}}
    return vlmb.Scene.from_dict({**root, "links": links * [PART], "start": start})


def evaluation(scene: vlmb.Scene) -> Any:
    """Evaluate a scene over and over, with its contact held."""
    system = make_system(vlmb.build(scene))
    start = consistent_start(system)
    if system.points:
        system = system.phase([system.points[0].footing_at(HELD, 0.0, np.zeros(3), plane=False)])
    engine = make_engine(system, start.branch)
    assert isinstance(engine, CoreEngine)
    y = engine.pack(start.state)
    return lambda: evaluations(engine.plan.plant, engine.memory, y, np.zeros(len(y)))


def beside_pivot(links: int) -> list[float]:
    """How many times as long as on a pivot an evaluation takes on a foot, and runs."""
    scenes = {name: chain(links, name == "foot") for name in ("pivot", "foot")}
    asked: list[dict[str, Any]] = [{name: evaluation(scene) for name, scene in scenes.items()}]
    made = {name: vlmb.build(scene) for name, scene in scenes.items()}
    for duration in DURATIONS:
        asked.append({name: lambda m=m, d=duration: vlmb.simulate(m, duration=d, rtol=1e-8) for name, m in made.items()})
    seconds = [interleaved(functions, repeats=30) for functions in asked]
    return [found["foot"] / found["pivot"] for found in seconds]


def main() -> None:
    """Run all walkers and chains, write the report."""
    rows, found = [], {}
    for name in WALKERS:
        scene = vlmb.load_scene(MODELS / f"{name}.toml")
        run = vlmb.simulate(scene)
        seconds = interleaved({"run": lambda scene=scene: vlmb.simulate(scene)}, repeats=5, number=1)["run"]
        touches = sum(event.kind == "touch" for event in run.events)
        simulated, count, asked = float(run.t[-1]), len(run.mechanism.coordinate_names), run.stats["rhs_evaluations"]
        rows.append([name, count, f"{simulated:g}", touches, asked, f"{seconds:.3f}", f"{simulated / seconds:.0f}"])
        found[name] = {"seconds": seconds, "simulated": simulated, "touches": touches, "times_real_time": simulated / seconds}
    head = ["model", "coordinates", "simulated [s]", "touches", "right-hand sides", "processor time [s]", "times real time"]
    ratios = {str(links): beside_pivot(links) for links in LINKS}
    feet = ["links", "an evaluation", *(f"a run of {duration:g} s" for duration in DURATIONS)]
    title, _, how, foot = (part.strip() for part in str(__doc__).split("\n\n"))
    parts = [title, table(head, rows), how, "## A foot held at the root, beside a pivot"]
    parts += [table(feet, [[links, *(f"{ratio:.2f}" for ratio in own)] for links, own in ratios.items()]), foot]
    write_report("walkers", parts, {**found, "foot_over_pivot": ratios})


if __name__ == "__main__":
    main()
