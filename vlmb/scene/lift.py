"""A ski that may leave the snow: what goes with it, and what does not."""

from __future__ import annotations

import re
from collections.abc import Callable

from vlmb.scene.by_phase import programmes_of
from vlmb.scene.tables import BASE, SceneTables

ON_SKI = ("base", "heading")  # ends of springs between directions that turn the ski


def check_lift(scene: SceneTables, refuse: Callable[[str, str], None]) -> None:
    """Refuse what needs more of a ski in the air than its inertia about its normal."""
    base = scene.base
    if not base.lift:
        if base.hold is not None or base.skid is not None:
            refuse("base", "hold and skid need lift = true: they are multiples of the normal force")
        return
    if base.skid is not None and base.hold is None:
        refuse("base.skid", "it is the ratio while the edge skids, and without hold it never does; give hold, too")
    if base.hold is not None and base.skid is not None and base.skid > base.hold:
        refuse("base.skid", f"{base.skid:g} is above hold = {base.hold:g}: an edge that skids holds no more than before")
    parallel = "a ski in the air stays parallel to the snow, which is exact"
    if base.com_offset:
        refuse("base.com_offset", f"{parallel} with its centre of mass at A only; set it to 0, or lift = false")
    if scene.plane:
        refuse("plane", "a ski with lift moves in space; write the plane as constraints, phi1 = phi0, or set lift = false")
    if base.friction_on != "normal":
        refuse("base.friction_on", "with lift friction goes by the normal force; remove it, or set lift = false")
    if scene.robots:
        refuse("base.lift", "it is there for scenes of links alone, not for robots")
    for index, link in enumerate(scene.links):
        if link.parent == BASE and link.anchor is not None and any(link.anchor):
            refuse(f"links[{index}].anchor", f"{parallel} with all hinges at A only; remove it, or set lift = false")
    roots = [k for k, link in enumerate(scene.links) if link.parent == BASE]
    for index, force in enumerate(scene.forces):
        key = f"forces[{index}]"
        if force.between is not None and any(end in ON_SKI for end in force.between):
            why = "in the air it takes no such moment; write its torque as a law of T_ with closed = ['ski']"
            refuse(key, f"a spring between {' and '.join(force.between)} pushes back on the ski: {why}")
        if force.on is not None and _turns_the_ski(scene, force.on, roots) and "ski" not in force.closed:
            refuse(key, _needs_snow(force.on))
    for key, programme in programmes_of(scene):
        for name in programme.controls:
            if _turns_the_ski(scene, name, roots) and "ski" not in programme.closed:
                refuse(f"{key}.controls", _needs_snow(name))


def _needs_snow(name: str) -> str:
    return f"{name} pushes back on the ski, which in the air has no inertia for it: let it act on the snow only, closed = ['ski']"


def _turns_the_ski(scene: SceneTables, name: str, roots: list[int]) -> bool:
    """Whether a generalized force turns the ski about another axis than its normal."""
    if re.fullmatch(r"M_(phi|psi)[1-9]\d*", name):
        return True
    return name in [f"T_{scene.links[k].name}" for k in roots]
