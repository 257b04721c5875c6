r"""What links in upright planes along a ski ask for sideways: they turn with it, so their places and rates alone tell.

A mass m of such a link is at X ahead of A and at a constant e to the left. With a the acceleration of A to the left it has

    a + X phi'' + 2 phi' X' - phi'^2 e

that way, so that all of them ask in sum for

    force   M a + S phi'' + f,   yaw   S a + I phi'' + g,   M = sum m,  S = sum m X,  I = sum m X^2,
                                                            f = sum m (2 phi' X' - phi'^2 e),  g = sum m X (2 phi' X' - phi'^2 e)

and a rod of transverse inertia J for J (cos^2 psi phi'' + 2 phi' cos psi (cos psi)') of yaw beside. The forces ahead at hinges
that are not on the ski's axis go with the hinges (base.py). Places are found from the base to the tips.
"""

from __future__ import annotations

from vlmb.core import scratch as c
from vlmb.core.jit import inner, kernel
from vlmb.core.segments import heading_of, length_below, lower_rate, place_on_parent, upper_motion, yaw_of
from vlmb.core.tree import ANCHOR, CENTRE, INERTIA, LENGTH, LINKS, MASS, PARENT, PLACE, ROD, TIP_MASS, Array, Tree
from vlmb.core.vectors import Pair, add_scaled2, dot, put_pair, row_pair

LEFT, LEFT_LEFT = 1, 3  # of a vector and of a symmetric matrix


@inner
def add_sideways(tree: Tree, y: Array, given: Array, rows: Array) -> None:
    """Add to what hangs on the base what all links ask for sideways."""
    yaw, n = yaw_of(tree, y), tree.shape[LINKS]
    for i in range(n):
        hinge, aside = hinge_ahead(tree, y, given, rows, i)
        slope, lower, growth = slope_of(tree, y, i), length_below(tree, y, given, i), lower_rate(tree, y, given, i)
        upper, upper_growth = upper_motion(tree, y, given, i)
        centre = point_ahead(hinge, slope, lower + tree.real[i, CENTRE], growth)
        tip = point_ahead(hinge, slope, lower + tree.real[i, LENGTH] + upper, growth + upper_growth)
        put_pair(rows, i, c.HINGE_AHEAD, hinge)
        put_pair(rows, i, c.TIP_AHEAD, tip)
        rows[i, c.ASIDE] = aside
        add_mass(rows, n, yaw, tree.real[i, MASS], centre, aside)
        add_mass(rows, n, yaw, tree.real[i, TIP_MASS], tip, aside)
        rows[n, c.TURN_SQUARE] += tree.real[i, INERTIA] * slope.one * slope.one
        rows[n, c.TURN_FORCE] += tree.real[i, INERTIA] * 2.0 * yaw * slope.one * slope.two


@kernel(inline=True)
def slope_of(tree: Tree, y: Array, i: int) -> Pair:
    """Read cos psi of a link and its rate: how far ahead a metre along it goes."""
    heading = heading_of(tree, y, i)
    return Pair(heading.d.x, heading.rate.x - dot(heading.d, heading.rate) * heading.d.x)


@kernel(inline=True)
def point_ahead(hinge: Pair, slope: Pair, far: float, growth: float) -> Pair:
    """Find X and X' of the point at `far` from a link's hinge, which grows with `growth`."""
    moved = add_scaled2(hinge, far, slope)
    return Pair(moved.one, moved.two + growth * slope.one)


@kernel(inline=True)
def hinge_ahead(tree: Tree, y: Array, given: Array, rows: Array, i: int) -> tuple[Pair, float]:
    """Find X and X' of a link's hinge, and how far to the left its plane is."""
    parent, zero = tree.link[i, PARENT], 0.0 * tree.real[i, ANCHOR]
    if parent < 0:
        return Pair(tree.real[i, ANCHOR], zero), tree.real[i, ANCHOR + 1]
    hinge = row_pair(rows, parent, c.TIP_AHEAD)
    if tree.link[i, PLACE] == ROD:
        far, growth = place_on_parent(tree, y, given, i), lower_rate(tree, y, given, parent)
        hinge = point_ahead(row_pair(rows, parent, c.HINGE_AHEAD), slope_of(tree, y, parent), far, growth)
    return hinge, rows[parent, c.ASIDE]


@kernel(inline=True)
def add_mass(rows: Array, n: int, yaw: float, mass: float, place: Pair, aside: float) -> None:
    """Add a point mass."""
    drift = mass * (2.0 * yaw * place.two - yaw * yaw * aside)
    rows[n, c.SUM + LEFT_LEFT] += mass
    rows[n, c.TURN_SUM + LEFT] += mass * place.one
    rows[n, c.TURN_SQUARE] += mass * place.one * place.one
    rows[n, c.FORCE + LEFT] += drift
    rows[n, c.TURN_FORCE] += drift * place.one
