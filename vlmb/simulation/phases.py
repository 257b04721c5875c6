"""Phases and events of a run, as they are told and as they are kept."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.model.frozen import read_only
from vlmb.system.contacts import SLIDING, ContactPoint, Footing
from vlmb.system.events import BOUNCES, OPENS, SLIPS, STICKS, TOLD, TOUCHES

Array = NDArray[np.float64]

KINDS = (TOUCHES, OPENS, SLIPS, STICKS, BOUNCES, *TOLD.values())


class Phase(NamedTuple):
    """An interval in which no contact changes: from start to end [s], what is closed, and which of these slide with friction."""

    start: float
    end: float
    closed: tuple[str, ...]
    slipping: tuple[str, ...]


class Event(NamedTuple):
    """Something that happened at a time [s].

    kind : of a contact touch (it stays closed), bounce (it leaves at once), open, slip or stick; event, one of the scene; limit
        and fall, which end a run; switch, of a law by the state; line_up, of two directions
    impulses : (3,) [N s] on the mechanism in the surface frame, by contact
    lost : [J] by the impact
    modes : what each contact does from now on: open, held or sliding
    several : whether other modes were admissible too and moved otherwise; these are the most sticking ones
    early : [s] at most, before the end of impacts of which every cycle is a share of the one before: contacts rest from here on
    """

    t: float
    kind: str
    name: str
    contacts: tuple[str, ...] = ()
    impulses: Mapping[str, Array] = MappingProxyType({})
    lost: float = 0.0
    modes: Mapping[str, str] = MappingProxyType({})
    several: bool = False
    early: float = 0.0

    def __reduce__(self) -> tuple[Any, ...]:
        return _event, (*self[:4], dict(self.impulses), self.lost, dict(self.modes), self.several, self.early)


def _event(*values: Any) -> Event:
    """Make an event of what is pickled of one: mappings that nobody writes into are not."""
    event = Event(*values)
    impulses = {name: read_only(impulse) for name, impulse in event.impulses.items()}
    return event._replace(impulses=MappingProxyType(impulses), modes=MappingProxyType(dict(event.modes)))


class Turn(NamedTuple):
    """A time [s] at which a run began anew, what made it, and how contacts stood from then on.

    There a motion, or its rates, are not smooth. Events of contacts are among them, and so is what is told of no run: a break of
    a law, a switch, a ski that stops or slips.
    """

    t: float
    what: str
    contacts: tuple[str, ...] = ()
    modes: tuple[tuple[str, str], ...] = ()


@dataclasses.dataclass(frozen=True)
class Stretch:
    """A phase as it was run: how contacts stood, and which samples (first, end) it has."""

    start: float
    end: float
    footings: tuple[Footing, ...]
    first: int
    last: int
    quiet: bool = False  # it began where nothing is told


def begun(stretches: Sequence[Stretch], count: int) -> Array:
    """Return when the phase of every sample (count,) began [s]; 0 without phases."""
    found, began = np.zeros(count), 0.0
    for stretch in stretches:
        began = began if stretch.quiet else stretch.start
        found[stretch.first : stretch.last] = began
    return found


def phases_of(points: Sequence[ContactPoint], stretches: Sequence[Stretch]) -> tuple[Phase, ...]:
    """Return the phases that are told: intervals with constant states of contacts."""
    found: list[Phase] = []
    for stretch in stretches:
        states = list(zip(points, stretch.footings, strict=True))
        closed = tuple(point.name for point, at in states if point.closed(at))
        slipping = tuple(point.name for point, at in states if at.state == SLIDING and point.contact.slips)
        if found and stretch.quiet:
            found[-1] = found[-1]._replace(end=stretch.end)
        else:
            found.append(Phase(stretch.start, stretch.end, closed, slipping))
    return tuple(found)
