"""Contacts in given modes: a linear problem, but for directions of slipping that are to be those of the velocities."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.system.least_reactions import RANK, Part, least

Array = NDArray[np.float64]

TOLERANCE = 1e-12  # of inequalities, against the size of the terms they compare
TURNS = 40  # steps of Newton's method on directions
SETTLED = 1e-9  # rad, where they end at rounding
FAN = 24  # sets of directions to begin with where nothing else led to an answer


class Grip(NamedTuple):
    """Friction of a contact along one or two rows: a tangent plane, or the edge or the length of a ski.

    `hold` bounds |p| / p_n where nothing slides (inf: rough, it never slides while it pushes), `slip` is the ratio while it does.
    `sliding` is the unit direction of a sliding that goes on, with accelerations; None where the speed is zero or, at an impact,
    where the direction afterwards is to be found.
    """

    rows: tuple[int, ...]
    hold: float
    slip: float
    sliding: tuple[float, ...] | None = None


class Contact(NamedTuple):
    """A point that may touch: the row of its normal, its friction, and the restitution of an impact."""

    normal: int
    grips: tuple[Grip, ...] = ()
    restitution: float = 0.0


class Answer(NamedTuple):
    """What happens: reactions and velocities (accelerations) of all rows, and the modes.

    `closed` has a truth for each contact, `slipping` one for each grip of each contact (False while open). `several` is true
    where other modes are admissible too and move otherwise; this is the most sticking one. `shared` is true where the reactions
    are not determined: then p is the least admissible.
    """

    p: Array
    v: Array
    closed: tuple[bool, ...]
    slipping: tuple[tuple[bool, ...], ...]
    several: bool = False
    shared: bool = False


class Refusal(NamedTuple):
    """No mode is admissible. `contact` is the one that asks for too much, or None.

    why: "rows": ideal rows contradict each other; "prescribed": nothing can change the normal velocity of a contact that
    approaches; "friction": friction presses a sliding contact down more than it resists (Painleve), `number` is the
    acceleration of its normal for a unit of normal force, which is not positive; "none": no mode found.
    """

    why: str
    contact: int | None = None
    number: float = math.nan


Mode = tuple[tuple[bool, ...] | None, ...]  # of each contact: None where it is open, else whether each of its grips slips
Directions = dict[tuple[int, int], Array]  # of slipping, by contact and grip


class Problem(NamedTuple):
    """v = g p + b, and the contacts among its rows."""

    g: Array
    b: Array
    contacts: tuple[Contact, ...]


class Frame(NamedTuple):
    """Unknowns of a mode: p = columns y, where G p + b vanishes in `rows`; which of them push, and which of them stick."""

    columns: Array  # (m, k)
    rows: Array  # (k,), the row that each unknown is there for
    normals: dict[int, int]  # contact -> unknown
    sticks: list[tuple[int, int, tuple[int, ...]]]  # contact, grip, unknowns


def frame_of(problem: Problem, mode: Mode, directions: Directions) -> Frame:
    """Return the unknowns of a mode, and the rows in which nothing may move."""
    unit = np.eye(problem.b.size)
    of_contacts = {contact.normal for contact in problem.contacts}
    of_contacts.update(row for contact in problem.contacts for grip in contact.grips for row in grip.rows)
    rows = [row for row in range(problem.b.size) if row not in of_contacts]
    columns = [unit[row] for row in rows]
    normals, sticks = {}, []
    for k, (contact, state) in enumerate(zip(problem.contacts, mode, strict=True)):
        if state is None:
            continue
        normals[k] = len(rows)
        rows.append(contact.normal)
        columns.append(unit[contact.normal].copy())
        push = columns[-1]
        for j, (grip, slips) in enumerate(zip(contact.grips, state, strict=True)):
            if not slips:
                sticks.append((k, j, tuple(range(len(rows), len(rows) + len(grip.rows)))))
                rows.extend(grip.rows)
                columns.extend(unit[row] for row in grip.rows)
            elif math.isinf(grip.slip):  # the limit of much friction: a force along the ground without one that presses
                push[contact.normal] = 0.0
                push[list(grip.rows)] = -directions[k, j]
            elif grip.slip > 0.0:
                push[list(grip.rows)] = -grip.slip * directions[k, j]
    return Frame(np.array(columns).reshape(len(rows), problem.b.size).T, np.array(rows, int), normals, sticks)


def inverse_of(problem: Problem, frame: Frame) -> Array:
    """Return the pseudo-inverse of the mode's matrix, of rows and unknowns made comparable by the diagonal of G."""
    if not frame.rows.size:
        return np.zeros((0, 0))
    diagonal = np.diag(problem.g)[frame.rows]
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    matrix = scale[:, None] * (problem.g[frame.rows] @ frame.columns) * scale
    return scale[:, None] * np.linalg.pinv(matrix, rcond=RANK) * scale


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
    for signs in itertools.product((1.0, -1.0), repeat=len(lines)):
        fixed_ones = known | {key: np.array([sign]) for key, sign in zip(lines, signs, strict=True)}
        for turning in _starts(problem, mode, fixed_ones, planes, start or {}, thorough):
            found = _settled(problem, mode, fixed_ones | turning, lines, planes)
            if found is not None:
                yield found


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
    for _ in range(TURNS):
        frame = frame_of(problem, mode, directions)
        inverse = inverse_of(problem, frame)
        y = -inverse @ problem.b[frame.rows]
        y -= inverse @ (problem.g[frame.rows] @ (frame.columns @ y) + problem.b[frame.rows])  # to rounding
        p = frame.columns @ y
        v = problem.g @ p + problem.b
        if not planes:
            break
        turn = _turn(problem, directions, planes, frame, inverse, y, v)
        if turn is None:
            return None
        for key, angle in zip(planes, turn, strict=True):
            c, s = directions[key]
            cosine, sine = math.cos(angle), math.sin(angle)
            directions[key] = np.array([c * cosine - s * sine, s * cosine + c * sine])
        before, last = last, float(np.max(np.abs(turn)))
        if last < SETTLED and (last < 1e-15 or last > 0.5 * before):  # to rounding
            break
    if planes and last > SETTLED:
        return None
    return _admitted(problem, mode, directions, [*lines, *planes], frame, p, v)


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
) -> Answer | None:
    """Return the answer if every row and inequality holds; with reactions that are not determined, their least."""
    weights = 1.0 / np.sqrt(np.where((diagonal := np.diag(problem.g)) > 0.0, diagonal, 1.0))
    moved = weights[:, None] * (problem.g @ frame.columns)
    values = np.linalg.svd(moved / np.maximum(np.linalg.norm(moved, axis=0), 1e-300), compute_uv=False)
    shared = bool(values.size) and bool(values[-1] <= RANK * values[0])
    if shared:
        found = _least(problem, frame, moved, weights * (v - problem.b))
        if found is None:
            return None
        p = found
        v = problem.g @ p + problem.b
    sizes = np.abs(problem.b) + np.abs(problem.g) @ np.abs(p)
    if np.any(np.abs(v[frame.rows]) > TOLERANCE * sizes[frame.rows]):
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


def _least(problem: Problem, frame: Frame, moved: Array, change: Array) -> Array | None:
    """Return the least p in a mode's cones that gives the same velocities; None if the cones hold none.

    Unknowns are scaled so that their squares add up to those of p. A normal force that bounds more than one grip stands once for
    each, and equations make these equal.
    """
    count = frame.rows.size
    bounded: dict[int, list[tuple[float, tuple[int, ...]]]] = {k: [] for k in frame.normals}
    for k, j, unknowns in frame.sticks:
        hold = problem.contacts[k].grips[j].hold
        if not math.isinf(hold):
            bounded[k].append((hold, unknowns))
    columns, parts, equal = [moved[:, n] for n in range(count)], [], []
    shapes = [frame.columns[:, n] for n in range(count)]
    for k, first in frame.normals.items():
        copies = max(1, len(bounded[k]))
        weight = float(np.linalg.norm(shapes[first])) * math.sqrt(copies)
        columns[first], shapes[first] = columns[first] / weight, shapes[first] / weight
        firsts = [first]
        for _ in range(copies - 1):
            firsts.append(len(columns))
            equal.append((first, len(columns)))
            columns.append(columns[first])
            shapes.append(shapes[first])
        if not bounded[k]:
            parts.append(Part((first,), 0.0))
        for one, (hold, unknowns) in zip(firsts, bounded[k], strict=False):
            parts.append(Part((one, *unknowns), hold * copies / weight))
    matrix = np.vstack([np.column_stack(columns), np.zeros((len(equal), len(columns)))])
    for n, (one, other) in enumerate(equal):
        matrix[change.size + n, [one, other]] = 1.0, -1.0
    y = least(matrix, np.concatenate([change, np.zeros(len(equal))]), parts)
    return None if y is None else np.column_stack(shapes) @ y


def fixed(values: Array) -> Array:
    """Return the array made read-only."""
    values.setflags(write=False)
    return values
