"""The arrays of a mechanism: links in a tree on a base, parents first."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

PIVOT, FREE, SKI, SLIDING = range(4)  # kinds of a base; SKI has its knife edge reduced, SLIDING may move sideways
TIP, ROD = range(2)  # where a link hangs on its parent
BASE_KIND, POSITIONS, VELOCITIES, LINKS = range(4)  # columns of `shape`
BASE_MASS, BASE_INERTIA, COM_OFFSET, GRAVITY = range(4)  # columns of `base`; gravity takes three
PARENT, PLACE, AT_P, AT_V, LOWER_FREE, UPPER_FREE, ROD_CHILDREN, TIP_LOAD = range(8)  # columns of `link`
LENGTH, MASS, CENTRE, INERTIA, TIP_MASS, K1, REST1, C1, K2, REST2, C2, ON_ROD, ANCHOR = range(13)  # of `real`; the last takes three
LOWER, LOWER_RATE, LOWER_SECOND, UPPER, UPPER_RATE, UPPER_SECOND = range(6)  # columns of given lengths

# What may be wrong with an evaluation: a code is fault * PLACES + link, the link being the number of links for the base.
PLACES = 1 << 24
FREE_TIP = 1  # a free segment moves the link's tip, or its rod and tip, along the link without inertia
FREE_ROD = 2  # the rod slides between two free segments without inertia
TURNING = 3  # the link turns about its hinge without inertia
FREE_BASE = 4  # the base moves in some direction without inertia
NO_DIRECTION = 5  # the direction of the link has length 0 or is not finite
TINY = 1e-13  # an inertia below this part of those beside it is none


class Tree(NamedTuple):
    """Constants of a mechanism; units m, kg, s, N."""

    shape: Integers  # (4,) base kind, positions, velocities, links
    base: Array  # (6,) mass, inertia about the vertical through its centre, centre ahead of A, gravity (3)
    link: Integers  # (n, 8)
    real: Array  # (n, 16)


class Scratch(NamedTuple):
    """What an evaluation leaves behind, a row a link; `accelerate` fills it, `respond` reads the factors."""

    tips: Array  # (n, 9) what hangs at the tip asks for the force A a + f there: A (xx xy xz yy yz zz), f
    rods: Array  # (n, 24) children on the rod, with r from the hinge: sums of A, r A, r^2 A, f, r f
    ground: Array  # (1, 24) the same for the base, and how it moves: columns in base.py
    factors: Array  # (n, 28) columns in plain.py and rods.py
    loads: Array  # (n, 16) columns in plain.py and rods.py
    biases: Array  # (n, 10) columns in links.py
    moves: Array  # (n, 9) accelerations less gravity's: tip, the rod's origin at the hinge; and w - |u|^2 d
    axial: Array  # (n, 2) forces [N] that given segments take, lower and upper


def make_scratch(tree: Tree, dtype: Any = np.float64) -> Scratch:
    """Make the buffers of one thread."""
    n = len(tree.link)
    sizes = [(n, 9), (n, 24), (1, 24), (n, 28), (n, 16), (n, 10), (n, 9), (n, 2)]
    return Scratch(*(np.zeros(size, dtype) for size in sizes))
