"""Forces along a run in phases: each phase by its own system, and the forces of contacts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.model.frozen import read_only
from vlmb.model.reading import Postures
from vlmb.scene.rows import rows_of
from vlmb.simulation.histories import forces_along
from vlmb.simulation.phases import Stretch
from vlmb.system.contacts import AWAY, CLOSED, STANDING
from vlmb.system.legs import LegPoint
from vlmb.system.slips import force_of, motion_of
from vlmb.system.stops import StopPoint
from vlmb.system.system import System

Array = NDArray[np.float64]


def forces_in_phases(
    system: System, stretches: Sequence[Stretch], taken: Sequence[Array], seen: Postures, failed: bool
) -> dict[str, Any]:
    """Return what `forces_along` does, and of each contact its force (N, 3) [N] on the mechanism, zeros while it is open.

    taken : t, q, v, work, values of coordinates and inputs, at all samples; `seen` where every point is there
    """
    parts, began = [], stretches[0].start
    for stretch in stretches:
        began = began if stretch.quiet else stretch.start
        if stretch.last > stretch.first:
            own = slice(stretch.first, stretch.last)
            phase = system.phase(stretch.footings, began=began)
            parts.append(_in_phase(system, phase, stretch, [values[own] for values in taken], seen, own, failed))
    return {name: _joined([part[name] for part in parts]) for name in parts[0]}


def _in_phase(
    system: System, phase: System, stretch: Stretch, taken: Sequence[Array], seen: Postures, own: slice, failed: bool
) -> dict[str, Any]:
    found = forces_along(phase, *taken, failed)  # type: ignore[call-arg, arg-type]
    reactions, texts = dict(found["reactions"]), set[str]()
    for point, footing in zip(system.points, stretch.footings, strict=True):
        forces = np.zeros((len(taken[0]), 3))
        if isinstance(point, LegPoint) and footing.state == STANDING:
            places, speeds = (values[own] for values in motion_of(point, seen))
            for i in range(len(forces)):
                forces[i] = point.pushes(places[i], speeds[i], footing) * point.slope(0.0, places[i], footing)
        elif footing.state in CLOSED:
            rows = point.row_texts(footing)
            texts |= {*rows}
            multipliers = np.column_stack([reactions[text] for text in rows])
            places, speeds = (values[own] for values in motion_of(point, seen))
            for i, t in enumerate(taken[0].tolist()):
                forces[i] = force_of(point, footing, t, places[i], speeds[i], multipliers[i])
        reactions[point.name] = read_only(forces[:, 0] if isinstance(point, StopPoint) else forces)
    nowhere = read_only(np.full(len(taken[0]), np.nan))
    kept = {row.name: (nowhere, nowhere) for row in rows_of(system.mechanism.scene).servo}  # of programmes that do not act
    kept |= {name: values for name, values in found["residuals"].items() if name not in texts}
    acting = {*(phase.programme.names if phase.programme else ()), *(channel.name for channel in phase.forces.named)}
    acting |= {at.force for at in phase.prescribed}
    found["controls"] |= {name: read_only(np.zeros(len(nowhere))) for name in {*found["controls"]} - acting}
    shown = {name: values for name, values in reactions.items() if name not in texts}
    return found | {"reactions": shown, "residuals": kept}


def _joined(parts: Sequence[Any]) -> Any:
    """Put values of phases one after the other; texts that differ, too."""
    if isinstance(parts[0], dict):
        return {name: _joined([part[name] for part in parts]) for name in parts[0]}
    if isinstance(parts[0], tuple):
        return tuple(_joined([part[k] for part in parts]) for k in range(len(parts[0])))
    if isinstance(parts[0], str):
        return "; ".join(dict.fromkeys(filter(None, parts)))
    return read_only(np.concatenate(parts))


def lowest_gaps(system: System, stretches: Sequence[Stretch], t: Array, seen: Postures) -> dict[str, float]:
    """Return the lowest gap [m] of each contact, without the time in which its `when` has refused it; none of legs."""
    found = {}
    for point in system.points:
        if isinstance(point, LegPoint):
            continue
        places, lowest = motion_of(point, seen)[0], np.inf
        for stretch in stretches:
            if stretch.footings[point.index].state != AWAY:
                own = range(stretch.first, stretch.last)
                lowest = min([lowest, *(point.gap(float(t[i]), places[i]) for i in own)])
        found[point.name] = float(lowest)
    return found
