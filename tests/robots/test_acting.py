"""What acts beside robots, against the engine of links alone: given lengths, friction and drag, gains that the motion gives.

A robot without mass that hangs on the ground changes nothing, so links beside it must move as they do alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vlmb

HINGE = """<robot name="still"><link name="base"/><link name="arm"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
<inertia ixx="0.01" iyy="0.02" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="100" velocity="10"/></joint></robot>"""
EXACT = {"rtol": 1e-11, "atol": 1e-12}
SKI = {"kind": "ski", "mass": 5.0, "inertia": 0.6}
RIDER = {
    "name": "legs", "rod": {"length": 0.6, "mass": 40.0}, "tip_mass": 30.0,
    "lower": {"motion": "prescribed", "law": "0.5 + 0.05*sin(4*t)"},
    "upper": {"length": 0.1, "stiffness": 4e4, "damping": 300.0},
}  # fmt: skip


def both(scene: dict[str, Any], names: tuple[str, ...], error: float, controls: tuple[str, ...] = ()) -> tuple[Any, Any]:
    """Run a scene of links alone, and beside a robot that hangs apart from them; compare coordinates and forces."""
    alone = vlmb.simulate(scene)
    robot = {"name": "still", "urdf": HINGE, "attach": {"to": "ground"}}
    beside = vlmb.simulate({**scene, "robots": [robot]})
    assert alone.status == beside.status, (alone.message, beside.message)
    for name in (*names, *(f"{name}_dot" for name in names)):
        assert np.abs(alone[name] - beside[name]).max() < error * max(1.0, np.abs(alone[name]).max()), name
    for name in controls:
        assert np.abs(alone.controls[name] - beside.controls[name]).max() < 1e3 * error * np.abs(alone.controls[name]).max(), name
    assert np.abs(beside["balance"]).max() < 1e-8 * beside["kinetic"].max()
    return alone, beside


def test_a_given_length_beside_a_robot() -> None:
    start = {"psi1": 1.3, "phi1": 0.2, "psi1_dot": 0.4, "phi1_dot": 0.3}
    scene = {"base": {"kind": "pivot"}, "links": [RIDER], "start": start, "run": {"duration": 1.0, "fall": False, **EXACT}}
    _, beside = both(scene, ("psi1", "phi1", "xi1_1", "xi1_2"), 1e-8, ("F1_1",))
    assert np.abs(beside["legs.lower"] - (0.5 + 0.05 * np.sin(4.0 * beside.t))).max() == 0.0
    assert "F1_1" not in beside.reactions and "F1_1" in beside.work_by_force
    still = {"robots": [{"name": "still", "urdf": HINGE}]}
    with pytest.raises(vlmb.SceneError, match="gives this length"):
        vlmb.check({**scene, **still, "start": {"legs.lower": 0.5}})
    with pytest.raises(vlmb.SceneError, match="its force is a result"):
        vlmb.check({**scene, **still, "forces": [{"on": "F1_1", "law": "1"}]})
    steps = {**RIDER, "lower": {"motion": "prescribed", "law": "0.5 + 0.1*step(t - 0.5)"}}
    with pytest.raises(vlmb.SceneError, match="not smooth enough"):
        vlmb.check({**scene, **still, "links": [steps]})


@pytest.mark.parametrize("form", ["multiplier", "reduction"])
def test_friction_and_drag_beside_a_robot(form: str) -> None:
    base = {**SKI, "friction": 0.1, "drag": 0.4, "drag_at": "legs.tip", "width": 0.2, "length": 1.5}
    scene = {
        "base": base, "links": [RIDER], "slope": 0.2, "start": {"psi1": 1.4, "phi0": 0.3, "phi0_dot": 0.5, "speed": 2.0},
        "forces": [{"at": "legs.tip", "force": ["3", "0", "20*sin(5*t)"]}],
        "springs": [{"between": ["legs.tip", [1.0, 0.5, 2.0]], "stiffness": 30.0, "rest": 0.5}],
        "run": {"duration": 0.8, "knife_edge": form, "fall": False, **EXACT},
    }  # fmt: skip
    if form == "multiplier":
        base["friction_on"] = "resultant"
    alone, beside = both(scene, ("x", "y", "phi0", "psi1", "xi1_2"), 1e-7, ("F1_1",))
    for name in ("knife_edge", "normal", "friction", "roll_moment", "pitch_moment"):
        assert np.abs(alone.reactions[name] - beside.reactions[name]).max() < 1e-5 * np.abs(alone.reactions["normal"]).max(), name
    assert ("tips there" in alone.summary()) == ("tips there" in beside.summary())


def test_a_ski_with_a_robot_stops_and_stands() -> None:
    base = {**SKI, "friction": 0.3}
    scene = {
        "base": base, "links": [{**RIDER, "lower": {"length": 0.5, "motion": "fixed"}}], "slope": 0.1,
        "start": {"psi1": 1.5, "speed": 0.2}, "run": {"duration": 0.3, "fall": False, **EXACT},
    }  # fmt: skip
    _, beside = both(scene, ("x", "psi1"), 1e-7)
    assert beside["speed"][-1] == 0.0


MOVING = {
    "gains": {"h": [["-25 - 5*sin(psi1)", 0.0], [0.0, "-16 - t"]], "k": [["-10", 0.0], [0.0, "-8 - psi1**2"]]},
    "weights": {"frequency": 5.0, "weights": {"M_psi1": "0.01*(1 + psi1**2)", "F1_2": "1e-6*(1 + t)"}},
    "u0": {"frequency": 5.0, "u0": "2e5*sin(3*t)"},
    "u0 and a border": {"frequency": 5.0, "u0": "3e6*cos(phi1)", "border": [["1", "psi1", "0", "t"]]},
}


@pytest.mark.parametrize("name", MOVING)
def test_a_programme_whose_numbers_the_motion_gives(name: str) -> None:
    controls = ["M_psi1", "M_phi1", "F1_1", "F1_2"]
    weights = {"M_psi1": 1e-5, "M_phi1": 2e-5, "F1_1": 1e-6, "F1_2": 3e-6} | MOVING[name].get("weights", {})
    segments = {"lower": {"length": 0.5, "stiffness": 3e3}, "upper": {"length": 0.1, "stiffness": 4e4}}
    programme = {
        "constraints": ["legs.tip.z = 1.1 + 0.05*sin(t)", "legs.tip.x = 0.25"], **MOVING[name],
        "controls": controls[1:] if name == "u0" else controls,
    }  # fmt: skip
    programme["weights"] = {force: weights[force] for force in programme["controls"]}
    start = {"psi1": 1.3, "phi1": 0.3, "xi1_1": 0.5, "xi1_2": 0.1}
    start |= {"psi1_dot": 0.0, "phi1_dot": 0.2, "xi1_1_dot": 0.0, "xi1_2_dot": 0.0}
    scene = {
        "base": {"kind": "pivot"}, "links": [{**RIDER, **segments}], "start": start, "programme": programme,
        "run": {"duration": 0.5, "fall": False, **EXACT},
    }  # fmt: skip
    alone, beside = both(scene, ("psi1", "phi1", "xi1_1", "xi1_2"), 1e-7)
    if "u0" in programme:
        assert np.abs(alone.controls["F1_1"]).max() > 1.0  # so that it is seen
    most = max(np.abs(values).max() for values in alone.controls.values())
    for control in programme["controls"]:
        assert np.abs(alone.controls[control] - beside.controls[control]).max() < 1e-5 * most, control


def gripper(tie: str, **robot: Any) -> dict[str, Any]:
    """Two fingers that slide sideways, 0.3 kg and 0.5 kg; the second one mimics the first."""
    finger = """<link name="{0}_link"><inertial><mass value="{1}"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0"
    iyz="0"/></inertial></link><joint name="{0}" type="prismatic"><parent link="palm"/><child link="{0}_link"/>
    <axis xyz="1 0 0"/>{2}<limit lower="-9" upper="9" effort="9" velocity="9"/></joint>"""
    urdf = f'<robot name="hand"><link name="palm"/>{finger.format("one", 0.3, "")}{finger.format("two", 0.5, tie)}</robot>'
    parts = {"robots": [{"name": "hand", "urdf": urdf, **robot}], "forces": [{"on": "T_one", "law": "0.7"}]}
    return {"base": {"kind": "pivot"}, **parts, "run": {"duration": 1.0}}


def test_a_joint_mimics_another() -> None:
    run = vlmb.simulate(gripper('<mimic joint="one" multiplier="-2" offset="0.1"/>'), rtol=1e-10, atol=1e-12)
    a = 0.7 / (0.3 + 4.0 * 0.5)  # the second finger's mass counts by the square of the ratio
    assert run["one"] == pytest.approx(0.5 * a * run.t**2, abs=1e-9) and run["two"] == pytest.approx(0.1 - a * run.t**2, abs=1e-9)
    assert run.reactions["mimic:two"] == pytest.approx(np.full(len(run), -2.0 * a * 0.5), rel=1e-9)
    assert np.abs(run["balance"]).max() < 1e-10 and not run.adjustments
    scene = gripper('<mimic joint="one" multiplier="-2" offset="0.1"/>')
    given = vlmb.check({**scene, "start": {"one": 0.02, "one_dot": 0.3}}).start
    assert (given.coordinates["two"], given.rates["two_dot"]) == pytest.approx((0.06, -0.6), abs=1e-12)


def test_a_joint_that_mimics_a_locked_one_stays_and_what_cannot_be_is_told() -> None:
    stays = vlmb.simulate({**gripper('<mimic joint="one" offset="0.01"/>', locked=["one"], posture={"one": 0.03}), "forces": []})
    assert stays["two"] == pytest.approx(np.full(len(stays), 0.04), abs=1e-12)
    lost = vlmb.build(gripper('<mimic joint="thumb"/>'))
    assert any("mimic unknown ones" in told and "two" in told for told in lost.left_out)
    with pytest.raises(vlmb.SceneError, match="'two': mimic: multiplier = 'x' is no number"):
        vlmb.build(gripper('<mimic joint="one" multiplier="x"/>'))
    with pytest.raises(vlmb.SceneError, match="not finite"):
        vlmb.build(gripper('<mimic joint="one" offset="inf"/>'))
