"""Sub-chains give the accelerations of the one model at a cost linear in the links, and say what they do not serve."""

from __future__ import annotations

import json
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from vlmb.model.long_chains import LONG_CHAIN, obstacle
from vlmb.system.bars import chain_energies
from vlmb.system.subchains import SubChains

import vlmb
from tests.reference.witness import Witness
from tests.small_scenes import ANY_LENGTH, FIXED, FLYING, PIVOT, SKI, link, random_state, scene, table
from vlmb.model.memory import make_data
from vlmb.system.constrained import SIDEWAYS
from vlmb.system.system import make_system

RESULTS = Path(__file__).resolve().parents[2] / "benchmarks" / "results"


def mixed(count: int) -> list[dict[str, Any]]:
    """Links of different sizes: some damped, some stiff, some hinges without mass between fixed segments."""
    links = []
    for i in range(count):
        changes: dict[str, Any] = {
            "rod": {"length": 0.2 + 0.01 * i, "mass": 1.0 + 0.3 * (i % 4)},
            "tip_mass": 0.3 + 0.1 * (i % 3),
        }
        if i % 5 == 1:
            changes["lower"] = {"length": 0.2, "stiffness": 900.0, "damping": 7.0}
        if i % 5 == 2:
            changes |= {"upper": FIXED, "tip_mass": None}
        if i % 5 == 3:
            changes["lower"] = FIXED
        links.append(link(f"link{i + 1}", **changes))
    return links


MASSLESS = {"kind": "free"}
CHAINS = [
    (PIVOT, False), (PIVOT, True), (SKI, False), (FLYING, False), (FLYING, True), (MASSLESS, False), (MASSLESS, True),
]  # fmt: skip
NAMES = ["pivot", "pivot in a plane", "ski", "flying", "flying in a plane", "massless", "massless in a plane"]


def any_link(random: np.random.Generator, name: str, held: bool) -> dict[str, Any]:
    """A link of any kind: segments free, damped or fixed, a mass in its tip or none, a rod of any make."""

    def segment(fixed: bool) -> dict[str, Any]:
        if fixed:
            return {"length": random.uniform(0.1, 0.3), "motion": "fixed"}
        damping = random.choice([0.0, 7.0])
        return {"length": 0.2, "stiffness": random.uniform(0.0, 2000.0), "damping": damping, "limits": ANY_LENGTH}

    rods = ({}, {}, {"com": 0.1, "inertia": 0.3}, {"inertia": 0.0}, {"mass": 0.0})
    lower, upper = held or random.random() < 0.4, random.random() < 0.4
    rod = {
        "length": random.uniform(0.2, 0.6),
        "mass": random.uniform(0.5, 3.0),
        **rods[random.integers(5 if lower or upper else 3)],
    }
    tip = random.uniform(0.1, 2.0) if random.random() < 0.6 or not rod["mass"] else None
    return link(name, rod=rod, lower=segment(lower), upper=segment(upper), tip_mass=tip)


def both(made: vlmb.Scene, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations of the one model, solved densely, and of the sub-chains."""
    mechanism = vlmb.build(made)
    dense = make_system(mechanism, route="dense").workspace()
    y = dense.pack(random_state(mechanism, seed, sideways=False))
    q, v = dense.unpack(0.0, y)
    return dense.rhs(0.0, y)[dense.nq : dense.nq + dense.nv].copy(), SubChains(mechanism).accelerations(q, v)


@pytest.mark.parametrize(("base", "plane"), CHAINS, ids=NAMES)
@pytest.mark.parametrize("count", [1, 2, 11])
def test_accelerations_are_those_of_the_one_model(base: dict[str, Any], plane: bool, count: int) -> None:
    links = mixed(count)
    if base is MASSLESS:
        links[0]["lower"] = FIXED
    made = scene(base, links, plane=plane, slope=0.2)
    for seed in range(3):
        one, ours = both(made, seed)
        np.testing.assert_allclose(ours, one, rtol=0, atol=1e-10 * np.abs(one).max())


@pytest.mark.parametrize(("base", "plane"), CHAINS, ids=NAMES)
def test_accelerations_of_any_chain_are_those_of_the_one_model(base: dict[str, Any], plane: bool) -> None:
    """As far as its mass matrix gives them: to rounding times its condition."""
    random = np.random.default_rng(7)
    compared = 0
    for seed in range(40):
        links = [any_link(random, f"link{i + 1}", base is MASSLESS and i == 0) for i in range(random.integers(1, 13))]
        made = scene(base, links, plane=plane, slope=-0.1)
        mechanism = vlmb.build(made)
        q = random_state(mechanism, seed, sideways=False).q
        condition = make_system(mechanism, route="dense").workspace().diagnostics.conditioning(q)[0]
        if condition > 1e10:
            assert SubChains(mechanism).conditioning(q)[0] > 1e-6 * min(condition, 1e16)
            continue
        one, ours = both(made, seed)
        bound = max(1e-11, 1e-16 * condition) * np.abs(one).max()
        np.testing.assert_allclose(ours, one, rtol=0, atol=bound, err_msg=str(made.to_dict()))
        compared += 1
    assert compared > 20


@pytest.mark.parametrize("links", [20, 50])
def test_accelerations_of_long_chains(links: int) -> None:
    one, ours = both(scene(PIVOT, links), 0)
    np.testing.assert_allclose(ours, one, rtol=0, atol=1e-7 * np.abs(one).max())


@pytest.mark.parametrize("base", [PIVOT, FLYING], ids=["pivot", "flying"])
def test_accelerations_do_not_depend_on_the_unit_of_mass(base: dict[str, Any]) -> None:
    found = []
    for unit in (1.0, 1e-10, 1e10):
        random, links = np.random.default_rng(3), []
        for i in range(40):
            made = any_link(random, f"link{i + 1}", False)
            for entry in (made["rod"], made["lower"], made["upper"], made):
                entry |= {
                    key: unit * entry[key] for key in ("mass", "inertia", "stiffness", "damping", "tip_mass") if entry.get(key)
                }
            links.append(made)
        mechanism = vlmb.build(scene(base | ({"mass": unit * base["mass"]} if "mass" in base else {}), links))
        found.append(SubChains(mechanism).accelerations(*random_state(mechanism, 2)).copy())
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], rtol=0, atol=1e-11 * np.abs(found[0]).max())


def test_spin_about_the_links_axes_acts_on_nothing() -> None:
    mechanism = vlmb.build(scene(FLYING, mixed(6)))
    (q, v), chains = random_state(mechanism, 1), SubChains(mechanism)
    lengths = [at.v for entry in mechanism.layout.links for at in (entry.lower, entry.upper) if at.joint]

    def motion(v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """d'' of the directions by a difference of d' along the motion, and xi''."""
        vdot, h = chains.accelerations(q, v).copy(), 1e-5
        rates = [
            vlmb.model.coordinates.kinematics(
                mechanism.layout, pin.integrate(mechanism.model, q, s * v + 0.5 * s * s * vdot), v + s * vdot
            )
            for s in (h, -h)
        ]
        return (rates[0].direction_rates - rates[1].direction_rates) / (2.0 * h), vdot[lengths]

    spinning, turns = v.copy(), vlmb.model.coordinates.kinematics(mechanism.layout, q, v).rotations
    third, fourth = mechanism.layout.links[2:4]
    spinning[third.v] += 3.0
    spinning[fourth.v : fourth.v + 3] -= 3.0 * turns[3].T @ turns[2, :, 0]
    for plain, spun in zip(motion(v), motion(spinning), strict=True):
        np.testing.assert_allclose(spun, plain, rtol=0, atol=1e-6 * np.abs(plain).max())


@pytest.mark.parametrize("turn", [0.0, 1e-7])
def test_a_massless_hinge_between_lined_up_free_segments_is_named(turn: float) -> None:
    links = [link(f"link{i + 1}", tip_mass=None if i == 2 else 1.0) for i in range(5)]
    mechanism = vlmb.build(scene(PIVOT, links))
    values = {f"psi{i + 1}": 0.4 * i for i in range(5)} | {f"phi{i + 1}": 0.0 for i in range(5)}
    values |= {f"xi{i + 1}_{k}": 0.2 for i in range(5) for k in (1, 2)} | {"psi4": 0.8 + turn}
    (q, v), chains = mechanism.state(values), SubChains(mechanism)
    condition, weakest = chains.conditioning(q)
    assert condition > 1e12
    assert weakest == ["the hinge at the tip of 'link3'"]
    assert make_system(mechanism, route="dense").workspace().diagnostics.conditioning(q)[0] > 1e12
    workspace = make_system(mechanism, route="subchains").workspace()
    assert "link3" in str(workspace.diagnostics.singular(q))
    if not turn:
        at = mechanism.layout.links[3].q
        q[at : at + 4] = 0.0, 0.0, 0.0, 1.0
        with pytest.raises(vlmb.SingularError, match="give 'link3' a tip_mass"):
            workspace.rhs(0.0, np.concatenate([q, v]))


@pytest.mark.parametrize("rigid", [False, True])
def test_what_is_not_finite_is_told_and_leaves_nothing_behind(rigid: bool) -> None:
    links = [link(f"link{i + 1}", **({"lower": FIXED, "upper": FIXED} if rigid else {})) for i in range(4)]
    mechanism = vlmb.build(scene(PIVOT, links))
    q, v = random_state(mechanism)
    workspace = make_system(mechanism, route="subchains").workspace()
    y = np.concatenate([q, v])
    before = workspace.rhs(0.0, y).copy()
    with np.errstate(all="ignore"), pytest.raises(vlmb.VlmbError, match="finite"):
        workspace.rhs(0.0, np.concatenate([q, np.full_like(v, np.nan)]))
    with np.errstate(all="ignore"), pytest.raises(vlmb.VlmbError):
        workspace.rhs(0.0, np.concatenate([np.full_like(q, np.nan), v]))
    np.testing.assert_array_equal(workspace.rhs(0.0, y), before)


def test_a_motion_agrees_with_mass_points_and_keeps_its_energy() -> None:
    links = [link(f"link{i + 1}", rod={"length": 0.3, "mass": 1.0 + 0.2 * i}) for i in range(10)]
    start = {f"psi{i + 1}": 0.9 - 0.2 * i for i in range(len(links))} | {f"phi{i + 1}": 0.3 * i for i in range(len(links))}
    start |= {"phi1_dot": 1.0, "psi4_dot": -0.7, "xi2_1_dot": 0.3}
    data = table(PIVOT, links, start=start, slope=0.1)
    t = np.linspace(0.0, 0.2, 5)
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(data), duration=0.2, t_eval=t, route="subchains")
    assert trajectory.stats["route"] == "subchains"
    plain = {key: value for key, value in data.items() if key != "run"}
    for entry in plain["links"]:
        for side in ("lower", "upper"):
            entry[side] = {key: value for key, value in entry[side].items() if key != "limits"}
    result = Witness(plain).simulate(t, rtol=1e-12, atol=1e-13)
    for i in range(len(links)):
        gap = np.abs(trajectory.position(f"link{i + 1}", "tip") - result.position(f"link{i + 1}", "tip")).max()
        assert gap < 1e-8, f"link{i + 1}"
    assert np.abs(trajectory["balance"]).max() < 1e-8 * trajectory["kinetic"].max()


def test_a_damped_chain_on_the_ski_loses_what_its_dampers_take() -> None:
    start = {f"psi{i + 1}": 1.2 - 0.1 * i for i in range(11)} | {"phi0_dot": 0.5, "speed": 2.0, "psi3_dot": -0.5}
    made = scene(SKI, mixed(11), start=start)
    runs = [vlmb.simulate(made, duration=0.1, t_eval=[0.0, 0.1], route=route) for route in ("subchains", "dense")]
    assert runs[0].work_by_force["dissipation"][-1] > 1e-4
    for name in ("energy", "balance", "dissipated", "x", "phi0", "speed"):
        assert runs[0][name][-1] == pytest.approx(runs[1][name][-1], abs=1e-7)
    assert runs[0].v[-1, SIDEWAYS] == 0.0
    np.testing.assert_allclose(runs[0].position("link11"), runs[1].position("link11"), atol=1e-8)


@pytest.mark.parametrize("base", [PIVOT, SKI, FLYING], ids=["pivot", "ski", "flying"])
def test_energies_of_points_are_those_of_the_model(base: dict[str, Any]) -> None:
    mechanism = vlmb.build(scene(base, mixed(6), slope=0.2))
    states = [random_state(mechanism, seed) for seed in range(3)]
    q, v = np.array([s.q for s in states]), np.array([s.v for s in states])
    kinetic, potential = chain_energies(mechanism, q, v)
    model, data = mechanism.model, make_data(mechanism.model)
    for i in range(3):
        assert kinetic[i] == pytest.approx(pin.computeKineticEnergy(model, data, q[i], v[i]), rel=1e-12)
        assert potential[i] == pytest.approx(pin.computePotentialEnergy(model, data, q[i]), rel=1e-12)


REFUSED = {
    "branch": scene(PIVOT, [link("a"), link("b"), link("c", parent="a")]),
    "`constraints`": scene(PIVOT, 2, constraints=["psi1 = psi2"], start={"psi1": 1.0, "psi2": 1.0}),
    "`forces`": scene(PIVOT, 2, forces=[{"on": "M_psi1", "law": 1.0}]),
    "prescribed": scene(PIVOT, [link("a"), link("b", lower={"motion": "prescribed", "law": "0.3"})]),
    "plane = true": scene(SKI, 2, plane=True),
    "ends coincide": scene(
        PIVOT, [link("a", rod={"length": 0.0, "mass": 1.0, "inertia": 0.1}, lower=None, upper=None), link("b")]
    ),
}


@pytest.mark.parametrize("word", REFUSED)
def test_what_cannot_be_cut_is_named(word: str) -> None:
    assert word in str(obstacle(REFUSED[word]))
    with pytest.raises(vlmb.SceneError, match="subchains"):
        SubChains(vlmb.build(REFUSED[word]))


def test_controls_and_other_forms_of_the_knife_edge_are_refused() -> None:
    with pytest.raises(vlmb.SceneError, match="subchains"):
        vlmb.simulate(scene(SKI, 2), route="subchains", knife_edge="multiplier")
    with pytest.raises(vlmb.SceneError, match="subchains"):
        vlmb.simulate(scene(PIVOT, 2), route="subchains", control=lambda t, view: {"M_psi1": 1.0})


def test_a_chain_whose_one_model_does_not_fit_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    count = 3 * LONG_CHAIN
    monkeypatch.setattr(vlmb.model.memory, "_available_memory", lambda: 2**26)
    start = {f"psi{i + 1}": -1.0 - 0.01 * i for i in range(count)}
    made = scene(PIVOT, count, start=start)
    trajectory = vlmb.simulate(made, duration=0.01, t_eval=[0.0, 0.01], rtol=1e-9, atol=1e-11)
    assert trajectory.status == "finished"
    assert trajectory.stats["route"] == "subchains"
    assert np.abs(trajectory["balance"]).max() < 1e-6 * trajectory["kinetic"].max()
    with pytest.raises(vlmb.VlmbError, match="GiB are free"):
        _ = make_data(trajectory.mechanism.model)
    with pytest.raises(vlmb.VlmbError, match="GiB are free"):
        vlmb.build(scene(PIVOT, count, forces=[{"on": "M_psi1", "law": 1.0}]))


def test_a_thousand_links_take_ten_times_the_memory_of_a_hundred() -> None:
    taken = []
    for count in (100, 1000):
        mechanism = vlmb.build(scene(PIVOT, count))
        q, v = random_state(mechanism)
        tracemalloc.start()
        SubChains(mechanism).accelerations(q, v)
        taken.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert taken[1] < 11.0 * taken[0] < 1e8


# What the measurements say -------------------------------------------------------------------------------------------


def test_bounds_of_the_recursive_route_follow_from_the_measurements() -> None:
    """Within them it is faster and no less exact; beyond, its error takes over."""
    data = json.loads((RESULTS / "evaluation.json").read_text(encoding="utf-8"))
    for base in ("pivot", "ski"):
        for text, seconds in data["time"][base].items():
            n, error = int(text), data["error"][base][text]
            if "dense" not in seconds:  # does not fit into one model
                continue
            if n <= LONG_CHAIN:
                assert seconds["recursive"] < seconds["dense"], (base, n)
                assert error["recursive"] < 2.0 * max(error["dense"], 1e-14), (base, n)
            else:
                assert error["recursive"] > 10.0 * error["dense"], (base, n)


def test_the_bound_of_one_model_follows_from_the_measurements() -> None:
    """Up to LONG_CHAIN sub-chains are slower than one pass; beyond, they win three digits beside all, and time beside dense."""
    data = json.loads((RESULTS / "evaluation.json").read_text(encoding="utf-8"))
    assert data["long_chain"] == LONG_CHAIN
    for text, seconds in data["time"]["pivot"].items():
        n, error = int(text), data["error"]["pivot"][text]
        if "dense" in seconds:
            if n > LONG_CHAIN:
                assert seconds["subchains"] < seconds["dense"], n
                assert error["subchains"] < 1e-3 * min(error["recursive"], error["dense"]), n
            else:
                assert seconds["subchains"] > seconds["recursive"], n
        assert error.get("subchains", 0.0) < 1e-13, n
    longest = [data["time"]["pivot"][text]["subchains"] for text in ("100", "1000")]
    assert longest[1] < 15.0 * longest[0]
