"""Four numbers at once: the same as one by one."""

from __future__ import annotations

import numpy as np
import pytest

from vlmb.core.jit import kernel
from vlmb.core.lanes import LANES, by_fours, side_by_side, sum_of
from vlmb.core.tree import Array


@kernel
def add_up(table: Array, out: Array) -> None:
    """Write sums of rows, of their sizes and of their shares into out (rows, 3)."""
    fours = by_fours(table)
    for i in range(table.shape[0]):
        total, sizes = side_by_side(0.0, 0.0, 0.0, 0.0), side_by_side(0.0, 0.0, 0.0, 0.0)
        shares = total
        for m in range(table.shape[1] // LANES):
            four = fours[i, m]
            total, sizes, shares = total + four, sizes + abs(four), shares + 1.0 / (1.0 + abs(four))
        out[i, 0], out[i, 1], out[i, 2] = sum_of(total), sum_of(sizes), sum_of(shares)


def test_sums_of_rows_of_any_size() -> None:
    draw = np.random.default_rng(5)
    for width in (LANES, 5 * LANES):
        table, out = draw.normal(size=(7, width)), np.zeros((7, 3))
        add_up(table, out)
        sizes = np.abs(table)
        expected = np.stack([table.sum(axis=1), sizes.sum(axis=1), (1.0 / (1.0 + sizes)).sum(axis=1)], axis=1)
        np.testing.assert_allclose(out, expected, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("odd", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_stays_so(odd: float) -> None:
    for lane in range(LANES):
        table, out = np.ones((1, LANES)), np.zeros((1, 3))
        table[0, lane] = odd
        add_up(table, out)
        assert out[0, 1] == np.inf if np.isinf(odd) else np.isnan(out[0, 1])
        assert not np.isfinite(out[0, 0])
