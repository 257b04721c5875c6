"""The arrays of a mechanism: links in a tree on a base, parents first."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# Kinds of a base. PLANTED: a free one whose point a contact holds; SKI: knife edge reduced; SLIDING: sideways; LIFTED: up, too
PIVOT, FREE, PLANTED, SKI, SLIDING, LIFTED = range(6)
TIP, ROD = range(2)  # where a link hangs on its parent
BASE_KIND, POSITIONS, VELOCITIES, LINKS, UPRIGHT, FLAT = range(6)  # columns of `shape`; see Tree
BASE_MASS, BASE_INERTIA, COM_OFFSET, GRAVITY = range(4)  # columns of `base`; gravity takes three
PARENT, PLACE, AT_P, AT_V, LOWER_FREE, UPPER_FREE, ROD_CHILDREN, TIP_LOAD = range(8)  # columns of `link`
# Columns of `real`; anchors take three, those of a link on another are 0, aside, 0
LENGTH, MASS, CENTRE, INERTIA, TIP_MASS, K1, REST1, C1, K2, REST2, C2, ON_ROD, ANCHOR = range(13)
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
    """Constants of a mechanism; units m, kg, s, N.

    UPRIGHT is 1 where the links of a ski stay in upright planes along its heading. Their directions and rates are then given in
    the frame of the ski, ahead, to the left (always 0) and up; else in the surface frame. FLAT is 1 where those of a pivot or a
    free base stay in a plane: what pushes them sideways, the plane carries.
    """

    shape: Integers  # (6,) base kind, positions, velocities, links, UPRIGHT, FLAT
    base: Array  # (6,) mass, inertia about the vertical through its centre, centre ahead of A, gravity (3)
    link: Integers  # (n, 8)
    real: Array  # (n, 16)
