"""From the base to the tips: every link finds its accelerations from that of its hinge."""

from __future__ import annotations

from vlmb.core import base
from vlmb.core import scratch as c
from vlmb.core.inwards import no_bias
from vlmb.core.jit import kernel
from vlmb.core.plain import Bias, Body, Factors, Move, move
from vlmb.core.rods import move_rod
from vlmb.core.segments import is_free
from vlmb.core.tree import (
    AT_P,
    AT_V,
    LINKS,
    LOWER_FREE,
    PARENT,
    PLACE,
    POSITIONS,
    ROD,
    ROD_CHILDREN,
    UPPER_FREE,
    UPRIGHT,
    Array,
    Tree,
)
from vlmb.core.vectors import (
    Axes,
    Parts,
    Vector,
    add2,
    add_scaled,
    add_scaled2,
    axes_of,
    dot2,
    into,
    out_of,
    put,
    put_row,
    row_pair,
    row_vector,
    scale2,
)


@kernel(inline=True)
def hinge_of(tree: Tree, rows: Array, loads: Array, i: int) -> Vector:
    """Find the acceleration of a link's hinge, less gravity's."""
    parent = tree.link[i, PARENT]
    if parent < 0:
        return base.hinge_of_root(tree, rows, loads, i)
    if tree.link[i, PLACE] == ROD:
        return add_scaled(row_vector(loads, parent, c.ROD_MOVE), rows[i, c.ON_PARENT], row_vector(loads, parent, c.TURN_MOVE))
    return row_vector(loads, parent, c.TIP_MOVE)


@kernel(inline=True)
def move_link(
    tree: Tree, rows: Array, loads: Array, i: int, axes: Axes, hinge: Parts, body: Body, factors: Factors, bias: Bias,
    square: float,
) -> Move:  # fmt: skip
    """Find how link i moves with its hinge, and keep it for its children; square = |u|^2."""
    lower_free, upper_free = is_free(tree, i)
    applied, tip = c.kept_load(loads, i)
    if tree.link[i, ROD_CHILDREN] == 0:
        moved = move(lower_free, upper_free, body, factors, applied, bias, tip, hinge)
    else:
        rod, rod_load = c.kept_rod(rows, i), c.kept_rod_load(loads, i)
        moved = move_rod(lower_free, upper_free, body, factors, rod, bias, tip, rod_load, hinge)
        put_row(loads, i, c.ROD_MOVE, out_of(axes, moved.along, add2(hinge.across, bias.across)))
        put_row(loads, i, c.TURN_MOVE, out_of(axes, -square, moved.turn))
    put_row(loads, i, c.TIP_MOVE, out_of(axes, moved.tip_along, moved.tip_across))
    return moved


@kernel(inline=True)
def write_lengths(tree: Tree, i: int, body: Body, hinge: Parts, moved: Move, square: float, out: Array, at: int) -> None:
    """Write the second derivatives of free lengths: differences of accelerations along, and what the turn adds."""
    rod_children = tree.link[i, ROD_CHILDREN] != 0
    here = 0.0 * body.centre if rod_children else body.centre
    beyond = body.reach if rod_children else body.beyond
    if tree.link[i, LOWER_FREE] != 0:
        out[at] = moved.along - hinge.along + here * square
        at += 1
    if tree.link[i, UPPER_FREE] != 0:
        out[at] = moved.tip_along - moved.along + beyond * square


@kernel(inline=True)
def write_axial(tree: Tree, rows: Array, i: int, body: Body, factors: Factors, bias: Bias, hinge: Parts, moved: Move) -> None:
    """Write the forces that given segments take: what tip and rod together, or the tip alone, ask for along the link."""
    lower_free, upper_free = is_free(tree, i)
    if lower_free and upper_free:
        return  # they stay 0
    at_tip = factors.weight * moved.tip_along + dot2(factors.mixed, moved.tip_across) + rows[i, c.TIP_ALONG]
    rows[i, c.AXIAL + 1] = 0.0 * at_tip if upper_free else at_tip
    if lower_free:
        rows[i, c.AXIAL] = 0.0 * at_tip
    elif tree.link[i, ROD_CHILDREN] == 0:
        rows[i, c.AXIAL] = body.mass * moved.along + (rows[i, c.PUSH] if upper_free else at_tip)
    else:
        rod, origin = c.kept_rod(rows, i), add2(hinge.across, bias.across)
        rows[i, c.AXIAL] = rod.axial * moved.along + dot2(rod.mixed, origin) + rows[i, c.SLIDE]


@kernel(inline=True)
def spread(tree: Tree, y: Array, dy: Array, rows: Array, i: int) -> None:
    """Find the accelerations of link i from that of its hinge, and write its rates."""
    axes = axes_of(c.kept_direction(rows, i))
    hinge, bias, turn = into(axes, hinge_of(tree, rows, rows, i)), c.kept_bias(rows, i), row_pair(rows, i, c.RATE)
    body, factors = c.kept_factors(tree, rows, i)
    square, whirl = dot2(turn, turn), 0.0 * turn.one
    if tree.shape[UPRIGHT] != 0:
        whirl = rows[tree.shape[LINKS], c.SPIN] * axes.d.x
        square += whirl * axes.d.x
    moved = move_link(tree, rows, rows, i, axes, hinge, body, factors, bias, square)
    write_axial(tree, rows, i, body, factors, bias, hinge, moved)
    p, v = tree.link[i, AT_P], tree.shape[POSITIONS] + tree.link[i, AT_V]
    put(dy, p, out_of(axes, 0.0 * square, scale2(rows[i, c.NORM], turn)))
    put(dy, v, out_of(axes, -square, add_scaled2(moved.turn, rows[i, c.SLIP], turn)))
    if tree.shape[UPRIGHT] != 0:
        dy[v] += whirl  # u' in the frame of the ski, which draws outwards
    for free in range(3, 3 + tree.link[i, LOWER_FREE] + tree.link[i, UPPER_FREE]):
        dy[p + free] = y[v + free]
    write_lengths(tree, i, body, hinge, moved, square, dy, v + 3)


@kernel(inline=True)
def spread_force(tree: Tree, out: Array, rows: Array, loads: Array, i: int) -> None:
    """Find what forces add to the accelerations of link i from what they add to its hinge's."""
    axes = axes_of(c.kept_direction(rows, i))
    hinge = into(axes, hinge_of(tree, rows, loads, i))
    body, factors = c.kept_factors(tree, rows, i)
    zero = 0.0 * body.centre
    moved = move_link(tree, rows, loads, i, axes, hinge, body, factors, no_bias(zero), zero)
    at = tree.link[i, AT_V]
    put(out, at, out_of(axes, zero, moved.turn))
    write_lengths(tree, i, body, hinge, moved, zero, out, at + 3)
