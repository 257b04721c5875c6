"""The witness of contacts has the digits that are known of its cases, and what its cases have to keep."""

from __future__ import annotations

import math
from itertools import islice

import numpy as np
import pytest

from tests.reference import contacts as known


def near(value: float, rel: float = 0.0) -> object:
    """The value to 12 decimals, or to a relative bound."""
    return pytest.approx(value, rel=rel, abs=0.0 if rel else 1.2e-12)


def test_ball() -> None:
    impacts = list(islice(known.ball_impacts(), 60))
    assert impacts[0][0] == near(0.45152364098573, 1e-13) and impacts[1][0] == near(1.17396146656290, 1e-13)
    assert known.ball_rests() == near(4.06371276887158, 1e-14)
    assert known.ball_rests() - impacts[-1][0] == pytest.approx(0.8**59 * 2 * 5 * impacts[0][0] * 0.8, rel=1e-6)
    lost = sum(0.5 * speed**2 * (1.0 - 0.8**2) for _, speed in islice(known.ball_impacts(), 400))
    assert lost == near(9.81, 1e-13)


def test_rods() -> None:
    smooth, sticks = known.rod_on_smooth_floor(), known.rod_sticks()
    assert smooth.normal == near(1.08894870037899, 1e-14) and smooth.lost == near(0.54447435018950, 1e-13)
    assert sticks.normal == near(1.12252464, 4e-9) and sticks.along == near(0.7390873, 4e-8)
    assert sticks.along / sticks.normal == near(0.658415209159)
    fall = known.ladder()
    assert fall.angle == near(0.67047647842666, 2e-14) and fall.leaves == near(0.407707335856)
    assert fall.flat == near(0.576918677127)


def test_blocks() -> None:
    time, place = known.oscillator_rests()
    assert time == near(2.51327412287183, 2e-15) and place == near(0.02912)
    block = known.pulled_block()
    assert block.slips == near(0.14715, 1e-14)
    assert block.lasts == near(0.53711477735011, 2e-14) and block.period == near(0.63521477735011, 2e-14)
    up, stays = known.thrown_up(0.3), known.thrown_up(0.15)
    assert up.stops == near(0.62847975900299, 1e-14) and up.back == near(1.98495384632264, 1e-14)
    assert stays.stops == near(0.88080972769583, 1e-14) and stays.back is None


def test_rimless_wheel() -> None:
    wheel = known.rimless_wheel()
    assert wheel.rate == near(1.09546283964766, 1e-14) and wheel.multiplier == near(0.5, 1e-15)
    assert wheel.step == near(1.034549811423)
    assert wheel.lost == near(0.5 * wheel.rate**2 * (1.0 / wheel.multiplier - 1.0), 1e-14)


def test_compass_gait() -> None:
    gait = known.compass_gait()
    np.testing.assert_allclose(gait.state, [0.218668802939, -0.323388558059, -1.092383589884, -0.377373948907], atol=2e-12)
    assert gait.time == near(0.734346391159) and gait.length == near(0.535445415430)
    assert gait.lost == near(5.498121984723)
    assert gait.lost == near(20.0 * 9.81 * gait.length * math.sin(math.radians(3.0)), 1e-11)  # what the slope gave
    again = known.compass_step(known.GOSWAMI, gait.state)
    np.testing.assert_allclose(again.state, gait.state, atol=1e-11)


def test_simplest_walker() -> None:
    gait = known.simplest_walker()
    assert gait.angle == near(0.20031090054425, 2e-11) and gait.rate == near(-0.19983247300495, 2e-11)
    assert gait.time == near(3.88246375285, 3e-11)
    times = [known.first_step_with_feet(mass) for mass in (1e-3, 1e-4, 1e-5)]
    np.testing.assert_allclose(times, [3.90032, 3.88424, 3.88264], atol=6e-6)
    errors = np.array(times) - gait.time
    np.testing.assert_allclose(errors[:-1] / errors[1:], 10.0, rtol=0.02)
    assert times[2] + (times[2] - times[1]) / 9.0 == pytest.approx(gait.time, abs=1e-6)


def test_running() -> None:
    stride, slope = known.steady_run()
    assert stride.height == near(0.940267144380) and stride.speed == near(5.115853655772)
    assert stride.contact == near(0.149240070570) and stride.flight == near(0.103292543248)
    assert slope == pytest.approx(-0.161308, abs=1e-6)


def test_running_is_stable_between_attacks() -> None:
    """From 66.5 to 68.75 degrees in quarters: beyond, the map turns over too steeply; before, no stride repeats."""
    slopes = [known.steady_run(known.Runner(attack=math.radians(degrees)))[1] for degrees in (66.5, 68.75, 69.0)]
    assert abs(slopes[0]) < 1.0 and abs(slopes[1]) < 1.0 and slopes[2] < -1.0
    with pytest.raises(ValueError, match="signs"):
        known.steady_run(known.Runner(attack=math.radians(66.25)))


def test_walking() -> None:
    step = known.steady_walk()
    assert step.height == near(0.970834667442) and step.speed == near(1.096980362504)
    assert step.single == near(0.138984856485, 1e-11) and step.rest == near(step.single, 1e-11)
    assert step.double == near(0.166562990043, 1e-11)
    assert step.length == near(0.514236114439)


def test_jump_and_skis() -> None:
    time, speed = known.jump()
    assert time == near(0.18120964585726, 1e-13) and speed == near(1.18545086359579, 1e-14)
    landing = known.ski_lands()
    assert landing.speed == near(9.80066577841242, 1e-14) and landing.edge == near(158.935464636, 3e-12)
    assert landing.lost == near(517.878011994, 1e-12)
    skate = known.skate()
    assert skate.lets_go == near(0.70304760494854, 1e-14) and skate.holds == near(2.901142665463)
    assert known.skid_stops() == near(0.50968399592253, 1e-14)
    heading = skate.holds  # at 1 rad/s
    across = 2.0 * 0.4 * math.cos(0.3) * 9.81 / 2.0
    needed = float(skate.velocity @ [math.cos(heading), math.sin(heading)]) + 9.81 * math.sin(0.3) * math.sin(heading)
    assert abs(needed) < across  # so it holds
