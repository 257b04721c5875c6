"""Springs and dampers between two directions: what they take, what they keep, and where they have no axis."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import simpson

import vlmb
from tests.small_scenes import FIXED, FLYING, PIVOT, SKI, bent, link, scene
from vlmb.simulation.checking import check

ENGINES = ["core", "pinocchio"]
TOLERANCES = [1e-4, 1e-6, 1e-9, 1e-11]
RIGID = {"lower": FIXED, "upper": FIXED}


def directions(trajectory: vlmb.Trajectory, name: str) -> np.ndarray:
    """A direction (N, 3) by the name that it has in `between`."""
    if name == "base":
        return np.broadcast_to([0.0, 0.0, 1.0], (len(trajectory), 3))
    if name == "heading":
        heading = trajectory["phi0"] if trajectory.scene.base.kind == "ski" else np.zeros(len(trajectory))
        return np.column_stack([np.cos(heading), np.sin(heading), 0.0 * heading])
    return np.column_stack([trajectory[f"{name}.direction.{axis}"] for axis in "xyz"])


def angle_between(trajectory: vlmb.Trajectory, pair: list[str]) -> np.ndarray:
    """Theta (N,): in a plane the signed angle of two links."""
    if trajectory.scene.plane and all(name.startswith("link") for name in pair):
        return np.asarray(trajectory[f"psi{pair[1][-1]}"] - trajectory[f"psi{pair[0][-1]}"])
    first, second = (directions(trajectory, name) for name in pair)
    return np.arctan2(np.linalg.norm(np.cross(first, second), axis=1), np.sum(first * second, axis=1))


def power_taken(trajectory: vlmb.Trajectory, pair: list[str], damping: float) -> np.ndarray:
    """c theta'^2 between two links; c |d' - w x d|^2 against the base, by differences of the directions."""
    t = trajectory.t
    if all(name.startswith("link") for name in pair):
        return damping * np.gradient(angle_between(trajectory, pair), t, edge_order=2) ** 2
    d = directions(trajectory, max(pair, key=lambda name: name.startswith("link")))
    yaw = trajectory["phi0_dot"] if trajectory.scene.base.kind == "ski" else np.zeros(len(t))
    turning = np.gradient(d, t, axis=0, edge_order=2) - np.cross(yaw[:, None] * [0.0, 0.0, 1.0], d)
    return damping * np.sum(turning**2, axis=1)


@pytest.mark.parametrize("pair", [["link1", "link2"], ["base", "link1"], ["link2", "heading"]], ids="-".join)
@pytest.mark.parametrize("base", [PIVOT, SKI], ids=["pivot", "ski"])
@pytest.mark.parametrize("plane", [False, True])
def test_springs_conserve_energy_and_dampers_take_it(base: dict[str, Any], pair: list[str], plane: bool) -> None:
    signed = plane and pair == ["link1", "link2"]
    rest = -1.0 if signed else 1.0
    spring = {"between": pair, "stiffness": 1000.0, "rest": rest}  # too stiff to be lined up, where it has a kink
    kept = vlmb.simulate(bent(base, 2, forces=[spring], plane=plane), duration=1.5)
    assert kept.status == "finished", kept.message
    scale = kept["kinetic"].max()
    np.testing.assert_allclose(kept["energy"], kept["energy"][0], rtol=0, atol=1e-9 * scale)
    assert np.ptp(kept["spring"]) > 0.1
    times = np.linspace(0.0, 1.5, 3001)
    lost = vlmb.simulate(bent(base, 2, forces=[{**spring, "damping": 2.0}], plane=plane), duration=1.5, t_eval=times)
    assert np.abs(lost["balance"]).max() < 1e-9 * scale
    assert (np.diff(lost["dissipated"]) >= -1e-12).all()
    assert lost["dissipated"][-1] > 0.05
    assert simpson(power_taken(lost, pair, 2.0), x=times) == pytest.approx(lost["dissipated"][-1], rel=2e-4)
    stored = 500.0 * (angle_between(lost, pair) - rest) ** 2
    for i in (1, 2):
        for which, stiffness, length in ((1, 2000.0, 0.3), (2, 1500.0, 0.2)):
            stored = stored + 0.5 * stiffness * (lost[f"xi{i}_{which}"] - length) ** 2
    np.testing.assert_allclose(lost["spring"] - lost["spring"][0], stored - stored[0], rtol=0, atol=1e-9 * scale)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("end", ["base", "heading"])
@pytest.mark.parametrize("way", ["up", "round", "askew"])
@pytest.mark.parametrize("psi", [0.0, 0.9, math.pi / 2 - 1e-3])
def test_a_free_link_against_the_base_slows_down_as_an_exponential(engine: str, end: str, way: str, psi: float) -> None:
    """J omega' = -c omega in every direction and posture: omega = omega(0) exp(-c t / J), about an axis that stays."""
    rates = {"up": (0.7, 0.0), "round": (0.0, 0.7), "askew": (0.5, -0.4)}[way]
    start = {"psi1": psi, "phi1": 0.3, "psi1_dot": rates[0], "phi1_dot": rates[1] / max(math.cos(psi), 0.02)}
    made = scene(
        PIVOT, [link("leg", **RIGID)], gravity=0.0, start=start, forces=[{"between": [end, "leg"], "damping": 0.6}]
    )  # fmt: skip
    trajectory = vlmb.simulate(made, duration=3.0, engine=engine)
    assert trajectory.status == "finished", trajectory.message
    inertia = 3.0 * 0.5**2 / 12.0 + 3.0 * 0.45**2 + 2.0 * 0.9**2
    d = directions(trajectory, "leg")
    rate = np.column_stack([trajectory[f"leg.direction.{axis}_dot"] for axis in "xyz"])
    omega = np.cross(d, rate)
    expected = np.exp(-0.6 * trajectory.t / inertia)[:, None] * omega[0]
    np.testing.assert_allclose(omega, expected, rtol=0, atol=1e-9 * np.linalg.norm(omega[0]))
    assert np.abs(trajectory["balance"]).max() < 1e-9 * trajectory["kinetic"].max()


@pytest.mark.parametrize("engine", ENGINES)
def test_the_ski_feels_the_damper_on_its_rider(engine: str) -> None:
    """A ski at rest is turned by a rider who swings round: power c |d' - w x d|^2, reaction on the yaw."""
    base = {**SKI, "com_offset": 0.0}
    start = {"psi1": 0.4, "phi1": 0.2, "phi1_dot": 2.0}
    made = scene(base, [link("link1", **RIGID)], start=start, forces=[{"between": ["base", "link1"], "damping": 1.5}])
    times = np.linspace(0.0, 0.5, 2001)
    trajectory = vlmb.simulate(made, duration=0.5, t_eval=times, engine=engine)
    assert trajectory["phi0_dot"][-1] > 0.1
    assert simpson(power_taken(trajectory, ["base", "link1"], 1.5), x=times) == pytest.approx(
        trajectory["dissipated"][-1], rel=1e-5
    )
    assert np.abs(trajectory["balance"]).max() < 1e-9 * trajectory["kinetic"].max()


BENT_PAIR = {
    "psi1": 0.7, "phi1": 0.4, "psi2": 0.2, "phi2": 1.3, "phi1_dot": 0.8, "psi1_dot": -0.5, "phi2_dot": -1.1, "psi2_dot": 0.6,
}  # fmt: skip


@pytest.mark.parametrize("engine", ENGINES)
def test_a_damper_between_two_links_has_no_fading_and_turns_nothing(engine: str) -> None:
    """Its power is c theta'^2 as near to the line-up as 0.002 rad, and the whole keeps its angular momentum."""
    start = {"psi1": 0.3, "psi2": 0.302, "phi1": 0.1, "phi2": 0.1}
    start |= {"psi2_dot": 1.5, "psi1_dot": -0.4, "phi1_dot": 0.2, "phi2_dot": 0.2}
    made = scene(
        FLYING, [link("link1", **RIGID), link("link2", **RIGID)], gravity=0.0, start=start,
        forces=[{"between": ["link1", "link2"], "damping": 0.8}],
    )  # fmt: skip
    times = np.linspace(0.0, 0.4, 4001)
    trajectory = vlmb.simulate(made, duration=0.4, t_eval=times, engine=engine, rtol=1e-13, atol=1e-14)
    assert trajectory.status == "finished", trajectory.message
    taken = simpson(power_taken(trajectory, ["link1", "link2"], 0.8), x=times)
    assert taken == pytest.approx(trajectory["dissipated"][-1], rel=1e-5)
    turning = angular_momentum(trajectory)
    np.testing.assert_allclose(turning, turning[0] + 0.0 * turning, rtol=0, atol=1e-12)
    assert np.linalg.norm(turning[0]) > 0.1


@pytest.mark.parametrize("engine", ENGINES)
def test_a_free_bent_pair_with_a_damper_keeps_its_angular_momentum(engine: str) -> None:
    made = scene(
        FLYING, [link("link1", **RIGID), link("link2", **RIGID)], gravity=0.0, start=BENT_PAIR,
        forces=[{"between": ["link1", "link2"], "damping": 0.8}],
    )  # fmt: skip
    trajectory = vlmb.simulate(made, duration=3.0, engine=engine, rtol=1e-12, atol=1e-13)
    assert trajectory.status == "finished", trajectory.message
    turning = angular_momentum(trajectory)
    np.testing.assert_allclose(turning, turning[0] + 0.0 * turning, rtol=0, atol=1e-12)
    assert np.linalg.norm(turning[0]) > 0.5 and trajectory["dissipated"][-1] > 0.5


def angular_momentum(trajectory: vlmb.Trajectory) -> np.ndarray:
    """About the centre of mass (N, 3) [kg m^2/s], mass by mass: thin rods, point masses in the tips and in the first hinge."""
    t = trajectory.t

    def rate(x: np.ndarray) -> np.ndarray:
        return np.column_stack([trajectory[f"{x}.{axis}_dot"] for axis in "xyz"])

    masses = [(1.5, trajectory.position("link1", "hinge"), rate("link1.hinge"))]
    about = np.zeros((len(t), 3))
    for name in ("link1", "link2"):
        start, end = trajectory.position(name, "rod_start"), trajectory.position(name, "rod_end")
        v_start, v_end = rate(f"{name}.rod_start"), rate(f"{name}.rod_end")
        masses.append((3.0, 0.5 * (start + end), 0.5 * (v_start + v_end)))
        masses.append((2.0, trajectory.position(name), rate(f"{name}.tip")))
        about += 3.0 / 12.0 * np.cross(end - start, v_end - v_start)
    total = sum(m for m, _, _ in masses)
    centre, velocity = (sum(entry[0] * entry[k] for entry in masses) / total for k in (1, 2))
    return np.asarray(about + sum(m * np.cross(x - centre, v - velocity) for m, x, v in masses))


# The line-up ---------------------------------------------------------------------------------------------------------


def test_a_start_in_line() -> None:
    springs = [{"between": ["link1", "link2"], "stiffness": 3.0, "rest": 0.2}]
    straight = {"psi1": 0.3, "psi2": 0.3}
    with pytest.raises(vlmb.SingularError, match=r"forces\[0\].*line up"):
        check(scene(PIVOT, 2, forces=springs, start=straight))
    check(scene(PIVOT, 2, forces=[{**springs[0], "rest": 0.0}], start=straight))
    opposite = {"psi1": 0.3, "psi2": -0.3, "phi2": math.pi}
    check(scene(PIVOT, 2, forces=[{**springs[0], "rest": math.pi}], start=opposite))
    check(scene(PIVOT, 2, plane=True, forces=springs, start=straight))


@pytest.mark.parametrize("engine", ENGINES)
def test_a_spring_at_rest_in_line_passes_its_line_up(engine: str) -> None:
    """A straight spring joint, rest = 0, passes its straight posture with its energy."""
    made = scene(
        PIVOT, 2, forces=[{"between": ["link1", "link2"], "stiffness": 60.0}],
        start={"psi1": -1.3, "psi2": -1.1, "psi2_dot": -4.0},
    )  # fmt: skip
    trajectory = vlmb.simulate(made, duration=2.0, engine=engine)
    assert trajectory.status == "finished", trajectory.message
    bend = trajectory["psi2"] - trajectory["psi1"]
    assert bend.min() < -0.05
    assert bend.max() > 0.05
    np.testing.assert_allclose(trajectory["energy"], trajectory["energy"][0], rtol=0, atol=1e-8 * trajectory["kinetic"].max())


FLIPPING = {"psi1": -0.5, "psi2": 0.4, "psi2_dot": -6.0}
BENT_SPRING = {"between": ["link1", "link2"], "stiffness": 4.0, "rest": 0.8}


def pendulum(spring: dict[str, Any], rtol: float, engine: str, plane: bool = False) -> vlmb.Trajectory:
    made = scene(PIVOT, [link("link1", **RIGID), link("link2", **RIGID)], plane=plane, start=FLIPPING, forces=[spring])
    return vlmb.simulate(made, duration=1.0, rtol=rtol, atol=0.1 * rtol, engine=engine)


@pytest.mark.parametrize("engine", ENGINES)
def test_in_a_plane_the_signed_angle_passes_the_line_up_at_every_tolerance(engine: str) -> None:
    runs = [pendulum(BENT_SPRING, rtol, engine, plane=True) for rtol in TOLERANCES]
    for rtol, trajectory in zip(TOLERANCES, runs, strict=True):
        assert trajectory.status == "finished", trajectory.message
        bend = trajectory["psi2"] - trajectory["psi1"]
        assert bend.max() > 0.5 and bend.min() < -0.5
        spring = 2.0 * (bend - 0.8) ** 2
        np.testing.assert_allclose(trajectory["spring"], spring, rtol=0, atol=1e-10)
        gap = np.abs(trajectory.position("link2") - runs[-1].position("link2")).max()
        assert gap < 1e4 * rtol
        assert np.abs(trajectory["balance"]).max() < 1e4 * rtol


SPRINGS = {
    "bent spring": BENT_SPRING,
    "damper": {"between": ["link1", "link2"], "damping": 0.3},
    "bent spring on the heading": {"between": ["heading", "link2"], "stiffness": 4.0, "rest": 0.8},
}


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", SPRINGS)
def test_in_space_the_line_up_is_located_at_every_tolerance(engine: str, name: str) -> None:
    runs = [pendulum(SPRINGS[name], rtol, engine) for rtol in TOLERANCES]
    for rtol, trajectory in zip(TOLERANCES, runs, strict=True):
        assert trajectory.status == "stopped", trajectory.message
        assert "forces[0]" in trajectory.message and "line up" in trajectory.message
        assert trajectory.t[-1] == pytest.approx(runs[-1].t[-1], abs=max(1e3 * rtol, 1e-6))
        assert angle_between(trajectory, SPRINGS[name]["between"])[-1] < 1e-6


@pytest.mark.parametrize("engine", ENGINES)
def test_folding_onto_each_other_is_a_line_up_of_a_spring_at_rest_in_line(engine: str) -> None:
    """With rest = 0 the spring has no axis where one link lies on the other."""
    made = scene(
        PIVOT, [link("link1", **RIGID), link("link2", **RIGID)], gravity=0.0, start={"psi1": 0.2, "psi2": 2.8, "psi2_dot": 3.0},
        forces=[{"between": ["link1", "link2"], "stiffness": 1.0}],
    )  # fmt: skip
    trajectory = vlmb.simulate(made, duration=3.0, engine=engine)
    assert trajectory.status == "stopped", trajectory.message
    assert "line up" in trajectory.message
    assert angle_between(trajectory, ["link1", "link2"])[-1] == pytest.approx(math.pi, abs=1e-6)
