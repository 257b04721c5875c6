"""Contacts that slide with friction, for Pinocchio's engine, and what is looked for of closed ones; see vlmb/core/contacts.py."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.core.contacts import SLOW
from vlmb.model.mechanism import Mechanism
from vlmb.model.reading import Postures
from vlmb.scene.tables import BASE
from vlmb.system.constraints import ConstraintSet
from vlmb.system.contacts import HELD, RESTING, SLIDING, ContactPoint, Footing, PhaseContacts
from vlmb.system.frames import LinkFrames
from vlmb.system.ski_contact import ALONG, EDGE, Edge, Heading, ski_frame, ski_rows, ski_way
from vlmb.system.stops import StopPoint

Array = NDArray[np.float64]


class Slide(NamedTuple):
    """A contact at the last evaluation, as it slides: which of the scene's ideal rows it is, and what that pushes on beside."""

    row: int
    extra: Array  # (nv,) for a unit of the multiplier
    speed: float  # [m/s] along its direction
    share: float  # friction [N] for a unit of the multiplier
    carried: float  # [m/s] of the surface along the direction
    name: str


class Slips:
    """Closed contacts of a phase in Pinocchio's engine. Remembers along what they slide: one for each run."""

    def __init__(self, mechanism: Mechanism, contacts: PhaseContacts) -> None:
        self.contacts, self.plane = contacts, mechanism.scene.plane
        self.sliding = [entry for entry in contacts.closed if entry[0].slides(entry[1])]
        self.ways = [np.array(footing.towards) for _, footing, _, _ in self.sliding]
        self.last = [np.array(way) for way in self.ways]
        texts = [(f"{name} = 0", "contacts", True) for point, *_ in self.sliding for name in point.names if name]
        self.places = ConstraintSet(mechanism, texts) if texts else None
        self.slides: list[Slide] = []

    def evaluate(self, frames: LinkFrames, t: float, q: Array, v: Array, branch: Array) -> list[Slide]:
        """Find what sliding contacts push on; frames are up to date."""
        self.slides = []
        if self.places is None:
            return self.slides
        values, at = self.places.evaluate(frames, t, q, v, branch), 0
        for k, (point, footing, row, _) in enumerate(self.sliding):
            axes = [axis for axis, name in enumerate(point.names) if name]
            lines = values.jacobian[at : at + len(axes)]
            place, rate = np.zeros(3), np.zeros(3)
            place[axes], rate[axes] = values.z[at : at + len(axes)], values.rate[at : at + len(axes)]
            at += len(axes)
            slope = point.slope(t, place, footing)
            size = float(np.linalg.norm(slope))
            normal, surface = slope / size, np.array(point.contact.surface_velocity)
            moving = rate - surface
            moving -= (moving @ normal) * normal
            way = way_of(self.ways[k], moving, normal, all(point.names))
            share = -point.coefficient * size
            if point.edge is not None:
                way, share = ski_way(heading_at(q), self.contacts.footings[point.index].towards), -size
            self.last[k] = way
            extra, carried = share * way[axes] @ lines, float(way @ surface)
            self.slides.append(Slide(row, extra, float(moving @ way), share, carried, point.name))
        return self.slides

    def keep(self) -> None:
        """Take the directions of the last evaluation as those at an accepted step."""
        self.ways = [np.array(way) for way in self.last]

    def indicators(
        self, t: float, jets: Array, multipliers: Array, q: Array, ground: Array | None = None
    ) -> list[float]:  # fmt: skip
        """Return the indicators of closed contacts in their order: normal force, then what friction may still hold or the speed.

        jets (contacts, 4, 3) of places and gaps; multipliers of all ideal rows of the scene; ground (3,) on a planted base.
        """
        found, slid = [], 0
        for point, footing, at, count in self.contacts.closed:
            if footing.state == RESTING:
                continue
            if point.edge is not None:
                found += _of_ski(point.edge, footing, heading_at(q), jets[point.index, :3, 1], multipliers[at : at + count])
                slid += point.slides(footing)
                continue
            if footing.planted and ground is not None:
                force, normal = ground, point.normal(footing)
            else:
                force, normal = held_by(point, footing, t, jets[point.index, :3, 0], multipliers[at : at + count])
            push = float(force @ normal)
            found.append(push)
            if not point.contact.slips:
                continue
            if footing.state == HELD:
                found.append(point.at_rest * push - float(np.linalg.norm(force - push * normal)))
                continue
            moving = jets[point.index, :3, 1] - np.array(point.contact.surface_velocity)
            way = self.ways[slid] - (self.ways[slid] @ normal) * normal
            found.append(float(moving @ way) / max(float(np.linalg.norm(way)), 1e-300))
            slid += 1
        return found


def way_of(last: Array, moving: Array, normal: Array, any_way: bool) -> Array:
    """Return the unit vector that a contact slides along with a velocity over its surface; see vlmb/core/contacts.py."""
    kept = last - (last @ normal) * normal
    size = float(np.linalg.norm(kept))
    kept = kept / size if size > 0.0 else kept
    speed = float(np.linalg.norm(moving))
    return moving / speed if any_way and speed > SLOW and moving @ kept > 0.0 else kept


def _of_ski(edge: Edge, footing: Footing, h: Heading, velocity: Array, multipliers: Array) -> list[float]:
    """Return the indicators of a closed ski: see `_looks_of_ski` of core_plan.py."""
    rows, local = ski_rows(footing.state == HELD, footing.first), ski_frame(h) @ velocity
    found, ratios, ways = [float(multipliers[0])], (edge.hold if edge.limited else 0.0, edge.friction), footing.towards[1::-1]
    for part in (EDGE, ALONG):
        if ratios[part] > 0.0 and part in rows:
            found.append(ratios[part] * float(multipliers[0]) - abs(float(multipliers[rows.index(part)])))
        elif ratios[part] > 0.0:
            found.append(math.copysign(float(local[part]), float(local[part]) * ways[part]))
    return found


def heading_at(q: Array) -> Heading:
    """Return the heading of a ski in Pinocchio's configuration."""
    size = math.hypot(q[2], q[3])
    return float(q[2]) / size, float(q[3]) / size


def held_by(
    point: ContactPoint, footing: Footing, t: float, place: Array, multipliers: Array, h: Heading = (1.0, 0.0)
) -> tuple[Array, Array]:
    """Return the force (3,) [N] on the mechanism of the rows of a closed contact, and its normal (3,)."""
    slope = point.slope(t, place, footing)
    return multipliers @ point.row_vectors(footing, slope, h), slope / float(np.linalg.norm(slope))


def force_of(
    point: ContactPoint, footing: Footing, t: float, place: Array, velocity: Array, multipliers: Array, h: Heading
) -> Array:
    """Return the force (3,) [N] of a closed contact on the mechanism, friction included, with its point at a place."""
    force, normal = held_by(point, footing, t, place, multipliers, h)
    if point.edge is not None:
        return force - float(force @ normal) * ski_way(h, footing.towards)
    if footing.state == SLIDING and point.contact.slips:
        moving = velocity - np.array(point.contact.surface_velocity)
        moving = moving - (moving @ normal) * normal
        way = way_of(np.array(footing.towards), moving, normal, all(point.names))
        force = force - point.coefficient * float(force @ normal) * way
    return force


def motion_of(point: ContactPoint, seen: Postures) -> tuple[Array, Array]:
    """Return places and velocities (N, 3) of a contact's point; of a stop the length and its rate."""
    if isinstance(point, StopPoint):
        link, _, which = point.contact.point.partition(".")
        i, side = [entry.name for entry in seen.layout.links].index(link), 0 if which == "lower" else 1
        found = np.zeros((2, len(seen.lengths), 3))
        found[0, :, 0], found[1, :, 0] = seen.lengths[:, i, side], seen.length_rates[:, i, side]
        return found[0], found[1]
    if point.contact.point == BASE:
        return seen.place, seen.velocity_of_place
    link, _, which = point.contact.point.partition(".")
    at = [entry.name for entry in seen.layout.links].index(link)
    return seen.position(at, which), seen.velocity(at, which)
