"""What an equation may name of a tree of bodies: value, rate and drift of every quantity, its row, and rows that hold frames.

The second derivative along a motion is L v' + drift, with L the row. Angles are read on the branch nearest to a reference.
"""

from __future__ import annotations

from typing import NamedTuple

from vlmb.core import bodies as of
from vlmb.core.bodies import Bodies, column, drift_at, push, push_at, turned, vector, velocity_at
from vlmb.core.jit import inner, kernel
from vlmb.core.scalars import NAN, TAU, atan2, nearest_turn, sqrt, wrapped
from vlmb.core.tree import Array, Integers
from vlmb.core.triples import Vector, cross, dot, plus, scaled

(
    COORDINATE,  # of joint FIRST
    SPEED,  # a rate alone: velocity FIRST
    POINT,  # COMPONENT of the place of frame FIRST
    AXIS,  # COMPONENT of axis SECOND of frame FIRST
    CENTRE_OF_MASS,  # COMPONENT
    HEADING,  # atan2 of the first axis of frame FIRST on the surface; COMPONENT 0: a link's, whose elevation may lean past pi/2
    ROLL,  # atan2 of what second and third axis rise
    ELEVATION,  # what the first axis rises above the surface; COMPONENT 1: pitch, what it sinks
    LENGTH,  # `offset`, and the coordinates of joints FIRST and SECOND, 0 for none
    BETWEEN,  # the distance of frames FIRST and SECOND
) = range(10)  # fmt: skip
KIND, FIRST, COMPONENT, SECOND = range(4)  # columns of `kind`
TRACE = 3  # axis of an edge: z of the surface x the frame's first axis
FLAT = 1e-12  # below which there is no heading
Moving = tuple[float, float, float]


class Readings(NamedTuple):
    """Frames and quantities of a tree."""

    frame: Integers  # (frames,) body of each
    place: Array  # (frames, 12) its rotation and place there
    kind: Integers  # (count, 4)
    offset: Array  # (count,)
    reference: Array  # (count, 2) angle near which one is read; of an elevation the second
    mass: Array  # (1,) [kg] of all


@kernel
def place_of(bodies: Bodies, readings: Readings, f: int) -> Vector:
    """Return where a frame is."""
    j = readings.frame[f]
    return plus(vector(bodies.state, j, of.AT), 1.0, turned(bodies.state, j, vector(readings.place, f, of.PLACE)))


@inner
def axis_of(bodies: Bodies, readings: Readings, f: int, axis: int) -> Vector:
    """Return an axis of a frame."""
    return turned(bodies.state, readings.frame[f], column(readings.place, f, axis))


@inner
def moving_axis(bodies: Bodies, readings: Readings, f: int, axis: int) -> tuple[Vector, Vector, Vector]:
    """Return an axis of a frame, its rate and drift."""
    state, j = bodies.state, readings.frame[f]
    d, omega = axis_of(bodies, readings, f, axis), vector(state, j, of.ANGULAR)
    u = cross(omega, d)
    return d, u, plus(cross(vector(state, j, of.ANGULAR_DRIFT), d), 1.0, cross(omega, u))


@kernel
def centre_of_mass(bodies: Bodies, readings: Readings) -> tuple[Vector, Vector, Vector]:
    """Return place, velocity and drift of the centre of mass of all."""
    place, velocity, drift = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for j in range(1, bodies.joint.shape[0]):
        share = bodies.real[j, of.MASS] / readings.mass[0]
        if share != 0.0:
            p = plus(vector(bodies.state, j, of.AT), 1.0, turned(bodies.state, j, vector(bodies.real, j, of.CENTRE)))
            place = plus(place, share, p)
            velocity = plus(velocity, share, velocity_at(bodies.state, j, p))
            drift = plus(drift, share, drift_at(bodies.state, j, p))
    return place, velocity, drift


@inner
def turning(y: Moving, x: Moving) -> Moving:
    """Return atan2(y, x) with rate and drift."""
    square = x[0] * x[0] + y[0] * y[0]
    if not square > FLAT * FLAT:
        return NAN, NAN, NAN
    rate = (x[0] * y[1] - y[0] * x[1]) / square
    growth = 2.0 * (x[0] * x[1] + y[0] * y[1])
    return atan2(y[0], x[0]), rate, (x[0] * y[2] - y[0] * x[2] - rate * growth) / square


@inner
def component(parts: tuple[Vector, Vector, Vector], k: int) -> Moving:
    """Return one component of value, rate and drift."""
    return parts[0][k], parts[1][k], parts[2][k]


@inner
def leaning(bodies: Bodies, readings: Readings, k: int) -> bool:
    """Tell whether a link's angles are (phi + pi, pi - psi), which is the same direction: where those are nearer."""
    d = axis_of(bodies, readings, readings.kind[k, FIRST], 0)
    phi, psi = atan2(d[1], d[0]), atan2(d[2], sqrt(d[0] * d[0] + d[1] * d[1]))
    near, other = readings.reference[k, 0], readings.reference[k, 1]
    here = wrapped(phi - near) ** 2 + wrapped(psi - other) ** 2
    there = wrapped(phi + 0.5 * TAU - near) ** 2 + wrapped(0.5 * TAU - psi - other) ** 2
    return there < here


@kernel
def measure(bodies: Bodies, readings: Readings, k: int, q: Array, v: Array) -> Moving:
    """Return value, rate and drift of quantity k."""
    kind, first, other = readings.kind[k, KIND], readings.kind[k, FIRST], readings.kind[k, COMPONENT]
    second = readings.kind[k, SECOND]
    if kind == COORDINATE:
        return q[bodies.joint[first, of.AT_Q] + other], v[bodies.joint[first, of.AT_V] + other], 0.0
    if kind == SPEED:
        return 0.0, v[first], 0.0
    if kind == POINT:
        p, j = place_of(bodies, readings, first), readings.frame[first]
        return p[other], velocity_at(bodies.state, j, p)[other], drift_at(bodies.state, j, p)[other]
    if kind == AXIS:
        return component(moving_axis(bodies, readings, first, second), other)
    if kind == CENTRE_OF_MASS:
        return component(centre_of_mass(bodies, readings), other)
    if kind == HEADING:
        axis = moving_axis(bodies, readings, first, 0)
        angle, rate, drift = turning(component(axis, 1), component(axis, 0))
        if other == 0 and leaning(bodies, readings, k):
            angle += 0.5 * TAU
        return nearest_turn(angle, readings.reference[k, 0]), rate, drift
    if kind == ROLL:
        y, z = moving_axis(bodies, readings, first, 1), moving_axis(bodies, readings, first, 2)
        angle, rate, drift = turning(component(y, 2), component(z, 2))
        return nearest_turn(angle, readings.reference[k, 0]), rate, drift
    if kind == ELEVATION:
        return elevation(bodies, readings, k)
    if kind == LENGTH:
        value, rate = readings.offset[k], 0.0
        for j in (first, second):
            if j > 0:
                value, rate = value + q[bodies.joint[j, of.AT_Q]], rate + v[bodies.joint[j, of.AT_V]]
        return value, rate, 0.0
    return distance(bodies, readings, first, second)


@inner
def elevation(bodies: Bodies, readings: Readings, k: int) -> Moving:
    """Return psi with sin psi = d_z and its derivatives; beyond the vertical pi - psi. A pitch is -psi."""
    d, u, w = moving_axis(bodies, readings, readings.kind[k, FIRST], 0)
    flat = sqrt(d[0] * d[0] + d[1] * d[1])
    angle, rate, drift = atan2(d[2], flat), NAN, NAN
    if flat > FLAT:
        rate = u[2] / flat
        drift = (w[2] + d[2] * rate * rate) / flat
    else:  # at the pole itself the motion goes through it
        rate = -sqrt(u[0] * u[0] + u[1] * u[1]) * (1.0 if d[2] > 0.0 else -1.0)
    if readings.kind[k, COMPONENT] == 1:
        return -angle, -rate, -drift
    if leaning(bodies, readings, k):
        angle, rate, drift = 0.5 * TAU - angle, -rate, -drift
    return nearest_turn(angle, readings.reference[k, 1]), rate, drift


@inner
def distance(bodies: Bodies, readings: Readings, first: int, second: int) -> Moving:
    """Return the distance of two frames, its rate and drift."""
    i, j = readings.frame[first], readings.frame[second]
    p, s = place_of(bodies, readings, first), place_of(bodies, readings, second)
    r = plus(s, -1.0, p)
    w = plus(velocity_at(bodies.state, j, s), -1.0, velocity_at(bodies.state, i, p))
    a = plus(drift_at(bodies.state, j, s), -1.0, drift_at(bodies.state, i, p))
    length = sqrt(dot(r, r))
    if not length > FLAT:
        return length, NAN, NAN
    rate = dot(r, w) / length
    return length, rate, (dot(r, a) + dot(w, w) - rate * rate) / length


@inner
def unit(k: int) -> Vector:
    """Return a unit vector of the surface frame."""
    return (1.0 if k == 0 else 0.0), (1.0 if k == 1 else 0.0), (1.0 if k == 2 else 0.0)


@inner
def push_axis(bodies: Bodies, readings: Readings, f: int, axis: int, weight: Vector, out: Array) -> None:
    """Add the row of weight . axis of a frame: d' = w x d, so that it is the moment d x weight."""
    moment = cross(axis_of(bodies, readings, f, axis), weight)
    push(bodies, readings.frame[f], (0.0, 0.0, 0.0), moment, out)


@kernel
def add_row(bodies: Bodies, readings: Readings, k: int, scale: float, out: Array) -> None:
    """Add the row of quantity k, times a scale. Needs `move`."""
    kind, first, other = readings.kind[k, KIND], readings.kind[k, FIRST], readings.kind[k, COMPONENT]
    second = readings.kind[k, SECOND]
    if kind == COORDINATE:
        out[bodies.joint[first, of.AT_V] + other] += scale
    elif kind == SPEED:
        out[first] += scale
    elif kind == POINT:
        push_at(bodies, readings.frame[first], place_of(bodies, readings, first), scaled(scale, unit(other)), out)
    elif kind == AXIS:
        push_axis(bodies, readings, first, second, scaled(scale, unit(other)), out)
    elif kind == CENTRE_OF_MASS:
        for j in range(1, bodies.joint.shape[0]):
            share = bodies.real[j, of.MASS] / readings.mass[0]
            if share != 0.0:
                p = plus(vector(bodies.state, j, of.AT), 1.0, turned(bodies.state, j, vector(bodies.real, j, of.CENTRE)))
                push_at(bodies, j, p, scaled(scale * share, unit(other)), out)
    elif kind == HEADING:
        d = axis_of(bodies, readings, first, 0)
        square = d[0] * d[0] + d[1] * d[1]
        factor = scale / square if square > FLAT * FLAT else NAN
        push_axis(bodies, readings, first, 0, (-factor * d[1], factor * d[0], 0.0), out)
    elif kind == ROLL:
        y, z = axis_of(bodies, readings, first, 1)[2], axis_of(bodies, readings, first, 2)[2]
        square = y * y + z * z
        factor = scale / square if square > FLAT * FLAT else NAN
        push_axis(bodies, readings, first, 1, (0.0, 0.0, factor * z), out)
        push_axis(bodies, readings, first, 2, (0.0, 0.0, -factor * y), out)
    elif kind == ELEVATION:
        d = axis_of(bodies, readings, first, 0)
        flat = sqrt(d[0] * d[0] + d[1] * d[1])
        factor = scale / flat if flat > FLAT else NAN
        if other == 1 or leaning(bodies, readings, k):
            factor = -factor
        push_axis(bodies, readings, first, 0, (0.0, 0.0, factor), out)
    elif kind == LENGTH:
        for j in (first, second):
            if j > 0:
                out[bodies.joint[j, of.AT_V]] += scale
    else:
        p, s = place_of(bodies, readings, first), place_of(bodies, readings, second)
        r = plus(s, -1.0, p)
        e = scaled(scale / sqrt(dot(r, r)), r)
        push_at(bodies, readings.frame[second], s, e, out)
        push_at(bodies, readings.frame[first], p, scaled(-1.0, e), out)


# Rows that hold frames


@inner
def weld(bodies: Bodies, readings: Readings, first: int, second: int, r: int, out: Array, matrix: Array) -> None:
    """Write six rows from r on: place and turn of the first frame less those of the second, surface frame.

    The error of the turn is half the sum of d_second x d_first over the axes: its rate is the angular velocity between them but
    for squares of the error.
    """
    state, i, j = bodies.state, readings.frame[first], readings.frame[second]
    p, s = place_of(bodies, readings, first), place_of(bodies, readings, second)
    error = plus(p, -1.0, s)
    rate = plus(velocity_at(state, i, p), -1.0, velocity_at(state, j, s))
    drift = plus(drift_at(state, i, p), -1.0, drift_at(state, j, s))
    turn = (0.0, 0.0, 0.0)
    for axis in range(3):
        away = cross(axis_of(bodies, readings, second, axis), axis_of(bodies, readings, first, axis))
        turn = plus(turn, 0.5, away)
    spin = plus(vector(state, i, of.ANGULAR), -1.0, vector(state, j, of.ANGULAR))
    growth = plus(vector(state, i, of.ANGULAR_DRIFT), -1.0, vector(state, j, of.ANGULAR_DRIFT))
    for k in range(3):
        out[0, r + k], out[1, r + k], out[2, r + k] = error[k], rate[k], drift[k]
        out[0, r + 3 + k], out[1, r + 3 + k], out[2, r + 3 + k] = turn[k], spin[k], growth[k]
        push_at(bodies, i, p, unit(k), matrix[r + k])
        push_at(bodies, j, s, scaled(-1.0, unit(k)), matrix[r + k])
        push(bodies, i, (0.0, 0.0, 0.0), unit(k), matrix[r + 3 + k])
        push(bodies, j, (0.0, 0.0, 0.0), scaled(-1.0, unit(k)), matrix[r + 3 + k])


@inner
def edge(bodies: Bodies, readings: Readings, f: int, axis: int, r: int, out: Array, matrix: Array) -> None:
    """Write the row of a knife edge: n . velocity of the frame's origin, n an axis of it or the horizontal across its trace."""
    state, j, p = bodies.state, readings.frame[f], place_of(bodies, readings, f)
    d, u, _ = moving_axis(bodies, readings, f, 0 if axis == TRACE else axis)
    n, turning_n = d, u
    if axis == TRACE:
        flat = sqrt(d[0] * d[0] + d[1] * d[1])
        size = 1.0 / flat if flat > FLAT else NAN
        n = (-d[1] * size, d[0] * size, 0.0)
        angle = (d[0] * u[1] - d[1] * u[0]) * size * size
        turning_n = (-n[1] * angle, n[0] * angle, 0.0)
    speed = velocity_at(state, j, p)
    out[0, r], out[1, r] = 0.0, dot(n, speed)
    out[2, r] = dot(n, drift_at(state, j, p)) + dot(turning_n, speed)
    push_at(bodies, j, p, n, matrix[r])
