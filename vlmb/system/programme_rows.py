"""The rows of a scene and what of its programme the motion gives, as they are read and compiled."""

from __future__ import annotations

import dataclasses

from vlmb.model.mechanism import Mechanism
from vlmb.model.quantities import allowed_names
from vlmb.scene.by_phase import keyed, numbers_of, programme_at
from vlmb.system.constraints import ConstraintSet
from vlmb.system.contacts import PhaseContacts
from vlmb.system.force_rows import ForceRow, force_rows, places_of
from vlmb.system.gains import Entry, MovingGains, moving_gains
from vlmb.system.programme import control_channels, control_scales


def read_rows(mechanism: Mechanism, contacts: PhaseContacts | None = None) -> tuple[ConstraintSet | None, MovingGains]:
    """Compile the ideal rows, those of the programme, then its secondary ones; None where there are none.

    contacts : of a phase, whose forces rows may name. Raises ExpressionError, SceneError.
    """
    scene, parts = mechanism.scene, keyed(programme_at(mechanism.scene))
    texts = [(text, f"constraints[{k}]", True) for k, text in enumerate(scene.constraints)]
    for what in ("constraints", "secondary"):
        texts += [(text, f"{key}.{what}[{k}]", False) for key, part in parts for k, text in enumerate(getattr(part, what))]
    named, first = force_rows(mechanism), len(scene.constraints)
    moving = _moving_gains(mechanism, [named.get(key) for _, key, _ in texts[first:]], contacts)
    acting = control_channels(mechanism)
    scales = control_scales(mechanism, acting).tolist()
    rests = {key: row.rest for key, row in named.items()}
    pushed = list(zip(acting, scales, strict=True))
    return ConstraintSet(mechanism, texts, pushed, moving.laws, rests) if texts else None, moving


def _moving_gains(mechanism: Mechanism, beyond: list[ForceRow | None], contacts: PhaseContacts | None) -> MovingGains:
    """Read what of a scene's programme the motion gives, forces that its rows name among it; nothing without one."""
    scene = mechanism.scene
    programme = programme_at(scene)
    if programme is None:
        return MovingGains()
    allowed = allowed_names(mechanism.names, numbers_of(scene), mechanism.signals)
    names = [channel.name for channel in control_channels(mechanism)]
    found, places = moving_gains(programme, names, allowed, scene.parameters), places_of(contacts)
    forces = [
        Entry("force", row, places[force.contact, force.axis], force.factor)
        for row, named in enumerate(beyond) if named is not None
        for force in named.forces if (force.contact, force.axis) in places
    ]  # fmt: skip
    return dataclasses.replace(found, entries=(*found.entries, *forces))
