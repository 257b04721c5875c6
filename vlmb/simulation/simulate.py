"""One run: from a scene to a trajectory. What was computed is returned, whatever stops it."""

from __future__ import annotations

import contextlib
import dataclasses
import inspect
import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import msgspec
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.errors import SceneError, VlmbError
from vlmb.model.building import build
from vlmb.model.mechanism import Mechanism
from vlmb.model.memory import fits
from vlmb.scene.scene import Scene
from vlmb.scene.tables import Run
from vlmb.simulation.breaks import breaks_of
from vlmb.simulation.end import End, begun_at, jumps
from vlmb.simulation.loop import Loop
from vlmb.simulation.motion import Motion
from vlmb.simulation.phased_run import PhasedRun
from vlmb.simulation.phases import Event
from vlmb.simulation.samples import samples_of
from vlmb.simulation.trajectory import Trajectory
from vlmb.simulation.until import read_until
from vlmb.system import interrupts
from vlmb.system.beginning import beginning, start_in_phase
from vlmb.system.core_engine import NO_BOUNDS, CoreEngine
from vlmb.system.engines import make_engine
from vlmb.system.forces import Control, StateView, answer_of
from vlmb.system.massless import require_held
from vlmb.system.pace import longest_steps, require_data, watched
from vlmb.system.pinocchio_engine import PinocchioEngine
from vlmb.system.start import Start
from vlmb.system.system import System, known_mechanism, make_system

if TYPE_CHECKING:
    from vlmb.model.robot_mechanism import RobotMechanism

Array = NDArray[np.float64]
LOG = logging.getLogger("vlmb")
LOG.addHandler(logging.NullHandler())  # silent unless a program asks for it

MIN_SAMPLES, MAX_SAMPLES = 200, 10_000_000
AT_REST, UNSTABLE = 1e-9, 1e-6  # [m/s^2, rad/s^2] accelerations of a balanced start; [1/s^2] growth that counts
NUDGE = 1e-6  # [m, rad] by which a balanced start is tried


def simulate(
    scene: Scene | Mechanism | RobotMechanism | str | Path | Mapping[str, Any],
    duration: float | None = None,
    method: str | None = None,
    rtol: float | None = None,
    knife_edge: str | None = None,
    t_eval: Sequence[float] | Array | None = None,
    control: Control | None = None,
    *,
    start: End | Mapping[str, float] | None = None,
    t0: float = 0.0,
    atol: float | None = None,
    step: float | None = None,
    gain: float | None = None,
    engine: str | None = None,
    max_step: float | None = None,
    progress: Callable[[float], None] | None = None,
    watch: Callable[[Array, Array, Array], None] | None = None,
    until: str | None = None,
) -> Trajectory:
    """Simulate a scene. Arguments override its `[run]`; None means what the scene says.

    Parameters
    ----------
    scene : a Scene, the path of a scene file, a dict with its keys, or a mechanism built from one
    duration : [s] length of the run
    method : integration method: dop853, adams, radau, bdf, gauss, rk4, euler
    rtol : relative tolerance of adaptive methods
    atol : absolute tolerance of adaptive methods
    knife_edge : how the knife edge is enforced: reduction, multiplier or projection
    t_eval : (N,) [s] times of the samples, ascending in [t0, t0 + duration]; default: evenly spaced
    control : called as control(t, view) -> {force name: value}; `view` gives coordinates, rates and points by name, read-only.
        The names are those of the first call. It is called once for every sample, and this value is recorded; after
        the run it is not called again. An exception it raises reaches the caller, with the run so far as its `trajectory`
    start : where to begin: `trajectory.end` of another run, or a dict of coordinates and rates that override the scene's [start]
    t0 : [s] time of the start; t, laws and samples count from it
    step : [s] step of fixed-step methods
    gain : [1/s] how fast errors of ideal constraints, and of the knife edge as a multiplier, are corrected
    engine : `auto`, `core` (compiled) or `pinocchio`
    max_step : [s] longest step of adaptive methods. Without it, laws bound the steps by how fast they vary; a control, which
        cannot be examined beforehand, is called at least every 1 / run.samples
    until : what ends the run before its duration: "touch left", "open left", "slip left" or "stick left" of a contact, the name
        of one of the scene's events, or an expression that falls through 0, such as "z_dot" at an apex
    progress : called with the time reached, sample by sample; its exceptions reach the caller like the control's
    watch : called during the run with the samples since its last call: t (N,), Pinocchio's q (N, nq) and v (N, nv)

    Returns a Trajectory, also for a run that stops early: its `message` says why.
    Raises SceneError (a VlmbError) for what is wrong before the run.
    """
    if control is not None and not (callable(control) and _takes_two(control)):
        raise SceneError(f"control = {control!r:.80}: must be a function of (t, view) that returns forces by name")
    if progress is not None and not callable(progress):
        raise SceneError(f"progress = {progress!r:.80}: must be a function that is called with the time reached [s]")
    if watch is not None and not callable(watch):
        raise SceneError(f"watch = {watch!r:.80}: must be a function that is called with samples (t, q, v)")
    mechanism = scene if isinstance(scene, Mechanism) else known_mechanism(scene) or build(scene)
    run = run_options(
        mechanism.scene, duration=duration, method=method, rtol=rtol, atol=atol, knife_edge=knife_edge, step=step, gain=gain,
        engine=engine, max_step=max_step,
    )  # fmt: skip
    times = sample_times(run, t_eval, t0)
    with interrupts.held():
        if not isinstance(mechanism, Mechanism):
            from vlmb.simulation.robot_run import simulate_robots

            asked, named, expression = read_until(mechanism, until)
            return simulate_robots(mechanism, run, times, control, start, t0, progress, asked, expression, named)
        return _simulated(mechanism, run, times, control, start, t0, progress, watch, until)


def start_of(system: System, t0: float = 0.0) -> Start:
    """Make a consistent start; what has no mass is held there.

    Without equations and contacts it goes by [start] alone: runs whose springs differ have the same.
    """
    given, alone = system.mechanism.scene.start, system.constraints is None and not system.points
    known = system.starts.get(t0) if alone else None
    if known is not None and known[0] == given:
        return cast(Start, known[1])
    start = start_in_phase(system, t0)
    held = require_held(system, start, t0)
    if held:
        start = start._replace(adjustments=(*start.adjustments, held))
    if alone:
        system.starts.clear()
        system.starts[t0] = given, start
    return start


def _takes_two(function: Callable[..., Any]) -> bool:
    """Whether a function can be called with two values; one that does not tell is given the benefit of the doubt."""
    try:
        inspect.signature(function).bind(0.0, None)
    except TypeError:
        return False
    except ValueError:
        return True
    return True


def _simulated(
    mechanism: Mechanism, run: Run, times: Array, control: Control | None, start: End | Mapping[str, float] | None, t0: float,
    progress: Callable[[float], None] | None, watch: Callable[[Array, Array, Array], None] | None, until: str | None,
) -> Trajectory:  # fmt: skip
    """Simulate with checked options."""
    if start is not None:
        mechanism = begun_at(mechanism, start)
    require_data(mechanism.scene, t0, float(times[-1]))
    asked, named, expression = read_until(mechanism, until)
    system = make_system(mechanism, run)
    if expression is not None or named:
        system = dataclasses.replace(system, until=expression, ends_at=named)
    return run_system(system, times, control, start, t0, progress, watch, asked)


def run_system(
    system: System, times: Array, control: Control | None = None, start: End | Mapping[str, float] | None = None, t0: float = 0.0,
    progress: Callable[[float], None] | None = None, watch: Callable[[Array, Array, Array], None] | None = None, asked: str = "",
) -> Trajectory:  # fmt: skip
    """Simulate a system from its scene's start; `start` is what that was made from. The rest is as in `simulate`."""
    mechanism, run = system.mechanism, system.run
    begin = start_of(system, t0)
    interrupts.answer()
    if control is not None:
        first = StateView(mechanism, t0, mechanism.postures(begin.state), begin.branch, begin.state)
        system = system.with_inputs(tuple(answer_of(control, first)))
    breaks = breaks_of(beginning(system, t0), t0, t0 + run.duration)
    with np.errstate(all="ignore"):  # what is not finite is found and named
        mover = make_engine(system, begin.branch, control)
        y = mover.pack(begin.state)
        said = jumps(start, begin) if isinstance(start, End) else []
        said += _balanced(system, mover, y, begin)
        begin = begin._replace(adjustments=(*begin.adjustments, *said)) if said else begin
        end = t0 + run.duration
        bounds = longest_steps(mechanism.scene, t0, end) if system.timed else NO_BOUNDS
        bounds = watched(bounds, mechanism.scene, t0, end, system.until is not None)
        began, used = time.perf_counter(), time.thread_time()

        def hand(t: Array, states: Array, phase: float = 0.0) -> None:
            assert watch is not None
            watch(t, *Motion(system, mover.name, t, mover.stored(t, states), np.array(begin.branch), phase).pinocchio)

        longest = math.inf if control is None else 1.0 / run.samples
        loop: Loop | PhasedRun
        if system.points:
            goes = (begin.branch, control, progress, longest, asked)
            loop = PhasedRun(system, run, y, times, breaks, t0, bounds, *goes, hand if watch else None)
        else:
            loop = Loop(mover, run, y, times, breaks, t0, bounds, progress, longest, hand if watch else None)
        interrupts.answer()
        LOG.info("%s: begins: %s, engine %s, %g s from t = %g s", mechanism.scene.name, run.method, mover.name, run.duration, t0)
        for sentence in begin.adjustments:
            LOG.info("%s: %s", mechanism.scene.name, sentence)

        def trajectory(status: str, message: str) -> Trajectory:
            stats = {
                "wall_time": time.perf_counter() - began,
                "cpu_time": time.thread_time() - used,
                "rhs_evaluations": loop.evaluations,
                "steps": loop.steps,
                "engine": mover.name,
            }
            return _kept(lambda: _trajectory(system, mover, loop, begin, t0, status, message, stats))

        try:
            status, message = loop.run()
        except BaseException as error:
            with contextlib.suppress(AttributeError):  # a type without room for it
                error.trajectory = trajectory("failed", loop.failed_by(error))  # type: ignore[attr-defined]
            raise
        return _logged(trajectory(status, message))


def _logged(trajectory: Trajectory) -> Trajectory:
    """Tell the log how a run ended, and what is doubtful of it."""
    name, steps = trajectory.scene.name, trajectory.stats["steps"]
    level = logging.WARNING if trajectory.status == "failed" else logging.INFO
    LOG.log(level, "%s: %s (%d steps)", name, trajectory.message, steps)
    for doubt in trajectory.doubts if _is_heard(logging.WARNING) else ():
        LOG.warning("%s: doubtful: %s", name, doubt)
    return trajectory


def _is_heard(level: int) -> bool:
    """Whether anything takes what the log is told: doubts are looked for then."""
    logger: logging.Logger | None = LOG
    while logger is not None:
        if any(not isinstance(handler, logging.NullHandler) for handler in logger.handlers):
            return LOG.isEnabledFor(level)
        logger = logger.parent if logger.propagate else None
    return False


def _trajectory(
    system: System, mover: CoreEngine | PinocchioEngine, loop: Loop | PhasedRun, start: Start, t0: float, status: str,
    message: str, stats: dict[str, Any],
) -> Trajectory:  # fmt: skip
    if isinstance(loop, Loop):
        events, taken = tuple(Event(*happened) for happened in loop.happened), samples_of(mover, loop.recorded)
        return Trajectory.from_run(
            system, mover, taken, start, t0, status, message, stats, events=events, turns=tuple(loop.turns)
        )
    return Trajectory.from_run(
        system, mover, loop.samples, start, t0, status, message, stats, tuple(loop.stretches), tuple(loop.events),
        tuple(loop.turns),
    )  # fmt: skip


def _kept(make: Callable[[], Trajectory]) -> Trajectory:
    """Make the trajectory of a run that is over; a Ctrl-C meanwhile, which is too late to stop it, loses nothing."""
    try:
        return make()
    except KeyboardInterrupt:
        return make()


def run_options(scene: Scene, **changes: Any) -> Run:
    """Return the scene's `[run]` with arguments put over it (None: as in the scene), checked like a scene file's."""
    given = {key: value for key, value in changes.items() if value is not None}
    if not given:
        return scene.run
    if all(type(value) in (int, float, str) for value in given.values()):
        with contextlib.suppress(msgspec.ValidationError):  # a tenth of the time of a whole scene; that says what is wrong
            checked = msgspec.convert(given, Run)
            return msgspec.structs.replace(scene.run, **{key: getattr(checked, key) for key in given})
    data = scene.to_dict()
    return Scene.from_dict({**data, "run": {**data.get("run", {}), **given}}, "arguments").run


def _balanced(system: System, engine: CoreEngine | PinocchioEngine, y: Array, start: Start) -> list[str]:
    """Say where a start rests in an unstable equilibrium: no answer there is better than rounding."""
    acting = system.forces.needed or system.prescribed or system.constraints is not None or system.knife_edge == "multiplier"
    if any(start.rates.values()) or acting or system.mechanism.scene.base.friction:
        return []
    try:
        if np.abs(engine.evaluate(0.0, y)).max() > AT_REST or not fits(system.mechanism.model.nv):
            return []
        growth = _growth(system, start)
    except VlmbError:
        return []  # the run says it
    if not growth > UNSTABLE:
        return []
    return [
        f"start: at rest in an unstable equilibrium: errors grow as exp({math.sqrt(growth):.3g} t): rounding decides when "
        "and where it leaves; give a start value a nudge"
    ]


def _growth(system: System, start: Start) -> float:
    """Return the largest growth [1/s^2] of small deviations from rest, by differences of Pinocchio's accelerations."""
    workspace, model, layout = system.workspace(), system.mechanism.model, system.mechanism.layout
    y = workspace.pack(start.state)

    def accelerations(q: Array) -> Array:
        rates = workspace.rhs(0.0, np.concatenate([q, y[layout.nq :]]))
        return np.array(rates[layout.nq : layout.nq + layout.nv])

    nudges = NUDGE * np.eye(layout.nv)
    apart = [accelerations(pin.integrate(model, start.state.q, sign * d)) for d in nudges for sign in (1.0, -1.0)]
    return float(np.linalg.eigvals((np.array(apart[::2]) - np.array(apart[1::2])).T / (2.0 * NUDGE)).real.max())


def sample_times(run: Run, t_eval: Sequence[float] | Array | None = None, t0: float = 0.0) -> Array:
    """Return the times (N,) [s] of the samples of a run."""
    if isinstance(t0, bool) or not isinstance(t0, (int, float)) or not math.isfinite(t0):
        raise SceneError(f"t0 = {t0!r:.80}: must be the time of the start, a finite number [s]")
    if t0 + run.duration / run.samples / MIN_SAMPLES == t0:
        raise SceneError(f"t0 = {t0:g} s: times of a run of {run.duration:g} s cannot be told apart there; begin nearer to 0")
    if run.duration * run.samples > MAX_SAMPLES:
        many = f"run.duration = {run.duration:g} s at run.samples = {run.samples:g} per second"
        raise SceneError(f"{many}: at most {MAX_SAMPLES} samples")
    if t_eval is None:
        return _evenly(float(t0), run.duration, max(MIN_SAMPLES, math.ceil(run.duration * run.samples))).copy()
    try:
        times = np.array(t_eval, dtype=float)
    except (TypeError, ValueError):
        raise SceneError(f"t_eval = {t_eval!r}: must be a list of times [s]") from None
    if times.ndim != 1 or not len(times) or not np.isfinite(times).all():
        raise SceneError("t_eval: must be a non-empty list of finite times [s]")
    if (np.diff(times) <= 0.0).any() or times[0] < t0 or times[-1] > t0 + run.duration + 1e-12 * (abs(t0) + run.duration):
        raise SceneError(f"t_eval: times must ascend within [{t0:g}, {t0 + run.duration:g}] s")
    return times


@lru_cache(maxsize=1)
def _evenly(t0: float, duration: float, count: int) -> Array:
    """Return `count` steps from t0 on, to be copied: runs of an ensemble have the same."""
    end = t0 + duration
    times = t0 + np.arange(count + 1, dtype=float) * ((end - t0) / count)
    times[-1] = end
    return times
