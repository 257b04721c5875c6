"""Two engines, one answer: accelerations and motions of both on every scene they both serve; the core compiles nothing anew."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import vlmb
from tests.small_scenes import FIXED, FLYING, PIVOT, SKI, bent, link, random_state, scene
from vlmb.core import jit
from vlmb.system.core_engine import CoreEngine
from vlmb.system.engines import make_engine
from vlmb.system.system import System, make_system

MODELS = sorted((Path(__file__).resolve().parents[2] / "models").glob("*.toml"))
SERVED = {path.stem: path for path in MODELS}
STATES = 100
# weights of f(-3h) ... f(3h) in h f', to order 6
DIFFERENCES = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0


def rates_by_pinocchio(system: System, engine: CoreEngine, t: float, state: vlmb.State) -> tuple[np.ndarray, float]:
    """Rates of the core's velocities w(q, v), which are linear in v: w(q, v') and the change of w along q with v kept.

    And the condition number of the mass matrix.
    """
    plan, workspace = system.core_plan, system.workspace(branch=engine.branch.tolist())
    y = workspace.pack(state)
    vdot = np.array(workspace.rhs(t, y)[workspace.nq : workspace.nq + workspace.nv])
    q, v = workspace.unpack(t, y)
    h = 5e-3 / max(1.0, np.abs(v).max())

    def velocities(place: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        return plan.arrays.pack(place, velocity)[plan.positions :]

    along = [velocities(pin.integrate(system.mechanism.model, q, k * h * v), v) for k in range(-3, 4)]
    return velocities(q, vdot) + DIFFERENCES @ np.array(along) / h, workspace.diagnostics.conditioning(q)[0]


@pytest.mark.parametrize("name", SERVED)
def test_accelerations_of_both_engines(name: str) -> None:
    """To 1e-11 of the largest, or 1e-15 times the condition number, at 100 random states and times."""
    system = make_system(vlmb.build(SERVED[name]))
    plan, random = system.core_plan, np.random.default_rng(len(name))
    for seed in range(STATES):
        state, t = random_state(system.mechanism, seed, sideways=False), random.uniform(0.0, system.run.duration)
        branch = list(system.mechanism.coordinates(state).values())
        engine = make_engine(system, branch)
        assert isinstance(engine, CoreEngine)
        core = engine.evaluate(t, engine.pack(state))[plan.positions : plan.positions + plan.velocities]
        right, condition = rates_by_pinocchio(system, engine, t, state)
        tolerance = max(1e-11, 1e-15 * condition) * np.abs(right).max()
        np.testing.assert_allclose(core, right, rtol=0.0, atol=tolerance, err_msg=f"state {seed}")


@pytest.mark.parametrize("name", SERVED)
def test_motions_of_both_engines(name: str) -> None:
    """Points, work and energies within the tolerances; the same end of the run."""
    options = {"duration": 0.5, "rtol": 1e-11, "atol": 1e-12, "t_eval": np.linspace(0.0, 0.5, 11), "method": "dop853"}
    runs = [vlmb.simulate(SERVED[name], engine=engine, **options) for engine in ("core", "pinocchio")]
    core, other = runs
    assert [run.engine for run in runs] == [run.stats["engine"] for run in runs] == ["core", "pinocchio"]
    assert core.status == other.status
    assert core.message.partition(":")[0] == other.message.partition(":")[0]  # the same time
    assert core.system.work_names == other.system.work_names
    for entry in core.mechanism.layout.links:
        for point in ("hinge", "rod_start", "tip"):
            np.testing.assert_allclose(core.position(entry.name, point), other.position(entry.name, point), rtol=0, atol=1e-8)
    for what in ("energy", *core.mechanism.coordinate_names):
        size = max(1.0, np.abs(other[what]).max())
        np.testing.assert_allclose(core[what], other[what], rtol=0, atol=1e-7 * size, err_msg=what)
    for what in core.work_by_force:
        np.testing.assert_allclose(core.work_by_force[what], other.work_by_force[what], rtol=0, atol=1e-6, err_msg=what)
    for what in core.reactions:
        size = max(1.0, np.abs(other.reactions[what]).max())
        np.testing.assert_allclose(core.reactions[what], other.reactions[what], rtol=0, atol=1e-6 * size, err_msg=what)


# Which engine --------------------------------------------------------------------------------------------------------

def test_engines_by_name() -> None:
    made = bent(PIVOT, 1)
    for asked, found in ((None, "core"), ("auto", "core"), ("core", "core"), ("pinocchio", "pinocchio")):
        run = vlmb.simulate(made, duration=0.05, engine=asked)
        assert run.engine == found == run.stats["engine"]
        assert run.system.engine == found
    written = scene(PIVOT, [link("a")], run={"engine": "pinocchio"}, start={"psi1": 0.3})
    assert vlmb.simulate(written, duration=0.05).engine == "pinocchio"
    assert vlmb.simulate(written, duration=0.05, engine="core").engine == "core"
    with pytest.raises(vlmb.SceneError, match=r"run\.engine = 'cores': allowed: auto, core, pinocchio"):
        vlmb.simulate(made, engine="cores")


def test_check_compares_the_engines(monkeypatch: pytest.MonkeyPatch) -> None:
    (note,) = (note for note in vlmb.check(bent(SKI, 2)).notes if "engines" in note)
    assert "both engines agree at the start" in note
    assert any("both engines agree" in note for note in vlmb.check(bent(SKI, 2, constraints=["phi1 = phi0"])).notes)
    evaluate = CoreEngine.evaluate

    def wrong(self: CoreEngine, t: float, y: np.ndarray) -> np.ndarray:
        return evaluate(self, t, y) * (1.0 + 1e-4)

    monkeypatch.setattr(CoreEngine, "evaluate", wrong)
    (note,) = (note for note in vlmb.check(bent(SKI, 2)).notes if "engines" in note)
    assert "the two engines differ at the start" in note and "report" in note


# Nothing is compiled for a scene ---------------------------------------------------------------------------------------


def dispatchers() -> Iterator[Any]:
    """Every compiled function of the core."""
    import importlib
    import pkgutil

    import vlmb.core as core

    seen = set()
    for module in pkgutil.iter_modules(core.__path__, "vlmb.core."):
        for value in vars(importlib.import_module(module.name)).values():
            if hasattr(value, "signatures") and id(value) not in seen:
                seen.add(id(value))
                yield value


def misses(function: Any) -> int:
    """How often a function was compiled, as nothing kept on this machine served."""
    return sum(function.stats.cache_misses.values())


def twenty_scenes() -> list[dict[str, Any]]:
    """Different in base, tree, segments, springs, forces, laws, method, and who looks on."""
    plain = [link("a"), link("b", lower=FIXED), link("c", parent="a", parent_point="rod_end", upper=None, tip_mass=None)]
    moved = [link("a", upper={"motion": "prescribed", "law": "0.2 + 0.02*sin(5*t)"}), link("b")]
    law = [{"on": "M_psi1", "law": "2*sin(3*t)"}, {"between": ["a", "b"], "stiffness": 10.0, "damping": 0.1}]
    found: list[dict[str, Any]] = []
    for base in (SKI, PIVOT, FLYING):
        start = {"psi1": 0.7, "phi1": 0.3, "psi2": 0.2, "phi2": 1.0, "phi1_dot": 0.5}
        for links, keys in ((moved, {"forces": law}), (plain, {}), (plain[:1], {"slope": 0.1}), (plain[:2], {})):
            wanted = {name: value for name, value in start.items() if len(links) > 1 or not name.endswith("2")}
            found.append({"scene": scene(base, links, start=wanted, **keys)})
    found += [{"scene": bent(PIVOT, 2), "method": method} for method in ("euler", "rk4", "gauss", "dop853", "adams", "radau")]
    found += [{"scene": bent(base, 2, plane=True)} for base in (PIVOT, SKI)]
    found += [{"scene": scene(SKI, [], start={"speed": 1.0}), "progress": lambda t: None}]
    found += [{"scene": bent(SKI, 1), "control": lambda t, view: {"M_psi1": 1.0}}]
    return found


@pytest.mark.skipif(not jit.COMPILED, reason="nothing is compiled")
def test_nothing_is_compiled_after_the_first_scene() -> None:
    """One machine code serves all mechanisms, laws and methods: no function gets another signature, none is compiled."""
    scenes = twenty_scenes()
    assert len(scenes) >= 21
    vlmb.simulate(**scenes[0], duration=0.05).summary()
    before = {function: (len(function.signatures), misses(function)) for function in dispatchers()}
    assert sum(count for count, _ in before.values()) >= 5
    for options in scenes[1:]:
        run = vlmb.simulate(**options, duration=0.05)
        assert run.engine == "core" and run.status == "finished", run.message
        run.summary()
    other = [function.__name__ for function, (count, _) in before.items() if 0 < count != len(function.signatures)]
    compiled = [function.__name__ for function, (_, missed) in before.items() if misses(function) != missed]
    assert (other, compiled) == ([], [])
    assert math.isfinite(run["energy"][-1])
