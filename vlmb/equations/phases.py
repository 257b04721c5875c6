"""What a phase adds to the equations of motion: the rows of closed contacts and of ideal constraints, in the paper's coordinates.

    A c'' + b = Q + W^T lambda,    W c'' + w = 0

On a free base the first contact of a phase takes the base's coordinates out: c' = B u with u the rates of the links, so that
B^T A B is the matrix of the chain which hangs on the foot that stands, as (7.13) is that of the chain on the ski.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, nearest
from vlmb.model.layout import State
from vlmb.model.mechanism import Mechanism
from vlmb.model.velocity_map import VelocityMap
from vlmb.scene.rows import rows_of
from vlmb.system.constraints import ConstraintSet
from vlmb.system.contacts import HELD, ContactPoint, Footing, by_rows
from vlmb.system.frames import LinkFrames
from vlmb.system.ski_point import SkiPoint
from vlmb.system.system import make_system

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PhaseRows:
    """Rows of a phase at a posture: W c'' + w = 0."""

    names: tuple[str, ...]  # of contacts by axis, such as left.z, first; then of ideal constraints
    jacobian: Array  # W (r, N)
    drift: Array  # w (r,)
    supported: tuple[str, ...]  # coordinates that are left where the first contact takes those of the base out; else none
    reduction: Array  # B (N, n): rates by theirs
    carried: Array  # (N,) accelerations where theirs are 0


def phase_rows(
    mechanism: Mechanism, coordinates: Mapping[str, float], rates: Mapping[str, float], chart: VelocityMap, closed: Sequence[str]
) -> PhaseRows:
    """Return the rows of the phase in which these contacts are closed and hold. Raises SceneError for names.

    Of a ski that may lift these are the snow's: z = 0, and its knife edge.
    """
    names = mechanism.layout.names
    system = make_system(mechanism)
    points = {point.name: point for point in system.points if type(point) is ContactPoint or isinstance(point, SkiPoint)}
    for name in closed:
        if name not in points:
            raise SceneError(f"closed: no contact {name!r:.80}; {nearest(name, points)}")
    state = mechanism.state(coordinates, rates)
    frames, branch = LinkFrames(mechanism), [coordinates[name] for name in names]
    frames.update(state.q)
    footings = []
    for point in system.points:
        if point.name in closed and isinstance(point, SkiPoint):
            footings.append(Footing(HELD))  # along itself it slides: friction is a force
        elif point.name in closed:
            place = _place(point, frames, state, branch)
            footings.append(by_rows(point.footing_at(HELD, 0.0, place, mechanism.scene.plane)))
        else:
            footings.append(Footing())
    phase = system.phase(footings)
    own, rows, contacts = len(mechanism.scene.constraints), phase.constraints, phase.contacts
    count = len(phase.mechanism.scene.constraints)
    assert contacts is not None
    if rows is None:
        return _supported(mechanism, (), np.zeros((0, len(names))), np.zeros(0), 0)
    values = rows.evaluate(frames, 0.0, state.q, state.v, branch, range(count))
    motion = np.array([rates[f"{name}_dot"] for name in names])
    jacobian, drift = chart.pull_back(values.jacobian), values.drift + values.jacobian @ chart.products(motion)
    labels = [row.name for row in rows_of(mechanism.scene).ideal]
    at, first = list[int](), 0
    for name in closed:
        point, _, begin, size = next(entry for entry in contacts.closed if entry[0].name == name)
        at += range(begin, begin + size)
        labels += [f"{name}.{what}" for what in _axes(point, size)]
        first = first or size
    order = [*at, *range(own)]
    named = (*labels[own:], *labels[:own])
    return _supported(mechanism, named, jacobian[order], drift[order], first)


def _axes(point: ContactPoint, size: int) -> list[str]:
    """Name what the rows of a held contact hold."""
    if isinstance(point, SkiPoint):
        return ["normal", "knife_edge"]
    normal = point.plain
    if normal is None:
        return ["normal", "across", "aside"][:size]
    return [*"xyz"[normal], *("xyz"[axis] for axis in range(3) if axis != normal and point.names[axis])][:size]


def _place(point: ContactPoint, frames: LinkFrames, state: State, branch: Sequence[float]) -> Array:
    """Return where the point of a contact is [m]."""
    there, found = [axis for axis in range(3) if point.names[axis]], np.zeros(3)
    texts = [(f"{point.names[axis]} = 0", "contacts", True) for axis in there]
    found[there] = ConstraintSet(frames.mechanism, texts).evaluate(frames, 0.0, state.q, state.v, branch).z
    return found


def _supported(mechanism: Mechanism, names: tuple[str, ...], jacobian: Array, drift: Array, first: int) -> PhaseRows:
    """Take the coordinates of a free base out by the rows of the first contact, where these are as many."""
    layout, size = mechanism.layout, len(mechanism.layout.names)
    base = [at for at, coordinate in enumerate(layout.coordinates) if coordinate.link < 0]
    left = [at for at in range(size) if at not in base]
    if layout.base != "free" or not first or first != len(base):
        return PhaseRows(names, jacobian, drift, (), np.eye(size)[:, :0], np.zeros(size))
    inverse = np.linalg.inv(jacobian[:first][:, base])
    reduction, carried = np.zeros((size, len(left))), np.zeros(size)
    reduction[left, range(len(left))] = 1.0
    reduction[base] = -inverse @ jacobian[:first][:, left]
    carried[base] = -inverse @ drift[:first]
    return PhaseRows(names, jacobian, drift, tuple(layout.names[at] for at in left), reduction, carried)
