"""Friction under a ski, in both engines and every form of the knife edge: against closed forms and an independent simulation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import vlmb
from tests.small_scenes import SKI, TIGHT, bent, link, scene

Array = np.ndarray
G = 9.81
engines = pytest.mark.parametrize("engine", ["core", "pinocchio"])
forms = pytest.mark.parametrize("form", ["reduction", "multiplier", "projection"])


def sleigh(friction: float, speed: float, slope: float = 0.0, **base: Any) -> vlmb.Scene:
    """A sleigh of 80 kg."""
    ski = {"kind": "ski", "mass": 80.0, "inertia": 4.0, "friction": friction, **base}
    return scene(ski, [], slope=slope, start={"speed": speed})


def run(made: vlmb.Scene, engine: str, duration: float, form: str = "reduction", **options: Any) -> vlmb.Trajectory:
    found = vlmb.simulate(made, duration=duration, engine=engine, knife_edge=form, **options)
    assert found.status == "finished", found.message
    assert np.abs(found["balance"]).max() < 1e-9 * max(1.0, float(np.abs(found["kinetic"]).max()))
    return found


@engines
@forms
def test_a_sleigh_stops_and_stands(engine: str, form: str) -> None:
    found = run(sleigh(0.05, 2.0), engine, 6.0, form)
    rate, stop = 0.05 * G, 2.0 / (0.05 * G)
    t = np.minimum(found.t, stop)
    np.testing.assert_allclose(found["x"], 2.0 * t - 0.5 * rate * t**2, atol=1e-11)
    standing = found.t > stop
    assert (found["speed"][standing] == 0.0).all() and standing.sum() > 20
    np.testing.assert_allclose(found.reactions["friction"][~standing], -0.05 * 80.0 * G, rtol=1e-12)
    assert np.abs(found.reactions["friction"][standing]).max() < 1e-9
    np.testing.assert_allclose(found["dissipated"], 160.0 - 40.0 * found["speed"] ** 2, atol=1e-9)


@engines
@pytest.mark.parametrize("method", ["dop853", "adams", "radau", "rk4"])
def test_on_a_slope_it_holds_or_slides_back(engine: str, method: str) -> None:
    """Uphill at 2 m/s. Where tan(slope) < mu it stands, with m g sin(slope) of friction; beyond, it slides down again."""
    for slope, holds in ((0.03, True), (0.2, False)):
        found = run(sleigh(0.05, -2.0, slope), engine, 5.0, method=method)
        pull, rub = G * math.sin(slope), 0.05 * G * math.cos(slope)
        stop = 2.0 / (pull + rub)
        later = np.maximum(found.t - stop, 0.0)
        back = 0.0 if holds else pull - rub
        np.testing.assert_allclose(found["speed"], np.minimum((pull + rub) * found.t - 2.0, 0.0) + back * later, atol=1e-9)
        if holds:
            np.testing.assert_allclose(found.reactions["friction"][found.t > stop + 1e-6], -80.0 * pull, rtol=1e-10)


@engines
@forms
def test_a_glide_with_friction_and_drag_in_closed_form(engine: str, form: str) -> None:
    """m w' = m g (sin - mu cos) - c w^2: w = w_end tanh(t/T + const)."""
    found = run(sleigh(0.05, 2.0, 0.2, drag=0.3), engine, 20.0, form)
    drive = G * (math.sin(0.2) - 0.05 * math.cos(0.2))
    end, rate = math.sqrt(80.0 * drive / 0.3), math.sqrt(drive * 0.3 / 80.0)
    np.testing.assert_allclose(found["speed"], end * np.tanh(rate * found.t + math.atanh(2.0 / end)), rtol=1e-9)


def turning(mu: float, board: float, mass: float, length: float, t: Array, start: Array) -> Array:
    """A point mass on a massless leg on a ski, by Newton, the normal force solved for at every instant.

    y: x, y, phi0, w, d (3), d' (3); I phi0'' = 0. Of the leg's push T, the speed and N = T d_z + M g:
        M w' = -mu s N - T d . h,    d . (g + T d/m - a_A) = -l |d'|^2.
    """

    def rates(_: float, y: Array) -> Array:
        h, n = np.array([math.cos(y[2]), math.sin(y[2]), 0.0]), np.array([-math.sin(y[2]), math.cos(y[2]), 0.0])
        d, u = y[4:7], y[7:]
        yaw, side, down = start[2], math.copysign(1.0, y[3]), np.array([0.0, 0.0, -G])
        matrix = np.array([[board, d @ h + mu * side * d[2]], [-d @ h, 1.0 / mass]])
        right = np.array([-mu * side * board * G, -length * u @ u - d @ down + d @ n * y[3] * yaw])
        ahead, push = np.linalg.solve(matrix, right)
        bend = (down + push / mass * d - ahead * h - y[3] * yaw * n) / length
        return np.concatenate([y[3] * h[:2], [yaw, ahead], u, bend])

    psi, phi = start[3], start[4]
    d = np.array([math.cos(psi) * math.cos(phi), math.cos(psi) * math.sin(phi), math.sin(psi)])
    u = start[5] * math.cos(psi) * np.array([-math.sin(phi), math.cos(phi), 0.0])
    first = np.concatenate([[0.0, 0.0, start[1], start[0]], d, u])
    return solve_ivp(rates, (t[0], t[-1]), first, "DOP853", t, rtol=1e-13, atol=1e-14).y


@engines
@forms
def test_in_a_turn_against_an_independent_simulation(engine: str, form: str) -> None:
    leg = {"name": "leg", "rod": {"length": 0.9, "mass": 0.0}, "tip_mass": 30.0}
    made = scene(
        {"kind": "ski", "mass": 20.0, "inertia": 2.0, "friction": 0.1}, [leg],
        start={"speed": 3.0, "phi0": 0.2, "phi0_dot": 0.8, "psi1": 1.2, "phi1": 0.9, "phi1_dot": 0.5},
    )  # fmt: skip
    found = run(made, engine, 0.5, form)
    wanted = turning(0.1, 20.0, 30.0, 0.9, found.t, np.array([3.0, 0.2, 0.8, 1.2, 0.9, 0.5]))
    for name, row in (("x", 0), ("y", 1), ("speed", 3), ("leg.direction.x", 4), ("leg.direction.z", 6)):
        np.testing.assert_allclose(found[name], wanted[row], atol=1e-9, err_msg=name)
    sliding = -found.reactions["friction"] / found.reactions["normal"]
    np.testing.assert_allclose(sliding, 0.1, rtol=1e-9)
    assert np.ptp(found.reactions["normal"]) > 50.0


@engines
@pytest.mark.parametrize("form", ["multiplier", "projection"])
def test_a_carving_sleigh_rubs_by_the_resultant_in_closed_form(engine: str, form: str) -> None:
    """E = m w phi0', N = m g: w' = -mu sqrt(g^2 + (w phi0')^2), so that asinh(w phi0'/g) falls by mu phi0' t."""
    made = sleigh(0.1, 8.0, friction_on="resultant")
    found = run(made.changed(start={"phi0_dot": 0.9}), engine, 6.0, form)
    wanted = G / 0.9 * np.sinh(math.asinh(8.0 * 0.9 / G) - 0.1 * 0.9 * found.t)
    np.testing.assert_allclose(found["speed"], wanted, rtol=1e-9)
    edge, normal = found.reactions["knife_edge"], found.reactions["normal"]
    np.testing.assert_allclose(found.reactions["friction"], -0.1 * np.hypot(edge, normal), rtol=1e-9)


@engines
def test_the_resultant_is_solved_for_with_a_rider(engine: str) -> None:
    leg = {"name": "leg", "rod": {"length": 0.9, "mass": 0.0}, "tip_mass": 30.0}
    ski = {"kind": "ski", "mass": 20.0, "inertia": 2.0, "friction": 0.1, "friction_on": "resultant"}
    start = {"speed": 3.0, "phi0": 0.2, "phi0_dot": 0.8, "psi1": 1.2, "phi1": 0.9, "phi1_dot": 0.5}
    found = run(scene(ski, [leg], start=start), engine, 0.4, "multiplier")
    edge, normal = found.reactions["knife_edge"], found.reactions["normal"]
    np.testing.assert_allclose(found.reactions["friction"], -0.1 * np.hypot(edge, normal), rtol=1e-8)
    assert np.abs(edge).max() > 20.0
    with pytest.raises(vlmb.SceneError, match=r"friction_on = .resultant.*knife_edge = .multiplier"):
        vlmb.check(scene(ski, [leg], start=start))


def skier(**changes: Any) -> vlmb.Scene:
    """A ski whose rider is pulled, hung and steered: everything that enters the normal force."""
    return bent(
        {**SKI, "friction": 0.08, "drag": 0.2}, 2, slope=0.1,
        forces=[{"at": "link2.rod_end", "force": ["4", "1", "20*sin(3*t)"]}],
        springs=[{"between": ["link2.tip", [2.0, 0.5, 3.0]], "stiffness": 30.0, "damping": 1.0, "rest": 0.5}],
        programme={"constraints": ["psi1 = 0.9"], "controls": ["M_psi1", "R_link1.tip.z"], "frequency": 6.0},
        **changes,
    )  # fmt: skip


@engines
@forms
def test_friction_is_mu_times_the_normal_force_of_all_that_acts(engine: str, form: str) -> None:
    made = skier().changed(start={"psi1_dot": 0.0, "xi1_1_dot": 0.0, "phi1_dot": 0.1, "phi2_dot": 0.2, "psi2_dot": 0.1})
    found = run(made, engine, 0.15, form)
    assert found.reactions["normal"].min() > 1.0
    np.testing.assert_allclose(found.reactions["friction"], -0.08 * found.reactions["normal"], rtol=1e-8)
    other = run(made, "core" if engine == "pinocchio" else "pinocchio", 0.15)
    for name in found.mechanism.coordinate_names:
        np.testing.assert_allclose(found[name], other[name], rtol=1e-8, atol=1e-8, err_msg=name)


def test_both_engines_agree_on_the_accelerations_of_friction() -> None:
    assert "both engines agree" in vlmb.check(skier()).report


@engines
def test_a_standing_ski_slips_where_its_rider_pushes_harder(engine: str) -> None:
    """A force that grows: it holds until t = mu m g / rate, then m w' = rate t - mu m g."""
    rider = {"name": "rider", "rod": {"length": 0.1, "mass": 0.0}, "tip_mass": 10.0}
    made = scene(
        {"kind": "ski", "mass": 70.0, "inertia": 4.0, "friction": 0.05}, [rider], plane=True,
        constraints=["psi1 = 1.5"], start={"psi1": 1.5}, forces=[{"on": "F_x", "law": "20*t"}],
    )  # fmt: skip
    found = run(made, engine, 4.0)
    most = 0.05 * 80.0 * G
    slips = most / 20.0
    later = np.maximum(found.t - slips, 0.0)
    np.testing.assert_allclose(found["speed"], 10.0 * later**2 / 80.0, atol=1e-8)
    before = found.t < slips - 1e-6
    np.testing.assert_allclose(found.reactions["friction"][before], -20.0 * found.t[before], atol=1e-6)


@engines
@pytest.mark.parametrize("rate", [7.0, 11.0, 13.0, 17.3, 19.0, 23.1, 29.0, 31.7])
def test_a_standing_ski_slips_once_however_its_limit_is_rounded(engine: str, rate: float) -> None:
    """At the instant found for it rounding may still have the ski hold."""
    made = sleigh(0.05, 0.0).changed(forces=[{"on": "F_x", "law": f"{rate}*t"}])
    slips = 0.05 * 80.0 * G / rate
    found = run(made, engine, slips + 1.0)
    np.testing.assert_allclose(found["speed"], rate * np.maximum(found.t - slips, 0.0) ** 2 / 160.0, atol=1e-8)
    assert found.stats["steps"] < 100


MOST = 0.05 * 80.0 * G
JUMPS = {
    "its limit, and more from then on": (f"{MOST!r} + 20*t", lambda t: 0.125 * t**2),
    "its limit": (f"{MOST!r}", lambda t: 0.0 * t),
    "no more than its limit": (f"{MOST!r}*sin(t)", lambda t: 0.0 * t),
    "a jump beyond its limit": ("50*step(t - 1)", lambda t: (50.0 - MOST) / 80.0 * np.maximum(t - 1.0, 0.0)),
    "a jump from below to beyond": ("where(t < 1, 10, 60)", lambda t: (60.0 - MOST) / 80.0 * np.maximum(t - 1.0, 0.0)),
}


@engines
@pytest.mark.parametrize("kind", JUMPS)
def test_a_standing_ski_under_a_force_at_its_limit_or_that_jumps(engine: str, kind: str) -> None:
    law, speed = JUMPS[kind]
    found = run(sleigh(0.05, 0.0).changed(forces=[{"on": "F_x", "law": law}]), engine, 3.0)
    np.testing.assert_allclose(found["speed"], speed(found.t), atol=1e-8)
    assert found.stats["steps"] < 100


@engines
def test_a_standing_ski_slips_for_a_moment_alone(engine: str) -> None:
    """Where a force is beyond the limit by a thousandth: m w' = F - mu m g from then on until w = 0."""
    found = run(sleigh(0.05, 0.0).changed(forces=[{"on": "F_x", "law": f"1.001*{MOST!r}*sin(t)"}]), engine, 3.0)
    begins, rate = math.asin(1.0 / 1.001), 0.05 * G

    def gone(t: Any) -> Any:
        return rate * (1.001 * (math.cos(begins) - np.cos(t)) - (t - begins))

    slides = (found.t > begins) & (found.t < float(brentq(gone, math.pi - begins, 2.0)))
    np.testing.assert_allclose(found["speed"], np.where(slides, gone(found.t), 0.0), atol=1e-9)
    assert found["speed"].max() > 2e-5


@engines
def test_a_standing_ski_is_let_go_by_a_switch_of_the_state(engine: str) -> None:
    """A rider who swings pushes the ski as soon as he is past the upright."""
    rider = {"name": "rider", "rod": {"length": 0.2, "mass": 0.0}, "tip_mass": 1e-6}
    made = scene(
        {"kind": "ski", "mass": 80.0, "inertia": 4.0, "friction": 0.05}, [rider], plane=True,
        start={"psi1": 1.2, "psi1_dot": 20.0}, forces=[{"on": "F_x", "law": "60*step(psi1 - pi/2)"}],
    )  # fmt: skip
    found = vlmb.simulate(made, duration=0.1, engine=engine)
    past = float(found.t[np.argmax(found["psi1"] > 0.5 * math.pi)])
    assert found.status == "finished" and 0.0 < past < 0.05
    assert found["speed"][-1] == pytest.approx((60.0 - MOST) / 80.0 * (0.1 - past), abs=0.26 / 60.0)


@engines
def test_a_ski_that_would_lift_is_a_named_stop(engine: str) -> None:
    made = scene({**SKI, "friction": 0.05}, 1, start={"psi1": 1.2}, forces=[{"at": "link1.rod_end", "force": [0, 0, "600*t"]}])
    found = vlmb.simulate(made, engine=engine)
    assert found.status == "stopped" and "the normal force became 0" in found.message
    assert abs(found.reactions["normal"][-1]) < 1e-6
    lifted = made.changed(forces=[{"at": "link1.rod_end", "force": [0, 0, 900]}])
    assert "the normal force became 0" in vlmb.simulate(lifted, engine=engine).message


@engines
def test_friction_that_jams_is_a_named_stop(engine: str) -> None:
    """A leaning leg ahead of a ski that is pushed against its lean: N grows faster than the friction that makes it grow."""
    rider = {"name": "rider", "rod": {"length": 1.0, "mass": 0.0}, "tip_mass": 80.0}
    made = scene({"kind": "ski", "mass": 1.0, "inertia": 1.0, "friction": 2.5}, [rider], plane=True,
                 start={"psi1": 0.9, "speed": 3.0}, run={**TIGHT, "fall": False})  # fmt: skip
    assert "mu |dN/dF| reached 1" in vlmb.simulate(made, engine=engine).message


def test_a_ski_that_would_tip_is_told_in_the_summary() -> None:
    wide = bent({**SKI, "width": 0.06, "length": 1.7}, 1, forces=[{"on": "M_psi1", "law": "40"}])
    said = vlmb.simulate(wide, duration=0.2).summary()
    assert "off the ski's middle" in said and "half its width is 0.03 m" in said
    assert "off the ski's middle" not in vlmb.simulate(sleigh(0.0, 2.0, width=0.3), duration=0.2).summary()


def test_friction_belongs_to_a_ski() -> None:
    with pytest.raises(vlmb.SceneError, match="base: friction, width and length belong to kind = 'ski'"):
        scene({"kind": "pivot", "friction": 0.1}, [link("legs")])
