"""The engine against the mass-point witness and against exact solutions: positions to 1e-9 m over seconds."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.reference import exact
from tests.reference.witness import Witness
from vlmb.model.memory import make_data

RUN = {"rtol": 1e-11, "atol": 1e-12, "fall": False}
FREE = {"limits": [-math.inf, math.inf]}  # the witness knows no limits


def link(name: str, **changes: Any) -> dict[str, Any]:
    table = {
        "name": name,
        "rod": {"length": 0.5, "mass": 3.0},
        "lower": {"length": 0.3, "stiffness": 2000.0, **FREE},
        "upper": {"length": 0.2, "stiffness": 1500.0, **FREE},
        "tip_mass": 2.0,
    }
    return {key: value for key, value in (table | changes).items() if value is not None}


def for_witness(scene: dict[str, Any]) -> dict[str, Any]:
    kept = {key: value for key, value in scene.items() if key not in ("run", "forces", "name")}
    links = []
    for entry in kept["links"]:
        entry = dict(entry)
        for side in ("lower", "upper"):
            if side in entry:
                entry[side] = {key: value for key, value in entry[side].items() if key not in ("limits", "law")}
        links.append(entry)
    return {**kept, "links": links}


SKI = {"kind": "ski", "mass": 5.0, "inertia": 0.6}
START = {"psi1": 0.4, "phi1": 0.3, "phi1_dot": 1.1, "psi1_dot": -0.4}
SCENES: dict[str, dict[str, Any]] = {
    "one link, pivoted": {"base": {"kind": "pivot"}, "links": [link("a")], "start": START},
    "two links, pivoted": {
        "base": {"kind": "pivot"},
        "links": [link("a"), link("b", rod={"length": 0.4, "mass": 2.0})],
        "start": {**START, "psi2": -0.5, "phi2": 1.0, "phi2_dot": -1.0},
    },
    "one link on the ski": {"base": SKI, "links": [link("a")], "start": {**START, "phi0": 0.2, "phi0_dot": 0.7, "speed": 2.0}},
    "two links on the ski": {
        "base": {**SKI, "com_offset": 0.15},
        "slope": 0.2,
        "links": [link("a"), link("b", rod={"length": 0.4, "mass": 2.0, "com": 0.15, "inertia": 0.05})],
        "start": {**START, "psi2": 1.0, "phi2": 1.0, "phi0": 1.4, "phi0_dot": 0.5, "speed": 2.0},
    },
    "flying chain": {
        "base": {"kind": "free"},
        "links": [link("a", lower={"length": 0.3, "motion": "fixed"}), link("b")],
        "start": {**START, "z": 1.0, "z_dot": 3.0, "x_dot": 1.0, "psi2": 0.9, "psi2_dot": 2.0},
    },
}


def largest_gap(trajectory: vlmb.Trajectory, result: Any) -> float:
    gaps = [0.0]
    for entry in trajectory.mechanism.layout.links:
        for point in ("hinge", "rod_start", "rod_end", "tip"):
            gaps.append(np.abs(trajectory.position(entry.name, point) - result.position(entry.name, point)).max())
    return float(max(gaps))


@pytest.mark.parametrize("name", SCENES)
def test_positions_agree_with_mass_points(name: str) -> None:
    scene = {**SCENES[name], "run": RUN}
    seconds = 1.5 if "flying" in name else 3.0
    times = np.linspace(0.0, seconds, 301)  # dense, so that both follow one branch of the angles
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(scene), duration=seconds, t_eval=times)
    assert trajectory.status == "finished", trajectory.message
    result = Witness(for_witness(scene)).simulate(times)
    assert largest_gap(trajectory, result) < 1e-9
    for coordinate in trajectory.mechanism.coordinate_names:
        np.testing.assert_allclose(trajectory[coordinate], result.coordinates[coordinate], rtol=0, atol=2e-8, err_msg=coordinate)
    np.testing.assert_allclose(trajectory["energy"], result.energy, rtol=1e-9, atol=1e-8)
    if scene["base"]["kind"] == "ski":
        largest = np.abs(result.edge_force).max()
        np.testing.assert_allclose(trajectory.reactions["knife_edge"], result.edge_force, rtol=0, atol=1e-8 * largest)


@pytest.mark.parametrize("form", ["multiplier", "projection"])
def test_knife_edge_forms_agree_with_mass_points(form: str) -> None:
    scene = {**SCENES["two links on the ski"], "run": RUN}
    times = np.linspace(0.0, 2.0, 41)
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(scene), duration=2.0, t_eval=times, knife_edge=form, gain=3.0)
    result = Witness(for_witness(scene)).simulate(times)
    assert largest_gap(trajectory, result) < 1e-9
    largest = np.abs(result.edge_force).max()
    np.testing.assert_allclose(trajectory.reactions["knife_edge"], result.edge_force, rtol=0, atol=1e-8 * largest)


def branched(base: dict[str, Any]) -> dict[str, Any]:
    """A tree with a fixed and a prescribed segment, hanging points of every kind."""
    return {
        "base": base,
        "links": [
            link("legs", upper={"length": 0.2, "motion": "fixed"}),
            link("arm", parent="legs", parent_point="rod_end", lower={"length": 0.1, "motion": "fixed"}),
            link("trunk", parent="legs", upper={"motion": "prescribed", "law": "0.25 + 0.05*sin(3*t)"}),
            link("pole", parent="arm", parent_point="rod_start", rod={"length": 0.3, "mass": 1.0}, upper=None, tip_mass=None),
        ],
        "start": {
            "psi1": 0.9, "phi1": 0.2, "psi2": 0.1, "phi2": 1.2, "psi3": 0.6, "phi3": -0.4, "psi4": -0.7, "phi4": 0.5,
            "phi1_dot": 0.5, "psi3_dot": -0.6,
        },
    }  # fmt: skip


def pumping(t: float) -> tuple[float, float, float]:
    return 0.25 + 0.05 * math.sin(3 * t), 0.15 * math.cos(3 * t), -0.45 * math.sin(3 * t)


@pytest.mark.parametrize("base", [{"kind": "pivot"}, {**SKI, "com_offset": 0.1}], ids=["pivot", "ski"])
@pytest.mark.parametrize("seed", [1, 2])
def test_tree_under_random_generalized_forces(base: dict[str, Any], seed: int) -> None:
    scene = {**branched(base), "gravity": 0.5, "run": RUN}  # weak, so that no link comes near a pole, where M_psi changes sides
    mechanism = vlmb.build(vlmb.Scene.from_dict(scene))
    names = [n for n in mechanism.coordinate_names if n != "xi3_2"]
    random = np.random.default_rng(seed)
    amplitudes = {n: random.uniform(-0.6, 0.6) for n in names}
    channel = {n: force_name(n) for n in names}

    def load(t: float) -> dict[str, float]:
        return {channel[n]: amplitudes[n] * math.sin((2.0 + k) * t + k) for k, n in enumerate(names)}

    times = np.linspace(0.0, 2.0, 41)
    trajectory = vlmb.simulate(mechanism, duration=2.0, t_eval=times, control=lambda t, view: load(t))
    assert trajectory.status == "finished", trajectory.message
    result = Witness(for_witness(scene), {"xi3_2": pumping}).simulate(
        times, force=lambda t, q, v: {n: load(t)[channel[n]] for n in names}
    )
    assert min(np.abs(np.cos(trajectory[f"psi{i}"])).min() for i in range(1, 5)) > 0.3
    assert largest_gap(trajectory, result) < 1e-9
    force = result.prescribed_force["xi3_2"]
    np.testing.assert_allclose(trajectory.controls["F3_2"], force, rtol=0, atol=5e-8 * np.abs(force).max())
    scale = np.abs(trajectory["kinetic"]).max()
    assert np.abs(trajectory["balance"]).max() < 1e-9 * max(scale, 1.0)


def force_name(coordinate: str) -> str:
    if coordinate.startswith("xi"):
        return "F" + coordinate[2:]
    return ("M_" if coordinate.startswith(("phi", "psi")) else "F_") + coordinate


def test_scene_order_of_a_tree_does_not_matter() -> None:
    scene = branched({"kind": "pivot"})
    shuffled = {**scene, "links": [scene["links"][k] for k in (0, 2, 1, 3)]}
    for entry, parent in zip(shuffled["links"], ("base", "legs", "legs", "arm"), strict=True):
        entry["parent"] = parent
    shuffled["start"] = {
        "psi1": 0.9, "phi1": 0.2, "psi3": 0.1, "phi3": 1.2, "psi2": 0.6, "phi2": -0.4, "psi4": -0.7, "phi4": 0.5,
        "phi1_dot": 0.5, "psi2_dot": -0.6,
    }  # fmt: skip
    first = vlmb.simulate(vlmb.Scene.from_dict({**scene, "run": RUN}), duration=1.0)
    second = vlmb.simulate(vlmb.Scene.from_dict({**shuffled, "run": RUN}), duration=1.0)
    for name in ("legs", "arm", "trunk", "pole"):
        np.testing.assert_allclose(first.position(name), second.position(name), rtol=0, atol=1e-9)


def test_skate_on_a_slope() -> None:
    scene = {"base": SKI, "slope": 0.3, "start": {"phi0_dot": 1.3}, "run": {**RUN, "duration": 6.0}}
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(scene))
    solution = exact.skate(trajectory.t, 5.0, 0.3, 1.3)
    for name in ("x", "y", "phi0"):
        np.testing.assert_allclose(trajectory[name], solution[name], rtol=0, atol=1e-9)
    pull = 2 * 5.0 * 9.81 * math.sin(0.3) * np.sin(1.3 * trajectory.t)
    np.testing.assert_allclose(trajectory.reactions["knife_edge"], pull, rtol=0, atol=1e-8)


@pytest.mark.parametrize("method", ["adams", "dop853"])
def test_conical_spring_pendulum(method: str) -> None:
    theta, stiffness, mass, rest = 0.6, 400.0, 2.0, 0.8
    reach = rest + mass * 9.81 / (stiffness * math.cos(theta))
    rate = math.sqrt(9.81 / (reach * math.cos(theta)))
    spring = {"length": rest, "stiffness": stiffness}
    bob = {"name": "bob", "rod": {"length": 0.0, "mass": 0.0}, "lower": spring, "tip_mass": mass}
    start = {"psi1": -math.pi / 2 + theta, "phi1_dot": rate, "xi1_1": reach}
    scene = {"base": {"kind": "pivot"}, "links": [bob], "start": start, "run": {**RUN, "duration": 5.0}}
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(scene), method=method)
    np.testing.assert_allclose(trajectory["xi1_1"], reach, rtol=0, atol=1e-9)
    np.testing.assert_allclose(trajectory["phi1"], rate * trajectory.t, rtol=0, atol=1e-9)


def test_prescribed_length_without_gravity() -> None:
    """l^2 theta' = h, F = m (l'' - l theta'^2)."""
    bob = {"rod": {"length": 0.0, "mass": 0.0}, "lower": {"motion": "prescribed", "law": "1 + 0.3*sin(2*t)"}, "tip_mass": 1.5}
    start = {"psi1": 0.0, "phi1_dot": 1.2}
    scene = {"gravity": 0.0, "base": {"kind": "pivot"}, "links": [bob], "start": start, "run": {**RUN, "duration": 5.0}}
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(scene))
    t = trajectory.t
    length = 1 + 0.3 * np.sin(2 * t)
    angle = exact.cumulative(lambda s: 1.2 / (1 + 0.3 * math.sin(2 * s)) ** 2, t)
    np.testing.assert_allclose(trajectory["phi1"], angle, rtol=0, atol=1e-9)
    servo = 1.5 * (-1.2 * np.sin(2 * t) - length * (1.2 / length**2) ** 2)
    np.testing.assert_allclose(trajectory.controls["F1_1"], servo, rtol=0, atol=1e-9)
    kinetic = 0.5 * 1.5 * ((0.6 * np.cos(2 * t)) ** 2 + (1.2 / length) ** 2)
    np.testing.assert_allclose(trajectory.work_by_force["F1_1"], kinetic - kinetic[0], rtol=0, atol=1e-9)


def test_link_through_the_vertical_and_heading_through_a_right_angle() -> None:
    scene = {
        "base": SKI,
        "links": [link("a", upper=None)],
        "start": {"psi1": 1.2, "phi1": 0.3, "psi1_dot": 4.0, "phi0": 1.3, "phi0_dot": 2.0, "speed": 2.0},
        "run": RUN,
    }
    times = np.linspace(0.0, 0.8, 41)
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(scene), duration=0.8, t_eval=times)
    result = Witness(for_witness(scene)).simulate(times)
    assert trajectory["psi1"].max() > math.pi / 2 + 0.3
    assert trajectory["phi0"].max() > math.pi / 2 + 1.0
    assert np.abs(np.diff(trajectory["phi1"])).max() < 2.0
    assert largest_gap(trajectory, result) < 1e-9


@pytest.mark.parametrize("offset", [0.0, 1e-12, 1e-6, 1e-3])
def test_passing_the_pole_keeps_the_angular_momentum(offset: float) -> None:
    scene = {
        "base": {"kind": "pivot"},
        "links": [link("a", upper=None, tip_mass=None)],
        "start": {"psi1": 1.0, "psi1_dot": 5.0, "phi1_dot": offset},
        "run": {**RUN, "duration": 2.0},
    }
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(scene))
    tip, length = trajectory.position("a", "tip"), trajectory["a.length"]
    direction = tip / length[:, None]
    if offset == 0.0:
        assert np.abs(direction[:, 1]).max() == 0.0
        assert trajectory["psi1"].max() > math.pi / 2
    assert np.abs(trajectory["balance"]).max() < 1e-9 * trajectory["kinetic"].max()
    momentum = vertical_momentum(trajectory)
    np.testing.assert_allclose(momentum, momentum[0], rtol=0, atol=1e-10)


def vertical_momentum(trajectory: vlmb.Trajectory) -> np.ndarray:
    """Angular momentum about the vertical of a one-link pivoted chain without tip mass: J cos^2(psi) phidot, from directions."""
    import pinocchio as pin

    model, data = trajectory.mechanism.model, make_data(trajectory.mechanism.model)
    found = []
    for q, v in zip(trajectory.q, trajectory.v, strict=True):
        momentum = pin.computeCentroidalMomentum(model, data, q, v)
        found.append(momentum.angular[2] + np.cross(data.com[0], momentum.linear)[2])
    return np.array(found)
