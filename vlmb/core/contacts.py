"""Closed contacts: what the rows that hold a point push on when it slides with friction, and what is looked for while it does.

A closed contact is a row along the gradient g of its surface, of which the multiplier is the normal force over |g|, and rows
across where it does not slip. One that slides pushes on

    J_n^T - mu |g| (d_x J_x + d_y J_y + d_z J_z)^T

per unit of its multiplier: d is the unit vector that it slides along, J_x ... are the rows of the point's place. In a plane d
keeps its side; in space it is v/|v|, and the last one where |v| is nearly 0 or turns back: friction that turned round there
would stop every step.

One that holds the point of a free base has no rows: the base is planted (base.py), and its force is the ground's on the base.
"""

from __future__ import annotations

from vlmb.core.jit import inner, kernel
from vlmb.core.opcodes import Buffers, Tape
from vlmb.core.places import heading, leftwards
from vlmb.core.quantities import Quantities, add_row, measure
from vlmb.core.row_arrays import FIRST, RowMemory, Rows, Sizes, Space
from vlmb.core.scalars import sqrt
from vlmb.core.tape import gradient
from vlmb.core.tree import Array, Integers, Tree
from vlmb.core.triples import Vector, across, dot, plus, scaled

# Columns of `contacts` of rows: the ideal row along the gradient, how many rows it has with those across (none on a planted base,
# and where others carry), the quantities that are the point's place (-1: none), work states of what friction takes and of what a
# moving surface gives (or -1), whether it slides.
AT, COUNT, PLACE, HEAT, CARRIED, SLIDES = 0, 1, 2, 5, 6, 7
# Columns of `grip`, and of `contacts` of a memory: coefficient while it slides and at rest, velocity of the surface [m/s], unit
# vector that it slides along, of a planted base its normal, whether it may slide any way (1) or to and fro (0), or is a ski (2),
# whose shares ahead and to the left stand for the vector; then, written by evaluations: |g|, the normal, how fast it slides
# [m/s], along what.
MU, MU_AT_REST, SURFACE, TOWARDS, ANY_WAY, SIZE, NORMAL, SPEED, ALONG = 0, 1, 2, 5, 8, 9, 10, 13, 14
OF_SKI = 2.0
SLOW = 1e-6  # [m/s] below which the last direction stays


@kernel(inline=True)
def three(row: Array, at: int) -> Vector:
    """Read three numbers of a row."""
    return row[at], row[at + 1], row[at + 2]


@inner
def gradient_at(rows: Rows, sizes: Sizes, tape: Tape, buffers: Buffers, c: int, r: int) -> Vector:
    """Return the gradient of ideal row r over the place of contact c, after the tape was played for jets."""
    root = rows.table[0, FIRST] + r - sizes.held
    gradient(tape, buffers, root, False)
    x, y, z = 0.0, 0.0, 0.0
    for j in range(tape.entering_ends[root, 0], tape.entering_ends[root, 1]):
        leaf = tape.entering[j]
        which = tape.leaf[leaf, 1]
        if which == rows.contacts[c, PLACE]:
            x += buffers.adjoint[leaf]
        elif which == rows.contacts[c, PLACE + 1]:
            y += buffers.adjoint[leaf]
        elif which == rows.contacts[c, PLACE + 2]:
            z += buffers.adjoint[leaf]
    return x, y, z


@inner
def velocity_of(
    place: Integers, quantities: Quantities, tree: Tree, y: Array, given: Array, reference: Array, measured: Array
) -> Vector:
    """Return the velocity [m/s] of a contact's point; `measured` is overwritten there."""
    found = (0.0, 0.0, 0.0)
    for axis in range(3):
        which = place[axis]
        if which >= 0:
            measure(quantities, which, tree, y, given, reference, measured)
            speed = measured[which, 1]
            found = (
                found[0] + (speed if axis == 0 else 0.0), found[1] + (speed if axis == 1 else 0.0),
                found[2] + (speed if axis == 2 else 0.0),
            )  # fmt: skip
    return found


@inner
def unit_across(v: Vector, normal: Vector) -> Vector:
    """Return the direction of what a vector has across a unit vector; 0 where it has nothing."""
    flat = across(v, normal)
    size = sqrt(dot(flat, flat))
    return scaled(1.0 / size, flat) if size > 0.0 else (0.0, 0.0, 0.0)


@inner
def way_of(known: Array, v: Vector, normal: Vector) -> Vector:
    """Return the unit vector that a contact slides along with a velocity v across its normal; see the top of this file."""
    last = unit_across(three(known, TOWARDS), normal)
    speed = sqrt(dot(v, v))
    if known[ANY_WAY] != 0.0 and speed > SLOW and dot(v, last) > 0.0:
        return scaled(1.0 / speed, v)
    return last


@inner
def write_pushes(
    rows: Rows, sizes: Sizes, space: Space, memory: RowMemory, tape: Tape, buffers: Buffers, quantities: Quantities, tree: Tree,
    y: Array, given: Array, reference: Array, measured: Array,
) -> None:  # fmt: skip
    """Write what the multipliers push on, after `write_lines`: their rows, and friction where contacts slide."""
    for r in range(sizes.ideal):
        for j in range(space.lines.shape[1]):
            space.pushes[r, j] = space.lines[r, j]
    for c in range(rows.contacts.shape[0]):
        if rows.contacts[c, SLIDES] != 0:
            known, at = memory.contacts[c], rows.contacts[c, AT]
            g = gradient_at(rows, sizes, tape, buffers, c, at)
            size = sqrt(dot(g, g))
            normal = scaled(1.0 / size, g)
            place = rows.contacts[c, PLACE : PLACE + 3]
            moving = velocity_of(place, quantities, tree, y, given, reference, measured)
            v = across(plus(moving, -1.0, three(known, SURFACE)), normal)
            d = way_of(known, v, normal)
            if known[ANY_WAY] == OF_SKI:
                h = heading(tree, y)
                d = plus(scaled(known[TOWARDS], h), known[TOWARDS + 1], leftwards(h))
            known[SIZE], known[SPEED] = size, dot(v, d)
            known[NORMAL], known[NORMAL + 1], known[NORMAL + 2] = normal[0], normal[1], normal[2]
            known[ALONG], known[ALONG + 1], known[ALONG + 2] = d[0], d[1], d[2]
            for axis in range(3):
                if place[axis] >= 0:
                    share = -known[MU] * size * known[ALONG + axis]
                    add_row(quantities, place[axis], tree, y, given, reference, share, space.pushes[at])


@inner
def add_friction_apart(
    rows: Rows, sizes: Sizes, space: Space, memory: RowMemory, k: int, quantities: Quantities, tree: Tree, still: Array,
    growing: Array, reference: Array, measured: Array,
) -> None:  # fmt: skip
    """Write what the multipliers push on driven length k, which alone grows in `growing`."""
    for r in range(sizes.held, sizes.ideal):
        space.pushes_apart[r, k] = space.apart[r, k]
    for c in range(rows.contacts.shape[0]):
        if rows.contacts[c, SLIDES] != 0:
            known, place = memory.contacts[c], rows.contacts[c, PLACE : PLACE + 3]
            v = velocity_of(place, quantities, tree, still, growing, reference, measured)
            space.pushes_apart[rows.contacts[c, AT], k] -= known[MU] * known[SIZE] * dot(v, three(known, ALONG))


@inner
def add_friction_powers(rows: Rows, sizes: Sizes, space: Space, memory: RowMemory, work: int, dy: Array) -> None:
    """Add what friction takes, and what it carries along with a moving surface, to the rates of work states."""
    for c in range(rows.contacts.shape[0]):
        if rows.contacts[c, SLIDES] != 0:
            known = memory.contacts[c]
            friction = -known[MU] * known[SIZE] * space.shares[sizes.controls + rows.contacts[c, AT]]
            if rows.contacts[c, HEAT] >= 0:
                dy[work + rows.contacts[c, HEAT]] += friction * known[SPEED]
            if rows.contacts[c, CARRIED] >= 0:
                dy[work + rows.contacts[c, CARRIED]] += friction * dot(three(known, ALONG), three(known, SURFACE))


@inner
def held_by(rows: Rows, sizes: Sizes, space: Space, tape: Tape, buffers: Buffers, c: int) -> tuple[float, float]:
    """Return normal force and friction [N] of a contact as its rows hold it, at the last solution."""
    force, normal = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(rows.contacts[c, COUNT]):
        r = rows.contacts[c, AT] + k
        g = gradient_at(rows, sizes, tape, buffers, c, r)
        force = plus(force, space.shares[sizes.controls + r], g)
        if k == 0:
            normal = scaled(1.0 / sqrt(dot(g, g)), g)
    push = dot(force, normal)
    flat = plus(force, -push, normal)
    return push, sqrt(dot(flat, flat))


@inner
def held_by_ground(rows: Rows, memory: RowMemory, c: int, force: Vector) -> tuple[float, float]:
    """Return normal force and friction [N] of the contact that holds a planted base, by the force of the ground on it."""
    normal, place = three(memory.contacts[c], TOWARDS), rows.contacts[c, PLACE : PLACE + 3]
    force = (
        force[0] if place[0] >= 0 else 0.0, force[1] if place[1] >= 0 else 0.0, force[2] if place[2] >= 0 else 0.0
    )  # fmt: skip
    push = dot(force, normal)
    flat = plus(force, -push, normal)
    return push, sqrt(dot(flat, flat))


@inner
def sliding_speed(
    rows: Rows, memory: RowMemory, c: int, quantities: Quantities, tree: Tree, y: Array, given: Array, reference: Array,
    measured: Array,
) -> float:  # fmt: skip
    """Return how fast [m/s] a contact slides along its last direction: below 0 it has stopped, or turned back."""
    known, place = memory.contacts[c], rows.contacts[c, PLACE : PLACE + 3]
    normal = three(known, NORMAL)
    v = across(plus(velocity_of(place, quantities, tree, y, given, reference, measured), -1.0, three(known, SURFACE)), normal)
    return dot(v, unit_across(three(known, TOWARDS), normal))


@inner
def keep_ways(rows: Rows, memory: RowMemory) -> None:
    """Take the directions of the last evaluation as those at an accepted step."""
    for c in range(rows.contacts.shape[0]):
        if rows.contacts[c, SLIDES] != 0 and memory.contacts[c, ANY_WAY] != OF_SKI:
            for axis in range(3):
                memory.contacts[c, TOWARDS + axis] = memory.contacts[c, ALONG + axis]
