"""What acts where a run begins, in a scene whose programmes, forces or laws go by phases."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from vlmb.errors import SceneError
from vlmb.scene.by_phase import acting, goes_by_phase
from vlmb.system.contacts import Footing
from vlmb.system.forces import StateView
from vlmb.system.legs import LegPoint
from vlmb.system.start import Start, consistent_start
from vlmb.system.system import System

NEAR_AT_START = 1e-6  # [m] a gap that counts as none


def beginning(system: System, t0: float, closed: Collection[str] = ()) -> System:
    """Return the system of a phase that begins at t0 [s], with what acts while these contacts are closed, but not their rows."""
    if goes_by_phase(system.mechanism.scene) or system.by_phase_time:
        return system.phase([Footing()] * len(system.points), began=t0, closed=closed)
    return system


def start_in_phase(system: System, t0: float) -> Start:
    """Make a consistent start, with the programmes that act where its contacts are closed."""
    start, scene = consistent_start(beginning(system, t0), t0), system.mechanism.scene
    if not goes_by_phase(scene):
        return start
    view = StateView(system.mechanism, t0, system.mechanism.postures(start.state), start.branch, start.state)
    closed = touching(system, view)
    if acting(scene, closed)[0] == acting(scene, ())[0]:
        return start
    return consistent_start(beginning(system, t0, closed), t0)


def touching(system: System, view: StateView) -> frozenset[str]:
    """Return the names of contacts whose points are on their surfaces."""
    found = set[str]()
    for point in system.points:
        if isinstance(point, LegPoint):
            found |= {point.name} if point.leg.foot is not None else set()
            continue
        place = [view[name] if name else 0.0 for name in point.names]
        _, size = point.steepness(view.t, np.array(place), Footing())
        if abs(point.surface.at(view.t, place)[0]) <= NEAR_AT_START * size:
            found.add(point.name)
    return frozenset(found)


def refuse_contacts(system: System, view: StateView) -> None:
    """Raise SceneError where contacts touch or legs stand: what they do there is found by a run."""
    names = sorted(touching(system, view)) if system.points else []
    if names:
        why = "whether they push, slip or open is found in a run: take its first sample, or lift them off"
        raise SceneError(f"contacts: {', '.join(names)} touch here, and {why}")
