"""What dampers of free segments lose."""

from __future__ import annotations

from vlmb.core import tree as of
from vlmb.core.jit import kernel
from vlmb.core.tree import Array, Tree


@kernel(inline=True)
def segment_losses(tree: Tree, y: Array) -> float:
    """Return the power lost in the dampers of free segments, the sum of c a'^2 [W]."""
    lost = 0.0
    for i in range(tree.shape[of.LINKS]):
        at = tree.shape[of.POSITIONS] + tree.link[i, of.AT_V] + 3
        if tree.link[i, of.LOWER_FREE] != 0:
            lost += tree.real[i, of.C1] * y[at] * y[at]
            at += 1
        if tree.link[i, of.UPPER_FREE] != 0:
            lost += tree.real[i, of.C2] * y[at] * y[at]
    return lost
