"""Links in upright planes along a ski: beside mass points written down, and in both engines, in every form of the knife edge."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.anchored import anchored
from tests.core.edge import edge_force
from tests.reference.particles import Particles
from tests.small_scenes import ANY_LENGTH, FIXED, SKI, TIGHT, Table, bent, link, scene, table
from tests.system.test_core_rows import programme, shares
from vlmb.core.tree import AT_P, AT_V
from vlmb.system.core_engine import CoreEngine
from vlmb.system.engines import make_engine
from vlmb.system.system import make_system

FORMS = ("reduction", "multiplier", "projection")
HEAVY = {**SKI, "mass": 4.0, "inertia": 0.7, "com_offset": 0.15}
ODD = {"length": 0.5, "mass": 2.0, "com": 0.1, "inertia": 0.3}
ASIDE = [0.3, -0.4, 0.2]
SCENES: dict[str, Table] = {
    "one link": table(HEAVY, [link("a", parent="base", rod=ODD)], plane=True, slope=0.3),
    "two links": table(HEAVY, [link("a", parent="base"), link("b", parent="a", rod=ODD)], plane=True, slope=0.3),
    "beside the axis": table(HEAVY, [link("a", parent="base", anchor=ASIDE, lower=FIXED)], plane=True, slope=0.3),
    "a tree on anchors": anchored("ski", plane=True),
}


def state_of(names: tuple[str, ...], seed: int) -> tuple[dict[str, float], dict[str, float]]:
    """Coordinates and rates of a ski that does not slip."""
    random = np.random.default_rng(seed)
    values = {name: random.uniform(0.1, 0.4) if name.startswith("xi") else random.uniform(-2.5, 2.5) for name in names}
    rates = {f"{name}_dot": random.uniform(-1.5, 1.5) for name in names}
    speed = rates["x_dot"]
    return values, rates | {"x_dot": speed * math.cos(values["phi0"]), "y_dot": speed * math.sin(values["phi0"])}


def by_mass_points(made: Table, values: dict[str, float], rates: dict[str, float]) -> tuple[dict[str, float], float]:
    """Second derivatives by coordinate, and the force of the edge: M a + h = Q + J' f, J a = phi0' speed."""
    particles = Particles(made)
    matrix, bias = particles.equations(values, rates)
    names, scene = particles.names, vlmb.Scene.from_dict(made)
    forces, row = np.zeros(len(names)), np.zeros(len(names))
    for i, entry in enumerate(scene.links):
        for side, segment in ((1, entry.lower), (2, entry.upper)):
            name = f"xi{i + 1}_{side}"
            if name in names:
                off, rate = segment.rest_length - values[name], rates[f"{name}_dot"]
                forces[names.index(name)] = segment.stiffness * off - segment.damping * rate
    cosine, sine = math.cos(values["phi0"]), math.sin(values["phi0"])
    row[[names.index("x"), names.index("y")]] = -sine, cosine
    turned = rates["phi0_dot"] * (cosine * rates["x_dot"] + sine * rates["y_dot"])
    whole = np.block([[matrix, -row[:, None]], [row[None], np.zeros((1, 1))]])
    found = np.linalg.solve(whole, [*(forces - bias), turned])
    return dict(zip(names, found[:-1].tolist(), strict=True)), float(found[-1])


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", SCENES)
def test_accelerations_and_the_edge_are_those_of_mass_points(name: str, form: str) -> None:
    mechanism = vlmb.build(SCENES[name])
    system = make_system(mechanism, knife_edge=form)
    plan, tree = system.core_plan, system.core_plan.arrays.tree
    for draw in range(4):
        values, rates = state_of(mechanism.coordinate_names, draw)
        right, edge = by_mass_points(SCENES[name], values, rates)
        engine = make_engine(system, list(values.values()))
        assert isinstance(engine, CoreEngine)
        y = engine.pack(mechanism.state(values, rates))
        dy = engine.evaluate(0.0, y)[plan.positions :]
        ahead = math.cos(values["phi0"]) * right["x"] + math.sin(values["phi0"]) * right["y"]
        found, expected = [dy[0], dy[1 if form == "reduction" else 2]], [ahead, right["phi0"]]
        for row, i in enumerate(plan.arrays.order):
            at, to = tree.link[row, AT_P], tree.link[row, AT_V]
            assert (y[at + 1], dy[to + 1]) == (0.0, 0.0)  # the frame of the ski: nothing goes sideways
            found.append(y[at] * dy[to + 2] - y[at + 2] * dy[to])
            expected.append(right[f"psi{i + 1}"])
            for side in (1, 2):
                if f"xi{i + 1}_{side}" in right:
                    found.append(dy[plan.arrays.length_at(i, side)[1] - plan.positions])
                    expected.append(right[f"xi{i + 1}_{side}"])
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
        felt = edge_force(engine.plan.plant.tree, engine.memory.scratch.rows) if form == "reduction" else shares(engine)[1][0]
        assert felt == pytest.approx(edge, rel=1e-9, abs=1e-9 * np.abs(expected).max())


def skier(**keys: Any) -> vlmb.Scene:
    """Legs, trunk and an arm beside the axis of the ski; springs, a hinge torque, laws of time and of the state."""
    law = {"motion": "prescribed", "law": "0.2 + 0.05*sin(5*t)"}
    links = [
        link("legs", parent="base", lower={"length": 0.3, "stiffness": 2e3, "damping": 9.0, "limits": ANY_LENGTH}),
        link("trunk", parent="legs", upper=law), link("pole", parent="base", anchor=ASIDE, upper=FIXED, lower=FIXED),
        link("arm", parent="trunk", parent_point="rod_start"),
    ]  # fmt: skip
    forces = [
        {"between": ["legs", "trunk"], "stiffness": 60.0, "damping": 2.0, "rest": -0.4},
        {"between": ["heading", "pole"], "stiffness": 40.0, "damping": 1.0, "rest": 1.2},
        {"on": "T_arm", "law": "3*sin(4*t) - 2*psi4_dot"}, {"on": "M_psi1", "law": "30*cos(3*t)"}, {"on": "F_x", "law": 4.0},
        {"on": "M_phi0", "law": "0.5*sin(t) - 0.1*legs.tip.y"},
    ]  # fmt: skip
    start = {"psi1": 1.2, "psi2": 1.0, "psi3": 1.3, "psi4": 0.2, "phi0": 0.4, "phi0_dot": 0.8, "speed": 2.5, "psi2_dot": -0.4}
    return scene(SKI, links, plane=True, **{"slope": 0.2, "start": start, "forces": forces, **keys})


PLANS = {
    "forces": {},
    "ideal rows": {"constraints": ["trunk.tip.z = legs.tip.z + 0.6", "psi4_dot = 0.3*phi0_dot"]},
    "a programme": {
        "forces": [],
        "programme": programme(
            ["tan(phi0) = 0.5*cos(x)", "psi1 = 1.2", "psi2 = 1.0"], ["M_phi0", "M_psi1", "T_trunk", "M_psi4"]
        ),
    },
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", PLANS)
def test_both_engines_give_the_same_motion(name: str, form: str) -> None:
    made = skier(**PLANS[name])
    assert vlmb.simulate(made, duration=0.01, knife_edge=form).engine == "core"
    core, other = (vlmb.simulate(made, duration=0.6, knife_edge=form, engine=engine) for engine in ("core", "pinocchio"))
    assert core.status == other.status == "finished", core.message + other.message
    for coordinate in core.mechanism.layout.names:
        np.testing.assert_allclose(core[coordinate], other[coordinate], rtol=0, atol=1e-8)
    for what in ("controls", "reactions", "work_by_force"):
        ours, theirs = getattr(core, what), getattr(other, what)
        for entry in theirs:
            size = max(1.0, np.abs(theirs[entry]).max())
            np.testing.assert_allclose(ours[entry], theirs[entry], rtol=0, atol=1e-6 * size, err_msg=entry)
    for entry in ("legs", "arm"):
        np.testing.assert_allclose(core.hinge_force(entry), other.hinge_force(entry), rtol=0, atol=1e-4)
    for what in ("kinetic", "potential", "energy", "dissipated"):
        np.testing.assert_allclose(core[what], other[what], rtol=0, atol=1e-7 * max(1.0, np.abs(other[what]).max()))
    assert np.abs(core["balance"]).max() < 1e-6 * core["kinetic"].max()


@pytest.mark.parametrize("method", ["dop853", "adams", "radau", "gauss", "rk4"])
def test_no_method_leaves_the_plane(method: str) -> None:
    run = vlmb.simulate(bent(SKI, 2, plane=True), duration=0.3, method=method, rtol=1e-8, atol=1e-9)
    assert run.engine == "core" and run.status == "finished", run.message
    plan = run.system.core_plan
    for row in plan.arrays.tree.link:
        for at in (int(row[AT_P]) + 1, plan.positions + int(row[AT_V]) + 1):
            assert not run.states[:, at].any()


def test_energy_stays_over_a_long_run() -> None:
    made = bent(SKI, 2, plane=True, slope=0.1, run={**TIGHT, "rtol": 1e-12})
    run = vlmb.simulate(made, duration=20.0)
    assert run.status == "finished", run.message
    assert np.abs(run["balance"]).max() < 1e-8 * run["kinetic"].max()


def test_a_fall_and_turns_are_told_alike() -> None:
    """A link that swings over the ski and onto the snow; psi counts on past a half turn."""
    start = {"psi1": 1.4, "psi1_dot": 1.5, "phi0_dot": 0.7, "speed": 2.0}
    made = scene(SKI, [link("a")], plane=True, start=start, run={**TIGHT, "fall": True})
    core, other = (vlmb.simulate(made, duration=5.0, engine=engine) for engine in ("core", "pinocchio"))
    assert core.status == other.status == "stopped", core.message + other.message
    assert core.message.partition(":")[2] == other.message.partition(":")[2]
    assert core.t[-1] == pytest.approx(other.t[-1], abs=1e-8)
    assert core["psi1"][-1] == pytest.approx(other["psi1"][-1], abs=1e-7)
    assert core["psi1"][-1] > 3.0


@pytest.mark.parametrize("form", FORMS)
def test_a_turn_to_the_other_side_is_the_mirror_image(form: str) -> None:
    """200 links on the axis of a ski: phi0'' changes its sign, nothing else does."""
    system = make_system(vlmb.build(scene(SKI, 200, plane=True)), knife_edge=form)
    values = {name: 0.25 if name.startswith("xi") else 0.3 for name in system.mechanism.coordinate_names}
    found, yaw = [], 1 if form == "reduction" else 2
    for turn in (0.6, -0.6):
        engine = make_engine(system, list(values.values()))
        state = system.mechanism.state(values, {"phi0_dot": turn, "x_dot": math.cos(0.3), "y_dot": math.sin(0.3)})
        found.append(engine.evaluate(0.0, engine.pack(state))[system.core_plan.positions :])
    assert found[0][yaw] == pytest.approx(-found[1][yaw], rel=1e-12) and abs(found[0][yaw]) > 1e-3
    size = np.abs(found[0]).max()
    np.testing.assert_allclose(np.delete(found[0], yaw), np.delete(found[1], yaw), rtol=0, atol=1e-12 * size)
