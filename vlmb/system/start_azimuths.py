"""Azimuths at the start: what ideal rows in their regular form say of them, which a link at the vertical does not feel.

The sine of such a row vanishes half a turn off as well, and at the vertical for every azimuth. So azimuths are turned before
the search, to where the equation as it is written holds.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from vlmb.errors import SceneError, VlmbError
from vlmb.model.coordinates import POLE
from vlmb.system.azimuth_rows import AzimuthRow
from vlmb.system.row_sets import RowSet

FAR = 1.0  # [rad] off its equation, where a search may end elsewhere
LACKING = 1e-7  # times cos psi: a gap [rad] that a search may leave
ASIDE = 1e-3  # [rad] off the vertical, where an equation is read that has no value on it


def shared_azimuths(sets: Sequence[RowSet]) -> set[str]:
    """Names of the azimuths that rows such as `phi1 = phi0` equate with others."""
    return {name for _, _, row in _regular(sets) if len(row.azimuths) > 1 for name in row.azimuths}


def turn_azimuths(given: Collection[str], coordinates: dict[str, float], sets: Sequence[RowSet]) -> None:
    """Turn azimuths that were not given to where their ideal rows hold; given ones only from far off, or at the vertical.

    Rows that name the fewest azimuths come first: what they turn is as if it had been given.
    """
    known = set(given)
    rows = sorted(_regular(sets), key=lambda entry: len(entry[2].azimuths))
    for _ in rows:
        for entry, k, row in rows:
            unset = [name for name in row.azimuths if name not in known]
            if len(unset) == 1:
                _turn(coordinates, row, unset, _gap(entry, k, row, coordinates))
                known.update(unset)
    for entry, k, row in rows:
        gap = _gap(entry, k, row, coordinates)
        upright = [name for name in row.azimuths if name != "phi0" and _upright(coordinates, name)]
        unset = [name for name in row.azimuths if name not in known]
        if unset and len(row.azimuths) > 1:
            _turn(coordinates, row, unset[:1], gap)
        elif upright or abs(gap) > FAR:
            _turn(coordinates, row, upright[:1] or list(row.azimuths), gap)


def require_azimuths(coordinates: dict[str, float], sets: Sequence[RowSet]) -> None:
    """Turn upright links to the azimuths that their rows say. SceneError where rows hold only because a link stands upright."""
    rows = _regular(sets)
    for entry, k, row in rows:
        upright = [name for name in row.azimuths if name != "phi0" and _upright(coordinates, name)]
        if upright:
            _turn(coordinates, row, upright[:1], _gap(entry, k, row, coordinates))
    for entry, k, row in rows:
        gap, flat = _gap(entry, k, row, coordinates), 1.0
        for name in row.azimuths:
            flat *= 1.0 if name == "phi0" else max(abs(math.cos(coordinates[name.replace("phi", "psi")])), ASIDE)
        if abs(gap) * flat > LACKING:
            raise SceneError(
                f"start: no posture near it meets the constraint {entry.rows.info[k].text!r} beside the others: it is off by "
                f"{gap:.3g}, and a link stands upright between them; give a start nearer to them, or drop one that contradicts "
                "another"
            )


def _regular(sets: Sequence[RowSet]) -> list[tuple[RowSet, int, AzimuthRow]]:
    """Return the ideal rows in their regular form: of which rows each is, and which of them."""
    ideal = [(entry, k, entry.rows.info[k].regular) for entry in sets if entry.ideal for k in entry.numbers]
    return [(entry, k, row) for entry, k, row in ideal if row]


def _turn(coordinates: dict[str, float], row: AzimuthRow, names: Sequence[str], gap: float) -> None:
    for name in names:
        coordinates[name] -= row.azimuths[name] * gap / len(names)


def _upright(coordinates: dict[str, float], azimuth: str) -> bool:
    return abs(math.cos(coordinates[azimuth.replace("phi", "psi")])) < POLE


def _gap(entry: RowSet, k: int, row: AzimuthRow, coordinates: dict[str, float]) -> float:
    """Return what an equation lacks as it is written, as an angle within half a turn; 0 where it has no value."""
    seen = dict(coordinates)
    for name in row.azimuths:
        if name != "phi0" and _upright(seen, name):
            seen[name.replace("phi", "psi")] -= ASIDE
    try:
        found = RowSet(entry.rows.as_written(k), entry.frames, range(1), False, entry.t).values(seen, {}).z
    except VlmbError:
        return 0.0
    return math.remainder(float(found[0]) / row.factor, math.tau)
