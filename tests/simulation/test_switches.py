"""Laws that switch, at any place: windows narrow beside a step, on the start, at the ends of a run, where steps are short."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.special import sici

import vlmb
from tests.small_scenes import ANY_LENGTH, PIVOT
from vlmb.core.jit import COMPILED

ENGINES = ["core", "pinocchio"] if COMPILED else ["core"]


def slide(law: str, speed: float = 1.0, **run: Any) -> dict[str, Any]:
    """A mass of 1 kg that slides from x = xi1_1 = 1 m without friction or gravity under a law."""
    mass = {"name": "m", "rod": {"length": 0.0, "mass": 0.0}, "tip_mass": 1.0, "lower": {"length": 1.0, "limits": ANY_LENGTH}}
    return {
        "plane": True, "base": PIVOT, "gravity": 0.0, "links": [mass], "run": run,
        "start": {"psi1": 0.0, "xi1_1": 1.0, "xi1_1_dot": speed}, "forces": [{"on": "F1_1", "law": law}],
    }  # fmt: skip


# A law that acts on a short way only, and the squared speed after it
WINDOWS = {
    "where(abs(xi1_1 - 2) < 1e-5, 1e5, 0)": 5.0,
    "where((xi1_1 - 2)**2 < 1e-10, 1e5, 0)": 5.0,
    "1e5*max(0, 1e-3 - abs(xi1_1 - 2))": 1.2,
    "-2e6*min(0, abs(xi1_1 - 2) - 1e-3)": 5.0,
    "1e5*step(xi1_1 - 1.99999)*step(2.00001 - xi1_1)": 5.0,
    "where(xi1_1 < 2, 0, where(xi1_1 < 2.0000001, -4e6, 0))": 0.2,
}


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("law", WINDOWS)
def test_a_narrow_window_is_not_passed_over(law: str, engine: str) -> None:
    for options in ({}, {"method": "adams"}, {"rtol": 1e-11, "atol": 1e-12, "max_step": 0.01}):
        run = vlmb.simulate(slide(law), 2.0, engine=engine, **options)
        assert run.status == "finished" and not run.doubts, (options, run.message)
        assert run["xi1_1_dot"][-1] == pytest.approx(math.sqrt(WINDOWS[law]), abs=1e-6), options
        assert np.abs(run["balance"]).max() < 1e-7


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", ["dop853", "adams", "radau"])
@pytest.mark.parametrize("width", [0.1, 1e-4, 1e-7])
def test_a_window_that_moves_is_not_passed_over(width: float, method: str, engine: str) -> None:
    """Against the window the speed is 0.8 m/s before, and sqrt(0.64 + 4) after."""
    law = f"where((xi1_1 - 1.5 - 0.2*t)**2 < {0.25 * width**2!r}, {2.0 / width!r}, 0)"
    run = vlmb.simulate(slide(law), 2.0, method, engine=engine)
    assert run["xi1_1_dot"][-1] == pytest.approx(0.2 + math.sqrt(4.64), abs=1e-6)


@pytest.mark.parametrize("method", ["dop853", "radau"])
@pytest.mark.parametrize("law", [
    "where((t - 50.345678)**2 < 2.5e-17, 1e8, 0)", "where(1e16*(t - 50.345678)**2 < 0.25, 1e8, 0)",
    "1e6*max(0, 1 - ((t - 50.345678)/1e-6)**2)*0.75",
])  # fmt: skip
def test_a_window_of_time_may_be_as_narrow_as_time_tells(law: str, method: str) -> None:
    """1e-8 s in 100 s; outside the parabola is as far from 0 as it is long."""
    run = vlmb.simulate(slide(law), 100.0, method)
    assert run.status == "finished" and run["xi1_1_dot"][-1] == pytest.approx(2.0, abs=1e-5), run.message


@pytest.mark.parametrize("method", ["dop853", "adams", "radau"])
@pytest.mark.parametrize("width", [1e-4, 1e-6])
def test_a_narrow_bump_far_from_the_start_is_not_passed_over(width: float, method: str) -> None:
    """At its edges it pushes nothing: a long step from there knows nothing of it."""
    law = f"{0.75 / width!r}*max(0, 1 - ((xi1_1 - 503.345678)/{width!r})**2)"
    run = vlmb.simulate(slide(law, 10.0), 100.0, method)
    assert run.status == "finished" and run["xi1_1_dot"][-1] == pytest.approx(math.sqrt(102.0), abs=1e-6), run.message


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", ["rk4", "gauss", "dop853", "radau"])
@pytest.mark.parametrize(
    ("law", "speed", "end"),
    [("where(xi1_1 > 1, 10, -1)", 1.0, 7.0), ("where(xi1_1 >= 1, 2, -2)", 0.0, 2.0), ("3 - 2*sign(xi1_1_dot)", 0.0, 1.5)],
)
def test_a_start_on_a_switch_counts_where_it_leads(law: str, speed: float, end: float, method: str, engine: str) -> None:
    run = vlmb.simulate(slide(law, speed), 1.0, method, engine=engine, step=0.01)
    assert run["xi1_1"][-1] == pytest.approx(end, abs=1e-9)
    assert run["xi1_1"][0] == 1.0 and run["xi1_1_dot"][0] == speed


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", ["rk4", "gauss", "dop853", "adams"])
@pytest.mark.parametrize(
    ("law", "push"),
    [("10*step(1 - t)", 0.0), ("where(t <= 1, 0, 10)", 10.0), ("10*sign(t - 1)", 10.0), ("where(t < 2, 10, 1e4)", 10.0),
     ("10*(1 - step(t - 2))", 10.0), ("max(0, t - 1)*20", 10.0)],
)  # fmt: skip
def test_a_law_that_switches_at_the_ends_of_a_run(law: str, push: float, method: str, engine: str) -> None:
    """From t = 1 to 2 s: whatever it has at these instants, its value between them counts."""
    for control in (None, lambda t, view: {"F1_1": 0.0}):
        run = vlmb.simulate(slide(law), 1.0, method, t0=1.0, engine=engine, step=0.01, control=control)
        assert run.status == "finished" and not run.doubts
        assert run["xi1_1_dot"][-1] == pytest.approx(1.0 + push, abs=1e-9)
        assert len(run) == 201 and run.t[0] == 1.0 and run.t[-1] == 2.0 and run["xi1_1_dot"][0] == 1.0


@pytest.mark.parametrize(("law", "push"), [("10*step(1 - t)", 0.0), ("where(t <= 1, 0, 10)", 10.0), ("100*step(t - 2)", 0.0)])
@pytest.mark.parametrize("method", ["rk4", "dop853"])
def test_a_law_that_switches_at_the_ends_of_a_run_on_the_ground(law: str, push: float, method: str) -> None:
    scene = {
        "plane": True, "base": {"kind": "free", "mass": 1.0}, "start": {"x_dot": 1.0}, "forces": [{"on": "F_x", "law": law}],
        "contacts": [{"name": "foot", "point": "base", "friction": 0.0}],
    }  # fmt: skip
    run = vlmb.simulate(scene, 1.0, method, t0=1.0, step=0.01)
    assert run["x_dot"][-1] == pytest.approx(1.0 + push, abs=1e-9) and len(run) == 201


@pytest.mark.parametrize("law", ["1/(1 - t)", "1/t", "log(t)"])
def test_a_law_without_a_value_at_an_end_is_named_all_the_same(law: str) -> None:
    for method in ("rk4", "dop853"):
        run = vlmb.simulate(slide(law), 1.0, method, step=0.01)
        assert run.status == "failed" and f"the law {law!r} of the force on F1_1 has no finite value" in run.message


@pytest.mark.parametrize("law", ["1/(0.3 - t)", "1/abs(t - 0.3)", "where(t < 0.3, 0, 1e-6/(t - 0.3))", "tan(pi*t/0.6)"])
def test_a_pole_of_a_law_is_no_break_to_step_over(law: str) -> None:
    """Its impulse has no bound; that of a root, of a logarithm and of sin(t)/t has one."""
    for method in ("dop853", "adams", "radau", "rk4"):
        run = vlmb.simulate(slide(law), 1.0, method)
        assert run.status == "failed" and "at t = 0.3 s" in run.message
    root, wave = 2.0 * (math.sqrt(0.3) + math.sqrt(0.7)), float(sum(sici([0.3, 0.7])[0]))
    for tame, impulse in (("abs(t - 0.3)**-0.5", root), ("sin(t - 0.3)/(t - 0.3)", wave)):
        run = vlmb.simulate(slide(tame), 1.0)
        assert run["xi1_1_dot"][-1] == pytest.approx(1.0 + impulse, abs=1e-4)


def test_a_switch_counts_at_any_time_of_the_clock() -> None:
    """What is kept away from a break is a share of the time, and is gone over all the same."""
    for t0 in (0.0, 1e3, 1e6):
        run = vlmb.simulate(slide(f"where(t < {t0 + 0.5!r}, 2, -3)", 9.0), 1.0, t0=t0, rtol=1e-10, atol=1e-12)
        rounding = 10.0 * math.ulp(t0 + 1.0)  # [m] at some 10 m/s
        assert run["xi1_1"][-1] == pytest.approx(1.0 + 9.0 + 0.25 + 0.5 - 0.375, abs=1e-9 + 4.0 * rounding)


@pytest.mark.parametrize("law", ["1 - 2*sign(xi1_1_dot)", "-2*sign(xi1_1_dot)", "where(xi1_1 < 1.2, 5, -7)"])
def test_what_is_driven_back_to_a_switch_is_told_soon(law: str) -> None:
    """Friction as a sign of the velocity holds: no motion along the switch is defined; a spring of two sides swings on."""
    run = vlmb.simulate(slide(law, 1.0), 2.0)
    assert run.stats["rhs_evaluations"] < 20_000
    assert run.status == "finished" if "where" in law else "both sides of this switch drive back to it" in run.message


@pytest.mark.parametrize(("size", "law"), [
    (1e-4, "0.3 + 0.2*abs(sin(t))"), (1.0, "0.3 + 0.00004*abs(t - 0.51)"), (1.0, "0.3 + 5e-8*step(t - 0.51)"),
    (1.0, "where(t <= 0, 0.2, 0.3)"),
])  # fmt: skip
def test_a_small_jump_of_a_given_length_is_a_jump(size: float, law: str) -> None:
    given: dict[str, Any] = {"motion": "prescribed", "law": f"{size!r}*({law})"}
    rod = {"length": size, "mass": 1.0}
    scene = {"base": PIVOT, "links": [{"name": "m", "rod": rod, "lower": given}], "start": {"psi1": 0.3}}
    for ask in (vlmb.check, lambda each: vlmb.simulate(each, 4.0)):
        with pytest.raises(vlmb.SceneError, match="is not smooth enough at t = "):
            ask({**scene, "run": {"duration": 4.0}})
    for smooth in ("0.3 + 1e-3*abs(t - 0.5)**1.5", "0.3 + 0.01*abs(t - 0.5)*(t - 0.5)", "0.3 + 0.1*max(0, t)"):
        given["law"] = f"{size!r}*({smooth})"
        assert vlmb.simulate(scene, 1.0).status == "finished"


@pytest.mark.parametrize("method", ["rk4", "gauss", "euler"])
def test_fixed_steps_that_may_pass_over_a_law_are_doubtful(method: str) -> None:
    for width, doubtful in ((1e-4, True), (1e-3, True), (0.2, False)):
        law = f"exp(-((t - 0.52031)/{width})**2)/{width}"
        run = vlmb.simulate(slide(law, 20.0), 1.0, method, step=0.01)
        assert any("steps of 0.01 s may pass over that; shorten them" in doubt for doubt in run.doubts) == doubtful


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("wave", [30.0, 300.0])
def test_events_that_the_motion_knows_nothing_of_are_all_found(wave: float, engine: str) -> None:
    """From 1 to 3 m, free of forces: steps would be seconds long."""
    count = math.floor(3.0 * wave / math.pi) - math.ceil(wave / math.pi) + 1
    scene = slide("0") | {"events": [{"name": "node", "when": f"sin({wave}*xi1_1) = 0", "direction": "both"}]}
    times = [event.t for event in vlmb.simulate(scene, 2.0, engine=engine).events if event.name == "node"]
    assert len(times) == count
    np.testing.assert_allclose(np.diff(times), math.pi / wave, rtol=1e-6)
    for until in ("abs(xi1_1 - 2) - 1e-5", "max(xi1_1 - 2, 2 - xi1_1) - 1e-5"):
        assert vlmb.simulate(slide("0"), 2.0, until=until, engine=engine).t[-1] == pytest.approx(0.99999, abs=1e-9)
