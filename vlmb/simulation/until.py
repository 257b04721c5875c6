"""What ends a run before its duration: an event of a contact, one of the scene by name, an expression that falls through 0."""

from __future__ import annotations

import re

from vlmb.errors import SceneError, nearest
from vlmb.model.mechanism import Mechanism
from vlmb.model.quantities import allowed_names
from vlmb.scene.expressions import Expression, parse
from vlmb.system.events import OPENS, SLIPS, STICKS, TOUCHES
from vlmb.system.stops import stop_points

KINDS = (TOUCHES, OPENS, SLIPS, STICKS)


def read_until(mechanism: Mechanism, until: str | None) -> tuple[str, str, Expression | None]:
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
        names = allowed_names(mechanism.names, mechanism.scene.parameters, mechanism.signals)
        return "", "", parse(until, "until", names)
    kind, name = words[1], words[2]
    contacts = [*mechanism.scene.closing, *(point.name for point in stop_points(mechanism))]
    if kind not in KINDS:
        raise SceneError(f"until = {until!r:.80}: no such event of a contact; {nearest(kind, KINDS)}")
    if name not in contacts:
        raise SceneError(f"until = {until!r:.80}: no contact or leg {name!r:.80}; {nearest(name, contacts)}")
    return f"{kind} {name}", "", None
