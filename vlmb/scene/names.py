"""Names in a scene: one space of them for links and rows, and what has a meaning of its own."""

from __future__ import annotations

import re
from collections.abc import Iterable

from vlmb.errors import SceneError
from vlmb.scene.rows import SceneRows
from vlmb.scene.tables import BASE, Link

OWN = "the base's own"
SNOW = "that of a force of the snow"
RESERVED = {
    BASE: OWN, "ski": OWN, "heading": OWN, "ground": "that of the ground", "com": "that of the whole centre of mass",
    "speed": "that of the ski's speed", "normal": SNOW, "friction": SNOW, "knife_edge": SNOW, "roll_moment": SNOW,
    "pitch_moment": SNOW, "impacts": "that of impacts", "t": "that of time", "phase_t": "that of time in a phase",
}  # fmt: skip
COORDINATE = r"(x|y|z|phi\d+|psi\d+|xi\d+_[12])(_dot)?"
FORCE = r"F\d+_[12]|F_[xyz]|M_(phi|psi)\d+|T_\w+|R_\w+"
REACTION = "knife_edge|normal|friction|roll_moment|pitch_moment|impacts"
ENERGY = "kinetic|potential|spring|energy|work|dissipated|dissipation|balance"
KINDS = {COORDINATE: "a coordinate", FORCE: "a force", REACTION: "a reaction", ENERGY: "an energy"}


def kind_of(name: str) -> str | None:
    """Say what a name is by its form: a coordinate (or its rate), a force, a reaction, an energy; None for any other."""
    return next((kind for pattern, kind in KINDS.items() if re.fullmatch(pattern, name)), None)


def why_not(name: str) -> str:
    """Say why an expression may not use a name, where it is that of a result; nothing for any other."""
    kind = kind_of(name)
    if kind in (None, "a coordinate"):
        return ""
    return f"{name} is {kind}, a result: laws and equations may not name forces, reactions or energies, which follow from them"


def check_names(links: Iterable[Link], rows: SceneRows) -> None:
    """Refuse names that are reserved, or given twice. Raises SceneError naming both places.

    Rows without a name may repeat each other: they are the same equation.
    """
    places: dict[str, str] = {}

    def take(name: str, key: str, shown: str) -> None:
        if name in RESERVED:
            raise SceneError(f"{shown}: this name is {RESERVED[name]}; choose another")
        if name in places:
            raise SceneError(f"{shown}: {places[name]} has this name already")
        places[name] = key

    for index, link in enumerate(links):
        take(link.name, f"links[{index}]", f"links[{index}].name = {link.name!r}")
    for row in (*rows.ideal, *rows.servo, *rows.secondary):
        if not row.named:
            continue
        kind = kind_of(row.name)
        if kind and row.name not in RESERVED:
            raise SceneError(f"{row.key}: the row's name {row.name!r} is that of {kind}; choose another")
        take(row.name, row.key, f"{row.key}: the row's name {row.name!r}")
