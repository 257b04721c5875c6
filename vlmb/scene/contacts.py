"""Contacts as a scene writes them: their surfaces, and the comparison of `when`."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from typing import NamedTuple

from vlmb.scene.expressions import Expression, failure, parse
from vlmb.scene.names import PHASE_START
from vlmb.scene.tables import BASE, Contact, SceneTables

AXES = ("x", "y", "z")
COMPARISON = re.compile(r"[<>]=?")


class Condition(NamedTuple):
    """One comparison: true where its expression is positive."""

    text: str
    expression: Expression


def surface_of(contact: Contact, parameters: Collection[str], key: str) -> Expression:
    """Read a surface. Raises ExpressionError for other names than the point's x, y, z, the time and parameters."""
    surface = parse(contact.surface, f"{key}.surface", {*AXES, "t", *parameters})
    if not surface.names & set(AXES):
        advice = 'it is 0 on the surface, positive outside: "z"'
        raise failure(f"{key}.surface", contact.surface, "names none of x, y, z", advice)
    return surface


def condition_of(text: str, key: str, allowed: Collection[str] | None = None) -> Condition:
    """Read a comparison of two expressions. Raises ExpressionError for anything else."""
    sides = COMPARISON.split(text)
    if len(sides) != 2:
        raise failure(key, text, f"{len(sides) - 1} comparisons", "it is one comparison of two expressions: a > b")
    first, second = (f"({side.strip()})" for side in sides)
    less = "<" in text
    return Condition(text, parse(f"{second} - {first}" if less else f"{first} - {second}", key, allowed))


def check_point(scene: SceneTables, point: str, key: str, refuse: Callable[[str, str], None]) -> None:
    """Refuse what cannot be a point of a contact or of a leg."""
    if point == BASE:
        if scene.base.kind != "free":
            refuse(key, f"'base' is the first hinge of a free base, not of a {scene.base.kind!r} one")
    elif "." not in point:
        refuse(key, f"{point!r:.80}: a point is a link's name with .tip, or another of its points, or 'base'")


def check_contact(scene: SceneTables, contact: Contact, key: str, refuse: Callable[[str, str], None]) -> None:
    """Refuse a contact whose numbers or texts do not fit together."""
    check_point(scene, contact.point, f"{key}.point", refuse)
    if contact.friction_static is not None:
        if contact.friction in ("rough", 0.0):
            refuse(f"{key}.friction_static", f"means nothing with friction = {contact.friction!r}; give both as numbers > 0")
        elif contact.friction_static < float(contact.friction):
            refuse(f"{key}.friction_static", f"{contact.friction_static:g} is below friction = {float(contact.friction):g}")
    if any(name in scene.parameters for name in AXES):
        refuse(key, "parameters x, y and z cannot be told from the point's place in a surface; rename them")
    surface_of(contact, scene.parameters, key)
    if contact.when:
        condition = condition_of(contact.when, f"{key}.when")
        if PHASE_START in condition.expression.names:
            refuse(f"{key}.when", f"{contact.when!r:.80}: phase_t has no place here; write it with t or with the motion")
