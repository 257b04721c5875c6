"""The contact of a ski that may leave the snow: its point A, its edge across, its length along.

While it is closed it has the row z = 0; one across while its edge holds; one along while friction keeps it standing. What skids
or slides pushes by the multiplier of the first: `towards` of its footing has these ratios, ahead and to the left of the ski.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.scene.tables import BASE, Base, Contact

Array = NDArray[np.float64]
Heading = tuple[float, float]  # its cosine and sine

SKI, NORMAL_ROW = "ski", "z = 0"
EDGE_ROW, ALONG_ROW = "y_dot*cos(phi0) - x_dot*sin(phi0) = 0", "speed = 0"
EDGE, ALONG = 0, 1  # parts of the contact: grips in this order
STANDS = (1.0, 0.0, 0.0)  # `first` of a footing


class Edge(NamedTuple):
    """What snow holds of a ski: ratios to the normal force."""

    hold: float  # of the edge force; infinite where there is no limit
    skid: float  # of the edge force while it skids
    friction: float  # along the ski

    @property
    def limited(self) -> bool:
        """Whether it may skid."""
        return math.isfinite(self.hold)

    @property
    def slips(self) -> bool:
        """Whether there is friction that takes energy."""
        return self.limited or self.friction > 0.0


def edge_of(base: Base) -> Edge:
    """Return what a scene says of a ski."""
    hold = math.inf if base.hold is None else float(base.hold)
    return Edge(hold, hold if base.skid is None else float(base.skid), float(base.friction))


def contact_of(edge: Edge) -> Contact:
    """Return the contact as the others are."""
    return Contact(point=BASE, name=SKI, friction=1.0 if edge.slips else 0.0)


def ski_frame(h: Heading) -> Array:
    """Return unit vectors (3, 3) as rows: to the left, ahead, up."""
    c, s = h
    return np.array([[-s, c, 0.0], [c, s, 0.0], [0.0, 0.0, 1.0]])


def ski_rows(holds: bool, first: tuple[float, float, float]) -> list[int]:
    """Return which of the rows of `ski_frame` hold a closed ski: up first."""
    return [2, *([EDGE] if holds else []), *([ALONG] if first == STANDS else [])]


def ski_way(h: Heading, towards: tuple[float, float, float]) -> Array:
    """Return the ratios of skidding and sliding as a vector (3,) of the surface frame."""
    frame = ski_frame(h)
    return towards[0] * frame[ALONG] + towards[1] * frame[EDGE]
