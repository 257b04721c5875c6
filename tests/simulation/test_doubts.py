"""What makes a run doubtful is said first, kept in its file, and an exit code; what is right raises no doubt."""

from __future__ import annotations

import dataclasses
import json
import logging
import math
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.small_scenes import FIXED, PIVOT, SKI, bent, link, scene
from vlmb.cli import main

ROOT = Path(__file__).resolve().parents[2]
MODELS = sorted(path.stem for path in (ROOT / "models").glob("*.toml"))
LONG = {"rtol": 1e-8, "atol": 1e-10, "method": "adams"}  # its steps are long and see little within
SWING = scene(PIVOT, [link("a", lower=FIXED, upper=FIXED)], start={"psi1": 0.3, "phi1": 0.2}, run=LONG)
ENGINES = ("core", "pinocchio")

Control = Callable[[float, Any], dict[str, float]]


def pulse(size: float, at: float, half: float, force: str = "M_psi1") -> Control:
    return lambda t, view: {force: size if abs(t - at) < half else 0.0}


@pytest.mark.parametrize("engine", ENGINES)
def test_a_pulse_that_the_steps_passed_over_is_the_first_line(engine: str, tmp_path: Path) -> None:
    """1e4 N m for 2 ms: without them the pendulum swings on, and its energy adds up all the same."""
    run = vlmb.simulate(SWING, duration=2.0, engine=engine, control=pulse(1e4, 1.005, 1e-3), t_eval=np.linspace(0, 2, 401))
    assert run.status == "finished" and abs(run["balance"]).max() < 1e-6 * run["kinetic"].max()
    assert run.controls["M_psi1"].max() == 1e4
    (doubt,) = run.doubts
    assert "at t = 1.005 s the control gives M_psi1 = 1e+04" in doubt and "max_step" in doubt
    assert run.summary().splitlines()[0] == f"DOUBTFUL  {doubt}" and f"DOUBT: {doubt}" in repr(run)
    loaded = vlmb.load_trajectory(run.save(tmp_path / "run.npz"))
    for other in (loaded, pickle.loads(pickle.dumps(run))):  # noqa: S301
        assert other.doubts == run.doubts and other.summary() == run.summary()
    seen = vlmb.simulate(SWING, duration=2.0, engine=engine, control=pulse(1e3, 1.005, 1e-3), t_eval=run.t, max_step=5e-4)
    assert seen.doubts == () and abs(seen["psi1"] - run["psi1"]).max() > 0.1  # its advice helps


@pytest.mark.parametrize(("at", "half", "samples"), [(1.0, 1e-4, 201), (0.4, 3e-3, 4001), (1.992, 1e-3, 501), (0.008, 1e-3, 501)])
def test_pulses_on_one_sample_on_many_and_near_the_ends(at: float, half: float, samples: int) -> None:
    control, times = pulse(-3e3, at, half), np.linspace(0.0, 2.0, samples)
    run = vlmb.simulate(SWING, duration=2.0, control=control, t_eval=times, max_step=0.1, rtol=1e-6, atol=1e-8)
    still = vlmb.simulate(SWING, duration=2.0, t_eval=times, max_step=0.1, rtol=1e-6, atol=1e-8)
    passed = abs(run["psi1"] - still["psi1"]).max() < 1e-4
    assert bool(run.doubts) == passed and abs(run.controls["M_psi1"]).max() == 3e3
    assert passed  # else this tests nothing


def test_a_pulse_on_a_link_at_rest_has_no_power_and_is_found() -> None:
    hanging = scene(PIVOT, [link("a", lower=FIXED, upper=FIXED)], start={"psi1": -1.2}, run=LONG)
    balance = -hanging.gravity  # held by the control, but for the pulse
    arm = 3.0 * 0.45 + 2.0 * 0.9
    held = vlmb.simulate(
        hanging, duration=1.0, t_eval=np.linspace(0, 1, 101),
        control=lambda t, view: {"M_psi1": -balance * arm * math.cos(view["psi1"]) + 500.0 * (abs(t - 0.5) < 1e-4)},
    )  # fmt: skip
    assert abs(held.power("M_psi1")).max() < 1e-3
    assert len(held.doubts) == 1 and "M_psi1" in held.doubts[0]


def test_a_law_of_the_state_that_is_passed_over() -> None:
    """A narrow bump in psi1 is smooth: no event stops at it, and a step may pass over it."""
    free = vlmb.simulate(SWING, duration=1.0, t_eval=np.linspace(0, 1, 101))
    at, rate = float(free["psi1"][40]), float(abs(free["psi1_dot"][40]))
    bump = {"on": "M_psi1", "law": f"2e3*exp(-((psi1 - ({at!r}))/{1e-3 * rate!r})**2)"}
    run = vlmb.simulate(SWING.changed(forces=[bump]), duration=1.0, t_eval=free.t, rtol=1e-5, atol=1e-7)
    assert abs(run["psi1"] - free["psi1"]).max() < 1e-3
    assert len(run.doubts) == 1 and "at t = 0.4 s a law gives a force" in run.doubts[0]
    seen = vlmb.simulate(SWING.changed(forces=[bump]), duration=1.0, t_eval=free.t, rtol=1e-5, atol=1e-7, max_step=1e-3)
    assert seen.doubts == () and abs(seen["psi1"] - free["psi1"]).max() > 0.1


RIGHT: dict[str, Control] = {
    "nothing": lambda t, view: {"M_psi1": 0.0},
    "a damper": lambda t, view: {"M_psi1": -30.0 * view["psi1_dot"]},
    "fast": lambda t, view: {"M_psi1": 20.0 * math.sin(200.0 * t)},
    "a switch": lambda t, view: {"M_psi1": math.copysign(20.0, math.sin(9.0 * t))},
    "a switch at a sample": lambda t, view: {"M_psi1": 20.0 * (t >= 0.5)},
    "a switch at the last sample": lambda t, view: {"M_psi1": 20.0 * (t >= 0.75)},
    "held between samples": lambda t, view: {"M_psi1": 5.0 * math.sin(7919.0 * math.floor(60.0 * t + 1e-9))},
    "a short pulse": lambda t, view: {"M_psi1": 300.0 * math.exp(-(((t - 0.5) / 3e-3) ** 2))},
    "a drift": lambda t, view: {"M_psi1": 1e-6 * t},
}


@pytest.mark.parametrize("method", ["adams", "dop853", "radau", "rk4", "gauss"])
@pytest.mark.parametrize("case", RIGHT)
def test_what_is_right_raises_no_doubt(case: str, method: str) -> None:
    for made, short in ((SWING, 0.002), (bent(PIVOT, 2), 0.001 if method == "rk4" else 0.002)):
        bounds = {"max_step": 1e-3} if case == "a short pulse" and method in ("adams", "dop853", "radau") else {}
        run = vlmb.simulate(made, duration=0.75, control=RIGHT[case], method=method, step=short, rtol=1e-7, atol=1e-9, **bounds)
        assert run.status in ("finished", "stopped"), run.message
        assert run.doubts == (), run.doubts


@pytest.mark.parametrize("name", MODELS)
def test_models_raise_no_doubt(name: str) -> None:
    for options in ({}, {"method": "dop853", "rtol": 1e-4, "atol": 1e-6}):
        if options and vlmb.load_scene(ROOT / "models" / f"{name}.toml").run.method == "euler":
            continue
        run = vlmb.simulate(ROOT / "models" / f"{name}.toml", duration=2.0, **options)
        assert run.doubts == (), (options, run.doubts)


def test_energy_that_does_not_add_up() -> None:
    coarse = vlmb.simulate(ROOT / "models" / "one_link.toml", method="euler")
    share = abs(coarse["balance"]).max() / coarse["kinetic"].max()
    (doubt,) = coarse.doubts
    assert doubt.startswith("the energy is off by ") and f"{share:.1g} of the largest kinetic energy" in doubt
    assert "the step of 0.001 s is too long" in doubt
    assert vlmb.simulate(ROOT / "models" / "one_link.toml", method="euler", step=1e-5).doubts == ()
    (doubt,) = vlmb.simulate(ROOT / "models" / "two_links.toml", method="adams", duration=5.0, rtol=3e-3, atol=3e-3).doubts
    assert "rtol 0.003 is too loose" in doubt


def test_an_equation_that_does_not_hold() -> None:
    """The error of an ideal row grows without correction under a step that is too long."""
    made = bent(SKI, 1, constraints=["lean: link1.tip.z = 0.64"], run={"fall": False, "method": "euler", "gain": 0.0})
    coarse, fine = (vlmb.simulate(made, duration=4.0, step=step) for step in (3e-3, 3e-4))
    assert coarse.doubts[1].startswith("lean does not hold: it is off by") and "run.gain" in coarse.doubts[1]
    assert not any("lean" in doubt for doubt in fine.doubts)


def test_at_rest_rounding_is_no_doubt() -> None:
    hanging = scene(PIVOT, [link("a", lower=FIXED, upper=FIXED)], start={"psi1": -math.pi / 2}, run={"rtol": 1e-8})
    run = vlmb.simulate(hanging, duration=1.0, control=lambda t, view: {"M_psi1": 0.0})
    assert run["kinetic"].max() < 1e-20 and run.doubts == ()


def test_files_without_doubts_are_read(tmp_path: Path) -> None:
    path = vlmb.simulate(SWING, duration=0.1).save(tmp_path / "run.npz")
    with np.load(path) as file:
        arrays, note = dict(file), json.loads(str(file["note"]))
    assert note.pop("doubts") == []
    arrays["note"] = np.array(json.dumps(note))
    np.savez(tmp_path / "old.npz", **arrays)
    assert vlmb.load_trajectory(tmp_path / "old.npz").doubts == ()


def test_the_command_line_has_exit_code_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["run", str(ROOT / "models" / "two_links.toml"), "--no-plots", "--quiet", "--duration", "3", "--method", "rk4"]
    assert main([*command, "--step", "0.015", "-o", str(tmp_path / "coarse")]) == 1
    assert capsys.readouterr().out.startswith("DOUBTFUL  the energy is off by ")
    assert (tmp_path / "coarse" / "run.csv").exists()
    assert main([*command, "-o", str(tmp_path / "fine")]) == 0


def test_doubts_do_not_change_what_a_run_is() -> None:
    names = [field.name for field in dataclasses.fields(vlmb.Trajectory)]
    assert names[-3:] == ["doubts", "stretches", "events"]  # pickles and positional arguments of before


def test_a_run_is_looked_through_when_its_doubts_are_asked_for_or_somebody_listens(monkeypatch: pytest.MonkeyPatch) -> None:
    log, heard = logging.getLogger("vlmb"), list[str]()
    monkeypatch.setattr(log, "propagate", False)
    coarse = {"scene": ROOT / "models" / "two_links.toml", "duration": 3.0, "method": "rk4", "step": 0.015}
    run = vlmb.simulate(**coarse)
    assert "doubts" not in run.__dict__
    (doubt,) = run.doubts
    assert doubt.startswith("the energy is off by") and run.doubts is run.doubts
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: heard.append(record.getMessage())  # type: ignore[method-assign]
    log.addHandler(handler)
    try:
        other = vlmb.simulate(**coarse)
    finally:
        log.removeHandler(handler)
    assert other.__dict__["doubts"] == (doubt,) and heard == [f"{run.scene.name}: doubtful: {doubt}"]
    unseen = vlmb.simulate(**coarse)
    assert pickle.loads(pickle.dumps(unseen)).doubts == dataclasses.replace(vlmb.simulate(**coarse)).doubts == (doubt,)  # noqa: S301


def test_what_cannot_be_looked_through_is_doubtful(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(logging.getLogger("vlmb"), "propagate", False)
    run = vlmb.simulate(SWING, duration=0.1)
    monkeypatch.setattr("vlmb.simulation.trajectory.doubts_of", lambda *_: 1 / 0)
    assert run.doubts == ("the run could not be looked through: ZeroDivisionError: division by zero",)
    failed = vlmb.simulate(SWING.changed(forces=[{"on": "M_psi1", "law": "sqrt(0.05 - t)"}]), duration=0.1)
    assert failed.status == "failed" and failed.doubts == ()


@pytest.mark.parametrize("law", [
    "-500*exp(-((psi1 + 0.7312)/1e-3)**2)", "-20*psi1_dot*exp(-((a.tip.x - 0.25)/1e-3)**2)",
    "-1000*exp(-((psi1_dot + 3)/3e-4)**2)",
])  # fmt: skip
def test_what_a_law_does_between_two_samples_is_looked_for_along_the_motion(law: str) -> None:
    """The pendulum passes it within some 1e-4 s; with short steps nothing is doubtful."""
    link = {"name": "a", "rod": {"length": 0.5, "mass": 2.0}}
    scene = {"base": {"kind": "pivot"}, "plane": True, "links": [link], "start": {"psi1": -0.3}}
    scene["forces"] = [{"on": "M_psi1", "law": law}]
    over, through = (vlmb.simulate(scene, 0.8, "adams", max_step=step) for step in (None, 2e-5))
    assert "steps passed over" in over.doubts[0]
    assert abs(over["psi1"][-1] - through["psi1"][-1]) > 1e-4 and not through.doubts


@pytest.mark.parametrize("law", [
    "-2*atan(xi1_1_dot/1e-4)", "-(1 + 0.5*xi1_1_dot)*exp((xi1_1 - 2)/1e-3)", "1e-3*(2 - xi1_1)/((2 - xi1_1)**2 + 1e-6)**1.5",
    "5*sin(xi1_1/1e-3)", "1e3*exp(-((xi1_1 - 2)/1e-2)**2)*max(0, 1 - xi1_1)",
])  # fmt: skip
@pytest.mark.parametrize("method", ["dop853", "radau"])
def test_laws_that_vary_fast_and_are_followed_raise_no_doubt(law: str, method: str) -> None:
    mass = {"name": "m", "rod": {"length": 0.0, "mass": 0.0}, "tip_mass": 1.0, "lower": {"length": 1.0, "limits": [-1e9, 1e9]}}
    start = {"psi1": 0.0, "xi1_1": 1.0, "xi1_1_dot": 1.0}
    scene = {"base": {"kind": "pivot"}, "plane": True, "gravity": 0.0, "links": [mass], "start": start}
    run = vlmb.simulate(scene | {"forces": [{"on": "F1_1", "law": law}]}, 1.0, method)
    assert run.status == "finished" and not run.doubts


@pytest.mark.parametrize("keys", [
    {"forces": [{"on": "T_b", "law": "-300*exp(-((psi2 - psi1 + 0.6)/1e-4)**2)"}], "start": {"psi1": -0.3, "psi2": -0.5}},
    {"programme": {"constraints": ["psi1 = -0.3 - t + 0.02*exp(-((a.tip.x - 0.25)/3e-4)**2)"], "controls": ["M_psi1"],
                   "frequency": 3.0}, "start": {"psi1": -0.3, "psi2": -0.5}},
])  # fmt: skip
def test_equations_and_torques_at_hinges_are_followed_as_well(keys: dict[str, Any]) -> None:
    links = [{"name": name, "rod": {"length": 0.5, "mass": 2.0}} for name in "ab"]
    found = vlmb.simulate({"base": {"kind": "pivot"}, "plane": True, "links": links, **keys}, 1.0, "adams")
    assert "does something on a way that the steps passed over" in found.doubts[0]
