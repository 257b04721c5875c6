"""Forces have the work, the sign and the reaction their names promise; all forms of the knife edge agree."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import simpson

import vlmb
from tests.small_scenes import BENT, FIXED, FLYING, MOVING, PIVOT, SKI, bent, link, random_state, scene
from vlmb.model.coordinates import kinematics
from vlmb.model.memory import make_data
from vlmb.model.names import generalized_forces
from vlmb.simulation.checking import check
from vlmb.system.constrained import SIDEWAYS
from vlmb.system.forces import ForceWriter, applied_forces
from vlmb.system.frames import LinkFrames
from vlmb.system.system import make_system

TREE = [
    link("legs", parent="base"),
    link("arm", parent="legs", parent_point="rod_end", upper=FIXED),
    link("trunk", parent="legs", lower=FIXED),
    link("hand", parent="arm", parent_point="rod_start", rod={"length": 0.3, "mass": 1.0, "com": 0.1, "inertia": 0.02}),
]
LAYOUTS: dict[str, vlmb.Scene] = {
    "pivot": scene(PIVOT, 2),
    "tree on the ski": scene(SKI, TREE, slope=0.2),
    "flying": scene(FLYING, 2),
    "pivot in a plane": scene(PIVOT, 2, plane=True),
    "ski in a plane": scene(SKI, TREE, plane=True),
    "flying in a plane": scene(FLYING, 2, plane=True),
}


def angle_to_parent(mechanism: vlmb.Mechanism, q: np.ndarray, i: int) -> float:
    """The angle a hinge torque opens."""
    motion = kinematics(mechanism.layout, q, np.zeros(mechanism.model.nv))
    parent = mechanism.layout.links[i].parent
    if parent >= 0:
        first = motion.directions[parent]
    else:
        first = (
            np.array([q[2], q[3], 0.0]) / np.hypot(q[2], q[3]) if mechanism.layout.base == "ski" else np.array([1.0, 0.0, 0.0])
        )
    second = motion.directions[i]
    return math.atan2(float(np.linalg.norm(np.cross(first, second))), float(first @ second))


@pytest.mark.parametrize("name", LAYOUTS)
def test_work_of_every_generalized_force(name: str) -> None:
    """tau . v of a unit force is the rate of its coordinate, for any motion, sideways slip included."""
    mechanism = vlmb.build(LAYOUTS[name])
    model, layout, step = mechanism.model, mechanism.layout, 1e-6
    tested = set()
    for seed in range(5):
        state = random_state(mechanism, seed)
        now = mechanism.coordinates(state)
        ahead, behind = (pin.integrate(model, state.q, sign * step * state.v) for sign in (1.0, -1.0))
        after, before = (mechanism.coordinates((q, state.v), now) for q in (ahead, behind))
        reference = [now[each] for each in layout.names]
        frames, forces = LinkFrames(mechanism), generalized_forces(layout)
        frames.update(state.q)
        writer = ForceWriter(mechanism, applied_forces(mechanism, list(forces)), frames, None)
        writer.held = [1.0] * len(forces)
        writer.add(0.0, state.q, state.v, np.zeros(layout.nv), np.array(reference))
        for channel, tau in zip(forces.values(), writer.columns, strict=True):
            if channel.kind != "hinge":
                coordinate = channel.coordinate
                rate = (after[coordinate] - before[coordinate]) / (2 * step)
                assert rate == pytest.approx(now[f"{coordinate}_dot"], rel=1e-6, abs=1e-6)
            elif layout.plane:
                parent = layout.links[channel.link].parent
                rate = now[f"psi{channel.link + 1}_dot"] - (now[f"psi{parent + 1}_dot"] if parent >= 0 else 0.0)
            else:
                rate = (angle_to_parent(mechanism, ahead, channel.link) - angle_to_parent(mechanism, behind, channel.link)) / (
                    2 * step
                )
            assert tau @ state.v == pytest.approx(rate, rel=1e-6, abs=1e-6), channel.name
            tested.add(channel.name)
    assert tested == set(generalized_forces(layout))


def test_the_names_of_forces() -> None:
    names = set(generalized_forces(vlmb.build(LAYOUTS["tree on the ski"]).layout))
    assert names == {
        "F_x", "F_y", "M_phi0", "M_phi1", "M_psi1", "F1_1", "F1_2", "M_phi2", "M_psi2", "F2_1", "M_phi3", "M_psi3", "F3_2",
        "M_phi4", "M_psi4", "F4_1", "F4_2", "T_legs", "T_arm", "T_trunk", "T_hand",
    }  # fmt: skip
    flying = generalized_forces(vlmb.build(scene(FLYING, 1)).layout)
    assert set(flying) == {"F_x", "F_y", "F_z", "M_phi1", "M_psi1", "F1_1", "F1_2"}
    plane = set(generalized_forces(vlmb.build(LAYOUTS["pivot in a plane"]).layout))
    assert not any(name.startswith("M_phi") for name in plane)
    with pytest.raises(vlmb.SceneError, match="plane"):
        vlmb.build(LAYOUTS["pivot in a plane"]).names.force("M_phi1", "here")


# Forms of the knife edge ---------------------------------------------------------------------------------------------


def test_an_unknown_form_is_refused() -> None:
    with pytest.raises(vlmb.VlmbError, match="knife_edge"):
        vlmb.simulate(scene(SKI, 1), knife_edge="glue", duration=0.1)


KNIFE_SCENES = {
    "plain": scene(SKI, 2, slope=0.2),
    "forces": scene(
        SKI, TREE,
        forces=[{"on": "M_psi1", "law": 3.0}, {"on": "F_y", "law": -7.0}, {"between": ["heading", "legs"], "stiffness": 9.0}],
    ),
    "prescribed and damped": scene(
        SKI, [link("link1", upper={"motion": "prescribed", "law": "0.2 + 0.05*sin(4*t)"}, lower={"length": 0.3, "damping": 3.0})]
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", KNIFE_SCENES)
def test_knife_edge_forms_agree(name: str) -> None:
    mechanism = vlmb.build(KNIFE_SCENES[name])
    for seed in range(3):
        state = random_state(mechanism, seed, sideways=False)
        assert abs(state.v[SIDEWAYS]) < 1e-15
        found = {}
        for form in ("reduction", "multiplier", "projection"):
            workspace = make_system(mechanism, knife_edge=form, gain=4.0).workspace()
            now = workspace.evaluate(0.3, workspace.pack(state))
            found[form] = now
            assert abs(now.vdot[SIDEWAYS]) < 1e-10
        scale = np.abs(found["reduction"].vdot).max()
        for form in ("multiplier", "projection"):
            np.testing.assert_allclose(found[form].vdot, found["reduction"].vdot, rtol=0, atol=1e-10 * scale)
            assert found[form].knife_edge == pytest.approx(found["reduction"].knife_edge, rel=1e-9, abs=1e-9)
            assert found[form].controls == pytest.approx(found["reduction"].controls, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("form", ["reduction", "multiplier", "projection"])
@pytest.mark.parametrize("heading", [0.0, 1.2, math.pi / 2, -2.5])
def test_the_edge_pushes_back(form: str, heading: float) -> None:
    """Push the ski to its right: the snow answers to its left, which is positive."""
    right = (math.sin(heading), -math.cos(heading))
    pushes = [{"on": "F_x", "law": 10.0 * right[0]}, {"on": "F_y", "law": 10.0 * right[1]}]
    made = scene({**SKI, "com_offset": 0.0}, [], forces=pushes, start={"phi0": heading})
    trajectory = vlmb.simulate(made, duration=0.5, knife_edge=form, t_eval=[0.0, 0.1, 0.5])
    np.testing.assert_allclose(trajectory.reactions["knife_edge"], 10.0, rtol=0, atol=1e-10)
    np.testing.assert_allclose(np.hypot(trajectory["x"], trajectory["y"]), 0.0, atol=1e-12)


def test_the_edge_force_of_a_turning_ski_points_inwards() -> None:
    made = scene({**SKI, "com_offset": 0.0}, [], start={"speed": 4.0, "phi0_dot": 0.5})
    left = vlmb.simulate(made, duration=1.0)
    np.testing.assert_allclose(left.reactions["knife_edge"], 5.0 * 4.0 * 0.5, rtol=1e-9)


def test_the_multiplier_takes_out_a_slip() -> None:
    """With a Baumgarte gain a the sideways velocity decays as exp(-a t)."""
    mechanism = vlmb.build(scene(SKI, 1))
    state = random_state(mechanism, 1)
    workspace = make_system(mechanism, knife_edge="multiplier", gain=4.0).workspace()
    rate = workspace.rhs(0.0, workspace.pack(state))[workspace.nq + SIDEWAYS]
    assert rate == pytest.approx(-4.0 * state.v[SIDEWAYS], rel=1e-12)


@pytest.mark.parametrize("name", ["pivot", "tree on the ski", "flying", "ski in a plane"])
def test_the_field_off_the_sphere(name: str) -> None:
    """A quaternion's or heading's norm changes no acceleration, and multiplies its own rates: what keeps full order."""
    mechanism = vlmb.build(LAYOUTS[name])
    layout, workspace = mechanism.layout, make_system(mechanism).workspace()
    state = random_state(mechanism, 7, sideways=False)
    y = workspace.pack(state)
    expected, longer = workspace.rhs(0.0, y).copy(), y.copy()
    blocks = [slice(entry.q, entry.q + 4) for entry in layout.links if not layout.plane]
    blocks += [slice(2, 4)] if layout.base == "ski" else []
    for k, block in enumerate(blocks):
        longer[block] *= 1.1 + 0.2 * k
        expected[block] *= 1.1 + 0.2 * k
    found = workspace.rhs(0.0, longer)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


# Action and reaction, energy -----------------------------------------------------------------------------------------


def momentum(trajectory: vlmb.Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Linear momentum, and angular momentum about the centre of mass, sample by sample."""
    model, data = trajectory.mechanism.model, make_data(trajectory.mechanism.model)
    found = [pin.computeCentroidalMomentum(model, data, q, v) for q, v in zip(trajectory.q, trajectory.v, strict=True)]
    return np.array([h.linear.copy() for h in found]), np.array([h.angular.copy() for h in found])


INTERNAL: dict[str, list[dict[str, Any]]] = {
    "hinge torque": [{"on": "T_link2", "law": "4*sin(5*t)"}],
    "direction spring": [{"between": ["link1", "link3"], "stiffness": 20.0, "rest": 0.5}],
    "direction damper": [{"between": ["link2", "link1"], "stiffness": 5.0, "damping": 0.8}],
    "segment force": [{"on": "F2_1", "law": "30*cos(4*t)"}],
}


@pytest.mark.parametrize("kind", INTERNAL)
@pytest.mark.parametrize("plane", [False, True])
def test_inner_forces_leave_the_momentum_alone(kind: str, plane: bool) -> None:
    trajectory = vlmb.simulate(bent(FLYING, 3, forces=INTERNAL[kind], plane=plane), duration=1.0)
    assert trajectory.status == "finished", trajectory.message
    linear, angular = momentum(trajectory)
    np.testing.assert_allclose(angular, np.broadcast_to(angular[0], angular.shape), rtol=0, atol=1e-9)
    mass = 1.5 + 3 * 5.0
    expected = linear[0] + mass * 9.81 * trajectory.t[:, None] * np.array([0.0, 0.0, -1.0])
    np.testing.assert_allclose(linear, expected, rtol=0, atol=1e-8)
    assert np.abs(trajectory["balance"]).max() < 1e-9 * trajectory["kinetic"].max()


def test_an_outer_moment_changes_the_momentum() -> None:
    """The counterpart: M_psi acts from outside, and the momentum follows it."""
    trajectory = vlmb.simulate(bent(FLYING, 2, forces=[{"on": "M_psi1", "law": 3.0}]), duration=1.0)
    _, angular = momentum(trajectory)
    assert np.linalg.norm(angular[-1] - angular[0]) > 0.5


def test_segment_dampers_take_what_the_account_says() -> None:
    damped = {"length": 0.3, "stiffness": 2000.0, "damping": 25.0, "limits": [-math.inf, math.inf]}
    times = np.linspace(0.0, 1.0, 4001)
    made = scene(SKI, [link("a", lower=damped)], start={"psi1": 0.8, "phi1": 0.3, "speed": 2.0, "xi1_1_dot": 1.0})
    trajectory = vlmb.simulate(made, duration=1.0, t_eval=times)
    assert simpson(25.0 * trajectory["xi1_1_dot"] ** 2, x=times) == pytest.approx(trajectory["dissipated"][-1], rel=1e-8)
    assert np.abs(trajectory["balance"]).max() < 1e-9 * trajectory["kinetic"].max()


def test_work_of_every_applied_force_is_its_power() -> None:
    forces = [
        {"on": "M_psi1", "law": "3*sin(2*t)"}, {"on": "M_phi1", "law": 1.5}, {"on": "T_link2", "law": "2*cos(t)"},
        {"on": "F1_1", "law": "20*t"}, {"on": "M_phi0", "law": -1.0}, {"on": "F_x", "law": 4.0}, {"on": "F_x", "law": "t"},
    ]  # fmt: skip
    times = np.linspace(0.0, 0.5, 2001)
    trajectory = vlmb.simulate(bent(SKI, 2, forces=forces), duration=0.5, t_eval=times)
    for name, rate in (
        ("M_psi1", "psi1_dot"),
        ("M_phi1", "phi1_dot"),
        ("F1_1", "xi1_1_dot"),
        ("M_phi0", "phi0_dot"),
        ("F_x", "x_dot"),
    ):
        work = simpson(trajectory.controls[name] * trajectory[rate], x=times)
        assert work == pytest.approx(trajectory.work_by_force[name][-1], rel=1e-7, abs=1e-9), name
    np.testing.assert_allclose(trajectory.controls["F_x"], 4.0 + times, rtol=1e-14)
    total = sum(trajectory.work_by_force.values())
    np.testing.assert_allclose(trajectory["work"], total, rtol=0, atol=1e-12)


# Errors at run time --------------------------------------------------------------------------------------------------


def test_a_moment_about_the_vertical_has_a_pole() -> None:
    made = scene(PIVOT, 1, forces=[{"on": "M_phi1", "law": 1.0}], start={"psi1": math.pi / 2})
    with pytest.raises(vlmb.SingularError, match=r"M_phi1.*pole.*T_"):
        check(made)
    near = scene(PIVOT, 1, forces=[{"on": "M_phi1", "law": 1.0}], start={"psi1": math.pi / 2 - 0.01})
    check(near)


def test_a_hinge_torque_needs_an_axis() -> None:
    made = scene(PIVOT, 2, forces=[{"on": "T_link2", "law": 1.0}], start={"psi1": 0.3, "psi2": 0.3})
    with pytest.raises(vlmb.SingularError, match=r"T_link2.*line up"):
        check(made)
    plane = scene(PIVOT, 2, plane=True, forces=[{"on": "T_link2", "law": 1.0}], start={"psi1": 0.3, "psi2": 0.3})
    check(plane)


# At rest -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("slope", [0.0, 0.3, -0.5])
def test_the_snow_carries_the_weight(slope: float) -> None:
    """A ski across the slope with a rider along the plumb line rests: normal force m g cos, edge force m g sin."""
    rider = link("legs", lower=FIXED, upper=FIXED)
    start = {"phi0": math.pi / 2, "phi1": math.pi if slope > 0 else 0.0, "psi1": math.pi / 2 - abs(slope)}
    trajectory = vlmb.simulate(scene({**SKI, "com_offset": 0.0}, [rider], slope=slope, start=start), duration=0.1)
    weight = 10.0 * 9.81
    assert trajectory.reactions["normal"][0] == pytest.approx(weight * math.cos(slope), rel=1e-12)
    assert trajectory.reactions["knife_edge"][0] == pytest.approx(weight * math.sin(slope), rel=1e-12, abs=1e-11)
    np.testing.assert_allclose(
        trajectory.position("legs"), trajectory.position("legs")[0] + np.zeros((len(trajectory), 3)), atol=1e-9
    )


def test_moments_of_the_snow_on_a_leaning_rider() -> None:
    """Held still by hinge springs, a rider who leans forward needs a pitch moment of her weight times the lever."""
    rider = link("legs", lower=FIXED, upper=FIXED)
    lean, stiffness = 0.3, 400.0
    lever = (3.0 * 0.45 + 2.0 * 0.9) * 9.81 * math.sin(lean)
    spring = {"between": ["base", "legs"], "stiffness": stiffness, "rest": lean - lever / stiffness}
    made = scene({**SKI, "com_offset": 0.0}, [rider], start={"psi1": math.pi / 2 - lean}, forces=[spring])
    trajectory = vlmb.simulate(made, duration=0.05)
    assert np.abs(trajectory["psi1"] - trajectory["psi1"][0]).max() < 1e-9
    assert trajectory.reactions["normal"][0] == pytest.approx(10.0 * 9.81, rel=1e-9)
    assert abs(trajectory.reactions["pitch_moment"][0]) == pytest.approx(lever, rel=1e-9)
    assert abs(trajectory.reactions["roll_moment"][0]) < 1e-9
    # about the ski's left (y) axis a force N at distance d ahead makes -N d: the snow pushes in front of A
    assert trajectory.reactions["pitch_moment"][0] < 0.0


def test_hinges_carry_what_hangs_below() -> None:
    """A chain at rest, hanging on its springs."""
    lower, upper = 2000.0, 1500.0
    below = {"link1": 10.0, "link2": 5.0}
    start = {"psi1": -math.pi / 2, "psi2": -math.pi / 2}
    start |= {"xi1_1": 0.3 + 10 * 9.81 / lower, "xi1_2": 0.2 + 7 * 9.81 / upper}
    start |= {"xi2_1": 0.3 + 5 * 9.81 / lower, "xi2_2": 0.2 + 2 * 9.81 / upper}
    trajectory = vlmb.simulate(scene(PIVOT, 2, start=start), duration=0.5)
    assert np.abs(trajectory.v).max() < 1e-9
    for name, mass in below.items():
        expected = np.broadcast_to([0.0, 0.0, mass * 9.81], (len(trajectory), 3))
        np.testing.assert_allclose(trajectory.hinge_force(name), expected, rtol=0, atol=1e-8)


def test_hinge_forces_obey_newton() -> None:
    """The force in the first hinge is the rate of the momentum less gravity; in a branched chain, of each subtree."""
    trajectory = vlmb.simulate(bent(PIVOT, 2), duration=1.0, t_eval=np.linspace(0.0, 1.0, 2001))
    linear, _ = momentum(trajectory)
    rate = np.gradient(linear, trajectory.t, axis=0, edge_order=2)
    expected = rate + np.array([0.0, 0.0, 10.0 * 9.81])
    np.testing.assert_allclose(trajectory.hinge_force("link1")[5:-5], expected[5:-5], rtol=0, atol=0.05)
    assert np.abs(expected).max() > 50.0


# plane = true --------------------------------------------------------------------------------------------------------


def pair(base: dict[str, Any], heading: float, seconds: float = 2.0, **keys: Any) -> tuple[vlmb.Trajectory, vlmb.Trajectory]:
    start = {name: value for name, value in (BENT | MOVING).items() if name.startswith(("psi1", "psi2", "xi"))}
    if base["kind"] == "ski":
        start |= {"phi0": heading, "speed": 1.5}
    flat = scene(base, 2, plane=True, start=start, **keys)
    space = scene(base, 2, start=start | {"phi1": heading, "phi2": heading}, **keys)
    return vlmb.simulate(flat, duration=seconds), vlmb.simulate(space, duration=seconds)


PLANES = {
    "pivot": (PIVOT, 0.0, {}),
    "pivot on a slope": (PIVOT, 0.0, {"slope": 0.4}),
    "ski": (SKI, 0.7, {}),
    "ski down the slope": (SKI, 0.0, {"slope": 0.3}),
    "flying": (FLYING, 0.0, {}),
    "forces": (
        SKI, -0.4, {"forces": [{"on": "M_psi1", "law": "5*sin(3*t)"}, {"on": "F1_1", "law": "10*t"}, {"on": "F_x", "law": 4.0}]}
    ),
    "springs": (PIVOT, 0.0, {"forces": [{"between": ["base", "link2"], "stiffness": 1000.0, "damping": 0.5, "rest": 1.0}]}),
}  # fmt: skip


@pytest.mark.parametrize("name", PLANES)
def test_a_plane_scene_is_the_motion_that_stays_in_the_plane(name: str) -> None:
    base, heading, keys = PLANES[name]
    flat, space = pair(base, heading, **keys)
    assert flat.status == space.status == "finished", flat.message + space.message
    for entry in ("link1", "link2"):
        np.testing.assert_allclose(flat.position(entry), space.position(entry), rtol=0, atol=1e-8)
    np.testing.assert_allclose(flat["energy"], space["energy"], rtol=0, atol=1e-7)
    assert np.ptp(flat["psi1"]) > 0.5


def test_a_hinge_torque_in_the_plane_raises_the_link() -> None:
    """In space it opens the angle between the links; psi2 < psi1 here, so the two signs differ."""
    flat, _ = pair(PIVOT, 0.0, 0.15, forces=[{"on": "T_link2", "law": -2.0}])
    _, space = pair(PIVOT, 0.0, 0.15, forces=[{"on": "T_link2", "law": 2.0}])
    _, idle = pair(PIVOT, 0.0, 0.15)
    assert flat["psi2"][-1] < flat["psi1"][-1] - 0.1
    np.testing.assert_allclose(flat.position("link2"), space.position("link2"), rtol=0, atol=1e-9)
    assert flat["psi2"][-1] < idle["psi2"][-1] - 0.01


def test_a_plane_turns_with_the_ski() -> None:
    made = bent(SKI, 2, plane=True)
    trajectory = vlmb.simulate(made, duration=2.0)
    assert np.ptp(trajectory["phi0"]) > 0.3
    for entry in ("link1", "link2"):
        away = -trajectory[f"{entry}.direction.x"] * np.sin(trajectory["phi0"]) + trajectory[f"{entry}.direction.y"] * np.cos(
            trajectory["phi0"]
        )
        assert np.abs(away).max() < 1e-14
    assert np.abs(trajectory["balance"]).max() < 1e-9 * trajectory["kinetic"].max()
