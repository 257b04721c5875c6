"""DOP853 in reverse communication: exact solutions, SciPy's count of evaluations, dense output, events, slices, failures."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vlmb.core.drive import drive
from vlmb.core.driver import DONE, STOPPED, STUCK


def oscillator(t, y):
    return np.array([y[1], -y[0]])


def kepler(t, y):
    r3 = (y[0] ** 2 + y[1] ** 2) ** 1.5
    return np.array([y[2], y[3], -y[0] / r3, -y[1] / r3])


def kepler_at(t, e=0.5):
    u = t
    for _ in range(60):
        u -= (u - e * np.sin(u) - t) / (1.0 - e * np.cos(u))
    b, r = np.sqrt(1.0 - e * e), 1.0 - e * np.cos(u)
    return np.array([np.cos(u) - e, b * np.sin(u), -np.sin(u) / r, b * np.cos(u) / r])


@pytest.mark.parametrize("rtol", [1e-5, 1e-8, 1e-11])
def test_kepler_to_tolerance_with_the_evaluations_of_scipy(rtol):
    start, end = kepler_at(0.0), 20.0
    times = np.linspace(0.0, end, 777)
    run = drive(kepler, 0.0, start, end, times=times, rtol=rtol, atol=rtol)
    assert run.code == DONE and run.t == end
    error = np.abs(run.samples - np.array([kepler_at(t) for t in times])).max()
    plain = drive(kepler, 0.0, start, end, rtol=rtol, atol=rtol)
    scipy = solve_ivp(kepler, (0.0, end), start, "DOP853", rtol=rtol, atol=rtol)
    assert error < 300.0 * rtol
    assert plain.evaluations <= 1.02 * scipy.nfev
    np.testing.assert_allclose(plain.y, scipy.y[:, -1], atol=100 * rtol)
    assert (run.samples[0] == start).all() and (run.samples[-1] == run.y).all()
