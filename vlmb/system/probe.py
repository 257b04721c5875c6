"""What forces at the points of contacts do: the matrix of their accelerations, found by trying each.

Everything answers there as it does in a run: ideal rows, the knife edge, and a programme where it may. So the same serves forces
after an event and, without forces and a programme, impulses.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.model.names import AXES
from vlmb.scene.tables import BASE
from vlmb.system.contacts import STANDING, ContactLook, ContactPoint, Footing, PhaseContacts
from vlmb.system.core_engine import CoreEngine
from vlmb.system.engines import inputs_of, make_engine
from vlmb.system.pinocchio_engine import PinocchioEngine
from vlmb.system.programme import total_mass
from vlmb.system.stops import StopPoint
from vlmb.system.system import System

Array = NDArray[np.float64]


class Responses(NamedTuple):
    """What forces and impulses at contacts do."""

    matrix: Array  # (3 contacts, 3 contacts) [1/kg] accelerations of the points by forces there
    moved: Array  # (velocities and work states, 3 contacts) what a state changes by for an impulse


class Answers:
    """Of all contacts at an instant, without forces of contacts; what forces do there is tried once it is asked for."""

    def __init__(self, jets: Array, responses: Callable[[], Responses]) -> None:
        self.jets = jets  # (contacts, 4, 3) x, y, z of the point and the gap, each with two derivatives
        self._try = responses

    @cached_property
    def responses(self) -> Responses:
        """What forces and impulses at contacts do."""
        return self._try()

    @property
    def matrix(self) -> Array:
        """Accelerations of the points by forces there (3 contacts, 3 contacts) [1/kg]."""
        return self.responses.matrix

    @property
    def moved(self) -> Array:
        """What a state changes by for an impulse (velocities and work states, 3 contacts)."""
        return self.responses.moved


class Probe:
    """The contacts of a system, all open but legs whose springs push; `bare` without these, forces and a programme.

    began : [s] of the phase; closed : contacts that programmes and forces take for closed
    """

    def __init__(
        self, system: System, engine: str, bare: bool, began: float, footings: Sequence[Footing], closed: Collection[str] = ()
    ) -> None:
        open_ = system.phase(unheld(footings, bare), bare, began, closed)
        given = () if bare else inputs_of(system)
        forces = [
            (3 * point.index + axis, _force_on(point, axis))
            for point in system.points
            for axis, name in enumerate(point.names)
            if name
        ]
        names = (*given, *(name for _, name in forces if name not in given))
        works = (*dict.fromkeys(name for name in names if name not in system.work_names), *system.work_names)
        assert open_.contacts is not None
        contacts = PhaseContacts(system.points, open_.contacts.footings, open_.contacts.own, works, began)
        self.system = dataclasses.replace(open_.with_inputs(names), contacts=contacts)
        self.bare = bare
        self.engine, self.names, self.given = engine, names, len(given)
        self.columns = [(column, names.index(name)) for column, name in forces]
        self.push = total_mass(system.mechanism) * (system.mechanism.scene.gravity or 1.0) or 1.0
        self.room = len(works)
        tried = {name for _, name in forces}  # a force of the scene along the same coordinate does no work by what is tried
        self.same = [at for at, name in enumerate(system.work_names) if name in tried]

    def place(self, footings: Sequence[Footing]) -> None:
        """Take the same legs to stand elsewhere, or to swing since another time."""
        self.system = self.system.placed(unheld(footings, self.bare))

    def at(self, t: float, y: Array, branch: Sequence[float], works: int, given: Sequence[float]) -> Answers:
        """Answer at a state y of the run, which has `works` work states, under forces `given` (S,) from outside."""
        engine = make_engine(self.system, branch, None, self.engine)
        state = np.concatenate([y[: len(y) - works], np.zeros(self.room)])
        inputs = np.zeros(len(self.names))
        inputs[: self.given] = given
        engine.hold_inputs(inputs)
        free = engine.look_at_contacts(t, state)
        return Answers(free.jets, lambda: self._responses(engine, t, state, free, inputs, works))

    def _responses(
        self, engine: CoreEngine | PinocchioEngine, t: float, state: Array, free: ContactLook, inputs: Array, works: int
    ) -> Responses:
        """Try each force beside what acts already."""
        count = len(free.jets)
        first, own = engine.velocities, self.room - works
        matrix, moved = np.zeros((3 * count, 3 * count)), np.zeros((first.stop - first.start + works, 3 * count))
        for column, at in self.columns:
            pushed = inputs.copy()
            pushed[at] += self.push
            engine.hold_inputs(pushed)
            found = engine.look_at_contacts(t, state)
            matrix[:, column] = ((found.jets[:, :3, 2] - free.jets[:, :3, 2]) / self.push).ravel()
            change = (found.rates - free.rates) / self.push
            moved[:, column] = np.concatenate([change[first], change[first.stop + own :]])
        moved[first.stop - first.start + np.array(self.same, np.intp)] = 0.0
        return Responses(matrix, moved)


def unheld(footings: Sequence[Footing], bare: bool) -> tuple[Footing, ...]:
    """Return how contacts stand with none held by rows; `bare`: nor pushed by the springs of legs."""
    return tuple(
        at if at.state == STANDING and not bare else Footing(place=at.place, since=at.since) for at in footings
    )


def _force_on(point: ContactPoint, axis: int) -> str:
    """Name the force along one axis of a contact's point, or along the length of a stop."""
    if isinstance(point, StopPoint):
        return point.force
    return f"F_{AXES[axis]}" if point.contact.point == BASE else f"R_{point.names[axis]}"
