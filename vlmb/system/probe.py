"""What forces at the points of contacts do: the matrix of their accelerations, found by trying each.

Everything answers there as it does in a run: ideal rows, the knife edge, and a programme where it may. So the same serves forces
after an event and, without forces and a programme, impulses.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.model.names import AXES
from vlmb.scene.tables import BASE
from vlmb.system.contacts import Footing, PhaseContacts
from vlmb.system.engines import make_engine
from vlmb.system.programme import total_mass
from vlmb.system.system import System

Array = NDArray[np.float64]


class Answers(NamedTuple):
    """Of all contacts at an instant, without forces of contacts."""

    jets: Array  # (contacts, 4, 3) x, y, z of the point and the gap, each with two derivatives
    matrix: Array  # (3 contacts, 3 contacts) [1/kg] accelerations of the points by forces there
    moved: Array  # (velocities and work states, 3 contacts) what a state changes by for an impulse


class Probe:
    """The contacts of a system, all open; `bare` without forces and a programme."""

    def __init__(self, system: System, engine: str, bare: bool) -> None:
        open_ = system.phase([Footing()] * len(system.points), bare)
        given = () if bare else system.inputs
        forces = [
            (3 * point.index + axis, f"F_{AXES[axis]}" if point.contact.point == BASE else f"R_{name}")
            for point in system.points
            for axis, name in enumerate(point.names)
            if name
        ]
        names = (*given, *(name for _, name in forces if name not in given))
        works = tuple(dict.fromkeys((*names, *system.work_names)))
        assert open_.contacts is not None
        contacts = PhaseContacts(system.points, open_.contacts.footings, open_.contacts.own, works)
        self.system = dataclasses.replace(open_.with_inputs(names), contacts=contacts)
        self.bare = bare
        self.engine, self.names, self.given = engine, names, len(given)
        self.columns = [(column, names.index(name)) for column, name in forces]
        self.push = total_mass(system.mechanism) * (system.mechanism.scene.gravity or 1.0) or 1.0
        self.room = len(works)

    def at(self, t: float, y: Array, branch: Sequence[float], works: int, given: Sequence[float]) -> Answers:
        """Answer at a state y of the run, which has `works` work states, under forces `given` (S,) from outside."""
        engine = make_engine(self.system, branch, None, self.engine)
        state = np.concatenate([y[: len(y) - works], np.zeros(self.room)])
        inputs = np.zeros(len(self.names))
        inputs[: self.given] = given
        engine.hold_inputs(inputs)
        free = engine.look_at_contacts(t, state)
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
        return Answers(free.jets, matrix, moved)
