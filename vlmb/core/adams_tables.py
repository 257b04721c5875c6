"""Coefficients of Adams methods."""

from __future__ import annotations

import numpy as np

HIGHEST = 12  # order


def _moulton(count: int) -> list[float]:
    """|gamma*_i|, i = 1 ... count, by gamma*_i = -sum_{j < i} gamma*_j / (i - j + 1), gamma*_0 = 1: the error of order i."""
    gamma = [1.0]
    for i in range(1, count + 1):
        gamma.append(-sum(g / (i - j + 1) for j, g in enumerate(gamma)))
    return [abs(g) for g in gamma[1:]]


ERROR_CONSTANTS = np.array([0.0, *_moulton(HIGHEST + 1)])  # 0, 1/2, 1/12, 1/24, 19/720, ... by order of the predictor
POWERS_OF_TWO = 2.0 ** np.arange(HIGHEST + 2)  # by order
