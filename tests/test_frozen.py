"""Frozen means frozen: what is made once is never changed, travels by pickle, and serves many threads."""

from __future__ import annotations

import copy
import pickle
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import vlmb
import vlmb.system.constraints
from tests.small_scenes import PIVOT, SKI, bent, link
from vlmb.system.start import consistent_start
from vlmb.system.system import System, make_system

MODELS = Path(__file__).resolve().parents[1] / "models"
PROGRAMME = vlmb.load_scene(MODELS / "skier_slalom.toml")
CONSTRAINED = bent(SKI, 2, constraints=["phi1 = phi0"], forces=[{"on": "M_psi1", "law": "sin(3*t)"}], parameters={"A": 1.5})


def again(what: Any) -> Any:
    return pickle.loads(pickle.dumps(what))  # noqa: S301 - our own


def pushed(t: float, view: Any) -> dict[str, float]:
    return {"M_psi2": 0.5 - view["psi2_dot"]}


RUNS: dict[str, Callable[[], vlmb.Trajectory]] = {
    "plain": lambda: vlmb.simulate(bent(PIVOT, 2), duration=0.1),
    "constrained": lambda: vlmb.simulate(CONSTRAINED, duration=0.1),
    "programme": lambda: vlmb.simulate(PROGRAMME, duration=0.1),
    "control": lambda: vlmb.simulate(CONSTRAINED, duration=0.1, control=pushed),
    "a lambda": lambda: vlmb.simulate(bent(PIVOT, 1), duration=0.1, control=lambda t, view: {"M_psi1": 1.0}),
    "multiplier": lambda: vlmb.simulate(bent(SKI, 1), duration=0.1, knife_edge="multiplier"),
}


def numbers(run: vlmb.Trajectory) -> dict[str, np.ndarray]:
    """Everything a trajectory tells."""
    found = {name: run[name] for name in run.names}
    found |= {f"control {name}": values for name, values in run.controls.items()}
    found |= {f"reaction {name}": values for name, values in run.reactions.items()}
    found |= {f"power {name}": run.power(name) for name in run.controls}
    found |= {f"work {name}": values for name, values in run.work_by_force.items()}
    for name, residual in run.residuals.items():
        found |= {f"rate {name}": residual.velocity, f"error {name}": residual.position}
    for entry in run.scene.links:
        found |= {f"{entry.name} {what}": getattr(run, what)(entry.name) for what in ("hinge_force", "hinge_torque", "position")}
        found |= {f"{entry.name}.length": run[f"{entry.name}.length"], f"{entry.name}.tip.z": run[f"{entry.name}.tip.z"]}
    found |= {name: getattr(run, name) for name in ("t", "q", "v", "work", "inputs", "branch", "conditions")}
    return {name: values for name, values in found.items() if values is not None}


@pytest.mark.parametrize("name", RUNS)
def test_a_trajectory_is_pickled_before_and_after_any_look(name: str) -> None:
    run = RUNS[name]()
    before = pickle.dumps(run)
    told, summary = numbers(run), run.summary()
    run._repr_html_()
    assert pickle.dumps(run) == before  # what was computed since is not carried along
    for other in (again(run), copy.copy(run), copy.deepcopy(run)):
        assert other.summary() == summary
        for what, values in numbers(other).items():
            np.testing.assert_array_equal(values, told[what], err_msg=what)
            assert not values.flags.writeable, what


@pytest.mark.parametrize("name", RUNS)
def test_arrays_of_a_trajectory_are_read_only(name: str) -> None:
    run = RUNS[name]()
    for what, values in numbers(run).items():
        assert not values.flags.writeable, what
        if values.size:
            with pytest.raises(ValueError, match="read-only"):
                values[0] = 0.0


def test_the_array_that_a_trajectory_is_made_of_stays_its_makers() -> None:
    import dataclasses

    run = RUNS["plain"]()
    half = run.states[::2].copy()
    other = dataclasses.replace(run, t=run.t[::2], states=half, inputs=run.inputs[::2])
    half[:] = half
    assert not other.states.flags.writeable and len(other) == (len(run) + 1) // 2
    np.testing.assert_array_equal(other.q, run.q[::2])


def test_a_scene_is_hashed_by_its_content() -> None:
    scenes = [vlmb.load_scene(path) for path in sorted(MODELS.glob("*.toml"))]
    assert len(set(scenes)) == len(scenes)
    for one in scenes:
        other = vlmb.Scene.from_dict(one.to_dict())
        assert other == one and hash(other) == hash(one) and again(one) == one
    data = PROGRAMME.to_dict()
    turned = vlmb.Scene.from_dict({**data, "start": dict(reversed(data["start"].items()))})
    assert turned == PROGRAMME and hash(turned) == hash(PROGRAMME)
    assert hash(PROGRAMME.changed(start={"phi0": 0.1})) != hash(PROGRAMME)


def test_a_mechanism_holds_nothing_that_changes() -> None:
    mechanism = vlmb.build(CONSTRAINED)
    before = pickle.dumps(mechanism)
    state = mechanism.state({**dict.fromkeys(mechanism.coordinate_names, 0.2)})
    mechanism.position(state, "link2", "rod_end"), mechanism.coordinates(state), mechanism._repr_html_()
    vlmb.simulate(mechanism, duration=0.05).summary()
    vlmb.equations_of_motion(mechanism, dict.fromkeys(mechanism.coordinate_names, 0.2), {}).blocks  # noqa: B018
    assert pickle.dumps(mechanism) == before
    assert not any(isinstance(value, pin.Data) for value in vars(mechanism).values())
    other = again(mechanism)
    assert other == mechanism and hash(other) == hash(mechanism) and {mechanism: 1}[other] == 1
    np.testing.assert_array_equal(other.position(state, "link2"), mechanism.position(state, "link2"))


@pytest.mark.parametrize("base", [PIVOT, SKI, {"kind": "free", "mass": 1.0}], ids=["pivot", "ski", "free"])
@pytest.mark.parametrize("plane", [False, True])
def test_positions_are_pinocchios(base: dict[str, Any], plane: bool) -> None:
    links = [link("a"), link("b", parent_point="rod_end"), link("c", parent="a", parent_point="rod_start"), link("d", parent="b")]
    mechanism = vlmb.build(bent(base, 1, plane=plane).changed(links=links))
    data, random = mechanism.model.createData(), np.random.default_rng(3)
    values = {name: random.uniform(0.1, 1.2) for name in mechanism.coordinate_names}
    q, v = mechanism.state(values)
    pin.framesForwardKinematics(mechanism.model, data, q)
    for name, at in mechanism.frames.items():
        if "." in name:
            found = mechanism.position((q, v), *name.split("."))
            np.testing.assert_allclose(found, data.oMf[at].translation, rtol=0, atol=1e-14, err_msg=name)


def test_equations_are_pickled_after_a_look() -> None:
    mechanism = vlmb.build(bent(SKI, 2))
    eom = vlmb.equations_of_motion(mechanism, dict.fromkeys(mechanism.coordinate_names, 0.3), {"phi1_dot": 1.0})
    before = pickle.dumps(eom)
    mass, bias = eom.mass_matrix, eom.bias
    assert pickle.dumps(eom) == before
    np.testing.assert_array_equal(again(eom).mass_matrix, mass)
    np.testing.assert_array_equal(again(eom).bias, bias)


@pytest.mark.parametrize("made", [CONSTRAINED, PROGRAMME, bent(PIVOT, 2)], ids=["constrained", "programme", "plain"])
def test_a_system_is_pickled(made: vlmb.Scene) -> None:
    system = make_system(vlmb.build(made), inputs=["M_psi1"])
    other = again(system)
    assert isinstance(other, System) and other.work_names == system.work_names and other.engine == system.engine
    start = consistent_start(system)
    y, branch = system.workspace().pack(start.state), list(start.coordinates.values())
    found = [one.workspace().evaluate(0.1, y, branch, [2.0]).vdot for one in (system, other)]
    np.testing.assert_array_equal(found[0], found[1])


def test_rows_are_compiled_once_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled, make_readings = [], vlmb.system.constraints.make_readings

    def counted(*args: Any) -> Any:
        compiled.append(1)
        return make_readings(*args)

    monkeypatch.setattr(vlmb.system.constraints, "make_readings", counted)
    for made in (CONSTRAINED, PROGRAMME):
        monkeypatch.setattr("vlmb.system.system._made", ())  # runs of other tests share what they compiled
        compiled.clear()
        run = vlmb.simulate(made, duration=0.05, control=lambda t, view: {"F1_1": 0.0})
        run.summary(), numbers(run)
        once = 2 if made is CONSTRAINED else 1  # the start reads its equation in azimuths as it is written as well
        assert len(compiled) == once
        run = again(run)
        assert len(compiled) == once  # until somebody looks
        run.summary()
        assert len(compiled) == once + 1


def test_threads_share_a_system_each_with_its_workspace() -> None:
    system = make_system(vlmb.build(PROGRAMME))
    start = consistent_start(system)
    branch = list(start.coordinates.values())

    def march(seed: int) -> np.ndarray:
        workspace = system.workspace(branch=branch)
        y = workspace.pack(start.state)
        y[: workspace.nq] += 1e-3 * np.random.default_rng(seed).normal(size=workspace.nq)
        for k in range(300):
            y = y + 1e-4 * workspace.rhs(1e-4 * k, y)
        return y

    alone = [march(seed) for seed in range(8)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(march, range(8)))
    np.testing.assert_array_equal(together, alone)


def test_threads_share_a_mechanism_and_a_trajectory() -> None:
    mechanism = vlmb.build(CONSTRAINED)
    alone = vlmb.simulate(mechanism, duration=0.1, method="dop853")
    with ThreadPoolExecutor(4) as pool:
        runs = list(pool.map(lambda _: vlmb.simulate(mechanism, duration=0.1, method="dop853"), range(4)))
        looks = list(pool.map(lambda _: numbers(runs[0]), range(4)))
    for run in runs:
        np.testing.assert_array_equal(run.q, alone.q)
    for found in looks:
        for what, values in numbers(alone).items():
            np.testing.assert_array_equal(found[what], values, err_msg=what)


def test_a_branch_is_an_argument_and_a_result() -> None:
    """The same evaluation whatever was evaluated before, if the branch is given; an accepted state returns the next."""
    system = make_system(vlmb.build(CONSTRAINED))
    start = consistent_start(system)
    first, second = system.workspace(), system.workspace(branch=list(start.coordinates.values()))
    y = first.pack(start.state)
    turned = {name: value + 2 * np.pi * (name == "phi1") for name, value in start.coordinates.items()}
    first.evaluate(0.0, y, list(turned.values()))
    one, other = first.evaluate(0.0, y, list(start.coordinates.values())), second.evaluate(0.0, y)
    np.testing.assert_array_equal(one.vdot, other.vdot)
    branch, _ = second.accept(0.0, y)
    np.testing.assert_allclose(branch, list(start.coordinates.values()), rtol=0, atol=1e-12)
    assert branch == second.branch


def test_an_ensemble_in_threads_equals_one_in_a_row_bit_for_bit() -> None:
    scene = vlmb.load_scene(MODELS / "one_link.toml")

    def motion(k: int) -> np.ndarray:
        run = vlmb.simulate(scene.changed_at({"links.0.lower.stiffness": 300.0 + k, "start.psi1": 0.1 + 1e-3 * k}), duration=1.0)
        assert run.engine == "core"
        return np.hstack([run.q, run.v, run["energy"][:, None]])

    alone = [motion(k) for k in range(24)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(motion, range(24)))
    for ours, theirs in zip(together, alone, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_runs_whose_springs_differ_share_a_start_and_others_have_their_own() -> None:
    scene = vlmb.load_scene("one_link")
    for changes, psi, xi in (
        ({"links.0.lower.stiffness": 310.0}, -0.5, 0.3), ({"start.psi1": 0.1}, 0.1, 0.3),
        ({"links.0.lower.stiffness": 320.0}, -0.5, 0.3), ({"start.xi1_1": 0.35, "links.0.lower.rest": 0.2}, -0.5, 0.35),
    ):  # fmt: skip
        run = vlmb.simulate(scene.changed_at(changes), duration=0.05)
        assert (run["psi1"][0], run["xi1_1"][0]) == pytest.approx((psi, xi), abs=1e-15)


def test_a_length_that_follows_a_law_starts_where_the_law_is() -> None:
    lower = {"motion": "prescribed", "law": "0.3 + 0.1*t"}
    links = [{"rod": {"length": 0.5, "mass": 1.0}, "lower": lower, "upper": {"length": 0.1}}]
    scene = vlmb.Scene.from_dict({"base": {"kind": "pivot"}, "links": links})
    for t0 in (0.0, 1.0, 0.0, 0.5):
        assert vlmb.simulate(scene, duration=0.05, t0=t0)["xi1_1"][0] == pytest.approx(0.3 + 0.1 * t0, abs=1e-15)


def test_runs_in_threads_leave_the_filters_of_warnings_as_they_are() -> None:
    """Filters are those of all threads: two that put them away and back in turn would leave what the first one set."""
    scene, before = vlmb.load_scene(MODELS / "one_link.toml"), list(warnings.filters)

    def run(k: int) -> str:
        changed = scene.changed_at({"links.0.lower.stiffness": 300.0 + k})
        return vlmb.simulate(changed, duration=1.0, control=(lambda t, view: {"M_psi1": 1.0}) if k % 9 == 0 else None).status

    with ThreadPoolExecutor(4) as pool:
        assert set(pool.map(run, range(60))) == {"finished"}
    assert warnings.filters == before
