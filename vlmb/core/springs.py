"""Springs and dampers between two directions, as generalized forces.

The spring's torque is -k (theta - rest) on the angle theta between them. The damper between two links takes the power c theta'^2.
Where one end is the base, whose angular velocity is w (0, or a ski's phi0' about the normal), it takes c |r|^2 with
r = d' - w x d: its forces are minus the derivatives of half of it by the rates, -c r on d' and c r . (z x d) on phi0'.
In a plane theta of two links is the signed angle psi_second - psi_first, which no line-up disturbs.
"""

from __future__ import annotations

from typing import NamedTuple

from vlmb.core import places
from vlmb.core.angles import plane_angle, push_plane_elevation
from vlmb.core.jit import inner, kernel
from vlmb.core.scalars import NAN, atan2, sqrt
from vlmb.core.tree import Array, Integers, Tree
from vlmb.core.triples import Vector, cross, dot, plus, scaled

LINKS, ON_BASE, IN_PLANE = range(3)  # between two links; from NORMAL or HEADING (first) to a link; between two links of a plane
FIRST, SECOND, FORM = range(3)  # columns of `pair`
STIFFNESS, DAMPING, REST = range(3)  # columns of `constant`
IN_LINE = 1e-9  # sin(angle) below which two directions have no axis between them


class AngleSprings(NamedTuple):
    """Springs and dampers between directions."""

    pair: Integers  # (count, 3) first and second direction, form
    constant: Array  # (count, 3) stiffness [N m], damping [N m s], rest [rad]


@inner
def torque_over_sine(k: float, rest: float, sine: float, cosine: float) -> float:
    """Return -k (theta - rest) / sin theta; nan where the two directions line up and theta is not at rest."""
    off = atan2(sine, cosine) - rest
    if sine > IN_LINE:
        return -k * off / sine
    if k == 0.0:
        return 0.0
    if abs(off) > 2.0 * IN_LINE:
        return NAN
    return -k if cosine > 0.0 else k


@kernel
def add_springs(springs: AngleSprings, tree: Tree, y: Array, near: Array, out: Array) -> tuple[int, float]:
    """Add the generalized forces of all to `out` (nv,); return 0, or 1 + the first that has no axis, and the power lost [W].

    near (count,): signed angles in a plane are read by whole turns nearest to these.
    """
    lost = 0.0
    for k in range(springs.pair.shape[0]):
        form = springs.pair[k, FORM]
        if form == IN_PLANE:
            lost += add_in_plane(springs, k, tree, y, near[k], out)
        else:
            power = add_in_space(springs, k, tree, y, out)
            if not power >= 0.0:
                return 1 + k, lost
            lost += power
    return 0, lost


@inner
def add_in_plane(springs: AngleSprings, k: int, tree: Tree, y: Array, near: float, out: Array) -> float:
    """Add one on the signed angle; return the power lost [W]."""
    first, second = springs.pair[k, FIRST], springs.pair[k, SECOND]
    theta, rate, _ = plane_angle(tree, y, first, second, near)
    torque = -springs.constant[k, STIFFNESS] * (theta - springs.constant[k, REST]) - springs.constant[k, DAMPING] * rate
    push_plane_elevation(tree, y, first, -torque, out)
    push_plane_elevation(tree, y, second, torque, out)
    return springs.constant[k, DAMPING] * rate * rate


@inner
def add_in_space(springs: AngleSprings, k: int, tree: Tree, y: Array, out: Array) -> float:
    """Add one on the angle in space; return the power lost [W], nan where it has no axis."""
    first, second = springs.pair[k, FIRST], springs.pair[k, SECOND]
    a, b = places.direction(tree, y, first), places.direction(tree, y, second)
    n = cross(a[0], b[0])
    sine, damping, lost = sqrt(dot(n, n)), springs.constant[k, DAMPING], 0.0
    ratio = torque_over_sine(springs.constant[k, STIFFNESS], springs.constant[k, REST], sine, dot(a[0], b[0]))
    if springs.pair[k, FORM] == ON_BASE:
        lost = damp_on_base(tree, y, second, b[0], b[1], damping, out)
    elif damping != 0.0:
        rate = -(dot(a[1], b[0]) + dot(a[0], b[1])) / sine if sine > IN_LINE else NAN
        lost = damping * rate * rate
        ratio -= damping * rate / sine
    if ratio != 0.0 and ratio == ratio:
        push_apart(tree, y, first, second, a[0], b[0], ratio, out)
    return lost if ratio == ratio else NAN


@inner
def push_apart(tree: Tree, y: Array, first: int, second: int, a: Vector, b: Vector, ratio: float, out: Array) -> None:
    """Add the forces of a torque on theta, given over sin theta: -b on a and -a on b, each times the ratio."""
    places.push_direction(tree, y, first, a, scaled(-ratio, b), out)
    places.push_direction(tree, y, second, b, scaled(-ratio, a), out)


@inner
def damp_on_base(tree: Tree, y: Array, link: int, d: Vector, u: Vector, damping: float, out: Array) -> float:
    """Add the forces of a damper between a link and the base, the base's reaction included; return the power lost [W]."""
    turning = places.leftwards(d)
    r = plus(u, -places.yaw_rate(tree, y), turning)
    places.push_direction(tree, y, link, d, scaled(-damping, r), out)
    if places.steers(tree):
        out[places.yaw_index(tree)] += damping * dot(r, turning)
    return damping * dot(r, r)


@kernel
def springs_energy(springs: AngleSprings, tree: Tree, y: Array, near: Array) -> float:
    """Return the sum of k (theta - rest)^2 / 2 [J]."""
    total = 0.0
    for k in range(springs.pair.shape[0]):
        off = spring_angle(springs, k, tree, y, near[k]) - springs.constant[k, REST]
        total += 0.5 * springs.constant[k, STIFFNESS] * off * off
    return total


@inner
def spring_angle(springs: AngleSprings, k: int, tree: Tree, y: Array, near: float) -> float:
    """Return theta of one [rad]."""
    first, second = springs.pair[k, FIRST], springs.pair[k, SECOND]
    if springs.pair[k, FORM] == IN_PLANE:
        return plane_angle(tree, y, first, second, near)[0]
    a, b = places.direction(tree, y, first)[0], places.direction(tree, y, second)[0]
    n = cross(a, b)
    return atan2(sqrt(dot(n, n)), dot(a, b))


@kernel
def line_ups(springs: AngleSprings, tree: Tree, y: Array, out: Array) -> None:
    """Write the sine of each angle, the rate of its cosine and its cosine into `out` (count, 3).

    Two directions pass their line-up where the rate changes its sign while the sine is almost 0. In a plane: 1, 0, 0.
    """
    for k in range(springs.pair.shape[0]):
        a, b = places.direction(tree, y, springs.pair[k, FIRST]), places.direction(tree, y, springs.pair[k, SECOND])
        n = cross(a[0], b[0])
        out[k, 0], out[k, 1] = sqrt(dot(n, n)), dot(a[1], b[0]) + dot(a[0], b[1])
        out[k, 2] = dot(a[0], b[0])
        if springs.pair[k, FORM] == IN_PLANE:
            out[k, 0], out[k, 1], out[k, 2] = 1.0, 0.0, 0.0


@inner
def follow_springs(springs: AngleSprings, tree: Tree, y: Array, near: Array) -> None:
    """Move the references of signed angles to those read now: after a step that is accepted."""
    for k in range(springs.pair.shape[0]):
        near[k] = spring_angle(springs, k, tree, y, near[k])
