"""One run: from a scene to a trajectory. What was computed is returned, whatever stops it."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.errors import SceneError, VlmbError
from vlmb.model.mechanism import Mechanism, build
from vlmb.model.names import counted
from vlmb.scene.laws import law_breaks, law_jump
from vlmb.scene.scene import Scene, as_scene
from vlmb.scene.tables import Run
from vlmb.simulation.march import March
from vlmb.simulation.trajectory import Trajectory
from vlmb.system.dynamics import Dynamics
from vlmb.system.forces import Control
from vlmb.system.prescribed import prescribed_segments
from vlmb.system.start import Start, consistent_start

Array = NDArray[np.float64]

MIN_SAMPLES, MAX_SAMPLES = 200, 10_000_000
SINGULAR = 1e14  # condition of the scaled mass matrix at which a start is refused
AT_REST, UNSTABLE = 1e-9, 1e-6  # [m/s^2, rad/s^2] accelerations of a balanced start; [1/s^2] growth that counts
NUDGE = 1e-6  # [m, rad] by which a balanced start is tried


def simulate(
    scene: Scene | Mechanism | str | Path | Mapping[str, Any],
    duration: float | None = None,
    method: str | None = None,
    rtol: float | None = None,
    knife_edge: str | None = None,
    t_eval: Sequence[float] | Array | None = None,
    control: Control | None = None,
    *,
    atol: float | None = None,
    step: float | None = None,
    gain: float | None = None,
    engine: str | None = None,
    max_step: float | None = None,
    route: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Simulate a scene; arguments override its `[run]`, None means what the scene says.

    Parameters
    ----------
    scene : a Scene, the path of a scene file, a dict with its keys, or a mechanism built from one
    t_eval : (N,) [s], ascending in [0, duration]; default: evenly spaced
    control : called as control(t, view) -> {force name: value}; `view` gives coordinates, rates and points by name. Names are
        those of the first call; an exception it raises goes through
    step : [s] of fixed-step methods
    gain : [1/s] Baumgarte gain of the knife edge as a multiplier
    engine : `auto`, `core` (compiled) or `pinocchio`
    max_step : [s] longest step of adaptive methods
    progress : called with the time reached, sample by sample

    Returns a Trajectory, also for a run that stops early: its `message` says why.
    Raises SceneError (a VlmbError) for what is wrong before the run.
    """
    if control is not None and not callable(control):
        raise SceneError(f"control = {control!r:.80}: must be a function of (t, view) that returns forces by name")
    if progress is not None and not callable(progress):
        raise SceneError(f"progress = {progress!r:.80}: must be a function that is called with the time reached [s]")
    mechanism = scene if isinstance(scene, Mechanism) else build(scene)
    run = run_options(
        mechanism.scene, duration=duration, method=method, rtol=rtol, atol=atol, knife_edge=knife_edge, step=step, gain=gain,
        engine=engine, max_step=max_step,
    )  # fmt: skip
    start = consistent_start(mechanism)
    reference = np.array([start.coordinates[name] for name in mechanism.layout.names])
    dynamics = Dynamics(mechanism, run.knife_edge, run.gain, control, start.state, route, run)
    dynamics.reference = reference.tolist()
    times = _sample_times(run, t_eval)
    breaks = _breaks(dynamics, run.duration)
    start = start._replace(repairs=(*start.repairs, *_balanced(dynamics, start)))
    began, used = time.perf_counter(), time.thread_time()
    with np.errstate(all="ignore"), warnings.catch_warnings():  # what is not finite is found and named; drivers raise
        warnings.simplefilter("ignore")
        march = March(dynamics, run, dynamics.pack(start.state), times, breaks, progress)
        status, message = march.run()
    stats = {
        "wall_time": time.perf_counter() - began,
        "cpu_time": time.thread_time() - used,
        "rhs_evaluations": dynamics.evaluations,
        "steps": march.steps,
        "route": dynamics.route,
    }
    return Trajectory.from_run(dynamics, run, start, march.recorded, status, message, stats)


def run_options(scene: Scene, **changes: Any) -> Run:
    """Return the scene's `[run]` with arguments put over it (None: as in the scene), checked like a scene file's."""
    given = {key: value for key, value in changes.items() if value is not None}
    data = scene.to_dict()
    return Scene.from_dict({**data, "run": {**data.get("run", {}), **given}}, "arguments").run


class Checked(NamedTuple):
    """What is known before a run: `mechanism, start = check(scene)`. Printed it is what `vlmb check` says."""

    mechanism: Mechanism
    start: Start

    @property
    def scene(self) -> Scene:
        """The scene that was checked."""
        return self.mechanism.scene

    @property
    def degrees_of_freedom(self) -> int:
        """Independent velocities at the start: coordinates less prescribed ones, the knife edge and ideal constraints."""
        layout = self.mechanism.layout
        prescribed = sum(at.motion == "prescribed" and at.joint > 0 for e in layout.links for at in (e.lower, e.upper))
        return len(layout.names) - prescribed - (layout.base == "ski") - self.start.rank

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings, what was repaired at the start, and how a programme is stable and controllable."""
        return (*self.mechanism.warnings, *self.start.repairs)

    @property
    def report(self) -> str:
        """Coordinates and degrees of freedom in a line, then a line for each note."""
        coordinates, free = len(self.mechanism.layout.names), self.degrees_of_freedom
        counts = f"fine. {counted(coordinates, 'coordinate')}, {counted(free, 'degree')} of freedom"
        return "\n".join([counts, *(f"  {note}" for note in self.notes)])

    def __repr__(self) -> str:
        return f"{self.scene.name}: {self.report}"


def check(scene: Scene | str | Path | Mapping[str, Any]) -> Checked:
    """Do everything that comes before a run; raise what a run would.

    Takes a Scene, the path of a scene file or a dict with its keys. Returns the mechanism and its consistent start, with
    `degrees_of_freedom` and `notes`; one of these tells how a programme is stable and controllable.
    """
    scene = as_scene(scene)
    mechanism = build(scene)
    start = consistent_start(mechanism)
    dynamics = Dynamics(mechanism, scene.run.knife_edge, scene.run.gain)
    _breaks(dynamics, scene.run.duration)
    dynamics.rhs(0.0, dynamics.pack(start.state))
    if dynamics.faults.conditioning(start.state.q)[0] > SINGULAR:
        raise dynamics.faults.singular(start.state.q)
    programme = dynamics.system.programme
    if programme is None:
        return Checked(mechanism, start)
    rank, condition = programme.rank(programme.effect)
    controllable = f"G has rank {rank} for {len(programme.texts)} rows, condition {condition:.4g} at the start"
    return Checked(mechanism, start._replace(repairs=(*start.repairs, f"programme: {programme.report}; {controllable}")))


def _balanced(dynamics: Dynamics, start: Start) -> list[str]:
    """Say where a start rests in an unstable equilibrium: no answer there is better than rounding."""
    actuation, model, nq, nv = dynamics.actuation, dynamics.mechanism.model, dynamics.nq, dynamics.nv
    if any(start.rates.values()) or actuation.channels or actuation.control or dynamics.prescribed or dynamics.system.needed:
        return []
    y = dynamics.pack(start.state)

    def accelerations(q: Array) -> Array:
        return np.array(dynamics.rhs(0.0, np.concatenate([q, y[nq:]]))[nq : nq + nv])

    try:
        if np.abs(accelerations(start.state.q)).max() > AT_REST:
            return []
        nudges = NUDGE * np.eye(nv)
        apart = [accelerations(pin.integrate(model, start.state.q, sign * d)) for d in nudges for sign in (1.0, -1.0)]
    except VlmbError:
        return []  # the run says it
    finally:
        dynamics.forget()
    growth = np.linalg.eigvals((np.array(apart[::2]) - np.array(apart[1::2])).T / (2.0 * NUDGE)).real.max()
    if not growth > UNSTABLE:
        return []
    return [
        f"start: at rest in an unstable equilibrium: errors grow as exp({math.sqrt(growth):.3g} t): rounding decides when "
        "and where it leaves; give a start value a nudge"
    ]


def _sample_times(run: Run, t_eval: Sequence[float] | Array | None) -> Array:
    if run.duration * run.samples > MAX_SAMPLES:
        many = f"run.duration = {run.duration:g} s at run.samples = {run.samples:g} per second"
        raise SceneError(f"{many}: at most {MAX_SAMPLES} samples")
    if t_eval is None:
        return np.linspace(0.0, run.duration, max(MIN_SAMPLES, int(np.ceil(run.duration * run.samples))) + 1)
    try:
        times = np.array(t_eval, dtype=float)
    except (TypeError, ValueError):
        raise SceneError(f"t_eval = {t_eval!r}: must be a list of times [s]") from None
    if times.ndim != 1 or not len(times) or not np.isfinite(times).all():
        raise SceneError("t_eval: must be a non-empty list of finite times [s]")
    if (np.diff(times) <= 0.0).any() or times[0] < 0.0 or times[-1] > run.duration * (1 + 1e-12):
        raise SceneError(f"t_eval: times must ascend within [0, {run.duration:g}] s")
    return times


def _breaks(dynamics: Dynamics, duration: float) -> tuple[float, ...]:
    """Times at which a law is not smooth; SceneError where a prescribed length jumps, or leaves its limits."""
    mechanism = dynamics.mechanism
    breaks: set[float] = set()
    for law in dynamics.actuation.laws:
        breaks |= set(law_breaks(law, 0.0, duration))
    coordinates = {c.name: c for c in mechanism.layout.coordinates}
    for at in prescribed_segments(mechanism):
        for t in law_breaks(at.law, 0.0, duration):
            value, rate = law_jump(at.law, t)
            if abs(value) > 1e-7 or abs(rate) > 1e-4:
                raise SceneError(
                    f"{at.name}: the law {at.law.text!r} is not smooth enough at t = {t:.6g} s (length jumps by {value:.3g} m, "
                    f"its rate by {rate:.3g} m/s): a prescribed length needs a continuous rate"
                )
            breaks.add(t)
        low, high = mechanism.segment(coordinates[at.name]).bounds
        for t in np.linspace(0.0, duration, 1001).tolist():
            length = at.law.value(t)
            if not low <= length <= high:
                raise SceneError(
                    f"{at.name}: the law {at.law.text!r} gives {length:.6g} m at t = {t:.6g} s, outside [{low:g}, {high:g}]"
                )
    return tuple(sorted(breaks))
