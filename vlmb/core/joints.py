"""Equations and forces over the velocities of another engine: balls or turns in a plane, lengths that slide, a base.

That engine's state (q, v) and the axes that its velocities turn about are read as a state of the core: d_i' = w_i x d_i. A row W
over the core's velocities becomes one over the engine's, W T: what stands on u_i is the torque d_i x w_i on link i, which every
ball between it and the base carries. Its drift takes W times the core's accelerations where the engine's are 0,
u_i' = w_i' x d_i + w_i x (w_i x d_i) with w_i' = w_p' + w_p x w_i. Directions in the frame of a ski turn in it alone.
"""

from __future__ import annotations

from typing import NamedTuple

from vlmb.core import opcodes as op
from vlmb.core import packed
from vlmb.core import tree as of
from vlmb.core.angles import FINE
from vlmb.core.jit import inner, kernel
from vlmb.core.packed import buffers_of, part, quantities_of, table, tape_of, tree_of
from vlmb.core.quantities import KIND, LINK, PLANE_ELEVATION, add_row, measure
from vlmb.core.rows import OF_FORCES, write_residual, write_row
from vlmb.core.scalars import NAN, atan2, cos, finite, nearest_turn, sin
from vlmb.core.tape import play_jets, play_values, read_leaves
from vlmb.core.tree import Array, Integers, Tree
from vlmb.core.triples import Vector, cross, dot, plus

PLANE, BASE_SIZE = range(2)  # entries of `shape`: whether all moves in a plane, velocities of a base without a heading
Q, V, LOWER_Q, LOWER_V, UPPER_Q, UPPER_V = range(6)  # columns of `link`: hinge and lengths in q and v, -1 where there is none
AXIS = 3  # columns of `axes` from here on are what a velocity turns about
SPIN, SPIN_DRIFT = 0, 3  # columns of `spin`


class Joints(NamedTuple):
    """Where what stands in (q, v)."""

    shape: Integers  # (2,)
    link: Integers  # (n, 6)


class Room(NamedTuple):
    """What taking a row over writes."""

    moment: Array  # (n, 3) on every link
    carried: Array  # (engine's nv,)


@kernel(copied=True)
def room_of(i: Integers, reals: Array) -> Room:
    """Return the room of packed equations."""
    return Room(table(reals, i, packed.MOMENT, 3), part(reals, i, packed.CARRIED))


@kernel(copied=True)
def joints_of(i: Integers) -> Joints:
    """Return the joints of packed equations."""
    return Joints(part(i, i, packed.JOINT_SHAPE), table(i, i, packed.JOINT, 6))


@inner
def triple(values: Array, row: int, at: int) -> Vector:
    """Return three numbers of a table."""
    return values[row, at], values[row, at + 1], values[row, at + 2]


@kernel
def heading_of(tree: Tree, q: Array) -> Vector:
    """Return the heading of the base in the frame of the directions."""
    if tree.shape[of.UPRIGHT] != 0:
        return 1.0, 0.0, 0.0
    return (q[2], q[3], 0.0) if tree.shape[of.BASE_KIND] >= of.SLIDING else (1.0, 0.0, 0.0)


@inner
def read_base(joints: Joints, tree: Tree, q: Array, v: Array, yaw: float, y: Array) -> None:
    """Write the base's entries of the core's state; its heading nearest to `yaw`."""
    rates = tree.shape[of.POSITIONS]
    if tree.shape[of.BASE_KIND] >= of.SLIDING:
        y[0], y[1], y[2] = q[0], q[1], nearest_turn(atan2(q[3], q[2]), yaw)
        y[rates], y[rates + 1], y[rates + 2] = v[0], v[1], v[2]
        if tree.shape[of.BASE_KIND] == of.LIFTED:
            y[3], y[rates + 3] = q[4], v[3]
    elif tree.shape[of.BASE_KIND] == of.FREE:
        for k in range(joints.shape[BASE_SIZE]):
            axis = 2 * k if joints.shape[PLANE] != 0 else k
            y[axis], y[rates + axis] = q[k], v[k]


@kernel
def axis_of(tree: Tree, axes: Array, k: int) -> Vector:
    """Return what a velocity turns about, in the frame of the directions: in that of a ski, to the right."""
    return (0.0, -1.0, 0.0) if tree.shape[of.UPRIGHT] != 0 else triple(axes, k, AXIS)


@inner
def turn_link(joints: Joints, tree: Tree, i: int, v: Array, axes: Array, spin: Array) -> None:
    """Write w_i and w_i' of a link where v' = 0, from those of its parent, in the frame of the directions."""
    parent, at = tree.link[i, of.PARENT], joints.link[i, V]
    if parent >= 0:
        before, growth = triple(spin, parent, SPIN), triple(spin, parent, SPIN_DRIFT)
    else:
        turns = tree.shape[of.BASE_KIND] >= of.SLIDING and tree.shape[of.UPRIGHT] == 0
        before, growth = (0.0, 0.0, v[2] if turns else 0.0), (0.0, 0.0, 0.0)
    omega = before
    for k in range(at, at + (1 if joints.shape[PLANE] != 0 else 3)):
        omega = plus(omega, v[k], axis_of(tree, axes, k))
    growth = plus(growth, 1.0, cross(before, omega))
    spin[i, 0], spin[i, 1], spin[i, 2] = omega
    spin[i, 3], spin[i, 4], spin[i, 5] = growth


@inner
def total_turn(joints: Joints, tree: Tree, i: int, q: Array) -> float:
    """Return psi of a link in a plane: the sum of the turns up to it."""
    psi = 0.0
    while i >= 0:
        psi += q[joints.link[i, Q]]
        i = tree.link[i, of.PARENT]
    return psi


@inner
def direction_of(joints: Joints, tree: Tree, i: int, q: Array, axes: Array, h: Vector) -> Vector:
    """Return d_i: the first axis of its ball, or (cos psi h, sin psi) with psi the sum of the turns up to the link."""
    if joints.shape[PLANE] == 0:
        return triple(axes, joints.link[i, V], AXIS)
    psi = total_turn(joints, tree, i, q)
    return cos(psi) * h[0], cos(psi) * h[1], sin(psi)


@kernel
def read_state(
    joints: Joints, tree: Tree, q: Array, v: Array, axes: Array, yaw: float, y: Array, bend: Array, spin: Array
) -> None:
    """Write the core's state y = (p, v) at (q, v), and v' of the core where that of the engine is 0 (`bend`)."""
    read_base(joints, tree, q, v, yaw, y)
    h, rates = heading_of(tree, q), tree.shape[of.POSITIONS]
    for i in range(tree.shape[of.LINKS]):
        turn_link(joints, tree, i, v, axes, spin)
        d, omega = direction_of(joints, tree, i, q, axes, h), triple(spin, i, SPIN)
        u = cross(omega, d)
        change = plus(cross(triple(spin, i, SPIN_DRIFT), d), 1.0, cross(omega, u))
        at_p, at_v = tree.link[i, of.AT_P], tree.link[i, of.AT_V]
        for k in range(3):
            y[at_p + k], y[rates + at_v + k], bend[at_v + k] = d[k], u[k], change[k]
        at_p, at_v = at_p + 3, rates + at_v + 3
        if tree.link[i, of.LOWER_FREE] != 0:
            y[at_p], y[at_v] = q[joints.link[i, LOWER_Q]], v[joints.link[i, LOWER_V]]
            at_p, at_v = at_p + 1, at_v + 1
        if tree.link[i, of.UPPER_FREE] != 0:
            y[at_p], y[at_v] = q[joints.link[i, UPPER_Q]], v[joints.link[i, UPPER_V]]


@inner
def carry(joints: Joints, tree: Tree, axes: Array, y: Array, row: Array, moment: Array, out: Array) -> None:
    """Write into `out` (engine's nv,) what a row (core's nv,) is over the engine's velocities."""
    for k in range(out.shape[0]):
        out[k] = 0.0
    sliding, n = tree.shape[of.BASE_KIND] >= of.SLIDING, tree.shape[of.LINKS]
    for i in range(n):
        p, at = tree.link[i, of.AT_P], tree.link[i, of.AT_V]
        moment[i, 0], moment[i, 1], moment[i, 2] = cross((y[p], y[p + 1], y[p + 2]), (row[at], row[at + 1], row[at + 2]))
        at += 3
        if tree.link[i, of.LOWER_FREE] != 0:
            out[joints.link[i, LOWER_V]] = row[at]
            at += 1
        if tree.link[i, of.UPPER_FREE] != 0:
            out[joints.link[i, UPPER_V]] = row[at]
    if sliding:
        out[0], out[1], out[2] = row[0], row[1], row[2]
        if tree.shape[of.BASE_KIND] == of.LIFTED:
            out[3] = row[3]
    elif tree.shape[of.BASE_KIND] == of.FREE:
        for k in range(joints.shape[BASE_SIZE]):
            out[k] = row[2 * k if joints.shape[PLANE] != 0 else k]
    for i in range(n - 1, -1, -1):
        at, parent = joints.link[i, V], tree.link[i, of.PARENT]
        for k in range(at, at + (1 if joints.shape[PLANE] != 0 else 3)):
            out[k] = dot(triple(moment, i, 0), axis_of(tree, axes, k))
        if parent >= 0:
            for c in range(3):
                moment[parent, c] += moment[i, c]
        elif sliding:
            out[2] += moment[i, 2]


@inner
def read_joints(i: Integers, reals: Array, q: Array, v: Array, axes: Array, branch: Array) -> None:
    """Read the state and measure all that the tape uses; a quantity without a value is nan.

    axes (nv, 6): Pinocchio's Jacobian in the world, transposed; branch (N,): coordinates that angles are near to.
    """
    tree, quantities, measured = tree_of(i, reals), quantities_of(i, reals), table(reals, i, packed.MEASURED, 3)
    y, reference, levels = part(reals, i, packed.STATE), table(reals, i, packed.REFERENCE, 2), table(i, i, packed.LEVELS, 2)
    yaw = branch[2] if tree.shape[of.BASE_KIND] >= of.SLIDING else 0.0
    read_state(joints_of(i), tree, q, v, axes, yaw, y, part(reals, i, packed.BEND), table(reals, i, packed.SPIN, 6))
    for k in range(levels.shape[0]):
        if quantities.kind[k, KIND] == PLANE_ELEVATION:  # turns in a plane just grow
            reference[k, 1] = total_turn(joints_of(i), tree, quantities.kind[k, LINK], q)
        elif levels[k, 0] >= 0:
            reference[k, 0], reference[k, 1] = branch[levels[k, 0]], branch[levels[k, 1]]
    given = table(reals, i, packed.GIVEN, 6)
    for k in part(i, i, packed.USED):
        code = measure(quantities, k, tree, y, given, reference, measured)
        if code != FINE:
            measured[k, 0], measured[k, 1], measured[k, 2] = NAN, NAN, NAN


@kernel
def put_row(
    joints: Joints, tree: Tree, axes: Array, y: Array, row: Array, room: Room, sound: bool, known: Integers, place: int,
    out: Array,
) -> bool:  # fmt: skip
    """Write a row over the engine's velocities into out[known, place]; nan where it has none. Return whether it is sound."""
    carry(joints, tree, axes, y, row, room.moment, room.carried)
    for j in range(known.shape[0]):
        value = room.carried[j] if sound else NAN
        out[known[j], place, j] = value
        sound = sound and finite(value)
    return sound


@kernel
def clear(row: Array) -> None:
    """Fill with zeros."""
    for j in range(row.shape[0]):
        row[j] = 0.0


@kernel
def rows_of_joints(
    i: Integers, reals: Array, t: float, q: Array, v: Array, axes: Array, branch: Array, known: Integers, first: int,
    out: Array, matrix: Array,
) -> bool:  # fmt: skip
    """Write z, z', drift into `out` (3, rows) and the rows over v into matrix[:, first:] (layers, any, nv).

    What else the tape has goes into out[0] behind them. Forces in their scales go to matrix[:, : forces]. known (nv,): the layer
    that each velocity's column stands in. False: a row, what else there is or a force has no finite value; that is nan.
    """
    tape, buffers, quantities = tape_of(i, reals), buffers_of(i, reals), quantities_of(i, reals)
    line, bend, form = part(reals, i, packed.ROW), part(reals, i, packed.BEND), part(i, i, packed.FORM)
    tree, joints, room, y = tree_of(i, reals), joints_of(i), room_of(i, reals), part(reals, i, packed.STATE)
    given, reference = table(reals, i, packed.GIVEN, 6), table(reals, i, packed.REFERENCE, 2)
    read_joints(i, reals, q, v, axes, branch)
    measured = table(reals, i, packed.MEASURED, 3)
    read_leaves(tape, t, part(reals, i, packed.PARAMETERS), measured, buffers.slots)
    play_jets(tape, buffers, tape.parts[op.PARAMETERS_END], tape.parts[op.ROOTS_END])
    fine, residual = True, table(reals, i, packed.RESIDUAL, 3)
    for r in range(tape.root.shape[0]):
        if r >= form.shape[0]:
            out[0, r] = buffers.slots[tape.root[r], 0]
            fine = finite(out[0, r]) and fine
            continue
        write_residual(tape, buffers, r, form[r], r, residual)
        code = FINE
        if form[r] == OF_FORCES:
            clear(line)
        else:
            code = write_row(tape, buffers, quantities, tree, r, y, given, reference, line)
        sound = code == FINE and finite(residual[r, 0] + residual[r, 1] + residual[r, 2])
        fine = put_row(joints, tree, axes, y, line, room, sound, known, first + r, matrix) and fine
        drift = residual[r, 2]
        for j in range(line.shape[0]):
            drift += line[j] * bend[j]
        out[0, r], out[1, r], out[2, r] = residual[r, 0], residual[r, 1], drift
    along, scale = part(i, i, packed.ALONG), part(reals, i, packed.SCALE)
    for s in range(along.shape[0]):
        clear(line)
        code = add_row(quantities, along[s], tree, y, given, reference, scale[s], line)
        fine = put_row(joints, tree, axes, y, line, room, code == FINE, known, s, matrix) and fine
    return fine


@kernel
def forces_of_joints(
    i: Integers, reals: Array, t: float, q: Array, v: Array, axes: Array, branch: Array, known: Integers, values: Array,
    columns: Array,
) -> bool:  # fmt: skip
    """Write the values of laws into the first of `values` (forces,), and what a unit of every force is over v into columns[0].

    A force of 0 needs no direction: its column is 0. False: a law or a column has no finite value; what has none is nan.
    """
    tape, buffers, quantities = tape_of(i, reals), buffers_of(i, reals), quantities_of(i, reals)
    tree, joints, room, y = tree_of(i, reals), joints_of(i), room_of(i, reals), part(reals, i, packed.STATE)
    given, reference = table(reals, i, packed.GIVEN, 6), table(reals, i, packed.REFERENCE, 2)
    read_joints(i, reals, q, v, axes, branch)
    measured = table(reals, i, packed.MEASURED, 3)
    read_leaves(tape, t, part(reals, i, packed.PARAMETERS), measured, buffers.slots)
    play_values(tape, buffers, tape.parts[op.PARAMETERS_END], tape.parts[op.ROOTS_END])
    fine, along, line = True, part(i, i, packed.ALONG), part(reals, i, packed.ROW)
    for s in range(along.shape[0]):
        if s < tape.root.shape[0]:
            values[s] = buffers.slots[tape.root[s], 0]
        clear(line)
        code = FINE if values[s] == 0.0 else add_row(quantities, along[s], tree, y, given, reference, 1.0, line)
        fine = put_row(joints, tree, axes, y, line, room, code == FINE, known, s, columns) and finite(values[s]) and fine
    return fine
