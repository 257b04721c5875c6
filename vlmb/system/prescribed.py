"""Segments whose length follows a law of time."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from vlmb.errors import SceneError
from vlmb.model.laws import Law, law_jump, time_law
from vlmb.model.layout import segment_of
from vlmb.model.mechanism import Mechanism
from vlmb.scene.by_phase import numbers_of

LENGTH_JUMP, RATE_JUMP = 1e-7, 1e-4  # [m, m/s] that are too much, whatever they are
CLOSE = 1e-9  # [s] from where sides are continued, beside those of `law_jump`
ROUNDED = 1e-9  # of a length, or a rate [1/s]: a jump that is none


class Prescribed(NamedTuple):
    """A segment whose length follows a law; `force` is the name of the force that results."""

    name: str
    force: str
    q: int
    v: int
    law: Law


def require_smooth(at: Prescribed, breaks: Iterable[float], start: float) -> None:
    """Raise SceneError where a given length, or its rate, jumps at a break [s]; at the start a rate may begin at once."""
    for t in breaks:
        value, rate = _jump(at.law, t, t == start)
        rate = 0.0 if t == start else rate
        if value or rate:
            raise SceneError(
                f"{at.name}: the law {at.law.text!r} is not smooth enough at t = {t:.6g} s (length jumps by {value:.3g} m, "
                f"its rate by {rate:.3g} m/s): a prescribed length needs a continuous rate"
            )


def _jump(law: Law, t: float, starts: bool) -> tuple[float, float]:
    """Return by how much a length [m] and its rate [m/s] jump at a time; 0 where it is rounding or fades nearby."""
    near = max(CLOSE, 64.0 * math.ulp(t))
    before, after = _continued(law, t, 0.0 if starts else -near), _continued(law, t, near)
    length, found = max(abs(before[0]), abs(after[0])), []
    for one, other, wide, most in zip(before, after, law_jump(law, t), (LENGTH_JUMP, RATE_JUMP), strict=True):
        close = other - one
        stays = abs(close) > ROUNDED * max(length, abs(one), abs(other)) and (starts or abs(close) > 0.5 * abs(wide))
        found.append(wide if abs(wide) > most and not starts else close if stays else 0.0)
    return found[0], found[1]


def _continued(law: Law, t: float, way: float) -> tuple[float, float]:
    """Return a law's value and rate at t, continued from a way [s] off."""
    value, rate, second = law.jet(t + way)
    back = (t + way) - t
    return value - back * (rate - 0.5 * back * second), rate - back * second


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
