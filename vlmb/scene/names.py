"""Names in a scene: one space of them for links, rows and data, and what has a meaning of its own."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from vlmb.errors import SceneError
from vlmb.scene.rows import SceneRows
from vlmb.scene.tables import ALLOWED_NAME, BASE, MAX_NAME, NAME, Contact, Link

SNOW = {"knife_edge": "N", "normal": "N", "roll_moment": "N m", "pitch_moment": "N m"}  # forces of the snow on a ski, and units
ENERGIES = ("kinetic", "potential", "spring", "energy", "work", "dissipated", "balance")  # [J], of a run
DAMPERS = "dissipation"  # the work state of all that is lost
OWN, OF_SNOW = "the base's own", "that of a force of the snow"
RESERVED = {
    BASE: OWN, "ski": OWN, "heading": OWN, "ground": "that of the ground", "com": "that of the whole centre of mass",
    "speed": "that of the ski's speed", **dict.fromkeys((*SNOW, "friction"), OF_SNOW), "impacts": "that of impacts",
    "t": "that of time", "phase_t": "that of time in a phase",
}  # fmt: skip
PHASE_TIME, PHASE_START = "phase_t", "phase.start"  # a name of laws, and the parameter of a phase that it goes by
SHOWN, WIDTH = 6, 32  # names in a list for people, and characters of each
COORDINATE = r"(x|y|z|phi\d+|psi\d+|xi\d+_[12])(_dot)?"
FORCE = r"F\d+_[12]|F_[xyz]|M_(phi|psi)\d+|T_\w+|R_[\w.]+"
CONTACT_FORCE = r"\.force\.[xyz]\b"  # of a contact, as secondary rows name it: left.force.z
REACTION = "|".join((*SNOW, "friction", "impacts"))
ENERGY = "|".join((*ENERGIES, DAMPERS))
KINDS = {COORDINATE: "a coordinate", FORCE: "a force", REACTION: "a reaction", ENERGY: "an energy"}
CONTROLS = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


def kind_of(name: str) -> str | None:
    """Say what a name is by its form: a coordinate (or its rate), a force, a reaction, an energy; None for any other."""
    return next((kind for pattern, kind in KINDS.items() if re.fullmatch(pattern, name)), None)


def why_not(name: str) -> str:
    """Say why an expression may not use a name, where it is that of a result; nothing for any other."""
    kind = kind_of(name)
    if name == PHASE_TIME:
        return f"{PHASE_TIME} is the time since a phase began, of forces, programmes and lengths in scenes with contacts"
    if kind in (None, "a coordinate"):
        return ""
    return f"{name} is {kind}, a result: laws and equations may not name forces, reactions or energies, which follow from them"


def check_names(
    links: Iterable[Link], rows: SceneRows, data: Sequence[str] = (), contacts: Sequence[Contact] = (),
    robots: Sequence[str] = (), events: Sequence[str] = (), legs: Sequence[str] = (),
) -> None:  # fmt: skip
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

    def take_own(name: str, key: str, shown: str) -> None:  # of what results are read by, too
        kind = kind_of(name)
        if kind and name not in RESERVED:
            raise SceneError(f"{shown}: this name is that of {kind}; choose another")
        take(name, key, shown)

    for index, link in enumerate(links):
        take(link.name, f"links[{index}]", f"links[{index}].name = {link.name!r}")
    for index, name in enumerate(data):
        take(name, f"data[{index}]", f"data[{index}].name = {name!r}")
    for index, contact in enumerate(contacts):
        shown = f"contacts[{index}].name = {contact.name!r:.80}"
        if contact.name == contact.point:
            if any(other.name == contact.name for other in contacts[:index]):
                where = f"contacts[{index}].point = {contact.point!r:.80}"
                raise SceneError(f"{where}: it has a contact already; give this one a name")
            continue
        if not re.fullmatch(NAME, contact.name) or len(contact.name) > MAX_NAME:
            raise SceneError(f"{shown}: {ALLOWED_NAME}")
        take_own(contact.name, f"contacts[{index}]", shown)
    for index, name in enumerate(legs):
        take_own(name, f"legs[{index}]", f"legs[{index}].name = {name!r}")
    for index, name in enumerate(robots):
        take(name, f"robots[{index}]", f"robots[{index}].name = {name!r}")
    for index, name in enumerate(events):
        take_own(name, f"events[{index}]", f"events[{index}].name = {name!r}")
    for row in (*rows.ideal, *rows.servo, *rows.secondary):
        if not row.named:
            continue
        kind = kind_of(row.name)
        if kind and row.name not in RESERVED:
            raise SceneError(f"{row.key}: the row's name {row.name!r} is that of {kind}; choose another")
        take(row.name, row.key, f"{row.key}: the row's name {row.name!r}")


def listed(names: Sequence[str]) -> str:
    """Name some of many: the first few, and how many there are."""
    shown = [name if len(name) <= WIDTH else f"{name[: WIDTH - 3]}..." for name in names[:SHOWN]]
    return ", ".join(shown) + (f", ... ({len(names)})" if len(names) > SHOWN else "")


def has_controls(text: str) -> bool:
    """Whether a text would do something to a terminal beside standing in lines: control characters, half letters, overrides."""
    return CONTROLS.search(text) is not None
