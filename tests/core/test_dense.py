"""Small dense systems beside numpy's."""

from __future__ import annotations

import numpy as np
import pytest

from vlmb.core.dense import (
    cholesky,
    condition_of,
    eliminate,
    largest_entry,
    least_singular,
    least_squares,
    pivots_hold,
    reflect,
    reflect_back,
    solve_cholesky,
    solve_lower,
    solve_upper,
)  # fmt: skip

SIZES = (1, 2, 3, 5, 9)
ROOM = 3  # rows and columns of a table beyond a matrix


def roomy(a: np.ndarray) -> np.ndarray:
    """A matrix in the corner of a larger table, whose rest must not matter."""
    out = np.full((a.shape[0] + ROOM, a.shape[1] + ROOM), np.nan)
    out[: a.shape[0], : a.shape[1]] = a
    return out


@pytest.mark.parametrize("n", SIZES)
def test_symmetric_systems(n: int) -> None:
    random = np.random.default_rng(n)
    half, b = random.normal(size=(n, n + 1)), random.normal(size=(n, 3))
    a = half @ half.T
    factor, x = roomy(a), roomy(b)
    assert cholesky(factor, n, 1e-12)
    solve_cholesky(factor, n, x, 3)
    np.testing.assert_allclose(x[:n, :3], np.linalg.solve(a, b), rtol=1e-8)


@pytest.mark.parametrize("n", SIZES[1:])
def test_rows_that_repeat_each_other_have_no_cholesky(n: int) -> None:
    half = np.random.default_rng(n).normal(size=(n, n + 1))
    half[-1] = half[:-1].sum(axis=0)
    assert not cholesky(half @ half.T, n, 1e-12)
    assert not cholesky(np.full((n, n), np.nan), n, 1e-12)


@pytest.mark.parametrize("n", SIZES)
@pytest.mark.parametrize("seed", range(4))
def test_square_systems_and_the_sign_of_their_determinant(n: int, seed: int) -> None:
    random = np.random.default_rng([n, seed])
    a, b = random.normal(size=(n, n)), random.normal(size=n)
    triangle, x = roomy(a), b.copy()
    assert eliminate(triangle, n, x) == np.sign(np.linalg.det(a))
    solve_upper(triangle, n, x)
    np.testing.assert_allclose(x, np.linalg.solve(a, b), rtol=1e-9)
    assert eliminate(np.zeros((n, n)), n, b) == 0.0


@pytest.mark.parametrize(("rows", "columns"), [(1, 2), (2, 5), (4, 5), (3, 3)])
def test_least_norms(rows: int, columns: int) -> None:
    random = np.random.default_rng(rows)
    a, b = random.normal(size=(rows, columns)), random.normal(size=rows)
    turned, pivots, x = roomy(a), np.zeros(rows), np.zeros(columns)
    x[:rows] = b
    reflect(turned, rows, rows, columns, pivots)
    assert pivots_hold(pivots, rows, 1e-9)
    solve_lower(turned, rows, pivots, x)
    reflect_back(turned, rows, columns, x)
    np.testing.assert_allclose(x, np.linalg.lstsq(a, b, rcond=None)[0], rtol=1e-11)


def test_what_is_beyond_the_triangle_spans_the_kernel() -> None:
    a = np.random.default_rng(3).normal(size=(2, 5))
    turned, pivots = a.copy(), np.zeros(2)
    reflect(turned, 2, 2, 5, pivots)
    for k in range(2, 5):
        x = np.eye(5)[k]
        reflect_back(turned, 2, 5, x)
        np.testing.assert_allclose(a @ x, 0.0, atol=1e-14)
        assert np.linalg.norm(x) == pytest.approx(1.0, abs=1e-14)


def test_pivots() -> None:
    assert largest_entry(roomy(np.array([[3.0, -5.0]])), 1, 2) == 5.0
    assert pivots_hold(np.array([3.0, -2e-8]), 2, 1e-8)
    assert not pivots_hold(np.array([3.0, 2e-9]), 2, 1e-8)
    assert not pivots_hold(np.array([0.0]), 1, 0.0)
    assert not pivots_hold(np.array([1.0, np.nan]), 2, 1e-9)


RANKS = [(1, 1, 1), (4, 4, 4), (4, 4, 2), (3, 6, 2), (6, 3, 3), (5, 5, 1), (3, 4, 0)]


@pytest.mark.parametrize(("rows", "columns", "rank"), RANKS)
def test_least_squares_of_any_rank(rows: int, columns: int, rank: int) -> None:
    random = np.random.default_rng([rows, columns, rank])
    a = random.normal(size=(rows, rank)) @ random.normal(size=(rank, columns))
    b = random.normal(size=(rows, 2))
    x = roomy(np.zeros((columns, 2)))
    least_squares(roomy(a), rows, columns, roomy(b), 2, 1e-10, x)
    expected = np.linalg.lstsq(a, b, rcond=1e-10)[0]
    np.testing.assert_allclose(x[:columns, :2], expected, rtol=0, atol=1e-11 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize(("rows", "columns"), [(1, 3), (3, 3), (2, 5)])
def test_condition(rows: int, columns: int) -> None:
    a = np.random.default_rng(columns).normal(size=(rows, columns)) * np.logspace(0, 3, columns)
    assert condition_of(roomy(a), rows, columns) == pytest.approx(np.linalg.cond(a), rel=1e-10)
    assert condition_of(np.zeros((rows, columns)), rows, columns) == np.inf
    assert least_singular(roomy(a), rows, columns, 1e-10) == pytest.approx(np.linalg.svd(a, compute_uv=False)[-1], rel=1e-10)
