"""Segments whose length follows a law of time."""

from __future__ import annotations

from typing import NamedTuple

from vlmb.model.laws import Law, time_law
from vlmb.model.layout import segment_of
from vlmb.model.mechanism import Mechanism
from vlmb.scene.by_phase import numbers_of


class Prescribed(NamedTuple):
    """A segment whose length follows a law; `force` is the name of the force that results."""

    name: str
    force: str
    q: int
    v: int
    law: Law


def prescribed_segments(mechanism: Mechanism) -> tuple[Prescribed, ...]:
    """Collect the prescribed segments and their laws."""
    found = []
    for coordinate in mechanism.layout.coordinates:
        if coordinate.kind == "xi":
            at = segment_of(mechanism.layout, coordinate)
            if at.motion == "prescribed":
                side = "lower" if coordinate.segment == 1 else "upper"
                text = mechanism.segment(coordinate).law
                key, parameters = f"links[{coordinate.link}].{side}.law", numbers_of(mechanism.scene)
                law = time_law(0.0 if text is None else text, parameters, key, mechanism.signals)
                force = f"F{coordinate.link + 1}_{coordinate.segment}"
                found.append(Prescribed(coordinate.name, force, at.q, at.v, law))
    return tuple(found)
