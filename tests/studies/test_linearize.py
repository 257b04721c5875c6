"""Steady motions and their linearizations against closed forms, and against the growth of runs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from vlmb.errors import SceneError, StudyError
from vlmb.studies.chart import chart_at
from vlmb.studies.derivatives import jacobian
from vlmb.studies.symmetry import turned
from vlmb.system.system import make_system

MODELS = Path(__file__).resolve().parents[2] / "models"
G = 9.81


def pendulum(**more: Any) -> vlmb.Scene:
    link = {"name": "rod", "rod": {"length": 0.8, "mass": 2.0}, "tip_mass": 0.3}
    return vlmb.Scene.from_dict({"base": {"kind": "pivot"}, "links": [link], "start": {"psi1": -1.0, "phi1_dot": 4.0}, **more})


INERTIA, MOMENT = 2.0 * 0.64 / 3.0 + 0.3 * 0.64, 2.0 * 0.4 + 0.3 * 0.8  # J about the hinge, m d


@pytest.mark.parametrize("psi", [-1.4, -0.9, -0.35])
def test_conical_pendulum(psi: float) -> None:
    found = vlmb.steady(pendulum(), {"psi1": psi})
    cosine = math.sin(-psi)  # of the angle to the vertical
    rate = math.sqrt(G * MOMENT / (INERTIA * cosine))
    assert found.rates["phi1_dot"] == pytest.approx(rate, rel=1e-10) and found.family == 1 and found.residual < 1e-10
    linear = vlmb.linearize(found, controls=["M_psi1"])
    assert linear.names == ("psi1", "phi1_dot", "psi1_dot")
    omega = math.sqrt(G * MOMENT / (INERTIA * cosine) * (1.0 + 3.0 * cosine**2))
    np.testing.assert_allclose(sorted(linear.eigenvalues.imag), [-omega, 0.0, omega], rtol=1e-10, atol=1e-10)
    assert np.abs(linear.eigenvalues.real).max() < 1e-10 and sorted(linear.labels) == ["", "", "family"]
    assert linear.stability == "neutral"
    np.testing.assert_allclose(linear.B, [[0.0], [0.0], [1.0 / INERTIA]], rtol=1e-12, atol=1e-14)


def test_a_state_has_the_same_numbers_however_far_it_has_turned() -> None:
    chart = chart_at(make_system(vlmb.build(pendulum())))
    for angle in (1.0, 2.2, 3.1, -2.2, 7.0):
        found = chart.numbers(turned(chart.arrays, chart.origin, angle))
        np.testing.assert_allclose(found, [-1.0, 4.0, 0.0], atol=1e-14)


def test_hanging_and_standing_have_no_azimuth() -> None:
    for psi, sign in ((-math.pi / 2, -1.0), (math.pi / 2, 1.0)):
        linear = vlmb.linearize(pendulum(start={"psi1": psi}))
        assert linear.names[:2] == ("rod.direction.x", "rod.direction.y")
        found = np.sort_complex(linear.eigenvalues**2)
        np.testing.assert_allclose(found, np.full(4, sign * MOMENT * G / INERTIA), rtol=1e-10)
        assert linear.stability == ("unstable" if sign > 0.0 else "neutral")


@pytest.mark.parametrize("speed", [2.0, -2.0])
def test_sleigh(speed: float) -> None:
    mass, arm, inertia = 20.0, 0.4, 1.5
    scene = vlmb.load_scene(MODELS / "chaplygin_sleigh.toml").changed(start={"phi0_dot": 0.0})
    found = vlmb.steady(scene, {"speed": speed})
    linear = vlmb.linearize(found)
    expected = -mass * arm * speed / (inertia + mass * arm**2)
    np.testing.assert_allclose(sorted(linear.eigenvalues.real), sorted([0.0, expected]), rtol=1e-10)
    assert linear.labels.count("family") == 1
    assert linear.stability == ("asymptotically stable" if speed > 0.0 else "unstable")
    with pytest.raises(StudyError, match="no steady motion near this start"):
        vlmb.steady(scene, {"speed": speed, "radius": 6.0})
    centred = scene.changed(base={"com_offset": 0.0})
    turning = vlmb.steady(centred, {"speed": speed, "radius": 6.0})
    assert turning.rates["phi0_dot"] == pytest.approx(speed / 6.0) and turning.family == 2


def carver(speed: float, sidecut: float) -> vlmb.Scene:
    """A rider whose ski turns as far as he leans: a rigid link, and a row for the heading."""
    lean = "(cos(phi0)*legs.direction.y - sin(phi0)*legs.direction.x)"
    return vlmb.Scene.from_dict(
        {
            "base": {"kind": "ski", "mass": 5.0, "inertia": 0.4},
            "links": [{"name": "legs", "rod": {"length": 1.0, "mass": 60.0}, "tip_mass": 10.0}],
            "parameters": {"kappa": sidecut},
            "constraints": [f"carve: phi0_dot = kappa*speed*{lean}"],
            "start": {"speed": speed},
        }
    )


@pytest.mark.parametrize("speed", [4.0, 9.0])
def test_carving_rider_on_both_sides_of_the_critical_speed(speed: float) -> None:
    sidecut, inertia, moment = 0.2, 60.0 / 3.0 + 10.0, 60.0 * 0.5 + 10.0
    scene = carver(speed, sidecut)
    linear = vlmb.linearize(vlmb.steady(scene, {"speed": speed}))
    square = moment * (G - sidecut * speed**2) / inertia
    rolling = [name for name in linear.names if name.startswith("legs.direction.y")]
    assert len(rolling) == 2 and "phi0_dot" not in linear.names
    part = [linear.names.index(name) for name in rolling]
    np.testing.assert_allclose(np.linalg.eigvals(linear.A[np.ix_(part, part)]) ** 2, [square, square], rtol=1e-9)
    wanted = np.sqrt(complex(square))
    assert np.abs(linear.eigenvalues - wanted).min() < 1e-9 * abs(wanted)
    assert np.abs(linear.eigenvalues + wanted).min() < 1e-9 * abs(wanted)


def test_a_deviation_grows_in_a_run_as_its_eigenvalue_says() -> None:
    scene = vlmb.load_scene(MODELS / "chaplygin_sleigh.toml").changed(start={"phi0_dot": 0.0, "speed": -2.0})
    rate = max(vlmb.linearize(scene).eigenvalues.real)
    run = vlmb.simulate(scene, duration=1.0, start={"phi0_dot": 1e-7}, rtol=1e-12, atol=1e-16)
    growth = math.log(run["phi0_dot"][-1] / run["phi0_dot"][0])
    assert growth == pytest.approx(rate, rel=1e-4)


def test_a_turn_is_left_as_its_fastest_mode_says() -> None:
    ski = {"kind": "ski", "mass": 6.0, "inertia": 0.5}
    leg = {"name": "legs", "rod": {"length": 0.9, "mass": 50.0}, "lower": {"length": 0.3, "stiffness": 4e4, "damping": 800.0}}
    scene = vlmb.Scene.from_dict({"base": ski, "links": [leg], "start": {"speed": 7.0, "phi1": math.pi / 2, "psi1": 1.1}})
    found = vlmb.steady(scene, {"speed": 7.0, "radius": 12.0})
    linear = vlmb.linearize(found)
    assert linear.stability == "unstable" and found.residual < 1e-10
    rate, mode = linear.eigenvalues[0].real, dict(zip(linear.names, linear.modes[:, 0].real, strict=True))
    heading = found.coordinates["phi0"]
    start = {k: v for k, v in found.start.items() if k not in ("x_dot", "y_dot")} | {"speed": 7.0}
    assert abs(linear.eigenvalues[0].imag) == 0.0 and abs(heading) < 1e-12
    moved = {name: start[name] + 1e-7 * mode.get(name, 0.0) for name in start}
    t = [0.0, 0.1, 0.4]
    runs = [vlmb.simulate(scene, start=each, t_eval=t, duration=0.4, rtol=1e-13, atol=1e-15) for each in (start, moved)]
    shape = [{"phi1": run["phi1"] - run["phi0"], "psi1": run["psi1"]} for run in runs]
    name = max(("phi1", "psi1"), key=lambda each: abs(mode[each]))
    apart = np.abs(shape[1][name] - shape[0][name])
    assert apart[0] == pytest.approx(1e-7 * abs(mode[name]), rel=1e-6)
    assert math.log(apart[2] / apart[1]) / 0.3 == pytest.approx(rate, rel=1e-4)


def test_a_programme_closes_the_loop_with_the_roots_of_its_errors() -> None:
    scene = pendulum(
        start={"psi1": -0.9, "phi1_dot": 0.0},
        programme={"constraints": ["psi1 = -0.9", "phi1 = 0.3"], "controls": ["M_psi1", "M_phi1"], "frequency": 4.0,
                   "damping_ratio": 0.5},
    ).changed(start={"phi1": 0.3})  # fmt: skip
    linear = vlmb.linearize(scene)
    expected = np.roots([1.0, 4.0, 16.0])
    for root in expected:
        assert np.sort(np.abs(linear.eigenvalues - root))[:2].max() < 1e-9
    assert linear.controls == ("M_psi1", "M_phi1") and linear.B.shape == (4, 2) and np.abs(linear.B).max() > 0.1
    assert linear.stability == "asymptotically stable"


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_place_of_a_link_tree_is_divided_out(side: float) -> None:
    ski = {"kind": "ski", "mass": 6.0, "inertia": 0.5}
    leg = {"name": "legs", "rod": {"length": 0.9, "mass": 50.0}, "lower": {"length": 0.3, "stiffness": 4e4, "damping": 800.0}}
    scene = vlmb.Scene.from_dict({"base": ski, "links": [leg], "start": {"speed": 7.0, "phi1": side * math.pi / 2, "psi1": 1.3}})
    found = vlmb.steady(scene, {"speed": 7.0, "radius": side * 20.0})
    lean = math.pi / 2 - found.coordinates["psi1"]
    out = 20.0 - (0.45 + found.coordinates["xi1_1"]) * math.sin(lean)  # the mass goes round a smaller circle
    assert 0.2 < lean < 0.3 and out < 20.0 and found.residual < 1e-10
    run = vlmb.simulate(scene, start=found.start, duration=0.5, rtol=1e-11, atol=1e-12)
    assert np.abs(run["psi1"] - found.coordinates["psi1"]).max() < 1e-8
    assert vlmb.linearize(found).labels.count("family") == found.family == 2


def test_refusals() -> None:
    with pytest.raises(SceneError, match="depends on time"):
        vlmb.steady(pendulum(forces=[{"on": "M_psi1", "law": "sin(t)"}]))
    with pytest.raises(SceneError, match="this scene has none"):
        vlmb.steady(pendulum(), {"radius": 3.0})
    with pytest.raises(SceneError, match="on a slope"):
        vlmb.steady(vlmb.load_scene(MODELS / "chaplygin_sleigh.toml").changed(slope=0.1), {"radius": 3.0, "speed": 1.0})
    with pytest.raises(SceneError, match="unknown name 'psi2'"):
        vlmb.steady(pendulum(), {"psi2": 1.0})
    with pytest.raises(StudyError, match="stands on a switch"):
        vlmb.linearize(pendulum(forces=[{"on": "M_psi1", "law": "-sign(psi1_dot)"}], start={"psi1": -1.0}))
    with pytest.raises(StudyError, match="not smooth here"):  # its axis is that of an azimuth which an upright link has not
        vlmb.linearize(pendulum(forces=[{"on": "M_psi1", "law": "5.0"}], start={"psi1": math.pi / 2}))


def test_derivatives_tell_their_error() -> None:
    x = np.array([0.3, -0.7])
    matrix, error = jacobian(lambda at: np.array([math.exp(at[0]) * at[1], math.sin(5.0 * at[1])]), x, np.ones(2))
    exact = [[-0.7 * math.exp(0.3), math.exp(0.3)], [0.0, 5.0 * math.cos(-3.5)]]
    np.testing.assert_allclose(matrix, exact, rtol=1e-11, atol=1e-12)
    assert error < 1e-10
    with pytest.raises(StudyError, match="not smooth"):
        jacobian(lambda at: np.array([abs(at[0] - 0.301)]), x, np.ones(2))
