"""Stored runs: a trajectory from its file, checked against the scene in it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.errors import SceneError, TrajectoryError
from vlmb.model.building import build
from vlmb.model.mechanism import Mechanism
from vlmb.scene.names import has_controls
from vlmb.scene.scene import Scene
from vlmb.simulation.motion import state_size, unit_directions
from vlmb.simulation.phases import Event, Stretch
from vlmb.simulation.phases_data import phases_from_data
from vlmb.simulation.storage import Stored, reading
from vlmb.simulation.trajectory import ARRAYS, STATUSES, Trajectory
from vlmb.system.system import System, make_system

Array = NDArray[np.float64]

FORMATS = (1, 2)  # 1 has q, v and work where 2 has the states of an engine
MAX_SAMPLES = 10_000_000
NUMBERS = ("wall_time", "cpu_time", "rhs_evaluations", "steps")  # of `stats`
ENGINES = ("core", "pinocchio")


def load_trajectory(path: str | Path) -> Trajectory:
    """Read a stored trajectory. It is data: nothing in it is run.

    Raises TrajectoryError for a file that is missing, damaged or foreign.
    """
    with reading(path, FORMATS) as stored:
        note = stored.note
        try:
            scene = Scene.from_dict(note["scene"], "scene")
            run = scene.changed(run=note["run"]).run
        except SceneError as error:
            raise TrajectoryError(f"{path}: not a trajectory of vlmb, or damaged: {error}") from None
        status, message, engine = (_one(path, note, name) for name in ("status", "message", "engine"))
        names, adjustments, doubts = (_texts(path, note, name) for name in ("asked_names", "repairs", "doubts"))
        t0 = float(note.get("t0", 0.0))
        if status not in STATUSES or engine not in ENGINES or not math.isfinite(t0):
            raise TrajectoryError(f"{path}: its note is damaged: status {status!r:.80}, engine {engine!r:.80}, t0 {t0}")
        mechanism = build(scene)
        if not isinstance(mechanism, Mechanism):
            return _with_robots(path, stored, mechanism, run, t0, (status, message, names, adjustments, doubts))
        system = make_system(mechanism, run, inputs=names or None)
        t, states, inputs, branch = _arrays(path, stored, system, engine, t0, len(names))
        made = Trajectory(
            system.mechanism, t, states, engine, inputs, names, branch, run, status, message, adjustments, _stats(path, note),
            _versions(path, note), t0, doubts, *_phases(path, note, system, len(t)),
        )  # fmt: skip
        made.__dict__["system"] = system
        return made


def _with_robots(path: str | Path, stored: Stored, mechanism: Any, run: Any, t0: float, told: tuple[Any, ...]) -> Trajectory:
    """Read the run of a scene with robots."""
    from vlmb.simulation.robot_trajectory import RobotTrajectory
    from vlmb.system.robot_system import make_robot_system

    status, message, names, adjustments, doubts = told
    system = make_robot_system(mechanism, run, names or None)
    t = _times(path, stored, t0, bool(system.points))
    states = stored.read(ARRAYS["states"], (len(t), system.size))
    if not all(pin.isNormalized(mechanism.model, np.array(q), 1e-6) for q in states[:, : mechanism.model.nq]):
        raise TrajectoryError(f"{path}: its states are damaged: quaternions do not have length 1")
    inputs = stored.read(ARRAYS["inputs"], (len(t), len(names)))
    made = RobotTrajectory(
        mechanism, t, states, "pinocchio", inputs, names, np.zeros((1, 0)), run, status, message, adjustments,
        _stats(path, stored.note), _versions(path, stored.note), t0, doubts, *_phases(path, stored.note, system, len(t)),
    )  # fmt: skip
    made.__dict__["system"] = system
    return made


def _times(path: str | Path, stored: Stored, t0: float, twice: bool = False) -> Array:
    """Read the times of the samples, which tell how many there are; `twice`: an event of a contact has two of one time."""
    shape = stored.shape("t")
    if len(shape) != 1 or not 0 < shape[0] <= MAX_SAMPLES:
        raise TrajectoryError(f"{path}: t is damaged: shape {shape} where 1 to {MAX_SAMPLES} times belong")
    t = stored.read("t", shape)
    steps = np.diff(t)
    if (steps < 0.0).any() or ((steps == 0.0).any() and not twice) or not t0 <= t[0]:
        raise TrajectoryError(f"{path}: t is damaged: times must ascend from that of the start")
    return t


def _arrays(
    path: str | Path, stored: Stored, system: System, engine: str, t0: float, inputs: int
) -> tuple[Array, Array, Array, Array]:
    """Read times, states, inputs and branches of the shapes that their scene needs; times first, since they tell how many."""
    t = _times(path, stored, t0, bool(system.points))
    layout = system.mechanism.layout
    if stored.note["format"] == 1:
        widths = {"q": layout.nq, "v": layout.nv, "work": len(system.work_names)}
        states = np.hstack([stored.read(name, (len(t), width)) for name, width in widths.items()])
    else:
        states = stored.read(ARRAYS["states"], (len(t), state_size(system, engine)))
    if not unit_directions(system, engine, states):
        raise TrajectoryError(f"{path}: its states are damaged: directions do not have length 1")
    asked, kept = ARRAYS["inputs"], ARRAYS["branch"]
    branches = 1 if stored.shape(kept)[:1] == (1,) else len(t)
    return t, states, stored.read(asked, (len(t), inputs)), stored.read(kept, (branches, len(layout.names)))


def _phases(
    path: str | Path, note: Mapping[str, Any], system: Any, count: int
) -> tuple[tuple[Stretch, ...], tuple[Event, ...]]:
    try:
        return phases_from_data(note, [point.name for point in system.points], count)
    except (KeyError, TypeError, ValueError) as error:
        raise TrajectoryError(f"{path}: its note is damaged: phases ({type(error).__name__}: {error!s:.80})") from None


def _one(path: str | Path, note: Mapping[str, Any], name: str) -> str:
    """Read a text of the note; without control characters: it is printed."""
    text = note[name] if name != "engine" else note.get(name, "pinocchio")
    if not isinstance(text, str) or has_controls(text):
        raise TrajectoryError(f"{path}: its note is damaged: {name} = {text!r:.80}")
    return text


def _texts(path: str | Path, note: Mapping[str, Any], name: str) -> tuple[str, ...]:
    entries = note[name] if name != "doubts" else note.get(name, ())
    if not isinstance(entries, (list, tuple)):
        raise TrajectoryError(f"{path}: its note is damaged: {name} = {entries!r:.80}")
    return tuple(_one(path, {name: entry}, name) for entry in entries)


def _stats(path: str | Path, note: Mapping[str, Any]) -> dict[str, Any]:
    """Read what a run took: finite numbers, and texts."""
    found = dict(note["stats"])
    for name in (*NUMBERS, *found):
        value = found.get(name)
        if name in NUMBERS and (isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < 1e300):
            raise TrajectoryError(f"{path}: its note is damaged: stats.{name} = {value!r:.80}")
    return found


def _versions(path: str | Path, note: Mapping[str, Any]) -> dict[str, str]:
    return {str(name): _one(path, {"versions": version}, "versions") for name, version in dict(note["versions"]).items()}
