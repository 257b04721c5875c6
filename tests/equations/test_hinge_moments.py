"""Hinge moments against generalized forces: virtual work of cylindrical hinges between bodies that turn."""

from __future__ import annotations

import math

import numpy as np
import pytest

import vlmb
from tests.reference.equation_cases import Table, random_posture, random_rates, random_scene
from vlmb.equations.hinge_moments import generalized_from_hinge_moments, hinge_moments_from_generalized
from vlmb.equations.motion import equations_of_motion

STEP = 1e-30  # of a complex step: the derivative has no truncation error


def tree(base: str, **changes: object) -> vlmb.Mechanism:
    table: Table = random_scene(5, base, seed=1)
    parents = [("base", "tip"), ("base", "tip"), ("link1", "rod_end"), ("link2", "tip"), ("link1", "rod_start")]
    for i, (link, (parent, point)) in enumerate(zip(table["links"], parents, strict=True)):
        link |= {"name": f"link{i + 1}", "parent": parent, "parent_point": point}
    return vlmb.build(vlmb.Scene.from_dict(table | changes))


def turning(phi: float, psi: float, phi_rate: float, psi_rate: float) -> np.ndarray:
    """Angular velocity of a body that first turns by phi about the vertical, then by psi about its horizontal axis."""
    azimuth, elevation = phi + 1j * STEP * phi_rate, psi + 1j * STEP * psi_rate
    c, s = np.cos(azimuth), np.sin(azimuth)
    a, b = np.cos(elevation), np.sin(elevation)
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[a, 0, -b], [0, 1, 0], [b, 0, a]])
    spin = (rotation.imag / STEP) @ rotation.real.T
    return np.array([spin[2, 1], spin[0, 2], spin[1, 0]])


def power_in_hinges(
    mechanism: vlmb.Mechanism, coordinates: dict[str, float], rates: dict[str, float], moments: dict[str, float]
) -> float:
    """Each moment times the rate of its own hinge: the relative rotation about its axis."""
    heading = rates.get("phi0_dot", 0.0)
    omega = {-1: np.array([0.0, 0.0, heading])}
    names = range(1, len(mechanism.layout.links) + 1)
    for i in names:
        angles = (coordinates[f"phi{i}"], coordinates[f"psi{i}"], rates[f"phi{i}_dot"], rates[f"psi{i}_dot"])
        omega[i - 1] = turning(*angles)
    power = moments.get("M_phi0", 0.0) * heading
    for i in names:
        relative = omega[i - 1] - omega[mechanism.layout.links[i - 1].parent]
        raising = np.array([math.sin(coordinates[f"phi{i}"]), -math.cos(coordinates[f"phi{i}"]), 0.0])
        power += moments[f"M_phi{i}"] * relative[2] + moments[f"M_psi{i}"] * (raising @ relative)
    return float(power + sum(moments[f"F{i}_{a}"] * rates[f"xi{i}_{a}_dot"] for i in names for a in (1, 2)))


def force_names(mechanism: vlmb.Mechanism) -> list[str]:
    return list(hinge_moments_from_generalized(mechanism, dict.fromkeys(mechanism.coordinate_names, 0.3), {}))


@pytest.mark.parametrize("base", ["pivot", "ski"])
def test_virtual_work(base: str) -> None:
    mechanism = tree(base)
    rng = np.random.default_rng(2)
    for _ in range(10):
        coordinates, rates = random_posture(mechanism, rng), random_rates(mechanism, rng)
        moments = {name: float(rng.uniform(-9, 9)) for name in force_names(mechanism) if name not in ("F_x", "F_y")}
        forces = generalized_from_hinge_moments(mechanism, coordinates, moments)
        power = sum(force * rates[f"{name}_dot"] for force, name in zip(forces.values(), mechanism.coordinate_names, strict=True))
        assert power == pytest.approx(power_in_hinges(mechanism, coordinates, rates, moments), rel=1e-12)


@pytest.mark.parametrize("base", ["pivot", "ski", "free"])
def test_both_ways(base: str) -> None:
    mechanism = tree(base)
    rng = np.random.default_rng(3)
    coordinates = random_posture(mechanism, rng)
    moments = {name: float(rng.uniform(-9, 9)) for name in force_names(mechanism)}
    forces = generalized_from_hinge_moments(mechanism, coordinates, moments)
    assert sum(abs(forces[name] - moments[name]) > 0.1 for name in moments) >= 4
    assert hinge_moments_from_generalized(mechanism, coordinates, forces) == pytest.approx(moments, rel=1e-13)
    back = generalized_from_hinge_moments(mechanism, coordinates, hinge_moments_from_generalized(mechanism, coordinates, moments))
    assert back == pytest.approx(moments, rel=1e-13)


def test_signs_of_the_paper() -> None:
    """Q_phi_i = M_phi_i - M_phi_(i+1), the reaction on psi_i carries cos(phi_(i+1) - phi_i), and the ski feels -M_phi1."""
    mechanism = vlmb.build(vlmb.Scene.from_dict(random_scene(2, "ski")))
    coordinates = random_posture(mechanism, np.random.default_rng(4))
    forces = generalized_from_hinge_moments(
        mechanism, coordinates, {"M_phi1": 1.0, "M_phi2": 10.0, "M_psi1": 100.0, "M_psi2": 1000.0, "M_phi0": 0.5, "F1_1": 7.0}
    )
    share = math.cos(coordinates["phi2"] - coordinates["phi1"])
    assert forces == {
        "F_x": 0.0, "F_y": 0.0, "M_phi0": -0.5, "M_phi1": -9.0, "M_psi1": 100.0 - 1000.0 * share, "F1_1": 7.0, "F1_2": 0.0,
        "M_phi2": 10.0, "M_psi2": 1000.0, "F2_1": 0.0, "F2_2": 0.0,
    }  # fmt: skip


def test_a_hinge_moment_cannot_turn_the_whole_about_the_vertical() -> None:
    """With the ski level and free to slide, M_phi of the hinges leave the angular momentum about the vertical alone."""
    mechanism = vlmb.build(vlmb.Scene.from_dict(random_scene(2, "ski") | {"slope": 0.0, "gravity": 0.0}))
    coordinates = random_posture(mechanism, np.random.default_rng(5)) | {"x": 0.0, "y": 0.0}
    eom = equations_of_motion(mechanism, coordinates)

    def gain(forces: dict[str, float]) -> float:
        turn = np.array([name.startswith("phi") for name in eom.names], dtype=float)
        accelerations = np.linalg.solve(eom.mass_matrix, [forces.get(f"M_{name}", 0.0) for name in eom.names])
        return float(turn @ eom.mass_matrix @ accelerations)  # rate of the momentum of phi0 = phi1 = phi2 turning together

    inner = generalized_from_hinge_moments(mechanism, coordinates, {"M_phi1": 5.0, "M_phi2": -3.0})
    assert abs(gain(inner)) < 1e-12
    assert gain({"M_phi1": 5.0, "M_phi2": -3.0}) == pytest.approx(2.0)


def test_plane_has_moments_of_elevation_alone() -> None:
    mechanism = vlmb.build(vlmb.Scene.from_dict(random_scene(2, "ski", odd=False) | {"plane": True}))
    coordinates = random_posture(mechanism, np.random.default_rng(6))
    forces = generalized_from_hinge_moments(mechanism, coordinates, {"M_psi1": 5.0, "M_psi2": 2.0})
    assert (forces["M_psi1"], forces["M_psi2"], forces["M_phi0"]) == (3.0, 2.0, 0.0)
    with pytest.raises(vlmb.SceneError, match="unknown force 'M_phi1'; with plane = true"):
        generalized_from_hinge_moments(mechanism, coordinates, {"M_phi1": 1.0})


def test_errors() -> None:
    mechanism = tree("pivot")
    coordinates = random_posture(mechanism, np.random.default_rng(7))
    with pytest.raises(vlmb.SceneError, match="unknown force 'M_phi0'"):
        generalized_from_hinge_moments(mechanism, coordinates, {"M_phi0": 1.0})
    with pytest.raises(vlmb.SceneError, match="M_psi2 = nan: must be finite"):
        hinge_moments_from_generalized(mechanism, coordinates, {"M_psi2": math.nan})
    del coordinates["psi3"]
    with pytest.raises(vlmb.SceneError, match="missing coordinates: psi3 of 'link3'"):
        generalized_from_hinge_moments(mechanism, coordinates, {})


@pytest.mark.parametrize("value", ["a", None, [1.0], math.nan])
def test_a_moment_is_a_finite_number(value: object) -> None:
    mechanism = vlmb.build(vlmb.Scene.from_dict(random_scene(2, "ski")))
    coordinates = random_posture(mechanism, np.random.default_rng(1))
    for convert in (generalized_from_hinge_moments, hinge_moments_from_generalized):
        with pytest.raises(vlmb.SceneError, match=r"M_psi1 = .*: must be"):
            convert(mechanism, coordinates, {"M_psi1": value})
