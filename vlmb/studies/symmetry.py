"""Symmetries of a mechanism with all that acts on it: whether its motion is the same at another place, or turned as a whole.

They are tried on the equations of motion themselves: what a scene names, and what cancels, need not be known.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.core import tree as columns
from vlmb.errors import VlmbError
from vlmb.model.arrays import Arrays
from vlmb.model.layout import Layout
from vlmb.system.core_engine import CoreEngine
from vlmb.system.jets import Numbers, cos, sin
from vlmb.system.system import System

Array = NDArray[np.float64]

ALIKE = 1e-9  # of the largest acceleration: by how much those of a moved state may differ
TURN, SHIFT = 0.7, 1.3  # [rad, m] by which a state is moved to see whether that matters
BESIDE = 0.05  # [m, rad, ...] how far from a state it is tried too


def symmetries(system: System, engine: CoreEngine, origin: Array, values: Array, t: float) -> tuple[bool, ...]:
    """Tell whether nothing depends on x, y, z, and on the heading, near a state; `values` (N,) are its coordinates."""
    layout = system.mechanism.layout
    found = [k in place_axes(layout) and _alike(system, engine, origin, values, t, 0.0, k) for k in range(3)]
    level = system.mechanism.scene.slope == 0.0 and (layout.headed or not layout.plane)
    return (*found, level and _alike(system, engine, origin, values, t, TURN, -1))


def place_axes(layout: Layout) -> list[int]:
    """Return the axes along which a base moves."""
    if layout.headed:
        return [0, 1, 2] if layout.lifts else [0, 1]
    if layout.base == "free":
        return [0, 2] if layout.plane else [0, 1, 2]
    return []


def turned(arrays: Arrays, y: Numbers, angle: Any, shift: Sequence[float] = (0.0, 0.0, 0.0)) -> Numbers:
    """Return a state of the core moved as a whole: turned about the vertical through the origin, then shifted."""
    y, w, c, s = np.array(y), arrays.positions, cos(angle), sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    if arrays.layout.headed:
        y[:2] = turn[:2, :2] @ y[:2] + np.array(shift[:2])
        y[2] += angle
        if arrays.layout.lifts:
            y[3] += shift[2]
    elif arrays.layout.base == "free":
        y[:3] = turn @ y[:3] + np.array(shift)
        y[w : w + 3] = turn @ y[w : w + 3]
    for d, u in _directions(arrays, y) if not arrays.upright else ():
        d[:], u[:] = turn @ d, turn @ u
    return y


def _directions(arrays: Arrays, y: Numbers) -> list[tuple[Numbers, Numbers]]:
    """Return the parts of a state where directions and their rates stand."""
    rows = [(int(row[columns.AT_P]), arrays.positions + int(row[columns.AT_V])) for row in arrays.tree.link]
    return [(y[at : at + 3], y[rate : rate + 3]) for at, rate in rows]


def _alike(
    system: System, engine: CoreEngine, origin: Array, values: Array, t: float, angle: float, axis: int
) -> bool:
    """Tell whether states that are turned, or shifted along an axis, move as they did."""
    arrays, tried = system.core_plan.arrays, 0
    for y in _around(arrays, origin):
        moved = turned(arrays, y, angle, [SHIFT * (k == axis) for k in range(3)])
        try:
            here, there = _rates(system, engine, values, t, y, 0.0), _rates(system, engine, values, t, moved, angle)
        except VlmbError:
            continue
        tried += 1
        back = turned(arrays, there, -angle)
        if arrays.layout.headed:
            back[2] = there[2]  # the rate of the heading is none of a place
        if np.abs(back - here).max() > ALIKE * max(1.0, float(np.abs(here).max())):
            return False
        if system.mechanism.scene.constraints and not _rows_alike(engine, t, y, moved):
            return False
    return tried > 0


def _rates(system: System, engine: CoreEngine, values: Array, t: float, y: Array, turn: float) -> Array:
    """Return y' with angles read near the coordinates, azimuths turned; without powers: work along x is none along y."""
    near = values.copy()
    for at, c in enumerate(system.mechanism.layout.coordinates):
        near[at] += turn * (c.kind in ("phi0", "phi"))
    table = system.core_plan.table
    engine.memory.reference[:] = table.reference(near)
    try:
        dy = engine.evaluate(t, y)
    finally:
        engine.memory.reference[:] = table.reference(values)
    dy[system.core_plan.positions + system.core_plan.velocities :] = 0.0
    return dy


def _rows_alike(engine: CoreEngine, t: float, y: Array, moved: Array) -> bool:
    here, there = engine.rows(t, y), engine.rows(t, moved)
    size = max(1.0, float(np.abs(here.z).max(initial=0.0)), float(np.abs(here.rate).max(initial=0.0)))
    off = max(float(np.abs(here.z - there.z).max(initial=0.0)), float(np.abs(here.rate - there.rate).max(initial=0.0)))
    return off <= ALIKE * size


def _around(arrays: Arrays, origin: Array) -> list[Array]:
    """Return a state, and two beside it."""
    found, rng = [origin], np.random.default_rng(1)
    for _ in range(2):
        y = origin + BESIDE * rng.standard_normal(len(origin))
        for d, u in _directions(arrays, y):
            if arrays.layout.plane:
                d[1] = u[1] = 0.0
            d /= np.linalg.norm(d)
            u -= (u @ d) * d
        found.append(y)
    return found
