r"""Accelerations of a tree of links: forces inwards from the tips to the base, accelerations back outwards.

What hangs on a hinge asks for the force A a + f there when the hinge accelerates with a (less gravity's). A link takes what its
tip and its rod carry into its own axes, adds itself (plain.py, rods.py) and hands A and f to its parent or to the base
(inwards.py, base.py). Once the base's acceleration is known, the links find theirs (outwards.py). The cost is linear in the
number of links.

A direction d need not have length 1 nor its rate u be across it: the motion is evaluated with d^ = d / |d| and
u^ = u - (u . d^) d^, and given the rates

    d' = |d| u^,   u' = w - |u^|^2 d^ + (u . d^) u^

so that d^ and u^ obey the true equations whatever |d| and u . d are, and errors of these two do not grow.

Links that stay in upright planes along a ski have d and u in its frame, and all vectors are in that frame. Along the plane such a
link moves as any other: with psi its elevation, d'' has in the plane the parts

    along d   -(psi'^2 + phi0'^2 cos^2 psi),     across it   w = psi'' + phi0'^2 sin psi cos psi

so that only |u|^2 is another; in the frame of the ski d'' has phi0'^2 cos psi more ahead. No force of the plane goes sideways:
what the links ask for there is the base's own (sideways.py).
"""

from __future__ import annotations

from vlmb.core import base
from vlmb.core.inwards import gather, gather_force
from vlmb.core.jit import kernel
from vlmb.core.lanes import wide
from vlmb.core.outwards import spread, spread_force
from vlmb.core.scratch import Lanes, Scratch, clear, clear_forces
from vlmb.core.sideways import add_sideways
from vlmb.core.tree import LINKS, PLACES, POSITIONS, UPRIGHT, Array, Tree


@kernel
def accelerate(tree: Tree, y: Array, given: Array, force: Array, dy: Array, scratch: Scratch) -> int:
    """Write the rates of positions and velocities at (y, given) under generalized forces, springs and weight; returns a code.

    y, dy (at least positions + velocities,); given (n, 6) [m, m/s, m/s^2]; force (velocities,) conjugate to the velocities: on
    u a vector, whose part along d does nothing; in upright planes it has no part sideways. Code 0, or fault * PLACES + link; the
    link is n for the base.
    """
    return accelerate_here(tree, y, given, force, dy, scratch)


@kernel(inline=True)
def accelerate_here(tree: Tree, y: Array, given: Array, force: Array, dy: Array, scratch: Scratch) -> int:
    """The same as a part of the caller: to hand over the arrays takes as long as a seventh of what one link takes."""
    n, rows = tree.shape[LINKS], scratch.rows
    clear(tree, rows)
    base.face(tree, y, rows)
    for i in range(n - 1, -1, -1):
        fault = gather(tree, y, given, force, rows, i)
        if fault != 0:
            return fault * PLACES + i
    if tree.shape[UPRIGHT] != 0:
        add_sideways(tree, y, given, rows)
    fault = base.move_base(tree, base.base_bias(tree, y, rows), force, dy, tree.shape[POSITIONS], rows, rows)
    if fault != 0:
        return fault * PLACES + n
    base.drive_base(tree, y, dy, rows)
    for i in range(n):
        spread(tree, y, dy, rows, i)
    return 0


@kernel
def respond(tree: Tree, scratch: Scratch, lanes: Lanes) -> int:
    """Write what generalized forces alone add to the accelerations, M^-1 Q, where `accelerate` was last; returns a code.

    lanes.moved (velocities, LANES): forces, LANES at a time, and in their place what they add; given segments do not accelerate.
    """
    n, rows, loads, moved = tree.shape[LINKS], scratch.rows, wide(lanes.loads), wide(lanes.moved)
    clear_forces(tree, loads)
    for i in range(n - 1, -1, -1):
        gather_force(tree, moved, rows, loads, i)
    fault = base.move_base(tree, base.no_bias(tree), moved, moved, 0, rows, loads)
    for i in range(n):
        spread_force(tree, moved, rows, loads, i)
    return fault * PLACES + n if fault != 0 else 0
