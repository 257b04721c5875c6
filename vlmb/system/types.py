"""Types that files of this folder share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rhs = Callable[[float, Array], Array]
