"""Derivatives of accelerations and of runs: by numbers that carry them, by differences, by variational equations (a minute).

Usage: python benchmarks/derivatives.py

*Accelerations*: all rates of a chart by all its numbers. Jets: the core's evaluation replayed as plain Python, on numbers with
derivatives. Differences: of compiled evaluations, with eight steps extrapolated to 0. Errors are along one direction, against
differences with 50 digits, over the largest derivative.

*Runs*: heights of directions and lengths at the end of a run by all elevations, lengths and rates of both at its start.
Beside: runs with other start values, as `vlmb.sensitivities` compares them. Variational: X' = A(t) X along the run, A by jets
at the nodes of Gauss's method with six stages in the state of the core, as few intervals as a change below 1e-9 needs. Both
errors are against twice as many. Variational equations would have to be carried on over events, impacts, changes of lengths
and starts that rows complete, each with derivatives of its own; runs beside go through all of them as they are.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

from common import MODELS, interleaved, table, write_report

# isort: split
import mpmath
import numpy as np
from numpy.typing import NDArray

import vlmb
from vlmb.core.tree import AT_P
from vlmb.studies.chart import Chart, chart_at
from vlmb.studies.derivatives import jacobian
from vlmb.studies.runs import Runs, tightened, value_at
from vlmb.studies.sensitivities import derivatives as runs_beside
from vlmb.system.jets import Numbers, derivatives, sqrt
from vlmb.system.system import make_system

Array = NDArray[np.float64]

SHOWN = ("spring_pendulum_cone", "one_link", "two_links", "carved_turn", "skier_two_links", "skier_whole_body", "skier_slalom")
RUNS, SPAN = ("spring_pendulum_cone", "one_link", "two_links", "tree"), 1.0  # [s]
STAGES, MOST, ENOUGH = 6, 64, 1e-9


def charted(scene: vlmb.Scene) -> Chart:
    """Return the chart around the start of a scene."""
    return chart_at(make_system(vlmb.build(scene)))


def exactly(function: Callable[[NDArray[np.object_]], NDArray[np.object_]], x: Array, way: Array) -> Array:
    """Return derivatives along a direction by differences with 50 digits."""
    with mpmath.workdps(50):
        h = mpmath.mpf(10) ** -20
        steps = [(mpmath.mpf(value), h * step) for value, step in zip(x.tolist(), way.tolist(), strict=True)]
        ahead, behind = (function(np.array([value + side * step for value, step in steps])) for side in (1, -1))
        return np.array([float((a - b) / (2 * h)) for a, b in zip(ahead, behind, strict=True)])


def accelerations(name: str) -> tuple[list[str], dict[str, float]]:
    """Measure derivatives of the accelerations of a model beside its start."""
    chart = charted(vlmb.load_scene(MODELS / f"{name}.toml"))
    rng = np.random.default_rng(1)
    x, way = chart.numbers(chart.origin) + 3e-3 * rng.standard_normal(len(chart.names)), rng.standard_normal(len(chart.names))
    exact, found = exactly(chart.rates, x, way), {}
    ways = {"jets": lambda: derivatives(chart.rates, x), "differences": lambda: jacobian(chart.rates, x, chart.scales)[0]}
    seconds = interleaved({**ways, "evaluation": lambda: chart.engine.evaluate(chart.t, chart.state(x))}, repeats=5)
    for kind, made in ways.items():
        matrix = made()
        found[f"{kind} error"] = float(np.abs(matrix @ way - exact).max() / np.abs(matrix).max())
    row = [name, str(len(x)), f"{1e3 * seconds['evaluation']:.3f}"]
    row += [text for kind in ways for text in (f"{1e3 * seconds[kind]:.2f}", f"{found[f'{kind} error']:.1e}")]
    return row, {**found, **seconds}


def runs(name: str) -> tuple[list[str], dict[str, float]]:
    """Measure derivatives of a run by its start."""
    scene = tightened(vlmb.load_scene(MODELS / f"{name}.toml"), SPAN)
    chart = charted(scene)
    to = [e.name for e in (*chart.positions, *chart.velocities) if e.kind in ("elevation", "length")]
    links = chart.layout.links
    of = [e.name if e.kind == "length" else f"{links[e.link].name}.direction.z" for e in chart.positions if e.name in to]
    beside = Runs(scene, [f"start.{each}" for each in to], of, np.array([0.0, SPAN]))
    values = np.array([value_at(scene, key) for key in beside.keys])
    runs_beside(beside, values)  # what is compiled and built once
    begun = time.perf_counter()
    compared = runs_beside(beside, values)[0][-1]
    took = time.perf_counter() - begun
    before, intervals = variational(scene, chart, 4, to), 8
    while True:
        begun = time.perf_counter()
        found = variational(scene, chart, intervals, to)
        lasted = time.perf_counter() - begun
        if intervals >= MOST or np.abs(found - before).max() < ENOUGH * np.abs(found).max():
            break
        before, intervals = found, 2 * intervals
    exact = variational(scene, chart, 2 * intervals, to)
    size = float(np.abs(exact).max())
    errors = [float(np.abs(each - exact).max()) / size for each in (compared, found)]
    row = [name, f"{len(of)} by {len(to)}", f"{1e3 * took:.0f}", f"{errors[0]:.1e}", f"{1e3 * lasted:.0f}", f"{errors[1]:.1e}"]
    row += [str(STAGES * intervals)]
    return row, {"beside": took, "variational": lasted, "beside error": errors[0], "variational error": errors[1]}


def variational(scene: vlmb.Scene, chart: Chart, intervals: int, to: list[str]) -> Array:
    """Return how directions and lengths at the end change with some numbers of a chart at the start, by Gauss's method.

    In the state of the core, which is regular at the poles.
    """
    nodes, weights = np.polynomial.legendre.leggauss(STAGES)
    nodes, weights, h = 0.5 * (1.0 + nodes), 0.5 * weights, SPAN / intervals
    powers = np.vander(nodes, STAGES, increasing=True)
    inner = (powers * nodes[:, None] / np.arange(1, STAGES + 1)) @ np.linalg.inv(powers)
    times = (np.arange(intervals)[:, None] * h + h * nodes).ravel()
    run = vlmb.simulate(scene, t_eval=np.concatenate([[0.0], times, [SPAN]]))
    moving = chart.system.core_plan.positions + chart.system.core_plan.velocities
    columns = [chart.names.index(name) for name in to]
    x = derivatives(chart.placed, chart.numbers(chart.origin))[:moving, columns]

    def slope(t: float, y: Numbers) -> Numbers:
        return chart.replay.evaluate(t, np.append(y, np.zeros(len(chart.origin) - moving))).slope[:moving]

    for k in range(intervals):
        part = slice(1 + STAGES * k, 1 + STAGES * (k + 1))
        own = [derivatives(partial(slope, t), state[:moving]) for t, state in zip(run.t[part], run.states[part], strict=True)]
        block = np.eye(STAGES * moving) - h * np.block([[inner[i, j] * own[i] for j in range(STAGES)] for i in range(STAGES)])
        slopes = np.linalg.solve(block, np.vstack([a @ x for a in own])).reshape(STAGES, *x.shape)
        x = x + h * np.einsum("i,ijk->jk", weights, slopes)

    def seen(y: Numbers) -> Numbers:
        found = []
        for e in chart.positions:
            if e.kind == "elevation":
                at = int(chart.arrays.tree.link[chart.arrays.rows[e.link], AT_P])
                found.append(y[at + 2] / sqrt(y[at] * y[at] + y[at + 1] * y[at + 1] + y[at + 2] * y[at + 2]))
            elif e.kind == "length":
                found.append(y[chart.arrays.length_at(e.link, e.axis)[0]])
        return np.array(found, object)

    answer: Array = derivatives(seen, run.states[-1][:moving]) @ x
    return answer


def main() -> None:
    """Measure, write the report."""
    first, second = [accelerations(name) for name in SHOWN], [runs(name) for name in RUNS]
    head = ["scene", "numbers", "evaluation [ms]", "jets [ms]", "error", "differences [ms]", "error"]
    under = ["scene", "derivatives", "runs beside [ms]", "error", "variational [ms]", "error", "nodes"]
    paragraphs = str(__doc__).split("\n\n")
    data = {"accelerations": dict(zip(SHOWN, [found for _, found in first], strict=True)),
            "runs": dict(zip(RUNS, [found for _, found in second], strict=True))}  # fmt: skip
    parts = [paragraphs[0], table(head, [row for row, _ in first]), paragraphs[2]]
    write_report("derivatives", [*parts, table(under, [row for row, _ in second]), paragraphs[3]], data)


if __name__ == "__main__":
    main()
