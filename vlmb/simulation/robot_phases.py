"""A run of robots in phases: what a run in phases asks of links, answered by robots.

The posture of a programme gives way to contacts that are closed, so what its torques are depends on which are. Modes of contacts
that go on are those under whose torques, held as they are, just these modes follow.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.model.layout import State
from vlmb.scene.by_phase import programmes_of
from vlmb.scene.tables import Run
from vlmb.simulation.phased_run import PhasedRun
from vlmb.simulation.samples import Samples
from vlmb.system.contacts import ContactPoint, Footing
from vlmb.system.robot_engine import RobotEngine, RobotView
from vlmb.system.robot_system import RobotSystem

Array = NDArray[np.float64]


class RobotPhases(PhasedRun):
    """Takes a state of robots through all phases."""

    def __init__(
        self, system: RobotSystem, run: Run, y: Array, times: Array, breaks: Sequence[float], start: float, bounds: Array,
        control: Any, progress: Callable[[float], None] | None, longest: float, until: str,
    ) -> None:  # fmt: skip
        asked: Any = system
        super().__init__(asked, run, y, times, breaks, start, bounds, [], control, progress, longest, until)

    def _breaks(self, system: Any, start: float, end: float) -> Sequence[float]:
        found: Sequence[float] = system.breaks(start, end)
        return found

    def _branch_at(self, y: Array) -> list[Any]:
        return list(self.branch)

    def _branches(self, part: Samples) -> Any:
        """Return how angles are read from here on; samples have no branches of their own."""
        assert isinstance(self.mover, RobotEngine)
        return [self.mover.branch()]

    @property
    def by_modes(self) -> bool:
        """Whether there is a programme."""
        return bool(programmes_of(self.systems.scene))

    def _apart(self) -> list[Footing]:
        return [Footing()] * len(self.points)

    def _controls(self, y: Array, footings: Sequence[Footing]) -> dict[str, float]:
        """Return forces from outside and torques of the programme by name, with contacts as they stand."""
        engine: Any = self._mover(footings)
        engine.evaluate(self.t, y)
        own = engine.system.forces[engine.system.laws :]
        return dict(zip((force.name for force in own), engine.workspace.values[engine.system.laws :].tolist(), strict=True))

    def _without_programmes(self) -> Any:
        system: Any = self.system
        return system.commanded(self._commands())

    def _commands(self) -> tuple[str, ...]:
        """Name the forces from outside, and the controls of programmes."""
        system: Any = self.system
        return (*system.inputs, *system.own.controls)

    def _view(self, y: Array) -> Any:
        engine = self._mover_of(y)
        return RobotView(engine.system, engine.workspace, self.t, engine.unpack(self.t, y))

    def _mover_of(self, y: Array) -> RobotEngine:
        system: Any = self.system
        made: RobotEngine = system.mover(system, self.branch, None)
        return made

    def _angle_to(self, point: ContactPoint) -> float | None:
        return None


def with_engine(system: RobotSystem, start: State) -> RobotSystem:
    """Return a system that makes its engine; joints go back to a start as the posture of its programme."""

    def mover(own: RobotSystem, branch: Sequence[Any], control: Any) -> RobotEngine:
        made = RobotEngine(own, start, control)
        made.take_branch(branch)
        return made

    return system.moved_by(mover)
