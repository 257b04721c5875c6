"""Looks: the colours of things that are drawn, and how parts of a body are told by the names of links."""

from __future__ import annotations

import re
from typing import NamedTuple

ROD, ROD_TOO, TELESCOPE, HINGE, MASS = "#2f6db3", "#5b9bd5", "#aab4bf", "#39424e", "#e08a3c"
SKI, STAND = "#c8313a", "#5c6670"
SNOW, SNOW_LINES, FLOOR, FLOOR_LINES = "#f4f8fb", "#cfdce6", "#e9ebee", "#c9ced4"
TRACK, TRAIL, PROGRAMME, EDGE_FORCE, GRAVITY = "#9db4c8", "#e08a3c", "#009e73", "#d55e00", "#333333"
SKIN, JACKET, SLEEVES, TROUSERS, BOOTS = "#e9bd95", "#c8313a", "#d9525a", "#27364b", "#4a4f57"


class Look(NamedTuple):
    """How the rod of a link is drawn."""

    colour: str
    thickness: float = 1.0  # factor on the radius its mass gives it
    width: float = 1.0  # factor across, to the sides
    depth: float = 1.0  # factor across, fore and aft
    round: bool = False  # a ball
    of_body: bool = True


PARTS = {
    r"head": Look(SKIN, round=True),
    r"neck|hand": Look(SKIN),
    r"trunk|torso|thorax|chest|abdomen|pelvis|spine|back": Look(JACKET, width=1.3, depth=0.77),
    r"thigh|shank|shin|leg|calf": Look(TROUSERS),
    r"arm": Look(SLEEVES),
    r"foot|feet|boot": Look(BOOTS),
    r"pole": Look(BOOTS, thickness=0.5),
}


def look_of(name: str, number: int = 0) -> Look:
    """Return the look of a link by its name; links that are no part of a body alternate by their number."""
    for pattern, look in PARTS.items():
        if re.search(pattern, name, re.IGNORECASE):
            return look
    return Look((ROD, ROD_TOO)[number % 2], of_body=False)
