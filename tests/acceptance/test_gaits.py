"""Walkers found as gaits from rough guesses, against their own equations: starts to 1e-9, multipliers to 1e-6."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.reference.contacts import GOSWAMI, Compass, Runner, compass_gait, compass_step, steady_run, steady_walk, walking_step
from tests.simulation.walkers import model

LEGS = ["psi1", "psi2", "psi1_dot", "psi2_dot"]


def multipliers(walker: Compass, state: np.ndarray) -> np.ndarray:
    """Return the multipliers of the compass, on the section, by differences of two sizes of its own equations."""

    def after(u: np.ndarray) -> np.ndarray:
        found: np.ndarray = compass_step(walker, np.array([u[0], -2.0 * walker.slope - u[0], u[1], u[2]])).state[[0, 2, 3]]
        return found

    u, slopes = state[[0, 2, 3]], []
    for h in (2e-4, 1e-4):
        slopes.append(np.column_stack([(after(u + h * e) - after(u - h * e)) / (2.0 * h) for e in np.eye(3)]))
    values = np.linalg.eigvals((4.0 * slopes[1] - slopes[0]) / 3.0)
    return values[np.argsort(-np.abs(values), kind="stable")]


def off_compass(gait: Any, walker: Compass, state: np.ndarray, period: float) -> None:
    """Compare a gait with the compass's own: start 1e-9, multipliers 1e-6."""
    lean = walker.slope - math.pi / 2
    found = [gait.start[name] - at for name, at in (("psi1", lean), ("psi2", lean), ("psi1_dot", 0.0), ("psi2_dot", 0.0))]
    np.testing.assert_allclose(found, state, atol=1e-9)
    assert gait.period == pytest.approx(period, abs=1e-9) and gait.residual < 1e-9
    own = multipliers(walker, state)
    np.testing.assert_allclose(np.abs(gait.multipliers), np.abs(own), atol=1e-6)
    np.testing.assert_allclose(gait.multipliers.real, own.real, atol=1e-6)
    assert gait.uncertainty.max() < 1e-6 and len(gait.multipliers) == 3


@pytest.mark.acceptance
def test_compass_from_a_rough_guess() -> None:
    """It is on the page of gaits, too."""
    guess = {"stance": 0.23, "swing": -0.34, "stance_rate": -1.15, "swing_rate": -0.4}
    scene = model("compass_gait", 2.0, {f"parameters.{name}": value for name, value in guess.items()})
    gait = vlmb.find_gait(scene, until="touch r", free=LEGS, mirror={"left": "right"})
    own = compass_gait()
    off_compass(gait, GOSWAMI, own.state, own.time)
    assert gait.stability == "asymptotically stable" and (gait.unknowns, gait.equations, gait.family) == (4, 4, 0)
    assert gait.trajectory.events[-1].lost == pytest.approx(own.lost, abs=1e-9)
    again = vlmb.simulate(scene, 3.0, start=gait.start)
    assert np.diff([0.0, *(event.t for event in again.events)]) == pytest.approx(own.time, abs=1e-8)


@pytest.mark.acceptance
@pytest.mark.parametrize("beta", [1e-2, 1e-3, 1e-4])
def test_simplest_walker_with_feet_from_a_rough_guess(beta: float) -> None:
    scene = model("simplest_walker", 6.0, {"parameters.beta": beta, "parameters.theta": 0.205, "parameters.rate": -0.203})
    gait = vlmb.find_gait(scene, until="touch r", free=LEGS, mirror={"left": "right"})
    walker = Compass(1.0, beta, 0.0, 1.0, 0.009, 1.0)
    own = compass_gait(walker, (0.2003 - 0.009, -0.1998, -0.1998 * math.cos(0.4)))
    off_compass(gait, walker, own.state, own.time)


@pytest.mark.acceptance
def test_running_on_a_spring_from_a_rough_guess() -> None:
    own, slope = steady_run()
    scene = model("slip_runner", 2.0, {"parameters.apex": 0.95})
    gait = vlmb.find_gait(scene, until="z_dot", free=["z", "x_dot"], hold={"energy": 1784.8})
    assert (gait.start["z"], gait.start["x_dot"]) == pytest.approx((own.height, own.speed), abs=1e-9)
    assert gait.period == pytest.approx(own.contact + own.flight, abs=1e-9) and gait.family == 0
    np.testing.assert_allclose(gait.multipliers, [1.0, slope], atol=1e-6)  # the first leads to another energy
    assert gait.uncertainty.max() < 1e-6 and gait.stability == "neutral"


@pytest.mark.acceptance
def test_walking_on_two_springs_from_a_rough_guess() -> None:
    """From one vertical leg to the other."""
    own = steady_walk()
    scene = model("slip_walker", 2.0, {"start.z": 0.9705, "start.x_dot": 1.1})
    gait = vlmb.find_gait(scene, until="right.foot.x - x", free=["z", "x_dot", "z_dot"], hold={"energy": 816.0})
    found = gait.start["z"], gait.start["x_dot"], gait.start["z_dot"], gait.period
    assert found == pytest.approx((own.height, own.speed, 0.0, own.time), abs=1e-9)
    assert gait.trajectory["x"][-1] == pytest.approx(own.length, abs=1e-9)
    assert gait.uncertainty.max() < 1e-6 and gait.multipliers[0] == pytest.approx(1.0, abs=1e-6)
    walker = Runner(stiffness=14_000.0, attack=math.radians(69.0), energy=816.0)

    def after(height: float, rising: float) -> np.ndarray:
        step = walking_step(height, walker, rising)
        return np.array([step.height, step.vertical_speed])

    slopes = []
    for h in (2e-4, 1e-4):  # at the same energy; the third multiplier is that of the energy
        ways = (h, 0.0), (0.0, h)
        slopes.append(np.column_stack([(after(own.height + a, b) - after(own.height - a, -b)) / (2.0 * h) for a, b in ways]))
    values = np.linalg.eigvals((4.0 * slopes[1] - slopes[0]) / 3.0)
    assert np.abs(gait.multipliers[1:]) == pytest.approx(np.abs(values), abs=1e-6)
