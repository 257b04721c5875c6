"""What is looked for along a run: limits of lengths, points on the snow, switches of laws, lines that swap, dependent rows."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

from vlmb.scene.expressions import Expression, fold, parse_equation
from vlmb.scene.tables import SceneTables

# kinds of events; QUIET never happens; GRIP: a ski stops, slips; CONTACT: one touches, opens, slips, sticks; NAMED: of the scene
LIMIT, FALL, SWITCH, LINE_UP, DEPENDENT, QUIET, GRIP, CONTACT, NAMED = range(9)
FALLING, BOTH_WAYS, RISING = -1.0, 0.0, 1.0
# names of the events of a contact; REARMS: one that was refused is outside again
TOUCHES, OPENS, SLIPS, STICKS, REARMS, BOUNCES = "touch", "open", "slip", "stick", "rearm", "bounce"
LETS_GO, TIPS = "let go", "tip"  # of a leg: its spring no longer pushes, its force leaves the cone of friction
HAPPENS = "event"  # kind of one of the scene, as it is told
WAYS = {"down": FALLING, "up": RISING, "both": BOTH_WAYS}
TOLD = {LIMIT: "limit", FALL: "fall", SWITCH: "switch", LINE_UP: "line_up", NAMED: HAPPENS}
IN_LINE = 1e-6  # sine of an angle below which two directions line up


class Event(NamedTuple):
    """Something that is looked for: what it is, the way its indicator crosses zero, and the sentence of a run that it ends."""

    kind: int
    direction: float
    name: str
    sentence: str
    which: int = -1  # of a line-up: the spring between points whose ends meet; the contact
    part: int = 0  # of a contact: which of its grips
    slack: float = 1e-12  # [m, N, m/s] what counts as 0 at a start, of one that ends a run or a phase

    @property
    def ends(self) -> bool:
        """Whether it ends a run, or a phase, wherever it happens: a limit, a fall, a contact's."""
        return self.kind in (LIMIT, FALL, CONTACT)


def events_of(
    scene: SceneTables, allowed: Collection[str], until: Expression | None, ends_at: str
) -> tuple[list[Expression], tuple[Event, ...]]:
    """Return the expressions, left - right, of the events of a scene and of `until`, and what is looked for of each.

    A run ends where `until` falls through 0, and at the event `ends_at`. Raises ExpressionError.
    """
    found, events = list[Expression](), list[Event]()
    for index, event in enumerate(scene.events):
        equation = parse_equation(event.when, f"events[{index}].when", allowed)
        tree = fold("-", [equation.left.tree, equation.right.tree])
        found.append(Expression(equation.text, equation.names, f"events[{index}].when", tree))
        ends = f"{event.name}: {event.when}" if event.end or event.name == ends_at else ""
        events.append(Event(NAMED, WAYS[event.direction], event.name, ends))
    if until is not None:
        found.append(until)
        events.append(Event(NAMED, FALLING, until.text, f"{until.text} fell through 0"))
    return found, tuple(events)
