"""Long chains: time, memory and error of every route over the number of links, from 1 to 1000.

Usage: python benchmarks/long_chains.py

The chains and postures of rhs_cost.py on a pivot. Dense and recursive routes go through one Pinocchio model; sub-chains through
closed forms of every link, joined by a banded solve. Error: accelerations beside mass points and Lagrange's equations in extended
precision, as far as that can be factored.
"""

from __future__ import annotations

import argparse
import gc
import json
import subprocess
import sys
from typing import TYPE_CHECKING, Any

from common import CLOCK, interleaved, save_figure, table, write_report

# isort: split
import numpy as np
import pinocchio as pin
from rhs_cost import Array, chain, evaluation, measured, micro, posture, reference, resident

import vlmb
from vlmb.model.long_chains import LONG_CHAIN
from vlmb.model.mechanism import Mechanism, build, data_bytes
from vlmb.system.dynamics import Dynamics
from vlmb.views.style import BLACK, PALETTE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LINKS = (1, 2, 4, 8, 12, 16, 20, 24, 28, 32, 40, 50, 64, 100, 200, 500, 1000)
ONE_MODEL = 100  # links whose single Data still fits into a few GB
MASS_POINTS = 200  # links for which the reference can be factored in extended precision
STATES = 2
RUN = (1000, 0.05)  # links, duration [s] of the run
ROUTES = ("recursive", "dense", "subchains")


def routes(links: int) -> tuple[str, ...]:
    """Routes that a chain of this length fits."""
    return ROUTES if links <= ONE_MODEL else ROUTES[2:]


def relative(mechanism: Mechanism, state: vlmb.State, vdot: Array, exact: tuple[Array, Array]) -> float:
    """Largest error of direction and length accelerations, each over its largest."""
    pairs = zip(measured(mechanism.layout, state, vdot), exact, strict=True)
    return max(float(np.abs(ours - true).max() / np.abs(true).max()) for ours, true in pairs)


def errors(mechanism: Mechanism) -> dict[str, float]:
    """Largest relative error of each route over some states."""
    links = len(mechanism.layout.links)
    found = dict.fromkeys(routes(links), 0.0)
    made = {route: Dynamics(mechanism, route=route) for route in found}
    if links > MASS_POINTS:
        return {}
    for seed in range(STATES):
        drawn = posture(mechanism, seed)
        state = vlmb.State(pin.normalize(mechanism.model, drawn.q), drawn.v)
        exact = reference(mechanism, state)
        for route, dynamics in made.items():
            vdot = dynamics.rhs(0.0, dynamics.pack(state))[dynamics.nq : dynamics.nq + dynamics.nv]
            found[route] = max(found[route], relative(mechanism, state, vdot, exact))
    return found


def times(mechanism: Mechanism) -> dict[str, float]:
    """Seconds of one evaluation by each route, taken in turn."""
    links, state = len(mechanism.layout.links), posture(mechanism, 0)
    made = {route: Dynamics(mechanism, route=route) for route in routes(links)}
    return interleaved({name: evaluation(d, d.pack(state)) for name, d in made.items()}, repeats=20 if links <= 100 else 6)


def memory(route: str, links: int) -> float:
    """Resident memory [bytes] that building and evaluating a chain adds to a process of its own."""
    command = [sys.executable, __file__, "--memory", route, str(links)]
    return float(json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout))


def print_memory(route: str, links: int) -> None:
    """Build and evaluate one chain; print what this process grew by. With the route "model": build it alone."""
    build(chain("pivot", 1))
    before = resident()
    mechanism = build(chain("pivot", links))
    if route == "model":
        print(resident() - before)
        return
    dynamics = Dynamics(mechanism, route=route)
    dynamics.rhs(0.0, dynamics.pack(posture(mechanism, 0)))
    print(resident() - before)


def run() -> dict[str, Any]:
    """Let the longest chain go and follow its energy."""
    links, duration = RUN
    mechanism = build(chain("pivot", links))
    start = mechanism.coordinates(posture(mechanism, 0))
    scene = vlmb.Scene.from_dict({**chain("pivot", links).to_dict(), "start": start})
    began = CLOCK()
    trajectory = vlmb.simulate(scene, duration=duration, t_eval=np.linspace(0.0, duration, 11), rtol=1e-9, atol=1e-11)
    spent = CLOCK() - began
    assert trajectory.status == "finished", trajectory.message
    balance = float(np.abs(trajectory["balance"]).max() / trajectory["kinetic"].max())
    return {"links": links, "duration": duration, "seconds": spent, "balance": balance, **trajectory.stats}


def measure() -> dict[str, Any]:
    """Measure everything, one chain at a time: Data of a long one takes gigabytes."""
    data: dict[str, Any] = {"time": {}, "error": {}, "memory": {}, "estimate": {}}
    for n in LINKS:
        mechanism = build(chain("pivot", n))
        data["time"][n] = times(mechanism)
        data["error"][n] = errors(mechanism)
        data["estimate"][n] = data_bytes(mechanism.model.nv)
        del mechanism
        gc.collect()
        data["memory"][n] = {route: memory(route, n) for route in routes(n) if route != "recursive"}
        print(f"{n} links: {micro(data['time'][n]['subchains'])} us by sub-chains", flush=True)
    data["model"] = memory("model", LINKS[-1])
    data["run"] = run()
    data |= {"long_chain": LONG_CHAIN}
    return data


def slope(values: dict[int, float]) -> float:
    """Power of n with which a quantity grows over the longest three chains."""
    n = sorted(values)[-3:]
    return float(np.polyfit(np.log(n), np.log([values[k] for k in n]), 1)[0])


def report(data: dict[str, Any]) -> str:
    """Write the page."""
    ours = {n: entry["subchains"] for n, entry in data["time"].items()}
    held = {n: entry["subchains"] for n, entry in data["memory"].items()}
    rows = []
    for n in data["time"]:
        t, e, m = data["time"][n], data["error"][n], data["memory"][n]
        cells = [f"{t[name] / t['subchains']:.2f}" if name in t else "-" for name in ("recursive", "dense")]
        wrong = [f"{e[name]:.1e}" if name in e else "-" for name in ROUTES]
        size = [f"{m['dense'] / 2**20:.4g}" if "dense" in m else f"({data['estimate'][n] / 2**20:.3g})"]
        rows.append((str(n), micro(t["subchains"]), *cells, *wrong, *size, f"{m['subchains'] / 2**20:.4g}"))
    header = (
        "links", "sub-chains, us", "recursive / sub-chains", "dense / sub-chains", "error recursive", "error dense",
        "error sub-chains", "one model, MiB", "sub-chains, MiB",
    )  # fmt: skip
    lines = [
        "# Long chains",
        "",
        "One evaluation of the right-hand side of a chain on a pivot (links as in [rhs_cost](rhs_cost.md)): processor time, the "
        "fastest of batches taken in turn, so read it as ratios; the largest relative error of accelerations beside mass points "
        f"in extended precision up to {MASS_POINTS} links; and the memory a process grows by. In brackets: an estimate of what "
        "does not fit.",
        "",
        table(header, rows),
        "",
        f"* From {LINKS[-3]} to {LINKS[-1]} links the time of sub-chains grows as n^{slope(ours):.2f}, "
        f"their memory as n^{slope(held):.2f}: of the {held[LINKS[-1]] / 2**20:.0f} MiB of {LINKS[-1]} links Pinocchio's model "
        f"takes {data['model'] / 2**20:.0f}, for it lists the ancestors of every joint. "
        "`pinocchio.Data` of one model grows as n^3.",
        f"* `simulate` takes one model up to {LONG_CHAIN} links, and sub-chains beyond, where the scene is a chain with nothing "
        "but springs and dampers; else the dense route.",
        f"* A run of {data['run']['links']} links over {data['run']['duration']:g} s, rtol 1e-9: "
        f"{data['run']['rhs_evaluations']} evaluations, energy kept to {data['run']['balance']:.1e} of the largest kinetic one.",
        "",
        "![time, memory and error over the number of links](long_chains.png)",
    ]
    return "\n".join(lines)


def draw(data: dict[str, Any], figure: Figure) -> None:
    """Time, memory and error over the number of links, both logarithmic."""
    axes = figure.subplots(1, 3)
    colours = dict(zip(ROUTES, PALETTE, strict=False))
    for route in ROUTES:
        for panel, name, scale in ((axes[0], "time", 1e3), (axes[1], "memory", 2.0**-20), (axes[2], "error", 1.0)):
            n = [k for k in data[name] if route in data[name][k]]
            label = {"subchains": "sub-chains"}.get(route, route)
            panel.plot(n, [data[name][k][route] * scale for k in n], ".-", color=colours[route], label=label)
    for panel, text in zip(axes, ("one evaluation, ms", "memory, MiB", "relative error of accelerations"), strict=True):
        panel.set(xscale="log", yscale="log", xlabel="links", ylabel=text)
    axes[2].axhline(float(np.finfo(float).eps), color=BLACK, linewidth=0.8)
    axes[0].legend()


def main() -> None:
    """Measure, print and write the report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--memory", nargs=2, metavar=("ROUTE", "LINKS"), help="print the memory one chain takes, and stop")
    args = parser.parse_args()
    if args.memory:
        print_memory(args.memory[0], int(args.memory[1]))
        return
    data = measure()
    page = report(data)
    print(page)
    save_figure("long_chains", lambda figure: draw(data, figure), 12.0, 4.0)
    write_report("long_chains", page, data)


if __name__ == "__main__":
    main()
