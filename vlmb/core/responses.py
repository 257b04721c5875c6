"""What controls and multipliers bring: each by its forces alone, LANES of them at a time."""

from __future__ import annotations

from vlmb.core import tree as of
from vlmb.core.jit import inner, kernel
from vlmb.core.lanes import LANES, side_by_side, wide
from vlmb.core.links import respond
from vlmb.core.row_arrays import Sizes, Space
from vlmb.core.scratch import GROUND, Lanes, Scratch
from vlmb.core.tree import Array, Tree


@kernel(copied=True)
def write_moved(sizes: Sizes, space: Space, lanes: Lanes, tree: Tree, dy: Array, scratch: Scratch) -> None:
    """Write what every control and every multiplier adds to all accelerations, and to those of the rows; and what these lack."""
    count, first, turned = sizes.controls + sizes.ideal, tree.shape[of.POSITIONS], space.turned
    axes = 3 if tree.shape[of.BASE_KIND] == of.PLANTED else 0
    for j in range(turned.shape[0]):
        turned[j, count] = dy[first + j]
    for axis in range(axes):
        space.ground[axis, count] = scratch.rows[tree.shape[of.LINKS], GROUND + axis]
    for begin in range(0, count, LANES):
        fill_lanes(sizes, space, begin, count - 1, wide(lanes.moved))
        respond(tree, scratch, lanes)
        for k in range(begin, min(begin + LANES, count)):
            for j in range(turned.shape[0]):
                turned[j, k] = space.answers[k, j] = lanes.moved[j, k - begin]
            for axis in range(axes):
                space.ground[axis, k] = lanes.loads[tree.shape[of.LINKS], GROUND + axis, k - begin]
    for i in range(sizes.ideal + sizes.beyond):
        line, moved = space.lines[i], space.moved[i]
        for k in range(count + 1):
            moved[k] = 0.0
        for j in range(line.shape[0]):
            share = line[j]
            if share != 0.0:  # rows name few velocities
                for k in range(count + 1):
                    moved[k] += share * turned[j, k]
        space.wanted[i] -= moved[count]


@kernel(copied=True)
def fill_lanes(sizes: Sizes, space: Space, begin: int, last: int, moved: Array) -> None:
    """Write what the controls and multipliers from `begin` on push on; the last one again where there are no more."""
    one, two = pushed_by(sizes, space, begin), pushed_by(sizes, space, min(begin + 1, last))
    three, four = pushed_by(sizes, space, min(begin + 2, last)), pushed_by(sizes, space, min(begin + 3, last))
    for j in range(one.shape[0]):
        moved[j] = side_by_side(one[j], two[j], three[j], four[j])


@kernel(copied=True)
def pushed_by(sizes: Sizes, space: Space, k: int) -> Array:
    """Return the generalized forces of control k, or of a multiplier beyond the controls."""
    return space.columns[k] if k < sizes.controls else space.pushes[k - sizes.controls]


@inner
def write_ground(sizes: Sizes, space: Space, tree: Tree, scratch: Scratch) -> None:
    """Write the force of the ground on a planted base with what controls and multipliers bring."""
    count = sizes.controls + sizes.ideal
    for axis in range(3):
        total = space.ground[axis, count]
        for k in range(count):
            total += space.shares[k] * space.ground[axis, k]
        scratch.rows[tree.shape[of.LINKS], GROUND + axis] = total
