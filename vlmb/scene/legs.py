"""Massless legs as a scene writes them, and as text: length, force and gap by the names of the point they hang on.

While a leg stands its foot is a place of parameters; `stands` is one that the scene of a phase has while it does. In laws
`phase_t` is the time since it came down, or let go; while it swings its length is that with which it comes down. Outside phases
what an equation reads of a leg is that of one that stands at its `foot`, or at the origin.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from vlmb.errors import ExpressionError
from vlmb.scene.contacts import AXES, check_point
from vlmb.scene.expressions import Tree, parse
from vlmb.scene.names import PHASE_START
from vlmb.scene.tables import BASE, Law, Leg, SceneTables

DOT = "_dot"
PHASE_TIME_ALONE = re.compile(r"(?<![\w.])phase_t(?![\w.(])")
LENGTH, FORCE, FOOT = "length", "force", "foot"  # what equations may read of a leg


def check_leg(scene: SceneTables, leg: Leg, key: str, refuse: Callable[[str, str], None]) -> None:
    """Refuse a leg whose keys do not fit together. Raises ExpressionError for laws that cannot be read."""
    check_point(scene, leg.from_, f"{key}.from", refuse)
    if leg.law is None and not (leg.length and leg.stiffness):
        refuse(key, "a leg needs length [m] and stiffness [N/m] > 0, or instead of these a `law` of its length")
    if leg.law is not None and (leg.length is not None or leg.stiffness or leg.damping):
        refuse(key, "a leg with a `law` has no length, stiffness and damping: the law gives its length, the force is the result")
    if scene.plane and leg.foot is not None and leg.foot[1] != 0.0:
        refuse(f"{key}.foot", f"y = {leg.foot[1]:g}: with plane = true it is 0")
    own = {"t", PHASE_START, *scene.parameters}
    for name, law in (("law", leg.law), ("attack", leg.attack), ("heading", leg.heading)):
        if law is not None:
            parse(law, f"{key}.{name}", own)
    if scene.plane and (not isinstance(leg.heading, (int, float)) or abs(math.sin(leg.heading)) > 1e-9):
        refuse(f"{key}.heading", "with plane = true it is 0, along x, or 'pi', against it")


def index_of(scene: SceneTables, k: int) -> int:
    """Return the number of leg k among contacts and legs."""
    return len(scene.contacts) + k


def place_names(point: str, plane: bool) -> tuple[str, str, str]:
    """Return the names of a point's x, y, z; "" where the plane has none."""
    x, y, z = (axis if point == BASE else f"{point}.{axis}" for axis in AXES)
    return x, "" if plane else y, z


def parameter(what: str, index: int) -> str:
    """Name a number of a phase; no scene can have such a name."""
    return f"phase.{what}{index}"


def law_text(law: Law, since: str = "") -> str:
    """Return a law of a leg with `phase_t` as the time since a number, or the name of one; as 0 without."""
    if not isinstance(law, str):
        return repr(float(law))
    return f"({PHASE_TIME_ALONE.sub(f'(t - {since})' if since else '0', law)})"


def swing_gap_text(leg: Leg, plane: bool, since: str) -> str:
    """Return how high [m] the foot of a leg is that swings since a time; of one that never lands the height of its point."""
    z = place_names(leg.from_, plane)[2]
    return z if leg.attack is None else f"{z} - {law_text(leg.reach)}*sin({law_text(leg.attack, since)})"


class Standing:
    """Texts of a leg with its foot at a place (x, y, z), each a number or the name of a parameter."""

    def __init__(self, leg: Leg, plane: bool, foot: tuple[str, str, str]) -> None:
        self.leg, self.names = leg, place_names(leg.from_, plane)
        self.away = [f"({name} - {at})" if name else "" for name, at in zip(self.names, foot, strict=True)]

    @property
    def length(self) -> str:
        """Distance of point and foot [m]."""
        return f"sqrt({' + '.join(f'{away}**2' for away in self.away if away)})"

    @property
    def length_dot(self) -> str:
        """Its rate [m/s]."""
        parts = [f"{away}*{name}{DOT}" for away, name in zip(self.away, self.names, strict=True) if name]
        return f"({' + '.join(parts)})/{self.length}"

    @property
    def height(self) -> str:
        """How high [m] the point is over the foot."""
        return self.away[2]

    @property
    def spring(self) -> str:
        """Force [N] of its spring along foot -> point."""
        return f"{self.leg.stiffness!r}*({self.leg.length!r} - {self.length})"

    @property
    def damper(self) -> str:
        """Force [N] of its damper along foot -> point."""
        return f"-{self.leg.damping!r}*{self.length_dot}"

    @property
    def force(self) -> str:
        """Both [N]."""
        return f"{self.spring} - {self.leg.damping!r}*{self.length_dot}" if self.leg.damping else self.spring

    @property
    def grip(self) -> str:
        """What falls through 0 where the force leaves the cone of friction [m]."""
        flat = " + ".join(f"{away}**2" for away in self.away[:2] if away)
        return f"{self.leg.friction!r}*{self.height} - sqrt({flat})"


def standing_of(scene: SceneTables, k: int) -> Standing:
    """Return the texts of leg k with its foot where the scene has it: at parameters of a phase, else where it starts."""
    leg, index = scene.legs[k], index_of(scene, k)
    named = tuple(parameter(axis, index) for axis in AXES)
    start = tuple(repr(float(value)) for value in (*(leg.foot or (0.0, 0.0)), 0.0))
    x, y, z = named if named[0] in scene.parameters else start
    return Standing(leg, scene.plane, (x, y, z))


def stands(scene: SceneTables, k: int) -> bool:
    """Whether leg k stands, in the scene of a phase."""
    return parameter("stands", index_of(scene, k)) in scene.parameters


def leg_tree(scene: SceneTables, name: str) -> Tree:
    """Return what an equation reads of a leg, `leg.length`, `leg.length_dot`, `leg.force` or `leg.foot.x`, as an expression.

    Raises ExpressionError for the force of a leg with a law, which is a reaction.
    """
    owner, _, what = name.partition(".")
    k = next(k for k, leg in enumerate(scene.legs) if leg.name == owner)
    leg, index = scene.legs[k], index_of(scene, k)
    phased = parameter("x", index) in scene.parameters
    if what.startswith(FOOT):
        axis = AXES.index(what[-1])
        return ("name", parameter(AXES[axis], index)) if phased else ("number", (*(leg.foot or (0.0, 0.0)), 0.0)[axis])
    if what == FORCE and leg.law is not None:
        advice = "its law gives the length, and the force follows from the motion; name the length, or give it a stiffness"
        raise ExpressionError(f"legs[{k}]: an equation names {name}, which is a result: {advice}")
    if phased and not stands(scene, k):
        text = law_text(leg.reach) if what == LENGTH else "0"
    else:
        standing = standing_of(scene, k)
        texts = {LENGTH: standing.length, LENGTH + DOT: standing.length_dot}
        text = texts.get(what) or standing.force
    return parse(text, name).tree


READABLE = (LENGTH, LENGTH + DOT, FORCE, *(f"{FOOT}.{axis}" for axis in AXES))
