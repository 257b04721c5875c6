"""Stored runs: a trajectory from its file, checked against the scene in it."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np

from vlmb.errors import TrajectoryError
from vlmb.model.mechanism import build
from vlmb.scene.scene import Scene
from vlmb.scene.tables import Run
from vlmb.simulation.motion import state_size, unit_directions
from vlmb.simulation.storage import read_arrays
from vlmb.simulation.trajectory import ARRAYS, Trajectory
from vlmb.system.system import make_system

OLD = ("t", "q", "v", "work", "asked", "reference")  # names in files of format 1


def load_trajectory(path: str | Path) -> Trajectory:
    """Read a stored trajectory. It is data: nothing in it is run.

    Raises TrajectoryError for a file that is missing, damaged or foreign.
    """
    note, stored = read_arrays(path, {1: OLD, 2: tuple(ARRAYS.values())})
    if "states" not in stored:
        try:
            stored["states"] = np.hstack([stored[name] for name in ("q", "v", "work")])
        except ValueError as error:
            raise TrajectoryError(f"{path}: q, v and work are damaged: {error}") from None
    arrays = {name: stored[key] for name, key in ARRAYS.items()}
    try:
        scene = Scene.from_dict(note["scene"], f"{path}: scene")
        run = msgspec.convert(note["run"], Run)
        status, message = str(note["status"]), str(note["message"])
        names, adjustments = tuple(map(str, note["asked_names"])), tuple(map(str, note["repairs"]))
        stats, made_with, engine = dict(note["stats"]), dict(note["versions"]), str(note.get("engine", "pinocchio"))
        t0, doubts = float(note.get("t0", 0.0)), tuple(map(str, note.get("doubts", ())))
    except (KeyError, TypeError, ValueError) as error:
        raise TrajectoryError(f"{path}: not a trajectory of vlmb, or damaged ({type(error).__name__}: {error})") from None
    system = make_system(build(scene), run, inputs=names or None)
    layout, samples = system.mechanism.layout, arrays["t"].size
    branches = len(arrays["branch"]) if len(arrays["branch"]) == 1 else samples
    shapes = {
        "t": (samples,), "states": (samples, state_size(system, engine)), "inputs": (samples, len(names)),
        "branch": (branches, len(layout.names)),
    }  # fmt: skip
    for name, shape in shapes.items():
        bad = ~np.isfinite(arrays[name]) & ~(np.isnan(arrays[name]) & (name == "inputs"))  # not known: nan
        if arrays[name].shape != shape or bad.any():
            what = f"shape {arrays[name].shape} where its scene needs {shape}, finite"
            raise TrajectoryError(f"{path}: {ARRAYS[name]} is damaged: {what}")
    if not samples or (np.diff(arrays["t"]) <= 0.0).any() or not -np.inf < t0 <= arrays["t"][0]:
        raise TrajectoryError(f"{path}: t is damaged: times must ascend from that of the start")
    if not unit_directions(system, engine, arrays["states"]):
        raise TrajectoryError(f"{path}: its states are damaged: directions do not have length 1")
    t, states, inputs, branch = (arrays[name] for name in ARRAYS)
    made = Trajectory(
        system.mechanism, t, states, engine, inputs, names, branch, run, status, message, adjustments, stats, made_with, t0,
        doubts,
    )  # fmt: skip
    made.__dict__["system"] = system
    return made
