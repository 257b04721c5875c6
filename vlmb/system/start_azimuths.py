"""Azimuths at the start: what ideal rows in their regular form say of them, which a link at the vertical does not feel.

The sine of such a row vanishes half a turn off as well, and at the vertical for every azimuth. So azimuths are turned before
the search, to where the equation as it is written holds.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from vlmb.errors import SceneError, VlmbError
from vlmb.model.coordinates import POLE
from vlmb.model.mechanism import Mechanism
from vlmb.system.azimuth_rows import AzimuthRow
from vlmb.system.constraints import ConstraintSet
from vlmb.system.frames import LinkFrames
from vlmb.system.row_sets import RowSet

FAR = 1.0  # [rad] off its equation, where a search may end elsewhere
LACKING = 1e-7  # times cos psi: a gap [rad] that a search may leave
ASIDE = 1e-3  # [rad] off the vertical, where an equation is read that has no value on it


def shared_azimuths(sets: Sequence[RowSet]) -> set[str]:
    """Names of the azimuths that rows such as `phi1 = phi0` equate with others."""
    return {name for _, row in _regular(sets) if len(row.azimuths) > 1 for name in row.azimuths}


def turn_azimuths(mechanism: Mechanism, given: Collection[str], coordinates: dict[str, float], sets: Sequence[RowSet]) -> None:
    """Turn azimuths that were not given to where their ideal rows hold; given ones only from far off, or at the vertical.

    Rows that name the fewest azimuths come first: what they turn is as if it had been given.
    """
    known = set(given)
    rows = sorted(_regular(sets), key=lambda entry: len(entry[1].azimuths))
    for _ in rows:
        for t, row in rows:
            unset = [name for name in row.azimuths if name not in known]
            if len(unset) == 1:
                _turn(coordinates, row, unset, _gap(mechanism, t, row, coordinates))
                known.update(unset)
    for t, row in rows:
        gap = _gap(mechanism, t, row, coordinates)
        upright = [name for name in row.azimuths if name != "phi0" and _upright(coordinates, name)]
        unset = [name for name in row.azimuths if name not in known]
        if unset and len(row.azimuths) > 1:
            _turn(coordinates, row, unset[:1], gap)
        elif upright or abs(gap) > FAR:
            _turn(coordinates, row, upright[:1] or list(row.azimuths), gap)


def require_azimuths(mechanism: Mechanism, coordinates: dict[str, float], sets: Sequence[RowSet]) -> None:
    """Turn upright links to the azimuths that their rows say. SceneError where rows hold only because a link stands upright."""
    rows = [(entry.t, row) for entry in sets if entry.ideal for row in entry.info if row.regular]
    for t, row in rows:
        upright = [name for name in row.regular.azimuths if name != "phi0" and _upright(coordinates, name)] if row.regular else []
        if row.regular and upright:
            _turn(coordinates, row.regular, upright[:1], _gap(mechanism, t, row.regular, coordinates))
    for t, row in rows:
        assert row.regular
        gap, flat = _gap(mechanism, t, row.regular, coordinates), 1.0
        for name in row.regular.azimuths:
            flat *= 1.0 if name == "phi0" else max(abs(math.cos(coordinates[name.replace("phi", "psi")])), ASIDE)
        if abs(gap) * flat > LACKING:
            raise SceneError(
                f"start: no posture near it meets the constraint {row.text!r} beside the others: it is off by {gap:.3g}, and a "
                "link stands upright between them; give a start nearer to them, or drop one that contradicts another"
            )


def _regular(sets: Sequence[RowSet]) -> list[tuple[float, AzimuthRow]]:
    return [(entry.t, row.regular) for entry in sets if entry.ideal for row in entry.info if row.regular]


def _turn(coordinates: dict[str, float], row: AzimuthRow, names: Sequence[str], gap: float) -> None:
    for name in names:
        coordinates[name] -= row.azimuths[name] * gap / len(names)


def _upright(coordinates: dict[str, float], azimuth: str) -> bool:
    return abs(math.cos(coordinates[azimuth.replace("phi", "psi")])) < POLE


def _gap(mechanism: Mechanism, t: float, row: AzimuthRow, coordinates: dict[str, float]) -> float:
    """Return what an equation lacks as it is written, as an angle within half a turn; 0 where it has no value."""
    seen = dict(coordinates)
    for name in row.azimuths:
        if name != "phi0" and _upright(seen, name):
            seen[name.replace("phi", "psi")] -= ASIDE
    rows, frames = ConstraintSet(mechanism, [(row.equation.text, row.equation.left.key, False)]), LinkFrames(mechanism)
    try:
        found = RowSet(rows, frames, range(1), False, t).values(seen, {}).z
    except VlmbError:
        return 0.0
    return math.remainder(float(found[0]) / row.factor, math.tau)
