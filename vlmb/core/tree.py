"""The arrays of a mechanism: links in a tree on a base, parents first."""

from __future__ import annotations

from typing import NamedTuple

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


class Tree(NamedTuple):
    """Constants of a mechanism; units m, kg, s, N."""

    shape: Integers  # (4,) base kind, positions, velocities, links
    base: Array  # (6,) mass, inertia about the vertical through its centre, centre ahead of A, gravity (3)
    link: Integers  # (n, 8)
    real: Array  # (n, 16)
