"""Numbers of a scene changed without checking the whole of it again: what runs of an ensemble differ by mostly."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Mapping
from typing import Any

import msgspec

from vlmb.scene.complete import LARGEST, TINIEST
from vlmb.scene.tables import Link, SceneTables, Segment
from vlmb.scene.written import Written

SPRING = ("stiffness", "damping", "rest")  # numbers of a free segment that nothing but its spring goes by
DIFFERENT = ("start", "links")  # keys of scenes that may differ
_the_same = operator.attrgetter(*(key for key in SceneTables.__struct_fields__ if key not in DIFFERENT))


def renumbered(scene: SceneTables, changes: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return [start] and the links of a complete scene under changes of start values and of springs of free segments.

    None where a change is of another kind, or not certainly allowed: then a check of the whole scene tells. Whatever a mechanism
    of the scene has in its layout, its masses and the names of its work stays as it is.
    """
    start, links = dict(scene.start), list(scene.links)
    names = [link.name for link in links]
    for key, value in changes.items():
        if not (isinstance(key, str) and _is_allowed(value)):
            return None
        path = re.sub(r"\[(\w+)\]", r".\1", key) if "[" in key else key
        first, *rest = path.split(".")
        if first == "start" and rest:
            start[".".join(rest)] = float(value)
        elif first == "links" and len(rest) == 3 and rest[1] in ("lower", "upper") and rest[2] in SPRING:
            at = names.index(rest[0]) if rest[0] in names else int(rest[0]) if re.fullmatch(r"\d{1,6}", rest[0]) else len(links)
            if at >= len(links):
                return None
            segment, number = getattr(links[at], rest[1]), float(value)
            if not _may_have(segment, rest[2], number):
                return None
            links[at] = msgspec.structs.replace(links[at], **{rest[1]: msgspec.structs.replace(segment, **{rest[2]: number})})
        else:
            return None
    return {"start": start, "links": tuple(links)}


def differ_in_numbers(one: SceneTables, other: SceneTables) -> bool:
    """Whether complete scenes differ in nothing but what `renumbered` changes."""
    if len(one.links) != len(other.links):
        return False
    return bool(_the_same(one) == _the_same(other)) and all(map(_is_renumbered_link, one.links, other.links))


def _is_renumbered_link(old: Link, new: Link) -> bool:
    if old is new:
        return True
    alike = msgspec.structs.replace(old, lower=new.lower, upper=new.upper) == new
    return alike and _is_renumbered(old.lower, new.lower) and _is_renumbered(old.upper, new.upper)


def _is_renumbered(old: Segment, new: Segment) -> bool:
    """Whether segments differ in numbers of a spring alone; whether there is a spring or a damper decides more than a number."""
    if old == new:
        return True
    alike = msgspec.structs.replace(new, stiffness=old.stiffness, damping=old.damping, rest=old.rest) == old
    return alike and all(_may_have(old, name, getattr(new, name)) for name in SPRING)


def _may_have(segment: Segment, name: str, value: float) -> bool:
    """Whether a number of SPRING may have another value: of a free segment, with a spring and a damper where it has them."""
    if segment.motion != "free" or name == "rest":
        return segment.motion == "free"
    return value > 0.0 if getattr(segment, name) > 0.0 else value == 0.0


def _is_allowed(value: Any) -> bool:
    """Whether a value is a number that any scene may have, and no expression."""
    if isinstance(value, (bool, Written)) or not isinstance(value, (int, float)):
        return False
    if isinstance(value, int) and abs(value) > 2**63:
        return False
    return math.isfinite(value) and (value == 0.0 or TINIEST <= abs(value) <= LARGEST)
