"""Runs with robots: energy, decay of errors, welds and edges, links on robots, limits; robots' files that are no robots."""

from __future__ import annotations

import contextlib
import pickle
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pinocchio as pin
import pytest

import vlmb
from tests.robots.nested import nested
from tests.robots.scenes import BENT, DATA, TALOS, arm, built, rider
from vlmb.model import mechanism as links_mechanism
from vlmb.simulation.robot_trajectory import RobotTrajectory
from vlmb.system.robot_start import robot_start
from vlmb.system.robot_system import make_robot_system
from vlmb.system.robot_workspace import RobotWorkspace

CIRCLE = {
    "constraints": ["cx: tool0.x = 0.45 + r*cos(w*t)", "cy: tool0.y = 0.15 + r*sin(w*t)", "cz: tool0.z = 0.35"],
    "controls": ["arm.*"], "frequency": 5.0,
}  # fmt: skip
POLE = {
    "name": "pole", "parent": "arm.tool0", "rod": {"length": 0.4, "mass": 1.0}, "lower": {"length": 0.1, "stiffness": 2000.0},
    "upper": {"length": 0.1, "stiffness": 1500.0}, "tip_mass": 0.3,
}  # fmt: skip
LEANING = {"pole.elevation": -1.0, "pole.azimuth": 0.4, "pole.azimuth_dot": 1.0}


def run(scene: dict[str, Any], **options: Any) -> RobotTrajectory:
    trajectory = vlmb.simulate(scene, **options)
    assert isinstance(trajectory, RobotTrajectory)
    return trajectory


@pytest.mark.slow
def test_urdfs_of_the_data_package_run_or_say_why_not() -> None:
    fine, said = 0, {}
    for path in sorted(DATA.rglob("*.urdf")):
        for root in ("fixed", "free"):
            robot = {"name": "robot", "urdf": str(path.relative_to(DATA)), "attach": {"root": root}}
            scene = {"name": path.stem, "base": {"kind": "pivot"}, "robots": [robot], "run": {"duration": 0.5, "rtol": 1e-8}}
            try:
                trajectory = run(scene)
            except vlmb.VlmbError as error:
                said[path.stem] = str(error)
                continue
            assert trajectory.status == "finished", f"{path.stem}: {trajectory.message}"
            assert np.abs(trajectory["balance"]).max() < 1e-5 * max(trajectory["kinetic"].max(), 1e-6), path.stem
            fine += 1
            said.pop(path.stem, None)
            break
    assert fine >= 60
    assert {"romeo", "icub"} <= said.keys()
    assert all("without inertia" in said[name] for name in ("romeo", "icub"))


def test_a_robot_is_read_run_stored_and_loaded(tmp_path: Path) -> None:
    trajectory = run(arm())
    assert np.abs(trajectory["balance"]).max() < 1e-9 * trajectory["kinetic"].max()
    assert trajectory["elbow_joint"][0] == 1.2 and trajectory["arm.elbow_joint"] is not None
    model, data = trajectory.mechanism.model, trajectory.mechanism.model.createData()
    pin.framesForwardKinematics(model, data, trajectory.q[-1])
    tool = data.oMf[trajectory.mechanism.frames["arm.tool0"]].translation
    assert np.abs(trajectory.position("tool0")[-1] - tool).max() < 1e-13
    loaded = vlmb.load_trajectory(trajectory.save(tmp_path / "run.npz"))
    assert np.array_equal(loaded["tool0.x"], trajectory["tool0.x"])
    assert np.array_equal(pickle.loads(pickle.dumps(trajectory))["energy"], trajectory["energy"])  # noqa: S301
    header = trajectory.save_csv(tmp_path / "run.csv").read_text(encoding="utf-8").splitlines()[0]
    assert "elbow_joint [rad],wrist_1_joint [rad]" in header and "elbow_joint_dot [rad/s]" in header
    table = trajectory.to_pandas(points=True)
    assert table.attrs["units"]["tool0.x"] == "m"
    again = run(arm(), start=trajectory.end, t0=0.5, duration=0.1)
    assert again["elbow_joint"][0] == pytest.approx(trajectory["elbow_joint"][-1], abs=1e-13)


def test_a_given_model_is_wrapped() -> None:
    model = pin.buildSampleModelHumanoid()
    mechanism = vlmb.build(model, name="human")
    trajectory = run(mechanism, duration=0.2)
    assert trajectory.status == "finished"
    assert "root_joint.z" in mechanism.names and "human.rleg_shoulder1_joint" in mechanism.names
    fall = trajectory["root_joint.z"][-1] - trajectory["root_joint.z"][0]
    assert fall == pytest.approx(-0.5 * 9.81 * 0.2**2, rel=0.2)
    drop = trajectory["com.z"][-1] - trajectory["com.z"][0]
    assert drop == pytest.approx(-0.5 * 9.81 * 0.2**2, rel=1e-9)
    with pytest.raises(vlmb.TrajectoryError, match=r"wrapped pinocchio\.Model"):
        trajectory.save("run.npz")


def test_a_circle_by_programme_decays_as_promised() -> None:
    scene = arm(parameters={"r": 0.1, "w": 2.0}, programme=CIRCLE, run={"duration": 6.0, "rtol": 1e-9})
    trajectory = run(scene)
    for name in ("cx", "cy", "cz"):
        z, rate = trajectory.residuals[name]
        assert z is not None and rate is not None
        exact = (z[0] + (rate[0] + 5.0 * z[0]) * trajectory.t) * np.exp(-5.0 * trajectory.t)
        assert np.abs(z - exact).max() < 1e-8
    assert trajectory.stats["rhs_evaluations"] < 2000
    assert trajectory.shares["effort:T_elbow_joint"] < 1.0
    assert "% of its limit" in trajectory.summary()


def test_a_rider_follows_the_sinusoid() -> None:
    programme = {"constraints": ["course: tan(phi0) = A*k*cos(k*x)", "com.z = 0.85"], "controls": ["talos.*"], "frequency": 5.0}
    scene = rider(
        parameters={"A": 1.0, "k": 0.5}, start={"phi0": 0.4636476, "speed": 2.0}, programme=programme,
        run={"duration": 10.0, "rtol": 1e-8},
    )  # fmt: skip
    trajectory = run(scene)
    assert trajectory.status == "finished"
    for foot in ("left_foot", "right_foot"):
        assert np.abs(trajectory.residuals[f"weld:{foot}"].position).max() < 1e-7
        assert trajectory.reactions[f"weld:{foot}"].shape == (len(trajectory), 6)
    assert np.abs(trajectory.residuals["knife_edge"].velocity).max() < 1e-12
    assert np.abs(trajectory["balance"]).max() < 1e-6 * trajectory["kinetic"].max()
    assert np.abs(trajectory.residuals["course"].position).max() < 1e-6
    together = sum(trajectory.reactions[f"weld:{foot}"][:, 2] for foot in ("left_foot", "right_foot"))
    weight = 9.81 * (trajectory.mechanism.table.mass - 5.0)
    assert np.mean(together) == pytest.approx(weight, rel=0.05)  # the board carries the rider
    assert any("only load what is welded" in note for note in trajectory.adjustments)


ROW = ["height: tool0.z = 0.4"]
LIFT = {"constraints": ["com.z = 0.85"], "controls": ["talos.*"], "frequency": 5.0}
PROGRAMMES = {
    "three rows": arm(programme=CIRCLE),
    "secondary rows, too many of them": arm(
        programme={**CIRCLE, "secondary": ["elbow_joint = 1.3", "wrist_1_joint = 0.3", "wrist_2_joint = 0.1", "com.x = 0.1"]}
    ),
    "a row twice": arm(programme={**CIRCLE, "constraints": [*CIRCLE["constraints"], "2*tool0.z = 0.7"]}),
    "as many torques as rows": arm(
        programme={**CIRCLE, "controls": ["T_shoulder_pan_joint", "T_elbow_joint", "T_shoulder_lift_joint"]}
    ),
    "a link, forces at points": arm(
        links=[POLE], start=LEANING,
        programme={"constraints": ROW, "controls": ["arm.*", "F1_1", "M_psi1", "R_pole.tip.x"], "frequency": 5.0},
    ),
    "welded twice": arm(
        welds=[{"frames": ["ground", "arm.forearm_link"]}], programme={**CIRCLE, "constraints": ["wrist_1_joint = 0.4 + t"]}
    ),
    "loads that move nothing": rider(programme=LIFT),
    "few torques, and a wish": rider(programme={**LIFT, "controls": ["talos.leg_*"], "secondary": ["torso_1_joint = 0.1"]}),
    "weights": rider(programme={**LIFT, "posture": {"weights": {"torso_1_joint": 50.0}}, "weights": {"T_torso_2_joint": 1.0}}),
}


@pytest.mark.parametrize("name", PROGRAMMES)
def test_a_programme_does_what_nested_least_squares_do(name: str) -> None:
    scene = {**PROGRAMMES[name], "parameters": {"r": 0.1, "w": 2.0}}
    system = make_robot_system(built(scene))
    start, space = robot_start(system), RobotWorkspace(system)
    v = start.state.v + 0.1 * np.random.default_rng(5).standard_normal(len(start.state.v))
    y = np.concatenate([start.state.q, v, np.zeros(len(system.work_names))])
    space.start_posture(start.state.q + 0.05)
    for _ in range(2):  # the first time for the rows, that the motion may obey them
        with contextlib.suppress(vlmb.SingularError):
            space.rhs(0.0, y)
        held = space.matrix[: space.eliminated]
        y[space.nq : space.end] -= np.linalg.pinv(held, rcond=1e-10) @ held @ y[space.nq : space.end]
    found = np.array(space.rhs(0.0, y)[space.nq : space.end]), space.values[space.first_control :], space.multipliers
    for one, other in zip(found, nested(space, y[: space.nq], y[space.nq : space.end]), strict=True):
        assert np.abs(one - other).max(initial=0.0) < 1e-9 * np.abs(other).max(initial=1e-9)


def test_rows_that_no_control_reaches_are_named() -> None:
    wrong = arm(parameters={"r": 0.1, "w": 2.0}, programme={**CIRCLE, "constraints": [*CIRCLE["constraints"], "tool0.z = 0.5"]})
    with pytest.raises(vlmb.SingularError, match=r"'cz', 'tool0\.z = 0\.5' cannot be met here by T_shoulder_pan_joint"):
        vlmb.check(wrong)


def test_an_edge_on_a_frame_lets_it_go_along_its_trace_alone() -> None:
    robot = {"name": "box", "urdf": TALOS, "attach": {"root": "free"}, "locked": [], "posture": "half_sitting"}
    joints = [name for name in vlmb.build({"base": {"kind": "pivot"}, "robots": [robot]}).names.index if "root" not in name]
    robot["locked"] = joints
    scene = {
        "base": {"kind": "pivot"}, "robots": [{**robot, "attach": {"root": "planar"}, "posture": ""}],
        "edges": [{"frame": "box.base_link"}], "start": {"root.x_dot": 1.0, "root.yaw_dot": 1.0},
        "run": {"duration": 3.0, "rtol": 1e-10}, "gravity": 0.0,
    }  # fmt: skip
    trajectory = run(scene)
    side = -np.sin(trajectory["root.yaw"]) * trajectory["root.x_dot"] + np.cos(trajectory["root.yaw"]) * trajectory["root.y_dot"]
    assert np.abs(side).max() < 1e-9
    assert np.abs(trajectory["root.yaw"]).max() > 1.0
    assert np.abs(trajectory["balance"]).max() < 1e-9 * trajectory["kinetic"].max()
    assert np.abs(trajectory.residuals["edge:base_link"].velocity - side).max() < 1e-12
    there = run({**scene, "edges": [{"frame": "box.base_link", "axis": "y"}]})
    assert np.abs(there["root.x"] - trajectory["root.x"]).max() < 1e-8


def test_two_edges_of_one_body_forbid_turning_and_it_is_told() -> None:
    edges = [{"frame": "talos.base_link"}, {"frame": "talos.torso_1_joint"}, {"frame": "talos.imu_link"}]
    scene = rider(welds=[], edges=edges)
    scene["robots"][0]["attach"] = {"to": "ground", "root": "planar"}
    scene["robots"][0]["posture"] = ""
    assert any("independent at the start" in note for note in vlmb.check(scene).notes)


def test_a_weld_by_pose_closes_a_loop() -> None:
    scene = arm(welds=[{"frames": ["ground", "arm.tool0"], "pose": [0.45, 0.2, 0.4, 0.0, 1.2, 0.3]}])
    trajectory = run(scene, duration=0.3)
    assert np.abs(trajectory.position("tool0") - [0.45, 0.2, 0.4]).max() < 1e-8
    assert vlmb.check(scene).degrees_of_freedom == 0


def test_a_link_on_a_robot_does_not_depend_on_its_gauge(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = arm(links=[POLE], start=LEANING, run={"duration": 0.5, "rtol": 1e-12, "atol": 1e-13})
    scene["forces"] = [{"on": "M_psi1", "law": "2*sin(5*t)"}, {"at": "pole.tip", "force": ["1", "0.5*t", "0"]}]
    first = run(scene)
    assert np.abs(first["balance"]).max() < 1e-9 * first["kinetic"].max()
    monkeypatch.setattr(links_mechanism, "AXIAL_RATIO", 5.0)
    second = run(scene)
    for name in ("elbow_joint", "pole.tip.x", "pole.tip.z", "xi1_1", "phi1", "psi1_dot"):
        assert np.abs(first[name] - second[name]).max() < 1e-10 * max(1.0, np.abs(first[name]).max()), name


PENDULUM = """<robot name="link"><link name="base"/>
<link name="a"/><link name="b"/>
<link name="rod"><inertial><origin xyz="0.25 0 0"/><mass value="3"/>
<inertia ixx="0" iyy="0.0625" izz="0.0625" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="azimuth" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/></joint>
<joint name="elevation" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 -1 0"/></joint>
<joint name="slide" type="prismatic"><parent link="b"/><child link="rod"/><axis xyz="1 0 0"/>
<limit lower="0" upper="9" effort="100" velocity="10"/></joint></robot>"""


def test_a_link_scene_written_as_a_robot_moves_as_the_links_do(tmp_path: Path) -> None:
    start, options = {"azimuth": 0.3, "elevation": -0.7, "slide": 0.4}, {"duration": 2.0, "rtol": 1e-12, "atol": 1e-13}
    rates = {"azimuth_dot": 1.5, "elevation_dot": 0.5, "slide_dot": -0.2}
    (tmp_path / "link.urdf").write_text(PENDULUM, encoding="utf-8")
    robot = {"base": {"kind": "pivot"}, "robots": [{"name": "link", "urdf": "link.urdf"}], "start": {**start, **rates},
             "forces": [{"on": "T_slide", "law": "-300*(slide - 0.3) - 2*slide_dot"}], "run": options}  # fmt: skip
    there = run(vlmb.Scene.from_dict(robot, folder=tmp_path))
    lower = {"length": 0.4, "rest": 0.3, "stiffness": 300.0, "damping": 2.0}
    link = {"name": "legs", "rod": {"length": 0.5, "mass": 3.0}, "lower": lower}
    names = {"azimuth": "phi1", "elevation": "psi1", "slide": "xi1_1"}
    given = {names[name.removesuffix("_dot")] + "_dot" * name.endswith("_dot"): value for name, value in (start | rates).items()}
    here = vlmb.simulate({"base": {"kind": "pivot"}, "links": [link], "start": given, "run": options | {"fall": False}})
    for name, other in names.items():
        assert np.abs(there[name] - here[other]).max() < 1e-9, name


def test_springs_between_points_keep_the_account() -> None:
    springs = [{"between": ["arm.tool0", [0.6, 0.0, 0.8]], "stiffness": 200.0, "damping": 3.0, "rest": 0.2}]
    rope = {**springs[0], "between": ["arm.forearm_link", [0.0, 0.5, 0.5]], "tension_only": True}
    trajectory = run(arm(springs=[*springs, rope]))
    assert np.abs(trajectory["balance"]).max() < 1e-6 * trajectory["kinetic"].max()
    assert trajectory["dissipated"][-1] > 0.0 and trajectory["spring"].max() > 1.0


def test_limits_stop_a_run_where_it_is_wanted() -> None:
    programme = {"constraints": ["elbow_joint = 1.2 + 2.5*t"], "controls": ["arm.*"], "frequency": 10.0, "limits": "stop"}
    trajectory = run(arm(programme=programme, run={"duration": 3.0}))
    assert trajectory.status == "stopped" and "elbow_joint reached its upper limit" in trajectory.message
    assert trajectory["elbow_joint"][-1] == pytest.approx(float(trajectory.mechanism.model.upperPositionLimit[2]), abs=1e-6)
    fast = run(arm(programme={**programme, "constraints": ["elbow_joint = 1.2 + 2*t^2".replace("^", "**")]}))
    assert "speed limit" in fast.message or fast.status == "finished"
    reported = run(arm(programme={**programme, "limits": "report"}, run={"duration": 1.0}))
    assert reported.status == "finished" and "WARNING" in reported.summary()


def test_controls_are_chosen_by_pattern() -> None:
    names = built(rider()).names
    whole = names.chosen(["talos.*"], "controls")
    assert len(whole) == 32
    assert len(names.chosen(["talos.*", "-talos.head_*"], "controls")) == 30
    assert [force.name for force in names.chosen(["T_torso_1_joint", "T_talos.torso_2_joint"], "c")] == [
        "T_torso_1_joint", "T_torso_2_joint",
    ]  # fmt: skip
    for wrong in (["talos.nose_*"], ["-talos.nose_*"], ["T_nose"], ["talos.*", "-talos.*"]):
        with pytest.raises(vlmb.SceneError, match="controls"):
            names.chosen(wrong, "controls")


def test_a_control_callable_acts_and_is_recorded() -> None:
    trajectory = run(arm(), control=lambda t, view: {"T_elbow_joint": -5.0 * view["elbow_joint_dot"]}, duration=0.3)
    assert np.abs(trajectory.controls["T_elbow_joint"] + 5.0 * trajectory["elbow_joint_dot"]).max() < 1e-9
    assert np.abs(trajectory["balance"]).max() < 1e-6 * trajectory["kinetic"].max()


HOSTILE = {
    "../up.urdf": "by a relative path", "/etc/passwd": "by a relative path", "x.xacro": "xacro is not run",
    "none.urdf": "no such file",
    "<robot><link name='a'/><link name='b'/></robot>": "2 links have no parent",
    "<robot><link name='a'/><link name='a'/></robot>": "two links are called",
    "<!DOCTYPE r [<!ENTITY a 'b'>]><robot/>": "DOCTYPE", "<robot": "is no XML", "<sdf/>": "a URDF has <robot>",
    "<robot xmlns:xacro='http://x'><xacro:macro/></robot>": "xacro",
    "<robot><link name='a'/><link name='b'/><joint name='j' type='fixed'><parent link='a'/><child link='b'/></joint></robot>": (
        "nothing"
    ),
    "<robot><link name='a'><inertial><mass value='nan'/></inertial></link></robot>": "finite number",
    "<robot><link name='a'/><joint name='j' type='revolute'><parent link='c'/><child link='a'/></joint></robot>": "no link 'c'",
}


@pytest.mark.parametrize("urdf", HOSTILE)
def test_what_is_no_robot_is_a_named_error(urdf: str) -> None:
    with pytest.raises(vlmb.SceneError, match=HOSTILE[urdf]):
        vlmb.check({"base": {"kind": "pivot"}, "robots": [{"name": "robot", "urdf": urdf}]})


def test_a_link_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    (tmp_path / "secret.urdf").write_text(PENDULUM, encoding="utf-8")
    (tmp_path / "deep" / "link.urdf").symlink_to(tmp_path / "secret.urdf")
    scene = {"base": {"kind": "pivot"}, "robots": [{"name": "robot", "urdf": "link.urdf"}]}
    with pytest.raises(vlmb.SceneError, match="leads out of the scene's folder"):
        vlmb.Scene.from_dict(scene, folder=tmp_path / "deep")


WRONG = [
    ({"robots": [{"name": "arm", "urdf": "<robot/>", "attach": {"to": "ski"}}]}, "this scene has no ski"),
    ({"robots": [{"name": "ski", "urdf": "<robot/>"}]}, "choose another"),
    (arm(robot={"locked": ["elbow"]}), "did you mean 'elbow_joint'"),
    (arm(robot={"posture": "sitting"}), "no such posture"),
    (arm(robot={"posture": {"elbow": 1.0}}), "elbow_joint"),
    (arm(robot={"aliases": {"hand": "tool1"}}), "tool0"),
    (arm(welds=[{"frames": ["arm.tool1", "ground"]}]), "tool0"),
    (arm(welds=[{"frames": ["arm.base_link", "ground"]}]), "on one body"),
    (arm(edges=[{"frame": "arm.base_link"}]), "does not move"),
    (arm(start={"elbow": 1.0}), "elbow_joint"),
    (arm(links=[{"rod": {"length": 1.0, "mass": 1.0}, "parent": "arm.tool1"}]), "tool0"),
    (arm(run={"engine": "core"}), "pinocchio"),
    (arm(programme={**CIRCLE, "constraints": ["tool0.w = 1"]}), "tool0"),
    (arm(forces=[{"on": "T_elbow", "law": "1"}]), "T_elbow_joint"),
    ({"links": [{"rod": {"length": 1.0, "mass": 1.0}}], "welds": [{"frames": ["a", "b"]}]}, "need \\[\\[robots\\]\\]"),
]


@pytest.mark.parametrize("scene, said", WRONG)
def test_what_is_wrong_is_named(scene: dict[str, Any], said: str) -> None:
    with pytest.raises(vlmb.VlmbError, match=said):
        vlmb.check({"base": {"kind": "pivot"}, **scene})


def test_a_scene_with_robots_goes_through_a_dict() -> None:
    scene = vlmb.Scene.from_dict(rider(programme={"constraints": ["com.z = 1"], "controls": ["talos.*"], "limits": "stop"}))
    assert vlmb.Scene.from_dict(scene.to_dict()) == scene
    changed = scene.changed_at({"robots.0.posture": "", "start.speed": 2.0})
    assert changed.start["speed"] == 2.0
    assert msgspec.to_builtins(scene.robots[0])["urdf"] == TALOS and BENT
