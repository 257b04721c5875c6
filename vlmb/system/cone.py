"""Contacts that push and rub: which of them open, stick or slip, and their impulses or forces.

One problem, of velocities at an impact and of accelerations after an event. Rows are velocities (accelerations) of contact points
along normals and tangents, and of ideal constraints; G = J M^-1 J^T says what reactions p do to them:

    v = G p + v_free
    v_n >= -e v_n^-   perpendicular to   p_n >= 0             (Signorini; Moreau and Newton at an impact, e = 0 for accelerations)
    |p_t| <= hold p_n  where v_t = 0,   p_t = -slip p_n v_t/|v_t|  elsewhere                                            (Coulomb)
    v = 0                                                                                        (rows of no contact: ideal ones)

Modes are tried from the most sticking one on; in each the problem is linear but for the directions of slipping, which Newton's
method finds. G may be singular (feet that share a load): then reactions are the least admissible ones, see least_reactions.py.
Everything is numpy: a run has few events, and compiling would take longer than all of them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.system.least_reactions import RANK, Part, least

Array = NDArray[np.float64]

GENTLE = 1e-6  # m/s: an approach that is slower has no restitution
TOLERANCE = 1e-11  # of inequalities, against the size of the terms they compare
SAME = 1e-9  # two answers whose velocities differ by less are one
TURNS = 40  # steps of Newton's method on directions
SETTLED = 1e-13  # rad, the last of them


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


def impact(g: Array, v: Array, contacts: Sequence[Contact]) -> Answer | Refusal:
    """Return impulses p (N s) and velocities after: v^+ = G p + v^-, Moreau's and Newton's law.

    All contacts that are closed or touch take part. A contact that leaves, or approaches slower than GENTLE, has no
    restitution. The kinetic energy lost to fixed surfaces is -p.(v^- + v^+)/2.
    """
    shift = np.zeros(v.size)
    for contact in contacts:
        if v[contact.normal] < -GENTLE:
            shift[contact.normal] = contact.restitution * v[contact.normal]
    found = _solve(g, v + shift, contacts, rough_limit=True)
    return found if isinstance(found, Refusal) else found._replace(v=_fixed(found.v - shift))


def modes(g: Array, a: Array, contacts: Sequence[Contact]) -> Answer | Refusal:
    """Return forces p (N) and accelerations of all rows, from the accelerations `a` without contact forces.

    Contacts are those whose gap and normal velocity are zero; a grip that slides has its direction in `sliding`.
    """
    return _solve(g, a, contacts, rough_limit=False)


def reactions(
    g: Array, a: Array, contacts: Sequence[Contact], closed: Sequence[bool], slipping: Sequence[Sequence[bool]]
) -> Answer | None:
    """Return what `modes` would if contacts are in these modes, or None where they cannot stay in them."""
    mode = tuple(tuple(slips) if shut else None for shut, slips in zip(closed, slipping, strict=True))
    for found in _answers(_Problem(g, a, tuple(contacts)), mode, thorough=False):
        return found
    return None


# A mode: None for an open contact, else whether each of its grips slips -------------------------------------------------

Mode = tuple[tuple[bool, ...] | None, ...]
Directions = dict[tuple[int, int], Array]  # of slipping, by contact and grip


class _Problem(NamedTuple):
    g: Array
    b: Array
    contacts: tuple[Contact, ...]


def _solve(g: Array, b: Array, contacts: Sequence[Contact], *, rough_limit: bool) -> Answer | Refusal:
    problem = _Problem(g, b, tuple(contacts))
    every = _modes(problem.contacts, rough_limit)
    for thorough in (False, True):
        best: Answer | None = None
        for mode in every:
            for found in _answers(problem, mode, thorough=thorough):
                if best is None:
                    best = found
                elif not _equal(best, found, problem):
                    return best._replace(several=True)
            if best is not None and _unique(problem):
                return best
        if best is not None:
            return best
    return _refusal(problem)


def _unique(problem: _Problem) -> bool:
    """Without friction, or where nothing may slip, velocities are those of a convex problem: one answer."""
    return all(grip.slip == 0.0 for contact in problem.contacts for grip in contact.grips)


def _equal(one: Answer, other: Answer, problem: _Problem) -> bool:
    size = np.abs(problem.b) + np.abs(problem.g) @ np.maximum(np.abs(one.p), np.abs(other.p))
    return bool(np.all(np.abs(one.v - other.v) <= SAME * np.max(size, initial=0.0)))


def _modes(contacts: Sequence[Contact], rough_limit: bool) -> list[Mode]:
    """All modes, from the most sticking one on; those with a rough contact that slips, the limit of much friction, come last."""
    choices = []
    for contact in contacts:
        states: list[tuple[bool, ...]] = []
        for grip in contact.grips:
            if grip.sliding is not None or grip.hold == 0.0:
                states.append((True,))
            elif math.isinf(grip.slip):
                states.append((False, True) if rough_limit and len(contact.grips) == 1 else (False,))
            else:
                states.append((False, True))
        choices.append([None, *itertools.product(*states)])

    def key(mode: Mode) -> tuple[bool, int, int]:
        pairs = list(zip(contacts, mode, strict=True))
        limits = any(
            slips and math.isinf(grip.slip)
            for contact, state in pairs
            for grip, slips in zip(contact.grips, state or (), strict=False)
        )
        return limits, -sum(state.count(False) for state in mode if state), sum(state is None for state in mode)

    return sorted(itertools.product(*choices), key=key)


class _Frame(NamedTuple):
    """Unknowns of a mode: p = columns y, where G p + b vanishes in `rows`; which of them push, and which of them stick."""

    columns: Array  # (m, k)
    rows: Array  # (k,), the row that each unknown is there for
    normals: dict[int, int]  # contact -> unknown
    sticks: list[tuple[int, int, tuple[int, ...]]]  # contact, grip, unknowns


def _frame(problem: _Problem, mode: Mode, directions: Directions) -> _Frame:
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
    return _Frame(np.array(columns).reshape(len(rows), problem.b.size).T, np.array(rows, int), normals, sticks)


def _inverse(problem: _Problem, frame: _Frame) -> Array:
    """Return the pseudo-inverse of the mode's matrix, of rows and unknowns made comparable by the diagonal of G."""
    if not frame.rows.size:
        return np.zeros((0, 0))
    diagonal = np.diag(problem.g)[frame.rows]
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    matrix = scale[:, None] * (problem.g[frame.rows] @ frame.columns) * scale
    return scale[:, None] * np.linalg.pinv(matrix, rcond=RANK) * scale


def _answers(problem: _Problem, mode: Mode, *, thorough: bool) -> Iterator[Answer]:
    """Yield admissible answers of a mode: one, or one from each start of the directions of slipping."""
    known: Directions = {}
    unknown = []
    for k, (contact, state) in enumerate(zip(problem.contacts, mode, strict=True)):
        for j, grip in enumerate(contact.grips if state else ()):
            if state and state[j] and grip.slip > 0.0:
                if grip.sliding is None:
                    unknown.append((k, j))
                else:
                    known[k, j] = np.array(grip.sliding, dtype=np.float64)
    for start in _starts(problem, mode, unknown, known, thorough):
        found = _settled(problem, mode, known | start, unknown)
        if found is not None:
            yield found


def _starts(
    problem: _Problem, mode: Mode, unknown: Sequence[tuple[int, int]], known: Directions, thorough: bool
) -> Iterator[Directions]:
    """Yield directions of slipping to start from: both ways along one row; in a plane those of no friction, and a fan."""
    smooth: Array | None = None
    choices: list[list[Array]] = []
    for k, j in unknown:
        rows = list(problem.contacts[k].grips[j].rows)
        if len(rows) == 1:
            choices.append([np.array([1.0]), np.array([-1.0])])
            continue
        if smooth is None:
            nothing = {(i, n): np.zeros(len(problem.contacts[i].grips[n].rows)) for i, n in unknown}
            frame = _frame(problem, mode, known | nothing)
            smooth = problem.b - problem.g @ frame.columns @ _inverse(problem, frame) @ problem.b[frame.rows]
        fan = [part / size for part in (smooth[rows], problem.b[rows]) if (size := float(np.linalg.norm(part))) > 0.0]
        if thorough or not fan:
            count = 32 if len(unknown) == 1 else 6
            fan += [np.array([math.cos(angle), math.sin(angle)]) for angle in 2.0 * math.pi * np.arange(count) / count]
        choices.append(fan)
    for chosen in itertools.product(*choices):
        yield dict(zip(unknown, chosen, strict=True))


def _settled(
    problem: _Problem, mode: Mode, directions: Directions, unknown: Sequence[tuple[int, int]]
) -> Answer | None:
    """Return the answer of a mode once directions of slipping in a plane are those of the velocities; None if not admissible."""
    turning = [key for key in unknown if len(problem.contacts[key[0]].grips[key[1]].rows) == 2]
    last = math.inf
    for _ in range(TURNS):
        frame = _frame(problem, mode, directions)
        inverse = _inverse(problem, frame)
        y = -inverse @ problem.b[frame.rows]
        p = frame.columns @ y
        v = problem.g @ p + problem.b
        if not turning:
            break
        turn = _turn(problem, directions, turning, frame, inverse, y, v)
        if turn is None:
            return None
        for key, angle in zip(turning, turn, strict=True):
            c, s = directions[key]
            cosine, sine = math.cos(angle), math.sin(angle)
            directions[key] = np.array([c * cosine - s * sine, s * cosine + c * sine])
        last = float(np.max(np.abs(turn)))
        if last < 1e-15:
            break
    if turning and last > SETTLED:
        return None
    return _admitted(problem, mode, directions, unknown, frame, p, v)


def _turn(
    problem: _Problem,
    directions: Directions,
    turning: Sequence[tuple[int, int]],
    frame: _Frame,
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
    problem: _Problem,
    mode: Mode,
    directions: Directions,
    unknown: Sequence[tuple[int, int]],
    frame: _Frame,
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
        if directions[k, j] @ v[rows] < -TOLERANCE * np.max(sizes[rows]):
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
    return Answer(_fixed(p), _fixed(v), closed, slipping, shared=shared)


def _tangents(problem: _Problem) -> list[int]:
    return [row for contact in problem.contacts for grip in contact.grips for row in grip.rows]


def _least(problem: _Problem, frame: _Frame, moved: Array, change: Array) -> Array | None:
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


def _refusal(problem: _Problem) -> Refusal:
    """Say why no mode is admissible, from what is left of G once ideal rows are held."""
    frame = _frame(problem, (None,) * len(problem.contacts), {})
    inverse = _inverse(problem, frame)
    held = problem.g - problem.g[:, frame.rows] @ inverse @ problem.g[frame.rows]
    free = problem.b - problem.g[:, frame.rows] @ (inverse @ problem.b[frame.rows])
    if np.any(np.abs(free[frame.rows]) > 1e-9 * np.max(np.abs(problem.b), initial=0.0)):
        return Refusal("rows")
    numbers = []
    for k, contact in enumerate(problem.contacts):
        normal = contact.normal
        if free[normal] < 0.0 and held[normal, normal] <= RANK * problem.g[normal, normal]:
            return Refusal("prescribed", k)
        number = held[normal, normal]
        for grip in contact.grips:
            if grip.sliding is not None:
                number -= grip.slip * float(held[normal, list(grip.rows)] @ np.array(grip.sliding))
        numbers.append((number, k))
    number, k = min(numbers, default=(math.nan, 0))
    return Refusal("friction", k, number) if number <= 0.0 else Refusal("none")


def _fixed(values: Array) -> Array:
    values.setflags(write=False)
    return values
