"""Directions, distances and places of a mechanism from its state, with their rates and drifts, and their rows.

Each of them x has a rate x' = L v and a second derivative x'' = L v' + drift. A direction d with u = d' has d'' = w - |u|^2 d, w
across d. The state carries d and u with small errors of length and of angle; what the motion means is
    d^ = d / |d|,  u^ = u - s d^  with  s = u . d^,  and u' = w - |u^|^2 d^ + s u^,
so that d^'' = u' across d^ - s u^ - |u^|^2 d^.

Links that stay in upright planes along a ski have d, u and w in its frame, which turns with W = phi0' z. In the surface frame the
rate is then u^ + W x d^, and d^'' has 2 W x u^ + W x (W x d^) + phi0'' z x d^ beside these.
"""

from __future__ import annotations

from vlmb.core import scratch
from vlmb.core import tree as of
from vlmb.core.jit import inner, kernel
from vlmb.core.scalars import cos, sin, sqrt
from vlmb.core.tree import Array, Tree
from vlmb.core.triples import Vector, across, dot, plus, scaled

Motion = tuple[Vector, Vector, Vector]  # value, rate, drift
Moving = tuple[float, float, float]  # the same of a number

NORMAL, HEADING = -1, -2  # directions that are no link's: the surface normal; the ski's heading, or the x axis
LOWER, UPPER, BOTH = 1, 2, 3  # segments that a distance along a link includes


@inner
def steers(tree: Tree) -> bool:
    """Tell whether the base is a ski, whose heading turns."""
    return tree.shape[of.BASE_KIND] >= of.SKI


@inner
def yaw_index(tree: Tree) -> int:
    """Return where the yaw rate of a ski stands among the velocities."""
    return 1 if tree.shape[of.BASE_KIND] == of.SKI else 2


@inner
def yaw_rate(tree: Tree, y: Array) -> float:
    """Return phi0' [rad/s]; 0 for a base that does not turn."""
    return y[tree.shape[of.POSITIONS] + yaw_index(tree)] if steers(tree) else 0.0


@inner
def heading(tree: Tree, y: Array) -> Vector:
    """Return the ski's direction h = (cos phi0, sin phi0, 0); the x axis for another base."""
    return (cos(y[2]), sin(y[2]), 0.0) if steers(tree) else (1.0, 0.0, 0.0)


@inner
def heading_met(tree: Tree, rows: Array) -> Vector:
    """Return the same of the state in which `accelerate` was last."""
    n = tree.shape[of.LINKS]
    return (rows[n, scratch.COSINE], rows[n, scratch.SINE], 0.0) if steers(tree) else (1.0, 0.0, 0.0)


@inner
def leftwards(h: Vector) -> Vector:
    """Return z x h."""
    return -h[1], h[0], 0.0


@inner
def link_direction(tree: Tree, y: Array, i: int) -> Motion:
    """Return d^, u^ and the drift of d^ of a link."""
    p, v = tree.link[i, of.AT_P], tree.shape[of.POSITIONS] + tree.link[i, of.AT_V]
    x, z, w = y[p], y[p + 1], y[p + 2]
    d = scaled(1.0 / sqrt(x * x + z * z + w * w), (x, z, w))
    u = (y[v], y[v + 1], y[v + 2])
    s = dot(u, d)
    u = plus(u, -s, d)
    drift = plus(scaled(-s, u), -dot(u, u), d)
    if tree.shape[of.UPRIGHT] != 0:
        return turned_with_ski(tree, y, d, u, drift)
    return d, u, drift


@inner
def turned_with_ski(tree: Tree, y: Array, d: Vector, u: Vector, drift: Vector) -> Motion:
    """Return a direction of the ski's frame with its rate and drift there in the surface frame."""
    h, w = heading(tree, y), yaw_rate(tree, y)
    rate = plus(u, w, leftwards(d))
    drift = plus(plus(drift, 2.0 * w, leftwards(u)), -w * w, (d[0], d[1], 0.0))
    return to_surface(h, d), to_surface(h, rate), to_surface(h, drift)


@inner
def to_surface(h: Vector, a: Vector) -> Vector:
    """Return a vector of the frame of a ski with the heading h in the surface frame."""
    return h[0] * a[0] - h[1] * a[1], h[1] * a[0] + h[0] * a[1], a[2]


@kernel
def direction(tree: Tree, y: Array, which: int) -> Motion:
    """Return a direction, its rate and drift: of link `which`, NORMAL or HEADING."""
    if which >= 0:
        return link_direction(tree, y, which)
    if which == NORMAL:
        return (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    h, w = heading(tree, y), yaw_rate(tree, y)
    return h, scaled(w, leftwards(h)), scaled(-w * w, h)


@inner
def push_direction(tree: Tree, y: Array, which: int, d: Vector, e: Vector, out: Array) -> None:
    """Add to `out` (nv,) the row of e . d, that is the force of e on the direction d."""
    if which >= 0:
        at, part = tree.link[which, of.AT_V], across(e, d)
        if tree.shape[of.UPRIGHT] != 0:  # in the plane it turns the link, sideways the ski
            out[yaw_index(tree)] += dot(e, leftwards(d))
            part = dot(part, heading(tree, y)), 0.0, part[2]
        out[at] += part[0]
        out[at + 1] += part[1]
        out[at + 2] += part[2]
    elif which == HEADING and steers(tree):
        out[yaw_index(tree)] += dot(e, leftwards(d))


@inner
def lower_length(tree: Tree, y: Array, given: Array, i: int) -> Moving:
    """Return a, a' and the drift of a: 0 where a is free, a'' where it is given."""
    if tree.link[i, of.LOWER_FREE]:
        return y[tree.link[i, of.AT_P] + 3], y[tree.shape[of.POSITIONS] + tree.link[i, of.AT_V] + 3], 0.0
    return given[i, 0], given[i, 1], given[i, 2]


@inner
def upper_length(tree: Tree, y: Array, given: Array, i: int) -> Moving:
    """Return b, b' and the drift of b."""
    if tree.link[i, of.UPPER_FREE]:
        after = 3 + tree.link[i, of.LOWER_FREE]
        return y[tree.link[i, of.AT_P] + after], y[tree.shape[of.POSITIONS] + tree.link[i, of.AT_V] + after], 0.0
    return given[i, 3], given[i, 4], given[i, 5]


@kernel
def distance(tree: Tree, y: Array, given: Array, i: int, offset: float, along: int) -> Moving:
    """Return the distance from a link's hinge, offset + a and/or b, with rate and drift."""
    r, rate, drift = offset, 0.0 * offset, 0.0 * offset
    if along & LOWER:
        a, a1, a2 = lower_length(tree, y, given, i)
        r, rate, drift = r + a, rate + a1, drift + a2
    if along & UPPER:
        b, b1, b2 = upper_length(tree, y, given, i)
        r, rate, drift = r + b, rate + b1, drift + b2
    return r, rate, drift


@inner
def push_distance(tree: Tree, i: int, along: int, force: float, out: Array) -> None:
    """Add the row of a distance along link i times a force."""
    at = tree.link[i, of.AT_V] + 3
    if along & LOWER and tree.link[i, of.LOWER_FREE]:
        out[at] += force
    if along & UPPER and tree.link[i, of.UPPER_FREE]:
        out[at + tree.link[i, of.LOWER_FREE]] += force


@inner
def base_place(tree: Tree, y: Array, h: Vector) -> Motion:
    """Return place, velocity and drift of the base's point A, with the heading h."""
    kind, v = tree.shape[of.BASE_KIND], tree.shape[of.POSITIONS]
    if kind == of.PIVOT:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if kind in (of.FREE, of.PLANTED):
        return (y[0], y[1], y[2]), (y[v], y[v + 1], y[v + 2]), (0.0, 0.0, 0.0)
    n, w = leftwards(h), yaw_rate(tree, y)
    sideways = y[v + 1] if kind >= of.SLIDING else 0.0
    high, rising = (y[3], y[v + 3]) if kind == of.LIFTED else (0.0, 0.0)
    velocity = plus(scaled(y[v], h), sideways, n)
    return (y[0], y[1], high), (velocity[0], velocity[1], rising), plus(scaled(w * y[v], n), -w * sideways, h)


@inner
def push_base(tree: Tree, h: Vector, e: Vector, out: Array) -> None:
    """Add the row of e . place of the base's point A, with the heading h."""
    kind = tree.shape[of.BASE_KIND]
    if kind in (of.FREE, of.PLANTED):
        out[0] += e[0]
        out[1] += e[1]
        out[2] += e[2]
    elif kind != of.PIVOT:
        out[0] += dot(e, h)
        if kind >= of.SLIDING:
            out[1] += dot(e, leftwards(h))
        if kind == of.LIFTED:
            out[3] += e[2]


@inner
def arm_of(tree: Tree, h: Vector, i: int) -> Vector:
    """Return the way from A to the hinge of a link on the base [m]."""
    ahead, left, up = tree.real[i, of.ANCHOR], tree.real[i, of.ANCHOR + 1], tree.real[i, of.ANCHOR + 2]
    return plus(plus(scaled(ahead, h), left, leftwards(h)), 1.0, (0.0, 0.0, up))


@inner
def turned_arm(tree: Tree, y: Array, arm: Vector) -> Motion:
    """Return an arm that turns with the base, its rate w z x arm and its drift -w^2 times its flat part."""
    w = yaw_rate(tree, y)
    return arm, scaled(w, leftwards(arm)), scaled(-w * w, (arm[0], arm[1], 0.0))


@inner
def push_arm(tree: Tree, arm: Vector, e: Vector, out: Array) -> None:
    """Add the row of e . arm."""
    if steers(tree):
        out[yaw_index(tree)] += dot(e, leftwards(arm))


@inner
def added(total: Motion, r: Moving, d: Motion) -> Motion:
    """Add r d to a place: rate r' d + r d', drift with 2 r' d'."""
    value = plus(total[0], r[0], d[0])
    rate = plus(plus(total[1], r[1], d[0]), r[0], d[1])
    drift = plus(plus(plus(total[2], r[2], d[0]), 2.0 * r[1], d[1]), r[0], d[2])
    return value, rate, drift


@kernel
def point(tree: Tree, y: Array, given: Array, link: int, offset: float, along: int) -> Motion:
    """Return place, velocity and drift of the point of a link at a distance from its hinge."""
    h = heading(tree, y)
    total = base_place(tree, y, h)
    i = link
    while i >= 0:
        total = added(total, distance(tree, y, given, i, offset, along), link_direction(tree, y, i))
        parent = tree.link[i, of.PARENT]
        if parent < 0:
            return added(total, (1.0, 0.0, 0.0), turned_arm(tree, y, arm_of(tree, h, i)))
        total = plus(total[0], tree.real[i, of.ANCHOR + 1], (0.0, 1.0, 0.0)), total[1], total[2]
        offset, along = place_on(tree, i, parent)
        i = parent
    return total


@inner
def push_point(tree: Tree, y: Array, given: Array, link: int, offset: float, along: int, e: Vector, out: Array) -> None:
    """Add the row of e . place of a point: the generalized force of a force e [N] there."""
    h = heading(tree, y)
    push_base(tree, h, e, out)
    i = link
    while i >= 0:
        d = link_direction(tree, y, i)[0]
        push_direction(tree, y, i, d, scaled(distance(tree, y, given, i, offset, along)[0], e), out)
        push_distance(tree, i, along, dot(e, d), out)
        parent = tree.link[i, of.PARENT]
        if parent < 0:
            push_arm(tree, arm_of(tree, h, i), e, out)
            return
        offset, along = place_on(tree, i, parent)
        i = parent


@inner
def place_on(tree: Tree, i: int, parent: int) -> tuple[float, int]:
    """Return where link i hangs on its parent: offset and segments of its distance from the parent's hinge."""
    if tree.link[i, of.PLACE] == of.ROD:
        return tree.real[i, of.ON_ROD], LOWER
    return tree.real[parent, of.LENGTH], BOTH
