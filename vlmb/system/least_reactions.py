"""The least reactions among admissible ones: the point of a product of cones, on an affine set, that is nearest to zero.

    minimise |y|^2 / 2   where   A y = c,   y in K

Its dual is a smooth convex function of few unknowns, and y = P_K(A^T u) of its least point u, found by Newton's method.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RANK = 1e-10  # singular values below this part of the largest are zero
CLOSE = 1e-13  # |A y - c| against |c|
ADMISSIBLE = 1e-11  # the same where a force is pinned at zero
STEPS = 60
SHORTEST = 1e-6  # part of a step


class Part(NamedTuple):
    """Unknowns of one cone: the first >= 0, and |the others| <= slope times the first; slope 0: the first alone.

    With `each` the others are bounded one by one: |other| <= its own slope times the first.
    """

    columns: tuple[int, ...]
    slope: float
    each: tuple[float, ...] = ()


def part_of(first: int, bounds: Sequence[tuple[float, tuple[int, ...]]]) -> Part:
    """Return the cone of a normal force that bounds frictions: each has its slope and its unknowns."""
    if len(bounds) > 1:  # of a ski: along itself and across
        return Part((first, *(at for _, unknowns in bounds for at in unknowns)), 0.0, tuple(slope for slope, _ in bounds))
    return Part((first, *bounds[0][1]), bounds[0][0]) if bounds else Part((first,), 0.0)


def least(a: Array, c: Array, parts: Sequence[Part]) -> Array | None:
    """Return the least y (k,) in all `parts` with a y = c, or None where there is none. Unknowns in no part are free."""
    size = float(np.linalg.norm(c))
    if size == 0.0:
        return np.zeros(a.shape[1])
    left, values, right = np.linalg.svd(a, full_matrices=False)
    keep = values > RANK * values[0] if values.size else values > 0.0
    rows = right[keep]
    target = (left[:, keep].T @ c) / values[keep]
    if np.linalg.norm(left[:, keep] @ (values[keep] * target) - c) > ADMISSIBLE * size:
        return None
    pinned: set[int] = set()
    for _ in range(len(parts) + 1):
        y = _newton(rows, target, [part for k, part in enumerate(parts) if k not in pinned], _dead(parts, pinned))
        scale = float(np.linalg.norm(target))
        if np.linalg.norm(rows @ y - target) <= ADMISSIBLE * scale:
            return y
        # The set may touch the cones at one point, where the dual has no least point: forces near zero are zero there.
        loads = {k: float(y[part.columns[0]]) for k, part in enumerate(parts) if k not in pinned}
        if not loads:
            break
        lightest = min(loads, key=lambda k: loads[k])
        if loads[lightest] > 1e-3 * float(np.max(np.abs(y), initial=0.0)):
            break
        pinned.add(lightest)
    return None


def _dead(parts: Sequence[Part], pinned: set[int]) -> list[int]:
    return [column for k in pinned for column in parts[k].columns]


def _newton(rows: Array, target: Array, parts: Sequence[Part], dead: Sequence[int]) -> Array:
    """Return y = P_K(rows^T u) after Newton's method on the dual; `rows` are orthonormal, unknowns in `dead` are zero."""
    rows = rows.copy()
    rows[:, dead] = 0.0
    u = target.copy()
    scale = float(np.linalg.norm(target))
    y, slopes = _project(rows.T @ u, parts)
    gradient = rows @ y - target
    value = 0.5 * float(y @ y) - float(target @ u)
    for _ in range(STEPS):
        error = float(np.linalg.norm(gradient))
        if error <= CLOSE * scale:
            break
        if np.linalg.norm(y) <= CLOSE * float(np.linalg.norm(u)) and target @ u > 0.0:
            break  # u separates the affine set from the cones
        damping = 1e-12 + 1e-3 * min(1.0, error / scale)
        step = -np.linalg.solve(rows @ slopes @ rows.T + damping * np.eye(u.size), gradient)
        descent = float(gradient @ step)
        length = 1.0
        while length > SHORTEST:
            tried = u + length * step
            y, slopes = _project(rows.T @ tried, parts)
            gradient = rows @ y - target
            new = 0.5 * float(y @ y) - float(target @ tried)
            if new <= value + 1e-4 * length * descent or np.linalg.norm(gradient) <= 0.5 * error:  # the latter at rounding
                break
            length *= 0.5
        else:
            break
        u, value = tried, new
    return y


def _project(z: Array, parts: Sequence[Part]) -> tuple[Array, Array]:
    """Return the nearest point of the cones and its derivative by z."""
    y, slopes = z.copy(), np.eye(z.size)
    for columns, slope, each in parts:
        where = np.array(columns)
        if each:
            turn = face_of(z[where], each)
            y[where], slopes[np.ix_(where, where)] = turn @ z[where], turn
            continue
        first, others = float(z[columns[0]]), z[where[1:]]
        across = float(np.linalg.norm(others))
        if first >= 0.0 and (not others.size or across <= slope * first):
            continue
        block = np.ix_(where, where)
        slopes[block] = 0.0
        if slope * across <= -first or not others.size:
            y[where] = 0.0
            continue
        unit = others / across
        edge = np.concatenate(([1.0], slope * unit)) / math.hypot(1.0, slope)  # the generator of the cone nearest to z
        along = float(edge @ z[where])
        y[where] = along * edge
        slopes[block] = np.outer(edge, edge)
        turning = along * slope / math.hypot(1.0, slope) / across
        slopes[np.ix_(where[1:], where[1:])] += turning * (np.eye(others.size) - np.outer(unit, unit))
    return y, slopes


def face_of(z: Array, each: Sequence[float]) -> Array:
    """Return what projects (n, n) on the face of a pyramid that is nearest: it takes z to its nearest point of the pyramid."""
    best, nearest, signs = np.zeros((z.size, z.size)), float(z @ z), np.copysign(1.0, z[1:])
    for bound in itertools.product((False, True), repeat=len(each)):
        ray = np.array([1.0, *(sign * slope if on else 0.0 for on, sign, slope in zip(bound, signs, each, strict=True))])
        turn = np.outer(ray, ray) / (ray @ ray) + np.diag([0.0, *(float(not on) for on in bound)])
        y = turn @ z
        inside = y[0] >= 0.0 and all(abs(y[1 + k]) <= slope * y[0] for k, slope in enumerate(each) if not bound[k])
        distance = float((z - y) @ (z - y))
        if inside and distance < nearest:
            best, nearest = turn, distance
    return best
