r"""One link with children on its rod, in its own axes.

The rod moves as the point of it at the hinge and a turn: p = (s, y) = h + a'' d + 2 a' u and q = (-|u|^2, w). A point of the rod
at the distance r from the hinge has the acceleration p + r q, so that children on it ask in sum for

    force   S0 p + S1 q + f0,   moment   S1 p + S2 q + f1,      Sk = sum r^k A,  fk = sum r^k f

With the rod's own inertia and what it sees of the tip (see plain.py) the unknowns w (2), s, y (2) stand in one symmetric system

    [ N^-1  along  across ] [w]   [turn ]   [0     ]
    [ .     axial  mixed  ] [s] + [slide] = [axial force at the hinge]
    [ .     .      cross  ] [y]   [push ]   [force across at the hinge]

from which w is eliminated, and s where the lower segment is free.
"""

from __future__ import annotations

from typing import NamedTuple

from vlmb.core.jit import kernel, reciprocal
from vlmb.core.plain import Applied, Bias, Body, Factors, Move, TipLoad, seen_across
from vlmb.core.tree import FREE_TIP, TINY, TURNING
from vlmb.core.vectors import (
    Blocks,
    Pair,
    Parts,
    Sym2,
    add2,
    add_scaled2,
    add_unit2,
    adjugate2,
    congruent2,
    determinant2,
    dot2,
    less_square2,
    scale2,
    sum2,
    times2,
)


class Moments(NamedTuple):
    """What children on a rod ask for, by the power of their distance from the hinge."""

    zeroth: Blocks  # S0 [kg]
    first: Blocks  # S1 [kg m]
    second: Blocks  # S2 [kg m^2]


class RodFactors(NamedTuple):
    """The symmetric system of a rod after the elimination of w, which `turn_along` and `turn_across` still couple."""

    turn_along: Pair  # w with s
    turn_across: Sym2  # w with y
    axial: float
    mixed: Pair


class RodLoad(NamedTuple):
    """Loads of the system: `turn` as it was, `slide` after the elimination of w."""

    turn: Pair
    slide: float


@kernel(inline=True)
def factor_rod(
    lower_free: bool, upper_free: bool, body: Body, tip: Blocks, sums: Moments
) -> tuple[int, Factors, RodFactors, Blocks]:
    """Factor a link with children on its rod; returns a fault, the factors and the inertia [kg] that the hinge feels."""
    fault, seen, inverse = 0, tip.across, 0.0 * tip.along
    if upper_free:
        fault, seen, inverse = seen_across(False, True, body.mass, tip)
    first_moment = body.mass * body.centre
    turning = add_unit2(1.0, sum2(sums.second.across, body.reach * body.reach, seen), body.hinge_inertia)
    turn_across = add_unit2(1.0, sum2(sums.first.across, body.reach, seen), first_moment)
    cross = add_unit2(1.0, sum2(sums.zeroth.across, 1.0, seen), body.mass)
    turn_along, axial, mixed = sums.first.mixed, sums.zeroth.along + body.mass, sums.zeroth.mixed
    if not upper_free:  # the tip goes along with the rod
        turn_along = add_scaled2(turn_along, body.reach, tip.mixed)
        axial, mixed = axial + tip.along, add2(mixed, tip.mixed)
    det, trace = determinant2(turning), turning.one + turning.two
    if fault == 0 and not det > TINY * trace * trace:
        fault = TURNING
    yielding = add_unit2(reciprocal(det), adjugate2(turning), 0.0 * det)
    weight = axial
    axial = axial - dot2(turn_along, times2(yielding, turn_along))
    mixed = add_scaled2(mixed, -1.0, times2(turn_across, times2(yielding, turn_along)))
    cross = sum2(cross, -1.0, congruent2(turn_across, yielding))
    factors = Factors(seen, yielding, tip.along, tip.mixed, inverse)
    rod = RodFactors(turn_along, turn_across, axial, mixed)
    if not lower_free:
        return fault, factors, rod, Blocks(axial, mixed, cross)
    zero = 0.0 * axial
    if fault == 0 and not axial > TINY * weight:
        fault = FREE_TIP
    return fault, factors, rod, Blocks(zero, Pair(zero, zero), less_square2(cross, reciprocal(axial), mixed))


@kernel(inline=True)
def whirl(sums: Moments, first_moment: float, speed: float) -> tuple[Parts, Pair]:
    """Loads of the turn -|u|^2 d, with speed = |u|^2: of children (force and moment across) and of the rod's centre."""
    along = -speed * (sums.first.along + first_moment)
    return Parts(along, scale2(-speed, sums.first.mixed)), scale2(-speed, sums.second.mixed)


@kernel(inline=True)
def load_rod(
    lower_free: bool, upper_free: bool, body: Body, factors: Factors, rod: RodFactors,
    applied: Applied, bias: Bias, tip: Parts, force: Parts, moment: Pair,
) -> tuple[Parts, TipLoad, RodLoad]:  # fmt: skip
    """Find the force [N] that the hinge feels at p = 0; `force` and `moment` are f0 and f1 with the load of the whirl."""
    if upper_free:
        axial = (applied.push - tip.along) * factors.inverse
        held = add_scaled2(tip.across, axial, factors.mixed)
        slide = force.along + applied.push
    else:
        axial = 0.0 * tip.along
        held = add_scaled2(tip.across, bias.stretch, factors.mixed)
        slide = force.along + tip.along + factors.weight * bias.stretch + dot2(factors.mixed, bias.fan)
    thrust = add2(held, times2(factors.seen, bias.fan))  # of the tip on the rod, were it not for p and w
    turn = add_scaled2(add_scaled2(moment, body.reach, thrust), -1.0, applied.turn)
    eased = times2(factors.yielding, turn)
    slide = slide - dot2(rod.turn_along, eased)
    across = add_scaled2(add2(force.across, thrust), -1.0, times2(rod.turn_across, eased))
    if lower_free:
        slide = slide - applied.pull
        across = add_scaled2(across, -slide / rod.axial, rod.mixed)
    return Parts(applied.pull if lower_free else slide, across), TipLoad(held, axial, tip.along), RodLoad(turn, slide)


@kernel(inline=True)
def move_rod(
    lower_free: bool, upper_free: bool, body: Body, factors: Factors, rod: RodFactors,
    bias: Bias, tip: TipLoad, loads: RodLoad, hinge: Parts,
) -> Move:  # fmt: skip
    """Find how the link moves with its hinge."""
    origin = add2(hinge.across, bias.across)
    along = hinge.along + bias.along
    if lower_free:
        along = -(loads.slide + dot2(rod.mixed, origin)) / rod.axial
    turning = add2(add_scaled2(loads.turn, along, rod.turn_along), times2(rod.turn_across, origin))
    turn = scale2(-1.0, times2(factors.yielding, turning))
    tip_across = add_scaled2(add2(origin, bias.fan), body.reach, turn)
    tip_along = along + bias.stretch
    if upper_free:
        tip_along = tip.axial - factors.inverse * dot2(factors.mixed, tip_across)
    return Move(turn, along, tip_along, tip_across)
