"""Segments whose length follows a law of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vlmb.errors import SceneError
from vlmb.model.laws import Law, law_breaks, law_jump, time_law
from vlmb.model.layout import segment_of
from vlmb.model.mechanism import Mechanism
from vlmb.scene.by_phase import numbers_of

LENGTH_JUMP, RATE_JUMP = 1e-7, 1e-4  # [m, m/s] that count as none


class Prescribed(NamedTuple):
    """A segment whose length follows a law; `force` is the name of the force that results."""

    name: str
    force: str
    q: int
    v: int
    law: Law


def breaks_of_law(at: Prescribed, start: float, end: float) -> set[float]:
    """Return the times in (start, end) at which a given length is not smooth. Raises SceneError where it, or its rate, jumps."""
    found = set[float]()
    for t in law_breaks(at.law, start, end):
        value, rate = law_jump(at.law, t)
        if abs(value) > LENGTH_JUMP or abs(rate) > RATE_JUMP:
            raise SceneError(
                f"{at.name}: the law {at.law.text!r} is not smooth enough at t = {t:.6g} s (length jumps by {value:.3g} m, "
                f"its rate by {rate:.3g} m/s): a prescribed length needs a continuous rate"
            )
        found.add(t)
    return found


def require_inside(at: Prescribed, bounds: tuple[float, float], begin: float, end: float) -> None:
    """Refuse a given length that leaves its limits within a time [s]. Raises SceneError."""
    low, high = bounds
    times = np.linspace(begin, end, 1001)
    for t, length in zip(times.tolist(), at.law.values(times).tolist(), strict=True):
        if not low <= length <= high:
            raise SceneError(
                f"{at.name}: the law {at.law.text!r} gives {length:.6g} m at t = {t:.6g} s, outside [{low:g}, {high:g}]"
            )


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
