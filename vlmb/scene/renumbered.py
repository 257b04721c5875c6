"""Numbers of a scene changed without checking the whole of it again: what runs of an ensemble differ by mostly."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

import msgspec

from vlmb.scene.complete import LARGEST, TINIEST
from vlmb.scene.scene import Scene

SPRING = ("stiffness", "damping", "rest")  # numbers of a free segment that nothing but its spring goes by


def renumbered(scene: Scene, changes: Mapping[str, Any]) -> Scene | None:
    """Return a scene with other numbers in [start] and in the springs of free segments, as `changed_at` would.

    None where a change is of another kind, or not certainly allowed: then `changed_at` tells. Whatever a mechanism of the scene
    has in its layout, its masses and the names of its work stays as it is.
    """
    start, links = dict(scene.start), list(scene.links)
    names = [link.name for link in links]
    for key, value in changes.items():
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not _in_range(float(value)):
            return None
        first, *rest = re.sub(r"\[(\w+)\]", r".\1", key).split(".")
        if first == "start" and rest:
            start[".".join(rest)] = float(value)
        elif first == "links" and len(rest) == 3 and rest[1] in ("lower", "upper") and rest[2] in SPRING:
            at = names.index(rest[0]) if rest[0] in names else int(rest[0]) if rest[0].isdigit() else len(links)
            if at >= len(links):
                return None
            old = getattr(links[at], rest[1])
            if old.motion != "free" or (rest[2] != "rest" and not (value > 0.0 and getattr(old, rest[2]) > 0.0)):
                return None  # whether there is a spring or a damper at all decides more than a number
            links[at] = msgspec.structs.replace(
                links[at], **{rest[1]: msgspec.structs.replace(old, **{rest[2]: float(value)})}
            )
        else:
            return None
    return scene.with_numbers(start, tuple(links))


def _in_range(value: float) -> bool:
    return math.isfinite(value) and (value == 0.0 or TINIEST <= abs(value) <= LARGEST)
