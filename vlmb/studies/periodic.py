"""Periodic motions, up to a displacement, and how deviations from them grow in a period."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, SimulationError, StudyError, VlmbError, finite
from vlmb.model.mechanism import build
from vlmb.model.names import DOT
from vlmb.scene.scene import Scene, as_scene
from vlmb.simulation.trajectory import Trajectory
from vlmb.studies.chart import Chart, chart_at
from vlmb.studies.derivatives import jacobian
from vlmb.studies.ensemble import Ensemble, Task
from vlmb.studies.linearize import independent
from vlmb.studies.runs import tightened
from vlmb.studies.steady import named_at
from vlmb.system.pace import laws_of
from vlmb.system.system import make_system

Array = NDArray[np.float64]

ROUNDS, HELD = 25, 1e-9  # iterations; the residual that is accepted
REPEATS = 1e-9  # of the largest rate: by how much those a period later may differ
FLAT, LONGEST = 1e-7, 0.3  # singular values over the largest that are none; the longest step, in units of a coordinate, or [s]
BESIDE = 0.01  # where laws are looked at: an equilibrium may hide them


@dataclass(frozen=True, eq=False)
class Orbit:
    """A periodic motion: its period [s], coordinates and rates at its start, and the trajectory of one period.

    `multipliers` (m,): what deviations are multiplied by in a period, the largest first; that of the motion along itself, 1, is
    left out where nothing depends on time. `residual` is what a period lacks to come back.
    """

    period: float
    coordinates: dict[str, float]
    rates: dict[str, float]
    multipliers: NDArray[np.complex128]
    residual: float
    trajectory: Trajectory
    error: float  # of the derivatives, relative

    @property
    def stability(self) -> str:
        """"asymptotically stable", "neutral" or "unstable", to first order."""
        largest = float(np.abs(self.multipliers).max(initial=0.0))
        return "unstable" if largest > 1.0 + 1e-6 else "neutral" if largest > 1.0 - 1e-6 else "asymptotically stable"

    def __repr__(self) -> str:
        size = float(np.abs(self.multipliers).max(initial=0.0))
        return f"<Periodic motion of {self.period:.6g} s: {self.stability}, largest multiplier {size:.6g} in size>"


def periodic(
    scene: Scene | str | Path | Mapping[str, Any], period: float, advance: Mapping[str, float] | None = None
) -> Orbit:
    """Find a periodic motion near the start of a scene, and its multipliers.

    Place and heading are divided out as `steady` does; where a scene names a place, it has gone on by `advance` after a period.

    Parameters
    ----------
    period : [s] a multiple of the period of every law; of a scene without laws of time a guess
    advance : {coordinate: change in a period [m, rad]}

    Raises SceneError for a period that is none of the scene's laws, StudyError where no periodic motion is found.
    """
    scene = as_scene(scene)
    period = finite("period", period)
    if period <= 0.0:
        raise SceneError(f"period = {period:g}: must be positive [s]")
    timed = any(root.names & {"t"} for root in laws_of(scene)) or bool(scene.data)
    chart = chart_at(make_system(build(scene)))
    shift = _shift(chart, advance or {})
    if timed:
        _refuse_other_period(chart, period)
    flow = _Flow(scene, chart)
    x = chart.numbers(chart.origin)
    basis = _tangent(chart, x)
    for _ in range(ROUNDS):
        lacking = flow.after(x, period) - x - shift
        size = float(np.abs(lacking).max(initial=0.0))
        if size < 1e-11:
            break
        matrix, _ = flow.derivatives(x, period, basis, quick=True)
        columns, along = matrix - basis, chart.rates(x)
        step = _newton(columns, lacking, basis, along, flow.rates_after(x, period) if not timed else None)
        for share in (1.0, 0.5, 0.2, 0.05):
            trial, longer = x + share * basis @ step[: basis.shape[1]], period + share * (0.0 if timed else float(step[-1]))
            try:
                better = np.abs(flow.after(trial, longer) - trial - shift).max(initial=0.0) < size
            except VlmbError:
                continue
            if better:
                x, period = trial, longer
                break
        else:
            break
    size = float(np.abs(flow.after(x, period) - x - shift).max(initial=0.0))
    if not size <= HELD * max(1.0, float(np.abs(x).max(initial=0.0))):
        raise StudyError(f"no periodic motion of about {period:g} s near this start: a period lacks {size:.3g} to come back")
    basis = _tangent(chart, x)
    matrix, error = flow.derivatives(x, period, basis)
    monodromy = np.linalg.lstsq(basis, matrix, rcond=None)[0]
    values = np.linalg.eigvals(monodromy).astype(complex)
    if not timed and np.abs(chart.rates(x)).max(initial=0.0) > HELD:
        values = np.delete(values, int(np.argmin(np.abs(values - 1.0))))
    coordinates, rates = named_at(chart, x)
    order = np.argsort(-np.abs(values), kind="stable")
    return Orbit(period, coordinates, rates, values[order], size, flow.trajectory(x, period), error)


class _Flow:
    """Where a state is after a time."""

    def __init__(self, scene: Scene, chart: Chart) -> None:
        self.chart, self.scene = chart, scene
        followed = {at.name for at in chart.system.prescribed}
        self.names = [name for name in chart.layout.names if name not in followed]

    def trajectory(self, x: Array, period: float, samples: bool = True) -> Trajectory:
        """Run from numbers x."""
        coordinates, rates = named_at(self.chart, x)
        start = {name: coordinates[name] for name in self.names} | {f"{name}{DOT}": rates[f"{name}{DOT}"] for name in self.names}
        scene = tightened(self.scene, period).changed(start=None).changed(start=start)
        task = Task(scene, (), (), (), "")
        return Ensemble(task, None if samples else np.array([0.0, period])).trajectory({})

    def after(self, x: Array, period: float) -> Array:
        """Return the numbers after a period. Raises SimulationError for a run that ends before."""
        found = self.trajectory(x, period, samples=False)
        if found.t[-1] < period:
            raise SimulationError(f"a run ends within the period: {found.message}")
        return self.chart.numbers(np.array(found.states[-1]))

    def derivatives(self, x: Array, period: float, basis: Array, quick: bool = False) -> tuple[Array, float]:
        """Return how the numbers after a period change with those at its start, along a basis (n, m), and the error of that."""
        count = basis.shape[1]
        return jacobian(lambda z: self.after(x + basis @ z, period), np.zeros(count), np.ones(count), quick)

    def rates_after(self, x: Array, period: float) -> Array:
        """Return dx/dt after a period."""
        return self.chart.rates(self.after(x, period))


def _newton(columns: Array, lacking: Array, basis: Array, along: Array, after: Array | None) -> Array:
    """Return a step; with an unknown period a step across the motion, and the change of the period.

    Directions that hardly change what is lacking, such as to a larger swing, are left out while they would lead far away.
    """
    matrix, wanted = columns, -lacking
    if after is not None:
        across = (along @ basis)[None] / max(float(np.linalg.norm(along)), 1e-300)
        matrix = np.block([[columns, after[:, None]], [across, np.zeros((1, 1))]])
        wanted = np.append(wanted, 0.0)
    left, sizes, right = np.linalg.svd(matrix, full_matrices=False)
    parts = (left.T @ wanted) / np.maximum(sizes, 1e-300)
    useful = int((sizes > FLAT * sizes[0]).sum())
    step = np.zeros(matrix.shape[1])
    for k in range(useful, 0, -1):
        step = right[:k].T @ parts[:k]
        if float(np.abs(step).max()) <= LONGEST:
            break
    return step * min(1.0, LONGEST / max(float(np.abs(step).max()), LONGEST))


def _tangent(chart: Chart, x: Array) -> Array:
    """Return the deviations (n, m) that rows allow."""
    basis, names = independent(chart, x)
    picks = [chart.names.index(name) for name in names]
    return basis * chart.scales[picks]


def _shift(chart: Chart, advance: Mapping[str, float]) -> Array:
    names = chart.system.mechanism.names
    found = np.zeros(len(chart.names))
    for name, value in advance.items():
        plain = names.find(name, "advance").name
        if plain in chart.names:
            found[chart.names.index(plain)] = finite(f"advance: {name}", value)
        elif plain not in chart.layout.names:
            raise SceneError(f"advance: {name} is no coordinate of this scene")
        else:
            raise SceneError(f"advance: nothing in this scene depends on {name}: it is divided out, and goes on by what it does")
    return found


def _refuse_other_period(chart: Chart, period: float) -> None:
    """Raise SceneError where laws are not the same a period later."""
    x = chart.numbers(chart.origin) + BESIDE * chart.scales
    for share in (0.11, 0.37, 0.71):
        t, sides = share * period, []
        for at in (t, t + period):
            chart.t = at
            sides.append(chart.rates(x))
        chart.t = 0.0
        if np.abs(sides[0] - sides[1]).max() > REPEATS * max(1.0, float(np.abs(sides[0]).max())) * 1e2:
            raise SceneError(f"period = {period:g} s: the laws of this scene are others a period later")
