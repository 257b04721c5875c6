"""Quintic smoothing splines of measured data, after Woltring.

The curve s makes

    sum_i (y_i - s(t_i))^2 + p integral s'''(t)^2 dt

least. Its third derivative is a sum of quadratic B-splines M_j over three intervals each, s''' = sum c_j M_j, so that with third
divided differences D, 6 D s = G c, G_jk = integral M_j M_k, and

    (G + 36 p D D') c = 6 D y,    s = y - 6 p D' c:

seven diagonals, a time that grows with the number of samples alone. p = 0 is the natural quintic interpolant. Samples much closer
than usual spoil the digits of D; they are taken as one, at their mean time and with their weight (then D W^-1 D' stands above).
Times are in mean spacings, so that p says how many samples the curve is smoothed over: half of the amplitude is left at the
angular frequency p^(-1/6) per sample.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from vlmb.core.banded import trace_of_solution
from vlmb.core.series import DEGREE, LOWEST, derivative

Array = NDArray[np.float64]

FEWEST, MANY = 6, 2000  # samples
WEAKEST, STRONGEST = -12.0, 11.0  # log10 of p: beyond, digits are lost
LOOKS = 47  # values of p that cross-validation looks at before it closes in on one
CLOSE = 1e-2  # of log10 p
CLOSEST = 0.5  # of the usual spacing: samples closer than that are taken as one
ROUNDING, TINY = 1e-6, 1e-25  # by which what grows with p may fall: relative, and of the square of the size
GOLDEN = 0.5 * (5.0**0.5 - 1.0)
GAUSS = np.polynomial.legendre.leggauss(3)


@dataclass(frozen=True, eq=False)
class Smooth:
    """A curve through samples: pieces (N, 7) as vlmb/core/series.py has them; how far it leaves them."""

    pieces: Array
    values: Array  # (N,) of the curve at the samples
    residual: float  # rms of the samples less the curve
    reach: float  # [s] over which the curve is smoothed: within it from an end, derivatives rest on one side alone
    strongest: bool  # it could not be smoothed more


def smoothed(t: Array, y: Array, sigma: float | None = None) -> Smooth:
    """Smooth samples y (N,) at ascending times t (N,), six at least.

    sigma: the rms residual that is wanted, 0 for a curve through all samples; None leaves it to generalized cross-validation,
    which takes the part of the samples that neighbours say nothing of for noise.
    """
    closest, found = CLOSEST, _smoothed(t, y, sigma, CLOSEST)
    while found.strongest and len(found.pieces) > MANY:  # more samples than digits can tell apart: some are taken together
        closest *= 8.0
        found = _smoothed(t, y, sigma, closest)
    return found


def _smoothed(t: Array, y: Array, sigma: float | None, closest: float) -> Smooth:
    """Smooth samples of which those nearer than a share of the usual spacing are taken as one."""
    times, means, weights = (t, y, np.ones(len(t))) if sigma == 0.0 else _merged(t, y, closest)
    spacing, level = (times[-1] - times[0]) / (len(times) - 1), float(y.mean())
    size = float(np.abs(y - level).max()) or 1.0
    problem = _Problem((times - times[0]) / spacing, (means - level) / size, weights)
    p = 0.0
    if sigma is None:
        p = 10.0 ** problem.cross_validated()
    elif sigma > 0.0:
        p = problem.with_square((sigma / size) ** 2)
    pieces = problem.pieces(*problem.solve(p))
    pieces[:, 0] = times
    pieces[:, 1:] *= size / spacing ** np.arange(6)
    pieces[:, 1] += level
    pieces[0, 1:] = [derivative(pieces, 0, float(t[0] - times[0]), k) / math.factorial(k) for k in range(6)]
    pieces[0, 0], pieces[-1, 0] = t[0], t[-1]
    values = evaluate(pieces, t)
    residual, reach = float(np.sqrt(np.mean((y - values) ** 2))), float(spacing * max(p, 1.0) ** (1.0 / 6.0))
    return Smooth(pieces, values, residual, reach, p > 10.0 ** (STRONGEST - 2.0 * CLOSE))


def evaluate(pieces: Array, times: Array, order: int = 0) -> Array:
    """Return a curve, or a derivative of it, (N,) at times (N,); beyond its ends the first and last piece go on."""
    at = np.clip(np.searchsorted(pieces[:-1, 0], times, side="right") - 1, 0, len(pieces) - 2)
    u, total = np.asarray(times) - pieces[at, 0], np.zeros(len(times))
    for k in range(DEGREE, order - 1, -1):
        total = total * u + float(np.prod(np.arange(k - order + 1, k + 1))) * pieces[at, LOWEST + k]
    return total


def _merged(t: Array, y: Array, closest: float) -> tuple[Array, Array, Array]:
    """Return mean times, mean values and numbers of samples, those within a share of the usual spacing taken together."""
    least = closest * float(np.median(np.diff(t)))
    if np.diff(t).min() >= least:
        return t, y, np.ones(len(t))
    group, begin, which = np.zeros(len(t), np.int64), t[0], 0
    for k, time in enumerate(t.tolist()):
        if time - begin >= least:
            begin, which = time, which + 1
        group[k] = which
    count = np.bincount(group).astype(float)
    return np.bincount(group, t) / count, np.bincount(group, y) / count, count


class _Problem:
    """The matrices of samples y (N,) at x (N,), in mean spacings, with weights (N,)."""

    def __init__(self, x: Array, y: Array, weights: Array) -> None:
        self.x, self.y, self.weights = x, y, weights
        self.knots = np.concatenate([x[0] - [2.0, 1.0], x, x[-1] + [1.0, 2.0]])  # those beyond the ends carry nothing
        self.d = _third_differences(x)
        self.gram, self.square = self._gram(), _squared(self.d, weights)
        self.wanted = 6.0 * _apply(self.d, y)

    def _third(self, u: Array) -> list[Array]:
        """Values of M_{i-2}, M_{i-1}, M_i at x_i + u of each interval i, 0 where there is none."""
        k, n = self.knots, len(self.x) - 1
        at = self.x[:-1] + u
        before, low, high, after = (k[1 + j : 1 + j + n] for j in range(4))  # x_{i-1} x_i x_{i+1} x_{i+2}
        h, left, right = high - low, high - before, after - low
        values = [
            (high - at) ** 2 / (left * h),
            (at - before) * (high - at) / (left * h) + (after - at) * (at - low) / (right * h),
            (at - low) ** 2 / (right * h),
        ]
        for which, part in enumerate(values):
            j = np.arange(n) + which - 2
            inside = (j >= 0) & (j < n - 2)
            span = self.x[np.clip(j + 3, 0, n)] - self.x[np.clip(j, 0, n)]
            part *= np.where(inside, 3.0, 0.0) / np.where(inside, span, 1.0)
        return values

    def _gram(self) -> Array:
        """Bands (4, N-3) of G, by Gauss's rule in each interval; the last is 0."""
        n, h = len(self.x) - 1, np.diff(self.x)
        bands = np.zeros((4, n + 4))  # column j + 2 is M_j
        for node, weight in zip(*GAUSS, strict=True):
            values = self._third(0.5 * (1.0 + node) * h)
            for first in range(3):
                for second in range(first, 3):
                    bands[second - first, first : first + n] += 0.5 * weight * h * values[first] * values[second]
        return np.ascontiguousarray(bands[:, 2 : n])

    def factor(self, p: float) -> Array:
        """Cholesky factor of G + 36 p D D', lower bands."""
        return np.asarray(scipy.linalg.cholesky_banded(self.gram + 36.0 * p * self.square, lower=True))

    def solve(self, p: float, factor: Array | None = None, refinements: int = 3) -> tuple[Array, Array]:
        """Return s at the samples (N,) and c (N-3,), made better with residuals in longer numbers."""
        factor = self.factor(p) if factor is None else factor
        long: Any = np.longdouble
        d, gram, c = self.d.astype(long), self.gram.astype(long), np.zeros(len(self.wanted), long)
        wanted = 6.0 * _apply(d, self.y.astype(long))
        for _ in range(1 + refinements):
            missing = wanted - _banded(gram, c) - 36.0 * p * _apply(d, _apply_back(d, c) / self.weights)
            c = c + scipy.linalg.cho_solve_banded((factor, True), missing.astype(float))
        return (self.y - 6.0 * p * _apply_back(d, c) / self.weights).astype(np.float64), c.astype(np.float64)

    def looked(self, exponent: float) -> tuple[float, float]:
        """Return the mean square of the residuals and the share of the samples' freedom that is left to them; nan: no digits."""
        p, n = 10.0**exponent, len(self.y)
        try:
            factor = self.factor(p)
        except scipy.linalg.LinAlgError:
            return math.nan, math.nan
        rest = 6.0 * p * _apply_back(self.d, scipy.linalg.cho_solve_banded((factor, True), self.wanted))
        share = 1.0 - (3.0 + trace_of_solution(factor, self.gram)) / n
        return (float(rest**2 @ (1.0 / self.weights)) / n, max(share, 1e-12)) if share <= 1.0 - 2.9 / n else (math.nan, math.nan)

    def cross_validated(self) -> float:
        """Return log10 p where mean square / share^2 is least."""

        def score(exponent: float) -> float:
            square, share = self.looked(exponent)
            return square / share**2

        grid, looks = self.sound()
        scores = [square / share**2 for square, share in looks]
        best = len(scores) - 1 - int(np.argmin(scores[::-1]))  # the smoothest of equals
        low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
        inner = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)]
        values = [score(exponent) for exponent in inner]
        while high - low > CLOSE:
            if values[0] < values[1]:
                high, inner[1], values[1] = inner[1], inner[0], values[0]
                inner[0] = high - GOLDEN * (high - low)
                values[0] = score(inner[0])
            else:
                low, inner[0], values[0] = inner[0], inner[1], values[1]
                inner[1] = low + GOLDEN * (high - low)
                values[1] = score(inner[1])
        return float(0.5 * (low + high))

    def sound(self) -> tuple[list[float], list[tuple[float, float]]]:
        """Look at values of log10 p in order, as far as digits last: residuals grow with p, and so does their freedom."""
        grid: list[float] = []
        looks: list[tuple[float, float]] = []
        for exponent in np.linspace(WEAKEST, STRONGEST, LOOKS).tolist():
            square, share = self.looked(exponent)
            if looks and not (square >= looks[-1][0] * (1.0 - ROUNDING) - TINY and share >= looks[-1][1] - ROUNDING):
                break
            grid.append(exponent)
            looks.append((square, share))
        return grid, looks

    def with_square(self, square: float) -> float:
        """Return the p under which the residuals have a mean square, or come nearest to it: they grow with p."""
        grid, looks = self.sound()
        low, high = grid[0], grid[-1]
        if looks[0][0] >= square:
            return 0.0
        if looks[-1][0] <= square:
            return float(10.0**high)
        while high - low > 0.1 * CLOSE:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.looked(middle)[0] < square else (low, middle)
        return float(10.0 ** (0.5 * (low + high)))

    def pieces(self, values: Array, c: Array) -> Array:
        """Return the polynomials (N, 7) of a curve with these values at the samples and this third derivative."""
        n, h = len(self.x) - 1, np.diff(self.x)
        padded = np.concatenate([np.zeros(2), c, np.zeros(2)])
        start, middle, end = (
            sum(padded[k : k + n] * part for k, part in enumerate(self._third(share * h))) for share in (0.0, 0.5, 1.0)
        )
        slope, bend = (4.0 * middle - 3.0 * start - end) / h, 2.0 * (start - 2.0 * middle + end) / h**2  # of s'''
        third = start, slope, bend

        def rise(k: int, order: int) -> Array:
            """Integral of s''' over its interval, `order` + 1 times."""
            a, b, q = third
            weights = ((1.0, 1 / 2, 1 / 3), (1 / 2, 1 / 6, 1 / 12), (1 / 6, 1 / 24, 1 / 60))[order]
            return weights[0] * a * h ** (order + 1) + weights[1] * b * h ** (order + 2) + weights[2] * q * h ** (order + 3)

        change = np.diff(values) - rise(0, 2)  # s' h + s'' h^2 / 2 with what holds where an interval begins
        # at an inner sample: ahead s' h + s'' h^2 / 2, behind s' k - s'' k^2 / 2, with s', s'' carried over the interval behind
        ahead, behind = change[1:], change[:-1]
        back, front = h[:-1], h[1:]
        behind = behind + rise(0, 1)[:-1] * back - 0.5 * rise(0, 0)[:-1] * back**2
        second = 2.0 * (ahead / front - behind / back) / (front + back)
        first = behind / back + 0.5 * second * back
        begin = np.array([second[0] - rise(0, 0)[0]])
        begin_rate = first[0] - begin[0] * h[0] - rise(0, 1)[0]
        second, first = np.concatenate([begin, second]), np.concatenate([[begin_rate], first])
        rows = np.zeros((n + 1, 7))
        rows[:-1, 1:] = np.column_stack([values[:-1], first, 0.5 * second, start / 6.0, slope / 24.0, bend / 60.0])
        return rows


def _third_differences(x: Array) -> Array:
    """Return D (4, N-3): divided differences f[x_j ... x_{j+3}] are the sums of D_kj f_{j+k}."""
    n = len(x) - 3
    parts = [x[k : k + n] for k in range(4)]
    return np.array([1.0 / np.prod([parts[k] - parts[j] for j in range(4) if j != k], axis=0) for k in range(4)])


def _apply(d: Array, y: Array) -> Array:
    n = d.shape[1]
    total: Array = sum(d[k] * y[k : k + n] for k in range(4))
    return total


def _apply_back(d: Array, c: Array) -> Array:
    out = np.zeros(len(c) + 3, c.dtype)
    for k in range(4):
        out[k : k + len(c)] += d[k] * c
    return out


def _squared(d: Array, weights: Array) -> Array:
    """Bands (4, N-3) of D W^-1 D'."""
    n = d.shape[1]
    bands = np.zeros((4, n))
    for k in range(min(4, n)):
        bands[k, : n - k] = sum(d[j, : n - k] * d[j - k, k:] / weights[j : j + n - k] for j in range(k, 4))
    return bands


def _banded(bands: Array, c: Array) -> Array:
    """Return the product of a symmetric matrix by its lower bands."""
    out: Array = bands[0] * c
    for k in range(1, min(4, len(c))):
        out[k:] += bands[k, : len(c) - k] * c[: len(c) - k]
        out[: len(c) - k] += bands[k, : len(c) - k] * c[k:]
    return out
