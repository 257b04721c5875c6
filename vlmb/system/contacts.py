"""Contacts of a system: their surfaces, and what the scene of a phase has beside that of the run: rows of what is closed.

A phase is a scene of its own: each held contact adds the row of its surface and rows across it, each sliding one that of its
surface. Where a point stands comes in as parameters, so that what is compiled for a set of closed contacts serves them anywhere.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from vlmb.core.contacts import SLOW
from vlmb.errors import SceneError
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import AXES
from vlmb.scene.by_phase import acts, is_conditional, programme_at
from vlmb.scene.contacts import surface_of
from vlmb.scene.expressions import Expression, parse
from vlmb.scene.legs import parameter, place_names
from vlmb.scene.names import PHASE_START
from vlmb.scene.scene import Scene, with_values
from vlmb.scene.tables import BASE, Contact, Force
from vlmb.system.events import Event
from vlmb.system.ski_contact import Edge, Heading
from vlmb.system.surface import ACROSS_PLAIN, OF_PLAIN, PLAIN, UNIT, ZERO, Surface, Vector, axes_at, vector

Array = NDArray[np.float64]

# AWAY: open, and blind until its gap has been positive; STANDING: a leg whose spring pushes, which no row holds
# RESTING: closed, and carries nothing, since others hold it where it is
OPEN, AWAY, HELD, SLIDING, STANDING, RESTING = "open", "away", "held", "sliding", "standing", "resting"
CLOSED = (HELD, SLIDING, RESTING)  # with rows, or with those of others
UNDER = 1e-12  # [m] a gap that counts as none where a phase begins
ROUNDED = 1e-14  # [m] what rounding makes of a gap: one that opens at a speed of nothing would touch again in the same instant
STILL = 1e-9  # [m/s] a speed that counts as none
TURNING = 10.0 * SLOW  # [m/s] the speed of a contact at a right angle to where it slid, with which it turns and does not stop
LIGHT = 1e-9  # of the weight: a normal force that counts as none where another has reached 0


class Footing(NamedTuple):
    """What is known of one contact in a phase."""

    state: str = OPEN
    place: Vector = ZERO  # [m] where the point stood when the phase began
    first: Vector = ZERO  # unit vectors across the surface, of a held contact
    second: Vector = ZERO
    since: float = 0.0  # [s]
    gap: float = 0.0  # [m] that counts as none, of one that has just opened: what its rows left
    towards: Vector = ZERO  # unit vector that it slides along
    planted: bool = False  # it holds the point of a free base, whose velocities are crossed out for it: it has no rows


def by_rows(footing: Footing) -> Footing:
    """Return a footing that rows hold, at the root too: for those who look at rows."""
    return footing._replace(planted=False)


class ContactLook(NamedTuple):
    """What an engine sees of contacts at an instant."""

    jets: Array  # (contacts, 4, 3) x, y, z of the point and the gap, each with two derivatives
    multipliers: Array  # of the scene's own ideal rows, then of those of closed contacts
    ways: Array  # (closed, 3) unit vectors that they slide along
    rates: Array  # y'
    ground: Array = np.zeros(3)  # [N] of the ground on a planted base


class Look(NamedTuple):
    """An expression whose fall through 0 is an event."""

    expression: Expression
    event: Event


@dataclass(frozen=True, eq=False)
class ContactPoint:
    """One contact of a mechanism."""

    index: int
    contact: Contact
    names: tuple[str, ...]  # of the point's x, y, z; "" where the plane has none
    surface: Surface = field(repr=False)

    @property
    def name(self) -> str:
        """Its name."""
        return self.contact.name

    @property
    def smooth(self) -> bool:
        """Whether it has no friction."""
        return self.contact.friction == 0.0

    @property
    def rough(self) -> bool:
        """Whether it never slips."""
        return self.contact.friction == "rough"

    @property
    def coefficient(self) -> float:
        """Friction while it slides; infinite where it is rough."""
        return np.inf if self.contact.friction == "rough" else float(self.contact.friction)

    @property
    def at_rest(self) -> float:
        """Friction while it does not slip."""
        static = self.contact.friction_static
        return self.coefficient if static is None else float(static)

    @property
    def edge(self) -> Edge | None:
        """What snow holds of a ski; None for any other contact."""
        return None

    @cached_property
    def plain(self) -> int | None:
        """Which of x, y and z is its distance from its surface; None where none is."""
        return PLAIN.get(self.contact.surface.strip())

    def slides(self, footing: Footing) -> bool:
        """Whether it slides with friction."""
        return footing.state == SLIDING and self.contact.slips

    def mode(self, footing: Footing) -> tuple[object, ...]:
        """Return what of a footing the equations of a phase depend on, beside numbers."""
        return footing.state, footing.planted

    @property
    def shares(self) -> bool:
        """Whether it may carry a load together with others."""
        return type(self) is ContactPoint

    @property
    def moving(self) -> bool:
        """Whether its surface moves, and may do work."""
        return any(self.contact.surface_velocity) or "t" in self.surface.expression.names

    @cached_property
    def plants(self) -> bool:
        """Whether it holds the point of a free base where it is once it holds."""
        return self.shares and self.edge is None and self.contact.point == BASE and not self.moving

    @property
    def lands(self) -> bool:
        """Whether it may touch."""
        return True

    @property
    def carried(self) -> str:
        """Name of the work state of what its moving surface does."""
        return f"surface {self.name}"

    def closed(self, footing: Footing) -> bool:
        """Whether it touches."""
        return footing.state in CLOSED

    def shown(self, footing: Footing) -> str:
        """Return how it stands, as events tell it: open, held or sliding."""
        return HELD if footing.state == RESTING else footing.state if footing.state in CLOSED else OPEN

    def parameter(self, what: str) -> str:
        """Name a number of a phase as its equations do; no scene can have such a name."""
        return parameter(what, self.index)

    def gap(self, t: float, place: Array) -> float:
        """Return the distance [m] of a place from its surface, below 0 inside."""
        if self.plain is not None:
            return float(place[self.plain])
        value, slope = self.surface.at(t, place)
        return value / max(float(np.linalg.norm(slope)), 1e-300)

    def slope(self, t: float, place: Array, footing: Footing) -> Array:
        """Return the gradient (3,) of its surface at a place."""
        return self.surface.at(t, place)[1] if self.plain is None else UNIT[self.plain]

    def steepness(self, t: float, place: Array, footing: Footing) -> tuple[Array, float]:
        """Return the unit normal (3,) of its surface at a place, and the size of its gradient there.

        Raises SceneError for a surface without a slope.
        """
        if self.plain is not None:
            return UNIT[self.plain], 1.0
        slope = self.slope(t, place, footing)
        size = math.sqrt(slope.dot(slope))
        if not size > 1e-12 or not math.isfinite(size):
            where = ", ".join(f"{value:.4g}" for value in place)
            raise SceneError(f"contacts[{self.index}].surface = {self.contact.surface!r}: has no slope at ({where})")
        return slope / size, size

    def normal(self, footing: Footing) -> Array:
        """Return the unit normal (3,) of its surface where it stands."""
        return self.steepness(footing.since, np.array(footing.place), footing)[0]

    def frame(self, t: float, place: Array, plane: bool, footing: Footing) -> tuple[Array, float]:
        """Return unit vectors (3, 3) as rows, two across the surface, then its normal; and the size of its gradient.

        In a plane the first is the one in it. Raises SceneError for a surface without a slope there.
        """
        if self.plain is not None:
            return OF_PLAIN[self.plain, plane], 1.0
        normal, size = self.steepness(t, place, footing)
        return axes_at(normal, plane), size

    def gap_text(self, footing: Footing) -> str:
        """Return the equation's side that is 0 on the surface, by the mechanism's names."""
        named = {axis: name or "0" for axis, name in zip(AXES, self.names, strict=True)}
        return re.sub(r"(?<![\w.])([xyz])(?![\w.(])", lambda found: named[found[1]], self.contact.surface)

    def row_texts(self, footing: Footing) -> tuple[str, ...]:
        """Return the equations that it adds while it is closed: its surface first, then what holds it across."""
        if footing.state not in (HELD, SLIDING) or footing.planted:
            return ()
        texts = [f"{self.gap_text(footing)} = 0"]
        if footing.state != HELD:
            return tuple(texts)
        velocity, since = self.contact.surface_velocity, self.parameter("t")
        away = []
        for axis, (name, speed) in enumerate(zip(self.names, velocity, strict=True)):
            start = self.parameter(AXES[axis])
            drift = f" - {speed!r}*(t - {since})" if speed else ""
            away.append(f"({name} - {start}{drift})" if name else "")
        if self.plain is not None:
            across = [axis for axis in range(3) if axis != self.plain and away[axis]]
            return (*texts, *(f"{away[axis]} = 0" for axis in across))
        for which in "ab"[: 1 + all(self.names)]:
            shares = [f"{self.parameter(which + AXES[axis])}*{away[axis]}" for axis in range(3) if away[axis]]
            texts.append(f"{' + '.join(shares)} = 0")
        return tuple(texts)

    def looks(self, footing: Footing) -> tuple[Look, ...]:
        """Return what is looked at after a step beside gaps, and normal forces and friction of rows."""
        return ()

    def footing_at(
        self, state: str, t: float, place: Array, plane: bool, towards: Vector = ZERO, before: Footing | None = None
    ) -> Footing:
        """Return the footing of a contact that closes, or goes on, at a place [m]; `before`: what it was."""
        if self.plain is not None:
            first, second = ACROSS_PLAIN[self.plain, plane]
        else:
            first, second, _ = map(vector, self.frame(t, place, plane, before or Footing())[0])
        return Footing(state, vector(place), first, second, t, 0.0, towards, state == HELD and self.plants)

    def let_go(self, t: float, gap: float, before: Footing) -> Footing:
        """Return the footing of a contact that opens with a gap [m]."""
        return Footing(gap=min(gap, 0.0) - ROUNDED)

    def numbers(self, footing: Footing) -> dict[str, float]:
        """Return the parameters of its equations in a phase."""
        found = {self.parameter("gap"): footing.gap}
        if footing.state == HELD:
            found |= {self.parameter("t"): footing.since}
            for axis, name in enumerate(AXES):
                found |= {self.parameter(name): footing.place[axis], self.parameter("a" + name): footing.first[axis]}
                found[self.parameter("b" + name)] = footing.second[axis]
        return found

    def row_vectors(self, footing: Footing, slope: Array, h: Heading = (1.0, 0.0)) -> Array:
        """Return the gradients (rows, 3) over the point's place of the rows of a closed contact, in their order; h of a ski."""
        if footing.state == RESTING or footing.planted:
            return np.zeros((0, 3))
        if footing.state != HELD:
            return slope[None]
        return np.vstack([slope[None], np.array([footing.first, footing.second][: 1 + all(self.names)])])


def contact_points(mechanism: Mechanism) -> tuple[ContactPoint, ...]:
    """Read the contacts of a mechanism. Raises SceneError for points that are none, ExpressionError for surfaces."""
    scene, names, found = mechanism.scene, mechanism.names, []
    for index, contact in enumerate(scene.contacts):
        key = f"contacts[{index}]"
        if contact.point != BASE:
            names.point(contact.point, f"{key}.point")
        parts = place_names(contact.point, scene.plane)
        surface = surface_of(contact, scene.parameters, key)
        if scene.plane and "y" in surface.names:
            raise SceneError(f"{key}.surface = {contact.surface!r}: names y, which a scene in the plane has not")
        found.append(ContactPoint(index, contact, parts, Surface(surface, scene.parameters)))
    return tuple(found)


def closed_names(points: Sequence[ContactPoint], footings: Sequence[Footing]) -> frozenset[str]:
    """Return the names of closed contacts and of legs that stand."""
    return frozenset(point.name for point, at in zip(points, footings, strict=True) if point.closed(at))


def phase_scene(
    scene: Scene, points: Sequence[ContactPoint], footings: Sequence[Footing], bare: bool = False, began: float = 0.0,
    closed: Collection[str] | None = None,
) -> Scene:  # fmt: skip
    """Return the scene of a phase: with the rows of closed contacts; `bare`: without forces and a programme.

    It is not completed again: no user sees it. began : [s] when `phase_t` was 0; closed : what programmes and forces go by,
    where the rows of it are not wanted. Raises SceneError where two programmes that act at once do not go together.
    """
    closed = closed_names(points, footings) if closed is None else closed
    rows = [text for point, at in zip(points, footings, strict=True) for text in point.row_texts(at)]
    numbers = {name: value for point, at in zip(points, footings, strict=True) for name, value in point.numbers(at).items()}
    changes: dict[str, object] = {
        "constraints": (*scene.constraints, *rows), "parameters": {**scene.parameters, **numbers, PHASE_START: began},
        "programme": None if bare else programme_at(scene, closed), "programmes": (),
        "forces": () if bare else tuple(always(force) for force in scene.forces if acts(force, closed)),
    }  # fmt: skip
    return with_values(scene, changes)


def always(force: Force) -> Force:
    """Return a force that does not go by phases."""
    return msgspec.structs.replace(force, closed=(), open=()) if is_conditional(force) else force


def work_names_of(points: Sequence[ContactPoint]) -> tuple[str, ...]:
    """Return the names of the work states that contacts bring."""
    found = [f"friction {point.name}" for point in points if point.contact.slips]
    found += [point.carried for point in points if point.moving]
    return (*found, "impacts") if points else ()


@dataclass(frozen=True, eq=False)
class PhaseContacts:
    """The contacts of a scene as they are in a phase, and where the rows of the closed ones begin among its constraints."""

    points: tuple[ContactPoint, ...]
    footings: tuple[Footing, ...]
    own: int  # constraints of the scene itself
    works: tuple[str, ...]  # of all work states
    began: float = 0.0  # [s]

    @property
    def closed(self) -> list[tuple[ContactPoint, Footing, int, int]]:
        """List the closed contacts with the first of their rows, counted from the scene's own constraints on, and how many."""
        found, at = [], self.own
        for point, footing in zip(self.points, self.footings, strict=True):
            if footing.state in CLOSED:
                count = len(point.row_texts(footing))
                found.append((point, footing, at, count))
                at += count
        return found

    @property
    def planted(self) -> bool:
        """Whether one of them holds the point of a free base."""
        return any(footing.planted for footing in self.footings)

    @property
    def roots(self) -> list[Expression]:
        """Return place and gap of every contact as expressions, four each, for a tape."""
        found = []
        for point, footing in zip(self.points, self.footings, strict=True):
            found += [parse(name or 0.0, "contacts") for name in point.names]
            found.append(parse(f"{point.gap_text(footing)} - {point.parameter('gap')}", "contacts"))
        return found

    @property
    def looks(self) -> list[Look]:
        """Return what is looked at after a step beside gaps, and normal forces and friction of rows."""
        return [look for point, footing in zip(self.points, self.footings, strict=True) for look in point.looks(footing)]

    def numbers(self) -> dict[str, float]:
        """Return the parameters of their equations."""
        found = {PHASE_START: self.began}
        for point, footing in zip(self.points, self.footings, strict=True):
            found |= point.numbers(footing)
        return found

    def work_of(self) -> dict[str, str]:
        """Return the work state of each of these rows, by its text, where it may do work."""
        return {
            text: point.carried for point, footing, _, _ in self.closed for text in point.row_texts(footing) if point.moving
        }
