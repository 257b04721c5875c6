"""Contacts on frames of robots: where their points are, what sliding ones push on, and what is looked for along a run."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.core import frame_rows
from vlmb.core.calls import direct
from vlmb.system.contacts import CLOSED, HELD, LIGHT, OPEN, RESTING, SLIDING, STILL, UNDER, PhaseContacts
from vlmb.system.events import CONTACT, FALLING, OPENS, REARMS, RISING, SLIPS, STICKS, TOUCHES, Event
from vlmb.system.slips import Slide, Slips, way_of

Array = NDArray[np.float64]

read_all: Any = direct(frame_rows.read_all)
rows_of_quantities: Any = direct(frame_rows.rows_of_quantities)


class RobotContacts(Slips):
    """The contacts of a phase on the buffers of a run. Remembers along what they slide: one for each run.

    seen : (contacts, 3) quantities that their x, y and z are; -1 for none
    """

    def __init__(self, space: Any, contacts: PhaseContacts, seen: NDArray[np.int64]) -> None:
        self.space, self.contacts, self.plane, self.places = space, contacts, False, None
        self.known = seen >= 0
        self.chosen = np.ascontiguousarray(seen[self.known])
        self.read, self.rows = np.zeros((len(self.chosen), 3)), np.zeros((len(self.chosen), space.nv))
        self.sliding = [entry for entry in contacts.closed if entry[1].state == SLIDING and entry[0].contact.slips]
        self.ways = [np.array(footing.towards) for _, footing, _, _ in self.sliding]
        self.last = [np.array(way) for way in self.ways]
        self.slides: list[Slide] = []
        system = space.system
        self.first = system.eliminated - len(system.mechanism.scene.constraints)  # of the scene's ideal rows
        works = system.work_names
        self.works = {name: at for at, name in enumerate(works) if name.startswith(("friction ", "surface "))}

    def places_at(self, q: Array, v: Array) -> Array:
        """Return x, y, z of all points with rates and drifts (contacts, 3, 3)."""
        space, found = self.space, np.zeros((*self.known.shape, 3))
        read_all(*space.bodies, *space.readings, self.chosen, q, v, self.read)
        found[self.known] = self.read
        return found

    def lines_at(self, q: Array, v: Array) -> Array:
        """Return the rows of x, y, z of all points (contacts, 3, nv)."""
        space, found = self.space, np.zeros((*self.known.shape, self.space.nv))
        rows_of_quantities(*space.bodies, *space.readings, self.chosen, q, v, self.rows)
        found[self.known] = self.rows
        return found

    def slide(self, t: float, q: Array, v: Array) -> tuple[Array, NDArray[np.int64]]:
        """Find what sliding contacts push on beside their rows (any, nv), and which held rows these are."""
        self.slides, places, lines = [], self.places_at(q, v), self.lines_at(q, v)
        for k, (point, footing, row, _) in enumerate(self.sliding):
            place, rate = places[point.index, :, 0], places[point.index, :, 1]
            slope = point.slope(t, place, footing)
            size = float(np.linalg.norm(slope))
            normal, surface = slope / size, np.array(point.contact.surface_velocity)
            moving = rate - surface
            moving = moving - (moving @ normal) * normal
            way = way_of(self.ways[k], moving, normal, True)
            self.last[k] = way
            share = -point.coefficient * size
            extra = share * way @ lines[point.index]
            self.slides.append(Slide(row, extra, float(moving @ way), share, float(way @ surface), point.name))
        return np.array([slide.extra for slide in self.slides]), np.array([self.first + s.row for s in self.slides], np.int64)

    def add_powers(self, multipliers: Array, work: Array) -> None:
        """Add what friction takes, and what it carries along with moving surfaces, to the rates of the work states [W]."""
        for slide in self.slides:
            force = slide.share * float(multipliers[self.first + slide.row])
            for name, speed in ((f"friction {slide.name}", slide.speed), (f"surface {slide.name}", slide.carried)):
                if name in self.works:
                    work[self.works[name]] += force * speed

    def jets(self, t: float, q: Array, v: Array, vdot: Array) -> Array:
        """Return x, y, z of the points and their gaps, each with two derivatives (contacts, 4, 3)."""
        found = np.zeros((len(self.known), 4, 3))
        found[:, :3] = self.places_at(q, v)
        found[:, :3, 2] += self.lines_at(q, v) @ vdot
        for point, footing in zip(self.contacts.points, self.contacts.footings, strict=True):
            plain = point.plain
            jet = found[point.index]
            jet[3] = point.surface.jet(t, jet[:3]) if plain is None else jet[plain]
            jet[3, 0] -= footing.gap
        return found

    @property
    def events(self) -> tuple[Event, ...]:
        """What is looked for of all contacts."""
        found, light = [], LIGHT * self.space.system.mechanism.table.mass
        for k, (point, footing) in enumerate(zip(self.contacts.points, self.contacts.footings, strict=True)):
            if footing.state in CLOSED:
                if footing.state == RESTING:
                    continue
                found.append(Event(CONTACT, FALLING, OPENS, "", k, slack=light))
                if point.contact.slips:
                    kind = SLIPS if footing.state == HELD else STICKS
                    found.append(Event(CONTACT, FALLING, kind, "", k, slack=STILL if kind == STICKS else light))
            elif footing.state == OPEN:
                found.append(Event(CONTACT, FALLING, TOUCHES, "", k, slack=UNDER))
            else:
                found.append(Event(CONTACT, RISING, REARMS, "", k, slack=0.0))
        return tuple(found)

    def look(self, t: float, q: Array, v: Array, vdot: Array, multipliers: Array) -> Array:
        """Return the indicators of these events and their rates (2, e)."""
        jets, found = self.jets(t, q, v, vdot), list[tuple[float, float]]()
        closed = iter(self.indicators(t, jets, multipliers[self.first :], q))
        for point, footing in zip(self.contacts.points, self.contacts.footings, strict=True):
            if footing.state == RESTING:
                continue
            if footing.state in CLOSED:
                found += [(next(closed), np.nan) for _ in range(1 + point.contact.slips)]
            else:
                found.append((float(jets[point.index, 3, 0]), float(jets[point.index, 3, 1])))
        return np.array(found, float).reshape(-1, 2).T
