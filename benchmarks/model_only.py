"""What each shipped scene would cost with the parts that are left out of its model.

Usage: python benchmarks/model_only.py

For each scene of models/: degrees of freedom, joints, the cost of one evaluation, and that of the same scene with a part put
back; chains in a plane and in space; then what a process takes to import and to hold a scene.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from common import interleaved, table, write_report

# isort: split
import msgspec
import numpy as np
import pinocchio as pin
from rhs_cost import chain, imports, micro

import vlmb
from vlmb.model.mechanism import Mechanism, build, data_bytes
from vlmb.simulation.simulate import Checked
from vlmb.system.dynamics import Dynamics
from vlmb.system.start import consistent_start

MODELS = Path(__file__).resolve().parents[1] / "models"
HEAVY = ("sympy", "matplotlib", "meshcat", "tqdm")
LIGHT = 1e-6  # of the rod's mass: hung on a last segment to make it a joint
SAME = 1e-6  # [m] between two motions that are one
SHORT = 0.2  # [s] of motion compared
PARTS = ("fixed segments as joints", "last segment as a joint", "in space", "programme", "reactions", "geometry")
CHAINS = {"pivot": (1, 2, 8, 20, 50), "ski": (1, 2, 8)}
PEAKS = {"numpy": "import numpy", "bare": "import pinocchio, scipy.integrate", "vlmb": "import vlmb"}


class Absent(Exception):
    """A part that a scene does not have, and why."""


def changed_links(scene: vlmb.Scene, change: Callable[[Any], Any]) -> vlmb.Scene:
    """Change every link."""
    return msgspec.structs.replace(scene, links=tuple(change(link) for link in scene.links))


def held(scene: vlmb.Scene) -> vlmb.Scene:
    """Make a joint of every fixed segment, and hold it by a constant law."""

    def side(segment: Any) -> Any:
        if segment.motion != "fixed":
            return segment
        return type(segment)(motion="prescribed", law=float(segment.length or 0.0), limits=(-math.inf, math.inf))

    made = changed_links(scene, lambda link: msgspec.structs.replace(link, lower=side(link.lower), upper=side(link.upper)))
    if build(made).model.njoints == build(scene).model.njoints:
        raise Absent("no fixed segment")
    return made


def with_last(scene: vlmb.Scene) -> vlmb.Scene:
    """Hang a millionth of the rod's mass on every last segment that moves nothing, so that it becomes a joint."""
    layout = build(scene).layout
    bare = {
        link.name
        for link, entry in zip(scene.links, layout.links, strict=True)
        if link.upper.motion != "fixed" and not entry.upper.joint
    }
    if not bare:
        raise Absent("no last segment left out")

    def hang(link: Any) -> Any:
        return msgspec.structs.replace(link, tip_mass=LIGHT * link.rod.mass) if link.name in bare else link

    return changed_links(scene, hang)


def in_space(scene: vlmb.Scene) -> tuple[vlmb.Scene, vlmb.Scene]:
    """Return the scene in space and in its plane; for a spatial scene only where its motion stays in one."""
    if scene.base.kind == "ski":
        raise Absent("the ski turns the plane: see below")
    spatial, planar = msgspec.structs.replace(scene, plane=False), msgspec.structs.replace(scene, plane=True)
    if any(name.startswith("phi") and value for name, value in scene.start.items()):
        raise Absent("the motion leaves the plane")
    start = {name: value for name, value in scene.start.items() if not name.startswith(("phi", "y"))}
    planar = msgspec.structs.replace(planar, start=start)
    try:
        runs = [vlmb.simulate(s, duration=SHORT, t_eval=[0.0, SHORT], rtol=1e-9, atol=1e-11) for s in (spatial, planar)]
    except vlmb.VlmbError as error:
        raise Absent("forces or equations name azimuths") from error
    gap = max(float(np.abs(runs[0].position(e.name) - runs[1].position(e.name)).max()) for e in runs[0].mechanism.layout.links)
    if not gap < SAME:
        raise Absent("the motion leaves the plane")
    return spatial, planar


def without_programme(scene: vlmb.Scene) -> vlmb.Scene:
    """Drop the programme and its controls."""
    if scene.programme is None:
        raise Absent("no programme")
    return msgspec.structs.replace(scene, programme=None)


class Prepared:
    """A scene ready to be evaluated at its start."""

    def __init__(self, scene: vlmb.Scene) -> None:
        self.mechanism: Mechanism = build(scene)
        run, start = scene.run, consistent_start(self.mechanism)
        self.dynamics = Dynamics(self.mechanism, run.knife_edge, run.gain, run=run)
        self.dynamics.reference = [start.coordinates[name] for name in self.mechanism.layout.names]
        self.y = self.dynamics.pack(start.state)

    def rhs(self, route: str | None = None) -> Callable[[], object]:
        """Make one evaluation, by the route that `simulate` takes or by another."""
        rhs = self.dynamics.rhs if route is None else Dynamics(self.mechanism, route=route).rhs
        return lambda: rhs(0.0, self.y)

    def evaluate(self) -> Callable[[], object]:
        """Make one evaluation with all reactions."""
        return lambda: self.dynamics.evaluate(0.0, self.y)

    def with_geometry(self) -> Callable[[], object]:
        """Make one evaluation with a body drawn for every rod kept in its place."""
        import coal

        model, layout = self.mechanism.model, self.mechanism.layout
        geometry = pin.GeometryModel()
        for link in layout.links:
            frame = model.frames[self.mechanism.frames[f"{link.name}.rod_start"]]
            shape = coal.Box(max(link.rod_length, 1e-3), 0.05, 0.05)
            geometry.addGeometryObject(pin.GeometryObject(link.name, frame.parentJoint, frame.placement, shape))
        placed, q, data = geometry.createData(), np.array(self.y[: model.nq]), self.mechanism.data

        def call() -> None:
            self.dynamics.rhs(0.0, self.y)
            pin.updateGeometryPlacements(model, data, geometry, placed, q)

        return call


def measure_scene(path: Path) -> dict[str, Any]:
    """Sizes and costs of one scene; for each part its ratio, or why there is none."""
    scene = vlmb.load_scene(path)
    plain = Prepared(scene)
    mechanism = plain.mechanism
    found: dict[str, Any] = {
        "degrees_of_freedom": Checked(mechanism, consistent_start(mechanism)).degrees_of_freedom,
        "joints": mechanism.model.njoints - 1,
        "velocities": mechanism.model.nv,
        "data": data_bytes(mechanism.model.nv),
        "left_out": len(mechanism.left_out),
        "route": plain.dynamics.route,
    }
    try:
        plain.dynamics.rhs(0.0, plain.y)
    except vlmb.SingularError:
        return found | {"ratios": {}, "reasons": dict.fromkeys(PARTS, "singular at its start, which it is there to show")}
    functions: dict[str, Callable[[], object]] = {"": plain.rhs()}
    sizes: dict[str, int] = {}
    reasons: dict[str, str] = {}
    pairs: dict[str, tuple[str, str]] = {}

    def put(part: str, more: vlmb.Scene | None = None, less: vlmb.Scene | None = None) -> None:
        for key, changed in ((part, more), (f"no {part}", less)):
            if changed is not None:
                other = Prepared(changed)
                functions[key], sizes[key] = other.rhs(), other.mechanism.model.nv
        pairs[part] = (part if more is not None else "", f"no {part}" if less is not None else "")

    for part, make in (
        (PARTS[0], lambda: put(PARTS[0], more=held(scene))),
        (PARTS[1], lambda: put(PARTS[1], more=with_last(scene))),
        (PARTS[2], lambda: put(PARTS[2], *in_space(scene))),
        (PARTS[3], lambda: put(PARTS[3], less=without_programme(scene))),
    ):
        try:
            make()
        except Absent as why:
            reasons[part] = str(why)
        except vlmb.VlmbError as error:
            reasons[part] = f"cannot run so: {str(error).split(':')[0]}"
    functions["reactions"], pairs["reactions"] = plain.evaluate(), ("reactions", "")
    if scene.links:
        functions["geometry"], pairs["geometry"] = plain.with_geometry(), ("geometry", "")
    else:
        reasons["geometry"] = "no links"
    seconds = interleaved(functions, repeats=15)
    found["seconds"] = seconds[""]
    found["ratios"] = {part: seconds[more] / seconds[less] for part, (more, less) in pairs.items()}
    found["velocities_with"] = sizes
    return found | {"reasons": reasons} | process(path)


def measure_plane(base: str, links: int) -> dict[str, Any]:
    """Ratios of a chain in space to the same one in a plane: one evaluation, and a run at the same tolerance.

    On the ski, whose heading turns the plane, the chain in space has the ideal rows phi_i = phi0.
    """
    side, ski = (-1.0 if base == "pivot" else 1.0), base == "ski"
    start = {f"psi{i + 1}": side * (0.8 + 0.6 * math.sin(1.3 * i)) for i in range(links)} | {"psi1_dot": 1.0}
    heading = {"phi0": 0.2, "phi0_dot": 0.5}
    names = [f"phi{i + 1}" for i in range(links)]
    plain = chain(base, links).to_dict() | {"start": start | (heading | {"speed": 2.0} if ski else {})}
    planar, spatial = vlmb.Scene.from_dict({**plain, "plane": True}), vlmb.Scene.from_dict(plain)
    if ski:
        turned = dict.fromkeys(names, 0.2) | {f"{name}_dot": 0.5 for name in names}
        rows = [f"{name} = phi0" for name in names]
        spatial = vlmb.Scene.from_dict({**plain, "constraints": rows, "start": {**plain["start"], **turned}})
    scenes = (spatial, planar)
    made = [Prepared(scene) for scene in scenes]
    seconds = interleaved({"space": made[0].rhs(), "plane": made[1].rhs()}, repeats=20)
    dense = interleaved({"space": made[0].rhs("dense"), "plane": made[1].rhs("dense")}, repeats=20)
    runs: list[Any] = []

    def run(scene: vlmb.Scene) -> Callable[[], object]:
        def call() -> None:
            runs.append(vlmb.simulate(scene, duration=SHORT, t_eval=[0.0, SHORT], rtol=1e-9, atol=1e-11))

        return call

    spent = interleaved({"space": run(scenes[0]), "plane": run(scenes[1])}, repeats=3, number=1)
    gap = max(float(np.abs(runs[-2].position(e.name) - runs[-1].position(e.name)).max()) for e in made[0].mechanism.layout.links)
    assert gap < SAME, f"{base}, {links} links: {gap} m between the two motions"
    return {
        "joints": [m.mechanism.model.njoints - 1 for m in made],
        "velocities": [m.mechanism.model.nv for m in made],
        "routes": [m.dynamics.route for m in made],
        "evaluation": seconds["space"] / seconds["plane"],
        "dense": dense["space"] / dense["plane"],
        "run": spent["space"] / spent["plane"],
        "gap": gap,
    }


PROCESS = """
import json, os, sys
import vlmb
def resident():
    return int(open("/proc/self/statm").read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
from vlmb.system.dynamics import Dynamics
from vlmb.system.start import consistent_start
scene = vlmb.load_scene(sys.argv[1])
before = resident()
mechanism = vlmb.build(scene)
start = consistent_start(mechanism)
dynamics = Dynamics(mechanism, scene.run.knife_edge, scene.run.gain, run=scene.run)
dynamics.reference = [start.coordinates[name] for name in mechanism.layout.names]
dynamics.rhs(0.0, dynamics.pack(start.state))
after = resident()
loaded = sorted({name.partition(".")[0] for name in sys.modules} & set(sys.argv[2:]))
print(json.dumps({"growth": after - before, "loaded": loaded}))
"""


def process(path: Path) -> dict[str, Any]:
    """Memory [bytes] that building a scene and evaluating it once adds to a process, and the heavy modules it loads."""
    return json.loads(child(PROCESS, str(path), *HEAVY))


def resident_after(statement: str) -> float:
    """Resident memory [bytes] of a process that has run a statement."""
    pages = "open('/proc/self/statm').read().split()[1]"
    return float(child(f"{statement}; import os; print(int({pages}) * os.sysconf('SC_PAGE_SIZE'))"))


def child(code: str, *arguments: str) -> str:
    """Run code in a process of its own, with this tree of vlmb; return what it prints."""
    code = f"import sys; sys.path.insert(0, {str(MODELS.parent)!r})\n{code}"
    return subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True).stdout


def measure() -> dict[str, Any]:
    """Measure all shipped scenes, then imports."""
    scenes = {}
    for path in sorted(MODELS.glob("*.toml")):
        scenes[path.stem] = measure_scene(path)
        print(f"{path.stem}: {scenes[path.stem]['ratios']}", flush=True)
    return {
        "scenes": scenes,
        "planes": {f"{base}, {n}": measure_plane(base, n) for base, sizes in CHAINS.items() for n in sizes},
        "imports": imports(),
        "peaks": {name: resident_after(statement) for name, statement in PEAKS.items()},
    }


def report(data: dict[str, Any]) -> str:
    """Write the page."""
    header = ("scene", "degrees of freedom", "joints", "velocities", "left out", "one evaluation, us", *PARTS)
    notes: dict[str, int] = {}
    rows = []
    for name, entry in data["scenes"].items():
        cells = []
        for part in PARTS:
            if part in entry["ratios"]:
                cells.append(f"{entry['ratios'][part]:.2f}")
            else:
                cells.append(f"({notes.setdefault(entry['reasons'][part], len(notes) + 1)})")
        counts = (entry[key] for key in ("degrees_of_freedom", "joints", "velocities", "left_out"))
        rows.append((name, *counts, micro(entry["seconds"]) if "seconds" in entry else "-", *cells))
    ratio = data["imports"]["vlmb"] / data["imports"]["bare"]
    peaks = {name: value / 2**20 for name, value in data["peaks"].items()}
    lines = [
        "# Only what a scene needs",
        "",
        "Shipped scenes at their start: one evaluation of the right-hand side, and how many times as long it takes with a part "
        "put back that is left out. Processor time, the fastest of batches taken in turn.",
        "",
        "* *fixed segments as joints*: each made a prismatic joint that a constant law holds.",
        "* *last segment as a joint*: a segment on which nothing hangs gets a millionth of its rod's mass at its end.",
        "* *in space*: ball joints over `plane = true`, for the same motion (compared before it is timed).",
        "* *programme*: the scene over itself without one.",
        "* *reactions*: every reaction and force by name with the evaluation.",
        "* *geometry*: a box for every rod, moved along by `updateGeometryPlacements`.",
        "",
        table(header, rows),
        "",
        *(f"({number}) {text}" + ("." if number == len(notes) else ";") for text, number in notes.items()),
        "",
        "## In a plane",
        "",
        "Chains of rhs_cost.py, moving in a vertical plane: in space over `plane = true`, by the route of each. On the ski, "
        "which turns the plane, the chain in space has the ideal rows `phi1 = phi0`, ... that hold it there. "
        "Memory, coordinates and the mass matrix shrink; `aba` hardly gains: it multiplies 6 x 6 matrices "
        "whatever a joint turns about.",
        "",
        table(
            (
                "chain",
                "joints",
                "velocities",
                "route",
                "pinocchio.Data",
                "one evaluation",
                "by the dense route",
                "run, with building",
                "gap, m",
            ),
            [
                (
                    n,
                    f"{e['joints'][0]} / {e['joints'][1]}",
                    f"{e['velocities'][0]} / {e['velocities'][1]}",
                    f"{e['routes'][0]} / {e['routes'][1]}",
                    f"{(e['velocities'][0] / e['velocities'][1]) ** 3:.2f}",
                    f"{e['evaluation']:.2f}",
                    f"{e['dense']:.2f}",
                    f"{e['run']:.2f}",
                    f"{e['gap']:.1e}",
                )
                for n, e in data["planes"].items()
            ],
        ),
        "",
        "## Process",
        "",
        f"`import vlmb` takes {ratio:.2f} times the processor time of `import pinocchio, scipy.integrate`, and "
        f"{peaks['vlmb']:.0f} MiB of memory where those take {peaks['bare']:.0f} MiB (numpy alone: {peaks['numpy']:.0f} MiB). "
        "Building a scene and evaluating it once in a process of its own:",
        "",
    ]
    header = ("scene", "pinocchio.Data, KiB", "memory added, MiB", "heavy modules loaded")
    rows = [
        (name, f"{entry['data'] / 2**10:.3g}", f"{entry['growth'] / 2**20:.3g}", " ".join(entry["loaded"]) or "none")
        for name, entry in data["scenes"].items()
        if "loaded" in entry
    ]
    return "\n".join([*lines, table(header, rows), "", f"Heavy: {', '.join(HEAVY)}."])


def main() -> None:
    """Measure, print and write the report."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    data = measure()
    page = report(data)
    print(page)
    write_report("model_only", page, data)


if __name__ == "__main__":
    main()
