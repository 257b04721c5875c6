"""From the tips to the base: every link takes what hangs on it, adds itself in its own axes and hands on what its hinge feels."""

from __future__ import annotations

from vlmb.core import base
from vlmb.core import scratch as c
from vlmb.core.jit import kernel
from vlmb.core.lanes import is_zero
from vlmb.core.plain import Applied, Bias, Body, body_of, factor, load
from vlmb.core.rods import Moments, factor_rod, load_rod, whirl
from vlmb.core.segments import Heading, Segments, heading_of, is_free, norm_of, place_on_parent, segments_of
from vlmb.core.tree import (
    AT_V,
    CENTRE,
    INERTIA,
    LENGTH,
    LINKS,
    LOWER_FREE,
    MASS,
    NO_DIRECTION,
    PARENT,
    PLACE,
    ROD,
    ROD_CHILDREN,
    UPPER_FREE,
    UPRIGHT,
    Array,
    Tree,
)
from vlmb.core.vectors import (
    Axes,
    Pair,
    Parts,
    Sym3,
    Vector,
    across,
    add_parts,
    add_scaled2,
    axes_of,
    dot,
    dot2,
    gather_sym3,
    gather_vector,
    into,
    into_blocks,
    out_of,
    out_of_blocks,
    put_pair,
    row_sym3,
    row_vector,
    scale2,
    times_blocks,
    vector,
)

INFINITY = float("inf")


@kernel(inline=True)
def hang_inertia(tree: Tree, rows: Array, i: int, place: float, inertia: Sym3) -> None:
    """Hand a link's inertia to its parent's tip or rod (`place` [m] from the parent's hinge), or to the base."""
    parent = tree.link[i, PARENT]
    if parent < 0:
        base.hang_inertia(tree, rows, i, inertia)
    elif tree.link[i, PLACE] == ROD:
        gather_sym3(rows, parent, c.ROD_SUMS, 1.0, inertia)
        gather_sym3(rows, parent, c.ROD_SUMS + 6, place, inertia)
        gather_sym3(rows, parent, c.ROD_SUMS + 12, place * place, inertia)
    else:
        gather_sym3(rows, parent, c.TIP_INERTIA, 1.0, inertia)


@kernel(inline=True)
def hang_force(tree: Tree, rows: Array, loads: Array, i: int, place: float, force: Vector) -> None:
    """Hand on the force of a link on a hinge at rest."""
    parent = tree.link[i, PARENT]
    if parent < 0:
        base.hang_force(tree, rows, loads, i, force)
    elif tree.link[i, PLACE] == ROD:
        gather_vector(loads, parent, c.ROD_FORCE, 1.0, force)
        gather_vector(loads, parent, c.ROD_MOMENT, place, force)
    else:
        gather_vector(loads, parent, c.TIP_FORCE, 1.0, force)


@kernel(inline=True)
def sums_of(rows: Array, axes: Axes, i: int) -> Moments:
    """Take the inertias of children on the rod into the axes of the link."""
    zeroth, first = into_blocks(axes, row_sym3(rows, i, c.ROD_SUMS)), into_blocks(axes, row_sym3(rows, i, c.ROD_SUMS + 6))
    return Moments(zeroth, first, into_blocks(axes, row_sym3(rows, i, c.ROD_SUMS + 12)))


@kernel(inline=True)
def forces_on_rod(loads: Array, axes: Axes, i: int) -> tuple[Parts, Pair]:
    """Take the force of children on the rod and its moment across into the axes of the link."""
    return into(axes, row_vector(loads, i, c.ROD_FORCE)), across(axes, row_vector(loads, i, c.ROD_MOMENT))


@kernel(inline=True)
def bias_of(segments: Segments, body: Body, turn: Pair, square: float, rod_children: bool) -> Bias:
    """Find what motion and given lengths bring, at the rod's point of reference (see `Bias`); turn is u across, square |u|^2."""
    here = 0.0 * body.centre if rod_children else body.centre
    beyond = body.reach if rod_children else body.beyond
    along, stretch = segments.lower_second - here * square, segments.upper_second - beyond * square
    return Bias(along, scale2(2.0 * segments.lower_rate, turn), stretch, scale2(2.0 * segments.upper_rate, turn))


@kernel(inline=True)
def keep_motion(rows: Array, i: int, heading: Heading, turn: Pair, bias: Bias) -> None:
    """Write the motion of a link."""
    rows[i, c.NORM], rows[i, c.SLIP] = heading.norm, dot(heading.d, heading.rate)
    put_pair(rows, i, c.RATE, turn)
    c.keep_bias(rows, i, bias)


@kernel(inline=True)
def gather(tree: Tree, y: Array, given: Array, force: Array, rows: Array, i: int) -> int:
    """Factor and load link i and hand on what its hinge feels, to a fixed point nothing; returns a fault."""
    lower_free, upper_free = is_free(tree, i)
    if not 0.0 < norm_of(tree, y, i) < INFINITY:
        return NO_DIRECTION
    heading, segments, real = heading_of(tree, y, i), segments_of(tree, y, given, force, i), tree.real
    axes = axes_of(heading.d)
    turn = across(axes, heading.rate)
    centre, beyond = segments.lower + real[i, CENTRE], real[i, LENGTH] - real[i, CENTRE] + segments.upper
    body = body_of(real[i, MASS], real[i, INERTIA], centre, beyond)
    square = dot2(turn, turn)
    if tree.shape[UPRIGHT] != 0:
        square += rows[tree.shape[LINKS], c.SPIN] * heading.d.x * heading.d.x
    bias = bias_of(segments, body, turn, square, tree.link[i, ROD_CHILDREN] != 0)
    applied = Applied(across(axes, vector(force, tree.link[i, AT_V])), segments.pull, segments.push)
    tip, tip_force = into_blocks(axes, row_sym3(rows, i, c.TIP_INERTIA)), into(axes, row_vector(rows, i, c.TIP_FORCE))
    if tree.link[i, ROD_CHILDREN] == 0:
        fault, factors, inertia = factor(lower_free, upper_free, body, tip)
        if fault != 0:
            return fault
        felt, held = load(lower_free, upper_free, body, factors, applied, bias, tip_force)
    else:
        sums, (children, moment) = sums_of(rows, axes, i), forces_on_rod(rows, axes, i)
        fault, factors, rod, inertia = factor_rod(lower_free, upper_free, body, tip, sums)
        if fault != 0:
            return fault
        whirling, whirling_moment = whirl(sums, body.mass * body.centre, square)
        children, moment = add_parts(children, whirling), add_scaled2(moment, 1.0, whirling_moment)
        felt, held, rod_load = load_rod(lower_free, upper_free, body, factors, rod, applied, bias, tip_force, children, moment)
        felt = add_parts(felt, times_blocks(inertia, Parts(bias.along, bias.across)))
        c.keep_rod(rows, i, rod)
        c.keep_rod_load(rows, i, rod_load)
    place = place_on_parent(tree, y, given, i)
    c.keep_factors(rows, i, heading.d, place, body, factors)
    c.keep_load(rows, i, applied, held)
    keep_motion(rows, i, heading, turn, bias)
    if base.is_fixed(tree, i):
        return 0
    hang_inertia(tree, rows, i, place, out_of_blocks(axes, inertia))
    hang_force(tree, rows, rows, i, place, out_of(axes, felt.along, felt.across))
    return 0


@kernel(inline=True)
def no_bias(zero: float) -> Bias:
    """Make the bias of a link at rest."""
    return Bias(zero, Pair(zero, zero), zero, Pair(zero, zero))


@kernel(inline=True)
def is_idle(tree: Tree, force: Array, loads: Array, i: int) -> bool:
    """Tell whether no force acts on link i or on what it carries: then its hinge feels none."""
    at = tree.link[i, AT_V]
    for j in range(at, at + 3 + tree.link[i, LOWER_FREE] + tree.link[i, UPPER_FREE]):
        if not is_zero(force[j]):
            return False
    for j in range(c.TIP_FORCE, c.TIP_FORCE + 3):
        if not is_zero(loads[i, j]):
            return False
    if tree.link[i, ROD_CHILDREN] != 0:
        for j in range(c.ROD_FORCE, c.ROD_MOMENT + 3):
            if not is_zero(loads[i, j]):
                return False
    return True


@kernel(inline=True)
def gather_force(tree: Tree, force: Array, rows: Array, loads: Array, i: int) -> None:
    """Load link i by forces alone and hand on what its hinge feels, to a fixed point nothing."""
    lower_free, upper_free = is_free(tree, i)
    at = tree.link[i, AT_V]
    if is_idle(tree, force, loads, i):
        c.keep_no_load(rows, loads, i)
        return
    axes = axes_of(c.kept_direction(rows, i))
    body, factors = c.kept_factors(tree, rows, i)
    zero = 0.0 * force[at]
    pull = force[at + 3] if lower_free else zero
    push = force[at + 3 + tree.link[i, LOWER_FREE]] if upper_free else zero
    applied, tip_force = Applied(across(axes, vector(force, at)), pull, push), into(axes, row_vector(loads, i, c.TIP_FORCE))
    if tree.link[i, ROD_CHILDREN] == 0:
        felt, held = load(lower_free, upper_free, body, factors, applied, no_bias(zero), tip_force)
    else:
        rod, (children, moment) = c.kept_rod(rows, i), forces_on_rod(loads, axes, i)
        felt, held, rod_load = load_rod(
            lower_free, upper_free, body, factors, rod, applied, no_bias(zero), tip_force, children, moment
        )
        c.keep_rod_load(loads, i, rod_load)
    c.keep_load(loads, i, applied, held)
    if not base.is_fixed(tree, i):
        hang_force(tree, rows, loads, i, rows[i, c.ON_PARENT], out_of(axes, felt.along, felt.across))
