"""The frozen baseline: what a snippet costs with this vlmb over what it cost at one fixed commit, both in one run.

Usage: python benchmarks/baseline.py [--repeats N]

Each side is a process of its own with the same packages; batches are taken in turn and processor time of the whole process
counts, the least of some. A snippet defines `once()`; relative paths are those of the side's own tree. The commit is unpacked
once into ~/.cache/vlmb (or $XDG_CACHE_HOME/vlmb), which may be removed at any time.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import io
import math
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from common import table, write_report

# isort: split
import vlmb

COMMIT = "5ba17c67eb713fe7beca02570f6727e96bd20731"
SHORT = COMMIT[:7]
HERE = Path(vlmb.__file__).resolve().parents[1]
BATCH, REPEATS = 0.05, 15  # [s] that a batch takes at least; batches of each side
SIDE = """
import gc, math, sys, time
import vlmb
def once(): pass
exec(sys.argv[1], globals())
def batch(number):
    began = time.process_time()
    for _ in range(number):
        once()
    return (time.process_time() - began) / number
once()
number = max(1, math.ceil(float(sys.argv[2]) / max(batch(1), 1e-9)))
gc.disable()
print(vlmb.__file__, flush=True)
for _ in sys.stdin:
    print(batch(number), flush=True)
    gc.collect()
"""
SCENE = "models/one_link.toml"
TOLERANCES = (1e-4, 1e-7, 1e-10)
RUN = """
mechanism = vlmb.build(vlmb.load_scene({scene!r}))
def once():
    assert vlmb.simulate(mechanism, duration=5.0, rtol={rtol}, atol={rtol}).status == "finished"
"""
CHANGED_RUN = "a run of an ensemble: one number changed, 5 s"
ENSEMBLE = """
import itertools
scene, numbers = vlmb.load_scene({scene!r}), itertools.count()
def once():
    assert vlmb.simulate(changed(300.0 + 1e-3 * next(numbers)), duration=5.0).status == "finished"
def changed(stiffness):
"""
CHANGED = """
    return scene.changed_at({"links.0.lower.stiffness": stiffness})
"""
CHANGED_BEFORE = """
    data = scene.to_dict()
    data["links"][0]["lower"]["stiffness"] = stiffness
    return vlmb.Scene.from_dict(data)
"""
RUNS, ENSEMBLE_RUNS = 100, 1000
SWEEP = """
scene = vlmb.load_scene({scene!r}).changed(run={{"duration": 5.0}})
def once():
    table = vlmb.sweep(scene, {{"links.0.lower.stiffness": [300.0 + 1e-3 * k for k in range({runs})]}}, ["psi1:last"])
    assert set(table["status"].values.tolist()) == {{"finished"}}
"""
SWEEP_BEFORE = """
scene = vlmb.load_scene({scene!r})
def once():
    for k in range({runs}):
        data = scene.to_dict()
        data["links"][0]["lower"]["stiffness"] = 300.0 + 1e-3 * k
        assert vlmb.simulate(vlmb.Scene.from_dict(data), duration=5.0)["psi1"][-1] < 0.0
"""
LINKS = 1000
CHAIN = """
import math
leg = {{"length": 0.1, "stiffness": 4e3, "limits": [-math.inf, math.inf]}}
link = {{"rod": {{"length": 0.2, "mass": 1.0}}, "lower": leg, "upper": leg, "tip_mass": 0.5}}
mechanism = vlmb.build(vlmb.Scene.from_dict({{"base": {{"kind": "pivot"}}, "links": [link] * {links}}}))
posture = {{"phi": lambda i: math.cos(i), "psi": lambda i: 0.6 * math.sin(3 * i), "xi": lambda i: 0.1}}
names = enumerate(mechanism.coordinate_names)
state = mechanism.state({{name: posture[name.rstrip("0123456789_")](i) for i, name in names}})
"""
CORE = """
from vlmb.system.engines import make_engine
from vlmb.system.system import make_system
engine = make_engine(make_system(mechanism), [0.0] * len(mechanism.coordinate_names), engine="core")
y = engine.pack(state)
def once():
    engine.evaluate(0.0, y)
"""
SUBCHAINS = """
from vlmb.dynamics import Dynamics
dynamics = Dynamics(mechanism, route="subchains")
y = dynamics.pack(state)
def once():
    dynamics.rhs(0.0, y)
"""


def baseline() -> Path:
    """Folder with the baseline's package and models; unpacked from the repository's history at first."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "vlmb" / f"baseline-{SHORT}"
    if folder.exists():
        return folder
    repository = Path(__file__).resolve().parents[1]
    command = ["git", "-C", str(repository), "archive", "--format=tar", COMMIT, "vlmb", "models"]
    packed = subprocess.run(command, capture_output=True, check=False)
    if packed.returncode:
        why = packed.stderr.decode().strip()
        raise SystemExit(f"the baseline is commit {SHORT} of this repository, and git cannot read it: {why}")
    folder.parent.mkdir(parents=True, exist_ok=True)
    made = tempfile.mkdtemp(dir=folder.parent)
    with tarfile.open(fileobj=io.BytesIO(packed.stdout)) as archive:
        archive.extractall(made, filter="data")
    try:
        Path(made).rename(folder)
    except OSError:
        shutil.rmtree(made)
        if not folder.exists():  # else another process was first
            raise
    return folder


class Side:
    """A process that imports vlmb from a tree and times `once()` of a snippet on request."""

    def __init__(self, tree: Path, snippet: str, seconds: float = BATCH) -> None:
        command = [sys.executable, "-c", SIDE, snippet, str(seconds)]
        self.process = subprocess.Popen(
            command, cwd=tree, env=_environment(tree), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        imported = self._answer()
        if not Path(imported).resolve().is_relative_to(tree.resolve()):
            raise SystemExit(f"imported {imported}, not the vlmb of {tree}")

    def seconds(self) -> float:
        """Processor seconds of one call of `once()`, from one batch."""
        assert self.process.stdin is not None
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        return float(self._answer())

    def close(self) -> None:
        """End the process."""
        self.process.communicate()

    def _answer(self) -> str:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit(f"a side ended with exit code {self.process.wait()}; its error is above")
        return line.strip()


def compare(snippet: str, before: str | None = None, repeats: int = REPEATS) -> dict[str, float]:
    """Processor seconds `old` and `new` of `once()`, and their `ratio` new / old; `before` is the old side's own snippet."""
    sides = {"old": Side(baseline(), snippet if before is None else before), "new": Side(HERE, snippet)}
    best = dict.fromkeys(sides, math.inf)
    for _ in range(repeats):
        for name, side in sides.items():
            best[name] = min(best[name], side.seconds())
    for side in sides.values():
        side.close()
    return best | {"ratio": best["new"] / best["old"]}


def compare_processes(code: str, before: str | None = None, repeats: int = REPEATS) -> dict[str, float]:
    """The same of whole processes that run some code: imports and first runs."""
    sides = {"old": (baseline(), code if before is None else before), "new": (HERE, code)}
    best = dict.fromkeys(sides, math.inf)
    for turn in range(repeats + 1):
        for name, (tree, text) in sides.items():
            spent = _process([sys.executable, "-c", text], tree)
            best[name] = min(best[name], spent) if turn else math.inf  # the first one warms the disk's cache
    return best | {"ratio": best["new"] / best["old"]}


def _process(command: Sequence[str], tree: Path) -> float:
    process = subprocess.Popen(command, cwd=tree, env=_environment(tree))
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"a side ended with exit code {process.returncode}; its error is above")
    return usage.ru_utime + usage.ru_stime


def _environment(tree: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(tree)}


def measure(repeats: int) -> dict[str, dict[str, float]]:
    """Ratios of runs, of the start of a process, of a run whose scene has another number, and of one long chain."""
    found = {
        f"`simulate`, 5 s, rtol {rtol:g}": compare(RUN.format(scene=SCENE, rtol=rtol), repeats=repeats) for rtol in TOLERANCES
    }
    ensemble, chain = ENSEMBLE.format(scene=SCENE), CHAIN.format(links=LINKS)
    found[CHANGED_RUN] = compare(ensemble + CHANGED, ensemble + CHANGED_BEFORE, repeats)
    sweeps = SWEEP.format(scene=SCENE, runs=RUNS), SWEEP_BEFORE.format(scene=SCENE, runs=RUNS)
    found[f"{RUNS} runs of a sweep, 5 s, what one ends with kept"] = compare(*sweeps, repeats)
    found[f"one evaluation of {LINKS} links"] = compare(chain + CORE, chain + SUBCHAINS, repeats)
    first = f"import vlmb; vlmb.simulate({SCENE!r}, duration=0.1)"
    found["a process that imports vlmb"] = compare_processes("import vlmb", repeats=repeats)
    found["a process with a first run"] = compare_processes(first, repeats=repeats)
    return found


def through_threads(repeats: int) -> dict[str, float]:
    """Seconds on the clock of a run of an ensemble of ENSEMBLE_RUNS, alone and through a pool of threads; the least of some.

    The runs of both are compared bit for bit.
    """
    scene, threads = vlmb.load_scene(HERE / SCENE), len(os.sched_getaffinity(0))

    def states(k: int) -> bytes:
        run = vlmb.simulate(scene.changed_at({"links.0.lower.stiffness": 300.0 + 1e-3 * k}), duration=5.0)
        assert run.status == "finished"
        return run.states.tobytes()

    least, ends = {"one": math.inf, "pool": math.inf}, dict[str, list[bytes]]()
    with concurrent.futures.ThreadPoolExecutor(threads) as pool:
        for _ in range(max(3, repeats // 3)):
            for name, run_all in (("one", map), ("pool", pool.map)):
                began = time.perf_counter()
                ends[name] = list(run_all(states, range(ENSEMBLE_RUNS)))
                least[name] = min(least[name], (time.perf_counter() - began) / ENSEMBLE_RUNS)
    if ends["one"] != ends["pool"]:
        raise SystemExit("runs through a pool of threads differ from those in a row")
    return least | {"threads": threads}


def main() -> None:
    """Compare and report."""
    parser = argparse.ArgumentParser(description="Compare this vlmb with the frozen baseline.")
    parser.add_argument("--repeats", type=int, default=REPEATS, help="batches, or processes, of each side")
    repeats = parser.parse_args().repeats
    found, least = measure(repeats), through_threads(repeats)
    old = found[CHANGED_RUN]["old"]
    rows = [
        (name, *(f"{1e3 * entry[side]:.3g}" for side in ("old", "new")), f"{entry['ratio']:.3f}") for name, entry in found.items()
    ]
    parts = [
        "# Beside the frozen baseline",
        f"`{SCENE}`: processor time of this vlmb over that of commit {SHORT}, taken in turn. The core is compiled before: the "
        f"first process of each side is not counted. {LINKS} links: one evaluation by the core over one by the sub-chains that "
        "the baseline takes for them.",
        table(("what", "old, ms", "new, ms", "new / old"), rows),
        f"An ensemble of {ENSEMBLE_RUNS} such runs by the clock, compared bit for bit: {1e3 * least['one']:.3g} ms a run in a "
        f"row, {1e3 * least['pool']:.3g} ms through a pool of {least['threads']} threads: {old / least['one']:.1f} and "
        f"{old / least['pool']:.1f} times as fast as the baseline in a row on one core.",
    ]
    write_report("baseline", parts, {"commit": COMMIT, "found": found, "ensemble": least})


if __name__ == "__main__":
    main()
