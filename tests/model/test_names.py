"""The vocabulary: every name is found, read, and has the rate that its value has along a motion."""

from __future__ import annotations

import itertools

import numpy as np
import pinocchio as pin
import pytest

import vlmb
from tests.small_scenes import BENT, FIXED, FLYING, MOVING, PIVOT, SKI, TIGHT, link, random_state, scene

TREE = [
    link("legs"),
    link("arm", parent="legs", parent_point="rod_end", lower=FIXED),
    link("trunk", parent="legs", upper={"motion": "prescribed", "law": "0.3 + 0.1*sin(3*t)"}),
]
SCENES = {
    "tree on the ski": scene(SKI, TREE, start=BENT),
    "flying tree": scene(FLYING, TREE, start=BENT),
    "pivot": scene(PIVOT, 2),
    "plane": scene(PIVOT, 2, plane=True),
    "flying in a plane": scene(FLYING, 2, plane=True),
}


@pytest.mark.parametrize("name", SCENES)
def test_points_and_the_centre_of_mass_are_where_pinocchio_has_them(name: str) -> None:
    mechanism = vlmb.build(SCENES[name])
    model, data = mechanism.model, mechanism.model.createData()
    for seed in range(5):
        q, v = random_state(mechanism, seed)
        seen = mechanism.postures((q, v))
        pin.forwardKinematics(model, data, q, v)
        pin.centerOfMass(model, data, q, v)
        np.testing.assert_allclose(seen.centre_of_mass[0], data.com[0], atol=1e-13)
        np.testing.assert_allclose(seen.centre_of_mass[1], data.vcom[0], atol=1e-12)
        for frame, at in mechanism.frames.items():
            owner, _, point = frame.partition(".")
            if point:
                i = mechanism.names.links[owner]
                placed = pin.updateFramePlacement(model, data, at).translation
                moving = pin.getFrameVelocity(model, data, at, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED).linear
                np.testing.assert_allclose(seen.position(i, point), placed, atol=1e-13)
                np.testing.assert_allclose(seen.velocity(i, point), moving, atol=1e-12)


@pytest.mark.parametrize("name", SCENES)
def test_every_name_has_the_rate_of_its_value(name: str) -> None:
    given = {key: value for key, value in MOVING.items() if key in vlmb.build(SCENES[name]).names.known}
    run = vlmb.simulate(SCENES[name].changed(start=given, run=TIGHT), t_eval=0.2 + 1e-3 * np.arange(-2, 3))
    names = run.mechanism.names
    middle = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12e-3  # a derivative of fourth order
    checked = 0
    for name in names:
        quantity = names.find(name)
        if not quantity.rate:
            rate = run[f"{name}_dot"][2]
            assert middle @ run[name] == pytest.approx(rate, abs=2e-8 * (1.0 + abs(rate))), name
            assert names.find(f"{name}_dot").rate and quantity.unit + "/s" in (names.find(f"{name}_dot").unit, "/s")
            checked += 1
    assert checked > 30


def test_aliases_are_the_coordinates() -> None:
    mechanism = vlmb.build(SCENES["tree on the ski"])
    pairs = {"legs.lower": "xi1_1", "legs.upper": "xi1_2", "arm.azimuth": "phi2", "trunk.elevation_dot": "psi3_dot"}
    for alias, coordinate in pairs.items():
        assert mechanism.names.find(alias) == mechanism.names.find(coordinate)
    values = dict(zip(mechanism.coordinate_names, np.linspace(0.1, 0.9, len(mechanism.coordinate_names)), strict=True))
    spelled = {"legs.lower" if name == "xi1_1" else "trunk.azimuth" if name == "phi3" else name: x for name, x in values.items()}
    for one, other in zip(mechanism.state(values), mechanism.state(spelled, {"legs.lower_dot": 0.0}), strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(
        vlmb.equations_of_motion(mechanism, spelled, {"legs.azimuth_dot": 0.4}).bias,
        vlmb.equations_of_motion(mechanism, values, {"phi1_dot": 0.4}).bias,
    )


def test_aliases_serve_in_starts_equations_and_trajectories() -> None:
    keys = {"constraints": ["legs.elevation = 1.1"], "run": {"duration": 0.2}}
    run = vlmb.simulate(scene(SKI, [link("legs")], start={"legs.lower": 0.35, "legs.azimuth_dot": 0.3, "psi1": 1.1}, **keys))
    assert run["legs.lower"][0] == 0.35 and run["phi1_dot"][0] == pytest.approx(0.3)
    np.testing.assert_array_equal(run["legs.elevation"], run["psi1"])
    assert np.abs(run.residuals["legs.elevation = 1.1"].position).max() < 1e-7


def test_a_name_given_twice_is_refused() -> None:
    with pytest.raises(vlmb.SceneError, match=r"start.legs.lower: xi1_1 is given already"):
        vlmb.simulate(scene(PIVOT, [link("legs")], start={"xi1_1": 0.3, "legs.lower": 0.3}))


@pytest.mark.parametrize(
    ("name", "advice"),
    [
        ("lean", "valid names: phi1"),
        ("legs.tp.z", "did you mean 'legs.tip.z'"),
        ("arm.lower", "this segment is 0.2 m long and makes no coordinate"),
        ("legs.tip", "x, y, z of direction, hinge"),
        ("com", "did you mean 'com"),
        ("xi2_1", "did you mean 'xi2_2' or 'xi1_1'"),
    ],
)
def test_wrong_names_are_explained(name: str, advice: str) -> None:
    mechanism = vlmb.build(scene(PIVOT, [link("legs"), link("arm", lower=FIXED)]))
    with pytest.raises(vlmb.SceneError, match=f"here: unknown name {name!r}.*{advice}"):
        mechanism.names.find(name, "here")
    assert name not in mechanism.names


@pytest.mark.parametrize("equation", ["com.z = 0.9", "com.y_dot = 0.1*t", "legs.tip.x_dot = 0.3", "trunk.length_dot = 0"])
def test_rows_on_composed_names_hold(equation: str) -> None:
    """The row's reaction keeps the quantity; the witness is the trajectory's own reading, without the row's derivatives."""
    given = {"psi1": 1.3, "psi2": 1.1, "phi2": 0.4, "com.z": 0.9}
    legs = [link("legs"), link("trunk")]
    start = {key: value for key, value in given.items() if "." not in key}
    run = vlmb.simulate(scene(SKI, legs, start=start, constraints=[equation], run={"duration": 0.5, **TIGHT}))
    left, _, right = equation.partition(" = ")
    wanted = 0.1 * run.t if "t" in right else float(right)
    assert run.status == "finished" and np.abs(run[left] - wanted).max() < 1e-9


def test_units_and_symbols() -> None:
    names = vlmb.build(SCENES["tree on the ski"]).names
    units = {"x": "m", "phi0": "rad", "psi1_dot": "rad/s", "xi1_1_dot": "m/s", "speed": "m/s", "legs.direction.x": ""}
    assert {name: names.find(name).unit for name in units} == units
    assert names.find("xi1_2_dot").symbol == r"$\dot{\xi}_{12}$" and names.find("phi0").symbol == r"$\varphi_{0}$"
    assert {force.unit for force in names.forces.values()} == {"N", "N m"}
    assert names.forces["M_psi1"].symbol == r"$M_{\psi_{1}}$"


def test_the_list_has_every_name_once() -> None:
    names = vlmb.build(SCENES["tree on the ski"]).names
    listed = list(names)
    assert len(listed) == len(set(listed)) == len(names)
    assert all(name in names for name in listed)
    own = itertools.product(("legs", "arm", "trunk"), ("direction", "hinge", "rod_start", "rod_end", "tip"), "xyz", ("", "_dot"))
    assert {f"{who}.{what}.{axis}{dot}" for who, what, axis, dot in own} <= set(listed)
