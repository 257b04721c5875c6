"""The whole motion of models/exoskeleton.toml: both engines, errors from a wrong start, every share of motors and muscles."""

from __future__ import annotations

import math

import numpy as np
import pytest

import vlmb
from tests.simulation.test_exoskeleton import MODEL, MOTORS, MUSCLES, phases

pytestmark = pytest.mark.acceptance


@pytest.fixture(scope="module")
def scene():
    return vlmb.load_scene(MODEL)


def test_both_engines_go_through_all_phases_alike(scene):
    core, other = (vlmb.simulate(scene, engine=engine, duration=3.0) for engine in ("core", "pinocchio"))
    assert [event.t for event in core.events] == pytest.approx([event.t for event in other.events], abs=1e-8)
    assert len(core.t) == len(other.t)
    for name in ("x", "z", "psi1", "xi1_2", "right_shank.tip.x", "right_lower_bar.elevation"):
        assert core[name] == pytest.approx(other[name], abs=1e-6), name
    for name in (*MOTORS, "F11_1"):
        assert core.controls[name] == pytest.approx(other.controls[name], abs=1e-3), name


def test_errors_of_the_start_decay_by_themselves(scene):
    """Each row starts wrong: its error is the critically damped one until the foot lifts, whatever the others do."""
    x, z, lean = 0.09, 0.55, 1.05
    start = {"x": x, "z": z, "psi1": lean, "psi2": 0.97, "frame.elevation": lean - math.pi, "psi1_dot": 0.0}
    for side, foot in (("left", 0.3), ("right", 0.0)):
        for part, at in zip(("thigh", "shank", "upper_bar", "lower_bar"), 2 * leg(scene, foot - x, z), strict=True):
            start[f"{side}_{part}.elevation"] = at
    start |= {f"xi{k}_1": scene.links[k - 1].lower.length for k in range(3, 12)}
    run = vlmb.simulate(scene.changed(start=start))
    programme, (_, at) = scene.programmes[0], phases(run)[0]
    wrong = 0.0
    for w, equation in zip(programme.frequency, programme.constraints, strict=True):
        z, rate = (values[at] for values in run.residuals[equation.partition(": ")[0]])
        t = run.t[at]
        assert z == pytest.approx((z[0] + (rate[0] + w * z[0]) * t) * np.exp(-w * t), abs=1e-6), equation
        wrong += abs(z[0]) > 1e-3
    assert wrong >= 3 and np.abs(run["balance"]).max() < 1e-7


def leg(scene, ahead, high):
    """Return the elevations of thigh and shank from hips so high over a foot so far ahead, the knee in front."""
    thigh, shank = scene.parameters["thigh"], scene.parameters["shank"]
    far, line = math.hypot(ahead, high), math.atan2(-high, ahead)
    hip = math.acos((thigh**2 + far**2 - shank**2) / (2 * thigh * far))
    return line + hip, line - math.acos((shank**2 + far**2 - thigh**2) / (2 * shank * far))


@pytest.mark.parametrize("share", [0.05, 0.5, 0.95])
def test_the_motion_is_the_same_for_every_share(scene, share):
    one, other = vlmb.simulate(scene, duration=2.6), vlmb.simulate(scene.changed(parameters={"share": share}), duration=2.6)
    assert other["z"] == pytest.approx(one["z"], abs=1e-7) and other["psi6"] == pytest.approx(one["psi6"], abs=1e-7)
    for motor, muscle in zip(MOTORS, MUSCLES, strict=True):
        both = other.controls[motor] + other.controls[muscle]
        assert other.controls[motor] == pytest.approx(share * both, abs=1e-6)
        assert both == pytest.approx(one.controls[motor] + one.controls[muscle], abs=1e-3)
