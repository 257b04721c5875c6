"""What an equation may name: quantities of a mechanism with value, rate = L v and drift, and their rows L.

The second derivative along a motion is L v' + drift. Angles are read on the branch nearest to a reference, which belongs to the
run and moves with it. At a pole or a line-up an error code tells which quantity has no value.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vlmb.core import angles, places
from vlmb.core import tree as of
from vlmb.core.angles import FINE
from vlmb.core.jit import inner, kernel
from vlmb.core.places import Moving
from vlmb.core.scalars import NAN, sqrt
from vlmb.core.tree import Array, Integers, Tree
from vlmb.core.triples import Vector, dot, plus, scaled

# Kinds of quantities and what the columns after LINK hold for each.
(
    BASE_PLACE,  # COMPONENT 0 1 2 of A's place
    YAW,  # phi0
    SPEED,  # a rate alone: COMPONENT 0 ahead, 1 to the left
    AZIMUTH, ELEVATION,  # phi, psi of LINK
    PLANE_ELEVATION,  # psi of LINK that stays in the upright plane of the heading
    DISTANCE,  # along LINK from its hinge: `offset` + ALONG
    DIRECTION,  # COMPONENT of the direction LINK, NORMAL or HEADING (places.py)
    POINT,  # COMPONENT of the place of the point at that distance
    CENTRE_OF_MASS,  # COMPONENT, of the whole mechanism
    ANGLE,  # between the directions LINK and SECOND, 0 to pi
    PLANE_ANGLE,  # psi of SECOND less psi of LINK in the upright plane of the heading
    CONSTANT,  # `offset`; three in a row are a place that does not move
    BETWEEN,  # the distance of two places, each the row of a POINT or the first of three CONSTANTs: LINK, SECOND
    HALF_SQUARE,  # half the square of that distance
) = range(15)  # fmt: skip
KIND, LINK, COMPONENT, ALONG = range(4)  # columns of `kind`
SECOND = COMPONENT
MEETING = 1e-12  # [m] below which two places have no direction from one to the other
CONSTANT_SHARE, LOWER_SHARE, UPPER_SHARE, MASS_SHARE = range(4)  # columns of `share`


class Quantities(NamedTuple):
    """Which quantities, and the centre of mass as shares of the directions."""

    kind: Integers  # (count, 4)
    offset: Array  # (count,) [m]
    share: Array  # (n + 1, 4) centre of mass: sum over links of (constant + lower a + upper b) d; and of mass; the base's last


def make_quantities(tree: Tree, kinds: Integers, offsets: Array) -> Quantities:
    """Make the table of quantities: kinds (count, 4), offsets (count,)."""
    kind, offset = np.asarray(kinds, np.int64).reshape(-1, 4), np.asarray(offsets, tree.real.dtype)
    return Quantities(np.ascontiguousarray(kind), np.ascontiguousarray(offset), mass_shares(tree))


def mass_shares(tree: Tree) -> Array:
    """Find the centre of mass as place of A + c h + sum of (c_i + lower_i a + upper_i b) d_i; (n + 1, 4), c last."""
    n = int(tree.shape[of.LINKS])
    share = np.zeros((n + 1, 4), tree.real.dtype)
    for i in range(n - 1, -1, -1):
        rod, tip, length = tree.real[i, of.MASS], tree.real[i, of.TIP_MASS], tree.real[i, of.LENGTH]
        share[i] += (rod * tree.real[i, of.CENTRE] + tip * length, rod + tip, tip, rod + tip)
        parent, hanging = int(tree.link[i, of.PARENT]), share[i, MASS_SHARE]
        if parent >= 0 and tree.link[i, of.PLACE] == of.ROD:
            share[parent] += (hanging * tree.real[i, of.ON_ROD], hanging, 0.0 * hanging, hanging)
        elif parent >= 0:
            share[parent] += (hanging * tree.real[parent, of.LENGTH], hanging, hanging, hanging)
    roots = [i for i in range(n) if tree.link[i, of.PARENT] < 0]
    mass = tree.base[of.BASE_MASS]
    share[n] = (mass * tree.base[of.COM_OFFSET], 0.0, 0.0, mass + sum(share[i, MASS_SHARE] for i in roots))
    return share / share[n, MASS_SHARE] if share[n, MASS_SHARE] else share


@inner
def axis(component: int) -> Vector:
    """Return a unit vector of the surface frame."""
    return (1.0 if component == 0 else 0.0), (1.0 if component == 1 else 0.0), (1.0 if component == 2 else 0.0)


@inner
def component_of(parts: tuple[Vector, Vector, Vector], component: int) -> Moving:
    """Return one component of value, rate and drift."""
    return parts[0][component], parts[1][component], parts[2][component]


# The centre of mass


@inner
def link_share(share: Array, tree: Tree, y: Array, given: Array, i: int) -> Moving:
    """Return the factor of d_i in the centre of mass, with rate and drift [m]."""
    a = scaled(share[i, LOWER_SHARE], places.distance(tree, y, given, i, 0.0, places.LOWER))
    ab = plus(a, share[i, UPPER_SHARE], places.distance(tree, y, given, i, 0.0, places.UPPER))
    return ab[0] + share[i, CONSTANT_SHARE], ab[1], ab[2]


@inner
def centre_of_mass(share: Array, tree: Tree, y: Array, given: Array) -> tuple[Vector, Vector, Vector]:
    """Return place, velocity and drift of the whole mechanism's centre of mass."""
    h, n = places.heading(tree, y), tree.shape[of.LINKS]
    ahead = places.turned_arm(tree, y, scaled(share[n, CONSTANT_SHARE], h))
    total = places.added(places.base_place(tree, y, h), (1.0, 0.0, 0.0), ahead)
    for i in range(n):
        total = places.added(total, link_share(share, tree, y, given, i), places.link_direction(tree, y, i))
        if tree.link[i, of.PARENT] < 0:
            total = places.added(total, (share[i, MASS_SHARE], 0.0, 0.0), places.turned_arm(tree, y, places.arm_of(tree, h, i)))
    return total


@inner
def push_centre_of_mass(share: Array, tree: Tree, y: Array, given: Array, e: Vector, out: Array) -> None:
    """Add the row of e . place of the centre of mass."""
    h, n = places.heading(tree, y), tree.shape[of.LINKS]
    places.push_base(tree, h, e, out)
    places.push_arm(tree, scaled(share[n, CONSTANT_SHARE], h), e, out)
    for i in range(n):
        d = places.link_direction(tree, y, i)[0]
        places.push_direction(tree, y, i, d, scaled(link_share(share, tree, y, given, i)[0], e), out)
        places.push_distance(tree, i, places.LOWER, share[i, LOWER_SHARE] * dot(e, d), out)
        places.push_distance(tree, i, places.UPPER, share[i, UPPER_SHARE] * dot(e, d), out)
        if tree.link[i, of.PARENT] < 0:
            places.push_arm(tree, scaled(share[i, MASS_SHARE], places.arm_of(tree, h, i)), e, out)


# Angles in a plane


@inner
def plane_directions(quantities: Quantities, k: int) -> tuple[int, int]:
    """Return the directions that an angle in the upright plane is measured from and to."""
    link = quantities.kind[k, LINK]
    return (places.HEADING, link) if quantities.kind[k, KIND] == PLANE_ELEVATION else (link, quantities.kind[k, SECOND])


# All kinds


@kernel
def measure(quantities: Quantities, k: int, tree: Tree, y: Array, given: Array, reference: Array, out: Array) -> int:
    """Write value, rate and drift of quantity k into out[k] (3,); reference (count, 2). Return a code."""
    return measure_here(quantities, k, tree, y, places.heading(tree, y), given, reference, out)


@kernel(inline=True)
def measure_here(
    quantities: Quantities, k: int, tree: Tree, y: Array, h: Vector, given: Array, reference: Array, out: Array
) -> int:
    """The same as a part of the caller, with the heading: calls with so many arrays take longer than most quantities."""
    kind, link = quantities.kind[k, KIND], quantities.kind[k, LINK]
    other, along, offset = quantities.kind[k, COMPONENT], quantities.kind[k, ALONG], quantities.offset[k]
    code = FINE
    if kind == AZIMUTH:
        code, found = angles.azimuth(tree, y, link, reference[k])
    elif kind == ELEVATION:
        found = angles.elevation(tree, y, link, reference[k])
    elif kind == DIRECTION:
        found = component_of(places.direction(tree, y, link), other)
    elif kind == POINT:
        found = component_of(places.point(tree, y, given, link, offset, along), other)
    elif kind == DISTANCE:
        found = places.distance(tree, y, given, link, offset, along)
    elif kind == ANGLE:
        code, found = angles.angle_between(tree, y, link, other)
    elif kind == CENTRE_OF_MASS:
        found = component_of(centre_of_mass(quantities.share, tree, y, given), other)
    elif kind in (PLANE_ELEVATION, PLANE_ANGLE):
        first, second = plane_directions(quantities, k)
        found = angles.plane_angle(tree, y, first, second, reference[k, 1])
    elif kind >= CONSTANT:
        code, found = distance_quantity(quantities, k, tree, y, given)
    else:
        found = base_quantity(tree, y, h, kind, other)
    out[k, 0], out[k, 1], out[k, 2] = found[0], found[1], found[2]
    return code


@inner
def place_of(quantities: Quantities, k: int, tree: Tree, y: Array, given: Array) -> tuple[Vector, Vector, Vector]:
    """Return place, velocity and drift of an end of a distance."""
    offset = quantities.offset
    if quantities.kind[k, KIND] == CONSTANT:
        still = 0.0 * offset[k], 0.0 * offset[k], 0.0 * offset[k]
        return (offset[k], offset[k + 1], offset[k + 2]), still, still
    return places.point(tree, y, given, quantities.kind[k, LINK], offset[k], quantities.kind[k, ALONG])


@inner
def end_of(quantities: Quantities, k: int, side: int) -> tuple[int, float]:
    """Return the row of an end of a distance, and the sign with which it counts: of the first -1, of the second 1."""
    return (quantities.kind[k, SECOND], 1.0) if side else (quantities.kind[k, LINK], -1.0)


@inner
def way_between(quantities: Quantities, k: int, tree: Tree, y: Array, given: Array) -> tuple[Vector, Vector, Vector]:
    """Return the way from the first end of a distance to the second, its rate and drift; a loop keeps what is compiled short."""
    zero = 0.0 * quantities.offset[k]
    r, w, a = (zero, zero, zero), (zero, zero, zero), (zero, zero, zero)
    for side in range(2):
        end, sign = end_of(quantities, k, side)
        place, velocity, drift = place_of(quantities, end, tree, y, given)
        r, w, a = plus(r, sign, place), plus(w, sign, velocity), plus(a, sign, drift)
    return r, w, a


@inner
def distance_quantity(quantities: Quantities, k: int, tree: Tree, y: Array, given: Array) -> tuple[int, Moving]:
    """Return code, and value, rate and drift of a constant, a distance l = |r| or l^2/2.

    (l^2/2)' = r . r', (l^2/2)'' = r . r'' + r'^2; l' = r . r' / l, l'' = (r . r'' + r'^2 - l'^2) / l.
    """
    kind = quantities.kind[k, KIND]
    if kind == CONSTANT:
        return FINE, (quantities.offset[k], 0.0 * quantities.offset[k], 0.0 * quantities.offset[k])
    r, w, a = way_between(quantities, k, tree, y, given)
    square, growth, bend = dot(r, r), dot(r, w), dot(r, a) + dot(w, w)
    if kind == HALF_SQUARE:
        return FINE, (0.5 * square, growth, bend)
    length = sqrt(square)
    if not length > MEETING:
        return angles.LINED_UP, (length, NAN, NAN)
    return FINE, (length, growth / length, (bend - growth * growth / square) / length)


@inner
def push_ends(quantities: Quantities, k: int, tree: Tree, y: Array, given: Array, scale: float, out: Array) -> int:
    """Add the row of a distance, or of half its square, times a force; return a code."""
    r = way_between(quantities, k, tree, y, given)[0]
    if quantities.kind[k, KIND] == BETWEEN:
        length = sqrt(dot(r, r))
        if not length > MEETING:
            return angles.LINED_UP
        scale /= length
    if tree.shape[of.FLAT] != 0:
        r = r[0], 0.0 * r[1], r[2]
    for side in range(2):
        end, sign = end_of(quantities, k, side)
        push_place(quantities, end, tree, y, given, scaled(sign * scale, r), out)
    return FINE


@inner
def push_place(quantities: Quantities, k: int, tree: Tree, y: Array, given: Array, e: Vector, out: Array) -> None:
    """Add the row of e . place of an end of a distance."""
    kind = quantities.kind
    if kind[k, KIND] == POINT:
        places.push_point(tree, y, given, kind[k, LINK], quantities.offset[k], kind[k, ALONG], e, out)


@inner
def base_quantity(tree: Tree, y: Array, h: Vector, kind: int, component: int) -> Moving:
    """Return value, rate and drift of a base's place, yaw or speed."""
    if kind == BASE_PLACE:
        return component_of(places.base_place(tree, y, h), component)
    if kind == SPEED:
        return 0.0, y[tree.shape[of.POSITIONS] + component], 0.0
    return (y[2] if places.steers(tree) else 0.0), places.yaw_rate(tree, y), 0.0


@kernel
def add_row(
    quantities: Quantities, k: int, tree: Tree, y: Array, given: Array, reference: Array, scale: float, out: Array
) -> int:
    """Add scale * L of quantity k to `out` (nv,): the generalized force of a force `scale` along it. Return a code.

    A force of 0 needs no row: it is never refused.
    """
    return add_row_here(quantities, k, tree, y, places.heading(tree, y), given, reference, scale, out)


@kernel(inline=True)
def add_row_here(
    quantities: Quantities, k: int, tree: Tree, y: Array, h: Vector, given: Array, reference: Array, scale: float, out: Array
) -> int:
    """The same as a part of the caller, with the heading."""
    if scale == 0.0:
        return FINE
    kind, link = quantities.kind[k, KIND], quantities.kind[k, LINK]
    other, along = quantities.kind[k, COMPONENT], quantities.kind[k, ALONG]
    if kind == AZIMUTH:
        return angles.push_azimuth(tree, y, link, scale, out)
    if kind == ANGLE:
        return angles.push_angle(tree, y, link, other, scale, out)
    if kind == ELEVATION:
        angles.push_elevation(tree, y, link, reference[k], scale, out)
    elif kind == DIRECTION:
        places.push_direction(tree, y, link, places.direction(tree, y, link)[0], scaled(scale, axis(other)), out)
    elif kind == POINT:
        places.push_point(tree, y, given, link, quantities.offset[k], along, scaled(scale, axis(other)), out)
    elif kind == DISTANCE:
        places.push_distance(tree, link, along, scale, out)
    elif kind == CENTRE_OF_MASS:
        push_centre_of_mass(quantities.share, tree, y, given, scaled(scale, axis(other)), out)
    elif kind in (PLANE_ELEVATION, PLANE_ANGLE):
        first, second = plane_directions(quantities, k)
        for side in range(2):
            angles.push_plane_elevation(tree, y, second if side else first, scale if side else -scale, out)
    elif kind in (BETWEEN, HALF_SQUARE):
        return push_ends(quantities, k, tree, y, given, scale, out)
    elif kind == CONSTANT:
        return FINE
    elif kind == BASE_PLACE:
        places.push_base(tree, h, scaled(scale, axis(other)), out)
    elif kind == SPEED:
        out[other] += scale
    elif places.steers(tree):
        out[places.yaw_index(tree)] += scale
    return FINE


@kernel
def measure_these(
    quantities: Quantities, these: Integers, tree: Tree, y: Array, given: Array, reference: Array, out: Array
) -> int:
    """Measure some quantities into `out` (count, 3); return 0, or code + 3 k of the first k that has no value."""
    h, missing = places.heading(tree, y), 0
    for k in these:
        code = measure_here(quantities, k, tree, y, h, given, reference, out)
        if code != FINE and missing == 0:
            missing = code + 3 * k
    return missing


@kernel
def follow(quantities: Quantities, tree: Tree, y: Array, reference: Array) -> None:
    """Move the references (count, 2) to the angles read now: after a step that is accepted."""
    for k in range(quantities.kind.shape[0]):
        kind, link = quantities.kind[k, KIND], quantities.kind[k, LINK]
        if kind in (AZIMUTH, ELEVATION):
            d = places.link_direction(tree, y, link)[0]
            reference[k, 0], reference[k, 1] = angles.read_angles(d, reference[k, 0], reference[k, 1])
        elif kind in (PLANE_ELEVATION, PLANE_ANGLE):
            first, second = plane_directions(quantities, k)
            reference[k, 1] = angles.plane_angle(tree, y, first, second, reference[k, 1])[0]


@kernel
def add_accelerations(
    quantities: Quantities, these: Integers, tree: Tree, y: Array, given: Array, reference: Array, change: Array, row: Array,
    out: Array,
) -> int:  # fmt: skip
    """Add L v' to the drifts in `out` (count, 3): then they are second derivatives along the motion with v' = `change` (nv,).

    row (nv,) is overwritten. Return 0, or code + 3 k of the first k that has no row.
    """
    for k in these:
        for j in range(row.shape[0]):
            row[j] = 0.0
        code = add_row(quantities, k, tree, y, given, reference, 1.0, row)
        if code != FINE:
            return code + 3 * k
        for j in range(row.shape[0]):
            out[k, 2] += row[j] * change[j]
    return 0
