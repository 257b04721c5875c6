"""What the state says: of a link its direction and rate, lengths of its segments, forces along free ones; how a ski turns."""

from __future__ import annotations

from typing import NamedTuple

from vlmb.core.jit import kernel, sqrt
from vlmb.core.tree import (
    AT_P,
    AT_V,
    BASE_KIND,
    C1,
    C2,
    K1,
    K2,
    LENGTH,
    LOWER,
    LOWER_FREE,
    ON_ROD,
    PARENT,
    PLACE,
    POSITIONS,
    REST1,
    REST2,
    ROD,
    SKI,
    UPPER,
    UPPER_FREE,
    Array,
    Tree,
)
from vlmb.core.vectors import Vector, dot, scale, vector


class Heading(NamedTuple):
    """The direction of a link: a unit vector, the length and the rate that the state gave."""

    d: Vector
    norm: float  # |d|
    rate: Vector  # u [1/s], with its part along d


class Segments(NamedTuple):
    """Lengths of a link's segments with rates and given second derivatives (0 where free), and forces along free ones."""

    lower: float
    lower_rate: float
    lower_second: float
    upper: float
    upper_rate: float
    upper_second: float
    pull: float
    push: float


@kernel(inline=True)
def is_free(tree: Tree, i: int) -> tuple[bool, bool]:
    """Say whether the lower and the upper segment are free."""
    return tree.link[i, LOWER_FREE] != 0, tree.link[i, UPPER_FREE] != 0


@kernel(inline=True)
def norm_of(tree: Tree, y: Array, i: int) -> float:
    """Read |d| of link i."""
    raw = vector(y, tree.link[i, AT_P])
    return sqrt(dot(raw, raw))


@kernel(inline=True)
def heading_of(tree: Tree, y: Array, i: int) -> Heading:
    """Read the direction of link i."""
    raw, rate = vector(y, tree.link[i, AT_P]), vector(y, tree.shape[POSITIONS] + tree.link[i, AT_V])
    norm = norm_of(tree, y, i)
    return Heading(scale(1.0 / norm, raw), norm, rate)


@kernel(inline=True)
def segments_of(tree: Tree, y: Array, given: Array, force: Array, i: int) -> Segments:
    """Read the segments; forces along free ones are those of springs and dampers, k (rest - a) - c a', and what else acts."""
    link, real = tree.link, tree.real
    p, v = link[i, AT_P] + 3, link[i, AT_V] + 3
    rates, zero = tree.shape[POSITIONS] + v, 0.0 * real[i, LENGTH]
    lower, lower_rate, lower_second, pull = given[i, LOWER], given[i, LOWER + 1], given[i, LOWER + 2], zero
    upper, upper_rate, upper_second, push = given[i, UPPER], given[i, UPPER + 1], given[i, UPPER + 2], zero
    if link[i, LOWER_FREE] != 0:
        lower, lower_rate, lower_second = y[p], y[rates], zero
        pull = real[i, K1] * (real[i, REST1] - lower) - real[i, C1] * lower_rate + force[v]
        p, v, rates = p + 1, v + 1, rates + 1
    if link[i, UPPER_FREE] != 0:
        upper, upper_rate, upper_second = y[p], y[rates], zero
        push = real[i, K2] * (real[i, REST2] - upper) - real[i, C2] * upper_rate + force[v]
    return Segments(lower, lower_rate, lower_second, upper, upper_rate, upper_second, pull, push)


@kernel(inline=True)
def length_below(tree: Tree, y: Array, given: Array, i: int) -> float:
    """Read the length of the lower segment [m]."""
    return y[tree.link[i, AT_P] + 3] if tree.link[i, LOWER_FREE] != 0 else given[i, LOWER]


@kernel(inline=True)
def lower_rate(tree: Tree, y: Array, given: Array, i: int) -> float:
    """Read the rate of the lower segment [m/s]."""
    return y[tree.shape[POSITIONS] + tree.link[i, AT_V] + 3] if tree.link[i, LOWER_FREE] != 0 else given[i, LOWER + 1]


@kernel(inline=True)
def upper_motion(tree: Tree, y: Array, given: Array, i: int) -> tuple[float, float]:
    """Read the length and the rate of the upper segment [m], [m/s]."""
    after = 3 + tree.link[i, LOWER_FREE]
    if tree.link[i, UPPER_FREE] != 0:
        return y[tree.link[i, AT_P] + after], y[tree.shape[POSITIONS] + tree.link[i, AT_V] + after]
    return given[i, UPPER], given[i, UPPER + 1]


@kernel(inline=True)
def yaw_of(tree: Tree, y: Array) -> float:
    """Read phi0' of a ski [rad/s]."""
    return y[tree.shape[POSITIONS] + (1 if tree.shape[BASE_KIND] == SKI else 2)]


@kernel(inline=True)
def place_on_parent(tree: Tree, y: Array, given: Array, i: int) -> float:
    """Find how far from its parent's hinge link i hangs on the parent's rod [m]; 0 for other places."""
    if tree.link[i, PLACE] == ROD:
        return length_below(tree, y, given, tree.link[i, PARENT]) + tree.real[i, ON_ROD]
    return 0.0 * tree.real[i, ON_ROD]
