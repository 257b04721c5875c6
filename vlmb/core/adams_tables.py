"""Coefficients of Adams methods."""

from __future__ import annotations

import numpy as np

from vlmb.core.lanes import LANES

HIGHEST = 12  # order


def _moulton(count: int) -> list[float]:
    """|gamma*_i|, i = 1 ... count, by gamma*_i = -sum_{j < i} gamma*_j / (i - j + 1), gamma*_0 = 1: the error of order i."""
    gamma = [1.0]
    for i in range(1, count + 1):
        gamma.append(-sum(g / (i - j + 1) for j, g in enumerate(gamma)))
    return [abs(g) for g in gamma[1:]]


ERROR_CONSTANTS = np.array([0.0, *_moulton(HIGHEST + 1)])  # 0, 1/2, 1/12, 1/24, 19/720, ... by order of the predictor
POWERS_OF_TWO = 2.0 ** np.arange(HIGHEST + 2)  # by order

# of Gauss' rule over 0 ... 1, four numbers wide: exact to degree 15, where products for order HIGHEST are of degree 12
_nodes, _weights = np.polynomial.legendre.leggauss(2 * LANES)
NODES, WEIGHTS = 0.5 * (1.0 + _nodes).reshape(2, LANES), 0.5 * _weights.reshape(2, LANES)
