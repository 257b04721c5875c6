"""Friction under a ski: Coulomb's law on the normal force of that instant, which answers to the friction itself.

With a force F along the ski all accelerations, rows and controls in, the normal force is N = N_0 + c F and the acceleration along
the ski a = a_0 + b F. Sliding, F = -mu s max(N, 0) with s the side of the speed; standing, F = -a_0/b while |F| <= mu N. Where it
goes by the edge force E = E_0 + e F as well, the resultant sqrt(N^2 + E^2) stands for N, and c for sqrt(c^2 + e^2): then
(1 - mu^2 c^2 - mu^2 e^2) F^2 - 2 mu^2 (N_0 c + E_0 e) F - mu^2 (N_0^2 + E_0^2) = 0, of whose two roots one has the right side.
"""

from __future__ import annotations

from vlmb.core import tree as of
from vlmb.core.jit import inner, kernel
from vlmb.core.quantities import (
    BETWEEN,
    CENTRE_OF_MASS,
    COMPONENT,
    CONSTANT,
    HALF_SQUARE,
    KIND,
    LINK,
    POINT,
    SECOND,
    Quantities,
    add_row,
    measure,
    place_of,
)
from vlmb.core.scalars import NAN, sqrt
from vlmb.core.tree import Array, Tree
from vlmb.core.triples import Vector, dot, plus

# Of `sliding` of a plant: coefficient, mass [kg] of all, force [N] that answers are tried with, whether the edge force counts.
MU, MASS, PUSH, CARVES = range(4)
# Rows of `sliding` of a memory: generalized forces without friction; what is known of it: the side that the ski slides to, 0
# where it stands and nan where its state shall say it; friction [N], normal force [N], c, the side as it came out, what friction
# goes by [N]; then normal force, edge force and acceleration without friction.
SAVED, FOUND, TRIED = range(3)
ANSWERS = 3  # that an evaluation takes: without friction, with a force along the ski, with the friction that follows from both
MODE, FRICTION, NORMAL, ANSWER, SLIDES, PRESS = range(6)
ROUNDED = 1.0 + 1e-12  # times the most that friction can hold: what is asked of a standing ski within this is rounding


@inner
def lift_of(quantities: Quantities, k: int, tree: Tree, y: Array, given: Array) -> float:
    """Return how much of a force along a quantity lifts the whole mechanism: 0 for those that act from one part on another."""
    kind = quantities.kind[k, KIND]
    if kind in (POINT, CENTRE_OF_MASS):
        return 1.0 if quantities.kind[k, COMPONENT] == 2 else 0.0
    if kind not in (BETWEEN, HALF_SQUARE):
        return 0.0
    first, second = quantities.kind[k, LINK], quantities.kind[k, SECOND]
    side = 0.0
    if quantities.kind[first, KIND] == CONSTANT:
        side = 1.0
    elif quantities.kind[second, KIND] == CONSTANT:
        side = -1.0
    if side == 0.0:
        return 0.0
    r = plus(place_of(quantities, second, tree, y, given)[0], -1.0, place_of(quantities, first, tree, y, given)[0])
    return side * r[2] / (sqrt(dot(r, r)) if kind == BETWEEN else 1.0)


@inner
def weight_carried(
    quantities: Quantities, k: int, mass: float, tree: Tree, y: Array, given: Array, reference: Array, change: Array, row: Array,
    measured: Array,
) -> float:  # fmt: skip
    """Return m (z'' - g_z) of the centre of mass, quantity k, with accelerations `change`; row and measured are overwritten."""
    for j in range(row.shape[0]):
        row[j] = 0.0
    measure(quantities, k, tree, y, given, reference, measured)
    add_row(quantities, k, tree, y, given, reference, 1.0, row)
    rise = measured[k, 2]
    for j in range(row.shape[0]):
        rise += row[j] * change[j]
    return mass * (rise - tree.base[of.GRAVITY + 2])


@inner
def side_at_rest(hold: float, most: float) -> float:
    """Return 0 where a standing ski is held by a force of at most `most`, else the side that it begins to slide to."""
    if abs(hold) <= most:
        return 0.0
    return -1.0 if hold > 0.0 else 1.0


@inner
def press_of(at: Vector, answer: Vector, force: float) -> float:
    """Return what friction goes by [N]: the resultant of normal force and edge force, 0 where the normal force is below 0."""
    normal, edge = at[0] + answer[0] * force, at[1] + answer[1] * force
    return sqrt(normal * normal + edge * edge) if normal > 0.0 else 0.0


@inner
def sliding_force(mu: float, side: float, at: Vector, answer: Vector) -> float:
    """Return the friction [N] of a ski that slides to a side; see the top of this file."""
    if at[1] == 0.0 and answer[1] == 0.0:
        return -mu * side * max(at[0] / (1.0 + mu * side * answer[0]), 0.0)
    square = mu * mu
    a = 1.0 - square * (answer[0] * answer[0] + answer[1] * answer[1])
    half, c = square * (at[0] * answer[0] + at[1] * answer[1]), square * (at[0] * at[0] + at[1] * at[1])
    root = sqrt(half * half + a * c)
    return (half - side * root) / a if at[0] > 0.0 else 0.0


@kernel
def choose(found: Array, mu: float, speed: float, at: Vector, answer: Vector) -> None:
    """Write friction and what goes with it into `found`; see the top of this file.

    at, answer: normal force, edge force (0 where it does not count) and acceleration along the ski without friction, and what
    1 N of it adds.
    """
    hold = -at[2] / answer[2] if answer[2] > 0.0 else NAN
    side = found[MODE]
    if side != side:
        side = 1.0 if speed > 0.0 else -1.0 if speed < 0.0 else side_at_rest(hold, mu * press_of(at, answer, hold))
    force = hold if side == 0.0 else sliding_force(mu, side, at, answer)
    found[FRICTION], found[NORMAL] = force, at[0] + answer[0] * force
    found[ANSWER], found[SLIDES] = sqrt(answer[0] * answer[0] + answer[1] * answer[1]), side
    found[PRESS] = press_of(at, answer, force)
