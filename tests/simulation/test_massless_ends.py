"""A prescribed segment that carries nothing still has its length, its rate and its acceleration, wherever they are read."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vlmb
from tests.small_scenes import FIXED, PIVOT, SKI, Table, link, scene
from vlmb.views.visual_model import of_trajectory

LAW = "0.2 + 0.1*sin(3*t)"
both_engines = pytest.mark.parametrize("engine", ["core", "pinocchio"])


def arm(mass: float | None = None, **changes: Any) -> Table:
    """A rod whose end is pushed in and out; with a mass on it or without."""
    upper = {"motion": "prescribed", "law": LAW}
    return link("arm", rod={"length": 1.0, "mass": 2.0}, lower=FIXED, upper=upper, tip_mass=mass, **changes)


def length(t: np.ndarray) -> np.ndarray:
    return 1.4 + 0.1 * np.sin(3 * t)


@both_engines
def test_its_length_rate_and_drawing_follow_the_law(engine: str) -> None:
    seen = []
    made = scene(PIVOT, [arm()], start={"phi1": 0.3, "psi1": 0.6}, forces=[{"on": "M_psi1", "law": "arm.length_dot"}])

    def control(t: float, view: Any) -> dict[str, float]:
        seen.append((t, view["arm.length"], view["arm.length_dot"]))
        return {"M_phi1": 0.1 * view["arm.length"]}

    trajectory = vlmb.simulate(made, duration=1.0, engine=engine, control=control)
    t = trajectory.t
    np.testing.assert_allclose(trajectory["arm.length"], length(t), rtol=1e-13)
    np.testing.assert_allclose(trajectory["arm.length_dot"], 0.3 * np.cos(3 * t), atol=1e-13)
    out = np.linalg.norm(trajectory.position("arm", "tip"), axis=1)
    np.testing.assert_allclose(out, length(t), rtol=1e-12)
    times, lengths, rates = np.array(seen).T
    np.testing.assert_allclose(lengths, length(times), rtol=1e-12)
    np.testing.assert_allclose(rates, 0.3 * np.cos(3 * times), atol=1e-12)
    np.testing.assert_allclose(trajectory.controls["M_psi1"], 0.3 * np.cos(3 * t), atol=1e-12)
    np.testing.assert_allclose(trajectory.controls["M_phi1"], 0.1 * length(t), rtol=1e-12)
    assert np.abs(trajectory.controls["F1_2"]).max() < 1e-12  # nothing is moved by it
    assert np.abs(trajectory["balance"]).max() < 1e-5 and not trajectory.doubts
    assert "xi1_2" in trajectory.to_pandas()
    drawn = of_trajectory(trajectory, 20.0)
    upper = next(body for body in drawn.bodies if body.path == "links/arm/rod/upper")
    np.testing.assert_allclose(upper.scale[:, 0], 0.2 + 0.1 * np.sin(3 * drawn.t), atol=1e-3)


@both_engines
@pytest.mark.parametrize("plane", [False, True])
def test_a_row_holds_for_the_tip_that_is_there(engine: str, plane: bool) -> None:
    start = {"psi1": 0.4} if plane else {"phi1": 0.3, "psi1": 0.4}
    row = {"constraints": ["arm.tip.z = 0.6"], "plane": plane}
    trajectory = vlmb.simulate(scene(PIVOT, [arm()], start=start, **row), duration=1.0, engine=engine)
    np.testing.assert_allclose(trajectory["psi1"], np.arcsin(0.6 / length(trajectory.t)), atol=1e-8)
    np.testing.assert_allclose(trajectory.position("arm", "tip")[:, 2], 0.6, atol=1e-8)
    assert np.abs(trajectory["balance"]).max() < 1e-7  # what the segment does against the row is counted as its work
    assert np.abs(trajectory.controls["F1_2"]).max() > 0.1
    light = vlmb.simulate(scene(PIVOT, [arm(1e-9)], start=start, **row), duration=1.0, engine=engine)
    np.testing.assert_allclose(trajectory["psi1"], light["psi1"], atol=1e-7)
    np.testing.assert_allclose(trajectory.reactions["arm.tip.z = 0.6"], light.reactions["arm.tip.z = 0.6"], atol=1e-5)


def test_its_limits_and_the_snow_are_watched() -> None:
    short = arm()
    short["upper"] = short["upper"] | {"limits": [0.0, 0.25]}
    with pytest.raises(vlmb.SceneError, match=r"xi1_2: the law .* outside \[0, 0\.25\]"):
        vlmb.simulate(scene(PIVOT, [short], start={"psi1": 0.6}), duration=1.0)
    down = arm()
    down["upper"] = {"motion": "prescribed", "law": "0.1 + 0.4*t**2", "limits": [0.0, 9.0]}
    held = scene(SKI, [down], start={"psi1": -1.0}, run={"fall": False})
    assert vlmb.build(held).left_out == ("xi1_1, the lower segment of 'arm': fixed at 0.2 m",)
    leaning = scene(SKI, [down], start={"psi1": 0.3, "psi1_dot": 0.0}, run={"fall": True})
    fallen = vlmb.simulate(leaning, duration=2.0)
    assert fallen.status == "stopped" and "arm.tip reached the snow" in fallen.message
    assert abs(fallen.position("arm", "tip")[-1, 2]) < 1e-9


def test_accelerations_at_a_posture_are_those_of_the_run() -> None:
    made = scene(PIVOT, [arm()], constraints=["arm.tip.z = 0.6"], start={"phi1": 0.3, "psi1": np.arcsin(0.6 / 1.4)})
    checked = vlmb.check(made)
    assert checked.degrees_of_freedom == 1 and "both engines agree" in checked.report
    h = 1e-4
    trajectory = vlmb.simulate(made, duration=2 * h, t_eval=[0.0, h, 2 * h])
    first, middle, last = trajectory["psi1_dot"]
    at = {name: trajectory[name][1] for name in ("phi1", "psi1")}
    found = vlmb.accelerations(made, at, {"psi1_dot": middle, "phi1_dot": 0.0}, t=h)
    assert found["psi1"] == pytest.approx((last - first) / (2 * h), rel=1e-5)
    assert found["xi1_2"] == pytest.approx(-0.9 * np.sin(3 * h), rel=1e-9)
