"""Where the laws of a run, or of a phase, are not smooth in time; whether given lengths go on where a phase begins."""

from __future__ import annotations

from functools import partial

from vlmb.errors import SceneError
from vlmb.model.laws import breaks_within, law_breaks
from vlmb.scene.names import PHASE_START
from vlmb.system.prescribed import LENGTH_JUMP, RATE_JUMP, Prescribed, require_inside, require_smooth
from vlmb.system.system import System


def breaks_of(system: System, t0: float, end: float) -> tuple[float, ...]:
    """Times in [t0, end] at which a law or a row is not smooth; SceneError where a given length jumps, or leaves its limits.

    How long a phase lasts is not known before, and so not where a length by `phase_t` leaves its limits: see `require_going_on`.
    """
    breaks = system.breaks(t0, end)
    for at in system.prescribed:
        found = breaks_within(partial(law_breaks, at.law), t0, end)
        require_smooth(at, found - {end}, t0)
        breaks |= found
        if PHASE_START not in at.law.expression.names:
            _require_inside(system, at, t0, end)
    return tuple(sorted(breaks))


def _require_inside(system: System, at: Prescribed, begin: float, end: float) -> None:
    coordinates = {c.name: c for c in system.mechanism.layout.coordinates}
    require_inside(at, system.mechanism.segment(coordinates[at.name]).bounds, begin, end)


def require_going_on(before: System, began: float, after: System, t: float) -> None:
    """Refuse given lengths that left their limits in the phase before, or jump where another begins at t [s]."""
    for one, other in zip(before.prescribed, after.prescribed, strict=True):
        if PHASE_START not in one.law.expression.names:
            continue
        _require_inside(before, one, began, t)
        (length, rate, _), (new, its, _) = one.law.jet(t), other.law.jet(t)
        if not (abs(new - length) <= LENGTH_JUMP and abs(its - rate) <= RATE_JUMP):
            raise SceneError(
                f"{one.name}: by the law {one.law.text!r} its length jumps by {new - length:.3g} m, and its rate by "
                f"{its - rate:.3g} m/s, where a phase begins: a given length needs a continuous rate; let the law begin as "
                "it ends, or leave the length free under a programme"
            )
