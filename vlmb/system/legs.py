"""Massless legs of a system: points that may stand on a foothold, with a spring that pushes or a length that a law gives.

A leg with a spring is a force of the phase's scene while it stands; one with a law is a smooth contact of its point with the
sphere around its foot, whose normal force is the leg's. Neither has a state while it swings.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vlmb.model.laws import Law, time_law
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import AXES
from vlmb.scene.expressions import parse
from vlmb.scene.legs import Standing, index_of, law_text, place_names, swing_gap_text
from vlmb.scene.tables import BASE, Contact, Leg
from vlmb.system.contacts import HELD, LIGHT, OPEN, SLIDING, STANDING, ContactPoint, Footing, Look
from vlmb.system.events import CONTACT, FALLING, LETS_GO, LIMIT, TIPS, Event
from vlmb.system.ski_contact import Heading
from vlmb.system.surface import ZERO, Surface, Vector

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LegPoint(ContactPoint):
    """One leg of a mechanism."""

    leg: Leg
    plane: bool
    parameters: tuple[tuple[str, float], ...] = field(repr=False)  # of the scene

    def law(self, law: float | str, since: float | None = None) -> Law:
        """Return one of its laws, with `phase_t` as the time since a number [s]; as 0 without."""
        return _law_of(law_text(law, "" if since is None else repr(float(since))), self.parameters, f"legs of {self.name}")

    @property
    def sprung(self) -> bool:
        """Whether a spring pushes, not a law."""
        return self.leg.law is None

    @property
    def lands(self) -> bool:
        """Whether it comes down again."""
        return self.leg.attack is not None

    @property
    def moving(self) -> bool:
        """Whether its length may do work on its own."""
        return not self.sprung and "t" in self.law(self.leg.reach, 0.0).expression.names

    @property
    def carried(self) -> str:
        """Name of the work state of what its law does."""
        return f"leg {self.name}"

    @property
    def standing(self) -> Standing:
        """Its texts, with the foot at a phase's parameters."""
        x, y, z = (self.parameter(axis) for axis in AXES)
        return Standing(self.leg, self.plane, (x, y, z))

    def closed(self, footing: Footing) -> bool:
        """Whether it stands."""
        return footing.state in (SLIDING, STANDING)

    def shown(self, footing: Footing) -> str:
        """Return how it stands, as events tell it: held or open."""
        return HELD if self.closed(footing) else OPEN

    @property
    def plain(self) -> None:
        """None: its surface is where its foot has it."""
        return None

    def slope(self, t: float, place: Array, footing: Footing) -> Array:
        """Return the unit vector (3,) from its foot to its point at a place."""
        away = np.asarray(place) - np.array(footing.place)
        return away / max(float(np.linalg.norm(away)), 1e-300)

    def gap_text(self, footing: Footing) -> str:
        """Return what is 0 where it lands, and, while a law holds its length, what that keeps at 0."""
        if not self.closed(footing):
            return swing_gap_text(self.leg, self.plane, self.parameter("t"))
        return f"{self.standing.length} - {self.reach_text(footing)}"

    def reach_text(self, footing: Footing) -> str:
        """Return its length by its law, or at rest."""
        return law_text(self.leg.reach, self.parameter("t") if self.closed(footing) else "")

    def row_texts(self, footing: Footing) -> tuple[str, ...]:
        """Return the equation of its law while it stands."""
        return (f"{self.gap_text(footing)} = 0",) if footing.state == SLIDING else ()

    def looks(self, footing: Footing) -> tuple[Look, ...]:
        """Return what is looked at: that it has a length, that its force is in the cone of friction, that its spring pushes."""
        found, leg = list[Look](), self.leg
        name = f"the leg {self.name!r}"
        if not self.sprung:
            short = Event(LIMIT, FALLING, self.name, f"the law of {name} makes it shorter than 0", slack=0.0)
            found.append(Look(parse(self.reach_text(footing), "legs"), short))
        if self.closed(footing):
            down = f"the point of {name} came down to its foot: no leg is shorter than 0; take a stiffer one"
            found.append(Look(parse(self.standing.height, "legs"), Event(LIMIT, FALLING, self.name, down, slack=0.0)))
            if leg.friction != "rough":
                found.append(Look(parse(self.standing.grip, "legs"), Event(CONTACT, FALLING, TIPS, "", self.index)))
            if self.sprung:
                light = LIGHT * leg.stiffness * float(leg.length or 0.0)
                off = Event(CONTACT, FALLING, LETS_GO, "", self.index, slack=light)
                found.append(Look(parse(self.standing.force, "legs"), off))
        return tuple(found)

    def foot_at(self, t: float, place: Array, footing: Footing) -> Vector:
        """Return where its foot is when it lands with its point at a place [m]."""
        x, y, _ = self.hangs_to(t, place, footing)
        return x, y, 0.0

    def hangs_to(self, t: float, place: Array, footing: Footing) -> Vector:
        """Return where its foot is while it swings; of one that never lands below its point."""
        length, heading = self.law(self.leg.reach).value(t), self.law(self.leg.heading, footing.since).value(t)
        attack = 0.5 * np.pi if self.leg.attack is None else self.law(self.leg.attack, footing.since).value(t)
        ahead = length * np.cos(attack)
        y = 0.0 if self.plane else float(place[1] + ahead * np.sin(heading))
        return float(place[0] + ahead * np.cos(heading)), y, float(place[2] - length * np.sin(attack))

    def footing_at(
        self, state: str, t: float, place: Array, plane: bool, towards: Vector = ZERO, before: Footing | None = None
    ) -> Footing:
        """Return the footing of a leg that stands; its foot is where it is before."""
        return Footing(state, before.place if before else ZERO, since=t)

    def let_go(self, t: float, gap: float, before: Footing) -> Footing:
        """Return the footing of a leg that lets go: its foot stays known."""
        return Footing(place=before.place, since=t)

    def numbers(self, footing: Footing) -> dict[str, float]:
        """Return the parameters of its equations in a phase: where its foot is, or was, and whether it stands."""
        found = {self.parameter("gap"): 0.0, self.parameter("t"): footing.since}
        found |= {self.parameter(axis): at for axis, at in zip(AXES, footing.place, strict=True)}
        return found | ({self.parameter("stands"): 1.0} if self.closed(footing) else {})

    def row_vectors(self, footing: Footing, slope: Array, h: Heading = (1.0, 0.0)) -> Array:
        """Return the gradient (1, 3) of its row over the point's place."""
        return slope[None]

    def gap_jet(self, t: float, jet: Array, footing: Footing) -> Array:
        """Return how much longer (3,) [m] it is than its law has it, with two derivatives; jet (4, 3) of its point."""
        away, v, a = jet[:3, 0] - np.array(footing.place), jet[:3, 1], jet[:3, 2]
        length = max(float(np.linalg.norm(away)), 1e-300)
        rate = float(away @ v) / length
        second = (float(v @ v) + float(away @ a) - rate * rate) / length
        return np.array([length, rate, second]) - np.array(self.law(self.leg.reach, footing.since).jet(t))

    def grips(self, place: Array, footing: Footing) -> bool:
        """Whether a force from its foot to a place is in the cone of friction."""
        away = np.asarray(place) - np.array(footing.place)
        return self.leg.friction == "rough" or bool(np.hypot(away[0], away[1]) <= float(self.leg.friction) * away[2])

    def pushes(self, place: Array, velocity: Array, footing: Footing) -> float:
        """Return the force [N] of spring and damper along foot -> point, of one that stands."""
        away = np.asarray(place) - np.array(footing.place)
        length = float(np.linalg.norm(away))
        return self.leg.stiffness * (float(self.leg.length or 0.0) - length) - self.leg.damping * float(away @ velocity) / length

    def stored(self, places: Array, footing: Footing) -> Array:
        """Return the energy (...) [J] of its spring with the point at places (..., 3)."""
        if footing.state != STANDING:
            return np.zeros(np.shape(places)[:-1])
        off = np.linalg.norm(np.asarray(places) - np.array(footing.place), axis=-1) - float(self.leg.length or 0.0)
        return np.asarray(0.5 * self.leg.stiffness * off**2)


def leg_points(mechanism: Mechanism) -> tuple[LegPoint, ...]:
    """Read the legs of a mechanism. Raises SceneError for points that are none."""
    scene, found = mechanism.scene, []
    for k, leg in enumerate(scene.legs):
        key = f"legs[{k}]"
        if leg.from_ != BASE:
            mechanism.names.point(leg.from_, f"{key}.from")
        contact, names = Contact(point=leg.from_, name=leg.name, friction=0.0), place_names(leg.from_, scene.plane)
        parameters = tuple(scene.parameters.items())
        found.append(LegPoint(index_of(scene, k), contact, names, Surface(parse("z"), {}), leg, scene.plane, parameters))
    return tuple(found)


@functools.lru_cache(maxsize=512)
def _law_of(text: str, parameters: tuple[tuple[str, float], ...], key: str) -> Law:
    return time_law(text, dict(parameters), key)
