"""Smoothing splines: against scipy's interpolant, a dense solution of the same least squares, and a known motion with noise."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.interpolate import BSpline, make_interp_spline

from vlmb.core.series import derivative, outside, piece_at, signal_box, signal_jet
from vlmb.model.signals import Signal, make_signal
from vlmb.model.smoothing import smoothed
from vlmb.scene.tables import Smoothing

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def curve(t: Array, y: Array, smooth: object = "auto") -> Signal:
    return make_signal("mocap.knee", "m", t, y, smooth, 0.2, "data[0].columns.knee")  # type: ignore[arg-type]


def uneven(count: int, seed: int = 0) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    t = (np.arange(count) + rng.uniform(-0.2, 0.2, count)) * 2.0 / count
    return t, 0.4 + 0.05 * np.sin(7.0 * t) + 0.01 * rng.normal(size=count)


def test_without_smoothing_it_is_the_natural_quintic_interpolant() -> None:
    """Third and fourth derivatives are 0 at both ends, and the curve goes through all samples."""
    t, y = uneven(60)
    found = curve(t, y, "none")
    natural = [(3, 0.0), (4, 0.0)]
    exact, times = make_interp_spline(t, y, k=5, bc_type=(natural, natural)), np.linspace(t[0], t[-1], 1001)
    for order in range(5):
        wanted = exact(times, order)
        np.testing.assert_allclose(found.values(times, order), wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())
    np.testing.assert_allclose(found.curve.values, y, rtol=1e-14)


@pytest.mark.parametrize("p", [1e-9, 1e-6, 1e-3])
def test_smoothing_solves_the_least_squares_that_it_claims(p: float) -> None:
    """sum (y - s)^2 + p int s'''^2 over all quintic splines with knots at the samples, by dense B-splines (p in s^5)."""
    t, y = uneven(25)
    knots = np.concatenate([[t[0]] * 5, t, [t[-1]] * 5])
    basis = [BSpline(knots, np.eye(len(t) + 4)[k], 5) for k in range(len(t) + 4)]
    at = np.column_stack([each(t) for each in basis])
    bends = lambda x: np.array([each(x, 3) for each in basis])  # noqa: E731
    penalty = sum(quad_vec(lambda x: np.outer(bends(x), bends(x)), a, b)[0] for a, b in pairwise(t))
    exact = BSpline(knots, np.linalg.solve(at.T @ at + p * penalty, at.T @ y), 5)
    residual = float(np.sqrt(np.mean((y - exact(t)) ** 2)))
    found = smoothed(t, y, residual)
    assert found.residual == pytest.approx(residual, rel=1e-3)
    np.testing.assert_allclose(found.values, exact(t), rtol=0, atol=2e-3 * residual)


def test_the_residual_is_what_sigma_asks_for() -> None:
    t, y = uneven(300)
    for sigma in (0.002, 0.0095, 0.02):
        assert curve(t, y, Smoothing(sigma=sigma)).curve.residual == pytest.approx(sigma, rel=1e-3)
    assert curve(t, y, Smoothing(sigma=1.0)).curve.residual < 0.1  # a parabola leaves no more


def test_a_noisy_sine_with_a_hole() -> None:
    """1 Hz, 0.05 m, errors of 1 mm, 100 Hz, 15 samples missing; the median of 50 recordings."""
    t = np.arange(501) / 100.0
    exact = 0.3 + 0.05 * np.sin(2.0 * np.pi * t)
    seen = np.ones(len(t), dtype=bool)
    seen[230:245] = False
    times = np.linspace(0.0, 5.0, 2001)
    wanted = -0.05 * (2.0 * np.pi) ** 2 * np.sin(2.0 * np.pi * times)
    within, hidden = (times > 0.5) & (times < 4.5), (times > 2.29) & (times < 2.45)
    errors = []
    for seed in range(50):
        y = exact + 1e-3 * np.random.default_rng(seed).normal(size=len(t))
        found = curve(t[seen], y[seen])
        off = found.values(times, 2) - wanted
        gap = np.abs(found.values(times) - 0.3 - 0.05 * np.sin(2.0 * np.pi * times))[hidden].max()
        errors.append([np.sqrt(np.mean(off**2)), np.sqrt(np.mean(off[within] ** 2)), gap, found.curve.residual])
    everywhere, inside, gap, residual = np.median(errors, axis=0)
    assert everywhere < 0.25 and inside < 0.1 and gap < 1e-3
    assert residual == pytest.approx(1e-3, rel=0.1)
    raw = curve(t[seen], (exact + 1e-3 * np.random.default_rng(0).normal(size=len(t)))[seen], "none")
    assert np.sqrt(np.mean((raw.values(times, 2) - wanted) ** 2)) > 10.0  # why it is smoothed


def test_dense_samples_of_a_slow_motion_keep_their_digits() -> None:
    """At 2000 Hz the equations have a condition of 1e13: residuals in longer numbers make up for it."""
    t = np.arange(20_000) / 2000.0
    y = 0.3 + 0.05 * np.sin(2.0 * np.pi * t) + 1e-3 * np.random.default_rng(1).normal(size=len(t))
    times = np.linspace(0.5, 9.5, 4001)
    off = curve(t, y).values(times, 2) + 0.05 * (2.0 * np.pi) ** 2 * np.sin(2.0 * np.pi * times)
    assert np.sqrt(np.mean(off**2)) < 0.04


def sampled(kind: str) -> Array:
    """Times of recordings that are no even grid, 5 s long."""
    even, dense, rng = np.arange(501) / 100.0, np.arange(5001) / 1000.0, np.random.default_rng(0)
    return {
        "close pairs": np.sort(np.concatenate([even, [0.501, 1.0001, 1.0002, 2.0 + 1e-9]])),
        "jitter": np.sort(even + 0.0045 * rng.uniform(-1.0, 1.0, len(even))), "random": np.sort(rng.uniform(0.0, 5.0, 500)),
        "a long hole": dense[(dense < 2.0) | (dense > 2.19)],
        "two rates": np.concatenate([dense[dense < 2.0], even[even >= 2.0]]),
        "a third dropped": even[rng.uniform(size=len(even)) > 0.3], "10 kHz": np.arange(50_001) / 10_000.0,
    }[kind]  # fmt: skip


@pytest.mark.parametrize("kind", ["close pairs", "jitter", "random", "a long hole", "two rates", "a third dropped", "10 kHz"])
@pytest.mark.parametrize("smooth", ["auto", Smoothing(sigma=1e-3)])
def test_any_times_will_do(kind: str, smooth: object) -> None:
    t = sampled(kind)
    found = curve(t, 0.05 * np.sin(2.0 * np.pi * t) + 1e-3 * np.random.default_rng(1).normal(size=len(t)), smooth)
    times = np.linspace(t[0] + 0.5, t[-1] - 0.5, 2001)
    off = found.values(times, 2) + 0.05 * (2.0 * np.pi) ** 2 * np.sin(2.0 * np.pi * times)
    assert np.sqrt(np.mean(off**2)) < 0.1
    assert found.curve.residual == pytest.approx(1e-3, rel=0.2)
    assert found.span == (t[0], t[-1]) == (found.curve.pieces[0, 0], found.curve.pieces[-1, 0])
    np.testing.assert_array_equal(found.curve.values, found.values(t))


@pytest.mark.parametrize("order", range(3))
def test_what_lies_exactly_on_a_parabola_stays_there(order: int) -> None:
    t, _ = uneven(40)
    found = curve(t, 1.0 + 2.0 * t - 0.5 * t**2)
    wanted = (1.0 + 2.0 * t - 0.5 * t**2, 2.0 - t, np.full(len(t), -1.0))[order]
    np.testing.assert_allclose(found.values(t, order), wanted, rtol=0, atol=1e-9)


def test_constant_samples_and_the_fewest_there_may_be() -> None:
    t = np.arange(6) / 10.0
    assert np.abs(curve(t, np.full(6, 0.25)).values(t) - 0.25).max() < 1e-15
    found = curve(t, t**2, "none")
    np.testing.assert_allclose(found.values(t, 2), 2.0, rtol=1e-9)


# ---- what the core makes of the pieces


def test_the_core_reads_the_same_curve() -> None:
    t, y = uneven(50)
    found = curve(t, y)
    pieces, last = found.curve.pieces, len(found.curve.pieces) - 1
    for time in np.linspace(t[0], t[-1], 137).tolist():
        every = [float(found.values(np.array([time]), order)[0]) for order in range(5)]
        for order in range(3):
            np.testing.assert_allclose(signal_jet(pieces, 0, last, order, time), every[order : order + 3], rtol=1e-12, atol=1e-9)
        assert pieces[piece_at(pieces, 0, last, time), 0] <= time
    assert signal_jet(pieces, 0, last, 0, t[0] - 1e-12)[0] == pytest.approx(found.values(t[:1])[0])
    assert outside(pieces, 0, last, t[0] - 1e-6) and np.isnan(signal_jet(pieces, 0, last, 0, t[-1] + 1e-6)).all()
    assert derivative(pieces, 3, 0.0, 5) == pytest.approx(120.0 * pieces[3, 6])


def test_enclosures_hold_all_that_a_curve_does() -> None:
    t, y = uneven(50)
    found, rng = curve(t, y), np.random.default_rng(2)
    pieces, last, box = found.curve.pieces, len(found.curve.pieces) - 1, np.zeros(6)
    for _ in range(200):
        low, high = np.sort(rng.uniform(t[0] - 0.1, t[-1] + 0.1, 2))
        inside = np.clip(np.linspace(low, high, 101), t[0], t[-1])
        for order in range(3):
            signal_box(pieces, 0, last, order, low, high, box)
            for k in range(3):
                values = found.values(inside, order + k)
                slack = 1e-9 * np.abs(values).max() + 1e-12
                assert box[2 * k] - slack <= values.min() and values.max() <= box[2 * k + 1] + slack
    signal_box(pieces, 0, last, 0, 0.7, 0.7 + 1e-9, box)
    assert box[1] - box[0] < 1e-8  # and close in on it
