"""Gaits found from rough guesses, against closed forms; walkers with two legs are in tests/acceptance."""

from __future__ import annotations

import math

import pytest

import vlmb
from tests.simulation.walkers import TIGHT, model, wheel
from vlmb.core.jit import COMPILED
from vlmb.errors import SceneError, SimulationError, StudyError

pytestmark = pytest.mark.skipif(not COMPILED, reason="too slow in plain Python")

G = 9.81


def rolling(mass: float) -> tuple[float, float]:
    """Speed of the rimless wheel after an impact, and its multiplier, for spokes of a mass: omega' = share omega before it."""
    alpha, whole, inertia = math.pi / 8, 1.0 + 8 * mass, 8 * mass / 3
    share = (inertia + whole * math.cos(2 * alpha)) / (inertia + whole)
    gained = 4 * whole * G * math.sin(alpha) * math.sin(0.08) / (inertia + whole)
    return -share * math.sqrt(gained / (1.0 - share**2)), share**2


def test_rimless_wheel_from_a_rough_guess() -> None:
    gait = vlmb.find_gait(model("rimless_wheel", 5.0, {"parameters.turning": 1.3}), until="touch s1.tip", free=["psi1_dot"])
    speed, multiplier = rolling(0.01)
    assert gait.start["psi1_dot"] == pytest.approx(speed, abs=1e-9)
    assert gait.start["psi5_dot"] == pytest.approx(speed, abs=1e-9)  # the rows take the other spokes along, the foot the hub
    assert math.hypot(gait.start["x_dot"], gait.start["z_dot"]) == pytest.approx(abs(speed), abs=1e-9)
    assert gait.multipliers == pytest.approx([multiplier], abs=1e-8) and gait.uncertainty[0] < 1e-6
    assert rolling(0.0) == pytest.approx((-1.09546283964766, 0.5), abs=1e-13)


def hopping(height: float) -> vlmb.Scene:
    """A mass that loses nothing as it bounces, from an apex."""
    bouncing = {"point": "base", "friction": 0.0, "restitution": 1.0}
    return vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "free", "mass": 2.0}, "contacts": [bouncing],
        "start": {"z": height, "x_dot": 0.5}, "run": {**TIGHT, "duration": 3.0},
    })  # fmt: skip


def test_conservative_gaits_are_a_family_of_which_the_energy_holds_one() -> None:
    free = vlmb.find_gait(hopping(0.7), until="z_dot", free=["z"])
    assert free.start["z"] == 0.7 and free.family == 1 and free.stability == "neutral"
    assert free.multipliers == pytest.approx([1.0], abs=1e-7)
    assert free.period == pytest.approx(2 * math.sqrt(2 * 0.7 / G), abs=1e-9)
    held = vlmb.find_gait(hopping(0.7), until="z_dot", free=["z", "z_dot"], hold={"energy": 2.0 * (0.5 * G + 0.125)})
    assert held.start["z"] == pytest.approx(0.5, abs=1e-9) and (held.unknowns, held.equations, held.family) == (2, 3, 0)
    assert held.multipliers == pytest.approx([1.0], abs=1e-6)  # along the section; that of the section itself is left out


def test_what_cannot_be_is_named() -> None:
    scene = wheel()
    for wrong, error, text in (
        ({"free": ["psi9"]}, SceneError, "psi9"),
        ({"free": []}, SceneError, "must be a list of coordinates and rates"),
        ({"free": ["s1.tip.z"]}, SceneError, "none of the start's coordinates and rates"),
        ({"free": ["psi1_dot"], "mirror": {"left": "s1"}}, SceneError, "no link 'left'"),
        ({"free": ["psi1_dot"], "advance": {"x": 0.7}}, SceneError, "advance: x is not free"),
        ({"free": ["psi1_dot"], "until": "touch s9.tip"}, SceneError, "no contact 's9.tip'"),
        ({"free": ["psi1_dot"], "until": "touch s4.tip"}, SimulationError, "within run.duration = 0.3 s"),
    ):
        with pytest.raises(error, match=text):
            vlmb.find_gait(scene.changed(run={"duration": 0.3}), **{"until": "touch s1.tip", **wrong})
    with pytest.raises(StudyError, match=r"feet that stand \(s0.tip.x = .*\) and ideal constraints do not hold"):
        vlmb.find_gait(scene, until="touch s1.tip", free=["psi1_dot", "psi2_dot"])
