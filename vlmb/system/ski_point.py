"""The contact of a ski that may leave the snow, among the other contacts of a mechanism; see ski_contact.py."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vlmb.model.mechanism import Mechanism
from vlmb.model.names import AXES
from vlmb.scene.expressions import parse
from vlmb.system.contacts import HELD, RESTING, SLIDING, ContactPoint, Footing
from vlmb.system.ski_contact import (
    ALONG_ROW,
    EDGE_ROW,
    NORMAL_ROW,
    STANDS,
    Edge,
    Heading,
    contact_of,
    edge_of,
    ski_frame,
    ski_rows,
)
from vlmb.system.surface import ZERO, Surface, Vector

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SkiPoint(ContactPoint):
    """The point A of a ski."""

    snow: Edge

    @property
    def edge(self) -> Edge:
        """What snow holds of it."""
        return self.snow

    def slides(self, footing: Footing) -> bool:
        """Whether it skids, or slides along itself with friction."""
        return footing.state in (HELD, SLIDING) and any(footing.towards)

    @property
    def shares(self) -> bool:
        """Whether it may carry a load together with others."""
        return True

    def mode(self, footing: Footing) -> tuple[object, ...]:
        """Return what of a footing the equations of a phase depend on, beside numbers."""
        return footing.state, footing.towards, footing.first

    def row_texts(self, footing: Footing) -> tuple[str, ...]:
        """Return the equations that hold it: up, across, along."""
        if footing.state not in (HELD, SLIDING):
            return ()
        return tuple((EDGE_ROW, ALONG_ROW, NORMAL_ROW)[row] for row in ski_rows(footing.state == HELD, footing.first))

    def row_vectors(self, footing: Footing, slope: Array, h: Heading = (1.0, 0.0)) -> Array:
        """Return the gradients (rows, 3) of these over its place, with the heading h."""
        rows = ski_rows(footing.state == HELD, footing.first) if footing.state != RESTING else []
        found: Array = ski_frame(h)[rows]
        return found

    def footing_at(
        self, state: str, t: float, place: Array, plane: bool, towards: Vector = ZERO, before: Footing | None = None
    ) -> Footing:
        """Return its footing at a place [m]: it stands where there is friction and it does not slide along itself."""
        stands = STANDS if self.snow.friction > 0.0 and not towards[0] else ZERO
        return Footing(state, (float(place[0]), float(place[1]), float(place[2])), stands, ZERO, t, 0.0, towards)

    def numbers(self, footing: Footing) -> dict[str, float]:
        """Return the parameter of its equations in a phase."""
        return {self.parameter("gap"): footing.gap}


def ski_points(mechanism: Mechanism, first: int) -> tuple[SkiPoint, ...]:
    """Return the contact of a ski that lifts, as the one after so many others; none for any other base."""
    scene = mechanism.scene
    if not scene.base.lift:
        return ()
    edge = edge_of(scene.base)
    return (SkiPoint(first, contact_of(edge), tuple(AXES), Surface(parse("z", "base.lift"), scene.parameters), edge),)
