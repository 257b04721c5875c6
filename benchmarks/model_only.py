"""What each shipped scene would cost with the parts that are left out of its model, and what a process takes to import vlmb.

Usage: python benchmarks/model_only.py
"""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from common import MODELS, interleaved, micro, table, write_report

# isort: split
import msgspec
import numba
import numpy as np

import vlmb
from vlmb.core.evaluation import evaluate
from vlmb.core.links import accelerate
from vlmb.core.plant import Memory, Plant
from vlmb.model.mechanism import build
from vlmb.system.core_engine import CoreEngine
from vlmb.system.engines import make_engine
from vlmb.system.start import consistent_start
from vlmb.system.system import make_system

LIGHT = 1e-6  # of the rod's mass: hung on a last segment to make it a joint
INSIDE = 200  # evaluations in a compiled loop
PARTS = {
    "fixed segments as joints": "each made a prismatic joint that a constant law holds",
    "last segment as a joint": "a segment on which nothing hangs gets a millionth of its rod's mass at its end",
    "programme": "the scene over itself without one",
    "reactions": "every reaction and force by name, by Pinocchio, over one evaluation",
    "limits": "a run with limits of its lengths over the run without",
}
PROCESSES = {"numpy": "import numpy", "bare": "import pinocchio, scipy.integrate", "vlmb": "import vlmb"}
PROCESS = """
import os, time
began = time.process_time()
{}
print(time.process_time() - began, int(open("/proc/self/statm").read().split()[1]) * os.sysconf("SC_PAGE_SIZE"))
"""
Call = Callable[[], object]
Array = np.ndarray


@numba.njit(_nrt=False)
def evaluations(plant: Plant, memory: Memory, y: Array, dy: Array) -> int:
    """Evaluate over and over; 0 if all went well."""
    code = 0
    for _ in range(INSIDE):
        code = max(code, evaluate(plant, memory, 0.0, y, dy))
    return code


@numba.njit(_nrt=False)
def recursions(plant: Plant, memory: Memory, y: Array, dy: Array) -> None:
    """The same of the links' recursion alone, with the forces of the last evaluation."""
    for _ in range(INSIDE):
        accelerate(plant.tree, y, memory.given, memory.force, dy, memory.scratch)


class Prepared:
    """A scene ready to be evaluated at its start."""

    def __init__(self, scene: vlmb.Scene) -> None:
        self.mechanism = build(scene)
        system = make_system(self.mechanism)
        start = consistent_start(system)
        near = [start.coordinates[name] for name in self.mechanism.layout.names]
        self.workspace = system.workspace(branch=near)
        self.y = self.workspace.pack(start.state)
        engine = make_engine(system, near)
        self.engine = engine if isinstance(engine, CoreEngine) else None
        self.state = engine.pack(start.state)
        self.change = np.zeros(len(self.state))

    def rhs(self) -> None:
        """Evaluate INSIDE times."""
        if self.engine is not None:
            evaluations(self.engine.plan.plant, self.engine.memory, self.state, self.change)
        else:
            for _ in range(INSIDE):
                self.workspace.rhs(0.0, self.y)

    def recursion(self) -> None:
        """Go through the links INSIDE times."""
        if self.engine is not None:
            recursions(self.engine.plan.plant, self.engine.memory, self.state, self.change)

    def reactions(self) -> None:
        """Evaluate once with all reactions."""
        self.workspace.evaluate(0.0, self.y)


def held(scene: vlmb.Scene) -> vlmb.Scene:
    """The scene with a joint for every fixed segment, held by a constant law."""

    def side(segment: Any) -> Any:
        if segment.motion != "fixed":
            return segment
        return type(segment)(motion="prescribed", law=float(segment.length or 0.0), limits=(-math.inf, math.inf))

    return _links(scene, lambda link: msgspec.structs.replace(link, lower=side(link.lower), upper=side(link.upper)))


def hung(scene: vlmb.Scene) -> vlmb.Scene:
    """The scene with a millionth of the rod's mass on every last segment that moves nothing."""
    entries = {entry.name: entry for entry in build(scene).layout.links}

    def hang(link: Any) -> Any:
        moves = link.upper.motion == "fixed" or entries[link.name].upper.joint
        return link if moves else msgspec.structs.replace(link, tip_mass=LIGHT * link.rod.mass)

    return _links(scene, hang)


def unlimited(scene: vlmb.Scene) -> vlmb.Scene:
    """The scene without limits of its lengths, and with no fall to look for."""

    def free(segment: Any) -> Any:
        return msgspec.structs.replace(segment, limits=(-math.inf, math.inf)) if segment.motion == "free" else segment

    run = msgspec.structs.replace(scene.run, fall=False)
    bare = msgspec.structs.replace(scene, run=run, expect={})
    return _links(bare, lambda link: msgspec.structs.replace(link, lower=free(link.lower), upper=free(link.upper)))


def of_run(scene: vlmb.Scene) -> Call:
    """A short run of a scene."""
    mechanism = build(scene)
    return lambda: vlmb.simulate(mechanism, duration=0.2)


def _links(scene: vlmb.Scene, change: Callable[[Any], Any]) -> vlmb.Scene:
    return msgspec.structs.replace(scene, links=tuple(change(link) for link in scene.links))


def measure_scene(path: Path) -> dict[str, Any]:
    """Sizes and cost of one scene, and for each part that can be put back how many times as long an evaluation takes then."""
    scene = vlmb.load_scene(path)
    plain = Prepared(scene)
    model = plain.mechanism.model
    found = {"joints": model.njoints - 1, "velocities": model.nv, "left_out": len(plain.mechanism.left_out), "ratios": {}}
    try:
        plain.reactions()
    except vlmb.SingularError:  # at its start, which it is there to show
        return found
    functions: dict[str, Call] = {"": plain.rhs, "recursion": plain.recursion, "reactions": plain.reactions}
    functions |= {"limits": of_run(scene), "no limits": of_run(unlimited(scene))}
    if scene.programme is not None:
        functions["none"] = Prepared(msgspec.structs.replace(scene, programme=None)).rhs
    for part, more in zip(PARTS, (held(scene), hung(scene)), strict=False):
        if build(more).model.njoints > model.njoints:
            functions[part] = Prepared(more).rhs
    seconds = interleaved(functions, repeats=15)
    seconds["reactions"] *= INSIDE
    found["seconds"] = seconds[""] / INSIDE
    found["ratios"] = {part: seconds[part] / seconds[""] for part in PARTS if part in seconds}
    found["ratios"]["limits"] = seconds["limits"] / seconds["no limits"]
    if plain.engine is not None:
        found["over"] = seconds[""] / seconds["recursion"]
    if "none" in seconds:
        found["ratios"]["programme"] = seconds[""] / seconds["none"]
    return found


def processes(repeats: int = 12) -> dict[str, tuple[float, float]]:
    """Processor seconds and memory [bytes] of imports in processes of their own: the least of some taken in turn."""
    best = dict.fromkeys(PROCESSES, (math.inf, math.inf))
    for _ in range(repeats):
        for name, statement in PROCESSES.items():
            command = [sys.executable, "-c", PROCESS.format(statement)]
            answer = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
            best[name] = (min(best[name][0], float(answer[0])), min(best[name][1], float(answer[1])))
    return best


def report(data: dict[str, Any]) -> list[str]:
    """Parts of the page."""
    rows = []
    for name, entry in data["scenes"].items():
        counts = [entry[key] for key in ("joints", "velocities", "left_out")]
        ratios = [f"{entry['ratios'][part]:.2f}" if part in entry["ratios"] else "-" for part in PARTS]
        over = f"{entry['over']:.2f}" if "over" in entry else "-"
        rows.append((name, *counts, micro(entry["seconds"]) if "seconds" in entry else "singular", over, *ratios))
    spent, taken = ({name: values[k] for name, values in data["processes"].items()} for k in (0, 1))
    return [
        "# Only what a scene needs",
        "Shipped scenes at their start: one evaluation of the right-hand side in a compiled loop, beside the recursion through "
        "the links alone (1: nothing is paid for forces, laws, rows, work states that the scene does not have), and how many "
        "times as long it takes with a part put back that is left out (a dash: it has no such part). Processor time, the "
        "fastest of batches taken in turn.",
        "\n".join(f"* *{part}*: {what}." for part, what in PARTS.items()),
        table(("scene", "joints", "velocities", "left out", "one evaluation, us", "over the recursion", *PARTS), rows),
        "## Process",
        f"`import vlmb` takes {spent['vlmb'] / spent['bare']:.2f} times the processor time of `import pinocchio, "
        f"scipy.integrate`, and {taken['vlmb'] / 2**20:.0f} MiB of memory where those take {taken['bare'] / 2**20:.0f} MiB "
        f"(numpy alone: {taken['numpy'] / 2**20:.0f} MiB).",
    ]


def main() -> None:
    """Measure and report."""
    data = {
        "scenes": {path.stem: measure_scene(path) for path in sorted(MODELS.glob("*.toml"))},
        "processes": processes(),
    }
    write_report("model_only", report(data), data)


if __name__ == "__main__":
    main()
