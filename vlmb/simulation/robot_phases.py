"""A run of robots in phases: what a run in phases asks of links, answered by robots.

The posture of a programme gives way to contacts that are closed, so what its torques are depends on which are. Modes of contacts
that go on are those under whose torques, held as they are, just these modes follow.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.model.layout import State
from vlmb.scene.by_phase import programme_at, programmes_of
from vlmb.scene.names import listed
from vlmb.scene.tables import Run
from vlmb.simulation.phased_run import PhasedRun
from vlmb.simulation.samples import Samples
from vlmb.system.contacts import CLOSED, HELD, OPEN, SLIDING, STILL, ContactPoint, Footing
from vlmb.system.probe import Answers, Probe
from vlmb.system.robot_engine import RobotEngine, RobotView
from vlmb.system.robot_system import RobotSystem

Array = NDArray[np.float64]

MOST = 60  # sets of modes that are tried


class RobotPhases(PhasedRun):
    """Takes a state of robots through all phases."""

    def __init__(
        self, system: RobotSystem, run: Run, y: Array, times: Array, breaks: Sequence[float], start: float, bounds: Array,
        control: Any, progress: Callable[[float], None] | None, longest: float, until: str,
    ) -> None:  # fmt: skip
        asked: Any = system
        self.torques: Probe | None = None  # contacts under given controls
        self.given: list[float] | None = None  # these: from outside, and of the programme
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

    def _modes_under(
        self, closed: frozenset[str], y: Array, resting: Sequence[int], frames: Mapping[int, Array],
        speeds: Mapping[int, Array], leaving: Mapping[int, tuple[int, Array]],
    ) -> tuple[dict[int, str], dict[int, Array], str]:  # fmt: skip
        """Return the modes that follow under the torques that the programme gives in these modes."""
        if programme_at(self.systems.scene, closed) is None or not resting:
            return super()._modes_under(closed, y, resting, frames, speeds, leaving)
        states, ways = dict.fromkeys(resting, HELD), dict[int, Array]()
        for k in resting:
            across, point = speeds[k][:-1], self.points[k]
            size = float(np.linalg.norm(across))
            if point.smooth or (point.contact.slips and size > STILL):
                states[k] = SLIDING
            if states[k] == SLIDING and not point.smooth:
                ways[k] = frames[k][:-1].T @ across / size
        tried, others = list[dict[int, str]](), self._fewer(dict(states))
        try:
            while len(tried) < MOST:
                tried.append(states)
                self.given = self._torques(y, states, ways)
                found = super()._modes_under(closed, y, resting, frames, speeds, leaving)
                self.given = None
                if found[0] == states and not found[2]:
                    return found
                states = found[0]
                if found[2] or states in tried:
                    fewer = next((other for other in others if other not in tried), None)
                    if fewer is None:
                        break
                    states = fewer
                ways = {k: found[1].get(k, ways.get(k, np.zeros(3))) for k, state in states.items() if state == SLIDING}
        finally:
            self.given = None
        touching = listed([self.points[k].name for k in resting])
        return {}, {}, f"no modes of the contacts {touching} go on: in each the torques of the programme lead to others"

    def _carried_by_others(
        self, y: Array, footings: tuple[Footing, ...], among: Sequence[int], frames: Mapping[int, Array], light: Collection[int]
    ) -> tuple[tuple[Footing, ...] | None, set[int]]:
        """Let all contacts carry under a programme, whose torques go by which do."""
        if programmes_of(self.systems.scene):
            return None, set()
        return super()._carried_by_others(y, footings, among, frames, light)

    def _under_forces(self, y: Array, closed: Collection[str]) -> Answers:
        if self.given is None:
            return super()._under_forces(y, closed)
        if self.torques is None:
            system: Any = self.system
            commanded, apart = system.commanded(commands_of(system)), [Footing()] * len(self.points)
            self.torques = Probe(commanded, system.engine, False, self.t, apart, closed)
        return self.torques.at(self.t, y, self._branch_at(y), self.works, self.given)

    @staticmethod
    def _fewer(states: Mapping[int, str]) -> Iterator[dict[int, str]]:
        """Yield the same modes with some contacts open, the fewest first."""
        for count in range(len(states) + 1):
            for opened in itertools.combinations(states, count):
                yield {k: OPEN if k in opened else state for k, state in states.items()}

    def _torques(self, y: Array, states: Mapping[int, str], ways: Mapping[int, Array]) -> list[float]:
        """Return forces from outside and of the programme with contacts in given modes."""
        footings, jets = [Footing()] * len(self.points), self._without_forces(y).jets
        for k, state in states.items():
            if state in CLOSED:
                ahead, aside, up = map(float, ways.get(k, np.zeros(3)))
                footings[k] = self.points[k].footing_at(state, self.t, jets[k, :3, 0], self.plane, (ahead, aside, up))
        engine: Any = self._mover(footings)
        engine.evaluate(self.t, y)
        system: Any = self.system
        own = engine.system.forces[engine.system.laws :]
        acting = dict(zip((force.name for force in own), engine.workspace.values[engine.system.laws :].tolist(), strict=True))
        return [acting.get(name, 0.0) for name in commands_of(system)]

    def _view(self, y: Array) -> Any:
        engine = self._mover_of(y)
        return RobotView(engine.system, engine.workspace, self.t, engine.unpack(self.t, y))

    def _mover_of(self, y: Array) -> RobotEngine:
        system: Any = self.system
        made: RobotEngine = system.mover(system, self.branch, None)
        return made

    def _angle_to(self, point: ContactPoint) -> float | None:
        return None


def commands_of(system: RobotSystem) -> tuple[str, ...]:
    """Name the forces from outside, and the controls of all programmes."""
    return (*system.inputs, *system.own.controls)


def with_engine(system: RobotSystem, start: State) -> RobotSystem:
    """Return a system that makes its engine; joints go back to a start as the posture of its programme."""

    def mover(own: RobotSystem, branch: Sequence[Any], control: Any) -> RobotEngine:
        made = RobotEngine(own, start, control)
        made.take_branch(branch)
        return made

    return system.moved_by(mover)
