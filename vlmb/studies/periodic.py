"""Periodic motions, up to a displacement, and how deviations from them grow in a period."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, SimulationError, StudyError, finite
from vlmb.model.mechanism import build
from vlmb.model.names import DOT
from vlmb.scene.scene import Scene, as_scene
from vlmb.simulation.trajectory import Trajectory
from vlmb.studies.chart import Chart, chart_at
from vlmb.studies.derivatives import jacobian
from vlmb.studies.ensemble import Ensemble, Task
from vlmb.studies.linearize import independent
from vlmb.studies.runs import tightened
from vlmb.studies.shooting import HELD, multipliers_of, shoot, stability_of
from vlmb.studies.steady import named_at
from vlmb.system.pace import laws_of
from vlmb.system.system import make_system

Array = NDArray[np.float64]

REPEATS = 1e-9  # of the largest rate: by how much those a period later may differ
NEAR = 0.5  # of the farthest that a motion has been from its start: nearer it has come back
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
    uncertainty: Array  # (m,) of the multipliers

    @property
    def stability(self) -> str:
        """"asymptotically stable", "neutral" or "unstable", to first order."""
        return stability_of(self.multipliers)

    def __repr__(self) -> str:
        size = float(np.abs(self.multipliers).max(initial=0.0))
        return f"<Periodic motion of {self.period:.6g} s: {self.stability}, largest multiplier {size:.6g} in size>"


def periodic(
    scene: Scene | str | Path | Mapping[str, Any], period: float | None = None, advance: Mapping[str, float] | None = None
) -> Orbit:
    """Find a periodic motion near the start of a scene, and its multipliers.

    Place and heading are divided out as `steady` does; where a scene names a place, it has gone on by `advance` after a period.

    Parameters
    ----------
    period : [s] a multiple of the period of every law; of a scene without laws of time a guess, by default the time after which
        its run first comes near its start again
    advance : {coordinate: change in a period [m, rad]}

    Raises SceneError for a period that is none of the scene's laws, or that they leave to be told, StudyError where no periodic
    motion is found.
    """
    scene = as_scene(scene)
    timed = any(root.names & {"t"} for root in laws_of(scene)) or bool(scene.data)
    if period is None and timed:
        raise SceneError("period: the laws of this scene depend on time: give a multiple of the period of each [s]")
    if period is not None and finite("period", period) <= 0.0:
        raise SceneError(f"period = {period:g}: must be positive [s]")
    chart = chart_at(make_system(build(scene)))
    shift = _shift(chart, advance or {})
    flow = _Flow(scene, chart, shift, timed)
    if period is None:
        period = _first_return(flow)
    elif timed:
        _refuse_other_period(chart, period)
    (x, period), size = shoot(flow, (chart.numbers(chart.origin), period))
    if not size <= HELD * max(1.0, float(np.abs(x).max(initial=0.0))):
        raise StudyError(f"no periodic motion of about {period:g} s near this start: a period lacks {size:.3g} to come back")
    basis = _tangent(chart, x)
    matrix, error = flow.derivatives(x, period, basis)
    monodromy = np.linalg.lstsq(basis, matrix, rcond=None)[0]
    values, uncertainty = multipliers_of(np.array(monodromy, float), error)
    if not timed and np.abs(chart.rates(x)).max(initial=0.0) > HELD:
        along = int(np.argmin(np.abs(values - 1.0)))
        values, uncertainty = np.delete(values, along), np.delete(uncertainty, along)
    coordinates, rates = named_at(chart, x)
    return Orbit(period, coordinates, rates, values, size, flow.trajectory(x, period), error, uncertainty)


class _Flow:
    """Where a state is after a time. What is sought is u = (numbers at the start, period)."""

    def __init__(self, scene: Scene, chart: Chart, shift: Array, timed: bool) -> None:
        self.chart, self.scene, self.shift, self.timed = chart, scene, shift, timed
        self.basis = _tangent(chart, chart.numbers(chart.origin))
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

    def lacking(self, u: tuple[Array, float]) -> Array:
        """Return what a period lacks to come back."""
        x, period = u
        return self.after(x, period) - x - self.shift

    def linear(self, u: tuple[Array, float]) -> Array:
        """Return the derivatives of that along the basis; with an unknown period by it as well, for a step across the motion."""
        x, period = u
        columns = self.derivatives(x, period, self.basis, quick=True)[0] - self.basis
        if self.timed:
            return columns
        along = self.chart.rates(x)
        across = (along @ self.basis)[None] / max(float(np.linalg.norm(along)), 1e-300)
        return np.block([[columns, self.chart.rates(self.after(x, period))[:, None]], [across, np.zeros((1, 1))]])

    def moved(self, u: tuple[Array, float], step: Array) -> tuple[Array, float]:
        """Return u a step on."""
        return u[0] + self.basis @ step[: self.basis.shape[1]], u[1] + (0.0 if self.timed else float(step[-1]))


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


def _first_return(flow: _Flow) -> float:
    """Return when [s] the scene's run is nearest to its start again, for the first time after it was far from it."""
    chart, x = flow.chart, flow.chart.numbers(flow.chart.origin)
    run = flow.trajectory(x, float(flow.scene.run.duration))
    away = np.array([chart.numbers(state) for state in run.states]) - x
    spans = np.ptp(away, axis=0)  # by which numbers of different kinds are compared
    off = np.linalg.norm((away - flow.shift) / np.where(spans > HELD, spans, np.inf), axis=1)
    far = np.maximum.accumulate(off)
    for k in range(1, len(off) - 1):
        if off[k] <= min(off[k - 1], off[k + 1]) and off[k] < NEAR * far[k]:
            return float(run.t[k])
    why = "rests" if not far[-1] > 0.0 else f"does not come near its start again within {run.t[-1]:g} s"
    raise StudyError(f"period: the run of this scene {why}; give a guess of the period [s], or let [run] duration be longer")


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
