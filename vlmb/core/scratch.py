"""The row of numbers that a link leaves behind: what hangs on it, its factors and loads for the way back, how it moves."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vlmb.core.jit import kernel
from vlmb.core.lanes import LANES, by_fours
from vlmb.core.plain import Applied, Bias, Body, Factors, TipLoad, body_of
from vlmb.core.rods import RodFactors, RodLoad
from vlmb.core.tree import BASE_KIND, INERTIA, LINKS, MASS, PIVOT, ROD_CHILDREN, TIP_MASS, Array, Tree
from vlmb.core.vectors import Vector, put_pair, put_sym2, row_pair, row_sym2, row_vector

# What hangs on the link: A (xx xy xz yy yz zz) and f of the force A a + f asked for at the tip; on the rod the same times powers
# of the distance r from the hinge: sums of A, r A, r^2 A, f, r f. In the axes of the surface.
TIP_INERTIA, TIP_FORCE = 0, 6
ROD_SUMS, ROD_FORCE, ROD_MOMENT = 9, 27, 30  # the sums of A, r A, r^2 A follow one another
# Factors: of the posture alone. The last four are of a rod with children.
DIRECTION, ROD_CENTRE, BEYOND, ON_PARENT = 33, 36, 37, 38
SEEN, YIELDING, WEIGHT, MIXED, INVERSE = 39, 42, 45, 46, 48
TURN_ALONG, TURN_ACROSS, ROD_AXIAL, ROD_MIXED = 49, 51, 54, 55
# Loads: what acts. The last two are of a rod with children.
TURN, PULL, PUSH, TIP_ACROSS, TIP_AXIAL, TIP_ALONG, ROD_TURN, SLIDE = 57, 59, 60, 61, 63, 64, 65, 67
# Motion: |d|, u . d, u across and those of `Bias`.
NORM, SLIP, RATE, ALONG, ACROSS, STRETCH, FAN = 68, 69, 70, 72, 73, 75, 76
# Accelerations less gravity's, of the tip and of the rod's point at the hinge, and w - |u|^2 d; in the axes of the surface.
TIP_MOVE, ROD_MOVE, TURN_MOVE = 78, 81, 84
AXIAL = 87  # forces [N] that given segments take, lower and upper
# Of links in upright planes along a ski: how far ahead hinge and tip are, with rates, and how far to the left the plane is.
HINGE_AHEAD, TIP_AHEAD, ASIDE = 89, 91, 93
WIDTH = 96  # a multiple of a line of the processor's cache

# The base has the last row. What hangs on it (see base.py): S0, f0, S1, S2, f1; cos and sin of phi0, phi'^2; the acceleration of
# its point, less gravity's, and phi''; the ski's direction ahead; the force on a planted base.
# Vectors are in the frame of the directions.
SUM, FORCE, TURN_SUM, TURN_SQUARE, TURN_FORCE, COSINE, SINE, SPIN, POINT, YAW = 0, 6, 9, 12, 13, 14, 15, 16, 17, 20
AHEAD, GROUND = 21, 23

# Parts of a row, LANES wide, that gather what hangs on a tip, then on a rod; all that the base keeps
OF_TIP, OF_ROD, OF_BASE = 3, 9, 7


class Scratch(NamedTuple):
    """Buffers of one thread; `accelerate` fills them, `respond` reads the factors."""

    rows: Array  # (n + 1, WIDTH), in one array, because every one costs an evaluation nanoseconds to hand over


class Lanes(NamedTuple):
    """Generalized forces, LANES at a time, in whose place `respond` writes what they add to the accelerations; and its loads."""

    moved: Array  # (velocities, LANES)
    loads: Array  # (n + 1, WIDTH, LANES)


def make_lanes(links: int, velocities: int, dtype: Any = np.float64) -> Lanes:
    """Make the buffers of `respond` for one thread."""
    return Lanes(np.zeros((velocities, LANES), dtype), np.zeros((links + 1, WIDTH, LANES), dtype))


def make_scratch(tree: Tree, dtype: Any = np.float64) -> Scratch:
    """Make the buffers for a tree."""
    return Scratch(np.zeros((len(tree.link) + 1, WIDTH), dtype))


def axial_forces(scratch: Scratch) -> Array:
    """View the forces (n, 2) [N] that given segments took at the last `accelerate`, along their growth; 0 for free ones."""
    return scratch.rows[:-1, AXIAL : AXIAL + 2]


@kernel(inline=True)
def clear(tree: Tree, rows: Array) -> None:
    """Begin with the tip masses, which ask for mu a."""
    parts = by_fours(rows)
    for i in range(tree.shape[LINKS]):
        mass = tree.real[i, TIP_MASS]
        for part in range(OF_TIP):
            parts[i, part] = 0.0 * mass
        for part in range(OF_TIP, OF_ROD if tree.link[i, ROD_CHILDREN] != 0 else OF_TIP):
            parts[i, part] = 0.0 * mass
        rows[i, TIP_INERTIA], rows[i, TIP_INERTIA + 3], rows[i, TIP_INERTIA + 5] = mass, mass, mass
    for part in range(OF_BASE if tree.shape[BASE_KIND] != PIVOT else 0):
        parts[tree.shape[LINKS], part] = 0.0 * tree.base[0]


@kernel(inline=True)
def clear_forces(tree: Tree, loads: Array) -> None:
    """Begin without forces and without whirl."""
    n, zero = tree.shape[LINKS], 0.0 * tree.base[0]
    for i in range(n):
        for j in range(TIP_FORCE, TIP_FORCE + 3):
            loads[i, j] = zero
        for j in range(ROD_FORCE, ROD_MOMENT + 3 if tree.link[i, ROD_CHILDREN] != 0 else ROD_FORCE):
            loads[i, j] = zero
    if tree.shape[BASE_KIND] != PIVOT:
        for j in range(FORCE, FORCE + 3):
            loads[n, j] = zero
        for j in (TURN_FORCE, SPIN, YAW):
            loads[n, j] = zero


@kernel(inline=True)
def keep_factors(rows: Array, i: int, d: Vector, on_parent: float, body: Body, found: Factors) -> None:
    """Write the posture and the factors of a link; `on_parent` [m] is how far along its parent's rod it hangs."""
    rows[i, DIRECTION], rows[i, DIRECTION + 1], rows[i, DIRECTION + 2] = d.x, d.y, d.z
    rows[i, ROD_CENTRE], rows[i, BEYOND], rows[i, ON_PARENT] = body.centre, body.beyond, on_parent
    put_sym2(rows, i, SEEN, found.seen)
    put_sym2(rows, i, YIELDING, found.yielding)
    put_pair(rows, i, MIXED, found.mixed)
    rows[i, WEIGHT], rows[i, INVERSE] = found.weight, found.inverse


@kernel(inline=True)
def kept_direction(rows: Array, i: int) -> Vector:
    """Read the unit direction of a link."""
    return row_vector(rows, i, DIRECTION)


@kernel(inline=True)
def kept_factors(tree: Tree, rows: Array, i: int) -> tuple[Body, Factors]:
    """Read the rod as it was and the factors of a link."""
    body = body_of(tree.real[i, MASS], tree.real[i, INERTIA], rows[i, ROD_CENTRE], rows[i, BEYOND])
    seen, yielding = row_sym2(rows, i, SEEN), row_sym2(rows, i, YIELDING)
    return body, Factors(seen, yielding, rows[i, WEIGHT], row_pair(rows, i, MIXED), rows[i, INVERSE])


@kernel(inline=True)
def keep_rod(rows: Array, i: int, rod: RodFactors) -> None:
    """Write the factors of a rod with children."""
    put_pair(rows, i, TURN_ALONG, rod.turn_along)
    put_sym2(rows, i, TURN_ACROSS, rod.turn_across)
    rows[i, ROD_AXIAL] = rod.axial
    put_pair(rows, i, ROD_MIXED, rod.mixed)


@kernel(inline=True)
def kept_rod(rows: Array, i: int) -> RodFactors:
    """Read the factors of a rod with children."""
    turn_along, turn_across = row_pair(rows, i, TURN_ALONG), row_sym2(rows, i, TURN_ACROSS)
    return RodFactors(turn_along, turn_across, rows[i, ROD_AXIAL], row_pair(rows, i, ROD_MIXED))


@kernel(inline=True)
def keep_load(loads: Array, i: int, applied: Applied, tip: TipLoad) -> None:
    """Write what acts on a link."""
    put_pair(loads, i, TURN, applied.turn)
    loads[i, PULL], loads[i, PUSH] = applied.pull, applied.push
    put_pair(loads, i, TIP_ACROSS, tip.across)
    loads[i, TIP_AXIAL], loads[i, TIP_ALONG] = tip.axial, tip.along


@kernel(inline=True)
def keep_no_load(rows: Array, loads: Array, i: int) -> None:
    """Write that nothing acts on a link."""
    for j in range(TURN, SLIDE + 1):
        loads[i, j] = 0.0 * rows[i, DIRECTION]


@kernel(inline=True)
def kept_load(loads: Array, i: int) -> tuple[Applied, TipLoad]:
    """Read what acts on a link."""
    applied = Applied(row_pair(loads, i, TURN), loads[i, PULL], loads[i, PUSH])
    return applied, TipLoad(row_pair(loads, i, TIP_ACROSS), loads[i, TIP_AXIAL], loads[i, TIP_ALONG])


@kernel(inline=True)
def keep_rod_load(loads: Array, i: int, load: RodLoad) -> None:
    """Write what acts on a rod with children."""
    put_pair(loads, i, ROD_TURN, load.turn)
    loads[i, SLIDE] = load.slide


@kernel(inline=True)
def kept_rod_load(loads: Array, i: int) -> RodLoad:
    """Read what acts on a rod with children."""
    return RodLoad(row_pair(loads, i, ROD_TURN), loads[i, SLIDE])


@kernel(inline=True)
def keep_bias(rows: Array, i: int, bias: Bias) -> None:
    """Write the bias of a link."""
    rows[i, ALONG], rows[i, STRETCH] = bias.along, bias.stretch
    put_pair(rows, i, ACROSS, bias.across)
    put_pair(rows, i, FAN, bias.fan)


@kernel(inline=True)
def kept_bias(rows: Array, i: int) -> Bias:
    """Read the bias of a link."""
    return Bias(rows[i, ALONG], row_pair(rows, i, ACROSS), rows[i, STRETCH], row_pair(rows, i, FAN))
