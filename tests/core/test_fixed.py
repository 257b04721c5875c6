"""Methods of fixed steps: order by slope, values between the steps, energy over long runs."""

from __future__ import annotations

import numpy as np
import pytest

from tests.core.problems import kepler, kepler_at, oscillator
from tests.reference.drive import drive
from vlmb.core.driver import DIVERGED, DONE, NOT_FINITE, STEPS, Driver, begin, make_driver
from vlmb.core.jit import COMPILED, kernel
from vlmb.core.march import march


@pytest.mark.parametrize("method, order", [("euler", 1), ("rk4", 4), ("gauss", 4)])
@pytest.mark.parametrize("places", ["ends", "between"])
def test_order_by_slope(method, order, places):
    times = [3.0] if places == "ends" else np.linspace(0.0, 3.0, 50) + 0.001
    errors = []
    for step in (0.02, 0.01, 0.005) if order > 1 else (2e-3, 1e-3, 5e-4):
        run = drive(kepler, 0.0, kepler_at(0.0), 3.0, method, times=times, step=step)
        assert run.code == DONE and run.steps == round(3.0 / step)
        errors.append(np.abs(run.samples - np.array([kepler_at(t) for t in run.times])).max())
    slopes = np.diff(np.log(errors)) / np.log(0.5)
    assert abs(slopes[-1] - order) < 0.25


def test_steps_divide_the_way_and_end_on_it():
    run = drive(oscillator, 0.0, np.array([1.0, 0.0]), 1.0, "rk4", step=0.3)
    assert run.steps == 4 and run.t == 1.0
    assert drive(oscillator, 0.0, np.array([1.0, 0.0]), 0.3, "rk4", step=0.1).steps == 3


@kernel
def march_oscillator(driver: Driver, t: float, end: float) -> int:
    begin(driver, t, end)
    code = march(driver)
    while code > DONE:
        driver.slope[0] = driver.point[1]
        driver.slope[1] = -driver.point[0]
        code = march(driver)
    return code


def test_gauss_keeps_the_energy_of_an_orbit():
    times = np.linspace(0.0, 400.0, 2001)
    run = drive(kepler, 0.0, kepler_at(0.0), 400.0, "gauss", times=times, step=0.1)
    x, y, u, v = run.samples.T
    energy = 0.5 * (u * u + v * v) - 1.0 / np.hypot(x, y) + 0.5
    assert np.abs(energy).max() < 2e-3
    assert abs(energy[1000:].mean() - energy[:1000].mean()) < 1e-5


def test_gauss_keeps_quadratic_invariants_to_rounding():
    steps = 100_000 if COMPILED else 1000
    driver = make_driver("gauss", 2, step=0.05)
    driver.point[:] = 1.0, 0.0
    assert march_oscillator(driver, 0.0, 0.05 * steps) == DONE
    assert driver.counts[STEPS] == steps
    assert abs(driver.point @ driver.point - 1.0) < 1e-13


def test_gauss_with_too_long_steps_says_so():
    assert drive(lambda t, y: -1e3 * y, 0.0, np.ones(1), 1.0, "gauss", step=0.1).code in (DIVERGED, NOT_FINITE)


def test_what_is_not_finite_ends_a_run():
    run = drive(lambda t, y: y * y, 0.0, np.ones(1), 40.0, "euler", step=0.1)
    assert run.code == NOT_FINITE and run.t < 10.0
