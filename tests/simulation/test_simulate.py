"""A run: what it conserves, what stops it, what it keeps, and what a file of it carries."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import pickle
import re
import signal
import threading
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vlmb
from tests.interrupting import usual_signals
from tests.simulation.test_events import MIDDLE, SWING, oscillator
from tests.small_scenes import ANY_LENGTH, FIXED, PIVOT, SKI, bent, link, scene, table, write_toml
from vlmb.simulation.checking import check
from vlmb.simulation.methods import METHODS
from vlmb.simulation.simulate import run_options
from vlmb.system.start import consistent_start
from vlmb.system.system import make_system

ADAPTIVE = [name for name, method in METHODS.items() if method.adaptive]

# Accuracy ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["adams", "dop853"])
@pytest.mark.parametrize("base", [PIVOT, SKI], ids=["pivot", "ski"])
def test_energy_drift_of_a_spring_chain(method: str, base: dict[str, Any]) -> None:
    """Below 1e-9 of the largest kinetic energy over 10 s at rtol 1e-11."""
    soft = {"length": 0.3, "stiffness": 400.0, "limits": ANY_LENGTH}
    links = [link("link1", lower=soft, upper=FIXED), link("link2", lower=soft, upper=FIXED)]
    start = {"psi1": 0.7, "phi1": 0.4, "psi2": 0.2, "phi2": 1.3, "phi1_dot": 0.8, "psi2_dot": 0.6}
    trajectory = vlmb.simulate(scene(base, links, start=start), duration=10.0, method=method, rtol=1e-11, atol=1e-12)
    assert trajectory.status == "finished", trajectory.message
    drift = np.abs(trajectory["energy"] - trajectory["energy"][0]).max()
    assert drift < 1e-9 * trajectory["kinetic"].max()
    assert trajectory["kinetic"].max() > 10.0


@pytest.mark.parametrize(
    ("method", "step"), [("euler", 0.002), ("rk4", 0.02), ("adams", None), ("dop853", None), ("radau", None)]
)
def test_the_knife_edge_holds_exactly_at_any_step(method: str, step: float | None) -> None:
    made = bent(SKI, 1, slope=0.2)
    trajectory = vlmb.simulate(made, duration=0.5, method=method, step=step, rtol=1e-4, atol=1e-4)
    assert trajectory.status == "finished", trajectory.message
    assert np.abs(trajectory.residuals["knife_edge"].velocity).max() < 1e-13
    assert np.abs(trajectory.v[:, 1]).max() == 0.0
    assert trajectory["speed"].max() > 1.0


@pytest.mark.parametrize("form", ["multiplier", "projection"])
def test_the_other_forms_keep_the_knife_edge_to_tolerance(form: str) -> None:
    trajectory = vlmb.simulate(bent(SKI, 1, slope=0.2), duration=1.0, knife_edge=form, rtol=1e-10, atol=1e-11)
    assert np.abs(trajectory.residuals["knife_edge"].velocity).max() < (1e-13 if form == "projection" else 1e-8)


@pytest.mark.parametrize("rate", [2.0, 7.0, 10.0, 20.0, 31.4])
@pytest.mark.parametrize("method", ["adams", "rk4"])
def test_a_link_passes_straight_through_the_vertical(rate: float, method: str) -> None:
    """Over and over, with samples wherever they fall: psi goes on, phi stays."""
    made = scene(PIVOT, [link("a", lower=FIXED, upper=FIXED)], gravity=0.0, start={"phi1": 0.3, "psi1": 0.1, "psi1_dot": rate})
    trajectory = vlmb.simulate(made, duration=2.0, method=method)
    np.testing.assert_allclose(trajectory["psi1"], 0.1 + rate * trajectory.t, rtol=0, atol=1e-8 if method == "adams" else 1e-5)
    np.testing.assert_allclose(trajectory["phi1"], 0.3, rtol=0, atol=1e-9)


def test_a_moment_keeps_its_side_when_the_link_passes_the_vertical() -> None:
    """M_psi on a link that turns over and over gives it M_psi times the angle: its work tells which way it pushed."""
    made = scene(
        PIVOT, [link("a", lower=FIXED, upper=FIXED)], gravity=0.0, start={"phi1": 0.3, "psi1": 0.1, "psi1_dot": 6.0},
        forces=[{"on": "M_psi1", "law": 3.0}],
    )  # fmt: skip
    trajectory = vlmb.simulate(made, duration=3.0)
    inertia = 3.0 * (0.5**2 / 12 + 0.45**2) + 2.0 * 0.9**2
    expected = 0.1 + 6.0 * trajectory.t + 0.5 * 3.0 / inertia * trajectory.t**2
    np.testing.assert_allclose(trajectory["psi1"], expected, rtol=0, atol=1e-8)
    np.testing.assert_allclose(trajectory.work_by_force["M_psi1"], 3.0 * (expected - 0.1), rtol=0, atol=1e-7)


@pytest.mark.parametrize("lateral", [0.3, 0.05, 1e-3, 0.0])
def test_the_choice_of_samples_changes_no_motion(lateral: float) -> None:
    """A link under M_psi passes close to the vertical: its azimuth swings round, however far apart the samples are."""
    start = {"psi1": 0.9, "phi1": 0.3, "psi1_dot": 7.0, "phi1_dot": lateral, "phi0": 0.3, "speed": 1.0}
    forces = [{"on": "M_psi1", "law": 5.0}]
    made = scene({**SKI, "com_offset": 0.0}, [link("a", lower=FIXED, upper=FIXED)], gravity=0.0, start=start, forces=forces)
    runs = [vlmb.simulate(made, duration=1.0, t_eval=np.linspace(0.0, 1.0, count)) for count in (2, 21, 401)]
    for run in runs:
        assert run.status == "finished", run.message
        np.testing.assert_allclose(run.v[-1], runs[-1].v[-1], rtol=0, atol=1e-6)
        np.testing.assert_allclose(run.work_by_force["M_psi1"], 5.0 * (run["psi1"] - 0.9), rtol=0, atol=1e-6)
    few, many = runs[1], runs[2]
    largest = np.abs(many.reactions["knife_edge"]).max()
    np.testing.assert_allclose(
        few.reactions["knife_edge"], many.reactions["knife_edge"][::20], rtol=0, atol=1e-6 * max(1.0, largest)
    )
    np.testing.assert_allclose(few["psi1"], many["psi1"][::20], rtol=0, atol=1e-6)


def test_angles_are_unwrapped_over_many_turns() -> None:
    theta, reach = 0.6, 0.9
    rate = 12.0
    made = scene(PIVOT, [link("a", lower=FIXED, upper=FIXED)], gravity=0.0, start={"psi1": 0.0, "phi1_dot": rate, "phi1": theta})
    trajectory = vlmb.simulate(made, duration=10.0)
    np.testing.assert_allclose(trajectory["phi1"], theta + rate * trajectory.t, rtol=0, atol=1e-7)
    np.testing.assert_allclose(trajectory["a.length"], reach, rtol=0, atol=1e-12)
    sleigh = scene({**SKI, "com_offset": 0.0}, [], start={"phi0_dot": -9.0, "speed": 1.0})
    turned = vlmb.simulate(sleigh, duration=10.0)
    np.testing.assert_allclose(turned["phi0"], -9.0 * turned.t, rtol=0, atol=1e-7)


# Starts --------------------------------------------------------------------------------------------------------------


def test_what_is_not_given_has_the_values_the_docs_say() -> None:
    start = consistent_start(make_system(vlmb.build(scene(SKI, 2))))
    assert start.coordinates == {
        "x": 0.0, "y": 0.0, "phi0": 0.0, "phi1": 0.0, "psi1": math.pi / 2, "xi1_1": 0.3, "xi1_2": 0.2,
        "phi2": 0.0, "psi2": math.pi / 2, "xi2_1": 0.3, "xi2_2": 0.2,
    }  # fmt: skip
    assert set(start.rates.values()) == {0.0}
    assert start.adjustments == ()


SPEEDS: dict[str, tuple[dict[str, float], float]] = {
    "speed": ({"speed": 3.0}, 3.0),
    "speed backwards": ({"speed": -3.0}, -3.0),
    "x_dot alone": ({"x_dot": 3.0 * math.cos(0.5)}, 3.0),
    "y_dot alone": ({"y_dot": 3.0 * math.sin(0.5)}, 3.0),
    "both": ({"x_dot": 3.0 * math.cos(0.5), "y_dot": 3.0 * math.sin(0.5)}, 3.0),
    "nothing": ({}, 0.0),
}


@pytest.mark.parametrize("case", SPEEDS)
def test_the_ski_starts_along_itself(case: str) -> None:
    given_values, speed = SPEEDS[case]
    trajectory = vlmb.simulate(scene(SKI, [], start={"phi0": 0.5, **given_values}), duration=0.1)
    assert trajectory["speed"][0] == pytest.approx(speed, abs=1e-14)
    assert trajectory["x_dot"][0] == pytest.approx(speed * math.cos(0.5), abs=1e-14)
    assert trajectory["y_dot"][0] == pytest.approx(speed * math.sin(0.5), abs=1e-14)
    assert trajectory.adjustments == ()


def test_a_sideways_start_is_repaired_and_reported() -> None:
    trajectory = vlmb.simulate(scene(SKI, [], start={"phi0": 0.5, "x_dot": 3.0, "y_dot": 0.0}), duration=0.1)
    (repair,) = trajectory.adjustments
    assert "sideways velocity -1.43828 m/s" in repair
    assert trajectory["speed"][0] == pytest.approx(3.0 * math.cos(0.5), rel=1e-14)
    assert repair in trajectory.summary()


@pytest.mark.parametrize("base", [PIVOT, SKI], ids=["pivot", "ski"])
def test_a_prescribed_segment_starts_on_its_law(base: dict[str, Any]) -> None:
    made = scene(base, [link("a", upper={"motion": "prescribed", "law": "0.2 + 0.05*sin(6*t)"})], start={"psi1": 1.0})
    trajectory = vlmb.simulate(made, duration=0.2)
    assert trajectory["xi1_2"][0] == pytest.approx(0.2, abs=1e-15)
    assert trajectory["xi1_2_dot"][0] == pytest.approx(0.3, abs=1e-15)
    np.testing.assert_allclose(trajectory["xi1_2"], 0.2 + 0.05 * np.sin(6 * trajectory.t), rtol=0, atol=1e-15)


def test_a_rider_under_the_snow_is_no_start() -> None:
    """`fall` stops a run at the snow: a start below it is told, not run."""
    made = scene(SKI, [link("legs")], start={"psi1": -0.3}, run={"fall": True})
    try:
        trajectory = vlmb.simulate(made, duration=0.2)
    except vlmb.SceneError as error:
        message = str(error)
    else:
        assert trajectory.status == "stopped"
        assert trajectory.t[-1] == 0.0
        message = trajectory.message
    assert "snow" in message
    assert vlmb.simulate(scene(SKI, [link("legs")], start={"psi1": -0.3}), duration=0.2).status == "finished"  # fall = false


# Options -------------------------------------------------------------------------------------------------------------


def test_arguments_override_the_scene() -> None:
    made = bent(
        SKI, 1, run={"duration": 0.2, "method": "rk4", "rtol": 1e-5, "atol": 1e-6, "step": 0.01, "knife_edge": "multiplier"}
    )
    as_written = vlmb.simulate(made)
    assert (as_written.run.method, as_written.run.duration, as_written.run.knife_edge) == ("rk4", 0.2, "multiplier")
    assert as_written.stats["steps"] == 20
    other = vlmb.simulate(
        made, duration=np.float64(0.1), method="dop853", rtol=1e-9, atol=1e-10, knife_edge="projection", gain=np.int64(3)
    )
    assert (other.run.method, other.run.rtol, other.run.atol, other.run.duration) == ("dop853", 1e-9, 1e-10, 0.1)
    assert (other.run.knife_edge, other.run.gain) == ("projection", 3.0)
    assert run_options(made, rtol=None).rtol == 1e-5


@pytest.mark.parametrize(
    ("option", "text"),
    [
        ({"duration": -1.0}, "run.duration"), ({"duration": math.nan}, "run.duration"), ({"duration": "long"}, "run.duration"),
        ({"method": "rk5"}, "run.method"), ({"rtol": 0.0}, "run.rtol"), ({"atol": -1.0}, "run.atol"), ({"step": 0.0}, "run.step"),
        ({"knife_edge": "glue"}, "run.knife_edge"), ({"gain": -1.0}, "run.gain"),
    ],
)  # fmt: skip
def test_wrong_arguments_are_refused(option: dict[str, Any], text: str) -> None:
    with pytest.raises(vlmb.SceneError, match=text):
        vlmb.simulate(scene(), **option)


def test_a_mechanism_or_a_path_will_do(tmp_path: Path) -> None:
    made = bent(PIVOT, 1)
    path = write_toml(tmp_path / "scene.toml", {**table(PIVOT, 1), "start": dict(made.start)})
    first, second, third = (vlmb.simulate(entry, duration=0.3) for entry in (made, vlmb.build(made), path))
    for other in (second, third):
        assert np.array_equal(first.q, other.q)
        assert np.array_equal(first.v, other.v)


def test_the_same_run_twice_is_the_same() -> None:
    mechanism = vlmb.build(bent(SKI, 2))
    first, second = (vlmb.simulate(mechanism, duration=0.5) for _ in range(2))
    assert np.array_equal(first.q, second.q)
    assert first.stats["rhs_evaluations"] == second.stats["rhs_evaluations"]


RIDER = link("legs", lower=FIXED, upper=FIXED)

# Runs that fail or are interrupted -----------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_a_run_that_fails_keeps_its_part(method: str) -> None:
    def control(t: float, view: Any) -> dict[str, float]:
        return {"M_psi1": math.inf if t > 0.25 else 0.1}

    times = np.linspace(0.0, 0.5, 51)
    trajectory = vlmb.simulate(bent(PIVOT, 1), duration=0.5, control=control, t_eval=times, method=method, rtol=1e-7, atol=1e-9)
    assert trajectory.status == "failed"
    assert trajectory.message.startswith("failed at t = 0.2")
    assert "control returned a non-finite force" in trajectory.message
    assert 10 <= len(trajectory) <= 26
    for values in (trajectory.q, trajectory.v, trajectory["energy"], trajectory.controls["M_psi1"], trajectory["balance"]):
        assert np.isfinite(values).all()
    reference = vlmb.simulate(
        bent(PIVOT, 1),
        duration=0.25,
        control=lambda t, view: {"M_psi1": 0.1},
        t_eval=times[:11],
        method=method,
        rtol=1e-7,
        atol=1e-9,
    )
    np.testing.assert_allclose(trajectory.v[:10], reference.v[:10], rtol=0, atol=1e-2 if method == "euler" else 1e-5)
    assert trajectory.message in trajectory.summary()


@pytest.mark.parametrize("method", METHODS)
def test_a_collapse_ends_with_a_sentence(method: str) -> None:
    """v' = v^2 has no solution beyond t = 1."""
    slide = {"rod": {"length": 0.0, "mass": 0.0}, "lower": {"length": 1.0, "limits": ANY_LENGTH}, "tip_mass": 2.0}
    made = scene(PIVOT, [slide], gravity=0.0, plane=True, start={"psi1": 0.0, "xi1_1_dot": 1.0})
    trajectory = vlmb.simulate(
        made, duration=2.0, control=lambda t, view: {"F1_1": 2.0 * view["xi1_1_dot"] ** 2}, t_eval=np.linspace(0, 2, 41),
        method=method, rtol=1e-6, atol=1e-8, step=0.002,
    )  # fmt: skip
    assert trajectory.status == "failed"
    assert trajectory.message.startswith("failed at t = ")
    assert any(text in trajectory.message for text in ("too small", "too large", "finite", "converge")), trajectory.message
    assert np.isfinite(trajectory.v).all()
    assert trajectory.t[-1] >= 0.9
    np.testing.assert_allclose(
        trajectory["xi1_1_dot"][:11], 1 / (1 - trajectory.t[:11]), rtol=2e-2 if method == "euler" else 1e-5
    )


@pytest.mark.parametrize("method", ["adams", "dop853"])
def test_a_crawl_ends_with_a_sentence(method: str) -> None:
    """A moment that turns with the velocity within 1e-12 rad/s: steps without end are a failure, not a wait."""
    law = "-1e8*atan(1e12*psi1_dot)"
    forces = [{"on": "M_psi1", "law": law}]
    made = scene(PIVOT, [link("a", lower=FIXED, upper=FIXED)], gravity=0.0, start={"psi1": 0.3, "psi1_dot": 1.0}, forces=forces)
    trajectory = vlmb.simulate(made, duration=3.0, t_eval=[0.0, 3.0], method=method, rtol=1e-9, atol=1e-11)
    assert trajectory.status == "failed"
    assert "steps" in trajectory.message
    assert trajectory.stats["rhs_evaluations"] < 300_000


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
@pytest.mark.parametrize("method", ["bdf", "radau"])
def test_a_control_that_switches_with_the_velocity_ends_with_a_sentence(method: str, engine: str) -> None:
    made = scene(PIVOT, [link("a", lower=FIXED, upper=FIXED)], gravity=0.0, start={"psi1": 0.3, "psi1_dot": 1.0})

    def switching(t: float, view: Any) -> dict[str, float]:
        return {"M_psi1": math.copysign(1e8, -view["psi1_dot"])}

    options = {"method": method, "engine": engine, "rtol": 1e-9, "atol": 1e-11}
    trajectory = vlmb.simulate(made, duration=3.0, t_eval=[0.0, 3.0], control=switching, **options)
    assert trajectory.status == "failed"
    assert "steps" in trajectory.message


@pytest.mark.parametrize("method", METHODS)
def test_an_interrupted_run_keeps_its_part(method: str) -> None:
    def control(t: float, view: Any) -> dict[str, float]:
        if t > 0.25:
            raise KeyboardInterrupt
        return {"M_psi1": 0.1}

    options = {"method": method, "rtol": 1e-6, "atol": 1e-8}
    trajectory = vlmb.simulate(bent(PIVOT, 1), duration=0.5, control=control, t_eval=np.linspace(0.0, 0.5, 51), **options)
    assert trajectory.status == "interrupted"
    assert trajectory.message.startswith("interrupted at t = 0.2")
    assert 10 <= len(trajectory) <= 26
    assert np.isfinite(trajectory["energy"]).all()
    assert trajectory.stats["steps"] > 0


def test_an_interrupt_that_comes_again_or_before_the_first_sample() -> None:
    calls = []

    def control(t: float, view: Any) -> dict[str, float]:
        calls.append(t)
        if len(calls) > 40:
            raise KeyboardInterrupt
        return {"M_psi1": 0.1}

    trajectory = vlmb.simulate(bent(PIVOT, 1), duration=0.5, control=control, t_eval=[0.4, 0.5])
    assert trajectory.status == "interrupted"
    assert np.isfinite(trajectory.q).all()
    assert trajectory.summary()


def test_an_interrupt_from_the_progress_bar() -> None:
    def progress(t: float) -> None:
        if t > 0.2:
            raise KeyboardInterrupt

    trajectory = vlmb.simulate(bent(PIVOT, 1), duration=0.5, progress=progress)
    assert trajectory.status == "interrupted"
    assert 0.2 < trajectory.t[-1] < 0.21


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
@pytest.mark.parametrize("base", [PIVOT, SKI])
def test_samples_are_handed_out_as_the_run_goes_on(base: Any, engine: str) -> None:
    parts: list[Any] = []

    def watch(*samples: Any) -> None:
        parts.append([np.array(entry) for entry in samples])

    run = vlmb.simulate(bent(base, 2), duration=2.0, engine=engine, max_step=1e-3, watch=watch)
    plain = vlmb.simulate(bent(base, 2), duration=2.0, engine=engine, max_step=1e-3)
    assert len(parts) > (engine == "pinocchio") and np.array_equal(run.states, plain.states)  # nothing else is changed by it
    for handed, kept in zip((np.concatenate(part) for part in zip(*parts, strict=True)), (run.t, run.q, run.v), strict=True):
        count = len(handed)
        assert count >= len(kept) - 1 and np.array_equal(handed, kept[:count])


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
def test_samples_of_phases_are_handed_out_too(engine: str) -> None:
    ball = {"base": {"kind": "free", "mass": 1.0}, "contacts": [{"point": "base", "restitution": 0.8}], "start": {"z": 1.0}}
    parts: list[Any] = []
    run = vlmb.simulate(ball, duration=1.5, engine=engine, watch=lambda *samples: parts.append(samples))
    t, q, v = (np.concatenate(part) for part in zip(*parts, strict=True))
    before = np.flatnonzero(np.diff(run.t) == 0.0)  # at an event the sample after it is handed out
    assert len(before) == len(run.events) > 1 and len(parts) > 2
    for handed, kept in ((t, run.t), (q, run.q), (v, run.v)):
        np.testing.assert_array_equal(handed, np.delete(kept, before, axis=0))


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
def test_progress_is_told_the_time(engine: str) -> None:
    told: list[float] = []
    trajectory = vlmb.simulate(bent(PIVOT, 1), duration=0.3, progress=told.append, engine=engine)
    assert told == trajectory.t[1:].tolist()
    told.clear()  # where samples are rare, in between as well
    vlmb.simulate(bent(PIVOT, 4), duration=60.0, t_eval=[0.0, 60.0], progress=told.append, engine="core")
    assert len(told) > 2 and told[-1] == 60.0 and told == sorted(set(told))


@pytest.mark.parametrize("control", [None, lambda t, view: {"M_psi1": 0.1}], ids=["compiled", "control"])
@pytest.mark.parametrize("engine", ["core", "pinocchio"])
def test_a_signal_interrupts_a_run(engine: str, control: Any) -> None:
    """Ctrl-C, from another thread while the run is under way: whatever is computed is kept."""
    timer = threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT))
    with usual_signals():
        timer.start()
        run = vlmb.simulate(bent(PIVOT, 2), duration=1e5, method="adams", engine=engine, control=control, t_eval=np.arange(1e5))
        timer.join()
    assert run.status == "interrupted" and re.match(r"interrupted at t = \S+ s; the part so far is kept", run.message)
    assert 0 < len(run) < 1e5 and run.t[-1] <= 1.00001 * float(run.message.split()[4])
    assert np.isfinite(run.states).all() and run.stats["steps"] > 0


def test_an_error_of_the_users_control_is_the_users() -> None:
    """What is wrong in a control callable is not dressed up as an error of the scene."""

    def control(t: float, view: Any) -> dict[str, float]:
        if t > 0.1:
            raise ZeroDivisionError("mine")
        return {"M_psi1": 0.1}

    with pytest.raises(ZeroDivisionError, match="mine"):
        vlmb.simulate(bent(PIVOT, 1), duration=0.3, control=control)


# Control callables ---------------------------------------------------------------------------------------------------


def test_names_a_control_sees() -> None:
    seen: dict[str, float] = {}

    def control(t: float, view: Any) -> dict[str, float]:
        names = [
            *view.mechanism.coordinate_names,
            *(f"{name}_dot" for name in view.mechanism.coordinate_names),
            "speed",
            "t",
            "A",
        ]
        names += ["link2.tip.x", "link2.tip.z", "link1.rod_end.y", "link1.hinge.z", "link2.direction.x", "link1.length"]
        if t == 0.0:
            seen.update({name: view[name] for name in names})
            seen["from position"] = float(view.position("link2", "tip")[2])
        return {"M_psi1": 0.0}

    made = bent(SKI, 2, parameters={"A": 2.5})
    trajectory = vlmb.simulate(made, duration=0.1, control=control)
    assert seen.pop("A") == 2.5
    assert seen.pop("from position") == seen["link2.tip.z"]
    for name, value in seen.items():
        assert value == pytest.approx(trajectory[name][0], abs=1e-12), name


def test_a_control_acts_and_is_recorded() -> None:
    def control(t: float, view: Any) -> dict[str, float]:
        return {"M_psi1": -4.0 * (view["psi1"] - 1.0) - 1.5 * view["psi1_dot"], "F1_1": np.float64(3.0)}

    trajectory = vlmb.simulate(bent(PIVOT, 1), duration=0.5, control=control)
    expected = -4.0 * (trajectory["psi1"] - 1.0) - 1.5 * trajectory["psi1_dot"]
    np.testing.assert_allclose(trajectory.controls["M_psi1"], expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(trajectory.controls["F1_1"], 3.0)
    np.testing.assert_allclose(trajectory.work_by_force["F1_1"], 3.0 * (trajectory["xi1_1"] - trajectory["xi1_1"][0]), atol=1e-9)
    assert np.abs(trajectory["balance"]).max() < 1e-9 * trajectory["kinetic"].max()


def test_the_same_control_twice_over_laws_and_callable() -> None:
    """A law and a callable may push the same coordinate: both count."""
    two, three = (bent(PIVOT, 1, forces=[{"on": "M_psi1", "law": f"{k}*sin(t)"}]) for k in (2, 3))
    law = vlmb.simulate(two, duration=0.5, control=lambda t, view: {"M_psi1": math.sin(t)})
    three = vlmb.simulate(three, duration=0.5)
    np.testing.assert_allclose(law.v, three.v, rtol=0, atol=1e-9)
    np.testing.assert_allclose(law.controls["M_psi1"], three.controls["M_psi1"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(law.work_by_force["M_psi1"], three.work_by_force["M_psi1"], rtol=0, atol=1e-9)


WRONG_ANSWERS: dict[str, tuple[Callable[[float, Any], Any], str]] = {
    "unknown force": (lambda t, view: {"M_psi7": 1.0}, "M_psi7"),
    "force of nothing known": (lambda t, view: {"T_knee": 1.0}, "T_knee"),
    "not a table": (lambda t, view: 3.0, "control"),
    "a list": (lambda t, view: ["M_psi1"], "control"),
    "text": (lambda t, view: {"M_psi1": "much"}, "M_psi1"),
    "a list of numbers": (lambda t, view: {"M_psi1": [1.0, 2.0]}, "M_psi1"),
    "nan": (lambda t, view: {"M_psi1": math.nan}, "M_psi1"),
    "unknown name": (lambda t, view: {"M_psi1": view["psi7"]}, "psi7"),
    "a name that is no force at first": (lambda t, view: {"M_psi1": 1.0} | ({"F1_1": 1.0} if t > 0.05 else {}), "F1_1"),
}


@pytest.mark.parametrize("case", WRONG_ANSWERS)
def test_wrong_answers_of_a_control_are_named(case: str) -> None:
    control, text = WRONG_ANSWERS[case]
    try:
        trajectory = vlmb.simulate(bent(PIVOT, 1), duration=0.2, control=control)
    except vlmb.VlmbError as error:
        message = str(error)
    else:
        assert trajectory.status == "failed"
        message = trajectory.message
    assert text in message


def test_a_control_may_rest() -> None:
    """None or an empty answer is no force."""
    trajectory = vlmb.simulate(bent(PIVOT, 1), duration=0.2, control=lambda t, view: {"M_psi1": 1.0} if t < 0.1 else None)
    assert trajectory.status == "finished", trajectory.message
    assert trajectory.controls["M_psi1"][-1] == 0.0
    idle = vlmb.simulate(bent(PIVOT, 1), duration=0.2, control=lambda t, view: None)
    assert list(idle.controls) == []


def test_a_control_is_not_asked_beyond_the_end() -> None:
    for method in METHODS:
        asked: list[float] = []

        def control(t: float, view: Any, asked: list[float] = asked) -> dict[str, float]:
            asked.append(t)
            return {"M_psi1": 1.0}

        vlmb.simulate(bent(PIVOT, 1), duration=0.05, control=control, method=method, rtol=1e-5, atol=1e-6, t_eval=[0.02, 0.05])
        assert min(asked) >= 0.0
        assert max(asked) <= 0.05, method


# What a trajectory answers -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def skier() -> vlmb.Trajectory:
    forces = [{"on": "M_psi1", "law": "2*sin(3*t)"}]
    upper = {"motion": "prescribed", "law": "0.2 + 0.02*sin(5*t)"}
    damped = {"length": 0.3, "stiffness": 2000.0, "damping": 5.0, "limits": [-math.inf, math.inf]}
    links = [link("link1", upper=upper), link("link2", lower=damped)]
    made = bent(SKI, 2, slope=0.1, forces=forces, name="a skier")
    made = vlmb.Scene.from_dict({**made.to_dict(), "links": links, "run": {"rtol": 1e-8, "atol": 1e-10, "fall": False}})
    return vlmb.simulate(made, duration=0.6)


def test_every_name_has_a_value(skier: vlmb.Trajectory) -> None:
    n = len(skier)
    for name in skier.names:
        assert skier[name].shape == (n,)
        assert np.isfinite(skier[name]).all()
    for name in ("link1.length", "link2.tip.x", "link2.hinge.z", "link1.direction.y", "link2.rod_start.z"):
        assert skier[name].shape == (n,)
    assert set(skier.controls) == {"M_psi1", "F1_2"}
    assert set(skier.reactions) == {"knife_edge", "normal", "roll_moment", "pitch_moment"}
    assert set(skier.work_by_force) == {"M_psi1", "F1_2", "dissipation"}
    assert skier.hinge_force("link2").shape == (n, 3)
    np.testing.assert_allclose(skier.controls["M_psi1"], 2 * np.sin(3 * skier.t), rtol=1e-14)


def test_rates_are_the_rates_of_the_coordinates() -> None:
    trajectory = vlmb.simulate(bent(SKI, 2), duration=0.5, t_eval=np.linspace(0.0, 0.5, 2001), rtol=1e-11, atol=1e-12)
    for name in trajectory.mechanism.coordinate_names:
        rate = np.gradient(trajectory[name], trajectory.t, edge_order=2)
        np.testing.assert_allclose(rate[2:-2], trajectory[f"{name}_dot"][2:-2], rtol=0, atol=2e-3, err_msg=name)
    speed = np.hypot(trajectory["x_dot"], trajectory["y_dot"])
    np.testing.assert_allclose(np.abs(trajectory["speed"]), speed, rtol=0, atol=1e-12)


def test_positions_agree_with_the_mechanism(skier: vlmb.Trajectory) -> None:
    for name in ("link1", "link2"):
        for point in ("hinge", "rod_start", "rod_end", "tip"):
            for i in (0, len(skier) - 1):
                expected = skier.mechanism.position((skier.q[i], skier.v[i]), name, point)
                np.testing.assert_allclose(skier.position(name, point)[i], expected, rtol=0, atol=1e-13)


def test_names_that_are_not_there(skier: vlmb.Trajectory) -> None:
    asks: list[tuple[Callable[[], Any], str]] = [
        (lambda: skier["psi_1"], "'psi1'"),
        (lambda: skier["link1.knee.x"], "hinge"),
        (lambda: skier["leg.tip.x"], "link1"),
        (lambda: skier["link1.tip.w"], "tip"),
        (lambda: skier[""], "t"),
        (lambda: skier.position("link3"), "link1"),
        (lambda: skier.position("link1", "x"), "rod_end"),
        (lambda: skier.controls["M_psi2"], "M_psi1"),
        (lambda: skier.reactions["edge"], "knife_edge"),
        (lambda: skier.residuals["phi1 = phi0"], "knife_edge"),
        (lambda: skier.hinge_force("knee"), "link1"),
    ]
    for ask, text in asks:
        with pytest.raises(vlmb.TrajectoryError, match=text):
            ask()


def test_a_scene_without_a_ski_has_no_reactions() -> None:
    trajectory = vlmb.simulate(bent(PIVOT, 1), duration=0.1)
    assert list(trajectory.reactions) == []
    assert list(trajectory.residuals) == []
    assert "speed" not in trajectory.names


def test_the_summary_has_the_figures(skier: vlmb.Trajectory) -> None:
    text = skier.summary()
    for part in (
        "a skier", "finished at t = 0.6 s", "dop853", "rtol 1e-08", "atol 1e-10", f"{skier.stats['steps']} steps",
        f"{skier.stats['rhs_evaluations']} right-hand sides", "times real time", "energy balance", "knife_edge", "edge force",
        "normal force", "M_psi1", "F1_2",
    ):  # fmt: skip
        assert part in text
    assert "step 0.01 s" in vlmb.simulate(bent(PIVOT, 1), duration=0.1, method="rk4", step=0.01).summary()


def test_a_ski_that_lifts_off_is_reported() -> None:
    """A rider thrown upwards by her legs pulls the ski off the snow when they are stretched."""
    leg = {"length": 0.3, "stiffness": 3000.0, "rest": 0.3, "limits": [0.05, 2.0]}
    made = scene(SKI, [link("legs", lower=leg, upper=FIXED)], start={"xi1_1_dot": 3.0}, run={"fall": False})
    trajectory = vlmb.simulate(made, duration=0.15)
    normal = trajectory.reactions["normal"]
    assert normal.min() < 0.0
    first = float(trajectory.t[np.argmax(normal < 0.0)])
    assert f"lifts off at t = {first:.4g} s" in trajectory.summary()
    assert "WARNING" not in vlmb.simulate(scene(SKI, [RIDER]), duration=0.1).summary()


# Files ---------------------------------------------------------------------------------------------------------------


def test_a_file_carries_the_whole_run(skier: vlmb.Trajectory, tmp_path: Path) -> None:
    path = skier.save(tmp_path / "run.npz")
    loaded = vlmb.load_trajectory(path)
    assert loaded.scene == skier.scene
    assert loaded.run == skier.run
    for name in ("t", "states", "q", "v", "work", "inputs", "branch"):
        assert np.array_equal(getattr(loaded, name), getattr(skier, name)), name
    assert (loaded.status, loaded.message, loaded.adjustments) == (skier.status, skier.message, skier.adjustments)
    assert loaded.stats == skier.stats
    assert loaded.versions == skier.versions
    assert set(loaded.versions) == {"vlmb", "pinocchio", "numpy", "scipy", "python"}
    for name in skier.names:
        assert np.array_equal(loaded[name], skier[name]), name
    for name in skier.controls:
        assert np.array_equal(loaded.controls[name], skier.controls[name]), name
    for name in skier.reactions:
        assert np.array_equal(loaded.reactions[name], skier.reactions[name]), name
    assert loaded.summary() == skier.summary()


def test_a_run_with_a_control_is_stored_with_its_forces(tmp_path: Path) -> None:
    trajectory = vlmb.simulate(bent(PIVOT, 1), duration=0.3, control=lambda t, view: {"M_psi1": -view["psi1_dot"]})
    loaded = vlmb.load_trajectory(trajectory.save(tmp_path / "run.npz"))
    np.testing.assert_allclose(loaded.controls["M_psi1"], -trajectory["psi1_dot"], rtol=0, atol=1e-12)
    assert np.array_equal(loaded["balance"], trajectory["balance"])


@pytest.mark.parametrize("method", ["adams", "rk4"])
def test_a_stored_run_can_be_run_again(method: str, tmp_path: Path) -> None:
    first = vlmb.simulate(bent(SKI, 1, slope=0.1), duration=0.4, method=method)
    loaded = vlmb.load_trajectory(first.save(tmp_path / "run.npz"))
    again = vlmb.simulate(msgspec.structs.replace(loaded.scene, run=loaded.run))
    assert np.array_equal(again.q, first.q)
    assert np.array_equal(again.v, first.v)
    assert again.stats["rhs_evaluations"] == first.stats["rhs_evaluations"]


def test_columns_of_numbers(skier: vlmb.Trajectory, tmp_path: Path) -> None:
    path = skier.save_csv(tmp_path / "run.csv")
    with path.open(encoding="utf-8", newline="") as file:
        units, *rows = list(csv.reader(file))
    assert units[0] == "t [s]" and "psi1 [rad]" in units and "knife_edge [N]" in units
    header = [name.partition(" [")[0] for name in units]
    assert (
        header[: 1 + 2 * 10]
        == ["t", *skier.mechanism.coordinate_names, *(f"{n}_dot" for n in skier.mechanism.coordinate_names)][: 1 + 2 * 10]
    )
    assert {"speed", "energy", "balance", "M_psi1", "F1_2", "knife_edge", "normal"} <= set(header)
    assert len(header) == len(set(header))
    values = np.array(rows, dtype=float)
    assert values.shape == (len(skier), len(header))
    for name in ("t", "psi2", "energy"):
        assert np.array_equal(values[:, header.index(name)], skier[name])
    assert np.array_equal(values[:, header.index("knife_edge")], skier.reactions["knife_edge"])


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("stored") / "run.npz"
    vlmb.simulate(bent(PIVOT, 1), duration=0.05, t_eval=np.linspace(0, 0.05, 4), control=lambda t, view: {"M_psi1": 1.0}).save(
        path
    )
    return path.read_bytes()


def refused(path: Path, content: bytes) -> str:
    path.write_bytes(content)
    with pytest.raises(vlmb.TrajectoryError) as caught:
        vlmb.load_trajectory(path)
    assert str(path) in str(caught.value)
    return str(caught.value)


def changed(content: bytes, **changes: Any) -> bytes:
    """The stored run with some arrays replaced (None: left out); `note` may be a function of the note."""
    with np.load(io.BytesIO(content)) as file:
        arrays = {name: file[name] for name in file.files}
    for name, value in changes.items():
        if value is None:
            del arrays[name]
        elif name == "note" and callable(value):
            arrays["note"] = np.array(json.dumps(value(json.loads(str(arrays["note"])))))
        else:
            arrays[name] = np.asarray(value)
    out = io.BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def test_files_that_are_no_runs(tmp_path: Path, stored: bytes) -> None:
    with pytest.raises(vlmb.TrajectoryError, match="no such file"):
        vlmb.load_trajectory(tmp_path / "missing.npz")
    with pytest.raises(vlmb.TrajectoryError, match=r"not a trajectory|cannot be read"):
        vlmb.load_trajectory(tmp_path)
    path = tmp_path / "run.npz"
    array = io.BytesIO()
    np.save(array, np.zeros(3))
    other = io.BytesIO()
    np.savez(other, a=np.zeros(3))
    empty = io.BytesIO()
    zipfile.ZipFile(empty, "w").close()
    for content in (b"", b"text", b"PK\x03\x04", bytes(range(256)), array.getvalue(), other.getvalue(), empty.getvalue()):
        assert "not a trajectory" in refused(path, content)
    for share in (0.1, 0.5, 0.9, 0.99):
        refused(path, stored[: int(share * len(stored))])


WIDTH = 11  # of the stored states: direction, its rate, two lengths, their rates, work
DAMAGE: dict[str, dict[str, Any]] = {
    "no note": {"note": None},
    "no states": {"states": None},
    "no times": {"t": None},
    "note is no text": {"note": np.zeros(3)},
    "note is no JSON": {"note": "{"},
    "note is a list": {"note": lambda note: [1, 2]},
    "note is a number": {"note": lambda note: 3},
    "another format": {"note": lambda note: {**note, "format": 999}},
    "no format": {"note": lambda note: {k: v for k, v in note.items() if k != "format"}},
    "no scene": {"note": lambda note: {k: v for k, v in note.items() if k != "scene"}},
    "scene is a list": {"note": lambda note: {**note, "scene": []}},
    "scene with an unknown key": {"note": lambda note: {**note, "scene": {**note["scene"], "gravitty": 1.0}}},
    "another scene": {"note": lambda note: {**note, "scene": table(PIVOT, 2)}},
    "run with an unknown method": {"note": lambda note: {**note, "run": {**note["run"], "method": "magic"}}},
    "run is text": {"note": lambda note: {**note, "run": "fast"}},
    "stats is text": {"note": lambda note: {**note, "stats": "many"}},
    "repairs is a number": {"note": lambda note: {**note, "repairs": 3}},
    "asked_names is a number": {"note": lambda note: {**note, "asked_names": 1}},
    "one time too few": {"t": np.zeros(3)},
    "times in a table": {"t": np.zeros((4, 1))},
    "one time alone": {"t": 0.0},
    "times not ascending": {"t": np.array([0.0, 0.02, 0.01, 0.05])},
    "times not finite": {"t": np.array([0.0, 0.01, np.nan, 0.05])},
    "states too narrow": {"states": np.zeros((4, 3))},
    "states not finite": {"states": np.full((4, WIDTH), np.inf)},
    "states are text": {"states": np.full((4, WIDTH), "x")},
    "direction of length zero": {"states": np.zeros((4, WIDTH))},
    "states too wide": {"states": np.ones((4, WIDTH + 1))},
    "states not known": {"states": np.full((4, WIDTH), np.nan)},
    "engine of another": {"note": lambda note: {**note, "engine": "pinocchio"}},
    "an engine of no name": {"note": lambda note: {**note, "engine": "steam"}},
    "forces too few": {"asked": np.zeros((2, 1))},
    "forces too wide": {"asked": np.zeros((4, 2))},
    "reference too short": {"reference": np.zeros(2)},
    "no samples": {
        "t": np.zeros(0),
        "states": np.zeros((0, WIDTH)),
        "asked": np.zeros((0, 1)),
    },
}


@pytest.mark.parametrize("case", DAMAGE)
def test_damaged_runs_are_refused(case: str, tmp_path: Path, stored: bytes) -> None:
    assert vlmb.load_trajectory(_written(tmp_path / "good.npz", changed(stored))).status == "finished"
    refused(tmp_path / "run.npz", changed(stored, **DAMAGE[case]))


FOREIGN: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
    "a hostile law": lambda note: {**note, "scene": {**note["scene"], "forces": [{"on": "M_psi1", "law": "__import__('os')"}]}},
    "an unknown force": lambda note: {**note, "scene": {**note["scene"], "forces": [{"on": "M_psi9", "law": 1.0}]}},
    "an unknown control": lambda note: {**note, "asked_names": ["M_psi9"]},
}


@pytest.mark.parametrize("case", FOREIGN)
def test_what_a_foreign_run_hides_in_its_scene_is_refused_when_it_matters(case: str, tmp_path: Path, stored: bytes) -> None:
    path = _written(tmp_path / "run.npz", changed(stored, note=FOREIGN[case]))
    with pytest.raises(vlmb.VlmbError):
        vlmb.load_trajectory(path).summary()


def _written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


class Hostile:
    """Touches a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.path,)


def test_loading_runs_nothing(tmp_path: Path, stored: bytes) -> None:
    trap = tmp_path / "touched"
    hostile = np.array([Hostile(trap)], dtype=object)
    for name in ("note", "states", "extra"):
        with np.load(io.BytesIO(stored)) as file:
            arrays: dict[str, Any] = {key: file[key] for key in file.files}
        out = io.BytesIO()
        np.savez(out, **{**arrays, name: hostile})
        path = _written(tmp_path / f"{name}.npz", out.getvalue())
        if name == "extra":
            assert vlmb.load_trajectory(path).status == "finished"  # what is not ours is not looked at
        else:
            refused(path, out.getvalue())
    refused(tmp_path / "pickle.npz", pickle.dumps(Hostile(trap)))
    assert not trap.exists()
    pickle.loads(pickle.dumps(Hostile(trap)))  # noqa: S301 - the trap works
    assert trap.exists()


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_flipped_bytes_are_noticed_or_harmless(
    data: st.DataObject, stored: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    content = bytearray(stored)
    for _ in range(data.draw(st.integers(1, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = _written(tmp_path_factory.mktemp("flipped") / "run.npz", bytes(content))
    try:
        trajectory = vlmb.load_trajectory(path)
    except vlmb.TrajectoryError:
        return
    assert np.isfinite(trajectory["energy"]).all()


def test_a_run_that_failed_or_stopped_is_stored_too(tmp_path: Path) -> None:
    def control(t: float, view: Any) -> dict[str, float]:
        return {"M_psi1": math.inf if t > 0.1 else 0.1}

    for trajectory in (
        vlmb.simulate(bent(PIVOT, 1), duration=0.5, control=control),
        vlmb.simulate(oscillator([0.5, MIDDLE + 0.5 * SWING]), duration=1.0),
    ):
        loaded = vlmb.load_trajectory(trajectory.save(tmp_path / "run.npz"))
        assert (loaded.status, loaded.message) == (trajectory.status, trajectory.message)
        assert np.array_equal(loaded["energy"], trajectory["energy"])
        assert loaded.save_csv(tmp_path / "run.csv").stat().st_size > 100


def test_check_does_what_comes_before_a_run() -> None:
    mechanism, start = check(bent(SKI, 2))
    assert mechanism.coordinate_names[0] == "x"
    assert start.coordinates["psi1"] == 0.7


def test_a_run_that_stops_at_its_start_is_stored(tmp_path: Path) -> None:
    made = scene(SKI, [link("a", lower={"length": 0.25, "limits": [0.25, 0.6]}, upper=FIXED)], start={"xi1_1_dot": -1.0})
    run = vlmb.simulate(made, duration=0.3)
    assert run.status == "stopped" and run.t.tolist() == [0.0]
    again = vlmb.load_trajectory(run.save(tmp_path / "run.npz"))
    assert again.message == run.message
    assert again["xi1_1"].tolist() == [0.25]


@pytest.mark.parametrize("method", ["adams", "bdf", "dop853", "radau"])
def test_a_pole_of_a_law_ends_with_a_sentence(method: str) -> None:
    made = scene(SKI, [link("a")], start={"psi1": 1.2}, forces=[{"on": "M_psi1", "law": "tan(20*t)"}])
    run = vlmb.simulate(made, duration=0.3, method=method)
    assert run.status == "failed" and run.t[-1] < 0.1
    assert "steps became too small" in run.message


def test_a_control_that_rests_at_first_is_asked_again() -> None:
    made = scene(PIVOT, [link("a")], start={"psi1": 0.3})

    def late(t: float, view: vlmb.system.forces.StateView) -> dict[str, float]:
        return {"M_psi1": 4.0} if t > 0.1 else {}

    stopped = vlmb.simulate(made, duration=0.3, control=late)
    assert stopped.status == "failed" and "not among the forces of the first call (none): name it there" in stopped.message
    early = vlmb.simulate(made, duration=0.3, control=lambda t, view: {"M_psi1": 4.0 if t > 0.1 else 0.0})
    assert early.controls["M_psi1"][-1] == 4.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"constraints": ["phi1 = phi0", "phi1 = phi0 + 0.01"]}, r"'phi1 = phi0' \(off by .*'phi1 = phi0 \+ 0.01' \(off by"),
        ({"parameters": {"phi1": 1.0}}, r"parameters.phi1: a coordinate of this scene"),
        ({"run": {"rtol": 1e-17}}, r"run.rtol = 1e-17: .*>= 3e-14"),
        ({"programme": {"constraints": [], "controls": ["M_phi1"], "frequency": 5.0}}, r"programme.constraints = \[\]"),
    ],
)
def test_what_makes_no_sense_is_named(changes: dict[str, object], words: str) -> None:
    with pytest.raises(vlmb.SceneError, match=words):
        vlmb.simulate(scene(SKI, [link("a")], start={"psi1": 1.2}, **changes))


def test_a_prescribed_law_without_a_start_is_named() -> None:
    made = scene(PIVOT, [link("a", lower={"motion": "prescribed", "law": "0.2 + sqrt(t)"})])
    with pytest.raises(vlmb.SceneError, match=r"xi1_1: the law '0.2 \+ sqrt\(t\)' has no finite value, rate"):
        vlmb.simulate(made)


@pytest.mark.parametrize("wrong", [3, None, [{"base": {"kind": "ski"}}]], ids=["number", "nothing", "list"])
def test_what_is_no_scene_is_refused(wrong: object) -> None:
    for call in (vlmb.simulate, vlmb.build, vlmb.check, lambda what: vlmb.accelerations(what, {})):
        with pytest.raises(vlmb.SceneError, match="must be a Scene, the path of a scene file, or a dict") as caught:
            call(wrong)
        assert "Pinocchio" not in str(caught.value)
    with pytest.raises(vlmb.SceneError, match="Pinocchio"):
        vlmb.accelerations(pin.Model(), {})
    for key in ("control", "progress", "watch"):
        with pytest.raises(vlmb.SceneError, match=f"{key} = 5: must be a function"):
            vlmb.simulate(scene(PIVOT, [link("a")]), **{key: 5})


def test_a_scene_may_be_a_dict_or_a_path(tmp_path: Path) -> None:
    data = table(PIVOT, [link("a")], start={"psi1": 0.4})
    path = write_toml(tmp_path / "scene.toml", data)
    made = vlmb.Scene.from_dict(data)
    for what in (made, data, path, str(path)):
        assert vlmb.build(what).scene == made
        assert vlmb.check(what).scene == made
        assert vlmb.simulate(what, duration=0.01).scene == made
    with pytest.raises(vlmb.SceneError, match=r"scene: base: a ski needs mass > 0"):
        vlmb.simulate({"base": {"kind": "ski"}})


def test_check_tells_what_is_known_before_a_run() -> None:
    found = vlmb.check(scene(SKI, [link("a")], start={"psi1": 1.2}, constraints=["phi1 = phi0"]))
    assert found.degrees_of_freedom == 5  # x y phi0 phi1 psi1 and two lengths, less the edge and the row
    assert found.start.coordinates["psi1"] == 1.2
    assert "7 coordinates, 5 degrees of freedom" in repr(found)
    mechanism, start = found
    assert (mechanism, start) == (found.mechanism, found.start)


def test_wrong_paths_and_names_of_trajectories_are_named(tmp_path: Path) -> None:
    run = vlmb.simulate(scene(PIVOT, [link("a")], start={"psi1": 0.4}), duration=0.01)
    for call in (run.save, run.save_csv, vlmb.load_trajectory):
        for wrong in (None, True, 3):
            with pytest.raises(vlmb.TrajectoryError, match=f"{wrong}: must be the path of a file"):
                call(wrong)
    for wrong in (5, None, ("psi1",)):
        with pytest.raises(vlmb.TrajectoryError, match="a name is needed"):
            run[wrong]


@pytest.mark.parametrize("knife_edge", ["reduction", "multiplier", "projection"])
@pytest.mark.parametrize(("method", "step"), [("euler", 0.5), ("rk4", 0.5), ("gauss", 0.25)])
def test_steps_far_too_long_end_with_a_sentence(method: str, step: float, knife_edge: str) -> None:
    """Also where the look for an event fails on the way that failed."""
    stiff = Path(__file__).resolve().parents[2] / "models" / "stiff_skier.toml"
    run = vlmb.simulate(stiff, 1.0, method, knife_edge=knife_edge, step=step, gain=1.0, t_eval=np.linspace(0.0, 1.0, 61))
    assert run.status in ("stopped", "failed") and run.message
    assert (np.diff(run.t) > 0.0).all() and np.isfinite(run.q).all() and np.isfinite(run.v).all()


@pytest.mark.parametrize("method", ["adams", "dop853", "radau"])
def test_a_tolerance_below_the_noise_of_nearly_dependent_rows_is_named(method: str) -> None:
    springs = {
        at: {"length": length, "stiffness": 4e3, "limits": [-np.inf, np.inf]} for at, length in (("lower", 0.3), ("upper", 0.2))
    }
    given = {
        "base": {"kind": "pivot"},
        "links": [{"rod": {"length": 0.5, "mass": 20.0}, "tip_mass": 10.0, **springs}],
        "constraints": ["psi1 = 1.2", "psi1 + 1e-05*(xi1_1 - 0.3) = 1.2"],
        "start": {"psi1": 1.2, "phi1_dot": 1.0, "xi1_1": 0.3},
    }
    way = vlmb.simulate(given, 0.5, method, 1e-12, atol=1e-13, engine="pinocchio")
    assert way.status == "failed" and "below the noise of the accelerations" in way.message
    advised = float(way.message.split("rtol = ")[1].split()[0])
    assert 1e-11 < advised < 1e-7 and way.stats["steps"] < 20_000
