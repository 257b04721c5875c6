"""The phase in which a state stands: which contacts are closed there, and how."""

from __future__ import annotations

import numpy as np

from vlmb.errors import SceneError, StudyError
from vlmb.scene.names import listed
from vlmb.simulation.phased_run import PhasedRun
from vlmb.system.contacts import HELD, Footing, by_rows
from vlmb.system.engines import make_engine
from vlmb.system.ski_contact import STANDS
from vlmb.system.start import Start
from vlmb.system.system import System


def in_phase(system: System, start: Start, t: float = 0.0) -> System:
    """Return the system of the phase in which a run from a start begins, with the rows of what is closed.

    Raises SceneError where something strikes there, or is carried along by ground that moves; StudyError where no motion is
    admissible.
    """
    if not system.points:
        return system
    y = make_engine(system, start.branch).pack(start.state)
    run = PhasedRun(system, system.run, y, np.array([t]), (), t, np.zeros((0, 3)), start.branch, None)
    begun = run.begins
    if begun.sentence:
        raise StudyError(begun.sentence)
    if begun.event is not None:
        names = listed(begun.event.contacts)
        raise SceneError(f"contacts: {names} strike here, and velocities jump: give rates at which they rest")
    for point, footing in zip(system.points, begun.footings, strict=True):
        if point.moving and footing.state == HELD:
            raise SceneError(f"contact {point.name!r} is carried along by ground that moves: no motion on it is steady")
    return run.systems.of([*map(by_rows, begun.footings)], t)


def standing(system: System) -> tuple[str, ...]:
    """Return how contacts stand in the system of a phase, each with its name, in words."""
    found = []
    for point, at in zip(system.points, footings_of(system), strict=False):
        words = f"{point.name} {point.shown(at)}"
        if point.edge is not None and point.edge.friction and point.closed(at):
            words += ", at rest along itself" if at.first == STANDS else ", sliding along itself"
        found.append(words)
    return tuple(found)


def footings_of(system: System) -> tuple[Footing, ...]:
    """Return the footings of the system of a phase; none of any other."""
    return () if system.contacts is None else system.contacts.footings
