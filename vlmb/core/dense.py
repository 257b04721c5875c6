"""Small dense systems of rows and controls: Cholesky and elimination with their pivots watched, least norms, least squares.

Matrices stand in the first rows and columns of tables, their sizes are given. Right sides are carried along, so that nothing of
a factorization need be kept.
"""

from __future__ import annotations

from vlmb.core.jit import inner, kernel
from vlmb.core.scalars import finite, sqrt
from vlmb.core.tree import Array

SWEEPS = 40
ORTHOGONAL = 1e-15  # cosine of two rows below which they are orthogonal
LOST = 1e-14  # of the longest row: a shorter one is rounding


# Symmetric, and square


@kernel
def cholesky(a: Array, n: int, repeated: float) -> bool:
    """Overwrite the lower triangle of a symmetric A (n, n) with L, A = L L^T.

    False where a pivot is not above `repeated` times its own diagonal entry.
    """
    for i in range(n):
        own = a[i, i]
        for j in range(i):
            for k in range(j):
                a[i, j] -= a[i, k] * a[j, k]
            a[i, j] /= a[j, j]
        pivot = own
        for k in range(i):
            pivot -= a[i, k] * a[i, k]
        if not pivot > repeated * own:
            return False
        a[i, i] = sqrt(pivot)
    return True


@kernel
def solve_cholesky(a: Array, n: int, b: Array, m: int) -> None:
    """Overwrite B (n, m) with A^-1 B by the factor of A."""
    for column in range(m):
        for i in range(n):
            for k in range(i):
                b[i, column] -= a[i, k] * b[k, column]
            b[i, column] /= a[i, i]
        for i in range(n - 1, -1, -1):
            for k in range(i + 1, n):
                b[i, column] -= a[k, i] * b[k, column]
            b[i, column] /= a[i, i]


@kernel
def eliminate(a: Array, n: int, x: Array) -> float:
    """Bring A (n, n) to an upper triangle by Gauss with row pivots, and x (n,) with it; return the sign of det A."""
    sign = 1.0
    for i in range(n):
        best = i
        for row in range(i + 1, n):
            if abs(a[row, i]) > abs(a[best, i]):
                best = row
        if best != i:
            sign = -sign
            x[i], x[best] = x[best], x[i]
            for column in range(i, n):
                a[i, column], a[best, column] = a[best, column], a[i, column]
        if a[i, i] == 0.0:
            return 0.0
        if a[i, i] < 0.0:
            sign = -sign
        inverse = 1.0 / a[i, i]
        for row in range(i + 1, n):
            share = inverse * a[row, i]
            x[row] -= share * x[i]
            for column in range(i + 1, n):
                a[row, column] -= share * a[i, column]
    return sign


@kernel
def solve_upper(a: Array, n: int, x: Array) -> None:
    """Overwrite x (n,) with the solution of the triangle that `eliminate` leaves."""
    for i in range(n - 1, -1, -1):
        for column in range(i + 1, n):
            x[i] -= a[i, column] * x[column]
        x[i] /= a[i, i]


@inner
def solve_square(a: Array, n: int, b: Array, m: int, repeated: float) -> bool:
    """Overwrite B (n, m) with A^-1 B, A (n, n), overwritten, by Gauss with row pivots.

    False where a pivot is not above `repeated` times the largest entry of A.
    """
    bound = repeated * largest_entry(a, n, n)
    for i in range(n):
        best = i
        for row in range(i + 1, n):
            if abs(a[row, i]) > abs(a[best, i]):
                best = row
        if not abs(a[best, i]) > bound:
            return False
        if best != i:
            for column in range(n):
                a[i, column], a[best, column] = a[best, column], a[i, column]
            for column in range(m):
                b[i, column], b[best, column] = b[best, column], b[i, column]
        for row in range(i + 1, n):
            share = a[row, i] / a[i, i]
            for column in range(i, n):
                a[row, column] -= share * a[i, column]
            for column in range(m):
                b[row, column] -= share * b[i, column]
    for column in range(m):
        for i in range(n - 1, -1, -1):
            for k in range(i + 1, n):
                b[i, column] -= a[i, k] * b[k, column]
            b[i, column] /= a[i, i]
    return True


# Of more columns than rows


@kernel
def reflect(a: Array, rows: int, count: int, n: int, sizes: Array) -> None:
    """Bring the first `count` <= n rows of A (rows, n) to a lower triangle by Householder's reflections from the right.

    What is below the diagonal stays there, the diagonal goes to sizes (count,); the vectors of the reflections, of length
    sqrt(2), stand on and above it. The other rows are reflected as well.
    """
    for i in range(count):
        square = 0.0
        for k in range(i, n):
            square += a[i, k] * a[i, k]
        length = sqrt(square)
        sizes[i] = -length if a[i, i] >= 0.0 else length
        if length > 0.0:
            shrink = 1.0 / sqrt(length * (length + abs(a[i, i])))
            a[i, i] -= sizes[i]
            for k in range(i, n):
                a[i, k] *= shrink
        for row in range(i + 1, rows):
            share = 0.0
            for k in range(i, n):
                share += a[row, k] * a[i, k]
            for k in range(i, n):
                a[row, k] -= share * a[i, k]


@kernel
def reflect_back(a: Array, count: int, n: int, x: Array) -> None:
    """Take x (n,) back through the reflections that `reflect` has left."""
    for i in range(count - 1, -1, -1):
        share = 0.0
        for k in range(i, n):
            share += a[i, k] * x[k]
        for k in range(i, n):
            x[k] -= share * a[i, k]


@kernel
def solve_lower(a: Array, count: int, sizes: Array, x: Array) -> None:
    """Overwrite x (count,) with the solution of the triangle that `reflect` has left."""
    for i in range(count):
        for k in range(i):
            x[i] -= a[i, k] * x[k]
        x[i] /= sizes[i]


@kernel
def largest_entry(a: Array, rows: int, columns: int) -> float:
    """Return the largest absolute value in a matrix."""
    largest = 0.0
    for i in range(rows):
        for j in range(columns):
            largest = max(largest, abs(a[i, j]))
    return largest


@kernel
def pivots_hold(pivots: Array, count: int, bound: float) -> bool:
    """Tell whether all pivots are finite and larger than a bound.

    The bound is of the size of the matrix: pivots of a column of zeros may be zeros all, and of one size.
    """
    held = True
    for k in range(count):
        held = held and finite(pivots[k]) and abs(pivots[k]) > bound
    return held


# Of any rank


@inner
def row_product(a: Array, i: int, j: int, n: int) -> float:
    """Return the product of two rows."""
    total = 0.0
    for k in range(n):
        total += a[i, k] * a[j, k]
    return total


@inner
def turn_rows(a: Array, i: int, j: int, n: int, cosine: float, sine: float) -> None:
    """Turn two rows into each other."""
    for k in range(n):
        a[i, k], a[j, k] = cosine * a[i, k] - sine * a[j, k], sine * a[i, k] + cosine * a[j, k]


@inner
def make_orthogonal(a: Array, m: int, n: int, b: Array, columns: int) -> None:
    """Turn the rows of A (m, n), and those of B (m, columns) with them, until A's are orthogonal (Jacobi).

    Their lengths are A's singular values then, in no order.
    """
    largest = 0.0
    for i in range(m):
        largest = max(largest, row_product(a, i, i, n))
    turned = True
    for _ in range(SWEEPS):
        if not turned:
            break
        turned = False
        for i in range(m):
            for j in range(i + 1, m):
                first, second, both = row_product(a, i, i, n), row_product(a, j, j, n), row_product(a, i, j, n)
                if min(first, second) > LOST * LOST * largest and abs(both) > ORTHOGONAL * sqrt(first * second):
                    slope = (second - first) / (2.0 * both)
                    tangent = (1.0 if slope >= 0.0 else -1.0) / (abs(slope) + sqrt(1.0 + slope * slope))
                    cosine = 1.0 / sqrt(1.0 + tangent * tangent)
                    turn_rows(a, i, j, n, cosine, cosine * tangent)
                    turn_rows(b, i, j, columns, cosine, cosine * tangent)
                    turned = True


@kernel
def least_squares(a: Array, m: int, n: int, b: Array, columns: int, cut: float, x: Array) -> None:
    """Write into X (n, columns) the least X with the least squares of A X - B, A (m, n), B (m, columns), both overwritten.

    Singular values up to `cut` of the largest count as 0.
    """
    make_orthogonal(a, m, n, b, columns)
    largest = 0.0
    for i in range(m):
        largest = max(largest, row_product(a, i, i, n))
    for j in range(n):
        for column in range(columns):
            x[j, column] = 0.0
    for i in range(m):
        square = row_product(a, i, i, n)
        if square > cut * cut * largest:
            for j in range(n):
                for column in range(columns):
                    x[j, column] += a[i, j] * (b[i, column] / square)


@kernel
def condition_of(a: Array, m: int, n: int) -> float:
    """Return the largest over the smallest singular value of A (m, n), m <= n, which is overwritten."""
    make_orthogonal(a, m, n, a, 0)
    largest = smallest = row_product(a, 0, 0, n)
    for i in range(m):
        square = row_product(a, i, i, n)
        largest, smallest = max(largest, square), min(smallest, square)
    return sqrt(largest / smallest) if smallest > 0.0 else float("inf")


@kernel
def least_singular(a: Array, m: int, n: int, cut: float) -> float:
    """Return the least singular value of A (m, n), m <= n, above `cut` of the largest; A is overwritten."""
    make_orthogonal(a, m, n, a, 0)
    largest = 0.0
    for i in range(m):
        largest = max(largest, row_product(a, i, i, n))
    least = largest
    for i in range(m):
        square = row_product(a, i, i, n)
        if square > cut * cut * largest:
            least = min(least, square)
    return sqrt(least)
