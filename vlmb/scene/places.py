"""Where links hang: at anchors of the base, or at points of their parents."""

from __future__ import annotations

from collections.abc import Callable

from vlmb.scene.tables import BASE, Link, SceneTables

SLACK = 1e-9  # [m] by which sums of lengths may miss a place: they round


def on_rod(parent: Link, point: str | float) -> float | None:
    """Distance [m] of a `parent_point` from the start of the parent's rod; None for the tip, which goes with the upper segment.

    A number is metres from the parent's hinge: S = number - lower.length, for a lower segment that is fixed.
    """
    if isinstance(point, float):
        return point - (parent.lower.length or 0.0)
    return {"tip": None, "rod_start": 0.0, "rod_end": parent.rod.length}[point]


def check_place(scene: SceneTables, index: int, parent: Link | None, refuse: Callable[[str, str], None]) -> None:
    """Refuse an anchor that is none of the base, `aside` without a plane, and a place along the parent that is not on its rod."""
    link, key, kind = scene.links[index], f"links[{index}]", scene.base.kind
    axes = "[ahead, left, up] in the ski's frame" if kind == "ski" else "[x, y, z] of the ground"
    if link.anchor is not None and link.parent != BASE:
        why = f"an anchor is a place of the base, and {link.name!r} hangs on {link.parent!r}"
        refuse(f"{key}.anchor", f"{why}: use parent_point, or parent = 'base'")
    if link.anchor is not None and kind == "free":
        why = "a free base is a point without directions, and all its links hang there"
        refuse(f"{key}.anchor", f"{why}: remove it, or hang {link.name!r} on a link with parent_point")
    if link.aside and (link.parent == BASE or not scene.plane or kind == "ski"):
        why = "on a base it is a part of `anchor`" if link.parent == BASE else "it takes a plane that does not turn"
        refuse(f"{key}.aside", f"{why}: for links on links, with plane = true and a pivot or a free base; remove it")
    if not isinstance(link.parent_point, float):
        return
    where = f"{key}.parent_point"
    if parent is None:
        instead = "all its links hang in one point; remove it" if kind == "free" else f"use anchor = {axes}"
        refuse(where, f"{link.parent_point:g} m along a base means nothing: {instead}")
        return
    if parent.lower.motion != "fixed":
        why = f"the lower segment of {parent.name!r} is {parent.lower.motion}: a distance from its hinge is no point of the rod"
        refuse(where, f"{why}; use 'rod_start', 'rod_end' or 'tip', or fix that segment")
    rod_end = (parent.lower.length or 0.0) + parent.rod.length
    end = rod_end + (parent.upper.length or 0.0) * (parent.upper.motion == "fixed")
    if not -SLACK <= link.parent_point <= end + SLACK:
        found = f"{link.parent_point:g} m from the hinge of {parent.name!r}"
        if link.parent_point > end and parent.upper.motion != "fixed":
            why = f"is no point of the rod, which ends at {rod_end:g} m, where a {parent.upper.motion} segment begins: use 'tip'"
            refuse(where, f"{found} {why}, or at most {rod_end:g}")
        refuse(where, f"{found} is not on that link: 0 to {end:g} m")
