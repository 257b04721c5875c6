"""Forces along a run in phases: each phase by its own system, and the forces of contacts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from vlmb.model.frozen import read_only
from vlmb.model.reading import Postures
from vlmb.scene.rows import rows_of
from vlmb.simulation.histories import forces_along
from vlmb.simulation.phases import Stretch
from vlmb.system.constraints import ConstraintSet
from vlmb.system.contacts import AWAY, CLOSED, STANDING
from vlmb.system.frames import LinkFrames
from vlmb.system.legs import LegPoint
from vlmb.system.sharing import Foot, foot_of, least_shares
from vlmb.system.ski_contact import ski_frame
from vlmb.system.slips import force_of, heading_at, motion_of
from vlmb.system.stops import StopPoint
from vlmb.system.system import System

Array = NDArray[np.float64]

SHARED = 1e-9  # of the rows of contacts: singular values that are none


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
        headings = np.array([np.cos(seen.heading[own]), np.sin(seen.heading[own])]).T
        if isinstance(point, LegPoint) and footing.state == STANDING:
            places, speeds = (values[own] for values in motion_of(point, seen))
            for i in range(len(forces)):
                forces[i] = point.pushes(places[i], speeds[i], footing) * point.slope(0.0, places[i], footing)
        elif footing.planted:
            forces = np.array(found["ground"])
        elif footing.state in CLOSED:
            rows = point.row_texts(footing)
            texts |= {*rows}
            multipliers = np.array([reactions[text] for text in rows] or np.zeros((0, len(forces)))).T
            places, speeds = (values[own] for values in motion_of(point, seen))
            for i, t in enumerate(taken[0].tolist()):
                forces[i] = force_of(point, footing, t, places[i], speeds[i], multipliers[i], tuple(headings[i].tolist()))
        reactions[point.name] = read_only(forces[:, 0] if isinstance(point, StopPoint) else forces)
    nowhere = read_only(np.full(len(taken[0]), np.nan))
    pairs = zip(system.points, stretch.footings, strict=True)
    if sum(footing.state in CLOSED and point.shares for point, footing in pairs) > 1:
        reactions |= _shared_out(phase, stretch, taken, reactions)
    if system.points[-1].edge is not None:
        reactions |= _of_snow(reactions[system.points[-1].name], seen.heading[own], stretch.footings[-1].state in CLOSED)
    kept = {row.name: (nowhere, nowhere) for row in rows_of(system.mechanism.scene).servo}  # of programmes that do not act
    kept |= {name: values for name, values in found["residuals"].items() if name not in texts}
    acting = {*(phase.programme.names if phase.programme else ()), *(channel.name for channel in phase.forces.named)}
    acting |= {at.force for at in phase.prescribed}
    found["controls"] |= {name: read_only(np.zeros(len(nowhere))) for name in {*found["controls"]} - acting}
    shown = {name: values for name, values in reactions.items() if name not in texts}
    return {name: values for name, values in found.items() if name != "ground"} | {"reactions": shown, "residuals": kept}


def _of_snow(forces: Array, heading: Array, closed: bool) -> dict[str, Array]:
    """Return the parts of the force (N, 3) of the snow on a ski that may lift; in the air its moments are 0."""
    c, s = np.cos(heading), np.sin(heading)
    x, y, normal = forces.T
    found = {"knife_edge": c * y - s * x, "friction": c * x + s * y, "normal": normal}
    found |= {} if closed else dict.fromkeys(("roll_moment", "pitch_moment"), np.zeros(len(forces)))
    return {name: read_only(values) for name, values in found.items()}


def _shared_out(
    phase: System, stretch: Stretch, taken: Sequence[Array], reactions: Mapping[str, Array]
) -> dict[str, Array]:
    """Return the least admissible forces (N, 3) of closed contacts that push together as those do that carry.

    Nothing where the forces are determined.
    """
    plane, pairs = phase.mechanism.scene.plane, zip(phase.points, stretch.footings, strict=True)
    closed = [(point, footing) for point, footing in pairs if footing.state in CLOSED and point.shares]
    axes = [0, 2] if plane else [0, 1, 2]
    places = ConstraintSet(phase.mechanism, [(f"{p.names[axis]} = 0", "contacts", True) for p, _ in closed for axis in axes])
    frames, found = LinkFrames(phase.mechanism), {p.name: np.array(reactions[p.name]) for p, _ in closed}
    for i, (t, q, v, branch) in enumerate(zip(taken[0].tolist(), taken[1], taken[2], taken[4], strict=True)):
        frames.update(q)
        seen = places.evaluate(frames, t, q, v, branch)
        jacobian = seen.jacobian.copy()
        jacobian[:, [at for at in phase.prescribed_dofs if at not in phase.planted_dofs]] = 0.0
        turns, feet, last = list[Array](), list[Foot](), -1
        for k, (point, footing) in enumerate(closed):
            place = np.zeros(3)
            place[axes] = seen.z[len(axes) * k : len(axes) * (k + 1)]
            frame, _ = point.frame(t, place, plane, footing)
            if point.edge is not None:
                frame = ski_frame(heading_at(q))[[0, 1, 2] if point.edge.friction else [0, 2]]
            frame = frame[[0, 2]] if plane else frame
            last += len(frame)
            feet.append(foot_of(point, footing, frame, last))
            turns.append(frame[:, axes])
        turn = scipy.linalg.block_diag(*turns)
        if i == 0 and np.linalg.matrix_rank(turn @ jacobian, tol=SHARED) == len(turn):
            return {}
        forces = np.concatenate([found[p.name][i, axes] for p, _ in closed])
        shares = least_shares(turn @ jacobian, jacobian.T @ forces, feet)
        forces = forces if shares is None else turn.T @ shares
        for k, (point, _) in enumerate(closed):
            found[point.name][i, axes] = forces[len(axes) * k : len(axes) * (k + 1)]
    return {name: read_only(values) for name, values in found.items()}


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
