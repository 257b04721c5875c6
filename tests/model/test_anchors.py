"""Links on anchors and anywhere along rods: where the generated model has them, and where they are read."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

import vlmb
from tests.anchored import anchored
from tests.reference.particles import Particles
from tests.small_scenes import FIXED, PIVOT, SKI, link, random_state, table
from vlmb.model.memory import make_data
from vlmb.model.mjcf import mjcf
from vlmb.model.names import POINTS

BARE = {"lower": None, "upper": None, "tip_mass": None}


@pytest.mark.parametrize("plane", [False, True])
@pytest.mark.parametrize("base", ["pivot", "ski"])
def test_points_are_read_where_pinocchio_has_them(base: str, plane: bool) -> None:
    mechanism = vlmb.build(anchored(base, plane=plane))
    q, v = random_state(mechanism, 3)
    seen = mechanism.postures((q, v))
    model, data = mechanism.model, make_data(mechanism.model)
    pin.forwardKinematics(model, data, q, v)
    pin.updateFramePlacements(model, data)
    for i, at in enumerate(mechanism.layout.links):
        for point in POINTS:
            frame = mechanism.frames[f"{at.name}.{point}"]
            velocity = pin.getFrameVelocity(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED).linear
            np.testing.assert_allclose(seen.position(i, point), data.oMf[frame].translation, atol=1e-13)
            np.testing.assert_allclose(seen.velocity(i, point), velocity, atol=1e-13)
    pin.centerOfMass(model, data, q, v)
    np.testing.assert_allclose(seen.centre_of_mass[0], data.com[0], atol=1e-13)
    np.testing.assert_allclose(seen.centre_of_mass[1], data.vcom[0], atol=1e-13)


@pytest.mark.parametrize("base", ["pivot", "ski"])
def test_hinges_stand_where_the_scene_says(base: str) -> None:
    scene = anchored(base)
    mechanism, particles = vlmb.build(scene), Particles(scene)
    coordinates = dict.fromkeys(mechanism.coordinate_names, 0.3)
    for name in particles.links:
        where = np.array(particles.place(name, 0.0, coordinates), float)
        np.testing.assert_allclose(mechanism.position(mechanism.state(coordinates), name, "hinge"), where, atol=1e-14)


def test_an_anchor_goes_with_the_ski() -> None:
    mechanism = vlmb.build(table(SKI, [link("leg", anchor=[0.4, -0.1, 0.2], **BARE)]))
    coordinates = {"x": 2.0, "y": 1.0, "phi0": math.pi / 2, "phi1": 0.0, "psi1": math.pi / 2}
    state = mechanism.state(coordinates, {"phi0_dot": 3.0, "y_dot": 1.0})
    np.testing.assert_allclose(mechanism.position(state, "leg", "hinge"), [2.1, 1.4, 0.2], atol=1e-15)
    np.testing.assert_allclose(mechanism.postures(state).velocity(0, "hinge"), [-1.2, 1.0 + 0.3, 0.0], atol=1e-14)


def test_an_anchor_in_the_origin_is_none() -> None:
    for base in (PIVOT, SKI):
        with_it = vlmb.build(table(base, [link("leg", anchor=[0.0, 0.0, 0.0])]))
        assert with_it.model == vlmb.build(table(base, [link("leg")])).model


@pytest.mark.parametrize(("point", "same"), [(0.2, "rod_start"), (0.7, "rod_end"), (0.9, "tip")])
def test_a_number_means_the_point_that_is_there(point: float, same: str) -> None:
    def model(where: object) -> pin.Model:
        trunk = link("trunk", lower=FIXED, upper=FIXED)
        return vlmb.build(table(PIVOT, [trunk, link("arm", parent_point=where, **BARE)])).model

    for ours, theirs in zip(model(point).jointPlacements, model(same).jointPlacements, strict=True):
        np.testing.assert_allclose(ours.homogeneous, theirs.homogeneous, atol=1e-15)


def test_in_a_plane_links_stay_parallel_to_it() -> None:
    mechanism = vlmb.build(anchored("pivot", plane=True))
    seen = mechanism.postures(random_state(mechanism, 1))
    for i in range(len(mechanism.layout.links)):
        root = mechanism.layout.path(i)[0]
        assert seen.position(i, "tip")[1] == mechanism.layout.links[root].anchor[1]


def test_links_hang_aside_in_a_plane() -> None:
    """A spring without a rest length pulls in the plane as it would without, and holds more; both engines and MJCF know."""
    def pair(aside: float, engine: str = "core") -> vlmb.Trajectory:
        legs = [link(name, parent="trunk", parent_point=0.2, aside=y, **BARE) for name, y in (("left", aside), ("right", -aside))]
        spring = {"between": ["left.tip", "right.tip"], "stiffness": 50.0}
        scene = table(PIVOT, [link("trunk", lower=FIXED, upper=FIXED), *legs], plane=True, springs=[spring])
        scene |= {"start": {"psi1": 1.2, "psi2": -1.0, "psi3": -1.4, "psi1_dot": 0.5}, "run": {"duration": 0.2, "fall": False}}
        return vlmb.simulate(vlmb.Scene.from_dict(scene), engine=engine)

    apart, close, other = pair(0.1), pair(0.0), pair(0.1, "pinocchio")
    np.testing.assert_array_equal(apart["left.tip.y"], 0.1)
    np.testing.assert_allclose(apart.position("right", "rod_start")[:, 1], -0.1, atol=1e-15)
    assert apart["spring"][0] - close["spring"][0] == pytest.approx(0.5 * 50.0 * 0.2**2, rel=1e-12)
    np.testing.assert_allclose(apart["psi2"], close["psi2"], atol=1e-9)
    np.testing.assert_allclose(apart["psi2"], other["psi2"], atol=1e-7)
    placed = apart.mechanism.model.jointPlacements[apart.mechanism.model.getJointId("left")].translation
    assert placed[1] == 0.1 and 'pos="0.2 0.1 0.0"' in mjcf(apart.mechanism)


def test_what_a_spring_pulls_out_of_a_plane_the_plane_carries() -> None:
    """A pendulum of 1 kg m^2/3 on a spring of 20 N/m to a point beside its plane, against a torque by hand."""
    rod = {"name": "rod", "rod": {"length": 1.0, "mass": 1.0}}
    beside = {"between": ["rod.tip", [1.0, 0.5, 0.0]], "stiffness": 20.0, "rest": 0.3}
    scene = vlmb.Scene.from_dict({"plane": True, "base": PIVOT, "links": [rod], "springs": [beside], "start": {"psi1": -1.0}})
    r = np.array([1.0 - math.cos(1.0), 0.5, math.sin(1.0)])
    pull = 20.0 * (1.0 - 0.3 / np.linalg.norm(r)) * r
    torque = math.cos(1.0) * pull[2] + math.sin(1.0) * pull[0] - 9.81 * 0.5 * math.cos(1.0)
    assert vlmb.accelerations(scene, {"psi1": -1.0}, {})["psi1"] == pytest.approx(3.0 * torque, rel=1e-12)
    runs = [vlmb.simulate(scene, duration=0.5, engine=engine) for engine in ("core", "pinocchio")]
    np.testing.assert_allclose(runs[0]["psi1"], runs[1]["psi1"], atol=1e-7)
    assert not np.any(runs[0]["rod.tip.y"]) and np.abs(runs[0]["balance"]).max() < 1e-7
