"""One evaluation of the accelerations of chains of 1 to 1000 links: time beside Pinocchio's bare calls, error, memory.

Usage: python benchmarks/evaluation.py

Bare calls: `crba` and `nonLinearEffects`, the least that any dense formulation asks for; `aba` alone is the other yardstick.
Error: direction and length accelerations beside mass points and Lagrange's equations in extended precision, as far as that can
be factored. Both engines are measured: the core's recursion in a compiled loop, as its drivers call it, and Pinocchio's through
its workspace, where one dense model fits.
"""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from common import interleaved, micro, table, write_report

# isort: split
import numba
import numpy as np
import pinocchio as pin
from chains import (
    BASES,
    LEG,
    LONG,
    MASS,
    ROD,
    TIP,
    Array,
    chain,
    core_chain,
    core_measured,
    largest_error,
    measured,
    posture,
    reference,
)  # fmt: skip

import vlmb
from vlmb.core.lanes import LANES
from vlmb.core.links import accelerate, respond
from vlmb.core.scratch import Lanes, Scratch, make_lanes, make_scratch
from vlmb.core.tree import VELOCITIES, Tree
from vlmb.model.mechanism import Mechanism, build
from vlmb.model.memory import data_bytes, make_data
from vlmb.system.engines import make_engine
from vlmb.system.system import make_system
from vlmb.views.style import BLACK, PALETTE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENGINES = ("core", "pinocchio")
LINKS = {
    "pivot": (1, 2, 4, 8, 12, 16, 20, 24, 32, 50, 100, 200, 500, 1000),
    "ski": (1, 2, 8, 20, 24, 32, 50, 100),
}  # fmt: skip
ONE_MODEL = 100  # links whose single Data still fits into a few GB
EXACT = 200  # links whose exact accelerations can be factored in extended precision
STATES = 2
INSIDE = 20000  # links that the core goes through in one batch
HELD = (1, 8, 24, 50, 100, 200, 500, 1000)  # links whose memory is measured


def engines(links: int) -> tuple[str, ...]:
    """Engines that a chain of this length fits."""
    return ENGINES if links <= ONE_MODEL else ENGINES[:1]


def rates(mechanism: Mechanism, state: vlmb.State, engine: str) -> tuple[Callable[[], Array], int]:
    """One evaluation of y' by an engine, and where the velocities' rates begin."""
    system = make_system(mechanism)
    if engine == "core":
        made = make_engine(system, np.zeros(len(mechanism.layout.names)), None, engine)
        y, first = made.pack(state), system.core_plan.positions
        return lambda: made.evaluate(0.0, y), first
    workspace = system.workspace()
    y, rhs = workspace.pack(state), workspace.rhs
    return lambda: rhs(0.0, y), workspace.nq


@numba.njit(_nrt=False)
def many(count: int, tree: Tree, y: Array, given: Array, force: Array, dy: Array, scratch: Scratch) -> None:
    """Evaluate over and over."""
    for _ in range(count):
        accelerate(tree, y, given, force, dy, scratch)


@numba.njit(_nrt=False)
def many_responses(count: int, tree: Tree, force: Array, scratch: Scratch, lanes: Lanes) -> None:
    """Respond over and over, to four loads at a time."""
    for _ in range(count):
        for j in range(force.shape[0]):
            for lane in range(LANES):
                lanes.moved[j, lane] = force[j, lane]
        respond(tree, scratch, lanes)


def core_seconds(base: str, n: int) -> dict[str, float]:
    """Seconds of one evaluation by the core, and of one response to forces with its factors."""
    tree, y = core_chain(base, n)
    given, force, dy, scratch = np.zeros((n, 6)), np.ones(tree.shape[VELOCITIES]), np.zeros_like(y), make_scratch(tree)
    lanes, loads = make_lanes(n, len(force)), np.ones((len(force), LANES))
    inside = max(1, INSIDE // n)
    found = interleaved({
        "core": lambda: many(inside, tree, y, given, force, dy, scratch),
        "respond": lambda: many_responses(inside, tree, loads, scratch, lanes),
    })  # fmt: skip
    return {name: seconds / inside for name, seconds in found.items()}


def seconds(mechanism: Mechanism) -> dict[str, float]:
    """Seconds of one evaluation by Pinocchio's workspace, and of Pinocchio's bare calls, taken in turn."""
    links, state, model = len(mechanism.layout.links), posture(mechanism, 0), mechanism.model
    if links > ONE_MODEL:
        return {}
    data, q, v, tau = make_data(mechanism.model), np.array(state.q), np.array(state.v), np.zeros(model.nv)
    functions = {
        "pinocchio": rates(mechanism, state, "pinocchio")[0],
        "bare": lambda: (pin.crba(model, data, q), pin.nonLinearEffects(model, data, q, v)),
        "aba": lambda: pin.aba(model, data, q, v, tau),
    }
    return interleaved(functions, repeats=30 if links <= 8 else 12)


def errors(mechanism: Mechanism) -> dict[str, float]:
    """Largest relative error of each engine over some states."""
    found = dict.fromkeys(engines(len(mechanism.layout.links)), 0.0)
    for seed in range(STATES):
        drawn = posture(mechanism, seed)
        state = vlmb.State(pin.normalize(mechanism.model, drawn.q), drawn.v)
        exact = reference(mechanism, state)
        for engine in found:
            evaluate, first = rates(mechanism, state, engine)
            read = core_measured if engine == "core" else measured
            found[engine] = max(found[engine], largest_error(read(mechanism.layout, state, evaluate()[first:]), exact))
    return found


def memory(links: int, model: bool = False) -> float:
    """Resident memory [bytes] that building and evaluating a chain on a pivot, or making its model, adds to a process."""
    command = [sys.executable, __file__, "--memory", str(links), *(["model"] if model else [])]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def print_memory(links: int, model: bool) -> None:
    """Print what this process grows by, for `memory`."""

    def resident() -> int:
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")

    first = build(chain("pivot", 1))
    rates(first, posture(first, 0), "core")[0]()  # code and its imports
    _ = first.model
    before = resident()
    mechanism = build(chain("pivot", links))
    _ = mechanism.model if model else rates(mechanism, posture(mechanism, 0), "core")[0]()
    print(resident() - before)


def measure() -> dict[str, Any]:
    """Measure everything, one chain at a time: Data of a long one takes gigabytes."""
    data: dict[str, Any] = {"time": {}, "error": {}, "memory": {}}
    for base, sizes in LINKS.items():
        data["time"][base], data["error"][base] = {}, {}
        for n in sizes:
            mechanism = build(chain(base, n))
            data["time"][base][n] = seconds(mechanism) | core_seconds(base, n)
            data["error"][base][n] = errors(mechanism) if n <= EXACT else {}
            del mechanism
            gc.collect()
            print(f"{base}, {n} links: {data['time'][base][n]}", flush=True)
    data["memory"] = {n: memory(n) for n in HELD}
    data["model"] = memory(HELD[-1], model=True)
    return data


def rows(data: dict[str, Any], base: str) -> list[tuple[str, ...]]:
    """Table rows of the chains on a base."""
    found = []
    for n, time in data["time"][base].items():
        error, aba = data["error"][base][n], time.get("aba")
        beside = [f"{time[name] / aba:.3f}" if aba and name in time else "-" for name in ("core", "respond", "pinocchio", "bare")]
        times = [micro(time[name]) if name in time else "-" for name in ("core", "respond", "pinocchio", "aba")]
        found.append((f"{base}, {n}", *times, *beside, *(f"{error[e]:.1e}" if e in error else "-" for e in ENGINES)))
    return found


def report(data: dict[str, Any]) -> list[str]:
    """Parts of the page."""
    times = ("core, us", "its response, us", "pinocchio engine, us", "aba, us")
    ratios = ("core / aba", "response / aba", "pinocchio engine / aba", "bare calls / aba")
    header = ("chain", *times, *ratios, *(f"error {engine}" for engine in ENGINES))
    held, last = data["memory"], HELD[-1]
    sizes = [(n, f"{held[n] / 2**20:.4g}", f"{data_bytes(5 * n) / 2**20:.4g}") for n in HELD]
    return [
        "# Cost of an evaluation",
        f"Chains of equal links: rod {ROD} m, {MASS:g} kg, both legs with springs of {LEG['stiffness']:g} N/m, tip mass {TIP} "
        "kg. Processor time of one thread, the fastest of batches taken in turn, so read it as ratios; largest relative error of "
        f"direction and length accelerations over {STATES} postures in motion, beside mass points in numbers of "
        f"{np.finfo(LONG).nmant + 1} bits (double: 53).",
        table(header, [row for base in BASES for row in rows(data, base)]),
        "*Core* is the compiled recursion over links in a compiled loop; its *response* is what four further loads add, with the "
        "factors at hand. The *Pinocchio engine* forms one dense mass matrix, as every form of constraint asks for; its time is "
        "that of a call from Python. *Bare calls*: `crba` and `nonLinearEffects`.",
        "![time and error over the number of links](evaluation.png)",
        "## Memory",
        "What a process grows by when it builds and evaluates a chain on a pivot, and an estimate of one model's "
        "`pinocchio.Data`, about 4 nv^3 doubles.",
        table(("links", "measured, MiB", "Data of one model, MiB"), sizes),
        f"{last} links take {held[last] / held[last // 10]:.2g} times what {last // 10} take. Pinocchio's model of {last} links, "
        f"which the core runs without, takes {data['model'] / 2**20:.0f} MiB: it lists the ancestors of every joint.",
    ]


def draw(data: dict[str, Any], figure: Figure) -> None:
    """Time and error over the number of links, both logarithmic."""
    axes = figure.subplots(1, 2)
    for base, dashes in zip(BASES, ("-", "--"), strict=True):
        for way, colour in zip(ENGINES, PALETTE, strict=False):
            for panel, name, scale in ((axes[0], "time", 1e3), (axes[1], "error", 1.0)):
                n = [k for k in data[name][base] if way in data[name][base][k]]
                values = [data[name][base][k][way] * scale for k in n]
                panel.plot(n, values, dashes, color=colour, marker=".", label=f"{way}, {base}")
    for panel, text in zip(axes, ("one evaluation [ms]", "largest relative error of accelerations"), strict=True):
        panel.set(xscale="log", yscale="log", xlabel="links", ylabel=text)
    axes[1].axhline(float(np.finfo(float).eps), color=BLACK, linewidth=0.8)
    axes[0].legend()


def main() -> None:
    """Measure and report."""
    if sys.argv[1:2] == ["--memory"]:
        print_memory(int(sys.argv[2]), len(sys.argv) > 3)
        return
    data = measure()
    write_report("evaluation", report(data), data, picture=(lambda figure: draw(data, figure), 9.0, 4.0))


if __name__ == "__main__":
    main()
