"""Angles of directions: of one link on the branch nearest to a reference, in a plane, and between two directions."""

from __future__ import annotations

from vlmb.core import places
from vlmb.core.jit import inner, kernel
from vlmb.core.places import Moving
from vlmb.core.scalars import TAU, atan2, cos, nearest_turn, sin, sqrt, wrapped
from vlmb.core.tree import Array, Tree
from vlmb.core.triples import Vector, cross, dot, plus, scaled

FINE, AT_POLE, LINED_UP = range(3)  # codes
POLE = 1e-6  # cos(psi) or sin(angle) below which an azimuth or the angle between two directions has no row
VERTICAL = 1e-12  # cos(psi) below which a direction tells no azimuth: that of the reference is kept
QUARTER_TURN = (0.25 * TAU) ** 2  # [rad^2]


# Angles of one link


@inner
def read_angles(d: Vector, phi: float, psi: float) -> tuple[float, float]:
    """Return (phi, psi) of a direction on the branch nearest to a reference (phi, psi).

    (phi, psi) and (phi + pi, pi - psi), each modulo 2 pi, are the same direction.
    """
    phi, psi, _ = read_branch(d, phi, psi)
    return phi, psi


@inner
def read_branch(d: Vector, phi: float, psi: float) -> tuple[float, float, float]:
    """Return the same, and the sign of cos psi there."""
    flat = sqrt(d[0] * d[0] + d[1] * d[1])
    up = atan2(d[2], flat)
    turn = atan2(d[1], d[0]) if flat > VERTICAL else phi
    first = wrapped(turn - phi), wrapped(up - psi)
    near = first[0] * first[0] + first[1] * first[1]
    if near < QUARTER_TURN:
        return phi + first[0], psi + first[1], 1.0
    second = wrapped(turn + 0.5 * TAU - phi), wrapped(0.5 * TAU - up - psi)
    if second[0] * second[0] + second[1] * second[1] < near:
        return phi + second[0], psi + second[1], -1.0
    return phi + first[0], psi + first[1], 1.0


@inner
def axes_at(d: Vector, phi: float, side: float) -> tuple[Vector, Vector, float]:
    """Return u_phi = (-sin phi, cos phi, 0), u_psi = (-cos phi sin psi, -sin phi sin psi, cos psi) and cos psi at (d, phi)."""
    flat = sqrt(d[0] * d[0] + d[1] * d[1])
    if flat > VERTICAL:
        cosine, sine = side * d[0] / flat, side * d[1] / flat
    else:
        cosine, sine = cos(phi), sin(phi)
    return (-sine, cosine, 0.0 * sine), (-cosine * d[2], -sine * d[2], side * flat), side * flat


@kernel
def azimuth(tree: Tree, y: Array, i: int, near: Array) -> tuple[int, Moving]:
    """Return phi: phi' = u_phi . u / cos psi, phi'' = (u_phi . d'' + 2 phi' psi' sin psi) / cos psi."""
    d, u, drift = places.link_direction(tree, y, i)
    phi, _, side = read_branch(d, near[0], near[1])
    across, upwards, steep = axes_at(d, phi, side)
    if abs(steep) < POLE:
        return AT_POLE, (phi, 0.0 * phi, 0.0 * phi)
    rate, climb = dot(across, u) / steep, dot(upwards, u)
    return FINE, (phi, rate, (dot(across, drift) + 2.0 * rate * climb * d[2]) / steep)


@kernel
def elevation(tree: Tree, y: Array, i: int, near: Array) -> Moving:
    """Return psi: psi' = u_psi . u, psi'' = u_psi . d'' - (u_phi . u)^2 tan psi; without the last term at the pole."""
    d, u, drift = places.link_direction(tree, y, i)
    phi, psi, side = read_branch(d, near[0], near[1])
    across, upwards, steep = axes_at(d, phi, side)
    sideways = dot(across, u)
    bend = sideways * sideways * d[2] / steep if abs(steep) > POLE else 0.0 * steep
    return psi, dot(upwards, u), dot(upwards, drift) - bend


@inner
def push_azimuth(tree: Tree, y: Array, i: int, force: float, out: Array) -> int:
    """Add the row of phi, (z x d) / (d_x^2 + d_y^2), times a moment M_phi."""
    d = places.link_direction(tree, y, i)[0]
    flat = d[0] * d[0] + d[1] * d[1]
    if flat < POLE * POLE:
        return AT_POLE
    places.push_direction(tree, y, i, d, scaled(force / flat, places.leftwards(d)), out)
    return FINE


@inner
def push_elevation(tree: Tree, y: Array, i: int, near: Array, force: float, out: Array) -> None:
    """Add the row of psi, u_psi, times a moment M_psi."""
    d = places.link_direction(tree, y, i)[0]
    phi, _, side = read_branch(d, near[0], near[1])
    places.push_direction(tree, y, i, d, scaled(force, axes_at(d, phi, side)[1]), out)


# Angles of directions in the upright plane of the heading


@inner
def plane_elevation(tree: Tree, y: Array, which: int) -> Moving:
    """Return psi of (cos psi h, sin psi): psi' = e . u with e = (-sin psi h, cos psi), drift e . d'' + e' . u."""
    if which < 0:
        return (0.25 * TAU if which == places.NORMAL else 0.0), 0.0, 0.0
    d, u, drift = places.link_direction(tree, y, which)
    h, w = places.heading(tree, y), places.yaw_rate(tree, y)
    flat = dot(d, h)
    e = plus((0.0, 0.0, flat), -d[2], h)
    return atan2(d[2], flat), dot(e, u), dot(e, drift) - d[2] * w * dot(u, places.leftwards(h))


@inner
def push_plane_elevation(tree: Tree, y: Array, which: int, force: float, out: Array) -> None:
    """Add the row of psi in the plane times a moment; a heading and a normal take none."""
    if which >= 0:
        d, h = places.link_direction(tree, y, which)[0], places.heading(tree, y)
        places.push_direction(tree, y, which, d, plus((0.0, 0.0, force * dot(d, h)), -force * d[2], h), out)


@inner
def plane_angle(tree: Tree, y: Array, first: int, second: int, near: float) -> Moving:
    """Return psi of the second direction less psi of the first, by whole turns nearest to a reference."""
    angle, rate, drift = 0.0 * near, 0.0 * near, 0.0 * near
    for side in range(2):  # a loop keeps what is compiled short
        which, sign = (second, 1.0) if side else (first, -1.0)
        psi, psi1, psi2 = plane_elevation(tree, y, which)
        angle, rate, drift = angle + sign * psi, rate + sign * psi1, drift + sign * psi2
    return nearest_turn(angle, near), rate, drift


# The angle between two directions


@inner
def angle_between(tree: Tree, y: Array, first: int, second: int) -> tuple[int, Moving]:
    """Return theta of two directions a, b: -sin theta theta' = (a . b)', -sin theta theta'' = (a . b)'' + theta'^2 a . b."""
    a, a1, a2 = places.direction(tree, y, first)
    b, b1, b2 = places.direction(tree, y, second)
    n = cross(a, b)
    sine, cosine = sqrt(dot(n, n)), dot(a, b)
    theta = atan2(sine, cosine)
    if sine < POLE:
        return LINED_UP, (theta, 0.0 * theta, 0.0 * theta)
    rate = -(dot(a1, b) + dot(a, b1)) / sine
    return FINE, (theta, rate, -(dot(a2, b) + 2.0 * dot(a1, b1) + dot(a, b2) + cosine * rate * rate) / sine)


@inner
def push_angle(tree: Tree, y: Array, first: int, second: int, force: float, out: Array) -> int:
    """Add the row of theta times a torque: -b / sin theta on a, -a / sin theta on b."""
    a, b = places.direction(tree, y, first)[0], places.direction(tree, y, second)[0]
    n = cross(a, b)
    sine = sqrt(dot(n, n))
    if sine < POLE:
        return LINED_UP
    places.push_direction(tree, y, first, a, scaled(-force / sine, b), out)
    places.push_direction(tree, y, second, b, scaled(-force / sine, a), out)
    return FINE
