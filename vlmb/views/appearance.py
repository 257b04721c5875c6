"""Looks: the colours of things that are drawn, and how parts of a body are told by the names of links."""

from __future__ import annotations

import re
from typing import NamedTuple

ROD, ROD_TOO, TELESCOPE, HINGE, MASS = "#2f6db3", "#5b9bd5", "#aab4bf", "#39424e", "#e08a3c"
SKI, STAND = "#c8313a", "#5c6670"
SNOW, SNOW_LINES, FLOOR, FLOOR_LINES = "#f4f8fb", "#cfdce6", "#e9ebee", "#c9ced4"
TRACK, TRAIL, PROGRAMME, EDGE_FORCE, GRAVITY = "#9db4c8", "#e08a3c", "#009e73", "#d55e00", "#333333"
CONTACT_FORCE, IMPULSE, FOOTPRINT = "#0072b2", "#cc79a7", "#7d8996"
SKIN, JACKET, SLEEVES, TROUSERS, BOOTS = "#e9bd95", "#c8313a", "#d9525a", "#3a588c", "#575e69"
HELMET, GOGGLES = "#e6e9ee", "#2b2f36"
STEEL, STRAP = "#c4cad1", "#22262c"
STRETCH = "#f0a030"  # segments that change their length


class Look(NamedTuple):
    """How the rod of a link is drawn."""

    colour: str
    part: str = ""  # of a person: body (all of it), legs, limb, trunk, neck, head, arm, foot, pole
    thickness: float = 1.0  # factor on the radius its mass gives it


class Theme(NamedTuple):
    """The surroundings of a page."""

    sky: str
    haze: str
    snow: str
    snow_lines: str
    floor: str
    floor_lines: str
    shadow: str
    sun: float
    ambient: float


LIGHT = Theme("#b0cde6", "#f1f6fa", SNOW, SNOW_LINES, FLOOR, FLOOR_LINES, "#c3d0db", 0.5, 0.6)
DARK = Theme("#0b1119", "#273341", "#33404e", "#465666", "#2a3038", "#414a55", "#222c37", 0.45, 0.55)
CHANGED = {GRAVITY: "#e8edf2", TRACK: "#5f7a92", BOOTS: "#7b8592", HINGE: "#7b8592", STAND: "#8b96a3"}  # by night

MACHINE, FAINT = "#5c6672", 0.3  # by night, what of a robot is darker than this

PARTS = {
    r"(^|_)(exo|bar|frame|brace)(_|$)": Look(STEEL, thickness=0.4),  # of a machine beside a body, whatever else it is named after
    r"^(body|skier|rider|jumper)$": Look(JACKET, "body"),
    r"head": Look(SKIN, "head"),
    r"neck": Look(SKIN, "neck"),
    r"trunk|torso|thorax|chest|abdomen|pelvis|spine|back(?!_)": Look(JACKET, "trunk"),
    r"thigh|shank|shin|calf": Look(TROUSERS, "limb"),
    r"leg": Look(TROUSERS, "legs"),
    r"hand": Look(SKIN, "arm"),
    r"arm": Look(SLEEVES, "arm"),
    r"foot|feet|boot": Look(BOOTS, "foot"),
    r"pole": Look(BOOTS, "pole", thickness=0.5),
}


def by_night(path: str, colour: str) -> str:
    """Return the colour of a body by night, an empty text where it keeps its own; robots change by their lightness alone."""
    if path.startswith("robots/"):
        return MACHINE if sum(int(colour[k : k + 2], 16) for k in (1, 3, 5)) < FAINT * 765.0 else ""
    return CHANGED.get(colour, "")


def look_of(name: str, number: int = 0) -> Look:
    """Return the look of a link by its name; links that are no part of a body alternate by their number."""
    for pattern, look in PARTS.items():
        if re.search(pattern, name, re.IGNORECASE):
            return look
    return Look((ROD, ROD_TOO)[number % 2])
