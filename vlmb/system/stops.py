"""Limits of lengths that are stops: smooth contacts of a length with its bound, by the names of the length.

The length stands where a contact has the x of its point; it has no y and no z.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from vlmb.model.mechanism import Mechanism
from vlmb.model.names import force_along, quantity_of
from vlmb.scene.expressions import parse
from vlmb.scene.tables import BOUNCE, Contact
from vlmb.system.contacts import ContactPoint, contact_points
from vlmb.system.legs import leg_points
from vlmb.system.ski_point import ski_points
from vlmb.system.surface import Surface


@dataclass(frozen=True, eq=False)
class StopPoint(ContactPoint):
    """One end of the range of a length."""

    force: str  # along the length


def stop_points(mechanism: Mechanism) -> tuple[StopPoint, ...]:
    """Return the stops of a mechanism, the lower one of a length first."""
    found, first = list[StopPoint](), len(mechanism.scene.contacts) + len(mechanism.scene.legs)
    for c in mechanism.layout.coordinates:
        if c.kind != "xi" or mechanism.segment(c).at_limit != BOUNCE:
            continue
        segment, length = mechanism.segment(c), mechanism.names.meaning(quantity_of(c))
        for end, bound in zip(("min", "max"), segment.bounds, strict=True):
            if math.isfinite(bound):
                surface = f"x - {bound!r}" if end == "min" else f"{bound!r} - x"
                contact = Contact(
                    point=length, name=f"{length}.{end}", surface=surface, friction=0.0, restitution=segment.restitution
                )  # fmt: skip
                names = (c.name, "", "")
                found.append(StopPoint(first + len(found), contact, names, Surface(parse(surface), {}), force_along(c)))
    return tuple(found)


def all_points(mechanism: Mechanism) -> tuple[ContactPoint, ...]:
    """Return the contacts of a mechanism, then its legs, its stops, a ski that lifts. Raises SceneError, ExpressionError."""
    others = (*contact_points(mechanism), *leg_points(mechanism), *stop_points(mechanism))
    return (*others, *ski_points(mechanism, len(others)))
