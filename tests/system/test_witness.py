"""The witness against exact solutions, invariants, symbolic Lagrange equations and the paper's printed rows."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import sympy as sp

from tests.reference import exact
from tests.reference.symbolic import derived
from tests.reference.witness import Result, Witness

G = 9.81
STATES = 20


def generator(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def one_link(**changes: Any) -> dict[str, Any]:
    link: dict[str, Any] = {"name": "arm", "rod": {"length": 0.8, "mass": 2.0}}
    return {"base": {"kind": "pivot"}, "links": [{**link, **changes}]}


def skier(**changes: Any) -> dict[str, Any]:
    legs = {
        "name": "legs",
        "rod": {"length": 0.5, "mass": 30.0},
        "lower": {"length": 0.25, "stiffness": 4e4, "damping": 0.0, "rest": 0.26},
        "upper": {"length": 0.2, "stiffness": 3e4},
        "tip_mass": 40.0,
    }
    return {"base": {"kind": "ski", "mass": 5.0, "inertia": 0.6}, "links": [legs], **changes}


def tree(kind: str = "pivot", **changes: Any) -> dict[str, Any]:
    """Three links, a branch, both kinds of rod, springs and tip masses on every kind of segment."""
    base = {"pivot": {"kind": "pivot"}, "free": {"kind": "free"}}.get(
        kind, {"kind": "ski", "mass": 5.0, "inertia": 0.6, "com_offset": 0.12}
    )
    links: list[dict[str, Any]] = [
        {
            "name": "legs",
            "rod": {"length": 0.5, "mass": 3.0},
            "lower": {"length": 0.3, "stiffness": 900.0, "rest": 0.32},
            "upper": {"length": 0.2, "stiffness": 700.0},
            "tip_mass": 1.0,
        },
        {
            "name": "trunk",
            "rod": {"length": 0.6, "mass": 4.0, "com": 0.35, "inertia": 0.2},
            "lower": {"length": 0.1, "motion": "fixed"},
            "upper": {"length": 0.2, "stiffness": 500.0},
            "tip_mass": 0.7,
        },
        {
            "name": "pole",
            "parent": "legs",
            "parent_point": "rod_end",
            "rod": {"length": 0.4, "mass": 1.5},
            "lower": {"length": 0.2, "stiffness": 400.0},
            "upper": {"length": 0.3},
        },
    ]
    if kind == "free":  # a massless first hinge and a free segment beside it would be one motion too many
        links[0]["lower"] = {"length": 0.3, "motion": "fixed"}
    return {"base": base, "links": links, **changes}


def random_state(witness: Witness, seed: int, spread: float = 1.0) -> tuple[dict[str, float], dict[str, float]]:
    """Coordinates away from the poles and rates that obey the knife edge, if there is one."""
    rng = generator(seed)
    q, v = {}, {}
    for name in witness.names:
        low, high = (0.1, 0.6) if name.startswith("xi") else (-1.2, 1.2)
        q[name] = float(rng.uniform(low, high))
        v[name + "_dot"] = spread * float(rng.normal())
    if witness.kind == "ski":
        v["y_dot"] = v["x_dot"] * math.tan(q["phi0"])
    return q, v


def drift(values: np.ndarray) -> float:
    return float(np.abs(values - values[0]).max())


def gauss_panels(end: float, panels: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of ten-point Gauss-Legendre quadrature on each of the panels of [0, end]."""
    node, weight = np.polynomial.legendre.leggauss(10)
    half = end / panels / 2.0
    middle = (2.0 * np.arange(panels) + 1.0) * half
    return (middle[:, None] + half * node).ravel(), np.tile(half * weight, panels)


# ------------------------------------------------------------------------------------------------------ exact solutions


def test_conical_spring_pendulum() -> None:
    steady = exact.conical_spring_pendulum(1.3, 80.0, 0.7, 0.5)
    link = {"lower": {"length": 0.7, "stiffness": 80.0}, "tip_mass": 1.3}
    witness = Witness({"base": {"kind": "pivot"}, "links": [link]})
    start = {"phi1": 0.2, "psi1": steady["psi1"], "xi1_1": steady["length"]}
    run = witness.simulate(np.linspace(0.0, 5.0, 26), start, {"phi1_dot": steady["phi1_dot"]})
    assert np.allclose(run.coordinates["xi1_1"], steady["length"], atol=1e-11, rtol=0)
    assert np.allclose(run.coordinates["psi1"], steady["psi1"], atol=1e-11, rtol=0)
    assert np.allclose(run.coordinates["phi1"], 0.2 + steady["phi1_dot"] * run.t, atol=1e-10, rtol=0)


def test_conical_rod_pendulum() -> None:
    steady = exact.conical_rod_pendulum(300.0, 0.4, 0.7, 2.0, 0.8, tip_mass=0.5)
    witness = Witness(one_link(lower={"length": 0.4, "stiffness": 300.0}, tip_mass=0.5))
    start = {"psi1": steady["psi1"], "xi1_1": steady["xi1_1"]}
    run = witness.simulate(np.linspace(0.0, 5.0, 26), start, {"phi1_dot": steady["phi1_dot"]})
    assert np.allclose(run.coordinates["xi1_1"], steady["xi1_1"], atol=1e-11, rtol=0)
    assert np.allclose(run.coordinates["phi1"], steady["phi1_dot"] * run.t, atol=1e-10, rtol=0)
    massless = exact.conical_rod_pendulum(80.0, 0.7, 0.5, 0.0, 0.0, tip_mass=1.3)
    point = exact.conical_spring_pendulum(1.3, 80.0, 0.7, 0.5)
    assert massless == pytest.approx({key: point[key] for key in massless}, abs=1e-13)


@pytest.mark.parametrize(("rod_mass", "rod_length", "tip_mass"), [(0.0, 0.0, 1.7), (2.0, 0.8, 0.5)])
def test_programmed_length(rod_mass: float, rod_length: float, tip_mass: float) -> None:
    def law(t: float) -> tuple[float, float, float]:
        return 0.5 + 0.2 * math.sin(3 * t), 0.6 * math.cos(3 * t), -1.8 * math.sin(3 * t)

    scene = one_link(rod={"length": rod_length, "mass": rod_mass}, lower={"motion": "prescribed"}, tip_mass=tip_mass)
    witness = Witness({**scene, "gravity": 0.0}, {"xi1_1": law})
    t, weight = gauss_panels(4.0, 20)
    t = np.concatenate([[0.0], t, [4.0]])
    run = witness.simulate(t, {"phi1": 0.4, "psi1": 0.0}, {"phi1_dot": 2.5})
    known = exact.programmed_length(t, law, 2.5, 0.4, tip_mass, rod_mass, rod_length)
    assert np.allclose(run.coordinates["phi1"], known["phi1"], atol=1e-11, rtol=0)
    assert np.allclose(run.rates["phi1"], known["phi1_dot"], atol=1e-11, rtol=0)
    assert np.allclose(run.prescribed_force["xi1_1"], known["force"], atol=1e-10, rtol=0)
    assert np.allclose(run.kinetic, known["kinetic"], atol=1e-10, rtol=0)
    work = (run.prescribed_force["xi1_1"] * run.rates["xi1_1"])[1:-1] @ weight
    assert work == pytest.approx(known["work"][-1], abs=1e-10)


@pytest.mark.parametrize(("heading", "speed", "yaw_rate"), [(0.0, 0.0, 0.9), (0.7, 3.0, -1.4)])
def test_skate_on_a_slope(heading: float, speed: float, yaw_rate: float) -> None:
    witness = Witness({"base": {"kind": "ski", "mass": 70.0, "inertia": 1.5}, "slope": 0.3})
    t = np.linspace(0.0, 8.0, 41)
    run = witness.simulate(t, {"phi0": heading}, {"speed": speed, "phi0_dot": yaw_rate})
    known = exact.skate(t, 70.0, 0.3, yaw_rate, heading, speed)
    for name in ("x", "y", "phi0"):
        assert np.allclose(run.coordinates[name], known[name], atol=1e-11, rtol=0), name
        assert np.allclose(run.rates[name], known[name + "_dot"], atol=1e-11, rtol=0), name
    assert np.allclose(run.edge_force, known["knife_edge"], atol=1e-9, rtol=0)
    if speed == 0.0:
        size = G * math.sin(0.3)
        assert np.allclose(known["x"], size * np.sin(yaw_rate * t) ** 2 / (2 * yaw_rate**2), atol=1e-12)
        assert np.allclose(known["knife_edge"], 2 * 70.0 * size * np.sin(yaw_rate * t), atol=1e-10)


def test_sleigh_with_centre_of_mass_ahead() -> None:
    witness = Witness({"base": {"kind": "ski", "mass": 5.0, "inertia": 0.6, "com_offset": 0.3}})
    t = np.linspace(0.0, 5.0, 26)
    run = witness.simulate(t, {}, {"speed": -1.0, "phi0_dot": 1.2})
    known = exact.sleigh(t, 5.0, 0.6, 0.3, -1.0, 1.2)
    for name in ("x", "y", "phi0"):
        assert np.allclose(run.coordinates[name], known[name], atol=1e-11, rtol=0), name
    assert np.allclose(run.rates["speed"], known["speed"], atol=1e-11, rtol=0)
    assert np.allclose(run.edge_force, known["knife_edge"], atol=1e-10, rtol=0)


@pytest.mark.parametrize("start", [{"amplitude": 0.4}, {"amplitude": 3.0}, {"bottom_rate": 3.0}, {"bottom_rate": -9.5}])
def test_pendulum(start: dict[str, float]) -> None:
    """Small, nearly inverted, from the bottom and over the top, where psi runs on through both poles."""
    first, inertia = exact.rod_moments(0.8, 2.0, 0.1, 0.5)
    witness = Witness(one_link(lower={"length": 0.1, "motion": "fixed"}, tip_mass=0.5))
    t = np.linspace(0.0, 5.0, 51)
    known = exact.pendulum(t, first, inertia, **start)
    run = witness.simulate(
        t, {"phi1": 0.7, "psi1": known["psi1"][0]}, {"psi1_dot": known["psi1_dot"][0]}, None, 1e-13, 1e-14
    )
    assert np.allclose(run.coordinates["psi1"], known["psi1"], atol=2e-11, rtol=0)
    assert np.allclose(run.rates["psi1"], known["psi1_dot"], atol=1e-10, rtol=0)
    theta = known["theta"]
    tip = np.stack([np.sin(theta) * math.cos(0.7), np.sin(theta) * math.sin(0.7), -np.cos(theta)], axis=1)
    assert np.allclose(run.position("arm"), 0.9 * tip, atol=2e-11, rtol=0)
    away = np.abs(np.sin(theta)) > 0.01
    assert np.allclose(run.coordinates["phi1"][away], 0.7, atol=1e-11, rtol=0)


def test_pendulum_on_its_separatrix_is_the_limit() -> None:
    t = np.linspace(0.0, 1.5, 7)
    w = math.sqrt(G * 1.0 / 2.0)
    middle = exact.pendulum(t, 1.0, 2.0, bottom_rate=2 * w)
    for factor in (1 - 1e-7, 1 + 1e-7):
        near = exact.pendulum(t, 1.0, 2.0, bottom_rate=2 * w * factor)
        assert np.allclose(near["theta"], middle["theta"], atol=1e-4)
        assert np.allclose(near["theta_dot"], middle["theta_dot"], atol=1e-4)


@pytest.mark.parametrize("up", [True, False])
@pytest.mark.parametrize("damping", [0.0, 8.0])
def test_vertical_oscillator(up: bool, damping: float) -> None:
    lower = {"length": 0.4, "stiffness": 600.0, "damping": damping, "rest": 0.5}
    witness = Witness(one_link(lower=lower, upper={"length": 0.1, "motion": "fixed"}, tip_mass=1.0))
    t = np.linspace(0.0, 2.0, 21)
    run = witness.simulate(t, {"psi1": math.pi / 2 if up else -math.pi / 2}, {"xi1_1_dot": 0.7})
    known = exact.vertical_oscillator(t, 3.0, 600.0, 0.5, 0.4, 0.7, damping, up)
    assert np.allclose(run.coordinates["xi1_1"], known["xi1_1"], atol=1e-12, rtol=0)
    assert np.allclose(run.rates["xi1_1"], known["xi1_1_dot"], atol=1e-10, rtol=0)


def test_free_link() -> None:
    scene = one_link(lower={"length": 0.1, "motion": "fixed"}, tip_mass=0.5)
    witness = Witness({**scene, "base": {"kind": "free"}, "slope": 0.2})
    t = np.linspace(0.0, 3.0, 16)
    q = {"x": 0.1, "y": -0.3, "z": 2.0, "phi1": 0.5, "psi1": 1.0}
    v = {"x_dot": 1.0, "y_dot": 0.5, "z_dot": 3.0, "phi1_dot": 2.0, "psi1_dot": -4.0}
    run = witness.simulate(t, q, v, rtol=1e-13, atol=1e-14)
    distance = exact.rod_moments(0.8, 2.0, 0.1, 0.5)[0] / 2.5
    known = exact.free_link(t, 0.5, 1.0, 2.0, -4.0, distance, (0.1, -0.3, 2.0), (1.0, 0.5, 3.0), slope=0.2)
    assert np.allclose(run.direction("arm"), known["direction"], atol=1e-11, rtol=0)
    assert np.allclose(run.position("arm", "hinge"), known["hinge"], atol=1e-10, rtol=0)
    assert np.allclose(run.center_of_mass, known["center_of_mass"], atol=1e-10, rtol=0)


# ----------------------------------------------------------------------------------------------------------- invariants


def test_free_flight_of_a_tree() -> None:
    witness = Witness(tree("free", slope=0.25))
    q, v = random_state(witness, 1)
    run = witness.simulate(np.linspace(0.0, 3.0, 16), q, v)
    com, speed = run.center_of_mass, run.momentum / 10.2
    path = exact.parabola(run.t, com[0], speed[0], slope=0.25)
    assert np.allclose(com, path, atol=1e-9, rtol=0)
    spin = run.angular_momentum - 10.2 * np.cross(com, speed)
    assert drift(spin) < 1e-9
    assert drift(run.energy) < 1e-8


def test_pivoted_tree_keeps_energy_and_vertical_angular_momentum() -> None:
    witness = Witness(tree())
    q, v = random_state(witness, 2)
    run = witness.simulate(np.linspace(0.0, 4.0, 21), q, v)
    assert drift(run.energy) < 1e-9
    assert drift(run.angular_momentum[:, 2]) < 1e-10
    assert np.ptp(run.coordinates["psi1"]) > 1.0


def test_skier_keeps_energy_and_knife_edge() -> None:
    witness = Witness(tree("ski", slope=0.2))
    q, v = random_state(witness, 3)
    run = witness.simulate(np.linspace(0.0, 3.0, 31), q, v)
    assert drift(run.energy) < 1e-8
    phi = run.coordinates["phi0"]
    sideways = run.rates["y"] * np.cos(phi) - run.rates["x"] * np.sin(phi)
    assert np.abs(sideways).max() < 1e-13
    assert np.abs(np.linalg.norm(run.states[:, 3:6], axis=1) - 1.0).max() < 1e-12


def test_momentum_follows_the_edge_force() -> None:
    """Sideways momentum changes by edge force and gravity alone; along the ski nothing else acts either."""
    witness = Witness(tree("ski", slope=0.2))
    q, v = random_state(witness, 4)
    t, weight = gauss_panels(1.0, 20)
    run = witness.simulate(np.concatenate([[0.0], t, [1.0]]), q, v)
    phi, force = run.coordinates["phi0"], run.edge_force
    total = np.stack([15.2 * G * math.sin(0.2) - force * np.sin(phi), force * np.cos(phi)], axis=1)[1:-1]
    assert np.allclose(run.momentum[-1, :2] - run.momentum[0, :2], weight @ total, atol=1e-8, rtol=0)


def test_directions_are_equal() -> None:
    """Without gravity a rotated start gives the rotated motion, started on the pole or not."""
    witness = Witness(tree(gravity=0.0))
    rng = generator(5)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    # first link on the vertical after the turn
    d = [turn.T @ np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.0, 0.8]), np.array([0.0, -0.28, 0.96])]
    rates = [np.cross(rng.normal(size=3), a) for a in d]

    def start(rotation: np.ndarray) -> tuple[dict[str, float], dict[str, float]]:
        q: dict[str, float] = {}
        v: dict[str, float] = {"xi1_1_dot": 0.3, "xi3_1_dot": -0.2}
        for i, (unit, rate) in enumerate(zip(d, rates, strict=True), 1):
            (x, y, z), speed = rotation @ unit, rotation @ rate
            if math.hypot(x, y) < 1e-9:  # at the pole any azimuth serves: take the one in which the link moves
                phi, psi = math.atan2(speed[1], speed[0]), math.pi / 2
                q[f"phi{i}"], q[f"psi{i}"] = phi, psi
                v[f"psi{i}_dot"] = -math.hypot(speed[0], speed[1])
                continue
            phi, psi = math.atan2(y, x), math.asin(z)
            q[f"phi{i}"], q[f"psi{i}"] = phi, psi
            v[f"phi{i}_dot"] = (speed[1] * math.cos(phi) - speed[0] * math.sin(phi)) / math.cos(psi)
            v[f"psi{i}_dot"] = speed[2] / math.cos(psi)
        return q, v

    t = np.linspace(0.0, 2.0, 11)
    plain, turned = witness.simulate(t, *start(np.eye(3))), witness.simulate(t, *start(turn))
    for link in ("legs", "trunk", "pole"):
        assert np.allclose(plain.position(link) @ turn.T, turned.position(link), atol=1e-10, rtol=0)


def test_order_of_links_and_kind_of_rod_do_not_matter() -> None:
    scene = tree()
    q, v = random_state(Witness(scene), 6)
    t = np.linspace(0.0, 2.0, 11)
    reference = Witness(scene).simulate(t, q, v)

    other = [{**link, "rod": dict(link["rod"])} for link in scene["links"]]
    other[0]["parent"], other[1]["parent"] = "base", "legs"
    rod = other[2]["rod"]
    rod["com"], rod["inertia"] = rod["length"] / 2, rod["mass"] * rod["length"] ** 2 / 12
    other[0]["rod"]["com"] = 0.25  # half its length: inertia left to its default
    other = other[::-1]  # pole, trunk, legs: numbers 1, 2, 3
    swap = {"1": "3", "2": "2", "3": "1"}

    def renamed(values: dict[str, float]) -> dict[str, float]:
        return {re.sub(r"^(phi|psi|xi)(\d)", lambda m: m[1] + swap[m[2]], key): value for key, value in values.items()}

    run = Witness({**scene, "links": other}).simulate(t, renamed(q), renamed(v))
    for link in ("legs", "trunk", "pole"):
        for point in ("hinge", "rod_start", "rod_end", "tip"):
            assert np.allclose(reference.position(link, point), run.position(link, point), atol=1e-10, rtol=0)


def test_tolerances_agree() -> None:
    links = [*skier()["links"], {"name": "trunk", "rod": {"length": 0.6, "mass": 20.0}, "tip_mass": 5.0}]
    witness = Witness({**skier(), "links": links})
    q = {"phi0": 0.3, "phi1": 0.2, "psi1": 1.2, "phi2": 0.9, "psi2": 1.3}
    runs = [witness.simulate([1.0, 2.0], q, {"speed": 3.0, "phi0_dot": 0.5}, None, r, r / 10) for r in (1e-11, 1e-13)]
    assert np.allclose(runs[0].position("trunk"), runs[1].position("trunk"), atol=1e-9, rtol=0)


# -------------------------------------------------------------------------------------------- forces, servos, reactions


def test_power_balance_under_random_forces() -> None:
    """Energy changes by the work of generalized forces, dampers, servo and hinge torques."""
    scene = tree("ski", slope=0.1)
    scene["links"][0]["lower"]["damping"] = 20.0
    scene["links"][1]["upper"] = {"motion": "prescribed"}
    scene["links"][2]["parent_point"] = "rod_start"
    witness = Witness(
        scene, {"xi2_2": lambda t: (0.2 + 0.05 * math.sin(6 * t), 0.3 * math.cos(6 * t), -1.8 * math.sin(6 * t))}
    )
    names = [name for name in witness.names if name != "xi2_2"]
    rng = generator(7)
    size, rate, phase = rng.uniform(1.0, 4.0, (3, len(names)))
    torque = rng.normal(size=3)

    def loads(t: float) -> dict[str, float]:
        return {name: float(size[i] * math.sin(rate[i] * t + phase[i])) for i, name in enumerate(names)}

    def force(t: float, q: Any, v: Any) -> dict[str, Any]:
        return {**loads(t), "T_trunk": torque * math.cos(3 * t), "T_legs": torque[::-1] * math.sin(2 * t)}

    q, v = random_state(witness, 8)
    q["xi2_2"], v["xi2_2_dot"] = 0.2, 0.3
    t, weight = gauss_panels(1.5, 40)
    run = witness.simulate(np.concatenate([[0.0], t, [1.5]]), q, v, force)
    table = [loads(time) for time in run.t]
    power = sum(np.array([row[name] for row in table]) * run.rates[name] for name in names)
    power = power + run.damping_power + run.prescribed_force["xi2_2"] * run.rates["xi2_2"]
    turning = {link: np.cross(run.direction(link), run._d_rate[:, k]) for link, k in (("trunk", 2), ("legs", 1))}
    power = power + (turning["trunk"] - turning["legs"]) @ torque * np.cos(3 * run.t)
    turning["legs"][:, 2] -= run.rates["phi0"]  # from here on relative to the ski
    power = power + turning["legs"] @ torque[::-1] * np.sin(2 * run.t)
    assert run.energy[-1] - run.energy[0] == pytest.approx(weight @ power[1:-1], abs=1e-8)
    assert abs(run.energy[-1] - run.energy[0]) > 1.0


def unbalanced(witness: Witness, seed: int, force: dict[str, float], t: float = 0.0, **fix: float) -> float:
    """Largest residual of M qddot + bias = forces + springs + reactions in the paper's coordinates."""
    q, v = random_state(witness, seed)
    for name, value in fix.items():
        (v if name.endswith("_dot") else q)[name] = value
    instant = witness.instant(q, v, force, t)
    mass, bias = witness.equations(q, v)
    known = dict.fromkeys(witness.names, 0.0)
    for name, value in [*force.items(), *instant.prescribed_force.items()]:
        known[name] += value
    for segment in witness._segments:
        name = segment.name
        known[name] -= segment.stiffness * (q[name] - segment.rest) + segment.damping * v[name + "_dot"]
    if witness.kind == "ski":
        known["x"] -= instant.edge_force * math.sin(q["phi0"])
        known["y"] += instant.edge_force * math.cos(q["phi0"])
    for text, value in instant.constraint_force.items():
        for side, sign in zip(text.split("="), (1.0, -1.0), strict=True):
            for name in re.findall(r"(?:phi|psi|xi)[\w]+", side):
                known[name] += sign * value
    accelerations = np.array([instant.accelerations[name] for name in witness.names])
    scale = np.abs(mass @ accelerations).max()
    return float(np.abs(mass @ accelerations + bias - np.array(list(known.values()))).max() / scale)


@pytest.mark.parametrize("kind", ["pivot", "free", "ski"])
def test_accelerations_obey_the_equations_of_the_coordinates(kind: str) -> None:
    scene = tree(kind, slope=0.3)
    witness = Witness(scene)
    rng = generator(9)
    for seed in range(STATES):
        force = {name: float(rng.normal(scale=5.0)) for name in witness.names}
        assert unbalanced(witness, seed, force) < 1e-10


def test_reactions_and_servo_force_close_the_equations() -> None:
    scene = tree("ski", slope=0.3, constraints=["phi1 = phi0", "psi2 = psi3", "phi0 = phi3"])
    scene["links"][0]["lower"]["motion"] = "prescribed"
    scene["links"][1]["lower"] = {"length": 0.2, "damping": 3.0, "stiffness": 50.0}
    witness = Witness(scene, {"xi1_1": lambda t: (0.3 + 0.1 * t**2, 0.2 * t, 0.2)})
    rng = generator(10)
    for seed in range(STATES):
        q, v = random_state(witness, seed)
        same = {"phi1": q["phi0"], "phi1_dot": v["phi0_dot"], "phi3": q["phi0"], "phi3_dot": v["phi0_dot"]}
        same |= {"psi3": q["psi2"], "psi3_dot": v["psi2_dot"], "xi1_1": 0.4, "xi1_1_dot": 0.2}
        force = {name: float(rng.normal(scale=5.0)) for name in witness.names if name != "xi1_1"}
        assert unbalanced(witness, seed, force, 1.0, **same) < 1e-10
        assert len(witness.instant(q | same, {**v, **same_rates(same)}, force, 1.0).constraint_force) == 3


def same_rates(values: dict[str, float]) -> dict[str, float]:
    return {key: value for key, value in values.items() if key.endswith("_dot")}


def test_constraint_in_its_own_form_and_with_a_multiplier() -> None:
    """phi1 = phi0 by one angle in the turning plane, and by a row between coordinates: the same motion and moment."""
    exact_form = Witness(skier(constraints=["phi1 = phi0"]))
    row_form = Witness(skier(constraints=["phi1 - phi0 = 0"]))
    q = {"phi0": 0.3, "phi1": 0.3, "psi1": 1.0}
    v = {"speed": 4.0, "phi0_dot": 0.8, "phi1_dot": 0.8}
    t = np.linspace(0.0, 0.5, 6)
    one, two = exact_form.simulate(t, q, v), row_form.simulate(t, q, v)
    assert np.allclose(one.position("legs"), two.position("legs"), atol=1e-10, rtol=0)
    assert np.allclose(
        one.constraint_force["phi1 = phi0"], two.constraint_force["phi1 - phi0 = 0"], atol=1e-6, rtol=1e-9
    )
    assert np.allclose(one.edge_force, two.edge_force, atol=1e-6, rtol=1e-9)
    assert drift(one.energy) < 1e-8
    assert np.abs(two.coordinates["phi1"] - two.coordinates["phi0"]).max() < 1e-11


def test_rider_leans_back_past_the_vertical() -> None:
    witness = Witness(skier(plane=True))
    start = {"phi0": 0.3, "phi1": 0.3, "psi1": 1.3}
    run = witness.simulate(
        np.linspace(0.0, 1.0, 21), start, {"speed": 4.0, "phi0_dot": 0.8, "phi1_dot": 0.8, "psi1_dot": 2.0}
    )
    assert run.coordinates["psi1"].max() > math.pi / 2 + 0.3
    assert np.abs(run.coordinates["phi1"] - run.coordinates["phi0"]).max() == 0.0
    assert drift(run.energy) < 1e-8
    across = np.stack([-np.sin(run.coordinates["phi0"]), np.cos(run.coordinates["phi0"])], axis=1)
    assert np.abs((run.direction("legs")[:, :2] * across).sum(axis=1)).max() < 1e-14


def test_fixed_plane_and_point_constraints() -> None:
    """A fixed vertical plane equals a symmetric free motion; a tip kept at a height stays there."""
    plane = Witness(tree(constraints=["phi1 = 0.4", "phi2 = 0.4", "0.4 = phi3"]))
    q = {"phi1": 0.4, "psi1": -0.5, "phi2": 0.4, "psi2": 0.3, "phi3": 0.4, "psi3": -1.0}
    t = np.linspace(0.0, 1.0, 6)
    held, loose = plane.simulate(t, q), Witness(tree()).simulate(t, q)
    assert np.allclose(held.position("trunk"), loose.position("trunk"), atol=1e-11, rtol=0)
    assert max(np.abs(value).max() for value in held.constraint_force.values()) < 1e-10

    height = 0.5 * math.sin(0.8) + 0.3 * math.sin(0.8)
    scene = one_link(rod={"length": 0.5, "mass": 2.0}, lower={"length": 0.3, "stiffness": 50.0}, tip_mass=1.0)
    table = Witness({**scene, "constraints": [f"arm.tip.z = {height!r}"]})
    run = table.simulate(np.linspace(0.0, 2.0, 11), {"psi1": 0.8}, {"phi1_dot": 1.0})
    assert np.abs(run.position("arm")[:, 2] - height).max() < 1e-11
    assert drift(run.energy) < 1e-9
    assert np.ptp(run.coordinates["xi1_1"]) > 0.01


def test_servo_force_moves_a_free_segment_as_prescribed() -> None:
    def law(t: float) -> tuple[float, float, float]:
        return 0.3 + 0.1 * math.sin(4 * t), 0.4 * math.cos(4 * t), -1.6 * math.sin(4 * t)

    scene = tree("ski")
    scene["links"][0]["lower"]["motion"] = "prescribed"
    run = Witness(scene, {"xi1_1": law}).simulate(np.linspace(0.0, 1.0, 6), {"psi1": 1.2, "psi2": 0.9, "phi3": 1.0})
    free = Witness(tree("ski"))
    for i, t in enumerate(run.t):
        q = {name: run.coordinates[name][i] for name in free.names}
        v = {name: run.rates[name][i] for name in free.names}
        accelerations = free.accelerations(q, v, {"F1_1": run.prescribed_force["xi1_1"][i]})
        assert accelerations["xi1_1"] == pytest.approx(law(t)[2], abs=1e-9)
        for name in free.names:
            assert accelerations[name] == pytest.approx(run.accelerations[name][i], rel=1e-9, abs=1e-9)


def test_spring_between_directions() -> None:
    """V = k (1 - d1 . d2) by forces conjugate to the directions, regular at the poles."""
    witness = Witness(tree())

    def unit_vector(q: dict[str, float], i: int) -> np.ndarray:
        phi, psi = q[f"phi{i}"], q[f"psi{i}"]
        return np.array([math.cos(phi) * math.cos(psi), math.sin(phi) * math.cos(psi), math.sin(psi)])

    def force(t: float, q: dict[str, float], v: dict[str, float]) -> dict[str, Any]:
        return {"direction_legs": 30.0 * unit_vector(q, 2), "direction_trunk": 30.0 * unit_vector(q, 1)}

    run = witness.simulate(np.linspace(0.0, 1.0, 11), {"phi2": 0.3, "psi2": 0.2, "psi3": 1.0}, {}, force)
    bend = 30.0 * (1.0 - (run.direction("legs") * run.direction("trunk")).sum(axis=1))
    assert drift(run.energy + bend) < 1e-9
    assert drift(bend) > 1.0


def test_law_with_a_kink_in_its_rate_of_change() -> None:
    """Acceleration jumps at t = 0.5: a step ends there."""

    def law(t: float) -> tuple[float, float, float]:
        s = min(t, 0.5)
        return (0.5 + 0.4 * s**2, 0.8 * s, 0.8) if t < 0.5 else (0.6 + 0.4 * (t - 0.5), 0.4, 0.0)

    witness = Witness({**one_link(lower={"motion": "prescribed"}), "gravity": 0.0}, {"xi1_1": law})
    t = np.array([0.0, 0.5, 1.0])
    run = witness.simulate(t, {"psi1": 0.0}, {"phi1_dot": 2.0}, breaks=[0.5])
    known = exact.programmed_length(t, law, 2.0, tip_mass=0.0, rod_mass=2.0, rod_length=0.8)
    assert np.allclose(run.coordinates["phi1"], known["phi1"], atol=1e-11, rtol=0)


def test_rates_are_derivatives_and_forces_see_them() -> None:
    seen: list[tuple[dict[str, float], dict[str, float]]] = []

    def force(t: float, q: dict[str, float], v: dict[str, float]) -> dict[str, float]:
        seen.append((dict(q), dict(v)))
        return {"M_psi1": -2.0 * v["psi1"], "M_phi1": -1.0 * v["phi1_dot"], "F1_1": -3.0 * (q["xi1_1"] - 0.3)}

    witness = Witness(tree())
    q, v = random_state(witness, 11)
    h = 1e-4
    run = witness.simulate([0.0, 0.5 - h, 0.5, 0.5 + h], q, v, force)
    for name in witness.names:
        slope = (run.coordinates[name][3] - run.coordinates[name][1]) / (2 * h)
        second = (run.rates[name][3] - run.rates[name][1]) / (2 * h)
        assert slope == pytest.approx(run.rates[name][2], abs=1e-4), name
        assert second == pytest.approx(run.accelerations[name][2], abs=1e-3), name
    assert seen[0][0] == pytest.approx({name: q[name] for name in witness.names}, abs=1e-12)
    step = (run.position("pole")[3] - run.position("pole")[1]) / (2 * h)
    assert np.allclose(step, run.velocity("pole")[2], atol=1e-5)


# -------------------------------------------------------------------------------------------- symbolic and printed rows


def lagrange(
    kinetic: Any, potential: Any, q: list[sp.Symbol], v: list[sp.Symbol]
) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Mass matrix and bias of d/dt dT/dv - dT/dq + dV/dq as functions of (*q, *v)."""
    both, size = derived(kinetic, potential, q, v), len(q)
    return (lambda *state: both(state[:size], state[size:])[0]), (lambda *state: both(state[:size], state[size:])[1])


def unit(phi: sp.Symbol, psi: sp.Symbol) -> sp.Matrix:
    return sp.Matrix([sp.cos(phi) * sp.cos(psi), sp.sin(phi) * sp.cos(psi), sp.sin(psi)])


def test_one_link_by_lagrange_and_by_the_paper() -> None:
    """(2.7)-(2.9): from (2.5), (2.6) symbolically, from the printed rows, and from the witness."""
    _, psi, xi, a, b, c, x = q_and_v = sp.symbols("phi psi xi a b c x")
    m, length = sp.Rational(2), sp.Rational(4, 5)
    square = c**2 + (x + xi) ** 2 * (b**2 + a**2 * sp.cos(psi) ** 2)  # (2.3)
    kinetic = sp.integrate(sp.expand(square), (x, 0, length)) * m / length / 2
    potential = sp.Float(G) * m * (length / 2 + xi) * sp.sin(psi)  # (2.6)
    mass, bias = lagrange(kinetic, potential, list(q_and_v[:3]), list(q_and_v[3:6]))
    witness = Witness(one_link(lower={"length": 0.3}))
    rng = generator(12)
    for seed in range(STATES):
        q, v = random_state(witness, seed)
        moments = rng.normal(scale=3.0, size=3)
        force = dict(zip(witness.names, moments.tolist(), strict=True))
        found = np.array(list(witness.accelerations(q, v, force).values()))
        state = [*q.values(), *v.values()]
        matrix, tail = mass(*state), np.array(bias(*state))
        assert np.allclose(found, np.linalg.solve(matrix, moments - tail), rtol=1e-11, atol=1e-11)
        ours = witness.equations(q, v)
        assert np.allclose(ours[0], matrix, atol=1e-14)
        assert np.allclose(ours[1], tail, atol=1e-13)

        (_, p, r), (dphi, dpsi, dxi), (ddphi, ddpsi, ddxi) = q.values(), v.values(), found
        zeta, arm, cos, sin = 2.0 * (0.8**2 / 3 + 0.8 * r + r**2), r + 0.4, math.cos(p), math.sin(p)
        rows = [
            zeta * cos**2 * ddphi + 4 * arm * cos**2 * dphi * dxi - 2 * zeta * cos * sin * dphi * dpsi,
            zeta * ddpsi + zeta * cos * sin * dphi**2 + 4 * arm * dpsi * dxi + G * 2 * arm * cos,
            2 * ddxi - 2 * arm * cos**2 * dphi**2 - 2 * arm * dpsi**2 + G * 2 * sin,
        ]
        assert np.allclose(rows, moments, rtol=1e-11, atol=1e-11)


@pytest.fixture(scope="module")
def symbolic_tree() -> tuple[Callable[..., Any], Callable[..., Any]]:
    """The tree on the ski from continuous rods: every term by integration along the rod."""
    witness = Witness(tree("ski"))
    q, v = sp.symbols(witness.names), sp.symbols([name + "_dot" for name in witness.names])
    of = dict(zip(witness.names, q, strict=True))
    kinetic, potential = sp.Float(0), sp.Float(0)
    ramp = sp.Float(0.3)
    pull = sp.Float(G) * sp.Matrix([sp.sin(ramp), 0, -sp.cos(ramp)])

    def rate(r: sp.Matrix) -> sp.Matrix:
        return r.jacobian(list(q)) * sp.Matrix(v)

    def point(mass: float, r: sp.Matrix) -> None:
        nonlocal kinetic, potential
        speed = rate(r)
        kinetic += sp.Float(mass) * speed.dot(speed) / 2
        potential -= sp.Float(mass) * pull.dot(r)

    def rod(mass: float, length: float, start: sp.Matrix, d: sp.Matrix) -> None:
        nonlocal kinetic, potential
        first, second = rate(start), rate(d)  # integral over s of |first + s second|^2 and of start + s d
        kinetic += (
            sp.Float(mass) / 2 * (first.dot(first) + length * first.dot(second) + length**2 * second.dot(second) / 3)
        )
        potential -= sp.Float(mass) * pull.dot(start + length / 2 * d)

    hinge = sp.Matrix([of["x"], of["y"], 0])
    heading = sp.Matrix([sp.cos(of["phi0"]), sp.sin(of["phi0"]), 0])
    d1, d2, d3 = (unit(of[f"phi{i}"], of[f"psi{i}"]) for i in (1, 2, 3))
    point(5.0, hinge + sp.Float(0.12) * heading)
    kinetic += sp.Float(0.6) * v[2] ** 2 / 2
    start = hinge + of["xi1_1"] * d1
    end = start + sp.Rational(1, 2) * d1
    tip = end + of["xi1_2"] * d1
    rod(3.0, sp.Rational(1, 2), start, d1)
    point(1.0, tip)
    point(4.0, tip + sp.Float(0.1 + 0.35) * d2)
    kinetic += sp.Float(0.2) * rate(d2).dot(rate(d2)) / 2
    point(0.7, tip + (sp.Float(0.1 + 0.6) + of["xi2_2"]) * d2)
    rod(1.5, sp.Rational(2, 5), end + of["xi3_1"] * d3, d3)
    return lagrange(kinetic, potential, list(q), list(v))


def test_tree_on_the_ski_by_lagrange(symbolic_tree: tuple[Callable[..., Any], Callable[..., Any]]) -> None:
    mass, bias = symbolic_tree
    witness = Witness(tree("ski", slope=0.3))
    for seed in range(STATES):
        q, v = random_state(witness, seed)
        state = [*q.values(), *v.values()]
        ours = witness.equations(q, v)
        assert np.allclose(ours[0], mass(*state), rtol=0, atol=1e-12)
        assert np.allclose(ours[1], bias(*state), rtol=0, atol=1e-11)


def test_skier_rows_of_the_paper() -> None:
    """(7.7)-(7.12) with generalized forces on the right, and the edge force of the form with a multiplier."""
    scene = skier()
    for segment in ("lower", "upper"):
        scene["links"][0][segment] = {"length": 0.25}
    witness = Witness(scene)
    assert witness.names == ("x", "y", "phi0", "phi1", "psi1", "xi1_1", "xi1_2")
    rng = generator(13)
    m1, mb, m0, length = 30.0, 40.0, 5.0, 0.5
    for seed in range(STATES):
        q, v = random_state(witness, seed)
        force = {name: float(rng.normal(scale=50.0)) for name in witness.names}
        instant = witness.instant(q, v, force)
        a = instant.accelerations
        tan, sec2 = math.tan(q["phi0"]), 1 / math.cos(q["phi0"]) ** 2
        cf, sf, cp, sp_ = math.cos(q["phi1"]), math.sin(q["phi1"]), math.cos(q["psi1"]), math.sin(q["psi1"])
        r1, r2 = q["xi1_1"], q["xi1_2"]
        dx, d0, df, dp, d1, d2 = (v[k + "_dot"] for k in ("x", "phi0", "phi1", "psi1", "xi1_1", "xi1_2"))
        zeta = m1 * length**2 / 3 + m1 * r1 * (length + r1) + mb * (length + r1 + r2) ** 2
        eta, vartheta = m1 * (r1 + length / 2), mb * (r1 + length + r2)
        first, theta, both = eta + vartheta, m0 + m1 + mb, m1 + mb
        plus, minus = sf * tan + cf, cf * tan - sf
        rows = [
            theta * sec2 * a["x"] + first * minus * cp * a["phi1"] - first * plus * sp_ * a["psi1"]
            + both * plus * cp * a["xi1_1"] + mb * plus * cp * a["xi1_2"] - first * plus * cp * (df**2 + dp**2)
            - 2 * first * minus * sp_ * df * dp + 2 * both * minus * cp * df * d1 + 2 * mb * minus * cp * df * d2
            - 2 * both * plus * sp_ * dp * d1 - 2 * mb * plus * sp_ * dp * d2 + theta * sec2 * tan * dx * d0,
            0.6 * a["phi0"],
            first * minus * cp * a["x"] + zeta * cp**2 * a["phi1"] + 2 * first * cp**2 * d1 * df
            + 2 * vartheta * cp**2 * d2 * df - 2 * zeta * cp * sp_ * df * dp + first * cp * cf * sec2 * dx * d0,
            -first * plus * sp_ * a["x"] + zeta * a["psi1"] + zeta * cp * sp_ * df**2 + 2 * first * d1 * dp
            + 2 * vartheta * d2 * dp + G * first * cp - first * sf * sp_ * sec2 * dx * d0,
            both * plus * cp * a["x"] + both * a["xi1_1"] + mb * a["xi1_2"] - first * cp**2 * df**2
            - first * dp**2 + G * both * sp_ + both * sf * cp * sec2 * dx * d0,
            mb * plus * cp * a["x"] + mb * a["xi1_1"] + mb * a["xi1_2"] - vartheta * cp**2 * df**2
            - vartheta * dp**2 + G * mb * sp_ + mb * sf * cp * sec2 * dx * d0,
        ]  # fmt: skip
        right = [force["x"] + tan * force["y"], *(force[k] for k in witness.names[2:])]
        assert np.allclose(rows, right, rtol=1e-10, atol=1e-8)
        # multiplier of (tan(phi0), -1): lambda = -N cos(phi0), from the y-row of the full form
        mass, bias = witness.equations(q, v)
        lam = -(mass[1] @ list(a.values()) + bias[1] - force["y"])
        assert instant.edge_force == pytest.approx(-lam / math.cos(q["phi0"]), rel=1e-9, abs=1e-8)
        assert a["y"] == pytest.approx(a["x"] * tan + dx * d0 * sec2, rel=1e-9, abs=1e-9)


def test_two_link_row_of_the_paper() -> None:
    """(3.3), the row of xi2_1."""
    rods = [(0.5, 3.0), (0.7, 2.0)]
    links: list[dict[str, Any]] = [
        {"rod": {"length": length, "mass": mass}, "lower": {"length": 0.2}, "upper": {"length": 0.3}}
        for length, mass in rods
    ]
    witness = Witness({"base": {"kind": "pivot"}, "links": links})
    assert witness.names == ("phi1", "psi1", "xi1_1", "xi1_2", "phi2", "psi2", "xi2_1")
    for seed in range(STATES):
        q, v = random_state(witness, seed)
        rng = generator(100 + seed)
        a = {name: float(rng.normal()) for name in witness.names}
        mass, bias = witness.equations(q, v)
        row = mass[6] @ list(a.values()) + bias[6]
        turn = q["phi1"] - q["phi2"]
        c12, s12, c1, s1 = math.cos(turn), math.sin(turn), math.cos(q["psi1"]), math.sin(q["psi1"])
        c2, s2 = math.cos(q["psi2"]), math.sin(q["psi2"])
        whole, arm = q["xi1_1"] + 0.5 + q["xi1_2"], q["xi2_1"] + 0.35
        growth = v["xi1_1_dot"] + v["xi1_2_dot"]
        f1, p1, f2, p2 = (v[k] for k in ("phi1_dot", "psi1_dot", "phi2_dot", "psi2_dot"))
        printed = 2.0 * (
            -whole * s12 * c1 * c2 * a["phi1"] - whole * (c12 * s1 * c2 - c1 * s2) * a["psi1"]
            + (c12 * c1 * c2 + s1 * s2) * (a["xi1_1"] + a["xi1_2"]) + a["xi2_1"] - whole * c12 * c1 * c2 * f1**2
            - arm * (1 + math.cos(2 * q["psi2"])) * f2**2 / 2 - whole * (c12 * c1 * c2 + s1 * s2) * p1**2
            - arm * p2**2 - 2 * s12 * c1 * c2 * f1 * growth + 2 * whole * s12 * s1 * c2 * f1 * p1
            - 2 * (c12 * s1 * c2 - c1 * s2) * p1 * growth + G * s2
        )  # fmt: skip
        assert row == pytest.approx(printed, rel=1e-12, abs=1e-12)


def test_azimuth_block_of_a_chain() -> None:
    """(4.2) for four links without tip masses."""
    rng = generator(14)
    lengths, masses = rng.uniform(0.3, 0.9, 4), rng.uniform(1.0, 4.0, 4)
    links = [
        {"rod": {"length": float(a), "mass": float(b)}, "lower": {"length": 0.2}, "upper": {"length": 0.3}}
        for a, b in zip(lengths, masses, strict=True)
    ]
    witness = Witness({"base": {"kind": "pivot"}, "links": links})
    at = [witness.names.index(f"phi{i}") for i in (1, 2, 3, 4)]
    q, v = random_state(witness, 15)
    block = witness.equations(q, v)[0][np.ix_(at, at)]
    lower = [q[f"xi{i}_1"] for i in (1, 2, 3, 4)]
    upper = [q.get(f"xi{i}_2", 0.3) for i in (1, 2, 3, 4)]
    for i in range(4):
        for j in range(i, 4):
            same, above = i == j, masses[j + 1 :].sum()
            first = lengths[i] + lower[i] + (0.0 if same else upper[i])
            value = masses[i] * lengths[i] ** 2 / 3 if same else 0.0
            value += first * masses[j] * ((0.0 if same else 0.5) * lengths[j] + lower[j])
            value += (lengths[i] + lower[i] + upper[i]) * (lengths[j] + lower[j] + upper[j]) * above
            value *= (
                math.cos(q[f"phi{i + 1}"] - q[f"phi{j + 1}"]) * math.cos(q[f"psi{i + 1}"]) * math.cos(q[f"psi{j + 1}"])
            )
            assert block[i, j] == pytest.approx(value, rel=1e-12)


# ------------------------------------------------------------------------------------------------------------- contract


def test_names_follow_the_scene() -> None:
    scene = tree("ski")
    assert Witness(scene).names == (
        "x", "y", "phi0", "phi1", "psi1", "xi1_1", "xi1_2", "phi2", "psi2", "xi2_2", "phi3", "psi3", "xi3_1",
    )  # fmt: skip
    assert Witness(one_link(upper={"length": 0.2})).names == ("phi1", "psi1")
    run: Result = Witness(one_link()).simulate([0.0], {"psi1": 0.3}, {"psi1": 1.0})
    assert run.rates["psi1_dot"][0] == run.rates["psi1"][0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("scene", "start", "rates", "match"),
    [
        (skier(), {"phi9": 1.0}, {}, "phi9"),
        (skier(), {}, {"y_dot": 1.0}, "sideways"),
        (skier(constraints=["phi1 = phi0"]), {"phi1": 1.0}, {}, "does not hold"),
        (skier(constraints=["xi1_1 = 0.5 - xi1_2"]), {}, {}, "does not hold"),
        ({**one_link(), "forces": [{"on": "M_psi1", "law": "1"}]}, {}, {}, "forces"),
        ({**one_link(), "base": {"kind": "sky"}}, {}, {}, "sky"),
        (one_link(lenght=1.0), {}, {}, "lenght"),
    ],
)
def test_mistakes_are_named(scene: dict[str, Any], start: Any, rates: Any, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        Witness(scene).simulate([0.0, 0.1], start, rates)


def test_motions_without_mass_are_named() -> None:
    """A free base beside a free lower segment; two links in line at a massless hinge between free segments."""
    scene = tree()
    with pytest.raises(np.linalg.LinAlgError, match="no mass"):
        Witness({**scene, "base": {"kind": "free"}}).simulate([0.0, 1.0], {})
    rod = {"rod": {"length": 0.5, "mass": 1.0}, "lower": {"length": 0.2}, "upper": {"length": 0.2}}
    witness = Witness({"base": {"kind": "pivot"}, "links": [rod, rod]})
    with pytest.raises(np.linalg.LinAlgError, match="no mass"):
        witness.accelerations({"psi1": 0.5, "psi2": 0.5})


def test_azimuth_moment_at_the_pole_is_refused() -> None:
    with pytest.raises(ValueError, match="pole"):
        Witness(one_link()).accelerations({}, {}, {"M_phi1": 1.0})
