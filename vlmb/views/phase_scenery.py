"""What is drawn of phases: legs without mass, footprints, forces of contacts and impulses as arrows, and what happens when."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vlmb.model.reading import Postures
from vlmb.simulation.phases import Stretch
from vlmb.simulation.trajectory import Trajectory
from vlmb.system.contacts import ContactPoint
from vlmb.system.legs import LegPoint
from vlmb.system.slips import motion_of
from vlmb.system.stops import StopPoint
from vlmb.views import appearance, shapes
from vlmb.views.bodies import Body

Array = NDArray[np.float64]

PRINTS = 200  # footprints that are drawn, the last ones
SHOWN = 0.15  # [s] for which an impulse is seen
TOLD = 2000  # events that a page tells
LARGEST = 3.0  # weights, of the longest arrow of a force
VERBS = {"touch": "touches", "bounce": "bounces", "open": "opens", "slip": "slips", "stick": "sticks"}  # of a contact in a page
TINY = 1e-4  # scale of what is not to be seen


def draw_legs(run: Trajectory, when: Array, seen: Postures, size: float) -> tuple[list[Body], list[Array]]:
    """Draw legs without mass from their points to their feet at times (N,) [s]; `seen` at these times. Return feet (N, 3) too."""
    bodies, feet, at = list[Body](), list[Array](), _stretch_at(run, when)
    for point in run.system.points:
        if not isinstance(point, LegPoint):
            continue
        places, thin = motion_of(point, seen)[0], 0.016 * size
        feet.append(_feet(point, run.stretches, at, when, places))
        away = feet[-1] - places
        length = np.linalg.norm(away, axis=1)
        turned = towards(away / np.maximum(length, 1e-300)[:, None])
        scale = np.column_stack([np.maximum(length, 1e-6), np.ones((len(when), 2))])
        path = f"legs/{point.name}"
        bodies.append(Body(path, None, appearance.STRETCH, places, turned))
        bodies.append(Body(f"{path}/spring", shapes.bellows(thin, folds=8), appearance.STRETCH, scale=scale))
        foot = np.column_stack([length, np.zeros((len(when), 2))])
        bodies.append(Body(f"{path}/foot", shapes.ball(1.6 * thin), appearance.HINGE, foot))
    return bodies, feet


def draw_footprints(run: Trajectory, when: Array, size: float, floor: float) -> list[Body]:
    """Draw where contacts and legs stood on the ground, from the moment on in which they came down."""
    found = []
    for before, stretch in zip([None, *run.stretches], run.stretches, strict=False):
        for point in _on_ground(run):
            one, other = (stretch.footings[point.index], before.footings[point.index] if before else None)
            stood = other is not None and point.closed(other) and other.place == one.place
            if point.closed(one) and not stood and abs(one.place[2] - floor) < 0.01 * size:
                found.append((stretch.start, one.place))
    bodies, shape = [], shapes.disc(0.035 * size, 0.002 * size)
    for k, (t, place) in enumerate(found[-PRINTS:]):
        scale = np.where(when >= t - 1e-9, 1.0, TINY)[:, None] * np.ones(3)
        at = np.array([place[0], place[1], floor])
        bodies.append(Body(f"footprints/{k}", shape, appearance.FOOTPRINT, at, scale=scale, shadow=False, fits=False))
    return bodies


def draw_forces(run: Trajectory, when: Array, seen: Postures, reach: float, weight: float) -> list[Body]:
    """Draw the forces of contacts and legs, and for a moment their impulses, as arrows: `reach` [m] long for the weight [N]."""
    bodies, at = [], _stretch_at(run, when)
    arrow = shapes.arrow(reach)
    hits = [event for event in run.events if event.impulses]
    most = max((float(np.linalg.norm(p)) for event in hits for p in event.impulses.values()), default=1.0)
    for point in _on_ground(run):
        places = motion_of(point, seen)[0]
        if isinstance(point, LegPoint):
            places = _feet(point, run.stretches, at, when, places)
        forces = _between_events(run, when, at, run.reactions[point.name])
        bodies += [_arrow(f"forces/{point.name}", arrow, places, forces / max(weight, 1e-9), appearance.CONTACT_FORCE)]
        impulses = np.zeros((len(when), 3))
        for event in hits:
            if point.name in event.impulses:
                impulses[(when >= event.t) & (when < event.t + SHOWN)] = event.impulses[point.name] / most
        if impulses.any():
            bodies.append(_arrow(f"impulses/{point.name}", arrow, places, impulses, appearance.IMPULSE))
    return bodies


def told_events(run: Trajectory) -> list[tuple[float, str]]:
    """Return times and words of the events of contacts for a page: what happened, and how large an impulse was."""
    found = []
    for event in run.events[:TOLD]:
        pushed = [float(np.linalg.norm(p)) for p in event.impulses.values()]
        words = f"{event.name} {VERBS[event.kind]}" if event.kind in VERBS else event.name or event.kind
        words += f", {max(pushed):.3g} N s" if pushed else ""
        found.append((event.t, words))
    return found


def towards(directions: Array) -> Array:
    """Return rotations (N, 3, 3) that take x to directions (N, 3)."""
    upright = np.abs(directions[:, 2]) > 0.999
    other = np.where(upright[:, None], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    side = np.cross(other, directions)
    side /= np.maximum(np.linalg.norm(side, axis=1), 1e-300)[:, None]
    return np.stack([directions, side, np.cross(directions, side)], axis=2)


def _arrow(path: str, shape: shapes.Mesh, places: Array, vectors: Array, colour: str) -> Body:
    """Draw an arrow of vectors (N, 3), in its own lengths, at places."""
    size = np.linalg.norm(vectors, axis=1)
    ways = np.where(size[:, None] > 1e-9, vectors / np.maximum(size, 1e-300)[:, None], [0.0, 0.0, 1.0])
    scale = np.clip(size, TINY, LARGEST)[:, None] * np.ones(3)
    return Body(path, shape, colour, places, towards(ways), scale, shadow=False, in_front=True, fits=False)


def _on_ground(run: Trajectory) -> list[ContactPoint]:
    """Return contacts and legs, without the stops of lengths and a ski."""
    return [point for point in run.system.points if not isinstance(point, StopPoint) and point.edge is None]


def _stretch_at(run: Trajectory, when: Array) -> NDArray[np.int64]:
    """Return the phase (N,) of times."""
    starts = np.array([stretch.start for stretch in run.stretches])
    return np.clip(np.searchsorted(starts, when, side="right") - 1, 0, len(starts) - 1)


def _feet(point: LegPoint, stretches: tuple[Stretch, ...], at: NDArray[np.int64], when: Array, places: Array) -> Array:
    """Return where a leg's foot is (N, 3): its foothold, or ahead of its point while it swings."""
    found = np.array(places)
    for k in np.unique(at):
        own, footing = at == k, stretches[k].footings[point.index]
        if point.closed(footing):
            found[own] = footing.place
            continue
        for i in np.flatnonzero(own):
            found[i] = point.hangs_to(float(when[i]), places[i], footing)
    return found


def _between_events(run: Trajectory, when: Array, at: NDArray[np.int64], values: Array) -> Array:
    """Return values (N, 3) at times between samples of their own phases."""
    found = np.zeros((len(when), 3))
    for k in np.unique(at):
        stretch, own = run.stretches[k], at == k
        part = slice(stretch.first, stretch.last)
        if stretch.last > stretch.first:
            found[own] = np.column_stack([np.interp(when[own], run.t[part], values[part, axis]) for axis in range(3)])
    return found
