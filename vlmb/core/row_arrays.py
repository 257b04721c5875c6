"""The arrays of the constraint layer: rows and controls of a scene, and what solving for them writes.

They are few, because each costs every evaluation nanoseconds to hand over; `view` names their parts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vlmb.core.jit import kernel
from vlmb.core.scratch import Lanes, make_lanes
from vlmb.core.tree import Array, Integers

# Row 0 of `table`: how many rows the knife edge holds (0, 1), ideal ones, those of the programme, secondary ones, controls; the
# root of the tape that the first row is, and that of u0 or -1; whether velocities are projected onto the knife edge; whether H or
# K are not diagonal; how many gains and weights the motion gives; the root that the first entry of the border is, or -1; how many
# roots stand behind those of the rows: u0, such gains and weights, the border by rows; how many contacts slide with friction.
HELD, IDEAL, SERVO, SECOND, CONTROLS, FIRST, FREE, PROJECTED, COUPLED, VARYING, BORDER, BEHIND, SLIDING = range(13)
# Then one for each row: its form as in rows.py, its work state (of an ideal row that works) or -1, whether it has no bound, as an
# azimuth's towards the pole; then one for each control; then one for each gain or weight that the motion gives.
FORM, WORK, UNBOUNDED = range(3)
ALONG = 0  # of a control: the quantity that it acts along; WORK as above
# ROOT and, of a gain, where in (H, K) it stands; of a weight OF_ROW is -1, COLUMN the control; of a force that row i of those
# beyond the ideal ones names, by which this root is multiplied, OF_ROW is -2 - i, COLUMN the ideal row that it holds.
ROOT, OF_ROW, COLUMN = range(3)
OF_WEIGHT = -1
# Of `state` of a space: sign of det G (0: none) now and at the last accepted step; whether rows of G repeat each other; what the
# ideal row that has least is still worth beside those before it, as a share of the largest that it has been, in the metric of
# M^-1; its rate [1/s], value and time [s] at the last accepted step, and the least one that is not looked at more closely. Of
# rows that repeat each other it is the least that they are worth together, what is repeated left out.
SIDE, SIDE_BEFORE, REPEATING, WORTH, WORTH_RATE, WORTH_BEFORE, WORTH_TIME, WORTH_BOUND = range(8)
PROJECTION, STILL = range(2)  # rows of `state` of a memory: velocities on the knife edge; velocities 0


class Rows(NamedTuple):
    """Rows and controls of a scene, constant for a run; empty where it has none."""

    table: Integers  # (1 + n + S + varying, 13)
    gains: Array  # (n + 1, 2 n or S + 1) H and K, 0 where they vary; then the scales of the controls, the knife edge's gain [1/s]
    contacts: Integers  # (closed contacts, 8) see contacts.py
    grip: Array  # (closed contacts, 9)


class RowMemory(NamedTuple):
    """What one thread writes."""

    lines: Array  # (any, nv)
    small: Array  # (any, any)
    state: Array  # (2, size of y) see PROJECTION
    given: Array  # (links, 6)
    contacts: Array  # (closed contacts, 17) see contacts.py
    lanes: Lanes  # for what controls and multipliers add


class Sizes(NamedTuple):
    """Numbers of rows and controls: the knife edge is one of the ideal rows, e of them; beyond them are r."""

    held: int
    ideal: int
    servo: int
    beyond: int
    controls: int
    sliding: int


class Space(NamedTuple):
    """Parts of the memory; rows and columns beyond those named are room."""

    lines: Array  # (e + r, nv) J, W
    pushes: Array  # (e, nv) what the multipliers push on: the rows themselves, but with friction where contacts slide
    columns: Array  # (S, nv) forces of the controls over their scales
    answers: Array  # (S + e, nv) M^-1 times columns and J^T
    turned: Array  # (nv, S + e + 1) the same as columns, a last
    residual: Array  # (n, 3) z, z', drift
    moved: Array  # (e + r, S + e + 1) lines times these
    square: Array  # (e, e) J M^-1 J^T
    solved: Array  # (e, S + 1) its inverse times that of the controls, and times what is lacking
    matrix: Array  # (r, S) G of (5.6) in the scales of the controls
    apart: Array  # (e, driven lengths) rows over the rates of driven lengths
    pushes_apart: Array  # (e, driven lengths) what the multipliers push on there
    ground: Array  # (3, S + e + 1) forces [N] on a planted base that controls and multipliers bring, and that without them
    wanted: Array  # (e + r,) what accelerations of the rows lack; beyond the eliminated ones beta of (5.6)
    shares: Array  # (S + e,) controls over their scales, multipliers
    errors: Array  # (e + r,) of rows that could not be met
    state: Array  # (8,)
    largest: Array  # (e,) diagonal of J M^-1 J^T, its largest at accepted steps; 0 for a row without bound
    first: Array  # three tables of e + r + S rows for solvers
    second: Array
    third: Array


def no_rows() -> Rows:
    """Make what a scene without rows has."""
    return Rows(np.zeros((0, 13), np.int64), np.zeros((0, 1)), np.zeros((0, 8), np.int64), np.zeros((0, 9)))


@kernel(inline=True)
def sizes_of(rows: Rows) -> Sizes:
    """Read the numbers of rows and controls."""
    head = rows.table[0]
    beyond = head[SERVO] + head[SECOND]
    return Sizes(head[HELD], head[HELD] + head[IDEAL], head[SERVO], beyond, head[CONTROLS], head[SLIDING])


def make_row_memory(rows: Rows, velocities: int, size: int, links: int, driven: int) -> RowMemory:
    """Make the memory for rows of a mechanism with `size` numbers in its state."""
    contacts = np.zeros((len(rows.contacts), 17))
    contacts[:, : rows.grip.shape[1]] = rows.grip
    if not len(rows.table):
        state, given = (np.zeros((2, size)), np.zeros((links, 6))) if driven else (np.zeros((0, 1)), np.zeros((0, 6)))
        return RowMemory(np.zeros((0, 1)), np.zeros((0, 1)), state, given, contacts, make_lanes(-1, 0))
    held, ideal, servo, second, controls = rows.table[0, : CONTROLS + 1].tolist()
    eliminated, beyond = held + ideal, servo + second
    whole, more = eliminated + beyond, eliminated if rows.table[0, SLIDING] else 0
    width = max(whole, controls + eliminated + 1, driven, 8)
    height = velocities + whole - held + whole + 3 * eliminated + beyond + 8 + 3 * (whole + controls)
    return RowMemory(
        np.zeros((whole + 2 * controls + eliminated + more, velocities)), np.zeros((height + more, width)),
        np.zeros((2, size)), np.zeros((links, 6)), contacts, make_lanes(links, velocities),
    )  # fmt: skip


def parts(sizes: Sizes, memory: RowMemory) -> Space:
    """Name the parts of the memory for Python."""
    lay_out = getattr(view, "py_func", view)  # compiled code returns no parts of arrays
    named: Space = lay_out(sizes, memory)
    return named


@kernel(copied=True)
def view(sizes: Sizes, memory: RowMemory) -> Space:
    """Name the parts of the memory."""
    e, r, s, lines, small = sizes.ideal, sizes.beyond, sizes.controls, memory.lines, memory.small
    a = e + r
    b = a + s
    c = b + s + e
    residual = lines.shape[1]
    moved = residual + a - sizes.held
    square = moved + a
    solved = square + e
    matrix = solved + e
    apart = matrix + r
    vectors = apart + e
    first = vectors + 5
    second = first + b
    third = second + b
    more = third + b
    own, own_apart, ground = (c, more, more + e) if sizes.sliding > 0 else (0, apart, more)
    return Space(
        lines[:a], lines[own : own + e], lines[a:b], lines[b:c], small[:residual], small[residual:moved],
        small[moved:square], small[square:solved],
        small[solved:matrix], small[matrix:apart], small[apart:vectors], small[own_apart : own_apart + e],
        small[ground : ground + 3], small[vectors], small[vectors + 1], small[vectors + 2], small[vectors + 3],
        small[vectors + 4], small[first:second], small[second:third], small[third:more],
    )  # fmt: skip
