"""What one evaluation by the compiled core costs beside `pin.aba` of the same chain.

Usage: python benchmarks/core_cost.py [--links 1 2 8 50 200 1000]

Chains with two spring legs a link and masses at the hinges, on a pivot and on the ski. The core evaluates in a compiled loop, as
its drivers do; `pin.aba` is called from Python, and not for chains whose `pinocchio.Data` takes more than a gigabyte.
"""

from __future__ import annotations

import argparse
import math
from typing import Any

from common import fastest, interleaved, table, write_report

# isort: split
import numba
import numpy as np
import pinocchio as pin

import vlmb
from vlmb.core import tree as t
from vlmb.core.links import accelerate, respond
from vlmb.core.scratch import Scratch, make_scratch
from vlmb.core.tree import Array, Tree
from vlmb.model.mechanism import build, data_bytes

LINKS = (1, 2, 8, 50, 200, 1000)
KINDS = {"pivot": t.PIVOT, "ski": t.SKI}
MASS, LENGTH, TIP_MASS, REST, STIFFNESS = 1.0, 0.2, 0.5, 0.1, 4e3
BASE = {"kind": "ski", "mass": 5.0, "inertia": 0.6, "com_offset": 0.05}
LIMITS = {1: 0.15, 2: 0.1, 8: 0.1, 50: 0.1}  # parts of pin.aba
DATA_LIMIT = 1e9  # [bytes]


@numba.njit(_nrt=False)
def many(count: int, tree: Tree, y: Array, given: Array, force: Array, dy: Array, scratch: Scratch) -> None:
    """Evaluate over and over."""
    for _ in range(count):
        accelerate(tree, y, given, force, dy, scratch)


@numba.njit(_nrt=False)
def many_responses(count: int, tree: Tree, y: Array, force: Array, dy: Array, scratch: Scratch) -> None:
    """Respond over and over."""
    for _ in range(count):
        respond(tree, y, force, dy, scratch)


def chain(base: str, n: int) -> tuple[Tree, Array]:
    """Make the arrays of a chain and a state in motion."""
    random = np.random.default_rng(n)
    p, v = (0, 0) if base == "pivot" else (3, 2)
    link, real = np.zeros((n, 8), np.int64), np.zeros((n, 16))
    for i in range(n):
        link[i] = i - 1, t.TIP, p + 5 * i, v + 5 * i, 1, 1, 0, 1
        real[i, : t.ON_ROD] = [
            LENGTH, MASS, LENGTH / 2, MASS * LENGTH**2 / 12, TIP_MASS, STIFFNESS, REST, 0.0, STIFFNESS, REST, 0.0
        ]  # fmt: skip
    tree = Tree(np.array([KINDS[base], p + 5 * n, v + 5 * n, n]), np.array([5.0, 0.6, 0.05, 0.0, 0.0, -9.81]), link, real)
    y = 0.3 * random.normal(size=p + v + 10 * n)
    for i in range(n):
        d = random.normal(size=3)
        y[p + 5 * i : p + 5 * i + 3] = d / np.linalg.norm(d)
        y[p + 5 * i + 3 : p + 5 * i + 5] = random.uniform(0.05, 0.15, 2)
    return tree, y


def core_times(base: str, n: int) -> dict[str, float]:
    """Seconds of one evaluation and of one response of the core."""
    tree, y = chain(base, n)
    given, force, dy, scratch = np.zeros((n, 6)), np.ones(tree.shape[t.VELOCITIES]), np.zeros_like(y), make_scratch(tree)
    inside = max(1, 20000 // n)
    found = interleaved({
        "accelerate": lambda: many(inside, tree, y, given, force, dy, scratch),
        "respond": lambda: many_responses(inside, tree, y, force, dy, scratch),
    })  # fmt: skip
    return {name: seconds / inside for name, seconds in found.items()}


def pinocchio_time(base: str, n: int) -> float:
    """Seconds of one `pin.aba`; nan where its Data is too large."""
    leg = {"length": REST, "stiffness": STIFFNESS, "limits": [-math.inf, math.inf]}
    rod = {"length": LENGTH, "mass": MASS}
    links = [{"name": f"link{i + 1}", "rod": rod, "lower": leg, "upper": leg, "tip_mass": TIP_MASS} for i in range(n)]
    if data_bytes(5 * n + 3) > DATA_LIMIT:
        return math.nan
    mechanism = build(vlmb.Scene.from_dict({"base": BASE if base == "ski" else {"kind": "pivot"}, "links": links}))
    model, data = mechanism.model, mechanism.data
    q, v = pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq)), np.ones(model.nv)
    tau = np.zeros(model.nv)
    return fastest(lambda: pin.aba(model, data, q, v, tau))


def measure(links: list[int]) -> dict[str, Any]:
    """Measure all chains."""
    data: dict[str, Any] = {}
    for base in KINDS:
        data[base] = {}
        for n in links:
            entry = core_times(base, n) | {"aba": pinocchio_time(base, n)}
            data[base][n] = entry
            ours = entry["accelerate"]
            print(f"{base}, {n} links: {1e9 * ours:.0f} ns, {ours / entry['aba']:.3f} of aba", flush=True)
    return data


def report(data: dict[str, Any]) -> str:
    """Write the page."""
    rows = []
    for base, entries in data.items():
        for n, entry in entries.items():
            ours, aba = entry["accelerate"], entry["aba"]
            ratio = "" if math.isnan(aba) else f"{ours / aba:.3f}"
            limit = LIMITS.get(n, "")
            cells = [f"{1e6 * ours:.3g}", f"{1e9 * ours / n:.0f}", f"{1e9 * entry['respond'] / n:.0f}"]
            rows.append([f"{base}, {n}", *cells, "" if math.isnan(aba) else f"{1e6 * aba:.3g}", ratio, limit])
    header = ["chain, links", "evaluation [us]", "a link [ns]", "response, a link [ns]", "pin.aba [us]", "ratio", "at most"]
    return f"# Cost of one evaluation by the compiled core\n\n{__doc__.split(chr(10), 4)[4].strip()}\n\n{table(header, rows)}"


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--links", type=int, nargs="+", default=list(LINKS))
    data = measure(parser.parse_args().links)
    page = report(data)
    print(page)
    write_report("core_cost", page, {"chains": data}, packages=("pin", "numpy", "numba"))


if __name__ == "__main__":
    main()
