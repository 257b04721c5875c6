"""Small dense linear systems, real and complex, by Gauss with row pivots; a complex matrix is two real ones."""

from __future__ import annotations

from vlmb.core.driver import Array, Integers
from vlmb.core.jit import kernel


@kernel
def factor(a: Array, pivots: Integers) -> None:
    """Overwrite A (n, n) with its factors L and U, P A = L U; row i was exchanged with row pivots[i]."""
    n = a.shape[0]
    for i in range(n):
        best = i
        for row in range(i + 1, n):
            if abs(a[row, i]) > abs(a[best, i]):
                best = row
        pivots[i] = best
        if best != i:
            for column in range(n):
                a[i, column], a[best, column] = a[best, column], a[i, column]
        for row in range(i + 1, n):
            share = a[row, i] / a[i, i]
            a[row, i] = share
            for column in range(i + 1, n):
                a[row, column] -= share * a[i, column]


@kernel
def solve(a: Array, pivots: Integers, x: Array) -> None:
    """Overwrite x (n,), the right-hand side, with A^-1 x by the factors of A."""
    n = a.shape[0]
    for i in range(n):
        best = pivots[i]
        x[i], x[best] = x[best], x[i]
    for i in range(n):
        for column in range(i):
            x[i] -= a[i, column] * x[column]
    for i in range(n - 1, -1, -1):
        for column in range(i + 1, n):
            x[i] -= a[i, column] * x[column]
        x[i] /= a[i, i]


@kernel
def factor_complex(re: Array, im: Array, pivots: Integers) -> None:
    """The same for A = re + i im."""
    n = re.shape[0]
    for i in range(n):
        best = i
        for row in range(i + 1, n):
            if re[row, i] ** 2 + im[row, i] ** 2 > re[best, i] ** 2 + im[best, i] ** 2:
                best = row
        pivots[i] = best
        if best != i:
            for column in range(n):
                re[i, column], re[best, column] = re[best, column], re[i, column]
                im[i, column], im[best, column] = im[best, column], im[i, column]
        size = re[i, i] ** 2 + im[i, i] ** 2
        for row in range(i + 1, n):
            p = (re[row, i] * re[i, i] + im[row, i] * im[i, i]) / size
            q = (im[row, i] * re[i, i] - re[row, i] * im[i, i]) / size
            re[row, i] = p
            im[row, i] = q
            for column in range(i + 1, n):
                re[row, column] -= p * re[i, column] - q * im[i, column]
                im[row, column] -= p * im[i, column] + q * re[i, column]


@kernel
def solve_complex(re: Array, im: Array, pivots: Integers, x: Array, z: Array) -> None:
    """Overwrite x + i z with A^-1 (x + i z)."""
    n = re.shape[0]
    for i in range(n):
        best = pivots[i]
        x[i], x[best] = x[best], x[i]
        z[i], z[best] = z[best], z[i]
    for i in range(n):
        for column in range(i):
            x[i] -= re[i, column] * x[column] - im[i, column] * z[column]
            z[i] -= re[i, column] * z[column] + im[i, column] * x[column]
    for i in range(n - 1, -1, -1):
        for column in range(i + 1, n):
            x[i] -= re[i, column] * x[column] - im[i, column] * z[column]
            z[i] -= re[i, column] * z[column] + im[i, column] * x[column]
        size = re[i, i] ** 2 + im[i, i] ** 2
        p = (x[i] * re[i, i] + z[i] * im[i, i]) / size
        z[i] = (z[i] * re[i, i] - x[i] * im[i, i]) / size
        x[i] = p
