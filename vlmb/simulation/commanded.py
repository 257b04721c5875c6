"""Modes of contacts under programmes whose controls go by the modes themselves.

Where controls are more than rows, or name forces of contacts, what they are depends on which contacts are held: they are computed
with the rows of these. Modes that go on are those under whose controls, held as they are, just these modes follow.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SingularError
from vlmb.scene.by_phase import acting, goes_by_modes
from vlmb.scene.names import listed
from vlmb.scene.scene import with_values
from vlmb.simulation.settling import Settling
from vlmb.system.contacts import CLOSED, HELD, OPEN, SLIDING, STANDING, STILL, Footing
from vlmb.system.probe import Answers, Probe
from vlmb.system.programme import control_names
from vlmb.system.system import System, make_system

Array = NDArray[np.float64]

MOST = 60  # sets of modes that are tried


class Commanded(Settling):
    """Finds what follows under such programmes."""

    given: list[float] | None = None  # what acts while modes are tried: forces from outside, and controls
    held: dict[object, Probe] | None = None  # contacts under given controls, by what else acts

    @property
    def by_modes(self) -> bool:
        """Whether controls of a programme go by the modes of contacts."""
        return goes_by_modes(self.systems.scene)

    def _modes(
        self, y: Array, resting: Sequence[int], frames: Mapping[int, Array], speeds: Mapping[int, Array],
        leaving: Mapping[int, tuple[int, Array]],
    ) -> tuple[dict[int, str], dict[int, Array], str]:  # fmt: skip
        """Return the modes that follow under the controls that programmes give in these modes."""
        if not self.by_modes or not resting:
            return super()._modes(y, resting, frames, speeds, leaving)
        states, ways = self._first_modes(resting, frames, speeds, leaving)
        tried, others = list[dict[int, str]](), self._fewer(dict(states))
        try:
            while len(tried) < MOST:
                tried.append(states)
                closed = frozenset(self.points[k].name for k, state in states.items() if state in CLOSED)
                try:
                    self.given = self._acting(y, states, ways)
                    found = self._modes_under(closed, y, resting, frames, speeds, leaving)
                except SingularError as error:  # a programme that needs other contacts than these
                    found = states, {}, str(error)
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
        touching = [self.points[k].name for k in resting]
        why = f"no modes of the contacts {listed(touching)} go on: in each what acts in it leads to others"
        return {}, {}, self._asked(why, frozenset(touching))

    def _first_modes(
        self, resting: Sequence[int], frames: Mapping[int, Array], speeds: Mapping[int, Array],
        leaving: Mapping[int, tuple[int, Array]],
    ) -> tuple[dict[int, str], dict[int, Array]]:  # fmt: skip
        """Return the modes that are tried first: all hold that do not slide."""
        states, ways = dict.fromkeys(resting, HELD), dict[int, Array]()
        for k in resting:
            across, point = speeds[k][:-1], self.points[k]
            size = float(np.linalg.norm(across))
            slides = k in leaving or (point.contact.slips and size > STILL)
            if point.smooth or (slides and point.edge is None):
                states[k] = SLIDING
            if states[k] == SLIDING and not point.smooth:
                friction = leaving[k][1][: len(across)] if k in leaving and not size > STILL else -across
                ways[k] = frames[k][:-1].T @ (-friction / np.linalg.norm(friction))
        return states, ways

    def _carried_by_others(
        self, y: Array, footings: tuple[Footing, ...], among: Sequence[int], frames: Mapping[int, Array], light: Collection[int]
    ) -> tuple[tuple[Footing, ...] | None, set[int]]:
        """Let all contacts carry under such a programme, whose controls go by which do."""
        if self.by_modes:
            return None, set()
        return super()._carried_by_others(y, footings, among, frames, light)

    def _under_forces(self, y: Array, closed: Collection[str]) -> Answers:
        if self.given is None:
            return super()._under_forces(y, closed)
        self.held = {} if self.held is None or self.systems.timed else self.held
        key, pushed = acting(self.systems.scene, closed)[1], any(at.state == STANDING for at in self.standing)
        if key not in self.held or pushed:
            self.held[key] = Probe(self._without_programmes(), self.system.engine, False, self.t, self.standing, closed)
        return self._on_legs(self.held[key].at(self.t, y, self._branch_at(y), self.works, self.given))

    @staticmethod
    def _fewer(states: Mapping[int, str]) -> Iterator[dict[int, str]]:
        """Yield the same modes with some contacts open, the fewest first."""
        for count in range(len(states) + 1):
            for opened in itertools.combinations(states, count):
                yield {k: OPEN if k in opened else state for k, state in states.items()}

    def _acting(self, y: Array, states: Mapping[int, str], ways: Mapping[int, Array]) -> list[float]:
        """Return forces from outside and of programmes, with contacts in given modes."""
        footings, jets = self._apart(), self._without_forces(y).jets
        for k, state in states.items():
            if state in CLOSED:
                ahead, aside, up = map(float, ways.get(k, np.zeros(3)))
                at = self.standing[k] if self.standing[k].state == state == HELD else None
                way = (ahead, aside, up)
                footings[k] = at or self.points[k].footing_at(state, self.t, jets[k, :3, 0], self.plane, way, self.standing[k])
        found = self._controls(y, footings)
        return [found.get(name, 0.0) for name in self._commands()]

    def _apart(self) -> list[Footing]:
        """Return all contacts open, but legs that springs push."""
        return [at if at.state == STANDING else Footing(place=at.place, since=at.since) for at in self.standing]

    def _controls(self, y: Array, footings: Sequence[Footing]) -> dict[str, float]:
        """Return forces from outside and controls by name, with contacts as they stand."""
        mover = self._mover(footings)
        found = dict(zip(self.system.forces.inputs or (), mover.inputs_at(self.t, y), strict=False))
        mover.evaluate(self.t, y)
        for name, value in mover.controls().items():
            found[name] = found.get(name, 0.0) + value
        return found

    def _without_programmes(self) -> System:
        """Return the system with forces from outside in the place of programmes."""
        scene = with_values(self.system.mechanism.scene, {"programme": None, "programmes": ()})
        made = make_system(self.system.with_scene(scene), self.system.run, self._commands())
        made.__dict__["work_names"] = self.system.work_names
        return made

    def _commands(self) -> tuple[str, ...]:
        """Name the forces from outside, and the controls of programmes."""
        return tuple(dict.fromkeys([*(self.system.forces.inputs or ()), *control_names(self.system.mechanism)]))
