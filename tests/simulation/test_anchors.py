"""Motions of links on anchors: energy, momentum, what the snow takes, closed loops, and what hinges carry."""

from __future__ import annotations

import math

import numpy as np
import pytest

import vlmb
from tests.anchored import anchored
from tests.reference.particles import Particles
from tests.small_scenes import ANY_LENGTH, FIXED, FLYING, PIVOT, SKI, TIGHT, link, table


def started(base: str, **keys: object) -> dict[str, object]:
    """A scene in motion, its links apart."""
    scene = anchored(base, run=TIGHT, **keys)
    names = vlmb.build(scene).coordinate_names
    rng = np.random.default_rng(7)
    start = {name: float(rng.uniform(0.4, 1.3)) for name in names if name.startswith("psi")}
    start |= {f"{name}_dot": float(rng.uniform(-1.0, 1.0)) for name in names if name[:3] in ("psi", "phi")}
    if base == "ski":
        start |= {"phi0": 0.3, "speed": 2.0}
    return {**scene, "start": start}


@pytest.mark.parametrize("plane", [False, True])
@pytest.mark.parametrize("base", ["pivot", "ski"])
def test_energy_is_accounted_for(base: str, plane: bool) -> None:
    run = vlmb.simulate(started(base, plane=plane), duration=0.5)
    assert run.status == "finished", run.message
    assert np.abs(run["balance"]).max() <= 1e-8 * run["kinetic"].max()


@pytest.mark.parametrize("base", ["pivot", "ski"])
def test_both_engines_give_the_same_motion(base: str) -> None:
    first, second = (vlmb.simulate(started(base), duration=0.5, engine=engine) for engine in ("core", "pinocchio"))
    for name in first.mechanism.coordinate_names:
        np.testing.assert_allclose(first[name], second[name], rtol=0.0, atol=1e-9)
    for name, values in first.reactions.items():
        np.testing.assert_allclose(values, second.reactions[name], rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("links", [1, 30])
def test_on_the_ground_an_anchor_is_a_shift(links: int) -> None:
    chain = [link(f"a{i}") for i in range(links)]
    there = [{**chain[0], "anchor": [0.7, -0.3, 1.1]}, *chain[1:]]
    start = {"psi1": 0.6, "phi1_dot": 1.0}
    plain, shifted = (vlmb.simulate(table(PIVOT, each, start=start), duration=0.1) for each in (chain, there))
    shift = shifted.position(f"a{links - 1}", "tip") - plain.position(f"a{links - 1}", "tip")
    np.testing.assert_allclose(shift, np.tile([0.7, -0.3, 1.1], (len(plain.t), 1)), atol=1e-8)
    assert np.abs(shifted["balance"]).max() <= 1e-8 * shifted["kinetic"].max()


def test_a_link_anywhere_along_another_keeps_momentum() -> None:
    trunk = link("trunk", lower=FIXED)
    links = [trunk, link("low", parent_point=0.05), link("side", parent="trunk", parent_point=0.43)]
    start = {"psi1": 0.7, "psi2": 0.2, "phi2": 1.3, "psi3": 1.1, "phi3": -0.6, "phi1_dot": 1.5, "psi3_dot": -2.0, "x_dot": 0.5}
    run = vlmb.simulate(table(FLYING, links, gravity=0.0, start=start), duration=0.5)
    particles, momenta = Particles(dict(run.scene.to_dict())), []
    for i in (0, len(run.t) // 2, len(run.t) - 1):
        values = {name: float(run[name][i]) for name in particles.names}
        rates = {f"{name}_dot": float(run[f"{name}_dot"][i]) for name in particles.names}
        now = particles.instant(values, rates, {})
        pushes = now.mass[:, None] * now.velocity
        momenta.append([*pushes.sum(axis=0), *np.cross(now.place, pushes).sum(axis=0)])
    np.testing.assert_allclose(momenta[1:], momenta[:1] * 2, atol=1e-9)


def test_the_snow_carries_what_the_inertia_of_all_particles_asks_for() -> None:
    """Force and moment about A of the snow: sum m (r'' - g), sum (r - r_A) x m (r'' - g)."""
    scene = started("ski", forces=[{"on": "M_psi1", "law": 12.0}, {"between": ["base", "back"], "stiffness": 50.0, "rest": 0.4}])
    run = vlmb.simulate(scene, duration=0.3)
    particles, gravity = Particles(scene), np.array(run.scene.surface_gravity)
    for i in (0, len(run.t) // 2, len(run.t) - 1):
        values = {name: float(run[name][i]) for name in particles.names}
        rates = {f"{name}_dot": float(run[f"{name}_dot"][i]) for name in particles.names}
        found = vlmb.accelerations(scene, values, rates, float(run.t[i]))
        now = particles.instant(values, rates, found)
        load = now.mass[:, None] * (now.acceleration - gravity)
        moment = np.cross(now.place - [values["x"], values["y"], 0.0], load).sum(axis=0)
        force = load.sum(axis=0)
        c, s = math.cos(values["phi0"]), math.sin(values["phi0"])
        ahead, left = np.array([c, s, 0.0]), np.array([-s, c, 0.0])
        reactions = run.reactions
        wanted = {
            "knife_edge": force @ left, "normal": force[2], "roll_moment": moment @ ahead, "pitch_moment": moment @ left
        }  # fmt: skip
        for name, value in wanted.items():
            assert reactions[name][i] == pytest.approx(value, abs=1e-8 * np.abs(load).sum()), name
        assert force @ ahead == pytest.approx(0.0, abs=1e-8 * np.abs(load).sum())
        assert moment[2] == pytest.approx(0.0, abs=1e-8 * np.abs(load).sum())


def a_frame(**keys: object) -> dict[str, object]:
    """Two massless bars on the ground, 1.2 m apart, that carry a weight where their tips meet."""
    bar = {"rod": {"length": 1.0, "mass": 0.0}}
    links = [
        {"name": "left", "anchor": [0.0, 0.0, 0.5], **bar, "tip_mass": 3.0},
        {"name": "right", "parent": "base", "anchor": [1.2, 0.0, 0.5], **bar, "tip_mass": 2.0},
    ]
    rows = ["east: left.tip.x = right.tip.x", "up: left.tip.z = right.tip.z"]
    angle = math.acos(0.6)
    start = {"psi1": angle, "psi2": math.pi - angle}
    return {"base": {"kind": "pivot"}, "plane": True, "links": links, "constraints": rows, "start": start, **keys}


def test_two_bars_carry_a_weight_along_themselves() -> None:
    """Statics: each bar carries W / (2 sin psi); a hinge's force is that of inverse dynamics less what the rows do at the tip."""
    run = vlmb.simulate(a_frame(), duration=0.5)
    assert np.abs(run["left.tip.z"] - 1.3).max() < 1e-9 and np.abs(run["right.hinge.x"] - 1.2).max() < 1e-15
    push = 5.0 * 9.81 / 2.0 / 0.8
    rows = np.stack([run.reactions["east"], 0.0 * run.t, run.reactions["up"]], axis=1)
    on_left, on_right = run.hinge_force("left") - rows, run.hinge_force("right") + rows
    np.testing.assert_allclose(on_left, np.tile([0.6 * push, 0.0, 0.8 * push], (len(run.t), 1)), atol=1e-6)
    np.testing.assert_allclose(on_right, np.tile([-0.6 * push, 0.0, 0.8 * push], (len(run.t), 1)), atol=1e-6)


def test_rows_between_links_on_a_turning_ski_hold() -> None:
    """Rows of points on anchors: their Jacobians and drifts have the ski's turn in."""
    leg = {"lower": {"length": 0.3, "stiffness": 900.0, "limits": ANY_LENGTH}, "upper": None, "tip_mass": 2.0}
    links = [link("front", anchor=[0.3, 0.1, 0.05], **leg), link("back", parent="base", anchor=[-0.3, 0.0, 0.0], **leg)]
    rows = [f"front.tip.{axis} = back.tip.{axis}" for axis in "xyz"]
    start = {"phi0": 0.3, "phi0_dot": 2.0, "speed": 3.0, "psi1": 1.2, "phi1": 2.8, "psi1_dot": 0.4}
    scene = table(SKI, links, constraints=rows, start=start)
    run = vlmb.simulate({**scene, "run": {**TIGHT, "gain": 0.0}}, duration=0.5)
    assert run.status == "finished", run.message
    for row in rows:
        assert np.abs(run.residuals[row].position).max() < 1e-8 and np.abs(run.residuals[row].velocity).max() < 1e-8
    assert np.abs(run["phi0"][-1] - run["phi0"][0]) > 0.1
    assert np.abs(run["balance"]).max() <= 1e-8 * run["kinetic"].max()


def test_a_leg_on_an_anchor_stands_still_where_it_is_balanced() -> None:
    """A ski at rest with a leg upright on a binding: the normal force acts between the two weights."""
    leg = {"name": "leg", "anchor": [0.2, -0.1, 0.3], "rod": {"length": 1.0, "mass": 20.0}}
    run = vlmb.simulate(table({**SKI, "com_offset": 0.0}, [leg], start={"psi1": math.pi / 2}), duration=0.01)
    weight = 9.81 * 20.0
    assert run.reactions["normal"][0] == pytest.approx(9.81 * 25.0)
    assert run.reactions["roll_moment"][0] == pytest.approx(-0.1 * weight)
    assert run.reactions["pitch_moment"][0] == pytest.approx(-0.2 * weight)
