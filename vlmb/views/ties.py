"""What holds links beside others together: bars to hinges that hang aside, and straps between points that ideal rows tie."""

from __future__ import annotations

import math
import re

import numpy as np
from numpy.typing import NDArray

from vlmb.model.mechanism import Mechanism
from vlmb.model.names import POINTS
from vlmb.model.reading import Postures
from vlmb.views import appearance, shapes
from vlmb.views.bodies import Body

Array = NDArray[np.float64]

TIE = re.compile(rf"(?:\w+:)?\s*(\w+)\.({'|'.join(POINTS)})\.([xz])\s*=\s*(\w+)\.({'|'.join(POINTS)})\.([xz])")
LEFT = np.column_stack([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # takes x to the left


def draw_ties(mechanism: Mechanism, seen: Postures, size: float) -> list[Body]:
    """Draw, in a plane, a bar to each hinge that is aside, and a strap where x and z of points of two links are one."""
    scene = mechanism.scene
    if not scene.plane or not any(link.aside for link in scene.links):
        return []
    found = [
        _across(f"beside_{link.name}", seen.position(i, "hinge"), -link.aside, 0.008 * size, appearance.HINGE)
        for i, link in enumerate(scene.links)
        if link.aside
    ]
    tied: dict[tuple[str, str, str, str], set[str]] = {}
    for row in filter(None, (TIE.fullmatch(text.strip()) for text in scene.constraints)):
        if row[3] == row[6]:
            tied.setdefault((row[1], row[2], row[4], row[5]), set()).add(row[3])
    for (one, point, other, there), axes in tied.items():
        links = mechanism.names.links
        start = seen.position(links[one], point)
        way = float(np.max(seen.position(links[other], there)[..., 1] - start[..., 1]))
        if len(axes) == 2 and way:
            found.append(_across(f"strap_{one}_{other}", start, way, 0.014 * size, appearance.STRAP))
    return found


def _across(name: str, start: Array, way: float, radius: float, colour: str) -> Body:
    """A bar from a point so far to the left."""
    turned = LEFT if way > 0.0 else LEFT @ np.diag([-1.0, -1.0, 1.0])
    return Body(name, shapes.tube(radius), colour, start, turned, np.array([math.fabs(way), 1.0, 1.0]))
