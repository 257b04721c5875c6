"""DOP853 and Adams: exact solutions, SciPy's counts of evaluations, dense output."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import ode, solve_ivp

from tests.core.problems import kepler, kepler_at, oscillator, oscillator_at
from tests.reference.drive import drive
from vlmb.core.driver import DONE

END = 20.0
TIMES = np.linspace(0.0, END, 777)
EXACT = np.array([kepler_at(t) for t in TIMES])


@pytest.mark.parametrize("rtol", [1e-5, 1e-8, 1e-11])
def test_dop853_takes_the_steps_of_scipy(rtol):
    run = drive(kepler, 0.0, EXACT[0], END, rtol=rtol, atol=rtol)
    scipy = solve_ivp(kepler, (0.0, END), EXACT[0], "DOP853", rtol=rtol, atol=rtol)
    assert run.code == DONE and run.t == END
    assert run.steps == len(scipy.t) - 1
    assert run.evaluations <= scipy.nfev
    assert np.abs(run.y - EXACT[-1]).max() < 1.01 * np.abs(scipy.y[:, -1] - EXACT[-1]).max() + 1e-13


@pytest.mark.parametrize("rtol", [1e-5, 1e-8, 1e-11])
def test_dop853_dense_output_is_as_good_as_the_steps(rtol):
    run = drive(kepler, 0.0, EXACT[0], END, times=TIMES, rtol=rtol, atol=rtol)
    scipy = solve_ivp(kepler, (0.0, END), EXACT[0], "DOP853", rtol=rtol, atol=rtol, t_eval=TIMES)
    assert np.abs(run.samples - EXACT).max() < 1.01 * np.abs(scipy.y.T - EXACT).max() + 1e-13
    assert run.evaluations <= scipy.nfev
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
