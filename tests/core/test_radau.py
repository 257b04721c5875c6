"""Radau IIA: SciPy's errors and counts on stiff problems, its dense output, its linear solver."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.reference.drive import drive
from vlmb.core.driver import DONE
from vlmb.core.linear import factor, factor_complex, solve, solve_complex
from vlmb.core.radau_tables import FROM_STAGES, IM, NODES, RE, REAL, STAGES, TO_STAGES

LINKS = 7


def van_der_pol(t, y):
    return np.array([y[1], 1000.0 * (1.0 - y[0] ** 2) * y[1] - y[0]])


def robertson(t, y):
    a, b, c = 0.04 * y[0], 1e4 * y[1] * y[2], 3e7 * y[1] ** 2
    return np.array([b - a, a - b - c, c])


def hanging(t, y):
    """Masses of 1 kg below each other on springs of 1e7 N/m with dampers of 1e3 N s/m."""
    x, v = y[:LINKS], y[LINKS:]
    pull = 1e7 * np.diff(x, prepend=0.0) + 1e3 * np.diff(v, prepend=0.0)
    return np.concatenate([v, -9.81 - pull + np.append(pull[1:], 0.0)])


@cache
def exact_end(f, y, end):
    return solve_ivp(f, (0.0, end), y, "Radau", rtol=1e-10, atol=1e-14).y[:, -1]


@pytest.mark.parametrize("f, y, end", [(van_der_pol, (2.0, 0.0), 2000.0), (robertson, (1.0, 0.0, 0.0), 1e4)])
@pytest.mark.parametrize("rtol", [1e-4, 1e-7])
def test_stiff_motions_beside_scipy(f, y, end, rtol):
    exact = exact_end(f, y, end)
    theirs = solve_ivp(f, (0.0, end), y, "Radau", rtol=rtol, atol=1e-3 * rtol)
    run = drive(f, 0.0, np.array(y), end, "radau", rtol=rtol, atol=1e-3 * rtol)
    assert run.code == DONE
    assert np.abs(run.y - exact).max() < 5.0 * np.abs(theirs.y[:, -1] - exact).max()
    assert run.steps < 1.1 * len(theirs.t)
    assert run.evaluations < 1.1 * (theirs.nfev + theirs.njev * len(y))


def test_stiff_springs_in_larger_steps_than_theirs():
    rest = drive(hanging, 0.0, np.zeros(2 * LINKS), 2.0, "radau", rtol=1e-6, atol=1e-9)
    forces = 9.81 * np.arange(LINKS, 0, -1)
    np.testing.assert_allclose(rest.y[:LINKS], -np.cumsum(forces / 1e7), rtol=1e-3)
    explicit = drive(hanging, 0.0, np.zeros(2 * LINKS), 2.0, "dop853", rtol=1e-6, atol=1e-9)
    assert rest.evaluations < explicit.evaluations * 0.6


@pytest.mark.parametrize("rtol", [1e-4, 1e-7])
def test_dense_output(rtol):
    times = np.linspace(0.0, 3.0, 200)
    run = drive(lambda t, y: -100.0 * (y - np.cos(t)), 0.0, np.zeros(1), 3.0, "radau", times, rtol=rtol, atol=rtol)
    exact = (1e4 * np.cos(times) + 100.0 * np.sin(times) - 1e4 * np.exp(-100.0 * times)) / 10001.0
    theirs = solve_ivp(lambda t, y: -100.0 * (y - np.cos(t)), (0.0, 3.0), [0.0], "Radau", times, rtol=rtol, atol=rtol)
    assert np.abs(run.samples[:, 0] - exact).max() < 1.05 * np.abs(theirs.y[0] - exact).max()


def test_the_coefficients_are_those_of_collocation():
    np.testing.assert_allclose(STAGES[2], [(16 - 6**0.5) / 36, (16 + 6**0.5) / 36, 1 / 9], rtol=1e-12)
    np.testing.assert_allclose(STAGES.sum(axis=1), NODES, rtol=1e-13)
    block = np.array([[REAL, 0.0, 0.0], [0.0, RE, IM], [0.0, -IM, RE]])
    np.testing.assert_allclose(TO_STAGES @ block @ FROM_STAGES @ STAGES, np.eye(3), atol=1e-13)


@pytest.mark.parametrize("n", [1, 2, 9])
def test_linear_systems(n):
    rng = np.random.default_rng(n)
    a, b, x, z = rng.normal(size=(n, n)), rng.normal(size=(n, n)), rng.normal(size=n), rng.normal(size=n)
    real, pivots, answer = a.copy(), np.zeros(n, dtype=np.int64), x.copy()
    factor(real, pivots)
    solve(real, pivots, answer)
    np.testing.assert_allclose(a @ answer, x, atol=1e-11)
    re, im, p, q = a.copy(), b.copy(), x.copy(), z.copy()
    factor_complex(re, im, pivots)
    solve_complex(re, im, pivots, p, q)
    np.testing.assert_allclose((a + 1j * b) @ (p + 1j * q), x + 1j * z, atol=1e-11)
