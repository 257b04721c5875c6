"""What ends a run before its duration: an event of a contact, one of the scene by name, an expression that falls through 0."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from vlmb.errors import SceneError, nearest
from vlmb.model.mechanism import Mechanism
from vlmb.model.quantities import allowed_names
from vlmb.scene.expressions import Expression, parse
from vlmb.system.events import OPENS, SLIPS, STICKS, TOUCHES
from vlmb.system.stops import stop_points

if TYPE_CHECKING:
    from vlmb.model.robot_mechanism import RobotMechanism

KINDS = (TOUCHES, OPENS, SLIPS, STICKS)


def read_until(mechanism: Mechanism | RobotMechanism, until: str | None) -> tuple[str, str, Expression | None]:
    """Return an event of a contact, "touch left", the name of one of the scene, or an expression; nothing for None.

    Raises SceneError for a contact or a kind that is none, ExpressionError for what cannot be read.
    """
    if until is None:
        return "", "", None
    if not isinstance(until, str):
        raise SceneError(f'until = {until!r:.80}: must be a text, such as "touch left", or "z_dot"')
    words = re.fullmatch(r"\s*([A-Za-z]+)\s+([A-Za-z][\w.]*)\s*", until)
    if words is None:
        if until.strip() in (event.name for event in mechanism.scene.events):
            return "", until.strip(), None
        names = (
            allowed_names(mechanism.names, mechanism.scene.parameters, mechanism.signals)
            if isinstance(mechanism, Mechanism) else mechanism.allowed
        )  # fmt: skip
        if re.fullmatch(r"\s*[A-Za-z]\w*\s*", until) and until.strip() not in names:
            raise SceneError(f"until = {until!r:.80}: {_what_it_takes(mechanism)}")
        return "", "", parse(until, "until", names)
    kind, name = words[1], words[2]
    stops = stop_points(mechanism) if isinstance(mechanism, Mechanism) else ()
    contacts = [*mechanism.scene.closing, *(point.name for point in stops)]
    if kind not in KINDS:
        raise SceneError(f"until = {until!r:.80}: no such event of a contact; {nearest(kind, KINDS)}")
    if name not in contacts:
        what = "contact or leg" if mechanism.scene.legs else "contact"
        raise SceneError(f"until = {until!r:.80}: no {what} {name!r:.80}; {nearest(name, contacts)}")
    return f"{kind} {name}", "", None


def _what_it_takes(mechanism: Mechanism | RobotMechanism) -> str:
    """Say what ends a run in this scene."""
    named = [event.name for event in mechanism.scene.events]
    contacts = [f"{kind} {name}" for name in mechanism.scene.closing for kind in KINDS[:2]]
    events = f"events are {', '.join([*named, *contacts][:12])}" if named or contacts else "this scene has no events"
    return f"no event or quantity of this name; {events}; an expression ends the run where it falls through 0, such as 'z_dot'"
