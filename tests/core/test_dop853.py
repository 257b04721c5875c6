"""DOP853 and Adams: exact solutions, SciPy's counts of evaluations, dense output."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import DOP853, ode, solve_ivp

from tests.core.problems import kepler, kepler_at, oscillator, oscillator_at
from tests.reference.drive import drive
from vlmb.core.driver import DONE, ERROR

END = 20.0
TIMES = np.linspace(0.0, END, 777)
EXACT = np.array([kepler_at(t) for t in TIMES])


def test_dop853_steps_as_scipy_where_no_step_is_chosen():
    run = drive(kepler, 0.0, EXACT[0], END, times=TIMES, rtol=1e-3, atol=1e-3, h_max=0.1, step=0.1)
    free = {"rtol": 1e-3, "atol": 1e-3, "max_step": 0.1, "first_step": 0.1}
    scipy = solve_ivp(kepler, (0.0, END), EXACT[0], "DOP853", t_eval=TIMES, **free)
    assert run.steps == 200
    np.testing.assert_allclose(run.samples, scipy.y.T, rtol=0.0, atol=1e-12)  # the dense output is its, too


@pytest.mark.parametrize("n", [1, 2, 3, 5, 8, 11])
def test_dop853_of_any_number_of_states(n):
    def turning(t, y):
        return np.cos(t) * np.roll(y, 1) - np.arange(1.0, n + 1.0) * y

    start, times = np.linspace(1.0, 2.0, n), np.linspace(0.0, 2.0, 41)
    run = drive(turning, 0.0, start, 2.0, times=times, rtol=1e-9, atol=1e-9)
    scipy = solve_ivp(turning, (0.0, 2.0), start, "DOP853", t_eval=times, rtol=1e-12, atol=1e-12)
    assert run.code == DONE and run.samples.shape == (41, n)
    np.testing.assert_allclose(run.samples, scipy.y.T, rtol=0.0, atol=2e-8)
    steps = drive(turning, 0.0, start, 2.0, rtol=1e-3, atol=1e-3, h_max=0.1, step=0.1)
    theirs = solve_ivp(turning, (0.0, 2.0), start, "DOP853", rtol=1e-3, atol=1e-3, max_step=0.1, first_step=0.1)
    np.testing.assert_allclose(steps.y, theirs.y[:, -1], rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("h", [0.02, 0.1, 0.3])
def test_dop853_estimates_the_error_of_scipy(h):
    solver = DOP853(kepler, 0.0, EXACT[0], h, first_step=h, rtol=1e-3, atol=1e-3)
    before = solver.y
    solver.step()
    scale = 1e-3 + 1e-3 * np.maximum(np.abs(before), np.abs(solver.y))
    run = drive(kepler, 0.0, EXACT[0], h, rtol=1e-3, atol=1e-3, step=h)
    assert run.steps == 1 and solver.t == h
    assert run.driver.real[ERROR] == pytest.approx(solver._estimate_error_norm(solver.K, h, scale), rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("rtol", [1e-5, 1e-8, 1e-11])
def test_dop853_beside_scipy_at_equal_error(rtol):
    run = drive(kepler, 0.0, EXACT[0], END, times=TIMES, rtol=rtol, atol=rtol)
    scipy = solve_ivp(kepler, (0.0, END), EXACT[0], "DOP853", rtol=rtol, atol=rtol, t_eval=TIMES)
    error, theirs = np.abs(run.y - EXACT[-1]).max(), np.abs(scipy.y[:, -1] - EXACT[-1]).max()
    assert run.code == DONE and run.t == END
    assert run.evaluations * (error / theirs) ** 0.125 < 1.1 * scipy.nfev  # work of order 8 for their error
    assert error < 1.2 * theirs + 1e-13


@pytest.mark.parametrize("rtol", [1e-5, 1e-8, 1e-11])
def test_dop853_dense_output_is_as_good_as_the_steps(rtol):
    run = drive(kepler, 0.0, EXACT[0], END, times=TIMES, rtol=rtol, atol=rtol)
    scipy = solve_ivp(kepler, (0.0, END), EXACT[0], "DOP853", rtol=rtol, atol=rtol, t_eval=TIMES)
    assert np.abs(run.samples - EXACT).max() < 1.2 * np.abs(scipy.y.T - EXACT).max() + 1e-13
    alone = drive(kepler, 0.0, EXACT[0], END, rtol=rtol, atol=rtol)
    assert alone.evaluations < run.evaluations <= alone.evaluations + 3 * run.steps  # three for a step with samples inside
    assert (run.samples[0] == EXACT[0]).all() and (run.samples[-1] == run.y).all()


@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-10])
def test_adams_beside_vode_at_equal_error(rtol):
    run = drive(kepler, 0.0, EXACT[0], END, "adams", times=TIMES, rtol=rtol, atol=rtol)
    evaluations, states = vode(rtol)
    error, theirs = np.abs(run.samples - EXACT).max(), np.abs(states - EXACT).max()
    equal = run.evaluations * (error / theirs) ** 0.1  # work of order 10 or so for their error
    assert run.code == DONE
    assert equal < 1.2 * evaluations
    assert error < 5e3 * rtol


def vode(rtol):
    evaluations = 0

    def f(t, y):
        nonlocal evaluations
        evaluations += 1
        return kepler(t, y)

    solver = ode(f).set_integrator("vode", method="adams", rtol=rtol, atol=rtol, nsteps=10**6)
    solver.set_initial_value(EXACT[0], 0.0)
    states = [EXACT[0], *(solver.integrate(t) for t in TIMES[1:])]
    return evaluations, np.array(states)


@pytest.mark.parametrize("method", ["dop853", "adams"])
def test_error_follows_tolerance(method):
    errors = []
    for rtol in (1e-4, 1e-6, 1e-8, 1e-10, 1e-12):
        run = drive(oscillator, 0.0, np.array([1.0, 0.0]), 10.0, method, times=np.linspace(0, 10, 99), rtol=rtol, atol=rtol)
        errors.append(np.abs(run.samples - np.array([oscillator_at(t) for t in run.times])).max())
        assert errors[-1] < 50.0 * rtol
    assert all(after < 0.2 * before for before, after in pairwise(errors))


@pytest.mark.parametrize("method", ["dop853", "adams"])
def test_a_start_at_rest_far_from_it(method):
    run = drive(lambda t, y: np.array([5.0 * t**4]), 0.0, np.zeros(1), 3.0, method, times=[1.0, 2.0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(run.samples[:, 0], [1.0, 32.0], rtol=1e-7)
    np.testing.assert_allclose(run.y, [243.0], rtol=1e-8)
