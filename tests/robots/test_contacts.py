"""Contacts on robots' frames: soles of several points, against closed forms, Pinocchio's own impact and Newton's law."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import simpson

import vlmb
from tests.robots.scenes import TALOS
from vlmb.simulation.robot_trajectory import RobotTrajectory

BLOCK = """<robot name="block"><link name="body"><inertial><mass value="12"/>
<inertia ixx="0.25" iyy="0.3" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""
FOOT = """<link name="{0}_foot"><inertial><origin xyz="0.02 0 0.05"/><mass value="1.5"/>
<inertia ixx="0.004" iyy="0.006" izz="0.006" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{0}_leg" type="prismatic"><parent link="torso"/><child link="{0}_foot"/><origin xyz="0 {1} -0.5"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1000" velocity="10"/></joint>"""
BIPED = f"""<robot name="biped"><link name="torso"><inertial><origin xyz="0.03 0.01 0.1"/><mass value="20"/>
<inertia ixx="0.5" iyy="0.4" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial></link>
{FOOT.format("left", 0.12)}{FOOT.format("right", -0.12)}</robot>"""
CORNERS = {"toe_in": (0.12, 0.04), "toe_out": (0.12, -0.04), "heel_in": (-0.08, 0.04), "heel_out": (-0.08, -0.04)}
SOLE = {name: ["body", *place, -0.1] for name, place in CORNERS.items()}
EXACT = {"rtol": 1e-9, "atol": 1e-10}


def run(scene: dict[str, Any], **options: Any) -> RobotTrajectory:
    trajectory = vlmb.simulate(scene, **options)
    assert isinstance(trajectory, RobotTrajectory)
    return trajectory


def block(points: dict[str, list[Any]], friction: Any, **changes: Any) -> dict[str, Any]:
    robot = {"name": "block", "urdf": BLOCK, "attach": {"root": "free"}, "points": points}
    contacts = [{"name": name, "point": f"block.{name}", "friction": friction} for name in points]
    return {"base": {"kind": "pivot"}, "robots": [robot], "contacts": contacts, "run": {"duration": 1.0, **EXACT}, **changes}


def biped(friction: Any = 0.8, **start: float) -> dict[str, Any]:
    sides = ("left", "right")
    points = {f"{side}_{name}": [f"{side}_foot", *place, 0.0] for side in sides for name, place in CORNERS.items()}
    robot = {"name": "biped", "urdf": BIPED, "attach": {"root": "free"}, "points": points}
    return {
        "base": {"kind": "pivot"}, "robots": [robot], "run": {"duration": 0.4, **EXACT}, "start": {"root.z": 0.55, **start},
        "contacts": [{"name": name, "point": f"biped.{name}", "friction": friction} for name in points],
        "forces": [{"on": f"T_{side}_leg", "law": f"-4000*{side}_leg - 120*{side}_leg_dot"} for side in sides],
    }  # fmt: skip


def test_a_block_falls_on_its_sole() -> None:
    trajectory = run(block(SOLE, "rough", start={"root.z": 0.4}))
    (touch,) = trajectory.events
    assert touch.kind == "touch" and touch.contacts == tuple(SOLE)
    assert touch.t == pytest.approx(np.sqrt(2.0 * 0.3 / 9.81), rel=1e-10)
    assert touch.lost == pytest.approx(12.0 * 9.81 * 0.3, rel=1e-9)
    assert np.abs(trajectory["balance"]).max() < 1e-8
    assert min(trajectory[f"{name}.z"].min() for name in SOLE) > -1e-9
    total = sum(trajectory.reactions[name] for name in SOLE)
    assert np.abs(total[-1] - [0.0, 0.0, 12.0 * 9.81]).max() < 1e-6
    pressed = trajectory.centre_of_pressure("toe_*", "heel_*")
    assert np.isnan(pressed[0]).all() and np.abs(pressed[-1]).max() < 1e-9
    assert trajectory.phases[-1].closed == tuple(SOLE)


def test_a_sliding_block_stops_where_coulomb_has_it() -> None:
    scene = block({"middle": ["body", 0.0, 0.0, 0.0]}, 0.2, slope=0.3, start={"root.x_dot": -3.0})
    trajectory = run(scene, until="stick middle", duration=3.0)
    ahead = run({**scene, "start": {"root.x_dot": 3.0}}, duration=0.3)
    friction, fall = 0.2 * 9.81 * np.cos(0.3), 9.81 * np.sin(0.3)
    uphill = trajectory if trajectory["root.x"][-1] * ahead["root.x_dot"][-1] < 0.0 else ahead
    assert abs(uphill["root.x_dot"][0]) == 3.0
    turned = 3.0 / (friction + fall)
    assert turned == pytest.approx(0.62847975900299, rel=1e-12)
    back = [event for event in trajectory.events if event.kind in ("slip", "stick")]
    assert back and back[0].t == pytest.approx(turned, rel=1e-9)
    assert np.abs(trajectory["balance"]).max() < 1e-8


def test_an_impact_of_soles_that_stick_is_pinocchios() -> None:
    trajectory = run(biped(), until="touch left_toe_in")
    model, mechanism = trajectory.mechanism.model, trajectory.mechanism
    q, before, after = trajectory.q[-1], trajectory.v[-2], trajectory.v[-1]
    assert trajectory.t[-1] == trajectory.t[-2] and set(trajectory.events[0].modes.values()) == {"held"}
    data = pin.Data(model)
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    impulses = trajectory.events[0].impulses
    frames = {name: mechanism.frames[f"biped.{name}"] for name in impulses}
    lines = {name: pin.getFrameJacobian(model, data, at, pin.LOCAL_WORLD_ALIGNED)[:3] for name, at in frames.items()}
    _, sizes, ways = np.linalg.svd(np.vstack([*lines.values()]))  # its rows must be independent
    expected = pin.impulseDynamics(model, data, q, before, ways[: int((sizes > 1e-9).sum())], 0.0, 0.0)
    assert np.abs(after - expected).max() < 1e-12
    mass = np.array(pin.crba(model, data, q))
    together = sum(lines[name].T @ impulse for name, impulse in impulses.items())
    assert np.abs((np.triu(mass) + np.triu(mass, 1).T) @ (after - before) - together).max() < 1e-9


@pytest.mark.parametrize("start", [{}, {"root.pitch": 0.05}], ids=["flat", "on its heels"])
def test_a_biped_dropped_on_its_soles(start: dict[str, float], tmp_path: Path) -> None:
    scene = biped(**start)
    trajectory = run(scene)
    assert trajectory.status == "finished", trajectory.message
    names = [contact["name"] for contact in scene["contacts"]]
    assert np.abs(trajectory["balance"]).max() < 1e-8
    assert min(trajectory[f"{name}.z"].min() for name in names) > -1e-9
    # Newton and Euler for the whole, by differences of its momentum inside the last phase
    model, data = trajectory.mechanism.model, pin.Data(trajectory.mechanism.model)
    last = slice(-12, None)
    t, momentum = trajectory.t[last], []
    for q, v in zip(trajectory.q[last], trajectory.v[last], strict=True):
        pin.computeCentroidalMomentum(model, data, q, v)
        momentum.append([*data.hg.linear, *(data.hg.angular + np.cross(data.com[0], data.hg.linear))])
    middle = len(t) // 2
    powers = np.vander((t - t[middle]) / (t[-1] - t[0]), 9, increasing=True)
    rate = np.linalg.lstsq(powers, np.array(momentum), rcond=None)[0][1] / (t[-1] - t[0])
    at = middle - len(t)
    force = sum(trajectory.reactions[name][at] for name in names)
    moment = sum(np.cross(trajectory.position(name)[at], trajectory.reactions[name][at]) for name in names)
    weight = np.array([0.0, 0.0, -9.81 * trajectory.mechanism.table.mass])
    com = np.array([trajectory[f"com.{axis}"][at] for axis in "xyz"])
    assert np.abs(force + weight - rate[:3]).max() < 1e-4 * np.abs(weight).max()
    assert np.abs(moment + np.cross(com, weight) - rate[3:]).max() < 1e-4 * np.abs(weight).max()
    # the centre of pressure is where the moments of the normal forces say, within the soles
    pressed = trajectory.centre_of_pressure("*")[at]
    assert np.abs(pressed[:2] - np.array([-moment[1], moment[0]]) / force[2]).max() < 1e-9
    loaded = vlmb.load_trajectory(trajectory.save(tmp_path / "run.npz"))
    assert np.array_equal(loaded.reactions[names[0]], trajectory.reactions[names[0]]) and loaded.phases == trajectory.phases
    assert "contact          left_toe_in" in loaded.summary() and f"{names[0]}.z" in loaded.to_pandas().columns


def test_a_humanoid_stands_on_its_soles_by_its_posture() -> None:
    sides = ("left", "right")
    points = {f"{side}_{name}": [f"{side}_sole_link", *place, 0.0] for side in sides for name, place in CORNERS.items()}
    robot = {"name": "talos", "urdf": TALOS, "attach": {"root": "free"}, "posture": "half_sitting", "points": points}
    scene: dict[str, Any] = {"base": {"kind": "pivot"}, "robots": [robot], "run": {"duration": 0.2, "rtol": 1e-8}}
    start = vlmb.check(scene).start
    height = float(vlmb.build(scene).position(start.state, "talos.left_toe_in")[2])
    scene["start"] = {"root.z": start.coordinates["root.z"] - height}
    scene["contacts"] = [{"name": name, "point": f"talos.{name}", "friction": 0.7} for name in points]
    upright = {"constraints": ["torso_1_joint = 0"], "controls": ["talos.*"], "frequency": 10.0}
    scene["programme"] = {**upright, "posture": {"frequency": 10.0}}
    trajectory = run(scene)
    assert trajectory.status == "finished" and trajectory.phases[-1].closed
    assert np.abs(trajectory["balance"]).max() < 1e-8 * 885.0
    weight = 9.81 * trajectory.mechanism.table.mass
    assert sum(trajectory.reactions[name][-1, 2] for name in points) == pytest.approx(weight, rel=0.1)
    assert np.abs(trajectory.centre_of_pressure("left_*")[-1] - trajectory.position("left_sole_link")[-1])[:2].max() < 0.12


WRONG = [
    (block({"middle": ["torso", 0.0, 0.0, 0.0]}, 0.2), "points.middle: no frame 'torso'"),
    (block({"body": ["body", 0.0, 0.0, 0.0]}, 0.2), "has a frame of this name"),
    ({**block(SOLE, 0.2), "contacts": [{"point": "block.nose"}]}, "unknown point 'block.nose'"),
    (block(SOLE, 0.2, start={"root.z": 0.05}), "under the surface"),
]


@pytest.mark.parametrize("scene, said", WRONG)
def test_contacts_that_are_wrong_are_named(scene: dict[str, Any], said: str) -> None:
    with pytest.raises(vlmb.VlmbError, match=said):
        vlmb.simulate(scene)
    if "under" not in said:
        with pytest.raises(vlmb.VlmbError, match=said):
            vlmb.check(scene)


def test_an_event_that_is_none_is_named() -> None:
    with pytest.raises(vlmb.SceneError, match="no contact 'left'"):
        vlmb.simulate(block(SOLE, 0.2), until="touch left")
    with pytest.raises(vlmb.TrajectoryError, match="no contact 'sole'"):
        run(block(SOLE, 0.2, start={"root.z": 0.4}), duration=0.01).centre_of_pressure("sole")


def test_a_run_ends_where_it_is_asked_to() -> None:
    up = {"root.z": 0.4, "root.z_dot": 2.0}
    apex = run(block(SOLE, 0.2, start=up), until="root.z_dot")
    assert apex.status == "stopped" and apex.t[-1] == pytest.approx(2.0 / 9.81, rel=1e-9)
    fallen = run(block(SOLE, 0.2, start=up), until="toe_in.z - 0.1")
    assert fallen["root.z"][-1] == pytest.approx(0.2, abs=1e-9) and "fell through 0" in fallen.message
    with pytest.raises(vlmb.SceneError, match="toe_out"):
        run(block(SOLE, 0.2, start=up), until="toe.z - 0.1")


def test_a_programme_and_a_force_act_while_a_foot_is_down() -> None:
    scene = biped()
    legs = ["left_leg", "right_leg"]
    scene["programme"] = {
        "constraints": [f"{leg} = 0.05*sin(20*t)" for leg in legs], "controls": [f"T_{leg}" for leg in legs], "frequency": 20.0,
        "closed": ["left_toe_in"],
    }  # fmt: skip
    scene["forces"] = [{"at": "biped.torso", "force": ["0", "0", "-20"], "closed": ["right_toe_in"]}]
    trajectory = run(scene)
    assert trajectory.status in ("finished", "stopped") and trajectory.events, trajectory.message
    up = trajectory.t < trajectory.events[0].t
    assert not trajectory.controls["T_left_leg"][up].any() and not trajectory.controls["R_biped.torso.z"][up].any()
    down = np.flatnonzero(trajectory.reactions["left_toe_in"][:, 2] > 0.0)
    assert (trajectory.controls["R_biped.torso.z"][down] == -20.0).all() and trajectory.controls["T_left_leg"][down].any()
    assert np.abs(trajectory["balance"]).max() < 1e-7


POGO = """<robot name="pogo"><link name="rail"/><link name="torso"><inertial><mass value="20"/>
<inertia ixx="0.5" iyy="0.4" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="foot"><inertial><mass value="2"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="height" type="prismatic"><parent link="rail"/><child link="torso"/><axis xyz="0 0 1"/>
<limit lower="-9" upper="9" effort="0" velocity="99"/></joint>
<joint name="leg" type="prismatic"><parent link="torso"/><child link="foot"/><origin xyz="0 0 -0.5"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="9000" velocity="99"/></joint></robot>"""


def pogo(**changes: Any) -> dict[str, Any]:
    """A mass on a leg, both on a vertical rail: it holds the leg in the air, and kicks by the time since it landed."""
    shared = {"controls": ["T_leg"], "frequency": 30.0}
    programmes = [
        {**shared, "constraints": ["air: leg = 0"], "open": ["foot"]},
        {**shared, "constraints": ["kick: leg = 0.1*cos(25*phase_t) - 0.1"], "closed": ["foot"]},
    ]  # fmt: skip
    return {
        "base": {"kind": "pivot"}, "robots": [{"name": "pogo", "urdf": POGO, "posture": {"height": 0.8}}],
        "contacts": [{"name": "foot", "point": "pogo.foot"}], "programmes": programmes,
        "events": [{"name": "apex", "when": "height_dot = 0", "direction": "down"}],
        "start": {"leg": 0.02}, "run": {"duration": 1.2, "samples": 500, **EXACT}, **changes,
    }  # fmt: skip


def test_programmes_and_events_of_phases() -> None:
    trajectory = run(pogo())
    assert trajectory.status == "finished", trajectory.message
    t, weight = trajectory.t, 22.0 * 9.81
    contacts = [event for event in trajectory.events if event.kind != "event"]
    assert [event.kind for event in contacts[:3]] == ["touch", "open", "touch"]
    (touch, lift, again), apexes = (event.t for event in contacts[:3]), [e.t for e in trajectory.events if e.name == "apex"]
    # each error decays as the programme says, e'' + 2*30 e' + 900 e = 0, from what it is where a phase begins
    for name, begin, end in (("air", 0.0, touch), ("kick", touch, lift), ("air", lift, again)):
        own = np.flatnonzero((t > begin + 1e-9) & (t < end - 1e-9))
        error, rate = trajectory.residuals[name].position[own], trajectory.residuals[name].velocity[own]
        since, grown = t[own] - t[own[0]], rate[0] + 30.0 * error[0]
        assert np.abs(error - (error[0] + grown * since) * np.exp(-30.0 * since)).max() < 1e-7
        other = trajectory.residuals["kick" if name == "air" else "air"].position[own]
        assert np.isnan(other).all()  # rows are none while their programme does not act
    stands = np.flatnonzero((t > touch + 1e-9) & (t < lift - 1e-9))
    impulse = simpson(trajectory.reactions["foot"][stands, 2] - weight, x=t[stands])
    assert impulse == pytest.approx(22.0 * np.ptp(trajectory["com.z_dot"][stands][[0, -1]]), rel=1e-4)
    # in the air the whole falls freely: from lift-off to the apex of its centre of mass, and the torso's is told as an event
    flown = np.flatnonzero((t > lift + 1e-9) & (t < again - 1e-9))
    fall = trajectory["com.z_dot"][flown] + 9.81 * t[flown]
    assert np.ptp(fall) < 1e-7
    assert len(apexes) == 1 and lift < apexes[0] < again
    assert np.abs(trajectory["balance"]).max() < 1e-6
    stopped = run(pogo(), until="apex")
    assert stopped.status == "stopped" and stopped.t[-1] == pytest.approx(apexes[0], abs=1e-9)
    assert abs(stopped["height_dot"][-1]) < 1e-8


def test_programmes_of_phases_that_are_wrong() -> None:
    one, two = pogo()["programmes"]
    for programmes, said in (
        ([one, {**two, "controls": ["T_knee"]}], "T_knee"),
        ([one, {**two, "controls": []}], "controls"),
        ([one, {**two, "closed": [], "constraints": one["constraints"]}], "act at once"),
    ):
        with pytest.raises(vlmb.VlmbError, match=said):
            vlmb.check(pogo(programmes=programmes))


def test_a_humanoid_is_dropped_on_its_soles() -> None:
    """In the air no torque moves the centre of mass: the programme acts once he stands, or it is told that it cannot."""
    scene = vlmb.load_scene(Path(__file__).resolve().parents[2] / "models" / "robots" / "humanoid_on_its_soles.toml").to_dict()
    scene |= {"expect": {}, "start": {**scene["start"], "root.z": scene["start"]["root.z"] + 0.01}}
    always = vlmb.simulate(scene, duration=0.3)
    assert always.status == "failed" and "cannot be met here by" in always.message and "and 22 more" in always.message
    with pytest.raises(vlmb.SingularError, match="cannot be met here"):
        vlmb.check(scene)
    scene["programme"]["closed"] = ["left_toe_in", "right_heel_out"]
    lands = run(scene, duration=0.3)
    (touch,) = lands.events
    assert touch.t == pytest.approx(np.sqrt(0.02 / 9.81), abs=1e-6) and len(touch.contacts) == 8 and touch.lost > 0.0
    assert lands.status == "finished" and len(lands.phases[-1].closed) == 8 and min(lands.lowest_gaps.values()) > -1e-9
    weight, up = 9.81 * float(lands.mechanism.table.mass), sum(force[:, 2] for name, force in lands.reactions.items())
    stands = lands.t > touch.t + 1e-6
    inertia = np.gradient(lands["com.z_dot"][stands], lands.t[stands], edge_order=2) * weight / 9.81
    assert np.abs(up[stands] - weight - inertia)[2:-2].max() < 1e-2 * weight
    assert np.abs(lands["balance"]).max() < 1e-6
