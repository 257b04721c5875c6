"""A problem of contacts: its parts and answers, the unknowns of a mode, and the least reactions in it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.system.least_reactions import RANK, least, part_of

Array = NDArray[np.float64]


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


def rank_lacks(problem: Problem, frame: Frame) -> bool:
    """Say whether a mode leaves reactions undetermined."""
    if not frame.rows.size:
        return False
    matrix = problem.g[frame.rows] @ frame.columns
    for axis in (1, 0):
        sizes = np.linalg.norm(matrix, axis=axis, keepdims=True)
        matrix = matrix / np.where(sizes > 0.0, sizes, 1.0)
    values = np.linalg.svd(matrix, compute_uv=False)
    return bool(values[-1] <= RANK * values[0])


def least_of(problem: Problem, frame: Frame) -> Array | None:
    """Return the least p in a mode's cones by which its rows vanish; None if the cones hold none.

    Unknowns are scaled so that their squares add up to those of p.
    """
    diagonal = np.diag(problem.g)[frame.rows]
    weights = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    moved = weights[:, None] * (problem.g[frame.rows] @ frame.columns)
    change = -weights * problem.b[frame.rows]
    count = frame.rows.size
    bounded: dict[int, list[tuple[float, tuple[int, ...]]]] = {k: [] for k in frame.normals}
    for k, j, unknowns in frame.sticks:
        hold = problem.contacts[k].grips[j].hold
        if not math.isinf(hold):
            bounded[k].append((hold, unknowns))
    columns, parts = [moved[:, n] for n in range(count)], []
    shapes = [frame.columns[:, n] for n in range(count)]
    for k, first in frame.normals.items():
        weight = float(np.linalg.norm(shapes[first]))
        columns[first], shapes[first] = columns[first] / weight, shapes[first] / weight
        parts.append(part_of(first, [(hold / weight, unknowns) for hold, unknowns in bounded[k]]))
    y = least(np.column_stack(columns), change, parts)
    return None if y is None else np.column_stack(shapes) @ y


def fixed(values: Array) -> Array:
    """Return the array made read-only."""
    values.setflags(write=False)
    return values
