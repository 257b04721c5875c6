"""Chains of up to a thousand links run in the compiled core: exact, at a cost and in memory linear in the links."""

from __future__ import annotations

import re
import tracemalloc
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import vlmb
from tests.reference.witness import Witness
from tests.small_scenes import ANY_LENGTH, FIXED, FLYING, PIVOT, SKI, link, random_state, scene, table
from tests.system.test_engines import accelerations
from vlmb.model.memory import make_data
from vlmb.system.engines import make_engine
from vlmb.system.system import make_system

MASSLESS = {"kind": "free"}
CHAINS = [
    (PIVOT, False), (PIVOT, True), (SKI, False), (FLYING, False), (FLYING, True), (MASSLESS, False), (MASSLESS, True),
]  # fmt: skip
NAMES = ["pivot", "pivot in a plane", "ski", "flying", "flying in a plane", "massless", "massless in a plane"]


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
    """Accelerations by Pinocchio's mass matrix, and by the core."""
    mechanism = vlmb.build(made)
    ours, theirs, _, _ = accelerations(make_system(mechanism), random_state(mechanism, seed, sideways=False), 0.0)
    return theirs, ours


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
        condition = make_system(mechanism).workspace().diagnostics.conditioning(q)[0]
        if condition > 1e10:
            continue
        one, ours = both(made, seed)
        bound = max(1e-11, 1e-15 * condition) * np.abs(one).max()
        np.testing.assert_allclose(ours, one, rtol=0, atol=bound, err_msg=str(made.to_dict()))
        compared += 1
    assert compared > 20


@pytest.mark.parametrize("links", [20, 50])
def test_accelerations_of_long_chains(links: int) -> None:
    """The core is right to the last digits (beside 50 digits); the mass matrix of the one model loses some."""
    one, ours = both(scene(PIVOT, links), 0)
    np.testing.assert_allclose(ours, one, rtol=0, atol=1e-9 * np.abs(one).max())


@pytest.mark.parametrize("base", [PIVOT, FLYING], ids=["pivot", "flying"])
def test_accelerations_do_not_depend_on_the_unit_of_mass(base: dict[str, Any]) -> None:
    found = []
    for unit in (1.0, 2.0**-33, 2.0**33):
        random, links = np.random.default_rng(3), []
        for i in range(40):
            made = any_link(random, f"link{i + 1}", False)
            for entry in (made["rod"], made["lower"], made["upper"], made):
                entry |= {
                    key: unit * entry[key] for key in ("mass", "inertia", "stiffness", "damping", "tip_mass") if entry.get(key)
                }
            links.append(made)
        mechanism = vlmb.build(scene(base | ({"mass": unit * base["mass"]} if "mass" in base else {}), links))
        engine = make_engine(make_system(mechanism), np.zeros(len(mechanism.layout.names)).tolist())
        found.append(engine.evaluate(0.0, engine.pack(random_state(mechanism, 2)))[:-1])  # but for the power of dampers
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], rtol=0, atol=1e-14 * np.abs(found[0]).max())


@pytest.mark.parametrize("turn", [0.0, 1e-7])
def test_a_massless_hinge_between_lined_up_free_segments_is_named(turn: float) -> None:
    links = [link(f"link{i + 1}", tip_mass=None if i == 2 else 1.0) for i in range(5)]
    start = {f"psi{i + 1}": 0.4 * i for i in range(5)} | {"psi4": 0.8 + turn}
    made = scene(PIVOT, links, start=start)
    with pytest.raises(vlmb.SingularError, match="link3"):
        vlmb.check(made)
    if not turn:
        mechanism = vlmb.build(made)
        values = start | {f"phi{i + 1}": 0.0 for i in range(5)} | {f"xi{i + 1}_{k}": 0.2 for i in range(5) for k in (1, 2)}
        core = make_engine(make_system(mechanism), [0.0] * len(mechanism.layout.names))
        y = core.pack(mechanism.state(values))
        fourth = make_system(mechanism).core_plan.arrays.tree.link[2:4, 2]
        y[fourth[1] : fourth[1] + 3] = y[fourth[0] : fourth[0] + 3]
        with pytest.raises(vlmb.SingularError, match=r"singular.*'link3'.*give 'link3' a tip_mass"):
            core.evaluate(0.0, y)


@pytest.mark.parametrize("rigid", [False, True])
def test_what_is_not_finite_is_told_and_leaves_nothing_behind(rigid: bool) -> None:
    links = [link(f"link{i + 1}", **({"lower": FIXED, "upper": FIXED} if rigid else {})) for i in range(30)]
    mechanism = vlmb.build(scene(PIVOT, links))
    engine = make_engine(make_system(mechanism), [0.0] * len(mechanism.layout.names))
    y = engine.pack(random_state(mechanism))
    before = engine.evaluate(0.0, y)
    for broken in (np.nan, np.inf):
        for at in (5, len(y) - 2):
            bad = y.copy()
            bad[at] = broken
            with pytest.raises(vlmb.VlmbError, match="finite"):
                engine.evaluate(0.0, bad)
    np.testing.assert_array_equal(engine.evaluate(0.0, y), before)


def test_a_motion_agrees_with_mass_points_and_keeps_its_energy() -> None:
    links = [link(f"link{i + 1}", rod={"length": 0.3, "mass": 1.0 + 0.2 * i}) for i in range(10)]
    start = {f"psi{i + 1}": 0.9 - 0.2 * i for i in range(len(links))} | {f"phi{i + 1}": 0.3 * i for i in range(len(links))}
    start |= {"phi1_dot": 1.0, "psi4_dot": -0.7, "xi2_1_dot": 0.3}
    data = table(PIVOT, links, start=start, slope=0.1)
    t = np.linspace(0.0, 0.2, 5)
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(data), duration=0.2, t_eval=t)
    assert trajectory.stats["engine"] == "core"
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
    runs = [vlmb.simulate(made, duration=0.1, t_eval=[0.0, 0.1], engine=engine) for engine in ("core", "pinocchio")]
    assert runs[0].work_by_force["dissipation"][-1] > 1e-4
    for name in ("energy", "balance", "dissipated", "x", "phi0", "speed"):
        assert runs[0][name][-1] == pytest.approx(runs[1][name][-1], abs=1e-7)
    np.testing.assert_allclose(runs[0].position("link11"), runs[1].position("link11"), atol=1e-8)


@pytest.mark.parametrize("base", [PIVOT, SKI, FLYING], ids=["pivot", "ski", "flying"])
def test_energies_are_those_of_the_model(base: dict[str, Any]) -> None:
    start = {f"psi{i + 1}": 1.2 - 0.3 * i for i in range(6)} | {"psi1_dot": 0.5, "phi2_dot": 1.1}
    trajectory = vlmb.simulate(scene(base, mixed(6), slope=0.2, start=start), duration=0.1, t_eval=[0.0, 0.05, 0.1])
    model, data = trajectory.mechanism.model, make_data(trajectory.mechanism.model)
    for q, v, kinetic, potential in zip(trajectory.q, trajectory.v, trajectory["kinetic"], trajectory["potential"], strict=True):
        assert kinetic == pytest.approx(pin.computeKineticEnergy(model, data, q, v), rel=1e-12)
        assert potential == pytest.approx(pin.computePotentialEnergy(model, data, q), rel=1e-12)


# Hundreds of links ---------------------------------------------------------------------------------------------------


def long_chain(count: int, base: dict[str, Any] = PIVOT, **keys: Any) -> vlmb.Scene:
    """A chain that hangs a little askew, under way."""
    start = {f"psi{i + 1}": -1.0 - 0.3 * np.sin(0.1 * i) for i in range(count)} | {"phi1_dot": 0.3}
    return scene(base, [link(f"link{i + 1}") for i in range(count)], **{"start": start, **keys})


@pytest.mark.parametrize("count", [50, 200, 1000])
@pytest.mark.parametrize("base", [PIVOT, FLYING], ids=["pivot", "flying"])
def test_a_long_chain_keeps_its_energy(count: int, base: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a pinocchio.Data, which has no room for it."""
    monkeypatch.setattr(vlmb.model.memory, "_available_memory", lambda: 2**22)
    monkeypatch.setattr(vlmb.model.memory.pin, "Data", lambda model: pytest.fail("Data was allocated"))
    made = long_chain(count, base)
    assert "both engines" not in vlmb.check(made).report
    trajectory = vlmb.simulate(made, duration=0.02, t_eval=[0.0, 0.01, 0.02], rtol=1e-9, atol=1e-11)
    assert trajectory.status == "finished", trajectory.message
    assert np.abs(trajectory["balance"]).max() < 1e-8 * trajectory["kinetic"].max()
    if base is FLYING:
        assert trajectory["com.z"][-1] - trajectory["com.z"][0] == pytest.approx(
            trajectory["com.z_dot"][0] * 0.02 - 0.5 * 9.81 * 0.02**2, abs=1e-9
        )
    with pytest.raises(vlmb.VlmbError, match="GiB are free"):
        vlmb.simulate(made, duration=0.01, engine="pinocchio")


def test_a_long_chain_falls_on_the_snow() -> None:
    """A row of 100 links without springs tips over on the ski; the point that the run's end names is on the snow."""
    rigid = {"rod": {"length": 0.02, "mass": 0.1}, "lower": None, "upper": {"length": 0.01, "motion": "fixed"}, "tip_mass": 0.05}
    start = {f"psi{i + 1}": 0.2 for i in range(100)} | {f"phi{i + 1}": 0.4 for i in range(100)}
    data = table(SKI, [link(f"link{i + 1}", **rigid) for i in range(100)], start=start)
    data["run"] = {"rtol": 1e-9, "atol": 1e-10}
    trajectory = vlmb.simulate(data, duration=2.0)
    assert trajectory.status == "stopped"
    found = re.search(r"fall: (link\d+\.\w+) reached the snow", trajectory.message)
    assert found is not None, trajectory.message
    assert abs(trajectory[f"{found[1]}.z"][-1]) < 1e-9
    heights = [trajectory[f"link{i + 1}.tip.z"] for i in range(100)]
    assert np.min(heights) > -1e-9


def test_a_thousand_links_take_ten_times_the_memory_of_a_hundred() -> None:
    taken = []
    for count in (100, 1000):
        system = make_system(vlmb.build(long_chain(count)))
        tracemalloc.start()
        engine = make_engine(system, [0.0] * len(system.mechanism.layout.names))
        engine.evaluate(0.0, np.array(engine.pack(random_state(system.mechanism))))
        taken.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert taken[1] < 11.0 * taken[0] < 1e8
