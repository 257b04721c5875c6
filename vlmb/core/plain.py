r"""One link on whose rod nothing hangs, in closed form and in its own axes.

The rod (mass m, transverse inertia J, centre at c from the hinge, e below the tip, tip at R = c + e) is between two segments
without mass. What hangs at the tip asks for the force [alpha, beta'; beta, B] (x, y) + (f_d, f) when the tip accelerates with x
along the link and y across it. With the hinge's acceleration h across, w the transverse angular acceleration, g the turning
force, Coriolis parts k of the centre and v of the tip:

    tip across       y = h + v + R w,        force across on the rod  T y + t
    turning          J w + m c (h + k + c w) + R (T y + t) = g
    hence            D w = g - m c (h + k) - R (T (h + v) + t),         D = (J + m c^2) 1 + R^2 T
                     D y = K h + (J + m c^2) v + R (g - m c k - R t),   K = J - m c e

How T and t come about depends on the segments. A free upper one hands on its force, so that the tip follows along the link; a
free lower one below a given upper one leaves rod and tip to move along together:

    T = B - beta beta' / W,   t = f + beta X,   x = X - beta' y / W
    upper free             W = alpha,       X = (push - f_d) / W
    only lower free        W = m + alpha,   X = (pull - f_d + m stretch) / W,   stretch: of the tip beyond the centre
    both given             1 / W = 0,       X = x, which is known from the hinge's

The hinge feels the force A h + (load); every term of its part across is positive, with det for that of D:

    A = (K^2 T + (m J (J + m c^2 + R^2 tr T) + (J + m e^2) R^2 det T) 1) / det
"""

from __future__ import annotations

from typing import NamedTuple

from vlmb.core.jit import kernel, reciprocal
from vlmb.core.tree import FREE_ROD, FREE_TIP, TINY, TURNING
from vlmb.core.vectors import (
    Blocks,
    Pair,
    Parts,
    Sym2,
    add2,
    add_scaled2,
    add_unit2,
    adjugate2,
    determinant2,
    dot2,
    less_square2,
    scale2,
    times2,
)


class Body(NamedTuple):
    """A rod at this moment: masses [kg], inertias [kg m^2], distances [m]."""

    mass: float
    inertia: float  # J, about the centre
    centre: float  # c, from the hinge
    beyond: float  # e, from the centre to the tip
    reach: float  # R = c + e
    hinge_inertia: float  # J + m c^2
    opposed: float  # K = J - m c e


class Factors(NamedTuple):
    """What depends on the posture alone."""

    seen: Sym2  # T [kg], what the rod sees of the tip across
    yielding: Sym2  # D^-1 [1/(kg m^2)]
    weight: float  # alpha [kg]
    mixed: Pair  # beta [kg]
    inverse: float  # 1 / W [1/kg]


class Applied(NamedTuple):
    """Forces on the link itself."""

    turn: Pair  # g [N m]
    pull: float  # along the free lower segment [N]
    push: float  # along the free upper segment [N]


class Bias(NamedTuple):
    """Accelerations [m/s^2] that the motion and given lengths bring, at the rod's point of reference and at the tip beyond it.

    The point is the rod's centre for a plain link, the point of the rod at the hinge for one with children on it; z is its
    distance from the hinge. Second derivatives of free lengths are not in it.
    """

    along: float  # a'' - z |u|^2
    across: Pair  # 2 a' u
    stretch: float  # b'' - (R - z) |u|^2
    fan: Pair  # 2 b' u


class TipLoad(NamedTuple):
    """What the way back needs of the tip."""

    across: Pair  # t [N]
    axial: float  # X [m/s^2]; 0 where both segments are given
    along: float  # f_d [N]


class Move(NamedTuple):
    """How a link moves: accelerations less gravity's."""

    turn: Pair  # w [rad/s^2]
    along: float  # of the rod's point of reference [m/s^2]
    tip_along: float  # x
    tip_across: Pair  # y


@kernel(inline=True)
def body_of(mass: float, inertia: float, centre: float, beyond: float) -> Body:
    """Complete a rod's constants; K is formed here, without the difference of what it comes from."""
    hinge_inertia, opposed = inertia + mass * centre * centre, inertia - mass * centre * beyond
    return Body(mass, inertia, centre, beyond, centre + beyond, hinge_inertia, opposed)


@kernel(inline=True)
def seen_across(lower_free: bool, upper_free: bool, mass: float, tip: Blocks) -> tuple[int, Sym2, float]:
    """Eliminate the motion along a free segment: T = B - beta beta' / W; returns a fault, T and 1 / W."""
    if not lower_free and not upper_free:
        return 0, tip.across, 0.0
    weight = tip.along if upper_free else mass + tip.along
    sound = weight > TINY * (tip.across.one + tip.across.two)
    inverse = reciprocal(weight)
    return 0 if sound else FREE_TIP, less_square2(tip.across, inverse, tip.mixed), inverse


@kernel(inline=True)
def factor(lower_free: bool, upper_free: bool, body: Body, tip: Blocks) -> tuple[int, Factors, Blocks]:
    """Factor a link; returns a fault, the factors and the inertia [kg] that the hinge feels."""
    fault, seen, inverse = seen_across(lower_free, upper_free, body.mass, tip)
    if fault == 0 and lower_free and upper_free and not body.mass > 0.0:
        fault = FREE_ROD
    square = body.reach * body.reach
    own = body.hinge_inertia + square * (seen.one + seen.two)
    beyond = square * determinant2(seen)
    det = body.hinge_inertia * own + square * beyond
    if fault == 0 and not det > TINY * own * own:
        fault = TURNING
    k = reciprocal(det)
    yielding = add_unit2(k * square, adjugate2(seen), k * body.hinge_inertia)
    far = body.inertia + body.mass * body.beyond * body.beyond
    across = add_unit2(
        k * body.opposed * body.opposed, seen, k * (body.mass * body.inertia * own + far * beyond)
    )
    factors = Factors(seen, yielding, tip.along, tip.mixed, inverse)
    if lower_free:
        return fault, factors, Blocks(0.0 * k, Pair(0.0 * k, 0.0 * k), across)
    if upper_free:
        return fault, factors, Blocks(body.mass, Pair(0.0 * k, 0.0 * k), across)
    bent = times2(yielding, tip.mixed)
    along = body.mass + tip.along - square * dot2(tip.mixed, bent)
    return fault, factors, Blocks(along, scale2(body.opposed, bent), across)


@kernel(inline=True)
def load(
    lower_free: bool, upper_free: bool, body: Body, factors: Factors, applied: Applied, bias: Bias, tip: Parts
) -> tuple[Parts, TipLoad]:
    """Find the force [N] that the hinge feels when it does not accelerate, and what the tip's motion along rests on."""
    both_given = not lower_free and not upper_free
    if upper_free:
        axial = (applied.push - tip.along) * factors.inverse
    elif lower_free:
        axial = (applied.pull - tip.along + body.mass * bias.stretch) * factors.inverse
    else:
        axial = bias.along + bias.stretch
    held = add_scaled2(tip.across, axial, factors.mixed)  # t
    drag = scale2(body.mass, bias.across)  # m k
    spread = add2(bias.across, bias.fan)  # v
    # N (K (T v + t) + J m k + R T (e m k + g) + m c g)
    inner = scale2(body.opposed, add2(times2(factors.seen, spread), held))
    inner = add_scaled2(inner, body.inertia, drag)
    inner = add_scaled2(inner, body.reach, times2(factors.seen, add_scaled2(applied.turn, body.beyond, drag)))
    inner = add_scaled2(inner, body.mass * body.centre, applied.turn)
    across = times2(factors.yielding, inner)
    if lower_free:
        along = applied.pull
    elif upper_free:
        along = body.mass * bias.along + applied.push
    else:
        swing = tip_swing(body, applied, bias, held)
        along = body.mass * bias.along + factors.weight * axial + tip.along
        along += dot2(factors.mixed, times2(factors.yielding, swing))
    if both_given:
        return Parts(along, across), TipLoad(tip.across, 0.0 * axial, tip.along)
    return Parts(along, across), TipLoad(held, axial, tip.along)


@kernel(inline=True)
def tip_swing(body: Body, applied: Applied, bias: Bias, held: Pair) -> Pair:
    """(J + m c^2) v + R (g - m c k - R t): D y of the tip at a hinge at rest."""
    turning = add_scaled2(add_scaled2(applied.turn, -body.mass * body.centre, bias.across), -body.reach, held)
    return add_scaled2(scale2(body.reach, turning), body.hinge_inertia, add2(bias.across, bias.fan))


@kernel(inline=True)
def move(
    lower_free: bool, upper_free: bool, body: Body, factors: Factors, applied: Applied, bias: Bias, tip: TipLoad, hinge: Parts
) -> Move:
    """Find how the link moves with its hinge."""
    held = tip.across
    if not lower_free and not upper_free:
        held = add_scaled2(held, hinge.along + bias.along + bias.stretch, factors.mixed)
    # w = N (g - m c (h + k) - R (T (h + v) + t))
    carried = add2(hinge.across, bias.across)
    force = add2(times2(factors.seen, add2(carried, bias.fan)), held)
    turning = add_scaled2(add_scaled2(applied.turn, -body.mass * body.centre, carried), -body.reach, force)
    turn = times2(factors.yielding, turning)
    # y = N (K h + (J + m c^2) v + R (g - m c k - R t))
    swing = add_scaled2(tip_swing(body, applied, bias, held), body.opposed, hinge.across)
    tip_across = times2(factors.yielding, swing)
    tip_along = tip.axial - factors.inverse * dot2(factors.mixed, tip_across)
    along = hinge.along + bias.along
    if lower_free and upper_free:
        along = (applied.pull - applied.push) / body.mass
    elif lower_free:
        along = tip_along - bias.stretch
    elif not upper_free:
        tip_along = along + bias.stretch
    return Move(turn, along, tip_along, tip_across)
