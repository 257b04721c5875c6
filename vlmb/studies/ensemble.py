"""The runs of a study, shard by shard: the same bits wherever a shard is computed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import VlmbError
from vlmb.model.mechanism import build
from vlmb.scene.renumbered import renumbered
from vlmb.scene.scene import Scene, with_values
from vlmb.simulation.simulate import run_system, sample_times, simulate
from vlmb.simulation.trajectory import Trajectory
from vlmb.studies.reductions import Kept, history_at
from vlmb.system.pace import require_data
from vlmb.system.system import System, make_system

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Task:
    """What is done for every run; two of one digest are the same."""

    scene: Scene
    keys: tuple[str, ...]
    kept: tuple[Kept, ...]
    histories: tuple[str, ...]
    digest: str

    def __hash__(self) -> int:
        return hash(self.digest)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Task) and other.digest == self.digest


class Shard(NamedTuple):
    """What is kept of some runs, one after the other."""

    numbers: Array  # (kept, runs), nan where a run has none
    histories: Array  # (histories, runs, N), nan after the end of a run
    status: tuple[str, ...]
    message: tuple[str, ...]
    doubts: tuple[str, ...]


class Ensemble:
    """Runs of one task. They share a system as long as they differ in nothing that it was compiled of. Threads may share it."""

    def __init__(self, task: Task, times: Array | None = None) -> None:
        self.task, self.given = task, times

    @cached_property
    def times(self) -> Array:
        """Times (N,) of the samples of a run; empty where its length is varied."""
        if self.given is not None:
            return self.given
        varied = any(key in ("run", "run.duration", "run.samples") for key in self.task.keys)
        return np.zeros(0) if varied else sample_times(self.task.scene.run)

    @cached_property
    def system(self) -> System | None:
        """What runs share; None where they share nothing."""
        scene, first = self.task.scene, dict.fromkeys(self.task.keys, 1.0)
        if not all(key.startswith(("start.", "links.", "links[")) for key in first):
            return None
        try:
            require_data(scene, 0.0, float(self.times[-1]))
            system = make_system(build(scene))
            return system if system.engine == "core" and system.core_plan is not None else None
        except VlmbError:
            return None  # a run says it

    def trajectory(self, changes: Mapping[str, Any], times: Array | None = None) -> Trajectory:
        """Simulate the scene with changes, or at other times: as `simulate(scene.changed_at(changes))` does, bit for bit."""
        numbers = renumbered(self.task.scene, changes) if self.system is not None else None
        if numbers is None or self.system is None:
            return simulate(self.task.scene.changed_at(changes), t_eval=self.given if times is None else times)
        mechanism = self.system.with_scene(with_values(self.task.scene, numbers))
        return run_system(self.system.with_numbers(mechanism, self.system.run), self.times if times is None else times)

    def shard(self, rows: Sequence[Sequence[Any]]) -> Shard:
        """Run the rows. A run that fails is a row with its status and message."""
        task = self.task
        numbers = np.full((len(task.kept), len(rows)), np.nan)
        histories = np.full((len(task.histories), len(rows), len(self.times)), np.nan)
        status, message, doubts = ["failed"] * len(rows), [""] * len(rows), [""] * len(rows)
        for k, row in enumerate(rows):
            try:
                trajectory = self.trajectory(dict(zip(task.keys, row, strict=True)))
            except VlmbError as error:
                message[k] = str(error)
                continue
            if trajectory.status == "interrupted":
                raise KeyboardInterrupt
            status[k], message[k], doubts[k] = trajectory.status, trajectory.message, "; ".join(trajectory.doubts)
            for j, entry in enumerate(task.kept):
                try:
                    numbers[j, k] = entry.of(trajectory)
                except VlmbError as error:
                    message[k] += f" {entry.name}: {error}"
            count = int(np.searchsorted(self.times, trajectory.t[-1], side="right")) if task.histories else 0
            for j, name in enumerate(task.histories):
                histories[j, k, :count] = history_at(trajectory, name, self.times[:count])
        return Shard(numbers, histories, tuple(status), tuple(message), tuple(doubts))


@lru_cache(maxsize=4)
def ensemble_of(task: Task) -> Ensemble:
    """Return the runs of a task; what they share is made once a process."""
    return Ensemble(task)


def run_shard(task: Task, rows: Sequence[Sequence[Any]]) -> Shard:
    """Run some rows of a task: what workers are given."""
    return ensemble_of(task).shard(rows)
