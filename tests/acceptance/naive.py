"""Naive ways to integrate a scene, to show what goes wrong: the paper's angles, and Runge-Kutta through pin.integrate.

Every way returns what it reached and an outcome: `finished` even where the answer is wrong, since it does not know.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.integrate import DOP853

from vlmb.equations.motion import equations_of_motion
from vlmb.errors import VlmbError
from vlmb.model.mechanism import Mechanism, build
from vlmb.scene.scene import Scene
from vlmb.system.start import consistent_start
from vlmb.system.system import make_system

Array = NDArray[np.float64]
FINISHED = "finished"
Rhs = Callable[[float, Array], Array]


def euler(rhs: Rhs, t: float, y: Array, h: float) -> Array:
    """Explicit Euler: y + h f."""
    return y + h * rhs(t, y)


def rk4(rhs: Rhs, t: float, y: Array, h: float) -> Array:
    """Classical Runge-Kutta of order 4."""
    k1 = rhs(t, y).copy()
    k2 = rhs(t + 0.5 * h, y + 0.5 * h * k1).copy()
    k3 = rhs(t + 0.5 * h, y + 0.5 * h * k2).copy()
    return y + (h / 6.0) * (k1 + 2.0 * (k2 + k3) + rhs(t + h, y + h * k3))


SCHEMES = {"euler": euler, "rk4": rk4}


@dataclass(frozen=True)
class Naive:
    """What a naive way reached: tips (samples, links, 3) [m], the base (samples, 2) [m], evaluations, outcome."""

    tips: Array
    base: Array
    evaluations: int
    outcome: str

    def error(self, tips: Array) -> float:
        """Largest distance [m] from a reference over the samples reached; inf where a number is lost."""
        if not len(self.tips):
            return math.inf
        value = float(np.abs(self.tips - tips[: len(self.tips)]).max(initial=0.0))
        return value if math.isfinite(value) else math.inf

    def told(self, error: float) -> str:
        """One sentence for a table."""
        if self.outcome != FINISHED:
            return self.outcome
        return f"{FINISHED} without a word, error {error:.1e}" if math.isfinite(error) else "NaN"


class _Stopped(Exception):
    """A naive way cannot go on."""


def paper_chart(
    scene: Scene, times: Sequence[float], form: str = "full", method: str = "dop853", step: float = 1e-3, most: int = 4000
) -> Naive:
    """Integrate the paper's equations in its angles: numpy.linalg.solve at every instant, springs alone as forces.

    A ski needs form "chaplygin", with y' = x' tan(phi0), or "speed". `most` evaluations, then it gives up.
    """
    mechanism = build(scene)
    names, start = mechanism.layout.names, consistent_start(make_system(mechanism))
    first = equations_of_motion(mechanism, start.coordinates, start.rates, form)
    springs = _springs(mechanism)
    count, calls = len(names), 0

    def rhs(t: float, y: Array) -> Array:
        nonlocal calls
        calls += 1
        if calls > most:
            raise _Stopped(f"stuck: gave up at t = {t:.4g} s after {most} evaluations")
        if not np.isfinite(y).all():
            raise _Stopped(f"NaN at t = {t:.4g} s")
        coordinates = dict(zip(names, y[:count].tolist(), strict=True))
        velocities = dict(zip(first.names, y[count:].tolist(), strict=True))
        rates = {f"{name}_dot": velocities.get(name, 0.0) for name in names}
        if form == "chaplygin":
            rates["y_dot"] = rates["x_dot"] * math.tan(coordinates["phi0"])
        equations = equations_of_motion(mechanism, coordinates, rates, form)
        forces = np.zeros(len(first.names))
        for name, (k, c, rest) in springs.items():
            forces[first.names.index(name)] = -k * (coordinates[name] - rest) - c * rates[f"{name}_dot"]
        try:
            accelerations = np.linalg.solve(equations.mass_matrix, forces - equations.bias)
        except np.linalg.LinAlgError:
            raise _Stopped(f"numpy.linalg.LinAlgError: Singular matrix at t = {t:.4g} s") from None
        return np.concatenate([[rates[f"{name}_dot"] for name in names], accelerations])

    rates = first.rates
    begin = np.array([*start.coordinates.values(), *(rates[f"{name}_dot"] for name in first.names)])
    with np.errstate(all="ignore"):
        states, outcome = _states(rhs, begin, times, method, step)
    tips, base = [], []
    for y in states:
        state = mechanism.state(dict(zip(names, y[:count].tolist(), strict=True)))
        tips.append([mechanism.position(state, link.name) for link in mechanism.layout.links])
        base.append(state.q[:2].copy())
    return Naive(np.array(tips), np.array(base), calls, outcome)


def pin_integrate(scene: Scene, times: Sequence[float], step: float = 1e-3, scheme: str = "rk4", gain: float = 0.0) -> Naive:
    """Integrate (q, v) with q <- pin.integrate(q, h v) in every stage; the knife edge by its multiplier, unstabilized."""
    mechanism = build(scene)
    start = consistent_start(make_system(mechanism)).state
    ski = mechanism.layout.base == "ski"
    workspace = make_system(mechanism, knife_edge="multiplier" if ski else "reduction", gain=gain).workspace()
    model, nq, nv = mechanism.model, mechanism.layout.nq, mechanism.layout.nv
    work = np.zeros(workspace.size - nq - nv)

    def acceleration(t: float, q: Array, v: Array) -> Array:
        return np.array(workspace.rhs(t, np.concatenate([q, v, work]))[nq : nq + nv])

    q, v, t = np.array(start.q), np.array(start.v), 0.0
    tips, base, outcome = [], [], FINISHED
    try:
        with np.errstate(all="ignore"):
            for time in times:
                while t < time - 1e-9:
                    h = min(step, time - t)
                    a1 = acceleration(t, q, v)
                    if scheme == "euler":
                        q, v = pin.integrate(model, q, h * v), v + h * a1
                    else:
                        v2 = v + 0.5 * h * a1
                        a2 = acceleration(t + 0.5 * h, pin.integrate(model, q, 0.5 * h * v), v2)
                        v3 = v + 0.5 * h * a2
                        a3 = acceleration(t + 0.5 * h, pin.integrate(model, q, 0.5 * h * v2), v3)
                        v4 = v + h * a3
                        a4 = acceleration(t + h, pin.integrate(model, q, h * v3), v4)
                        q = pin.integrate(model, q, h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4))
                        v = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
                    t += h
                tips.append([mechanism.position((q, v), link.name) for link in mechanism.layout.links])
                base.append(q[:2].copy())
    except VlmbError:
        outcome = f"NaN at t = {t:.4g} s"
    return Naive(np.array(tips), np.array(base), workspace.evaluations, outcome)


def _states(
    rhs: Callable[[float, Array], Array], y: Array, times: Sequence[float], method: str, step: float
) -> tuple[list[Array], str]:
    """States at each time, as far as it goes, and the outcome."""
    found, t = [y] if times[0] == 0.0 else [], 0.0
    try:
        for time in times:
            if time == 0.0:
                continue
            if method in SCHEMES:
                count = max(1, round((time - t) / step))
                for k in range(count):
                    y = SCHEMES[method](rhs, t + k * (time - t) / count, y, (time - t) / count)
            else:
                solver = DOP853(rhs, t, y, time, rtol=1e-9, atol=1e-11)
                while solver.status == "running":
                    solver.step()
                if solver.status == "failed":
                    raise _Stopped(f"stuck: steps too small at t = {solver.t:.4g} s")
                y = solver.y
            if not np.isfinite(y).all():
                raise _Stopped(f"NaN at t = {time:.4g} s")
            t = time
            found.append(y)
    except _Stopped as stopped:
        return found, str(stopped)
    return found, FINISHED


def _springs(mechanism: Mechanism) -> dict[str, tuple[float, float, float]]:
    """Stiffness, damping and rest of every free segment, by coordinate."""
    found = {}
    for coordinate in mechanism.layout.coordinates:
        if coordinate.kind == "xi":
            segment = mechanism.scene.links[coordinate.link].segment(coordinate.segment)
            rest = segment.length if segment.rest is None else segment.rest
            found[coordinate.name] = (segment.stiffness, segment.damping, float(rest or 0.0))
    return found
