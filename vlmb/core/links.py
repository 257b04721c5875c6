r"""Accelerations of a tree of links: forces inwards from the tips to the base, accelerations back outwards.

What hangs on a hinge asks for the force A a + f there when the hinge accelerates with a (less gravity's). A link takes what its tip
and its rod carry into its own axes, adds itself (plain.py, rods.py) and hands A and f to its parent or to the base (base.py). Once
the base's acceleration is known, the links find theirs outwards. The cost is linear in the number of links.

A direction d need not have length 1 nor its rate u be across it: the motion is evaluated with d^ = d / |d|, u^ = u - (u . d^) d^, and

    d' = |d| u^,   u' = w - |u^|^2 d^ + (u . d^) u^

so that d^ and u^ obey the true equations whatever |d| and u . d are, and errors of these two do not grow.
"""

from __future__ import annotations

from typing import NamedTuple

from vlmb.core import base
from vlmb.core.jit import kernel, sqrt
from vlmb.core.plain import Applied, Bias, Body, Factors, Move, TipLoad, body_of, factor, load, move
from vlmb.core.rods import Moments, RodFactors, RodLoad, factor_rod, load_rod, move_rod, whirl
from vlmb.core.tree import (
    AT_P,
    AT_V,
    C1,
    C2,
    CENTRE,
    INERTIA,
    K1,
    K2,
    LENGTH,
    LINKS,
    LOWER,
    LOWER_FREE,
    MASS,
    NO_DIRECTION,
    ON_ROD,
    PARENT,
    PLACE,
    PLACES,
    POSITIONS,
    REST1,
    REST2,
    ROD,
    ROD_CHILDREN,
    TIP_MASS,
    UPPER,
    UPPER_FREE,
    Array,
    Scratch,
    Tree,
)
from vlmb.core.vectors import (
    Axes,
    Blocks,
    Pair,
    Parts,
    Sym3,
    Vector,
    across,
    add2,
    add_parts,
    add_scaled,
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
    put,
    put_pair,
    put_row,
    put_sym2,
    row_pair,
    row_sym2,
    row_sym3,
    row_vector,
    scale,
    scale2,
    times_blocks,
    vector,
)

# columns of the factors; the last four are of a rod with children
DIRECTION, ROD_CENTRE, BEYOND, SEEN, YIELDING, WEIGHT, MIXED, INVERSE = 0, 3, 4, 5, 8, 11, 12, 14
ON_PARENT, TURN_ALONG, TURN_ACROSS, ROD_AXIAL, ROD_MIXED = 15, 16, 18, 21, 22
# columns of the loads
TURN, PULL, PUSH, TIP_ACROSS, TIP_AXIAL, TIP_ALONG, ROD_TURN, SLIDE = 0, 2, 3, 4, 6, 7, 8, 10
# columns of the biases: |d|, u . d, u across and those of `Bias`
NORM, SLIP, RATE, ALONG, ACROSS, STRETCH, FAN = 0, 1, 2, 4, 5, 7, 8
# columns of the moves
TIP_MOVE, ROD_MOVE, TURN_MOVE = 0, 3, 6
INFINITY = float("inf")


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
def segments_of(tree: Tree, y: Array, given: Array, force: Array, i: int) -> Segments:
    """Read the segments; forces along free ones are those of springs and dampers, k (rest - a) - c a', and what else acts."""
    link, real = tree.link, tree.real
    p, v = link[i, AT_P] + 3, link[i, AT_V] + 3
    rates = tree.shape[POSITIONS] + v
    lower, lower_rate, lower_second, pull = given[i, LOWER], given[i, LOWER + 1], given[i, LOWER + 2], 0.0 * real[i, LENGTH]
    upper, upper_rate, upper_second, push = given[i, UPPER], given[i, UPPER + 1], given[i, UPPER + 2], 0.0 * real[i, LENGTH]
    if link[i, LOWER_FREE] != 0:
        lower, lower_rate, lower_second = y[p], y[rates], 0.0 * lower
        pull = real[i, K1] * (real[i, REST1] - lower) - real[i, C1] * lower_rate + force[v]
        p, v, rates = p + 1, v + 1, rates + 1
    if link[i, UPPER_FREE] != 0:
        upper, upper_rate, upper_second = y[p], y[rates], 0.0 * upper
        push = real[i, K2] * (real[i, REST2] - upper) - real[i, C2] * upper_rate + force[v]
    return Segments(lower, lower_rate, lower_second, upper, upper_rate, upper_second, pull, push)


@kernel(inline=True)
def length_below(tree: Tree, y: Array, given: Array, i: int) -> float:
    """Read the length of the lower segment."""
    return y[tree.link[i, AT_P] + 3] if tree.link[i, LOWER_FREE] != 0 else given[i, LOWER]


# rows of the scratch


@kernel(inline=True)
def keep_factors(factors: Array, i: int, body: Body, found: Factors) -> None:
    """Write the factors of a link."""
    factors[i, ROD_CENTRE], factors[i, BEYOND] = body.centre, body.beyond
    put_sym2(factors, i, SEEN, found.seen)
    put_sym2(factors, i, YIELDING, found.yielding)
    put_pair(factors, i, MIXED, found.mixed)
    factors[i, WEIGHT], factors[i, INVERSE] = found.weight, found.inverse


@kernel(inline=True)
def kept_factors(tree: Tree, factors: Array, i: int) -> tuple[Body, Factors]:
    """Read the rod as it was and the factors of a link."""
    body = body_of(tree.real[i, MASS], tree.real[i, INERTIA], factors[i, ROD_CENTRE], factors[i, BEYOND])
    seen, yielding = row_sym2(factors, i, SEEN), row_sym2(factors, i, YIELDING)
    return body, Factors(seen, yielding, factors[i, WEIGHT], row_pair(factors, i, MIXED), factors[i, INVERSE])


@kernel(inline=True)
def keep_rod(factors: Array, i: int, rod: RodFactors) -> None:
    """Write the factors of a rod with children."""
    put_pair(factors, i, TURN_ALONG, rod.turn_along)
    put_sym2(factors, i, TURN_ACROSS, rod.turn_across)
    factors[i, ROD_AXIAL] = rod.axial
    put_pair(factors, i, ROD_MIXED, rod.mixed)


@kernel(inline=True)
def kept_rod(factors: Array, i: int) -> RodFactors:
    """Read the factors of a rod with children."""
    return RodFactors(
        row_pair(factors, i, TURN_ALONG), row_sym2(factors, i, TURN_ACROSS), factors[i, ROD_AXIAL], row_pair(factors, i, ROD_MIXED)
    )


@kernel(inline=True)
def keep_load(loads: Array, i: int, applied: Applied, tip: TipLoad) -> None:
    """Write what acts on a link."""
    put_pair(loads, i, TURN, applied.turn)
    loads[i, PULL], loads[i, PUSH] = applied.pull, applied.push
    put_pair(loads, i, TIP_ACROSS, tip.across)
    loads[i, TIP_AXIAL], loads[i, TIP_ALONG] = tip.axial, tip.along


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
def keep_bias(biases: Array, i: int, bias: Bias) -> None:
    """Write the bias of a link."""
    biases[i, ALONG], biases[i, STRETCH] = bias.along, bias.stretch
    put_pair(biases, i, ACROSS, bias.across)
    put_pair(biases, i, FAN, bias.fan)


@kernel(inline=True)
def kept_bias(biases: Array, i: int) -> Bias:
    """Read the bias of a link."""
    return Bias(biases[i, ALONG], row_pair(biases, i, ACROSS), biases[i, STRETCH], row_pair(biases, i, FAN))


# inwards


@kernel(inline=True)
def clear(tree: Tree, scratch: Scratch) -> None:
    """Begin with the tip masses, which ask for mu a."""
    tips = scratch.tips
    for i in range(tree.shape[LINKS]):
        mass = tree.real[i, TIP_MASS]
        tips[i, :] = 0.0 * mass
        tips[i, 0], tips[i, 3], tips[i, 5] = mass, mass, mass
        if tree.link[i, ROD_CHILDREN] != 0:
            scratch.rods[i, :] = 0.0 * mass


@kernel(inline=True)
def hang_inertia(tree: Tree, scratch: Scratch, i: int, place: float, inertia: Sym3) -> None:
    """Hand a link's inertia to its parent's tip or rod (`place` [m] from the parent's hinge), or to the base."""
    parent = tree.link[i, PARENT]
    if parent < 0:
        base.hang_inertia(tree, scratch.ground, i, inertia)
    elif tree.link[i, PLACE] == ROD:
        gather_sym3(scratch.rods, parent, 0, 1.0, inertia)
        gather_sym3(scratch.rods, parent, 6, place, inertia)
        gather_sym3(scratch.rods, parent, 12, place * place, inertia)
    else:
        gather_sym3(scratch.tips, parent, 0, 1.0, inertia)


@kernel(inline=True)
def hang_force(tree: Tree, scratch: Scratch, i: int, place: float, force: Vector) -> None:
    """Hand the force of a link on a hinge at rest on."""
    parent = tree.link[i, PARENT]
    if parent < 0:
        base.hang_force(tree, scratch.ground, i, force)
    elif tree.link[i, PLACE] == ROD:
        gather_vector(scratch.rods, parent, 18, 1.0, force)
        gather_vector(scratch.rods, parent, 21, place, force)
    else:
        gather_vector(scratch.tips, parent, 6, 1.0, force)


@kernel(inline=True)
def place_on_parent(tree: Tree, y: Array, given: Array, i: int) -> float:
    """Find how far from its parent's hinge link i hangs on the parent's rod [m]; 0 for other places."""
    if tree.link[i, PLACE] == ROD:
        return length_below(tree, y, given, tree.link[i, PARENT]) + tree.real[i, ON_ROD]
    return 0.0 * tree.real[i, ON_ROD]


@kernel(inline=True)
def sums_of(rods: Array, axes: Axes, i: int) -> Moments:
    """Take the inertias of children on the rod into the axes of the link."""
    zeroth, first = into_blocks(axes, row_sym3(rods, i, 0)), into_blocks(axes, row_sym3(rods, i, 6))
    return Moments(zeroth, first, into_blocks(axes, row_sym3(rods, i, 12)))


@kernel(inline=True)
def forces_on_rod(rods: Array, axes: Axes, i: int) -> tuple[Parts, Pair]:
    """Take the force of children on the rod and its moment across into the axes of the link."""
    return into(axes, row_vector(rods, i, 18)), across(axes, row_vector(rods, i, 21))


@kernel(inline=True)
def gather(tree: Tree, y: Array, given: Array, force: Array, scratch: Scratch, i: int) -> int:
    """Factor and load link i and hand on what its hinge feels; returns a fault."""
    at_p, at_v = tree.link[i, AT_P], tree.link[i, AT_V]
    lower_free, upper_free = is_free(tree, i)
    direction, rate = vector(y, at_p), vector(y, tree.shape[POSITIONS] + at_v)
    norm = sqrt(dot(direction, direction))
    if not 0.0 < norm < INFINITY:
        return NO_DIRECTION
    axes = axes_of(scale(1.0 / norm, direction))
    turn = across(axes, rate)
    square = dot2(turn, turn)  # |u|^2
    segments = segments_of(tree, y, given, force, i)
    real = tree.real
    centre, beyond = segments.lower + real[i, CENTRE], real[i, LENGTH] - real[i, CENTRE] + segments.upper
    body = body_of(real[i, MASS], real[i, INERTIA], centre, beyond)
    applied = Applied(across(axes, vector(force, at_v)), segments.pull, segments.push)
    tip, tip_force = into_blocks(axes, row_sym3(scratch.tips, i, 0)), into(axes, row_vector(scratch.tips, i, 6))
    carried, fan = scale2(2.0 * segments.lower_rate, turn), scale2(2.0 * segments.upper_rate, turn)
    if tree.link[i, ROD_CHILDREN] == 0:
        bias = Bias(segments.lower_second - centre * square, carried, segments.upper_second - beyond * square, fan)
        fault, factors, inertia = factor(lower_free, upper_free, body, tip)
        felt, held = load(lower_free, upper_free, body, factors, applied, bias, tip_force)
    else:
        bias = Bias(segments.lower_second, carried, segments.upper_second - body.reach * square, fan)
        sums = sums_of(scratch.rods, axes, i)
        fault, factors, rod, inertia = factor_rod(lower_free, upper_free, body, tip, sums)
        children, moment = forces_on_rod(scratch.rods, axes, i)
        whirling, whirling_moment = whirl(sums, body.mass * body.centre, square)
        felt, held, left = load_rod(
            lower_free, upper_free, body, factors, rod, applied, bias, tip_force,
            add_parts(children, whirling), add_scaled2(moment, 1.0, whirling_moment),
        )  # fmt: skip
        felt = add_parts(felt, times_blocks(inertia, Parts(bias.along, bias.across)))
        keep_rod(scratch.factors, i, rod)
        keep_rod_load(scratch.loads, i, left)
    place = place_on_parent(tree, y, given, i)
    put_row(scratch.factors, i, DIRECTION, axes.d)
    scratch.factors[i, ON_PARENT] = place
    keep_factors(scratch.factors, i, body, factors)
    keep_load(scratch.loads, i, applied, held)
    keep_bias(scratch.biases, i, bias)
    scratch.biases[i, NORM], scratch.biases[i, SLIP] = norm, dot(axes.d, rate)
    put_pair(scratch.biases, i, RATE, turn)
    hang_inertia(tree, scratch, i, place, out_of_blocks(axes, inertia))
    hang_force(tree, scratch, i, place, out_of(axes, felt.along, felt.across))
    return fault


# outwards


@kernel(inline=True)
def hinge_of(tree: Tree, scratch: Scratch, i: int) -> Vector:
    """Find the acceleration of a link's hinge, less gravity's."""
    parent, moves = tree.link[i, PARENT], scratch.moves
    if parent < 0:
        return base.hinge_of_root(tree, scratch.ground, i)
    if tree.link[i, PLACE] == ROD:
        place = scratch.factors[i, ON_PARENT]
        return add_scaled(row_vector(moves, parent, ROD_MOVE), place, row_vector(moves, parent, TURN_MOVE))
    return row_vector(moves, parent, TIP_MOVE)


@kernel(inline=True)
def move_link(
    tree: Tree, scratch: Scratch, i: int, axes: Axes, hinge: Parts, body: Body, factors: Factors, bias: Bias, square: float
) -> Move:
    """Find how link i moves with its hinge, and keep it for its children; square = |u|^2."""
    lower_free, upper_free = is_free(tree, i)
    applied, tip = kept_load(scratch.loads, i)
    moves = scratch.moves
    if tree.link[i, ROD_CHILDREN] == 0:
        moved = move(lower_free, upper_free, body, factors, applied, bias, tip, hinge)
    else:
        rod = kept_rod(scratch.factors, i)
        left = RodLoad(row_pair(scratch.loads, i, ROD_TURN), scratch.loads[i, SLIDE])
        moved, origin = move_rod(lower_free, upper_free, body, factors, rod, bias, tip, left, hinge)
        put_row(moves, i, ROD_MOVE, out_of(axes, moved.along, origin))
        put_row(moves, i, TURN_MOVE, out_of(axes, -square, moved.turn))
    put_row(moves, i, TIP_MOVE, out_of(axes, moved.tip_along, moved.tip_across))
    return moved


@kernel(inline=True)
def write_lengths(tree: Tree, i: int, body: Body, hinge: Parts, moved: Move, square: float, out: Array, at: int) -> None:
    """Write the second derivatives of free lengths: differences of accelerations along, and what the turn adds."""
    rod_children = tree.link[i, ROD_CHILDREN] != 0
    reference = 0.0 * body.centre if rod_children else body.centre
    beyond = body.reach if rod_children else body.beyond
    if tree.link[i, LOWER_FREE] != 0:
        out[at] = moved.along - hinge.along + reference * square
        at += 1
    if tree.link[i, UPPER_FREE] != 0:
        out[at] = moved.tip_along - moved.along + beyond * square


@kernel(inline=True)
def write_axial(tree: Tree, scratch: Scratch, i: int, body: Body, factors: Factors, bias: Bias, hinge: Parts, moved: Move) -> None:
    """Write the forces that given segments take."""
    lower_free, upper_free = is_free(tree, i)
    at_tip = factors.weight * moved.tip_along + dot2(factors.mixed, moved.tip_across) + scratch.loads[i, TIP_ALONG]
    scratch.axial[i, 1] = 0.0 * at_tip if upper_free else at_tip
    if lower_free:
        scratch.axial[i, 0] = 0.0 * at_tip
    elif tree.link[i, ROD_CHILDREN] == 0:
        scratch.axial[i, 0] = body.mass * moved.along + (scratch.loads[i, PUSH] if upper_free else at_tip)
    else:
        rod, origin = kept_rod(scratch.factors, i), add2(hinge.across, bias.across)
        scratch.axial[i, 0] = rod.axial * moved.along + dot2(rod.mixed, origin) + scratch.loads[i, SLIDE]


@kernel(inline=True)
def spread(tree: Tree, y: Array, dy: Array, scratch: Scratch, i: int) -> None:
    """Find the accelerations of link i from that of its hinge, and write its rates."""
    axes, biases = axes_of(row_vector(scratch.factors, i, DIRECTION)), scratch.biases
    hinge, bias, turn = into(axes, hinge_of(tree, scratch, i)), kept_bias(biases, i), row_pair(biases, i, RATE)
    body, factors = kept_factors(tree, scratch.factors, i)
    square, first = dot2(turn, turn), tree.shape[POSITIONS]
    moved = move_link(tree, scratch, i, axes, hinge, body, factors, bias, square)
    write_axial(tree, scratch, i, body, factors, bias, hinge, moved)
    p, v = tree.link[i, AT_P], tree.link[i, AT_V]
    put(dy, p, out_of(axes, 0.0 * square, scale2(biases[i, NORM], turn)))
    put(dy, first + v, out_of(axes, -square, add_scaled2(moved.turn, biases[i, SLIP], turn)))
    for free in range(tree.link[i, LOWER_FREE] + tree.link[i, UPPER_FREE]):
        dy[p + 3 + free] = y[first + v + 3 + free]
    write_lengths(tree, i, body, hinge, moved, square, dy, first + v + 3)


# the borders of the core


@kernel
def accelerate(tree: Tree, y: Array, given: Array, force: Array, dy: Array, scratch: Scratch) -> int:
    """Write the rates of positions and velocities at (y, given) under generalized forces, springs and weight; returns a code.

    y, dy (at least positions + velocities,); given (n, 6) [m, m/s, m/s^2]; force (velocities,) conjugate to the velocities: on
    u a vector, whose part along d does nothing. Code 0, or fault * PLACES + link; `scratch.axial` then has the forces that given
    segments take.
    """
    n, ground = tree.shape[LINKS], scratch.ground
    clear(tree, scratch)
    base.face(tree, y, ground)
    for i in range(n - 1, -1, -1):
        fault = gather(tree, y, given, force, scratch, i)
        if fault != 0:
            return fault * PLACES + i
    fault = base.move_base(tree, base.base_bias(tree, y, ground), force, dy, tree.shape[POSITIONS], ground)
    if fault != 0:
        return fault * PLACES + n
    base.drive_base(tree, y, ground, dy)
    for i in range(n):
        spread(tree, y, dy, scratch, i)
    return 0


@kernel(inline=True)
def gather_force(tree: Tree, force: Array, scratch: Scratch, i: int) -> None:
    """Load link i by forces alone and hand on what its hinge feels."""
    lower_free, upper_free = is_free(tree, i)
    at = tree.link[i, AT_V]
    axes, tips = axes_of(row_vector(scratch.factors, i, DIRECTION)), scratch.tips
    body, factors = kept_factors(tree, scratch.factors, i)
    zero = 0.0 * body.centre
    still = Bias(zero, Pair(zero, zero), zero, Pair(zero, zero))
    pull = force[at + 3] if lower_free else zero
    push = force[at + 3 + tree.link[i, LOWER_FREE]] if upper_free else zero
    applied, tip_force = Applied(across(axes, vector(force, at)), pull, push), into(axes, row_vector(tips, i, 6))
    if tree.link[i, ROD_CHILDREN] == 0:
        felt, held = load(lower_free, upper_free, body, factors, applied, still, tip_force)
    else:
        rod = kept_rod(scratch.factors, i)
        children, moment = forces_on_rod(scratch.rods, axes, i)
        felt, held, left = load_rod(lower_free, upper_free, body, factors, rod, applied, still, tip_force, children, moment)
        keep_rod_load(scratch.loads, i, left)
    keep_load(scratch.loads, i, applied, held)
    hang_force(tree, scratch, i, scratch.factors[i, ON_PARENT], out_of(axes, felt.along, felt.across))


@kernel(inline=True)
def spread_force(tree: Tree, out: Array, scratch: Scratch, i: int) -> None:
    """Find the accelerations of link i that forces add from what they add to its hinge's."""
    axes = axes_of(row_vector(scratch.factors, i, DIRECTION))
    hinge = into(axes, hinge_of(tree, scratch, i))
    body, factors = kept_factors(tree, scratch.factors, i)
    zero = 0.0 * body.centre
    still = Bias(zero, Pair(zero, zero), zero, Pair(zero, zero))
    moved = move_link(tree, scratch, i, axes, hinge, body, factors, still, zero)
    at = tree.link[i, AT_V]
    put(out, at, out_of(axes, zero, moved.turn))
    write_lengths(tree, i, body, hinge, moved, zero, out, at + 3)


@kernel
def respond(tree: Tree, y: Array, force: Array, out: Array, scratch: Scratch) -> int:
    """Write what generalized forces alone add to the accelerations, M^-1 Q, where `accelerate` was last; returns a code.

    force, out (velocities,); given segments do not accelerate. Overwrites the loads in `scratch` and keeps the factors.
    """
    n, ground = tree.shape[LINKS], scratch.ground
    base.still(ground)
    for i in range(n):
        scratch.tips[i, 6:] = 0.0 * scratch.tips[i, 6]
        if tree.link[i, ROD_CHILDREN] != 0:
            scratch.rods[i, 18:] = 0.0 * scratch.tips[i, 6]
    for i in range(n - 1, -1, -1):
        gather_force(tree, force, scratch, i)
    zero = 0.0 * ground[0, base.COSINE]
    fault = base.move_base(tree, Vector(zero, zero, zero), force, out, 0, ground)
    for i in range(n):
        spread_force(tree, out, scratch, i)
    return fault * PLACES + n if fault != 0 else 0
