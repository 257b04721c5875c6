"""Accelerations by name: against the equations of motion, the motion of a run, and formulas by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.small_scenes import BENT, FLYING, MOVING, PIVOT, SKI, TIGHT, bent, link, scene

PROGRAMME = {"constraints": ["psi1 = 0.9", "xi1_1 = 0.3"], "controls": ["M_psi1", "F1_1"], "frequency": 3.0}


def posture(mechanism: vlmb.Mechanism) -> tuple[dict[str, float], dict[str, float]]:
    """A posture off the pole and rates that a ski's edge allows."""
    names = mechanism.coordinate_names
    values = {"x": 0.4, "y": -0.3, "z": 1.1, "phi0": 0.3} | BENT
    coordinates = {name: values.get(name, 0.35) for name in names}
    moving = {"z_dot": 0.3, "phi0_dot": 0.9} | MOVING
    rates = {name: value for name, value in moving.items() if name.removesuffix("_dot") in names}
    if "phi0" in names:
        rates["speed"] = 1.7
    return coordinates, rates


@pytest.mark.parametrize("plane", [False, True])
@pytest.mark.parametrize("base", [PIVOT, SKI, FLYING], ids=["pivot", "ski", "free"])
def test_springs_and_forces_by_hand_give_the_same(base: Any, plane: bool) -> None:
    """The equations of motion, solved for spring forces -k (xi - rest) and the applied moment."""
    made = bent(base, 2, plane=plane, forces=[{"on": "M_psi2", "law": "4 + 3*t"}])
    mechanism = vlmb.build(made)
    coordinates, rates = posture(mechanism)
    forces = {"M_psi2": 4.0 + 3.0 * 0.5}
    for name, value in coordinates.items():
        if name.startswith("xi"):
            stiffness, rest = (2000.0, 0.3) if name.endswith("1") else (1500.0, 0.2)
            forces[f"F{name.removeprefix('xi')}"] = -stiffness * (value - rest)
    eom = vlmb.equations_of_motion(mechanism, coordinates, rates)
    expected = dict(zip(eom.names, eom.solve(forces).accelerations, strict=True))
    for what in (made, mechanism, made.to_dict()):
        found = vlmb.accelerations(what, coordinates, rates, t=0.5)
        assert list(found) == list(mechanism.coordinate_names)
        assert found == pytest.approx(expected, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("knife_edge", ["reduction", "multiplier"])
def test_the_second_differences_of_a_run_are_the_accelerations(knife_edge: str) -> None:
    """Ideal row, programme, a law in t, a prescribed length and a spring between directions, all at once."""
    made = scene(
        SKI,
        [
            link("a", upper={"motion": "prescribed", "law": "0.2 + 0.02*sin(3*t)"}),
            link("b", lower={"length": 0.3, "motion": "fixed"}, upper=None),
        ],
        constraints=["phi1 = phi0"], programme=PROGRAMME, forces=[{"on": "M_psi2", "law": "2*cos(t)"}, {
            "between": ["a", "b"], "stiffness": 40.0, "damping": 1.0, "rest": 0.2}],
        start={"phi0": 0.3, "phi0_dot": 0.4, "speed": 1.7, "psi1": 0.8, "psi2": 0.4, "phi2": 1.0, "phi2_dot": -0.3},
        run={**TIGHT, "knife_edge": knife_edge, "method": "dop853"},
    )  # fmt: skip
    h, t = 1e-3, 0.2
    run = vlmb.simulate(made, duration=t + 2 * h, t_eval=[t - 2 * h, t - h, t, t + h, t + 2 * h])
    names = run.mechanism.coordinate_names
    found = vlmb.accelerations(
        made, {name: run[name][2] for name in names}, {f"{name}_dot": run[f"{name}_dot"][2] for name in names}, t=run.t[2]
    )
    for name in names:
        rate = run[f"{name}_dot"]
        expected = (8.0 * (rate[3] - rate[1]) - (rate[4] - rate[0])) / (12.0 * h)
        assert found[name] == pytest.approx(expected, rel=1e-6, abs=1e-6), name
    assert found["xi1_2"] == pytest.approx(-0.18 * math.sin(3 * t), abs=1e-12)


def test_a_pendulum_and_a_spring_by_formula() -> None:
    """A thin rod turns with -3 g cos(psi) / (2 l); a point on a leg: xi'' = (l + xi) psi'^2 - g sin(psi) - k (xi - rest) / m."""
    rod = vlmb.Link(rod=vlmb.Rod(length=0.8, mass=2.0))
    pendulum = vlmb.Scene(base=vlmb.Base(kind="pivot"), links=[rod], plane=True)
    assert vlmb.accelerations(pendulum, {"psi1": 0.4}) == pytest.approx({"psi1": -1.5 * 9.81 * math.cos(0.4) / 0.8})
    leg = vlmb.Link(rod=vlmb.Rod(length=0.1, mass=0.0), lower=vlmb.Segment(length=0.4, stiffness=50.0), tip_mass=2.0)
    mass = vlmb.Scene(base=vlmb.Base(kind="pivot"), links=[leg], plane=True)
    found = vlmb.accelerations(mass, {"psi1": 0.4, "xi1_1": 0.5}, {"psi1_dot": 1.5, "xi1_1_dot": 0.2})
    r = 0.6
    assert found["xi1_1"] == pytest.approx(r * 1.5**2 - 9.81 * math.sin(0.4) - 50.0 * 0.1 / 2.0)
    assert found["psi1"] == pytest.approx((-9.81 * math.cos(0.4) - 2.0 * 0.2 * 1.5) / r)


def test_a_ski_turns_as_its_speed_and_yaw_say() -> None:
    """On its edge x'' = a cos - v phi0' sin, y'' = a sin + v phi0' cos, a = 0 without slope and offset."""
    ski = vlmb.Scene(base=vlmb.Base(kind="ski", mass=5.0, inertia=0.6))
    found = vlmb.accelerations(ski, {"x": 0.0, "y": 0.0, "phi0": 0.7}, {"speed": 3.0, "phi0_dot": 0.5})
    assert found == pytest.approx({"x": -1.5 * math.sin(0.7), "y": 1.5 * math.cos(0.7), "phi0": 0.0}, abs=1e-14)


def test_what_has_no_acceleration_is_named() -> None:
    made = bent(SKI, 1)
    coordinates, rates = posture(vlmb.build(made))
    with pytest.raises(vlmb.SceneError, match="missing coordinates: psi1 of 'link1'"):
        vlmb.accelerations(made, {name: value for name, value in coordinates.items() if name != "psi1"})
    with pytest.raises(vlmb.SceneError, match="unknown rate 'psi1_dott'"):
        vlmb.accelerations(made, coordinates, {"psi1_dott": 1.0})
    with pytest.raises(vlmb.SceneError, match=r"sideways at .* m/s; give `speed`"):
        vlmb.accelerations(made, coordinates, {"x_dot": 1.0, "y_dot": 1.0})
    with pytest.raises(vlmb.SingularError, match="link 'link1' stands at the pole"):
        vlmb.accelerations(made, {**coordinates, "psi1": math.pi / 2}, rates)
    with pytest.raises(vlmb.SceneError, match="t = nan"):
        vlmb.accelerations(made, coordinates, rates, t=math.nan)
    moved = scene(PIVOT, [link("a", lower={"motion": "prescribed", "law": "0.3 + t"})])
    values = {"phi1": 0.2, "psi1": 0.4, "xi1_2": 0.2}
    assert vlmb.accelerations(moved, {"a.azimuth": 0.2, "a.elevation": 0.4, "a.upper": 0.2}, {"a.upper_dot": 0.3}) == (
        vlmb.accelerations(moved, values, {"xi1_2_dot": 0.3})
    )
    assert vlmb.accelerations(moved, values, t=0.1)["xi1_1"] == pytest.approx(0.0, abs=1e-12)
    assert np.isfinite(list(vlmb.accelerations(moved, {**values, "xi1_1": 0.4}, {"xi1_1_dot": 1.0}, t=0.1).values())).all()
    with pytest.raises(vlmb.SceneError, match=r"xi1_1 = 0.5: this segment follows its law, 0.4 at t = 0.1"):
        vlmb.accelerations(moved, {**values, "xi1_1": 0.5}, t=0.1)
