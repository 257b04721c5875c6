"""A run of a scene with robots, and what is known before one."""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError
from vlmb.model.layout import State
from vlmb.model.robot_mechanism import RobotMechanism
from vlmb.scene.expressions import Expression
from vlmb.scene.scene import Scene
from vlmb.scene.tables import Run
from vlmb.simulation.end import End
from vlmb.simulation.loop import Loop
from vlmb.simulation.robot_phases import RobotPhases, with_engine
from vlmb.simulation.robot_trajectory import RobotTrajectory
from vlmb.system import interrupts
from vlmb.system.beginning import touching
from vlmb.system.contacts import HELD, SLIDING, Footing
from vlmb.system.pace import longest_steps, require_data, watched
from vlmb.system.robot_engine import RobotEngine, RobotView, asked
from vlmb.system.robot_start import robot_start
from vlmb.system.robot_system import RobotSystem, make_robot_system
from vlmb.system.robot_workspace import RobotWorkspace
from vlmb.system.start import Start

Array = NDArray[np.float64]


def simulate_robots(
    mechanism: RobotMechanism, run: Run, times: Array, control: Callable[..., Any] | None,
    start: End | Mapping[str, float] | None, t0: float, progress: Callable[[float], None] | None, until: str = "",
    expression: Expression | None = None, ends_at: str = "",
) -> RobotTrajectory:  # fmt: skip
    """Simulate with checked options; see `vlmb.simulate`."""
    if start is not None:
        mechanism = begun_at(mechanism, start)
    require_data(mechanism.scene, t0, float(times[-1]))
    system = make_robot_system(mechanism, run, until=expression, ends_at=ends_at)
    begin = robot_start(system, t0)
    interrupts.answer()
    if control is not None:
        view = RobotView(system, RobotWorkspace(system), t0, State(*map(np.array, begin.state)))
        system = system.with_inputs(tuple(asked(control, view)))
    breaks = system.breaks(t0, t0 + run.duration)
    with np.errstate(all="ignore"):  # what is not finite is found and named
        asked_for = control if system.inputs else None
        system = with_engine(system, begin.state)
        engine = RobotEngine(system, begin.state, asked_for)
        y = engine.pack(begin.state)
        end = t0 + run.duration
        bounds = watched(longest_steps(mechanism.scene, t0, end), mechanism.scene, t0, end, expression is not None)
        began, used = time.perf_counter(), time.thread_time()
        longest = np.inf if control is None else 1.0 / run.samples
        loop: Loop | RobotPhases
        if system.points:
            loop = RobotPhases(system, run, y, times, breaks, t0, bounds, asked_for, progress, longest, until)
        else:
            loop = Loop(engine, run, y, times, breaks, t0, bounds, progress, longest)

        def trajectory(status: str, message: str) -> RobotTrajectory:
            stats = {
                "wall_time": time.perf_counter() - began, "cpu_time": time.thread_time() - used,
                "rhs_evaluations": loop.evaluations, "steps": loop.steps, "engine": engine.name,
            }  # fmt: skip
            return RobotTrajectory.of_run(system, engine, loop, begin, t0, status, message, stats)

        try:
            status, message = loop.run()
        except BaseException as error:
            with contextlib.suppress(AttributeError):
                error.trajectory = trajectory("failed", loop.failed_by(error))  # type: ignore[attr-defined]
            raise
        return trajectory(status, message)


def begun_at(mechanism: RobotMechanism, start: End | Mapping[str, float]) -> RobotMechanism:
    """Return a mechanism whose scene has another start: the end of a run as a whole, a dict laid over its own."""
    scene, names = mechanism.scene, mechanism.names
    data = scene.to_dict()
    if isinstance(start, End):
        if tuple(names.index) != start.names:
            raise SceneError("start: the end of a run with other coordinates; give a dict of those that both have")
        given: dict[str, Any] = {**start.coordinates, **start.rates}
        kept: dict[str, Any] = {}
    elif isinstance(start, Mapping):
        given = names.canonical(start, "start")
        over = {*given, *(("x_dot", "y_dot") if "speed" in given else ())}
        over |= {"speed"} if {"x_dot", "y_dot"} & given.keys() else set()
        kept = {name: value for name, value in names.canonical(data.get("start", {}), "start").items() if name not in over}
    else:
        raise SceneError(f"start = {start!r:.80}: must be the end of a run, or a dict of coordinates and rates by name")
    changed = Scene.from_dict({**data, "start": {**kept, **given}}, "arguments")
    made = dataclasses.replace(mechanism, scene=changed)
    made.__dict__["robots"] = mechanism.robots  # the model is the same
    return made


def check_robots(mechanism: RobotMechanism) -> Start:
    """Do everything that comes before a run; return its start and what is known of it. Raises what a run would."""
    scene = mechanism.scene
    require_data(scene, 0.0, scene.run.duration)
    system = make_robot_system(mechanism)
    start = robot_start(system)
    system.breaks(0.0, scene.run.duration)
    if system.points:
        system = system.phase(_standing(system, start))
    engine = RobotEngine(system, start.state)
    engine.workspace.evaluate(0.0, engine.pack(start.state))
    programme, notes = engine.workspace.programme, []
    if programme is not None:
        notes.append(programme.controllable)
        notes += engine.workspace.unreached()
    return start._replace(adjustments=(*start.adjustments, *notes))


def _standing(system: RobotSystem, start: Start) -> list[Footing]:
    """Return how contacts stand at a start: those that touch hold."""
    view: Any = RobotView(system, RobotWorkspace(system), 0.0, State(*map(np.array, start.state)))
    own: Any = system
    found, names = [], touching(own, view)
    for point in system.points:
        place = np.array([view[name] for name in point.names])
        state = SLIDING if point.smooth else HELD
        found.append(point.footing_at(state, 0.0, place, False) if point.name in names else Footing())
    return found
