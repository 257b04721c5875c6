"""The crane beside a pendulum whose hinge and length are given; the carved ride beside its critical speed."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import sympy
from scipy.integrate import solve_ivp

import vlmb

MODELS = Path(__file__).resolve().parents[2] / "models"
GRAVITY = 9.81


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
def test_the_load_of_a_crane_sways_as_a_pendulum_on_a_moving_hinge(engine: str) -> None:
    """n'' = (g - P'' - 2 L' n')/L across n, less |n'|^2 n: the rope's direction n, its upper end P and its length L given."""
    run = vlmb.simulate(MODELS / "crane.toml", rtol=1e-11, atol=1e-12, engine=engine)
    assert run.status == "finished", run.message
    t = sympy.Symbol("t")
    last = run.scene.parameters["time"]
    done = t / last
    smooth = done**3 * (10 - 15 * done + 6 * done**2)
    phi, psi = sympy.pi / 3 * smooth, sympy.Float("0.45") + sympy.Float("0.35") * smooth
    boom, rope = 12 + 3 * smooth, 7 - smooth
    hinge = [boom * sympy.cos(phi) * sympy.cos(psi), boom * sympy.sin(phi) * sympy.cos(psi), boom * sympy.sin(psi)]
    given = sympy.lambdify(t, [*[sympy.diff(part, t, 2) for part in hinge], rope, sympy.diff(rope, t)])

    def rates(now: float, y: np.ndarray) -> np.ndarray:
        *push, length, hoisting = given(now) if now < last else (0.0, 0.0, 0.0, 6.0, 0.0)
        n, rate = y[:3], y[3:]
        pull = (np.array([0.0, 0.0, -GRAVITY]) - np.array(push) - 2.0 * hoisting * rate) / length
        return np.concatenate([rate, pull - (pull @ n) * n - (rate @ rate) * n])

    before, after = run.t <= last, run.t >= last
    first = solve_ivp(rates, (0.0, last), [0, 0, -1, 0, 0, 0], "DOP853", run.t[before], rtol=1e-12, atol=1e-13)
    second = solve_ivp(rates, (last, 28.0), first.y[:, -1], "DOP853", run.t[after], rtol=1e-12, atol=1e-13)
    rope_of = run.position("rope", "tip") - run.position("boom", "tip")
    found = rope_of / np.linalg.norm(rope_of, axis=1)[:, None]
    np.testing.assert_allclose(found[before], first.y[:3].T, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found[after], second.y[:3].T, rtol=0, atol=1e-8)
    sway = np.hypot(*rope_of[after, :2].T)
    assert 0.05 < sway.max() < 1.0 and run.controls["F2_1"].max() < -5000.0  # it sways, and the rope is never slack
    assert np.abs(run["balance"]).max() < 1e-9 * np.abs(run["energy"]).max()


def carved(speed: float, lean: float) -> vlmb.Scene:
    return vlmb.load_scene(MODELS / "carved_turn.toml").changed_at({"parameters.v": speed, "parameters.lean": lean})


@pytest.mark.parametrize("speed", [4.0, 8.0, 9.5, 10.5, 14.0, 20.0])
@pytest.mark.parametrize("engine", ["core", "pinocchio"])
def test_an_upright_ride_has_its_critical_speed(speed: float, engine: str) -> None:
    """lambda^2 = m d (g - kappa v^2)/J: a small lean grows as cosh(lambda t) below sqrt(g/kappa), swings as a cosine above."""
    if engine == "pinocchio" and speed not in (8.0, 14.0):
        pytest.skip("one on either side is enough")
    tilt, mass, d, inertia, kappa = 1e-5, 70.0, 0.9, 14.0 + 70.0 * 0.9**2, 0.1
    square = mass * d * (GRAVITY - kappa * speed**2) / inertia
    assert (square > 0.0) == (speed < math.sqrt(GRAVITY / kappa))
    run = vlmb.simulate(carved(speed, tilt), 1.5, rtol=1e-12, atol=1e-16, engine=engine)
    assert run.status == "finished", run.message
    side = run["legs.direction.y"] * np.cos(run["phi0"]) - run["legs.direction.x"] * np.sin(run["phi0"])
    rate = math.sqrt(abs(square))
    expected = np.cosh(rate * run.t) if square > 0.0 else np.cos(rate * run.t)
    np.testing.assert_allclose(side / tilt, expected, rtol=0, atol=1e-7 * expected.max())
    np.testing.assert_allclose(run["phi0_dot"], kappa * run["speed"] * side, rtol=0, atol=1e-12)


def test_the_ride_falls_below_and_stays_up_above() -> None:
    below, above = (vlmb.simulate(carved(speed, 0.02), 8.0) for speed in (8.0, 14.0))
    assert below.status == "stopped" and "fall" in below.message
    assert above.status == "finished" and np.abs(above["psi1"] - math.pi / 2).max() < 0.03
