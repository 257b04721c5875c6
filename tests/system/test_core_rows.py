"""Rows and programmes: both engines give the same accelerations, controls, multipliers and powers, and the same words."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.small_scenes import ANY_LENGTH, FIXED, FLYING, PIVOT, SKI, link, random_state, scene
from tests.system.test_engines import in_the_core
from vlmb.core.row_arrays import parts, sizes_of
from vlmb.system.core_engine import CoreEngine
from vlmb.system.engines import make_engine
from vlmb.system.system import System, make_system
from vlmb.system.workspace import Workspace

MODELS = Path(__file__).resolve().parents[2] / "models"
FORMS = ("reduction", "multiplier", "projection")
ON_SKIS = [path.stem for path in sorted(MODELS.glob("*.toml")) if 'kind = "ski"' in path.read_text(encoding="utf-8")]
DRIVEN = {"motion": "prescribed", "law": "0.3 + 0.05*sin(3*t)"}
LEGS = {"lower": FIXED, "upper": FIXED}
THREE = [link("a"), link("b"), link("c")]
FOUR_BAR = [link("s1", parent="base", **LEGS), link("s2", parent="s1", **LEGS), link("s3", parent="s2", **LEGS)]


def programme(rows: list[str], controls: list[str], **keys: Any) -> dict[str, Any]:
    return {"constraints": rows, "controls": controls, "frequency": 4.0, **keys}


CASES: dict[str, vlmb.Scene] = {
    "position rows": scene(SKI, THREE, constraints=["b.tip.z = 1.0 + 0.1*sin(2*t)", "xi1_1 + xi2_1 = 0.6"]),
    "velocity rows": scene(SKI, THREE, constraints=["speed*phi0_dot = 0.4*cos(t)", "psi1_dot = 0.3*psi2_dot + 0.1*t"]),
    "equated azimuths": scene(SKI, THREE, constraints=["phi1 = phi0", "phi3 = phi2"]),
    "redundant rows": scene(PIVOT, THREE, constraints=["phi2 = phi1", "phi3 = phi1", "phi2 = phi3", "c.tip.x = 0.2"]),
    "dependent by factors": scene(FLYING, THREE, constraints=["b.tip.x = 0.4", "2*b.tip.x + c.tip.y = 0.8", "c.tip.y = 0"]),
    "closed loop": scene(PIVOT, FOUR_BAR, plane=True, constraints=["s3.tip.x = 0.8", "s3.tip.z = 0.1"]),
    "rows on a driven length": scene(
        PIVOT, [link("a", lower=DRIVEN, upper=FIXED), link("b", upper=DRIVEN)],
        constraints=["b.tip.z = 0.5 + 0.1*t", "phi1 = phi2"],
    ),
    "a programme": scene(
        SKI, THREE[:2],
        programme=programme(["psi1 = 1.0", "phi1 = phi0 + 0.2*sin(t)", "a.length = 1"], ["M_psi1", "M_phi1", "F1_1"]),
    ),
    "more controls than rows": scene(
        SKI, THREE[:2], programme=programme(["psi1 = 1.0", "com.z = 0.9"], ["M_psi1", "M_psi2", "F1_1", "F2_2", "M_phi0"])
    ),
    "weights": scene(
        SKI, THREE[:2], programme=programme(["psi1 = 1.0", "com.z = 0.9"], ["M_psi1", "T_b", "F1_1"], weights={"T_b": 0.01})
    ),
    "a free control": scene(
        SKI, THREE[:2], programme=programme(["psi1 = 1.0", "com.z = 0.9"], ["M_psi1", "M_psi2", "F1_1"], u0="2e-4*cos(3*t)")
    ),
    "secondary rows": scene(
        SKI, THREE[:2],
        programme=programme(["psi1 = 1.0"], ["M_psi1", "M_psi2", "F1_1", "M_phi1"], secondary=["xi1_1 = 0.3", "phi1 = 0.1"]),
    ),
    "too many secondary rows": scene(
        SKI, THREE[:2],
        programme=programme(["psi1 = 1.0"], ["M_psi1", "F1_1"], secondary=["xi1_1 = 0.3", "phi1 = 0.1", "com.z = 0.8"]),
    ),
    "gains of one's own": scene(
        SKI, THREE[:2],
        programme={
            "constraints": ["psi1 = 1.0", "speed = 2"], "controls": ["M_psi1", "F_x"], "h": [[-9.0], [0.5]],
            "k": [[-6.0, 0.2], [0.1, -2.0]],
        },
    ),
    "gains, weights and u0 of the motion": scene(
        SKI, THREE[:2], parameters={"w": 3.0}, constraints=["phi2 = phi1"],
        programme={
            "constraints": ["psi1 = 1.0", "speed = 2", "com.z = 0.9"], "controls": ["M_psi1", "F_x", "F1_1", "M_psi2"],
            "h": [["-w**2 - psi1**2", 0.5], ["0.1*sin(t)", "0.2*xi1_1"], [0.5, "-9 - speed**2"]],
            "k": [[-6.0, "0.2*psi1_dot", 0.0], [0.1, "-2 - cos(t)", 0.0], ["w", 0.0, "-2*w"]],
            "weights": {"F_x": 0.01, "M_psi1": "1e-6*(2 + sin(psi1_dot))", "M_psi2": "1e-5*exp(-t)"}, "u0": "1e-4*psi1 - 1e-5*t",
        },
    ),
    "a border": scene(
        SKI, THREE[:2],
        programme=programme(
            ["psi1 = 1.0", "com.z = 0.9"], ["M_psi1", "M_psi2", "F1_1", "M_phi0", "F2_1"], u0="1e-3*(psi2_dot + 2)",
            border=[[1.0, "0.1*psi1", 0, 0, "t"], [0, 1, 0.2, "xi1_1", -1]], weights={"F1_1": "1e-5 + 1e-6*speed**2"},
        ),
    ),
    "rows in the plane of a ski": scene(
        SKI, THREE, plane=True, slope=0.2,
        constraints=["b.tip.z = 1.0 + 0.1*sin(2*t)", "c.tip.y - x = 0.6", "psi3 = 2*psi1 + 0.1*t"],
    ),
    "velocity rows in the plane of a ski": scene(
        SKI, THREE, plane=True, slope=0.2, constraints=["speed*phi0_dot = 0.4*cos(t)", "b.tip.x_dot = 0.3*psi2_dot + 0.1*t"]
    ),
    "rows on a driven length in the plane of a ski": scene(
        SKI, [link("a", lower=DRIVEN, upper=FIXED), link("b", parent="base", anchor=[0.3, 0.2, 0.1], upper=DRIVEN)], plane=True,
        constraints=["b.tip.y = 0.5 + 0.1*t"],
    ),
    "a programme in the plane of a ski": scene(
        SKI, [link("a", lower=DRIVEN, upper=FIXED), *THREE[1:]], plane=True, constraints=["xi2_1 = 0.3"],
        programme=programme(
            ["com.z = 0.9 + 0.1*sin(t)", "psi1_dot = 0.1", "phi0 = 0.2*sin(x)"], ["M_psi1", "M_psi2", "M_psi3", "T_c", "M_phi0"],
            secondary=["psi3 = 0.4"],
        ),
    ),
    "a programme beside ideal rows": scene(
        SKI, [link("a", lower=DRIVEN, upper=FIXED), *THREE[1:]], constraints=["phi2 = phi1", "xi2_1 = 0.3"],
        programme=programme(["com.z = 0.9 + 0.1*sin(t)", "psi1_dot = 0.1"], ["M_psi1", "M_psi2", "M_psi3", "T_c"]),
    ),
}  # fmt: skip


def at_rest_on(system: System, state: vlmb.State) -> list[float]:
    """Coordinates near which angles of a state are read."""
    read = system.mechanism.coordinates(state)
    return [read[name] for name in system.mechanism.layout.names]


def shares(engine: CoreEngine) -> tuple[np.ndarray, np.ndarray]:
    """Controls and multipliers of the last evaluation."""
    rows = engine.plan.plant.rows
    if not len(rows.table):
        return np.zeros(0), np.zeros(0)
    sizes = sizes_of(rows)
    found, last = parts(sizes, engine.memory.rows).shares, sizes.controls + sizes.ideal
    return found[: sizes.controls] * rows.gains[-1, : sizes.controls], np.array(found[sizes.controls : last])


def answers(system: System, state: vlmb.State, t: float) -> list[tuple[np.ndarray, np.ndarray]] | str:
    """Accelerations, controls, multipliers and powers of the core, each with Pinocchio's; or the error of both."""
    branch = at_rest_on(system, state)
    engine, workspace = make_engine(system, branch, engine="core"), system.workspace(branch=branch)
    assert isinstance(engine, CoreEngine)
    y = workspace.pack(state)
    words = [said(engine, t, engine.pack(state)), said(workspace, t, y)]
    assert without_numbers(words[0]) == without_numbers(words[1])
    if words[0]:
        return words[0]
    rates, (q, v) = workspace.rhs(t, y).copy(), workspace.unpack(t, y)
    theirs = in_the_core(system.core_plan, q, v, rates[workspace.nq : workspace.nq + workspace.nv])
    plan, ours = system.core_plan, engine.evaluate(t, engine.pack(state))
    first, last = plan.positions, plan.positions + plan.velocities
    controls, multipliers = shares(engine)
    return [
        (ours[first:last], theirs), (controls, workspace.solver.controls), (multipliers, workspace.solver.multipliers),
        (ours[last:], rates[workspace.nq + workspace.nv :]),
    ]  # fmt: skip


def said(engine: CoreEngine | Workspace, t: float, y: np.ndarray) -> str:
    """What an engine says of a state that has no accelerations."""
    try:
        engine.evaluate(t, y)
    except vlmb.VlmbError as error:
        return f"{type(error).__name__}: {error}"
    return ""


def without_numbers(words: str) -> str:
    """A sentence whose numbers may differ by rounding."""
    return re.sub(r"\d[\d.]*(e[-+]?\d+)?", "#", words)


def assert_agreement(system: System, draws: int, bound: float = 1e-9) -> int:
    """Compare both engines at random states; return at how many there is a motion."""
    compared = 0
    for draw in range(draws):
        found = answers(system, random_state(system.mechanism, draw, sideways=system.knife_edge != "reduction"), 0.3)
        for ours, theirs in () if isinstance(found, str) else found:
            largest = max(1e-3, float(np.abs(theirs).max(initial=0.0)))
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=bound * largest)
        compared += not isinstance(found, str)
    return compared


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", ON_SKIS)
def test_shipped_models_agree_in_every_form(name: str, form: str) -> None:
    mechanism = vlmb.build(vlmb.load_scene(MODELS / f"{name}.toml"))
    if form == "reduction" and mechanism.scene.base.friction_on == "resultant":
        with pytest.raises(vlmb.SceneError, match="friction_on"):
            make_system(mechanism, knife_edge=form)
        return
    assert assert_agreement(make_system(mechanism, knife_edge=form), 12) > 6


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", CASES)
def test_rows_agree(name: str, form: str) -> None:
    if CASES[name].base.kind != "ski" and form != "reduction":
        pytest.skip("no ski, no knife edge")
    system = make_system(vlmb.build(CASES[name]), knife_edge=form, gain=3.0)
    assert system.engine == "core"
    assert assert_agreement(system, 12) > 6


def test_rows_of_a_programme_may_repeat_an_ideal_one() -> None:
    rows = programme(["psi1 = 0.7", "psi2 = 0.2"], ["M_psi1", "M_psi2"])
    mechanism = vlmb.build(scene(PIVOT, THREE[:2], constraints=["psi1 = 0.7"], programme=rows))
    values = dict(zip(mechanism.coordinate_names, (0.1, 0.7, 0.3, 0.2, -0.4, 0.3, 0.2, 0.25), strict=False))
    found = answers(make_system(mechanism), mechanism.state({**values, "psi1": 0.7}, {"psi2_dot": 0.4, "xi2_1_dot": 0.1}), 0.3)
    assert not isinstance(found, str), found
    for ours, theirs in found:
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9 * max(1.0, np.abs(theirs).max(initial=0.0)))


@pytest.mark.parametrize("seed", range(12))
def test_random_rows_agree(seed: int) -> None:
    random = np.random.default_rng(seed)
    base = (SKI, PIVOT, FLYING)[seed % 3]
    pool = ["b.tip.x = 0.3", "phi2 = phi1", "psi3 + psi1 = 0.4*t", "com.y = 0", "a.direction.z*b.direction.x = 0.2"]
    pool += ["psi2_dot = 0.3", "xi1_1 = 0.3", "2*phi2 = 2*phi1", "c.length = 1 + 0.1*sin(t)", "c.tip.z - a.tip.z = 0.2*cos(t)"]
    rows = [str(row) for row in random.choice(pool, size=int(random.integers(2, 6)), replace=False)]
    others = [row for row in pool if row not in rows][:2]
    controls = [str(name) for name in random.choice(["M_psi1", "M_psi2", "F2_1", "T_c", "F3_2"], size=4, replace=False)]
    made = scene(base, THREE, constraints=rows, programme=programme(others, controls))
    assert_agreement(make_system(vlmb.build(made), gain=float(random.uniform(0.0, 20.0))), 8, 1e-7)  # nearly singular ones too


# Motions ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", FORMS)
def test_a_programme_gives_the_same_motion(form: str) -> None:
    made = vlmb.load_scene(MODELS / "skier_slalom.toml")
    runs = [
        vlmb.simulate(made, duration=0.6, rtol=1e-10, atol=1e-11, knife_edge=form, engine=engine)
        for engine in ("core", "pinocchio")
    ]
    assert [run.engine for run in runs] == ["core", "pinocchio"]
    for name in runs[0].mechanism.layout.names:
        np.testing.assert_allclose(runs[0][name], runs[1][name], rtol=0, atol=1e-9)
    for what in ("controls", "reactions"):
        ours, theirs = getattr(runs[0], what), getattr(runs[1], what)
        for name in theirs:
            np.testing.assert_allclose(ours[name], theirs[name], rtol=0, atol=1e-7 * max(1.0, np.abs(theirs[name]).max()))
    assert np.abs(runs[0]["balance"]).max() < 1e-6


def test_errors_of_ideal_rows_decay() -> None:
    """A row of positions whose rate is off at the start: (z' + gain z)' = -gain (z' + gain z)."""
    gain, made = 8.0, scene(PIVOT, FOUR_BAR, plane=True, constraints=["s3.tip.z = -0.9"], start={"psi1": -0.4, "psi2": -1.0})
    mechanism = vlmb.build(made)
    system = make_system(mechanism, gain=gain)
    values = {"psi1": -0.4, "psi2": -1.0, "psi3": -0.2}
    engine = make_engine(system, [values[name] for name in mechanism.layout.names], engine="core")
    y, step = engine.pack(mechanism.state(values, {"psi2_dot": 0.3})), 1e-3
    found = []
    for k in range(501):
        state = system.core_plan.postures(np.array([k * step]), y[None])
        tip, speed = state.position(2, "tip")[0, 2], state.velocity(2, "tip")[0, 2]
        found.append((tip + 0.9, speed))
        half = y + 0.5 * step * engine.evaluate(k * step, y)
        y = y + step * engine.evaluate((k + 0.5) * step, half)
    t = step * np.arange(501)
    z, rate = np.array(found).T
    expected = (z[0] + (rate[0] + gain * z[0]) * t) * np.exp(-gain * t)
    np.testing.assert_allclose(z, expected, rtol=0, atol=2e-5)


def test_the_energy_of_a_closed_loop_stays() -> None:
    start = {"psi1": 1.2, "psi2": 0.1, "psi3": -1.1, "psi1_dot": 0.8}
    made = scene(PIVOT, FOUR_BAR, plane=True, constraints=["s3.tip.x = 0.8", "s3.tip.z = 0.1"], start=start)
    run = vlmb.simulate(made, duration=2.0)
    assert run.engine == "core" and run.status == "finished", run.message
    assert np.abs(run["balance"]).max() < 1e-6
    assert max(np.abs(run.residuals[name].position).max() for name in ("s3.tip.x = 0.8", "s3.tip.z = 0.1")) < 1e-8


def test_a_run_breaks_where_a_row_or_the_free_control_switches() -> None:
    rows = programme(["psi1_dot = where(t < 0.3, 0.1, 0.4)"], ["M_psi1", "F1_1"], u0="2e-4*step(t - 0.7)")
    made = scene(PIVOT, THREE[:1], constraints=["phi1 = 0.2*abs(t - 0.5)"], programme=rows)
    system = make_system(vlmb.build(made))
    assert sorted(system.breaks(0.0, 1.0)) == pytest.approx([0.3, 0.5, 0.7], abs=1e-9)
    assert system.breaks(0.8, 1.0) == set()


# Words ------------------------------------------------------------------------------------------------------------------

SILENT = {
    "contradicting": (
        scene(PIVOT, THREE, constraints=["b.tip.x = 0.4", "c.tip.y = 0", "b.tip.x + c.tip.y = t**2"]), "contradict"
    ),
    "known otherwise": (
        scene(PIVOT, [link("a", lower=DRIVEN, upper=FIXED)], constraints=["xi1_1 = 0.3 + 0.1*t**2"], start={"psi1": 0.3}),
        "known otherwise",
    ),
    "out of reach": (
        scene(PIVOT, THREE[:1], programme=programme(["psi1 = 1", "xi1_1 = 0.3"], ["F1_1", "F1_2"])), "cannot be met"
    ),
    "without a value": (scene(PIVOT, THREE, constraints=["log(psi1 - 5) = psi2"]), "no finite value"),
}


@pytest.mark.parametrize("name", SILENT)
def test_both_engines_say_the_same(name: str) -> None:
    made, words = SILENT[name]
    found = answers(make_system(vlmb.build(made)), random_state(vlmb.build(made), 3), 0.3)
    assert isinstance(found, str) and words in found, found


def test_a_control_at_the_pole_is_named() -> None:
    made = scene(PIVOT, [link("a", lower=FIXED, upper=FIXED)], programme=programme(["a.direction.x = 0.1"], ["M_phi1"]))
    mechanism = vlmb.build(made)
    system, state = make_system(mechanism), mechanism.state({"psi1": math.pi / 2.0, "phi1": 0.0}, {})
    found = answers(system, state, 0.0)
    assert isinstance(found, str) and "M_phi1: link 1 stands at the pole" in found


def test_a_posture_beyond_which_controls_pull_the_wrong_way_ends_a_run() -> None:
    """det G = cos psi1 changes its sign where the link passes the vertical."""
    segments = {"lower": {"length": 0.3, "limits": ANY_LENGTH, "stiffness": 1e3}, "upper": FIXED}
    made = scene(
        PIVOT, [link("a", **segments)], programme=programme(["a.tip.x = 0.4 - 0.8*t"], ["M_psi1"], gains=None), plane=True,
        start={"psi1": 1.2},
    )  # fmt: skip
    for engine in ("core", "pinocchio"):
        run = vlmb.simulate(made, duration=3.0, engine=engine)
        assert run.status == "failed" and run.t[-1] < 2.0
        assert "programme" in run.message, run.message
