"""Places and velocities of hinges and tips, and the energy of a mechanism."""

from __future__ import annotations

import numpy as np

from vlmb.core.jit import cos, kernel, sin
from vlmb.core.segments import heading_of, length_below, lower_rate, place_on_parent, upper_motion, yaw_of
from vlmb.core.tree import (
    ANCHOR,
    BASE_INERTIA,
    BASE_KIND,
    BASE_MASS,
    CENTRE,
    COM_OFFSET,
    FREE,
    GRAVITY,
    INERTIA,
    K1,
    K2,
    LENGTH,
    LIFTED,
    LINKS,
    LOWER_FREE,
    MASS,
    PARENT,
    PIVOT,
    PLACE,
    PLANTED,
    POSITIONS,
    REST1,
    REST2,
    ROD,
    SKI,
    TIP_MASS,
    UPPER_FREE,
    UPRIGHT,
    Array,
    Tree,
)
from vlmb.core.vectors import Vector, add, add_scaled, dot, put_row, row_vector, scale, vector

HINGE, HINGE_RATE, TIP_PLACE, TIP_RATE = 0, 3, 6, 9  # columns of places, three each


@kernel(inline=True)
def moving_direction(tree: Tree, y: Array, i: int) -> tuple[Vector, Vector]:
    """Find the unit direction of a link and its rate in the surface frame."""
    heading = heading_of(tree, y, i)
    d, u = heading.d, add_scaled(heading.rate, -dot(heading.d, heading.rate), heading.d)
    if tree.shape[UPRIGHT] != 0:
        cosine, sine, yaw = cos(y[2]), sin(y[2]), yaw_of(tree, y)
        u = Vector(u.x - yaw * d.y, u.y + yaw * d.x, u.z)
        return to_surface(cosine, sine, d), to_surface(cosine, sine, u)
    return d, u


@kernel(inline=True)
def to_surface(cosine: float, sine: float, a: Vector) -> Vector:
    """Turn a vector by phi0."""
    return Vector(cosine * a.x - sine * a.y, sine * a.x + cosine * a.y, a.z)


@kernel(inline=True)
def carried_by_base(tree: Tree, y: Array, ahead: float, aside: float, high: float) -> tuple[Vector, Vector]:
    """Find place and velocity of a point of the base; only a ski has such points beside its own, in its frame."""
    kind, first, zero = tree.shape[BASE_KIND], tree.shape[POSITIONS], 0.0 * ahead
    if kind == PIVOT:
        return Vector(ahead, aside, high), Vector(zero, zero, zero)
    if kind in (FREE, PLANTED):
        return vector(y, 0), vector(y, first)
    forward, left = Vector(cos(y[2]), sin(y[2]), zero), Vector(-sin(y[2]), cos(y[2]), zero)
    yaw, sideways = yaw_of(tree, y), zero if kind == SKI else y[first + 1]
    lift, rise = (y[3], y[first + 3]) if kind == LIFTED else (zero, zero)
    place = add_scaled(add_scaled(Vector(y[0], y[1], high + lift), ahead, forward), aside, left)
    # speed forward + sideways left + phi' z x r
    rate = add_scaled(scale(y[first] - yaw * aside, forward), sideways + yaw * ahead, left)
    return place, Vector(rate.x, rate.y, rise)


@kernel(inline=True)
def hinge_motion(tree: Tree, y: Array, given: Array, out: Array, i: int) -> tuple[Vector, Vector]:
    """Find place and velocity of a link's hinge from its parent's row."""
    parent = tree.link[i, PARENT]
    if parent < 0:
        return carried_by_base(tree, y, tree.real[i, ANCHOR], tree.real[i, ANCHOR + 1], tree.real[i, ANCHOR + 2])
    beside = Vector(0.0 * y[0], tree.real[i, ANCHOR + 1], 0.0 * y[0])
    if tree.link[i, PLACE] != ROD:
        return add(row_vector(out, parent, TIP_PLACE), beside), row_vector(out, parent, TIP_RATE)
    (d, u), far = moving_direction(tree, y, parent), place_on_parent(tree, y, given, i)
    place, rate = row_vector(out, parent, HINGE), row_vector(out, parent, HINGE_RATE)
    return add(add_scaled(place, far, d), beside), add_scaled(add_scaled(rate, lower_rate(tree, y, given, parent), d), far, u)


@kernel
def places(tree: Tree, y: Array, given: Array, out: Array) -> None:
    """Write places and velocities (n, 12) [m], [m/s]: hinge, its rate, tip, its rate.

    A point at r from the hinge, growing with r', is at hinge + r d and moves with hinge' + r' d + r u.
    """
    for i in range(tree.shape[LINKS]):
        place, rate = hinge_motion(tree, y, given, out, i)
        d, u = moving_direction(tree, y, i)
        upper, upper_rate = upper_motion(tree, y, given, i)
        reach = length_below(tree, y, given, i) + tree.real[i, LENGTH] + upper
        growth = lower_rate(tree, y, given, i) + upper_rate
        put_row(out, i, HINGE, place)
        put_row(out, i, HINGE_RATE, rate)
        put_row(out, i, TIP_PLACE, add_scaled(place, reach, d))
        put_row(out, i, TIP_RATE, add_scaled(add_scaled(rate, growth, d), reach, u))


@kernel(inline=True)
def base_energy(tree: Tree, y: Array, gravity: Vector) -> tuple[float, float]:
    """Kinetic energy of the base and its potential [J]."""
    mass, zero = tree.base[BASE_MASS], 0.0 * tree.base[COM_OFFSET]
    if tree.shape[BASE_KIND] == PIVOT:
        return zero, zero
    place, rate = carried_by_base(tree, y, tree.base[COM_OFFSET], zero, zero)
    kinetic = mass * dot(rate, rate)
    if tree.shape[BASE_KIND] >= SKI:
        yaw = yaw_of(tree, y)
        kinetic += tree.base[BASE_INERTIA] * yaw * yaw
    return kinetic, -mass * dot(gravity, place)


@kernel(allocates=True)
def energies(tree: Tree, y: Array, given: Array, out: Array) -> None:
    """Write kinetic energy, potential of gravity and energy of the free segments' springs to out (3,) [J]."""
    rows = np.zeros((tree.shape[LINKS], 12), y.dtype)
    places(tree, y, given, rows)
    gravity, real, springs = vector(tree.base, GRAVITY), tree.real, 0.0 * tree.base[COM_OFFSET]
    twice, potential = base_energy(tree, y, gravity)  # twice the kinetic energy
    for i in range(tree.shape[LINKS]):
        d, u = moving_direction(tree, y, i)
        lower, (upper, _) = length_below(tree, y, given, i), upper_motion(tree, y, given, i)
        far = lower + real[i, CENTRE]
        centre = add_scaled(row_vector(rows, i, HINGE), far, d)
        rate = add_scaled(row_vector(rows, i, HINGE_RATE), lower_rate(tree, y, given, i), d)
        rate, tip_rate = add_scaled(rate, far, u), row_vector(rows, i, TIP_RATE)
        twice += real[i, MASS] * dot(rate, rate) + real[i, INERTIA] * dot(u, u) + real[i, TIP_MASS] * dot(tip_rate, tip_rate)
        weight = add(scale(real[i, MASS], centre), scale(real[i, TIP_MASS], row_vector(rows, i, TIP_PLACE)))
        potential -= dot(gravity, weight)
        if tree.link[i, LOWER_FREE] != 0:
            springs += real[i, K1] * (lower - real[i, REST1]) ** 2
        if tree.link[i, UPPER_FREE] != 0:
            springs += real[i, K2] * (upper - real[i, REST2]) ** 2
    out[0], out[1], out[2] = 0.5 * twice, potential, 0.5 * springs
