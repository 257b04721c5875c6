"""Parts of the inverse of a banded matrix in time that grows with its size alone."""

from __future__ import annotations

import numpy as np

from vlmb.core.jit import kernel
from vlmb.core.tree import Array

BAND = 3


def trace_of_solution(factor: Array, bands: Array) -> float:
    """Return the trace of A^-1 G of symmetric matrices of bandwidth 3 (4, n): of A the factor L (A = L L'), of G the bands.

    Lower form: row k holds what stands k below the diagonal.
    """
    return float(sum_of_products(factor, bands, np.zeros((bands.shape[1] + BAND, BAND + 1))))


@kernel
def sum_of_products(factor: Array, bands: Array, inverse: Array) -> float:
    """Write the band of A^-1 into `inverse` (n + 3, 4), from the last row up, and sum its products with the bands of G.

    With l = L / diag L: Z_ij = [i = j] / L_ii^2 - sum_k l_ki Z_kj.
    """
    n, total = bands.shape[1], 0.0
    for i in range(n - 1, -1, -1):
        share = 1.0 / factor[0, i]
        for j in range(BAND, -1, -1):
            value = share * share if j == 0 else 0.0
            for k in range(1, BAND + 1):
                if i + k < n:
                    near = inverse[i + k, j - k] if j >= k else inverse[i + j, k - j]
                    value -= share * factor[k, i] * near
            inverse[i, j] = value if i + j < n else 0.0
            if i + j < n:
                total += (1.0 if j == 0 else 2.0) * value * bands[j, i]
    return total
