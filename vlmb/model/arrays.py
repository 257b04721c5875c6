"""A mechanism as arrays for the compiled core: constants of its links, and its states both ways.

The core's state is y = (p, v): of the base its place and velocity, of each link, parents first, the unit direction d and the
lengths of its free segments in p, and their rates in v. Directions of links that stay in upright planes along a ski are in the
frame of the ski. There is no quaternion and no roll. Pinocchio's (q, v) is made from it with the rotation that takes the heading
to d by the shortest way, and without spin about d: only directions, lengths and forces are promised of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vlmb.core import tree as columns
from vlmb.core.tree import Tree
from vlmb.model.coordinates import directions_of
from vlmb.model.frozen import copied
from vlmb.model.layout import Layout, LinkIndex
from vlmb.model.reading import Postures
from vlmb.scene.scene import Scene
from vlmb.scene.tables import Link, Segment

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Place = tuple[int, int] | None  # of a length and its rate in y; of one that is not free

BASES = {"pivot": columns.PIVOT, "free": columns.FREE, "ski": columns.SKI}
BASE_SIZES = {
    columns.PIVOT: (0, 0), columns.FREE: (3, 3), columns.PLANTED: (3, 3), columns.SKI: (3, 2), columns.SLIDING: (3, 3),
    columns.LIFTED: (4, 4),
}  # in p and in v  # fmt: skip


@dataclass(frozen=True, eq=False)
class Arrays:
    """Constants of a mechanism for the core, and where what stands in its states."""

    scene: Scene
    layout: Layout
    tree: Tree
    given: Array  # (n, 6) lengths [m], rates, accelerations of segments that are not free; the prescribed ones at the start
    order: tuple[int, ...]  # link of the scene by row

    @cached_property
    def rows(self) -> dict[int, int]:
        """Row of each link of the scene."""
        return {link: row for row, link in enumerate(self.order)}

    @property
    def positions(self) -> int:
        """Number of positions."""
        return int(self.tree.shape[columns.POSITIONS])

    @property
    def velocities(self) -> int:
        """Number of velocities."""
        return int(self.tree.shape[columns.VELOCITIES])

    @property
    def upright(self) -> bool:
        """Whether directions are in the frame of a ski: its links stay in upright planes along it."""
        return bool(self.tree.shape[columns.UPRIGHT])

    @cached_property
    def places(self) -> list[tuple[int, int, int, tuple[Place, Place]]]:
        """Link by row, where its direction stands in p, and its rate in v, and where its lengths, lower and upper, in y."""
        found = []
        for i, row in zip(self.order, self.tree.link.tolist(), strict=True):
            at_p, at_v, lower = row[columns.AT_P], row[columns.AT_V], row[columns.LOWER_FREE]
            first, second = (at_p + 3, self.positions + at_v + 3), (at_p + 3 + lower, self.positions + at_v + 3 + lower)
            found.append((i, at_p, at_v, (first if lower else None, second if row[columns.UPPER_FREE] else None)))
        return found

    def length_at(self, link: int, segment: int) -> tuple[int, int]:
        """Where the length of a free segment (1 lower, 2 upper) and its rate stand in y."""
        at = self.places[self.rows[link]][3][segment - 1]
        assert at is not None
        return at

    def pack(self, q: Array, v: Array) -> Array:
        """Return the core's state (positions + velocities,) of Pinocchio's q (nq,), v (nv,)."""
        layout, moving, w = self.layout, directions_of(self.layout, q, v), self.positions
        y = [0.0] * (self.positions + self.velocities)
        kind = int(self.tree.shape[columns.BASE_KIND])
        if layout.base == "ski":
            y[:3] = q[0], q[1], np.arctan2(q[3], q[2])
            y[w : w + BASE_SIZES[kind][1]] = (v[[0, 2]] if kind == columns.SKI else v[: layout.base_size]).tolist()
            if layout.lifts:
                y[3] = q[4]
        elif layout.base == "free":
            for axis, at in zip((0, 2) if layout.plane else (0, 1, 2), range(layout.base_size), strict=True):
                y[axis], y[w + axis] = q[at], v[at]
        for i, at_p, at_v, lengths in self.places:
            d, u = moving[i]
            if self.upright:
                d, u = (in_upright_plane(np.array(part), np.array(y[2])).tolist() for part in (d, u))
            y[at_p : at_p + 3], y[w + at_v : w + at_v + 3] = d, u
            for segment, length in zip((layout.links[i].lower, layout.links[i].upper), lengths, strict=True):
                if length is not None:
                    y[length[0]], y[length[1]] = q[segment.q], v[segment.v]
        return np.array(y)

    def postures(self, y: Array, given: Array) -> Postures:
        """Return where every point is at states y (..., positions + velocities), given lengths (..., n, 6) by row."""
        kind, (p, w) = int(self.tree.shape[columns.BASE_KIND]), (y[..., : self.positions], y[..., self.positions :])
        shape, count = y.shape[:-1], len(self.order)
        place, velocity = np.zeros((*shape, 3)), np.zeros((*shape, 3))
        heading, turning = np.zeros(shape), np.zeros(shape)
        if kind >= columns.SKI:
            heading, turning, forward = p[..., 2], w[..., 1 if kind == columns.SKI else 2], w[..., 0]
            left = np.zeros(shape) if kind == columns.SKI else w[..., 1]
            place[..., :2] = p[..., :2]
            if kind == columns.LIFTED:
                place[..., 2], velocity[..., 2] = p[..., 3], w[..., 3]
            velocity[..., 0] = np.cos(heading) * forward - np.sin(heading) * left
            velocity[..., 1] = np.sin(heading) * forward + np.cos(heading) * left
        elif kind in (columns.FREE, columns.PLANTED):
            place, velocity = np.array(p[..., :3]), np.array(w[..., :3])
        directions, rates = np.zeros((*shape, count, 3)), np.zeros((*shape, count, 3))
        lengths, growth = np.zeros((*shape, count, 2)), np.zeros((*shape, count, 2))
        for row, (i, at_p, at_v, own) in enumerate(self.places):
            d, u = p[..., at_p : at_p + 3], w[..., at_v : at_v + 3]
            unit, across = directions[..., i, :], rates[..., i, :]
            norm = np.sqrt(_product_of(d, d))
            for k in range(3):  # NumPy goes along samples four times as fast as along components
                unit[..., k] = d[..., k] / norm
            along = _product_of(u, unit)
            for k in range(3):
                across[..., k] = u[..., k] - along * unit[..., k]
            if self.upright:
                directions[..., i, :], rates[..., i, :] = _turned_with_ski(unit, across, heading, turning)
            for side, at in enumerate(own):
                if at is not None:
                    lengths[..., i, side], growth[..., i, side] = y[..., at[0]], y[..., at[1]]
                else:
                    lengths[..., i, side], growth[..., i, side] = given[..., row, 3 * side], given[..., row, 3 * side + 1]
        return Postures(
            self.scene, self.layout, place, velocity, heading, turning, directions, rates, lengths, growth
        )


def _product_of(first: Array, second: Array) -> Array:
    """Scalar product (...) of vectors (..., 3): of many a fifth of the time of NumPy's sum."""
    found: Array = first[..., 0] * second[..., 0] + first[..., 1] * second[..., 1] + first[..., 2] * second[..., 2]
    return found


def in_upright_plane(vectors: Array, heading: Array) -> Array:
    """Vectors (..., 3) in the frame of a ski, without what they have sideways; rates of directions lose the ski's turn so."""
    ahead = np.cos(heading) * vectors[..., 0] + np.sin(heading) * vectors[..., 1]
    return np.stack([ahead, np.zeros_like(ahead), vectors[..., 2]], axis=-1)


def _turned_with_ski(d: Array, u: Array, heading: Array, turning: Array) -> tuple[Array, Array]:
    """Directions d (..., 3) in the frame of a ski, and their rates u there, in the surface frame."""
    cosine, sine, ahead = np.cos(heading), np.sin(heading), np.zeros(d.shape)
    ahead[..., 0], ahead[..., 1] = cosine, sine
    left = np.stack([-sine, cosine, np.zeros_like(sine)], axis=-1)
    up, rates = np.array([0.0, 0.0, 1.0]), u[..., :1] * ahead + (turning * d[..., 0])[..., None] * left
    return d[..., :1] * ahead + d[..., 2:] * up, rates + u[..., 2:] * up


def pinocchio_states(seen: Postures) -> tuple[Array, Array]:
    """Return Pinocchio's q (..., nq), v (..., nv) of postures: links without roll from the heading, and without spin.

    q is continuous wherever no link points against the heading; in a plane angles are those nearest to zero.
    """
    layout, shape = seen.layout, seen.heading.shape
    q, v = np.zeros((*shape, layout.nq)), np.zeros((*shape, layout.nv))
    cosine, sine = np.cos(seen.heading), np.sin(seen.heading)
    if layout.base == "ski":
        q[..., :2], q[..., 2], q[..., 3] = seen.place[..., :2], cosine, sine
        x, y = seen.velocity_of_place[..., 0], seen.velocity_of_place[..., 1]
        v[..., 0], v[..., 1], v[..., 2] = cosine * x + sine * y, cosine * y - sine * x, seen.turning
        if layout.lifts:
            q[..., 4], v[..., 3] = seen.place[..., 2], seen.velocity_of_place[..., 2]
    elif layout.base == "free":
        axes = [0, 2] if layout.plane else [0, 1, 2]
        q[..., : layout.base_size], v[..., : layout.base_size] = seen.place[..., axes], seen.velocity_of_place[..., axes]
    half = 0.5 * seen.heading
    yaw = np.stack([np.zeros(shape), np.zeros(shape), np.sin(half), np.cos(half)], axis=-1)
    turn = np.stack([np.zeros(shape), np.zeros(shape), seen.turning], axis=-1)
    for i in layout.order:
        index, parent = layout.links[i], layout.links[i].parent
        for side, segment in enumerate((index.lower, index.upper)):
            if segment.joint:
                q[..., segment.q], v[..., segment.v] = seen.lengths[..., i, side], seen.length_rates[..., i, side]
        if layout.plane:
            angle, rate = _in_plane(seen, i)
            before = _in_plane(seen, parent) if parent >= 0 else (0.0, 0.0)
            q[..., index.q], v[..., index.v] = angle - before[0], rate - before[1]
            continue
        own = _from_heading(yaw, seen.directions[..., i, :])
        others = _from_heading(yaw, seen.directions[..., parent, :]) if parent >= 0 else yaw
        omega = np.cross(seen.directions[..., i, :], seen.direction_rates[..., i, :])
        carried = np.cross(seen.directions[..., parent, :], seen.direction_rates[..., parent, :]) if parent >= 0 else turn
        q[..., index.q : index.q + 4] = _product(_conjugate(others), own)
        v[..., index.v : index.v + 3] = _turned(_conjugate(own), omega - carried)
    return q, v


def _in_plane(seen: Postures, i: int) -> tuple[Array, Array]:
    """Elevation and its rate in the vertical plane through the heading."""
    d, u = seen.directions[..., i, :], seen.direction_rates[..., i, :]
    cosine, sine = np.cos(seen.heading), np.sin(seen.heading)
    along, growth = cosine * d[..., 0] + sine * d[..., 1], cosine * u[..., 0] + sine * u[..., 1]
    return np.arctan2(d[..., 2], along), along * u[..., 2] - d[..., 2] * growth


def _from_heading(yaw: Array, direction: Array) -> Array:
    """Quaternion (..., 4) that takes x by the yaw to the heading, and from there by the shortest way to a direction."""
    x, y, z = np.moveaxis(_turned(_conjugate(yaw), direction), -1, 0)
    zero = np.zeros_like(x)
    ahead = np.stack([zero, -z, y, 1.0 + x], axis=-1)
    behind = np.stack([y, 1.0 - x, zero, -z], axis=-1)  # by half a turn about y, then the shortest way from -x
    arc = np.where((x >= -0.5)[..., None], ahead, behind)
    return _product(yaw, arc / np.linalg.norm(arc, axis=-1, keepdims=True))


def _conjugate(quaternion: Array) -> Array:
    return quaternion * np.array([-1.0, -1.0, -1.0, 1.0])


def _product(first: Array, second: Array) -> Array:
    """Product (..., 4) of quaternions x, y, z, w."""
    a, b, s, t = first[..., :3], second[..., :3], first[..., 3:], second[..., 3:]
    vector = s * b + t * a + np.cross(a, b)
    return np.concatenate([vector, s * t - (a * b).sum(axis=-1, keepdims=True)], axis=-1)


def _turned(quaternion: Array, vector: Array) -> Array:
    """Vectors (..., 3) turned by unit quaternions: v + 2 q x (q x v + w v)."""
    q, w = quaternion[..., :3], quaternion[..., 3:]
    return vector + 2.0 * np.cross(q, np.cross(q, vector) + w * vector)


def make_arrays(
    scene: Scene, layout: Layout, sliding: bool = False, driven: bool = False, planted: bool = False
) -> Arrays:  # fmt: skip
    """Make the core's constants of a scene.

    sliding : the ski keeps its sideways velocity (its knife edge is a row); driven : prescribed lengths are velocities like
    free ones, as for Pinocchio; planted : a contact holds the free base where it is.
    """
    kind = columns.LIFTED if layout.lifts else columns.SLIDING if sliding and layout.base == "ski" else BASES[layout.base]
    kind = columns.PLANTED if planted else kind
    p, v = BASE_SIZES[kind]
    count = len(layout.links)
    link, real, given = np.zeros((count, 8), np.int64), np.zeros((count, 16)), np.zeros((count, 6))
    rows = {i: row for row, i in enumerate(layout.order)}
    for row, i in enumerate(layout.order):
        index, table = layout.links[i], scene.links[i]
        parent = rows[index.parent] if index.parent >= 0 else -1
        on_rod = parent >= 0 and index.point != "tip"
        segments = index.lower, index.upper
        free = [segment.joint > 0 and (driven or segment.motion == "free") for segment in segments]
        link[row] = parent, columns.ROD if on_rod else columns.TIP, p, v, *free, 0, table.tip_mass > 0.0
        if parent >= 0:
            link[parent, columns.ROD_CHILDREN if on_rod else columns.TIP_LOAD] = 1
        real[row] = _constants(table, index, free)
        given[row, [0, 3]] = [0.0 if is_free else at.length for is_free, at in zip(free, segments, strict=True)]
        p, v = p + 3 + sum(free), v + 3 + sum(free)
    base = np.array([scene.base.mass, scene.base.inertia, scene.base.com_offset, *scene.surface_gravity])
    upright = layout.base == "ski" and layout.plane
    tree = Tree(np.array([kind, p, v, count, upright, layout.plane and not upright], np.int64), base, link, real)
    return Arrays(scene, layout, tree, given, layout.order)


def renumbered_arrays(arrays: Arrays, scene: Scene) -> Arrays:
    """Return the constants with the springs of segments as another scene has them; all else is the same."""
    real = np.array(arrays.tree.real)
    for row, (i, *_) in enumerate(arrays.places):  # they are found once, for all of these
        table = scene.links[i]
        if table is arrays.scene.links[i]:
            continue
        for column, segment, first in (
            (columns.LOWER_FREE, table.lower, columns.K1), (columns.UPPER_FREE, table.upper, columns.K2)
        ):  # fmt: skip
            if arrays.tree.link[row, column] and segment.motion == "free":
                real[row, first : first + 3] = _spring(segment)
    return copied(arrays, scene=scene, tree=arrays.tree._replace(real=real))


def _constants(link: Link, index: LinkIndex, free: list[bool]) -> Array:
    """Return a row of the tree's real columns."""
    found = np.zeros(16)
    rod = link.rod
    found[: columns.K1] = rod.length, rod.mass, rod.centre, rod.transverse_inertia, link.tip_mass
    for is_free, segment, first in ((free[0], link.lower, columns.K1), (free[1], link.upper, columns.K2)):
        if is_free:
            found[first : first + 3] = _spring(segment)
    found[columns.ON_ROD] = index.on_rod
    found[columns.ANCHOR : columns.ANCHOR + 3] = index.anchor
    return found


def _spring(segment: Segment) -> tuple[float, float, float]:
    return segment.stiffness, segment.rest_length, segment.damping
