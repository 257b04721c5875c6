"""Contacts in given modes: a linear problem, but for directions of slipping that are to be those of the velocities."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from vlmb.system.cone_problem import (
    Answer,
    Array,
    Directions,
    Frame,
    Mode,
    Problem,
    fixed,
    frame_of,
    inverse_of,
    least_of,
    rank_lacks,
)
from vlmb.system.least_reactions import RANK

TOLERANCE = 1e-12  # of inequalities, against the size of the terms they compare
ROUNDING = 1e-3  # of the largest size among the rows: what a smaller one is compared with
TURNS = 60  # steps on directions
NEAR = 0.02  # rad, where Newton's method on directions begins if reactions are shared
SETTLED = 1e-9  # rad, where they end at rounding
FAN = 24  # sets of directions to begin with where nothing else led to an answer


def answers(problem: Problem, mode: Mode, *, start: Directions | None = None, thorough: bool = False) -> Iterator[Answer]:
    """Yield admissible answers of a mode, the same one more than once perhaps; `start` has directions to begin with too."""
    known: Directions = {}
    lines: list[tuple[int, int]] = []
    planes: list[tuple[int, int]] = []
    for k, (contact, state) in enumerate(zip(problem.contacts, mode, strict=True)):
        for j, grip in enumerate(contact.grips if state else ()):
            if state and state[j] and grip.slip > 0.0:
                if grip.sliding is not None:
                    known[k, j] = np.array(grip.sliding, dtype=np.float64)
                else:
                    (lines if len(grip.rows) == 1 else planes).append((k, j))
    for signs in _signs(lines, start or {}):
        fixed_ones = known | {key: np.array([sign]) for key, sign in zip(lines, signs, strict=True)}
        for turning in _starts(problem, mode, fixed_ones, planes, start or {}, thorough):
            found = _settled(problem, mode, fixed_ones | turning, lines, planes)
            if found is not None:
                yield found


def _signs(lines: Sequence[tuple[int, int]], start: Directions) -> list[tuple[float, ...]]:
    """Return all ways to slip along single rows, that of the start first."""
    first = tuple(float(start[key][0]) if key in start else 1.0 for key in lines)
    return list(itertools.product(*[(sign, -sign) for sign in first]))


def _starts(
    problem: Problem, mode: Mode, directions: Directions, planes: Sequence[tuple[int, int]], start: Directions, thorough: bool
) -> Iterator[Directions]:
    """Yield directions in planes to begin with: all there are if one is to be found, else those of no friction, and a fan."""
    if not planes:
        yield {}
        return
    still = directions | {key: np.zeros(2) for key in planes}
    frame = frame_of(problem, mode, still)
    inverse = inverse_of(problem, frame)
    y = -inverse @ problem.b[frame.rows]
    smooth = problem.g @ (frame.columns @ y) + problem.b
    if len(planes) == 1:
        for angle in _angles(problem, planes[0], frame, inverse, y, smooth):
            yield {planes[0]: np.array([math.cos(angle), math.sin(angle)])}
        return
    rows = np.array([problem.contacts[k].grips[j].rows for k, j in planes])
    tries = [np.array([start.get(key, np.zeros(2)) for key in planes]), smooth[rows], problem.b[rows]]
    if thorough:
        turns = 2.0 * math.pi * np.outer(np.arange(FAN), np.sqrt(2.0 + np.arange(len(planes))))
        tries += list(np.stack([np.cos(turns), np.sin(turns)], axis=-1))
    for tried in tries:
        sizes = np.linalg.norm(tried, axis=1)
        if np.all(sizes > 0.0):
            yield {key: way / size for key, way, size in zip(planes, tried, sizes, strict=True)}


def _angles(problem: Problem, key: tuple[int, int], frame: Frame, inverse: Array, y: Array, smooth: Array) -> list[float]:
    """Return every angle at which a single slipping contact slips along its velocity or against it.

    Everything else is linear in its friction force, so the velocity across the direction, times the determinant of the normal,
    is a trigonometric polynomial of degree 2: a quartic.
    """
    k, j = key
    grip = problem.contacts[k].grips[j]
    rows, push = list(grip.rows), float(y[frame.normals[k]])
    forces = np.zeros((smooth.size, 2))
    forces[rows] = np.eye(2)
    turned = -inverse @ (problem.g[frame.rows] @ forces)
    press, move = turned[frame.normals[k]], (problem.g @ (forces + frame.columns @ turned))[rows]
    angles = 2.0 * math.pi * np.arange(8) / 8
    along = np.array([np.cos(angles), np.sin(angles)])
    across = np.array([-along[1], along[0]])
    rough = math.isinf(grip.slip)
    ratio = 1.0 if rough else grip.slip
    determinant = (0.0 if rough else 1.0) + ratio * press @ along  # p_n = push / determinant; rough: the force along it is
    values = np.sum(across * (smooth[rows][:, None] * determinant - ratio * push * (move @ along)), axis=0)
    waves = np.fft.fft(values) / 8
    roots = np.roots([waves[2], waves[1], waves[0], waves[-1], waves[-2]])
    return [float(np.angle(root)) for root in roots if abs(abs(root) - 1.0) < 1e-3]


def _settled(
    problem: Problem,
    mode: Mode,
    directions: Directions,
    lines: Sequence[tuple[int, int]],
    planes: Sequence[tuple[int, int]],
) -> Answer | None:
    """Return the answer of a mode once directions of slipping in planes are those of the velocities; None if not admissible."""
    last = math.inf
    shared = rank_lacks(problem, frame_of(problem, mode, directions))
    for _ in range(TURNS):
        frame = frame_of(problem, mode, directions)
        inverse = inverse_of(problem, frame)
        if shared:
            least = least_of(problem, frame)
            if least is None:
                return None
            p = least
        else:
            y = -inverse @ problem.b[frame.rows]
            y -= inverse @ (problem.g[frame.rows] @ (frame.columns @ y) + problem.b[frame.rows])  # to rounding
            p = frame.columns @ y
        v = problem.g @ p + problem.b
        if not planes:
            break
        if shared:
            turn = _turn_shared(problem, mode, directions, planes, v)
        else:
            turn = _turn(problem, directions, planes, frame, inverse, y, v)
        if turn is None:
            return None
        directions = _turned(directions, planes, turn)
        before, last = last, float(np.max(np.abs(turn)))
        if last < SETTLED and (last < 1e-15 or last > 0.5 * before):  # to rounding
            break
    if planes and last > SETTLED:
        return None
    return _admitted(problem, mode, directions, [*lines, *planes], frame, p, v, shared)


def _turned(directions: Directions, planes: Sequence[tuple[int, int]], turn: Array) -> Directions:
    found = dict(directions)
    for key, angle in zip(planes, turn, strict=True):
        c, s = directions[key]
        cosine, sine = math.cos(angle), math.sin(angle)
        found[key] = np.array([c * cosine - s * sine, s * cosine + c * sine])
    return found


def _turn_shared(
    problem: Problem, mode: Mode, directions: Directions, planes: Sequence[tuple[int, int]], v: Array
) -> Array | None:
    """Return a step of directions where reactions are the least: a careful one, nearer one of Newton's method by differences."""
    angles = _off(directions, planes, problem, v)
    if np.max(np.abs(angles)) > NEAR:
        return 0.3 * angles
    slopes = np.empty((len(planes), len(planes)))
    for n in range(len(planes)):
        turn = np.zeros(len(planes))
        turn[n] = 1e-6
        other = _turned(directions, planes, turn)
        p = least_of(problem, frame_of(problem, mode, other))
        if p is None:
            return None
        slopes[:, n] = (_off(other, planes, problem, problem.g @ p + problem.b) - angles) / 1e-6
    return np.asarray(-np.linalg.lstsq(slopes, angles, rcond=RANK)[0], dtype=np.float64)


def _off(directions: Directions, planes: Sequence[tuple[int, int]], problem: Problem, v: Array) -> Array:
    """Return the angles from directions of slipping to those of the velocities [rad]."""
    found = []
    for k, j in planes:
        (c, s), (x, z) = directions[k, j], v[list(problem.contacts[k].grips[j].rows)]
        found.append(math.atan2(c * z - s * x, c * x + s * z))
    return np.array(found)


def _turn(
    problem: Problem,
    directions: Directions,
    turning: Sequence[tuple[int, int]],
    frame: Frame,
    inverse: Array,
    y: Array,
    v: Array,
) -> Array | None:
    """Return the step of Newton's method for the angles between directions and velocities to vanish [rad]."""
    angles, slopes = np.empty(len(turning)), np.empty((len(turning), len(turning)))
    changes = []
    for k, j in turning:
        grip = problem.contacts[k].grips[j]
        c, s = directions[k, j]
        force = np.zeros(v.size)
        force[list(grip.rows)] = (1.0 if math.isinf(grip.slip) else grip.slip) * np.array([s, -c]) * y[frame.normals[k]]
        changes.append(problem.g @ (force - frame.columns @ (inverse @ (problem.g[frame.rows] @ force))))
    for i, (k, j) in enumerate(turning):
        rows = list(problem.contacts[k].grips[j].rows)
        c, s = directions[k, j]
        along, across = c * v[rows[0]] + s * v[rows[1]], c * v[rows[1]] - s * v[rows[0]]
        square = along * along + across * across
        if square == 0.0:
            return None
        angles[i] = math.atan2(across, along)
        for n, change in enumerate(changes):
            x, z = c * change[rows[0]] + s * change[rows[1]], c * change[rows[1]] - s * change[rows[0]]
            slopes[i, n] = (along * z - across * x) / square - (1.0 if n == i else 0.0)
    try:
        step = -np.linalg.solve(slopes, angles)
    except np.linalg.LinAlgError:
        return None
    return np.clip(step, -0.7, 0.7) if np.all(np.isfinite(step)) else None


def _admitted(
    problem: Problem,
    mode: Mode,
    directions: Directions,
    unknown: Sequence[tuple[int, int]],
    frame: Frame,
    p: Array,
    v: Array,
    shared: bool,
) -> Answer | None:
    """Return the answer if every row and inequality holds, to rounding."""
    sizes = np.abs(problem.b) + np.abs(problem.g) @ np.abs(p)
    least = ROUNDING * np.max(sizes, initial=0.0)  # of rows that nothing acts on
    if np.any(np.abs(v[frame.rows]) > TOLERANCE * np.maximum(sizes[frame.rows], least)):
        return None
    pushes = [contact.normal for contact in problem.contacts]
    slack = TOLERANCE * float(np.max(np.abs(p[[*pushes, *_tangents(problem)]]), initial=0.0))
    for contact, state in zip(problem.contacts, mode, strict=True):
        if state is None:
            if v[contact.normal] < -TOLERANCE * sizes[contact.normal]:
                return None
        elif p[contact.normal] < -slack:
            return None
    for k, j, _ in frame.sticks:
        grip, push = problem.contacts[k].grips[j], p[problem.contacts[k].normal]
        if not math.isinf(grip.hold) and np.linalg.norm(p[list(grip.rows)]) > grip.hold * push + slack:
            return None
    for k, j in unknown:
        grip = problem.contacts[k].grips[j]
        rows = list(grip.rows)
        along = float(directions[k, j] @ v[rows])
        if along < -TOLERANCE * np.max(sizes[rows]):
            return None
        if np.linalg.norm(v[rows] - along * directions[k, j]) > TOLERANCE * np.max(sizes[rows]):
            return None
        if math.isinf(grip.slip) and directions[k, j] @ p[rows] > slack:
            return None
    p, v = p.copy(), v.copy()
    v[frame.rows] = 0.0
    for contact, state in zip(problem.contacts, mode, strict=True):
        if state is not None:
            p[contact.normal] = max(p[contact.normal], 0.0)
        else:
            v[contact.normal] = max(v[contact.normal], 0.0)
    closed = tuple(state is not None for state in mode)
    slipping = tuple(
        state if state is not None else (False,) * len(contact.grips)
        for contact, state in zip(problem.contacts, mode, strict=True)
    )
    return Answer(fixed(p), fixed(v), closed, slipping, shared=shared)


def _tangents(problem: Problem) -> list[int]:
    return [row for contact in problem.contacts for grip in contact.grips for row in grip.rows]
