"""Sub-chains give the accelerations of the one model at a cost linear in the links, and say what they do not serve."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from small_scenes import FIXED, FLYING, PIVOT, SKI, link, random_state, scene, table
from witness import Witness

import vlmb
from vlmb.constrained import SIDEWAYS
from vlmb.cuts import LONG_CHAIN, LONGEST, PIECE, cuts, obstacle, part
from vlmb.dynamics import RECURSIVE_LINKS, Dynamics
from vlmb.mechanism import data_bytes
from vlmb.subchains import SubChains, chain_energies

RESULTS = Path(__file__).resolve().parents[1] / "benchmarks" / "results"


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


def both(made: vlmb.Scene, size: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations of the one model, solved densely, and of its sub-chains."""
    mechanism = vlmb.build(made)
    dense = Dynamics(mechanism, route="dense")
    y = dense.pack(random_state(mechanism, seed, sideways=False))
    q, v = dense.unpack(0.0, y)
    return dense.rhs(0.0, y)[dense.nq : dense.nq + dense.nv].copy(), SubChains(mechanism, size).accelerations(q, v)


@pytest.mark.parametrize(("base", "plane"), [(PIVOT, False), (PIVOT, True), (SKI, False), (FLYING, False), (FLYING, True)])
@pytest.mark.parametrize("size", [1, 2, 5])
def test_accelerations_are_those_of_the_one_model(base: dict[str, Any], plane: bool, size: int) -> None:
    made = scene(base, mixed(11), plane=plane, slope=0.2)
    assert len(cuts(made, size)) > 1
    for seed in range(3):
        one, cut = both(made, size, seed)
        np.testing.assert_allclose(cut, one, rtol=0, atol=1e-9 * np.abs(one).max())


@pytest.mark.parametrize("links", [20, 50])
def test_accelerations_of_long_chains(links: int) -> None:
    one, cut = both(scene(PIVOT, links), PIECE, 0)
    np.testing.assert_allclose(cut, one, rtol=0, atol=1e-7 * np.abs(one).max())


def test_a_motion_agrees_with_mass_points_and_keeps_its_energy() -> None:
    links = [link(f"link{i + 1}", rod={"length": 0.3, "mass": 1.0 + 0.2 * i}) for i in range(PIECE + 2)]
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
    model, data = mechanism.model, mechanism.data
    for i in range(3):
        assert kinetic[i] == pytest.approx(pin.computeKineticEnergy(model, data, q[i], v[i]), rel=1e-12)
        assert potential[i] == pytest.approx(pin.computePotentialEnergy(model, data, q[i]), rel=1e-12)


def test_pieces_share_all_links_and_all_mass() -> None:
    made = scene(SKI, mixed(23))
    total = made.base.mass + sum(entry.rod.mass + entry.tip_mass for entry in made.links)
    for size in (1, 3, 8, 40):
        pieces = cuts(made, size)
        assert [at for first, last in pieces for at in range(first, last)] == list(range(23))
        parts = [part(made, first, last) for first, last in pieces]
        share = sum(p.base.mass + sum(entry.rod.mass + entry.tip_mass for entry in p.links) for p in parts)
        assert share == pytest.approx(total, rel=1e-14)


REFUSED = {
    "branch": scene(PIVOT, [link("a"), link("b"), link("c", parent="a")]),
    "`constraints`": scene(PIVOT, 2, constraints=["psi1 = psi2"], start={"psi1": 1.0, "psi2": 1.0}),
    "`forces`": scene(PIVOT, 2, forces=[{"on": "M_psi1", "law": 1.0}]),
    "prescribed": scene(PIVOT, [link("a"), link("b", lower={"motion": "prescribed", "law": "0.3"})]),
    "plane = true": scene(SKI, 2, plane=True),
    "hinge to cut": scene(PIVOT, [link(f"a{i}", tip_mass=None, upper=FIXED) for i in range(LONGEST + 2)]),
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
    monkeypatch.setattr(vlmb.mechanism, "_available_memory", lambda: 2**26)
    start = {f"psi{i + 1}": -1.0 - 0.01 * i for i in range(count)}
    made = scene(PIVOT, count, start=start)
    trajectory = vlmb.simulate(made, duration=0.01, t_eval=[0.0, 0.01], rtol=1e-9, atol=1e-11)
    assert trajectory.status == "finished"
    assert trajectory.stats["route"] == "subchains"
    assert np.abs(trajectory["balance"]).max() < 1e-6 * trajectory["kinetic"].max()
    with pytest.raises(vlmb.VlmbError, match="GiB are free"):
        _ = trajectory.mechanism.data
    with pytest.raises(vlmb.VlmbError, match="GiB are free"):
        vlmb.build(scene(PIVOT, count, forces=[{"on": "M_psi1", "law": 1.0}]))


def test_a_thousand_links_take_ten_times_the_memory_of_a_hundred() -> None:
    taken = []
    for count in (100, 1000):
        made = scene(PIVOT, count)
        taken.append(sum(data_bytes(vlmb.build(part(made, *piece)).model.nv) for piece in cuts(made, PIECE)))
    assert taken[1] < 10.5 * taken[0] < data_bytes(500)


# What the measurements say -------------------------------------------------------------------------------------------


def test_bounds_of_the_recursive_route_follow_from_the_measurements() -> None:
    """Within them it is faster and no less exact; beyond, its error takes over."""
    data = json.loads((RESULTS / "rhs_cost.json").read_text(encoding="utf-8"))
    for base in ("pivot", "ski"):
        for text, seconds in data["time"][base].items():
            n, error = int(text), data["error"][base][text]
            if n <= RECURSIVE_LINKS:
                assert seconds["recursive"] < seconds["dense"], (base, n)
                assert error["recursive"] < 2.0 * max(error["dense"], 1e-14), (base, n)
            else:
                assert error["recursive"] > 10.0 * error["dense"], (base, n)


def test_the_bound_of_one_model_follows_from_the_measurements() -> None:
    """Beyond LONG_CHAIN sub-chains lose at most a quarter of the time while they win digits, and soon win both."""
    data = json.loads((RESULTS / "long_chains.json").read_text(encoding="utf-8"))
    assert (data["long_chain"], data["piece"]) == (LONG_CHAIN, PIECE)
    for text, seconds in data["time"].items():
        n, error = int(text), data["error"][text]
        if "dense" in seconds:
            if n > LONG_CHAIN:
                assert seconds["subchains"] < 1.25 * seconds["dense"], n
                assert error["subchains"] < 0.05 * min(error["recursive"], error["dense"]), n
            else:
                assert seconds["subchains"] > seconds["recursive"], n
        assert error["subchains"] < 1e-10, n
    assert data["sizes"][str(PIECE)]["time"] < 1.2 * min(entry["time"] for entry in data["sizes"].values())
    longest = [data["time"][text]["subchains"] for text in ("100", "1000")]
    assert longest[1] < 15.0 * longest[0]
