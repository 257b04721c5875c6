"""Runs that derivatives are taken of: tight tolerances, one system, the same samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, SimulationError
from vlmb.model.mechanism import build
from vlmb.scene.keys import changed_data
from vlmb.scene.scene import Scene
from vlmb.simulation.methods import find_method
from vlmb.simulation.phases import Turn
from vlmb.simulation.trajectory import Trajectory
from vlmb.studies.ensemble import Ensemble, Task
from vlmb.studies.reductions import history_at
from vlmb.system.start import consistent_start
from vlmb.system.system import make_system

Array = NDArray[np.float64]

TIGHT, STIFF = (1e-12, 1e-14), (1e-10, 1e-12)  # rtol and atol; of stiff methods
LEAST = 0.1  # size of a start value or a parameter that is nearly 0


class Ran(NamedTuple):
    """What is looked at of a run: histories (names, N), and where it began anew."""

    values: Array
    turns: tuple[Turn, ...]


class Runs:
    """Histories of quantities as functions of numbers of a scene, at given times."""

    def __init__(self, scene: Scene, keys: Sequence[str], names: Sequence[str], times: Array) -> None:
        self.keys, self.names, self.times = tuple(keys), tuple(names), times
        self.scene = tightened(scene, float(times[-1]))
        self.ensemble = Ensemble(Task(self.scene, self.keys, (), (), ""), times)

    def trajectory(self, values: Sequence[float] | Array, times: Array | None = None) -> Trajectory:
        """Run with values of the keys; `times`: other samples."""
        return self.ensemble.trajectory(dict(zip(self.keys, map(float, values), strict=True)), times)

    def ran(self, values: Sequence[float] | Array, times: Array | None = None) -> Ran:
        """Return histories and turns. Raises SimulationError for a run that ends before its last sample."""
        found, times = self.trajectory(values, times), self.times if times is None else times
        if found.t[-1] < times[-1]:
            raise SimulationError(f"a run ends before its last sample: {found.message}")
        return Ran(np.array([history_at(found, name, times) for name in self.names]), found.turns)

    def histories(self, values: Sequence[float] | Array) -> Array:
        """Return the histories (names, N). Raises SimulationError for a run that ends before its last sample."""
        return self.ran(values).values


def tightened(scene: Scene, duration: float) -> Scene:
    """Return a scene that is run long enough, and as exactly as derivatives need; fixed steps stay as they are."""
    method = find_method(scene.run.method)
    rtol, atol = STIFF if method.stiff else TIGHT
    closer = {"rtol": min(rtol, float(scene.run.rtol)), "atol": min(atol, float(scene.run.atol))} if method.adaptive else {}
    return scene.changed(run={"duration": duration, **closer})


def value_at(scene: Scene, key: str) -> float:
    """Return the number at a key path; of a start that does not give it the value it begins with. Raises SceneError."""
    changed_data(scene, {key: 0.0})  # explains a wrong key
    parts = key.replace("[", ".").replace("]", "").split(".")
    if parts[0] == "start":
        name = ".".join(parts[1:])
        system = make_system(build(scene))
        start = consistent_start(system)
        found = {**start.coordinates, **start.rates}
        if name == "speed" and name not in scene.start:
            return float(np.hypot(found["x_dot"], found["y_dot"]))
        return float(scene.start.get(name, found.get(system.mechanism.names.find(name, "start").name, 0.0)))
    place: Any = scene
    names = [link.name for link in scene.links]
    for at, part in enumerate(parts):
        if isinstance(place, Mapping):
            place = place.get(".".join(parts[at:]))
            break
        if isinstance(place, tuple):
            place = place[names.index(part) if at == 1 and parts[0] == "links" and part in names else int(part)]
        else:
            place = getattr(place, part, None)
    if isinstance(place, bool) or not isinstance(place, (int, float)):
        raise SceneError(f"{key}: has no number in this scene to begin with; give it one")
    return float(place)


def size_of(key: str, value: float) -> float:
    """Return what a change of a number is measured by."""
    return max(abs(value), LEAST) if key.startswith(("start.", "parameters.")) else abs(value) or 1.0
