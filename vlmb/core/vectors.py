"""Vectors, pairs across a direction and small symmetric matrices, as tuples that the compiler keeps in registers.

A link's axes are its unit direction d and two axes across it. In them a vector is `Parts` (a number along d, a pair across it),
a symmetric matrix is `Blocks`.
"""

from __future__ import annotations

from typing import NamedTuple

from vlmb.core.jit import kernel
from vlmb.core.tree import Array


class Vector(NamedTuple):
    """A vector (3,) in the surface frame."""

    x: float
    y: float
    z: float


class Pair(NamedTuple):
    """A vector across a direction, by its two components."""

    one: float
    two: float


class Sym3(NamedTuple):
    """A symmetric matrix (3, 3)."""

    xx: float
    xy: float
    xz: float
    yy: float
    yz: float
    zz: float


class Sym2(NamedTuple):
    """A symmetric matrix (2, 2) across a direction."""

    one: float
    mix: float
    two: float


class Axes(NamedTuple):
    """Orthonormal axes of a link: its direction and two across it."""

    d: Vector
    one: Vector
    two: Vector


class Parts(NamedTuple):
    """A vector in the axes of a link."""

    along: float
    across: Pair


class Blocks(NamedTuple):
    """A symmetric matrix (3, 3) in the axes of a link: [along, mixed'; mixed, across]."""

    along: float
    mixed: Pair
    across: Sym2


# vectors


@kernel(inline=True)
def vector(array: Array, at: int) -> Vector:
    """Read three numbers of a flat array."""
    return Vector(array[at], array[at + 1], array[at + 2])


@kernel(inline=True)
def row_vector(array: Array, i: int, at: int) -> Vector:
    """Read three numbers of row i."""
    return Vector(array[i, at], array[i, at + 1], array[i, at + 2])


@kernel(inline=True)
def put(array: Array, at: int, v: Vector) -> None:
    """Write three numbers of a flat array."""
    array[at], array[at + 1], array[at + 2] = v.x, v.y, v.z


@kernel(inline=True)
def put_row(array: Array, i: int, at: int, v: Vector) -> None:
    """Write three numbers of row i."""
    array[i, at], array[i, at + 1], array[i, at + 2] = v.x, v.y, v.z


@kernel(inline=True)
def dot(a: Vector, b: Vector) -> float:
    """a . b."""
    return a.x * b.x + a.y * b.y + a.z * b.z


@kernel(inline=True)
def scale(k: float, a: Vector) -> Vector:
    """K a."""
    return Vector(k * a.x, k * a.y, k * a.z)


@kernel(inline=True)
def add(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return Vector(a.x + b.x, a.y + b.y, a.z + b.z)


@kernel(inline=True)
def add_scaled(a: Vector, k: float, b: Vector) -> Vector:
    """a + k b."""
    return Vector(a.x + k * b.x, a.y + k * b.y, a.z + k * b.z)


@kernel(inline=True)
def times(m: Sym3, a: Vector) -> Vector:
    """M a."""
    return Vector(
        m.xx * a.x + m.xy * a.y + m.xz * a.z,
        m.xy * a.x + m.yy * a.y + m.yz * a.z,
        m.xz * a.x + m.yz * a.y + m.zz * a.z,
    )


# pairs


@kernel(inline=True)
def dot2(p: Pair, q: Pair) -> float:
    """p . q."""
    return p.one * q.one + p.two * q.two


@kernel(inline=True)
def scale2(k: float, p: Pair) -> Pair:
    """K p."""
    return Pair(k * p.one, k * p.two)


@kernel(inline=True)
def add2(p: Pair, q: Pair) -> Pair:
    """p + q."""
    return Pair(p.one + q.one, p.two + q.two)


@kernel(inline=True)
def add_scaled2(p: Pair, k: float, q: Pair) -> Pair:
    """p + k q."""
    return Pair(p.one + k * q.one, p.two + k * q.two)


@kernel(inline=True)
def times2(m: Sym2, p: Pair) -> Pair:
    """M p."""
    return Pair(m.one * p.one + m.mix * p.two, m.mix * p.one + m.two * p.two)


@kernel(inline=True)
def add_unit2(k: float, m: Sym2, c: float) -> Sym2:
    """K M + c 1."""
    return Sym2(k * m.one + c, k * m.mix, k * m.two + c)


@kernel(inline=True)
def sum2(m: Sym2, k: float, n: Sym2) -> Sym2:
    """M + k N."""
    return Sym2(m.one + k * n.one, m.mix + k * n.mix, m.two + k * n.two)


@kernel(inline=True)
def less_square2(m: Sym2, k: float, p: Pair) -> Sym2:
    """M - k p p'."""
    one, two = k * p.one, k * p.two
    return Sym2(m.one - one * p.one, m.mix - one * p.two, m.two - two * p.two)


@kernel(inline=True)
def determinant2(m: Sym2) -> float:
    """Det M."""
    return m.one * m.two - m.mix * m.mix


@kernel(inline=True)
def adjugate2(m: Sym2) -> Sym2:
    """M^-1 det M."""
    return Sym2(m.two, -m.mix, m.one)


@kernel(inline=True)
def congruent2(x: Sym2, n: Sym2) -> Sym2:
    """X N X for symmetric X and N."""
    one, two = times2(n, Pair(x.one, x.mix)), times2(n, Pair(x.mix, x.two))
    return Sym2(
        x.one * one.one + x.mix * one.two, x.one * two.one + x.mix * two.two, x.mix * two.one + x.two * two.two
    )


# symmetric matrices as rows


@kernel(inline=True)
def row_sym3(array: Array, i: int, at: int) -> Sym3:
    """Read a symmetric matrix of row i."""
    return Sym3(array[i, at], array[i, at + 1], array[i, at + 2], array[i, at + 3], array[i, at + 4], array[i, at + 5])


@kernel(inline=True)
def row_pair(array: Array, i: int, at: int) -> Pair:
    """Read a pair of row i."""
    return Pair(array[i, at], array[i, at + 1])


@kernel(inline=True)
def put_pair(array: Array, i: int, at: int, p: Pair) -> None:
    """Write a pair of row i."""
    array[i, at], array[i, at + 1] = p.one, p.two


@kernel(inline=True)
def row_sym2(array: Array, i: int, at: int) -> Sym2:
    """Read a symmetric matrix across of row i."""
    return Sym2(array[i, at], array[i, at + 1], array[i, at + 2])


@kernel(inline=True)
def put_sym2(array: Array, i: int, at: int, m: Sym2) -> None:
    """Write a symmetric matrix across of row i."""
    array[i, at], array[i, at + 1], array[i, at + 2] = m.one, m.mix, m.two


@kernel(inline=True)
def gather_sym3(array: Array, i: int, at: int, k: float, m: Sym3) -> None:
    """Add k M to a symmetric matrix of row i."""
    array[i, at] += k * m.xx
    array[i, at + 1] += k * m.xy
    array[i, at + 2] += k * m.xz
    array[i, at + 3] += k * m.yy
    array[i, at + 4] += k * m.yz
    array[i, at + 5] += k * m.zz


@kernel(inline=True)
def gather_vector(array: Array, i: int, at: int, k: float, v: Vector) -> None:
    """Add k v to a vector of row i."""
    array[i, at] += k * v.x
    array[i, at + 1] += k * v.y
    array[i, at + 2] += k * v.z


# axes of a link


@kernel(inline=True)
def axes_of(d: Vector) -> Axes:
    """Complete a unit direction to axes; they are smooth on each half of the sphere."""
    side = 1.0 if d.z >= 0.0 else -1.0
    k = -side / (1.0 + side * d.z)
    x, y, mix = k * d.x, k * d.y, k * d.x * d.y
    return Axes(d, Vector(1.0 + side * x * d.x, side * mix, -side * d.x), Vector(mix, side + y * d.y, -d.y))


@kernel(inline=True)
def across(axes: Axes, v: Vector) -> Pair:
    """Take the components of a vector across the direction."""
    return Pair(dot(axes.one, v), dot(axes.two, v))


@kernel(inline=True)
def into(axes: Axes, v: Vector) -> Parts:
    """Take a vector into the axes of a link."""
    return Parts(dot(axes.d, v), across(axes, v))


@kernel(inline=True)
def out_of(axes: Axes, along: float, p: Pair) -> Vector:
    """Take a vector out of the axes of a link: along d + p.one e1 + p.two e2."""
    return add_scaled(add_scaled(scale(along, axes.d), p.one, axes.one), p.two, axes.two)


@kernel(inline=True)
def into_blocks(axes: Axes, m: Sym3) -> Blocks:
    """Take a symmetric matrix into the axes of a link: E' M E."""
    d, one, two = times(m, axes.d), times(m, axes.one), times(m, axes.two)
    mixed = Pair(dot(axes.one, d), dot(axes.two, d))
    return Blocks(dot(axes.d, d), mixed, Sym2(dot(axes.one, one), dot(axes.one, two), dot(axes.two, two)))


@kernel(inline=True)
def times_blocks(m: Blocks, v: Parts) -> Parts:
    """M v in the axes of a link."""
    return Parts(m.along * v.along + dot2(m.mixed, v.across), add_scaled2(times2(m.across, v.across), v.along, m.mixed))


@kernel(inline=True)
def add_parts(a: Parts, b: Parts) -> Parts:
    """a + b in the axes of a link."""
    return Parts(a.along + b.along, add2(a.across, b.across))


@kernel(inline=True)
def out_of_blocks(axes: Axes, m: Blocks) -> Sym3:
    """Take a symmetric matrix out of the axes of a link: E M E'."""
    e, f, d = axes.one, axes.two, axes.d
    # the columns of E M
    one = out_of(axes, m.mixed.one, Pair(m.across.one, m.across.mix))
    two = out_of(axes, m.mixed.two, Pair(m.across.mix, m.across.two))
    along = out_of(axes, m.along, m.mixed)
    return Sym3(
        one.x * e.x + two.x * f.x + along.x * d.x,
        one.x * e.y + two.x * f.y + along.x * d.y,
        one.x * e.z + two.x * f.z + along.x * d.z,
        one.y * e.y + two.y * f.y + along.y * d.y,
        one.y * e.z + two.y * f.z + along.y * d.z,
        one.z * e.z + two.z * f.z + along.z * d.z,
    )
