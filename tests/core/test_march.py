"""The march: events, samples, slices, hard ends, failures."""

from __future__ import annotations

import numpy as np
import pytest

from tests.core.problems import ball, kepler, kepler_at, oscillator
from tests.reference.drive import drive
from vlmb.core.driver import (
    DONE,
    EVALUATE,
    EVALUATIONS,
    FAILED,
    H_MAX,
    HIT,
    INDICATE,
    NEXT_SAMPLE,
    NOISY,
    NOT_FINITE,
    RATE,
    SLICE,
    STOPPED,
    STUCK,
    TIME,
    VALUE,
    begin,
    make_driver,
    resume,
)
from vlmb.core.march import march

ALL = ["euler", "rk4", "gauss", "dop853", "adams", "radau"]
GOOD = ["dop853", "adams", "radau"]


def position(level):
    """Indicator y[0] - level of (position, speed)."""
    return lambda t, y, dy: (np.array([y[0] - level]), np.array([dy[0]]))


@pytest.mark.parametrize("method", GOOD)
def test_a_fall_ends_where_the_formula_says(method):
    start, times = np.array([10.0, 3.0]), [0.5, 1.0, 4.0]
    run = drive(ball, 0.0, start, 5.0, method, times, position(0.0), [-1.0], [True], rtol=1e-12, atol=1e-12)
    exact = (3.0 + np.sqrt(9.0 + 2.0 * 9.81 * 10.0)) / 9.81
    assert run.code == STOPPED
    assert abs(run.t - exact) < 1e-11
    assert abs(run.y[0]) < 1e-10
    assert run.times.tolist() == [0.5, 1.0]


@pytest.mark.parametrize("method", GOOD)
def test_crossings_in_order_with_directions(method):
    def indicate(t, y, dy):
        return np.array([y[0], y[0], y[0], y[0] - 0.5]), np.array([dy[0]] * 4)

    start, directions = np.array([1.0, 0.0]), [0, 1, -1, 0]
    run = drive(oscillator, 0.0, start, 7.0, method, None, indicate, directions, [False] * 4, rtol=1e-13, atol=1e-13)
    found = [(c.t, c.indicator, c.direction) for c, _ in run.crossings]
    third, half = np.pi / 3.0, np.pi / 2.0
    wanted = [
        (third, 3, -1), (half, 0, -1), (half, 2, -1), (3 * half, 0, 1), (3 * half, 1, 1), (2 * np.pi - third, 3, 1),
    ]  # fmt: skip
    assert [(i, d) for _, i, d in found] == [(i, d) for _, i, d in wanted]
    np.testing.assert_allclose([t for t, _, _ in found], [t for t, _, _ in wanted], atol=1e-11)


@pytest.mark.parametrize("method", GOOD)
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_two_crossings_in_one_step(method, direction):
    top = 3.0**2 / (2.0 * 9.81)
    start, below = np.array([0.0, 3.0]), position(top - 1e-9)
    run = drive(ball, 0.0, start, 0.6, method, None, below, [direction], [True], rtol=1e-3, atol=1e-3)
    exact = (3.0 - direction * np.sqrt(2.0 * 9.81 * 1e-9)) / 9.81
    assert run.code == STOPPED
    assert abs(run.t - exact) < 1e-8  # ill-conditioned: the speed is almost 0 there


@pytest.mark.parametrize("method", ALL)
def test_several_in_one_step_stop_at_the_first_terminal(method):
    def indicate(t, y, dy):
        return np.array([t - 0.9, t - 0.3, t - 0.6, 0.7 - t]), np.array([1.0, 1.0, 1.0, -1.0])

    ends = [True, False, True, True]
    run = drive(lambda t, y: np.ones(1), 0.0, np.zeros(1), 1.0, method, [0.2, 0.5, 0.8], indicate, [0, 1, 0, 0], ends, step=1.0)
    assert run.code == STOPPED and abs(run.t - 0.6) < 1e-12
    assert [c.indicator for c, _ in run.crossings] == [1, 2]
    np.testing.assert_allclose(run.samples[:, 0], [0.2, 0.5], atol=1e-9)


@pytest.mark.parametrize("method", GOOD)
def test_a_bouncing_ball_neither_fires_again_nor_falls_through(method):
    run = march_on(method, bounce=0.5, ends=2.0)
    first = np.sqrt(2.0 / 9.81)
    wanted = [first * (1.0 + sum(2.0 * 0.5**k for k in range(1, n + 1))) for n in range(len(run))]
    assert 5 < len(run) < 40
    np.testing.assert_allclose(run[:5], wanted[:5], atol=1e-9)


def march_on(method, bounce, ends):
    """Times of impacts of a ball dropped from 1 m."""
    driver = make_driver(method, 2, None, np.array([-1.0]), rtol=1e-10, atol=1e-10)
    driver.point[:] = 1.0, 0.0
    begin(driver, 0.0, ends)
    impacts = []
    while len(impacts) < 12:
        code = step_python(driver, ball, position(0.0))
        if code != STOPPED:
            break
        t = float(driver.real[TIME])
        impacts.append(t)
        driver.point[1] *= -bounce
        resume(driver, t, ends)
    return impacts


def step_python(driver, f, indicate):
    from tests.reference.drive import Drive, _decide
    from vlmb.core.driver import CROSSING

    while True:
        code = march(driver)
        if code == EVALUATE:
            driver.slope[:] = f(driver.real[TIME], driver.point)
        elif code == INDICATE:
            driver.indicators[VALUE], driver.indicators[RATE] = indicate(driver.real[TIME], driver.point, driver.slope)
        elif code == CROSSING:
            _decide(indicate, driver, [True], Drive(DONE, 0.0, driver.point, driver.times, driver.samples, driver))
        elif code != SLICE:
            return code


@pytest.mark.parametrize(
    "speed, weight, direction, fires",
    [
        (1.0, -9.81, -1.0, 2.0 / 9.81),  # leaves upwards, comes back
        (-1.0, 0.0, -1.0, None),  # goes on through: it was there already
        (0.0, -1.0, -1.0, 0.0),  # at rest, pulled the wrong way
        (0.0, 1.0, -1.0, None),  # at rest, pulled the right way
        (0.0, 0.0, 0.0, None),  # stays
    ],
)
def test_an_indicator_that_starts_on_zero(speed, weight, direction, fires):
    start = np.array([0.0, speed])
    run = drive(lambda t, y: np.array([y[1], weight]), 0.0, start, 1.0, "dop853", None, position(0.0), [direction], [True])
    if fires is None:
        assert run.code == DONE
    else:
        assert run.code == STOPPED and abs(run.t - fires) < 1e-9


def test_after_a_stop_going_on_does_not_fire_again():
    driver = make_driver("dop853", 2, None, np.array([-1.0]), rtol=1e-9, atol=1e-9)
    driver.point[:] = 1.0, 0.0
    begin(driver, 0.0, 1.0)
    assert step_python(driver, ball, position(0.0)) == STOPPED
    assert driver.indicators[HIT, 0] == -1.0
    resume(driver, float(driver.real[TIME]), 1.0)
    assert step_python(driver, ball, position(0.0)) == DONE


@pytest.mark.parametrize("method", ALL)
def test_no_evaluation_outside_the_way(method):
    start, end = 0.1, 0.1 + 0.7
    seen = []

    def f(t, y):
        assert start <= t <= end
        seen.append(t)
        return np.array([np.cos(50.0 * t)])

    run = drive(f, start, np.zeros(1), end, method, np.linspace(start, end, 31), rtol=1e-7, atol=1e-9, step=0.004)
    assert run.code == DONE and run.t == end and max(seen) == end
    assert run.times[-1] == end and (run.samples[-1] == run.y).all()
    if method in GOOD:
        exact = (np.sin(50.0 * run.times) - np.sin(50.0 * start)) / 50.0
        np.testing.assert_allclose(run.samples[:, 0], exact, atol=1e-6)


@pytest.mark.parametrize("method", ALL)
def test_slices_change_no_bit(method):
    def run(size):
        driver = make_driver(method, 4, np.linspace(0.0, 5.0, 100), rtol=1e-8, atol=1e-8, step=0.05, slice_size=size)
        driver.point[:] = kepler_at(0.0)
        begin(driver, 0.0, 5.0)
        slices = 0
        while (code := march(driver)) > DONE:
            slices += code == SLICE
            if code == EVALUATE:
                driver.slope[:] = kepler(0.0, driver.point)
        assert code == DONE and driver.counts[NEXT_SAMPLE] == 100
        return driver, slices

    whole, none = run(2**62)
    cut, some = run(7)
    assert none == 0 and some > 5
    assert (whole.samples == cut.samples).all() and (whole.point == cut.point).all()
    assert whole.counts[EVALUATIONS] == cut.counts[EVALUATIONS]


@pytest.mark.parametrize("method", GOOD)
def test_the_longest_step_is_kept(method):
    times = []
    drive(lambda t, y: times.append(t) or np.zeros(1), 0.0, np.zeros(1), 1.0, method, h_max=0.1)
    assert len(times) >= 10 and np.diff(sorted(times)).max() <= 0.1 + 1e-12


@pytest.mark.parametrize("method", GOOD)
def test_a_failure_makes_a_shorter_step_and_the_first_one_is_told(method):
    class WrongError(Exception):
        pass

    def f(t, y):
        if y[0] > 1.0:
            raise WrongError(f"{y[0]}")
        return np.array([1.0])

    run = drive(f, 0.0, np.zeros(1), 2.0, method, failures=(WrongError,))
    assert run.code == STUCK and isinstance(run.error, WrongError)
    assert 0.9 < run.t <= 1.0 + 1e-6 and run.evaluations < 1000
    assert drive(f, 0.0, 2.0 * np.ones(1), 2.0, method, failures=(WrongError,)).code == FAILED
    with pytest.raises(WrongError):
        drive(f, 0.0, np.zeros(1), 2.0, method)


@pytest.mark.parametrize("method", GOOD)
def test_a_failure_that_a_shorter_step_avoids_is_forgotten(method):
    def f(t, y):
        if y[0] < -1e-3:
            raise ValueError
        return -20.0 * y

    run = drive(f, 0.0, np.ones(1), 1.0, method, rtol=1e-6, atol=1e-6, failures=(ValueError,), step=0.5)
    assert run.code == DONE and abs(run.y[0] - np.exp(-20.0)) < 1e-5


@pytest.mark.parametrize("method", GOOD)
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_not_finite(method, wrong):
    assert drive(lambda t, y: np.array([wrong]), 0.0, np.zeros(1), 1.0, method).code == NOT_FINITE
    run = drive(lambda t, y: np.array([1.0 if y[0] < 0.5 else wrong]), 0.0, np.zeros(1), 1.0, method)
    assert run.code == STUCK and run.t < 0.5 + 1e-9 and run.evaluations < 2000 and np.isfinite(run.y).all()


@pytest.mark.parametrize("method", GOOD)
def test_a_pole_is_no_endless_run(method):
    run = drive(lambda t, y: y * y, 0.0, np.ones(1), 2.0, method, rtol=1e-6, atol=1e-6)
    assert run.code == STUCK and abs(run.t - 1.0) < 1e-3 and run.evaluations < 50_000


@pytest.mark.parametrize("method", ["adams", "dop853"])
def test_steps_that_noise_keeps_short_end_the_run_early(method):
    random = np.random.default_rng(1)
    for rtol, code in ((1e-6, DONE), (1e-12, NOISY)):
        run = drive(lambda t, y: 1e-6 * random.standard_normal(2) - y, 0.0, np.ones(2), 2.0, method, rtol=rtol, atol=0.1 * rtol)
        assert run.code == code
        assert run.evaluations < (4000 if code == DONE else 120_000)
        assert abs(run.y[0] - np.exp(-run.t)) < 1e-5


@pytest.mark.parametrize(("method", "rtol"), [("adams", 1e-6), ("adams", 3e-14), ("dop853", 1e-6), ("dop853", 3e-14)])
def test_stiffness_is_no_noise(method, rtol):
    class EnoughError(Exception):
        pass

    asked = []

    def f(t, y):
        asked.append(t)
        if len(asked) > 30_000:
            raise EnoughError
        return -1e6 * (y - np.cos(t)) - np.sin(t)

    with pytest.raises(EnoughError):
        drive(f, 0.0, np.ones(1), 50.0, method, rtol=rtol, atol=0.1 * rtol)


@pytest.mark.parametrize("method", ALL)
def test_nothing_to_do(method):
    run = drive(oscillator, 1.0, np.array([1.0, 0.0]), 1.0, method, [1.0], step=0.1)
    assert run.code == DONE and run.evaluations == 1 and (run.samples == [[1.0, 0.0]]).all()


def test_the_longest_step_may_change_on_the_way():
    driver = make_driver("dop853", 1)
    begin(driver, 0.0, 10.0)
    seen = []
    while (code := march(driver)) > DONE:
        driver.slope[:] = 0.0
        seen.append(float(driver.real[TIME]))
        driver.real[H_MAX] = 0.05 if seen[-1] > 5.0 else np.inf
    assert code == DONE
