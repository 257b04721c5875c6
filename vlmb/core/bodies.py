"""Rigid bodies in a tree of any joints: poses, twists, their drift where v' = 0, and what every velocity moves, in the world.

Twists are (velocity of what passes through the origin, angular velocity). Every joint's axes are constant in its own frame, so
a twist's drift grows along the tree by a_i = a_p + V_i x (J_i v_i).
"""

from __future__ import annotations

from typing import NamedTuple

from vlmb.core.jit import inner, kernel
from vlmb.core.scalars import cos, sin, sqrt
from vlmb.core.tree import Array, Integers
from vlmb.core.triples import Vector, cross, plus

PARENT, TYPE, AT_Q, AT_V, COUNT, AT_J = range(6)  # columns of `joint`; row 0 is the world
REVOLUTE, PRISMATIC, BALL, FREE, PLANAR, TRANSLATION = range(6)
PLACE, AXIS, MASS, CENTRE = 9, 12, 15, 16  # columns of `real`: rotation, place, axis, mass, its centre
TURN, AT, LINEAR, ANGULAR, LINEAR_DRIFT, ANGULAR_DRIFT = 0, 9, 12, 15, 18, 21  # columns of `state`


class Bodies(NamedTuple):
    """A tree of bodies, parents first. What moves relative to its parent alone may stand beside it, as a tree of its own."""

    joint: Integers  # (n + 1, 6)
    real: Array  # (n + 1, 19)
    state: Array  # (n + 1, 24) written by `move`
    jacobian: Array  # (any, 6) twist by each velocity, written by `move`


@inner
def vector(values: Array, row: int, at: int) -> Vector:
    """Return three numbers of a table."""
    return values[row, at], values[row, at + 1], values[row, at + 2]


@inner
def put(values: Array, row: int, at: int, what: Vector) -> None:
    """Write three numbers into a table."""
    values[row, at], values[row, at + 1], values[row, at + 2] = what


@inner
def column(values: Array, row: int, axis: int) -> Vector:
    """Return a column of the rotation that a row begins with: an axis of its frame."""
    return values[row, axis], values[row, 3 + axis], values[row, 6 + axis]


@inner
def turned(values: Array, row: int, x: Vector) -> Vector:
    """Return the rotation that a row begins with times a vector."""
    return (
        values[row, 0] * x[0] + values[row, 1] * x[1] + values[row, 2] * x[2],
        values[row, 3] * x[0] + values[row, 4] * x[1] + values[row, 5] * x[2],
        values[row, 6] * x[0] + values[row, 7] * x[1] + values[row, 8] * x[2],
    )


@inner
def put_axes(state: Array, j: int, x: Vector, y: Vector, z: Vector) -> None:
    """Write a rotation by its columns."""
    for k in range(3):
        state[j, 3 * k], state[j, 3 * k + 1], state[j, 3 * k + 2] = x[k], y[k], z[k]


@inner
def turn_by(state: Array, j: int, x: Vector, y: Vector, z: Vector) -> None:
    """Multiply the rotation of a body by one given by its columns, from the right."""
    first, second, third = turned(state, j, x), turned(state, j, y), turned(state, j, z)
    put_axes(state, j, first, second, third)


@inner
def turn_by_quaternion(state: Array, j: int, x: float, y: float, z: float, w: float) -> None:
    """Multiply the rotation of a body by that of a quaternion of any length."""
    size = 1.0 / sqrt(x * x + y * y + z * z + w * w)
    x, y, z, w = x * size, y * size, z * size, w * size
    turn_by(
        state, j,
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)),
        (2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)),
        (2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)),
    )  # fmt: skip


@inner
def turn_about(state: Array, j: int, a: Vector, angle: float) -> None:
    """Multiply the rotation of a body by one about a unit axis."""
    c, s = cos(angle), sin(angle)
    d = 1.0 - c
    turn_by(
        state, j,
        (c + d * a[0] * a[0], d * a[0] * a[1] + s * a[2], d * a[0] * a[2] - s * a[1]),
        (d * a[0] * a[1] - s * a[2], c + d * a[1] * a[1], d * a[1] * a[2] + s * a[0]),
        (d * a[0] * a[2] + s * a[1], d * a[1] * a[2] - s * a[0], c + d * a[2] * a[2]),
    )  # fmt: skip


@inner
def slide(state: Array, j: int, by: Vector) -> None:
    """Move a body along its own axes."""
    put(state, j, AT, plus(vector(state, j, AT), 1.0, turned(state, j, by)))


@inner
def put_turning(bodies: Bodies, j: int, k: int, axis: Vector) -> None:
    """Write the twist of turning about an axis through the body's origin as that of its velocity k."""
    at = bodies.joint[j, AT_J] + k
    put(bodies.jacobian, at, 0, cross(vector(bodies.state, j, AT), axis))
    put(bodies.jacobian, at, 3, axis)


@inner
def put_sliding(bodies: Bodies, j: int, k: int, axis: Vector) -> None:
    """Write the twist of sliding along an axis as that of a body's velocity k."""
    at = bodies.joint[j, AT_J] + k
    put(bodies.jacobian, at, 0, axis)
    put(bodies.jacobian, at, 3, (0.0, 0.0, 0.0))


@inner
def pose(bodies: Bodies, j: int, q: Array) -> None:
    """Write the pose of a body after its parent's, and what its velocities move."""
    state, real, at, kind = bodies.state, bodies.real, bodies.joint[j, AT_Q], bodies.joint[j, TYPE]
    parent = bodies.joint[j, PARENT]
    place = plus(vector(state, parent, AT), 1.0, turned(state, parent, vector(real, j, PLACE)))
    put_axes(
        state, j, turned(state, parent, column(real, j, 0)), turned(state, parent, column(real, j, 1)),
        turned(state, parent, column(real, j, 2)),
    )  # fmt: skip
    put(state, j, AT, place)
    axis = vector(real, j, AXIS)
    if kind == REVOLUTE:
        turn_about(state, j, axis, q[at])
        put_turning(bodies, j, 0, turned(state, j, axis))
    elif kind == PRISMATIC:
        slide(state, j, (axis[0] * q[at], axis[1] * q[at], axis[2] * q[at]))
        put_sliding(bodies, j, 0, turned(state, j, axis))
    elif kind == BALL:
        turn_by_quaternion(state, j, q[at], q[at + 1], q[at + 2], q[at + 3])
        for k in range(3):
            put_turning(bodies, j, k, column(state, j, k))
    elif kind == FREE:
        slide(state, j, (q[at], q[at + 1], q[at + 2]))
        turn_by_quaternion(state, j, q[at + 3], q[at + 4], q[at + 5], q[at + 6])
        for k in range(3):
            put_sliding(bodies, j, k, column(state, j, k))
            put_turning(bodies, j, 3 + k, column(state, j, k))
    elif kind == PLANAR:
        slide(state, j, (q[at], q[at + 1], 0.0))
        size = 1.0 / sqrt(q[at + 2] * q[at + 2] + q[at + 3] * q[at + 3])
        c, s = q[at + 2] * size, q[at + 3] * size
        turn_by(state, j, (c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0))
        put_sliding(bodies, j, 0, column(state, j, 0))
        put_sliding(bodies, j, 1, column(state, j, 1))
        put_turning(bodies, j, 2, column(state, j, 2))
    else:
        slide(state, j, (q[at], q[at + 1], q[at + 2]))
        for k in range(3):
            put_sliding(bodies, j, k, column(state, j, k))


@kernel
def move(bodies: Bodies, q: Array, v: Array) -> None:
    """Write the state of all bodies and what every velocity moves; quaternions of q may have any length."""
    state, jacobian = bodies.state, bodies.jacobian
    for j in range(1, bodies.joint.shape[0]):
        pose(bodies, j, q)
        parent, at_v, at_j = bodies.joint[j, PARENT], bodies.joint[j, AT_V], bodies.joint[j, AT_J]
        slid, turning = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for k in range(bodies.joint[j, COUNT]):
            slid = plus(slid, v[at_v + k], vector(jacobian, at_j + k, 0))
            turning = plus(turning, v[at_v + k], vector(jacobian, at_j + k, 3))
        linear = plus(vector(state, parent, LINEAR), 1.0, slid)
        angular = plus(vector(state, parent, ANGULAR), 1.0, turning)
        put(state, j, LINEAR, linear)
        put(state, j, ANGULAR, angular)
        growth = plus(cross(angular, slid), 1.0, cross(linear, turning))
        put(state, j, LINEAR_DRIFT, plus(vector(state, parent, LINEAR_DRIFT), 1.0, growth))
        put(state, j, ANGULAR_DRIFT, plus(vector(state, parent, ANGULAR_DRIFT), 1.0, cross(angular, turning)))


@inner
def quaternion_rate(q: Array, at: int, wx: float, wy: float, wz: float, out: Array) -> None:
    """Write the rate of a quaternion of any length by the angular velocity in its own frame."""
    x, y, z, w = q[at], q[at + 1], q[at + 2], q[at + 3]
    out[at] = 0.5 * (w * wx + y * wz - z * wy)
    out[at + 1] = 0.5 * (w * wy + z * wx - x * wz)
    out[at + 2] = 0.5 * (w * wz + x * wy - y * wx)
    out[at + 3] = -0.5 * (x * wx + y * wy + z * wz)


@inner
def position_rates(bodies: Bodies, joints: int, q: Array, v: Array, out: Array) -> None:
    """Write q' of the first joints; a quaternion keeps whatever length it has. Needs `move`."""
    for j in range(1, joints):
        kind, at, k = bodies.joint[j, TYPE], bodies.joint[j, AT_Q], bodies.joint[j, AT_V]
        if kind == BALL:
            quaternion_rate(q, at, v[k], v[k + 1], v[k + 2], out)
        elif kind == FREE:
            x, y, z, w = q[at + 3], q[at + 4], q[at + 5], q[at + 6]
            size = 2.0 / (x * x + y * y + z * z + w * w)
            part, u = (x, y, z), (v[k], v[k + 1], v[k + 2])
            side = cross(part, u)  # R u = u + 2 w (p x u) + 2 p x (p x u), over the square of the length
            moved = plus(plus(u, size * w, side), size, cross(part, side))
            out[at], out[at + 1], out[at + 2] = moved
            quaternion_rate(q, at + 3, v[k + 3], v[k + 4], v[k + 5], out)
        elif kind == PLANAR:
            c, s = q[at + 2], q[at + 3]
            size = 1.0 / sqrt(c * c + s * s)
            out[at], out[at + 1] = size * (c * v[k] - s * v[k + 1]), size * (s * v[k] + c * v[k + 1])
            out[at + 2], out[at + 3] = -s * v[k + 2], c * v[k + 2]
        else:
            for i in range(bodies.joint[j, COUNT]):
                out[at + i] = v[k + i]


@inner
def velocity_at(state: Array, j: int, p: Vector) -> Vector:
    """Return the velocity of a body's point at p."""
    return plus(vector(state, j, LINEAR), 1.0, cross(vector(state, j, ANGULAR), p))


@inner
def drift_at(state: Array, j: int, p: Vector) -> Vector:
    """Return the acceleration of a body's point at p where v' = 0."""
    spatial = plus(vector(state, j, LINEAR_DRIFT), 1.0, cross(vector(state, j, ANGULAR_DRIFT), p))
    return plus(spatial, 1.0, cross(vector(state, j, ANGULAR), velocity_at(state, j, p)))


@inner
def push(bodies: Bodies, j: int, force: Vector, moment: Vector, out: Array) -> None:
    """Add what a force through the origin and a moment on a body are over the velocities."""
    joint, jacobian = bodies.joint, bodies.jacobian
    while j > 0:
        at_j, at_v = joint[j, AT_J], joint[j, AT_V]
        for k in range(joint[j, COUNT]):
            a = at_j + k
            out[at_v + k] += (
                jacobian[a, 0] * force[0] + jacobian[a, 1] * force[1] + jacobian[a, 2] * force[2]
                + jacobian[a, 3] * moment[0] + jacobian[a, 4] * moment[1] + jacobian[a, 5] * moment[2]
            )  # fmt: skip
        j = joint[j, PARENT]


@inner
def push_at(bodies: Bodies, j: int, p: Vector, force: Vector, out: Array) -> None:
    """Add what a force on a body's point at p is over the velocities."""
    push(bodies, j, force, cross(p, force), out)
