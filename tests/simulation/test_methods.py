"""Every method on both engines: its order on real mechanisms, the samples asked for, kinks of laws, the end of their domain."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.small_scenes import FIXED, FLYING, PIVOT, SKI, bent, link, scene
from vlmb.simulation.methods import METHODS, find_method
from vlmb.system.dense import Dense

Array = np.ndarray
ENGINES = ("core", "pinocchio")
FIXED_STEP = [name for name, method in METHODS.items() if not method.adaptive]
ADAPTIVE = [name for name, method in METHODS.items() if method.adaptive]

SPINNING = scene(
    PIVOT, [link("a", lower={"length": 0.3, "stiffness": 300.0}, upper={"length": 0.2, "stiffness": 200.0})],
    start={"psi1": 0.4, "phi1": 0.2, "phi1_dot": 4.0, "psi1_dot": -2.0, "xi1_1_dot": 0.5},
)  # fmt: skip
SKIER = bent(SKI, 1, slope=0.2, start={"psi1": 1.1, "phi1": 0.5, "phi0": 0.3, "phi0_dot": 1.5, "speed": 2.0, "phi1_dot": 2.0})
SMOOTH = {"spinning spring link": SPINNING, "skier": SKIER, "flying chain": bent(FLYING, 2)}


def state_at_end(made: vlmb.Scene, seconds: float, **options: Any) -> Array:
    """Points and rates at the end."""
    trajectory = vlmb.simulate(made, duration=seconds, t_eval=[seconds], **options)
    assert trajectory.status == "finished", trajectory.message
    assert trajectory.stats["engine"] == options.get("engine", "core")
    points = [
        trajectory.position(entry.name, point)[-1]
        for entry in trajectory.mechanism.layout.links
        for point in ("rod_start", "tip")
    ]
    return np.concatenate([*points, [trajectory[f"{name}_dot"][-1] for name in trajectory.mechanism.coordinate_names]])


# Orders --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", SMOOTH)
@pytest.mark.parametrize("method", FIXED_STEP)
def test_order_of_fixed_step_methods(method: str, name: str, engine: str) -> None:
    """The slope of the error over the step is the order, with quaternions that turn and a heading that turns."""
    made, seconds = SMOOTH[name], 0.4
    exact = state_at_end(made, seconds, method="dop853", rtol=1e-13, atol=1e-13)
    order = METHODS[method].order
    counts = (2000, 4000, 8000) if order == 1 else (80, 160, 320)
    ends = [state_at_end(made, seconds, method=method, step=seconds / count, engine=engine) for count in counts]
    errors = [np.abs(end - exact).max() for end in ends]
    slopes = np.diff(np.log(errors)) / np.diff(np.log([1.0 / count for count in counts]))
    assert slopes[-1] == pytest.approx(order, abs=0.1), (errors, slopes)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", SMOOTH)
@pytest.mark.parametrize("method", ADAPTIVE)
def test_tolerances_are_kept(method: str, name: str, engine: str) -> None:
    """Errors fall with rtol, by at least half a decade for each decade, and stay within a fair multiple of it.

    A coarse run may be better than asked by chance: from then on they fall from what was asked.
    """
    made, seconds = SMOOTH[name], 0.3
    exact = state_at_end(made, seconds, method="dop853", rtol=1e-13, atol=1e-13)
    tolerances = (1e-4, 1e-6, 1e-8) if method in ("bdf", "radau") else (1e-4, 1e-7, 1e-10)
    ends = [state_at_end(made, seconds, method=method, rtol=tol, atol=tol, engine=engine) for tol in tolerances]
    errors = [np.abs(end - exact).max() for end in ends]
    for tolerance, error in zip(tolerances, errors, strict=True):
        assert error < 5e3 * tolerance
    decades = math.log10(tolerances[0] / tolerances[-1])
    assert math.log10(max(errors[0], tolerances[0]) / errors[-1]) > 0.5 * decades


def test_methods_know_what_they_are() -> None:
    assert {"euler", "rk4", "gauss", "dop853", "adams", "bdf", "radau"} == set(METHODS)
    assert (METHODS["euler"].order, METHODS["rk4"].order, METHODS["dop853"].order) == (1, 4, 8)
    assert all(name == method.name and method.purpose for name, method in METHODS.items())
    with pytest.raises(vlmb.SceneError, match=r"'rk5'.*did you mean 'rk4'"):
        find_method("rk5")


def test_the_integrator_of_pinocchio_alone_would_be_of_order_two() -> None:
    """The counterpart: naive rk4 through pin.integrate loses its order on a ball joint; ours does not."""
    import pinocchio as pin

    from vlmb.system.start import consistent_start
    from vlmb.system.system import make_system

    mechanism = vlmb.build(SPINNING)
    model, workspace, seconds = mechanism.model, make_system(mechanism).workspace(), 0.4
    start = consistent_start(make_system(mechanism)).state

    def velocity_at_end(**options: Any) -> Array:
        return vlmb.simulate(SPINNING, duration=seconds, t_eval=[seconds], engine="pinocchio", **options).v[-1]

    exact = velocity_at_end(method="dop853", rtol=1e-13, atol=1e-13)

    def naive(count: int) -> Array:
        q, v, h = start.q, start.v, seconds / count

        def acceleration(q: Array, v: Array) -> Array:
            return workspace.rhs(0.0, np.concatenate([q, v]))[model.nq :].copy()

        for _ in range(count):
            k1 = acceleration(q, v)
            v2 = v + 0.5 * h * k1
            k2 = acceleration(pin.integrate(model, q, 0.5 * h * v), v2)
            v3 = v + 0.5 * h * k2
            k3 = acceleration(pin.integrate(model, q, 0.5 * h * v2), v3)
            v4 = v + h * k3
            k4 = acceleration(pin.integrate(model, q, h * v3), v4)
            q = pin.integrate(model, q, h / 6 * (v + 2 * v2 + 2 * v3 + v4))
            v = v + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return v

    errors = [np.abs(naive(count) - exact).max() for count in (160, 320)]
    assert math.log2(errors[0] / errors[1]) < 3.5
    ours = [np.abs(velocity_at_end(method="rk4", step=seconds / count) - exact).max() for count in (160, 320)]
    assert math.log2(ours[0] / ours[1]) > 3.8
    assert ours[1] < errors[1]


# Landing on samples --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", METHODS)
def test_the_solution_at_every_time_asked_for(method: str, engine: str) -> None:
    """x'' = cos t at irregular times, several within a step; nobody asks for the forces after the end."""
    times = np.array([1e-9, 0.003, 0.0031, 0.0032, 0.1, 0.123456789, 0.5, 0.50000001, 0.75, 0.9999, 1.0])
    options = {"method": method, "engine": engine, "rtol": 1e-10, "atol": 1e-12, "step": 1e-4 if method == "euler" else 0.01}
    trajectory = vlmb.simulate(pushed("2*cos(t)"), duration=1.0, t_eval=times, **options)
    tolerance = 2e-4 if method == "euler" else 1e-8
    assert np.array_equal(trajectory.t, times)
    np.testing.assert_allclose(trajectory["xi1_1"], 2.0 - np.cos(times), rtol=0, atol=tolerance)
    np.testing.assert_allclose(trajectory["xi1_1_dot"], np.sin(times), rtol=0, atol=tolerance)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", METHODS)
def test_what_lies_beyond_the_end_changes_nothing(method: str, engine: str) -> None:
    """The control is not asked beyond it, however the samples lie."""
    runs, asked = [], []
    for wall in (0.0, 1e6):

        def control(t: float, view: Any, wall: float = wall) -> dict[str, float]:
            asked.append(t)
            return {"F1_1": 2.0 * math.cos(3 * t) if t <= 0.7 else wall}

        options = {"method": method, "engine": engine, "rtol": 1e-9, "atol": 1e-10}
        runs.append(vlmb.simulate(pushed("0"), duration=0.7, control=control, t_eval=[0.2, 0.55, 0.699999, 0.7], **options))
    assert min(asked) == 0.0 and max(asked) == 0.7
    assert np.array_equal(runs[0].states, runs[1].states)
    assert runs[0]["xi1_1_dot"][-1] == pytest.approx(math.sin(2.1) / 3, abs=2e-2 if method == "euler" else 1e-7)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", METHODS)
def test_a_run_inside_another(method: str, engine: str) -> None:
    """A control that looks ahead by a run of its own: the same answer as one that knows."""
    inner = {"duration": 0.01, "t_eval": [0.01], "method": method, "engine": engine, "step": 0.01}

    def looks_ahead(t: float, view: Any) -> dict[str, float]:
        ahead = vlmb.simulate(pushed("2"), **inner)
        return {"F1_1": 2.0 * float(ahead["xi1_1_dot"][-1]) / 0.01}

    options = {"duration": 0.2, "t_eval": [0.1, 0.2], "method": method, "engine": engine, "step": 0.1}
    run, known = (
        vlmb.simulate(pushed("0"), control=control, rtol=1e-4, atol=1e-6, **options)
        for control in (looks_ahead, lambda t, view: {"F1_1": 2.0})
    )
    np.testing.assert_allclose(run["xi1_1"], known["xi1_1"], rtol=0, atol=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", METHODS)
def test_samples_are_exactly_those_asked_for(method: str, engine: str) -> None:
    times = np.array([0.0, 0.001, 0.0123, 0.05, 0.2, 1 / 3])
    options = {"duration": 0.5, "method": method, "engine": engine, "rtol": 1e-6, "atol": 1e-8}
    trajectory = vlmb.simulate(SKIER, t_eval=times, **options)
    assert np.array_equal(trajectory.t, times)
    dense = vlmb.simulate(SKIER, t_eval=np.linspace(0.0, 1 / 3, 50), **options)
    np.testing.assert_allclose(trajectory.v[-1], dense.v[-1], rtol=0, atol=1e-2 if method == "euler" else 1e-4)
    late = vlmb.simulate(SKIER, t_eval=[0.2], **options)
    assert late.t.tolist() == [0.2]
    np.testing.assert_allclose(late.v[0], trajectory.v[4], rtol=0, atol=1e-2 if method == "euler" else 1e-4)
    first = vlmb.simulate(SKIER, t_eval=[0.0], **options)
    assert first.t.tolist() == [0.0]
    assert first.status == "finished"


IMPOSSIBLE: list[Any] = [[], [0.2, 0.1], [0.1, 0.1], [-0.1, 0.2], [0.1, 0.6], [math.nan], [0.1, math.inf], [[0.1, 0.2]], 0.3]


@pytest.mark.parametrize("times", [*IMPOSSIBLE, ["soon"], "soon"], ids=str)
def test_samples_that_cannot_be_are_refused(times: Any) -> None:
    with pytest.raises(vlmb.SceneError, match="t_eval"):
        vlmb.simulate(SKIER, duration=0.5, t_eval=times)


def test_default_samples() -> None:
    short = vlmb.simulate(SKIER, duration=0.1)
    assert len(short) >= 100
    assert (short.t[0], short.t[-1]) == (0.0, 0.1)
    longer = vlmb.simulate(scene(SKI, [], start={"speed": 1.0}), duration=20.0)
    assert len(longer) == 1201
    np.testing.assert_allclose(np.diff(longer.t), 1 / 60, rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_statistics_count(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    original = Dense.rhs

    def counted(self: Any) -> Any:
        inner = original(self)
        return lambda t, y: calls.append(t) or inner(t, y)

    options = {"duration": 0.1, "method": method, "rtol": 1e-6, "atol": 1e-8, "step": 0.005, "max_step": 1.0}
    monkeypatch.setattr(Dense, "rhs", counted)
    trajectory = vlmb.simulate(SKIER, engine="pinocchio", **options)
    assert trajectory.stats["rhs_evaluations"] == len(calls)
    assert 5 <= trajectory.stats["steps"] <= len(calls)
    assert trajectory.stats["wall_time"] > 0.0
    if not METHODS[method].adaptive:
        assert trajectory.stats["steps"] == 20
    asked: list[float] = []
    control = vlmb.simulate(SKIER, engine="core", control=lambda t, view: asked.append(t), **options)
    assert control.stats["rhs_evaluations"] == len(asked) - len(control) - 1  # once for every sample, and for the names
    compiled = vlmb.simulate(SKIER, engine="core", **options)
    assert compiled.stats["rhs_evaluations"] == control.stats["rhs_evaluations"]
    assert compiled.stats["engine"] == "core" and "route" not in compiled.stats


def test_steps_that_do_not_divide_the_time() -> None:
    trajectory = vlmb.simulate(SKIER, duration=0.1, method="rk4", step=0.03)
    assert trajectory.stats["steps"] == 4  # shorter ones, equal
    whole = vlmb.simulate(SKIER, duration=0.1, method="rk4", step=7.0)
    assert whole.stats["steps"] == 1


# Laws with kinks -----------------------------------------------------------------------------------------------------

PUSHED = {"rod": {"length": 0.0, "mass": 0.0}, "lower": {"length": 1.0, "limits": [-9.0, 9.0]}, "tip_mass": 2.0}


def pushed(law: str) -> vlmb.Scene:
    """A point on a horizontal slide under a force law: m x'' = F."""
    return scene(PIVOT, [PUSHED], gravity=0.0, plane=True, start={"psi1": 0.0}, forces=[{"on": "F1_1", "law": law}])


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", METHODS)
def test_a_force_with_kinks(method: str, engine: str) -> None:
    """F = max(0, sin t): x'' = max(0, sin t) / m, known in closed form."""
    times = np.linspace(0.0, 7.0, 57)
    options = {"method": method, "engine": engine, "rtol": 1e-10, "atol": 1e-11, "t_eval": times}
    trajectory = vlmb.simulate(pushed("max(0, sin(2*t))"), duration=7.0, **options)
    assert trajectory.status == "finished", trajectory.message

    def place(t: float) -> float:
        x = v = 0.0  # sin(2 t) pushes for half of each period pi: v gains 1/m, x gains pi/4/m in a push, pi/2 v in a pause
        while t > 0.0:
            s = min(t, math.pi / 2)
            x, v = x + v * s + (s / 2 - math.sin(2 * s) / 4) / 2, v + (1 - math.cos(2 * s)) / 4
            rest = min(max(t - math.pi / 2, 0.0), math.pi / 2)
            x += v * rest
            t -= math.pi
        return 1.0 + x

    expected = np.array([place(t) for t in times.tolist()])
    tolerance = {"euler": 2e-2, "bdf": 1e-6, "radau": 1e-6}.get(method, 1e-8)
    np.testing.assert_allclose(trajectory["xi1_1"], expected, rtol=0, atol=tolerance)


PULSES = {
    "division": "0.5*(abs(t - 1)/(t - 1) - abs(t - 2)/(t - 2))",
    "atan2": "(atan2(t - 1, -1) + atan(t - 1) - atan2(t - 2, -1) - atan(t - 2))/(2*pi)",
}


@pytest.mark.parametrize("pulse", PULSES)
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", METHODS)
def test_a_force_that_jumps(method: str, engine: str, pulse: str) -> None:
    """F = 1 between t = 1 and t = 2: both jumps are found and met exactly."""
    options = {"method": method, "engine": engine, "rtol": 1e-10, "atol": 1e-11, "t_eval": [0.5, 1.0, 1.5, 2.0, 3.0]}
    trajectory = vlmb.simulate(pushed(PULSES[pulse]), duration=3.0, **options)
    assert trajectory.status == "finished", trajectory.message
    expected = [1.0, 1.0, 1.0 + 0.25 * 0.25, 1.25, 1.75]
    tolerance = {"euler": 2e-2, "bdf": 1e-6, "radau": 1e-6}.get(method, 1e-8)
    np.testing.assert_allclose(trajectory["xi1_1"], expected, rtol=0, atol=tolerance)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_law_up_to_the_end_of_its_domain(engine: str) -> None:
    """No method asks the law beyond the duration, where it has no value."""
    for method in METHODS:
        options = {"method": method, "engine": engine, "rtol": 1e-7, "atol": 1e-9}
        trajectory = vlmb.simulate(pushed("3*sqrt(2 - t)"), duration=2.0, **options)
        assert trajectory.status == "finished", (method, trajectory.message)
        expected = 1.0 + 1.5 * (2.0 * (2 / 3) * 2**1.5 - 4 / 15 * 2**2.5)
        assert trajectory["xi1_1"][-1] == pytest.approx(expected, abs=5e-3 if method == "euler" else 1e-4)


@pytest.mark.parametrize("law", ["0.3 + 0.05*abs(sin(3*t))", "0.3 + 0.1*max(0, t - 0.5)", "0.3 + 0.1*min(t, 0.4)"])
def test_a_prescribed_length_needs_a_continuous_rate(law: str) -> None:
    made = scene(PIVOT, [link("a", lower={"motion": "prescribed", "law": law})])
    with pytest.raises(vlmb.SceneError, match=r"xi1_1.*not smooth enough at t = .*continuous rate"):
        vlmb.simulate(made, duration=2.0)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", METHODS)
def test_a_prescribed_length_with_a_smooth_kink(method: str, engine: str) -> None:
    """l = 0.3 + 0.05 max(0, sin 3t)^2 has a continuous rate: l^2 theta' is constant through every kink."""
    bob = {
        "rod": {"length": 0.0, "mass": 0.0},
        "lower": {"motion": "prescribed", "law": "0.3 + 0.05*max(0, sin(3*t))**2"},
        "tip_mass": 1.5,
    }
    made = scene(PIVOT, [bob], gravity=0.0, start={"psi1": 0.0, "phi1_dot": 1.2})
    trajectory = vlmb.simulate(made, duration=2.5, method=method, engine=engine, rtol=1e-10, atol=1e-11)
    assert trajectory.status == "finished", trajectory.message
    s = np.maximum(0.0, np.sin(3 * trajectory.t))
    length = 0.3 + 0.05 * s**2
    tolerance = {"euler": 1e-2, "bdf": 1e-6, "radau": 1e-6}.get(method, 1e-8)
    np.testing.assert_allclose(trajectory["xi1_1"], length, rtol=0, atol=1e-14)
    np.testing.assert_allclose(trajectory["xi1_1_dot"], 0.3 * s * np.cos(3 * trajectory.t), rtol=0, atol=1e-13)
    np.testing.assert_allclose(length**2 * trajectory["phi1_dot"], 0.09 * 1.2, rtol=0, atol=tolerance)
    assert np.abs(trajectory["balance"]).max() < 100 * tolerance


# Short events in time -------------------------------------------------------------------------------------------------

ADAPTIVE_ON = pytest.mark.parametrize("method", ADAPTIVE)


@pytest.mark.parametrize("engine", ENGINES)
@ADAPTIVE_ON
def test_a_bump_in_time_is_not_stepped_over(method: str, engine: str) -> None:
    """A gliding ski, 82.6 kg, under F_x = 1000 exp(-((t - 5.2)/0.05)^2): its speed gains 1000 0.05 sqrt(pi) / 82.6."""
    base = {"kind": "ski", "mass": 82.6, "inertia": 1.2}
    bump = {"on": "F_x", "law": "1000*exp(-((t-5.2)/0.05)**2)"}
    made = scene(base, [], start={"speed": 2.0}, forces=[bump], run={"fall": False})
    run = vlmb.simulate(made, duration=10.0, method=method, engine=engine, t_eval=[0.0, 10.0])
    assert run["speed"][-1] == pytest.approx(2.0 + 50.0 * math.sqrt(math.pi) / 82.6, abs=1e-4)


@pytest.mark.parametrize("engine", ENGINES)
@ADAPTIVE_ON
def test_a_control_that_acts_for_a_moment_is_not_stepped_over(method: str, engine: str) -> None:
    push = 40.0

    def control(t: float, view: Any) -> dict[str, float]:
        return {"F1_1": push if 5.0 < t < 5.2 else 0.0}

    options = {"method": method, "engine": engine, "rtol": 1e-6, "atol": 1e-8}
    run = vlmb.simulate(pushed("0"), duration=10.0, t_eval=[10.0], control=control, **options)
    assert run["xi1_1_dot"][-1] == pytest.approx(push * 0.2 / 2.0, abs=1e-3)


@ADAPTIVE_ON
def test_an_equation_in_time_is_not_stepped_over(method: str) -> None:
    row = "psi1 = 0.7 + 0.2*exp(-((t-5.2)/0.1)**2)"
    made = scene(PIVOT, [link("a")], start={"psi1": 0.7}, gravity=0.0, constraints=[row], run={})
    run = vlmb.simulate(made, duration=10.0, method=method)
    assert run.status == "finished", run.message
    assert np.abs(run.residuals[row].position).max() < 1e-3
    assert run["psi1"].max() > 0.89


@pytest.mark.parametrize("engine", ENGINES)
@ADAPTIVE_ON
def test_a_prescribed_length_that_moves_for_a_moment(method: str, engine: str) -> None:
    law = "0.3 + 0.05*exp(-((t-5.2)/0.05)**2)"
    made = scene(PIVOT, [link("a", lower={"motion": "prescribed", "law": law}, upper=FIXED)], start={"psi1": -1.5}, run={})
    run = vlmb.simulate(made, duration=10.0, method=method, engine=engine)
    assert run.status == "finished", run.message
    assert np.abs(run["balance"]).max() < 1e-2


# Stiff scenes --------------------------------------------------------------------------------------------------------


def stiff(damping: float) -> vlmb.Scene:
    leg = {"length": 0.3, "stiffness": 4e4, "damping": damping}
    return scene(
        SKI,
        [link("leg", lower=leg, upper={"length": 0.2, "motion": "fixed"})],
        start={"psi1": 1.2, "phi1": 0.3, "speed": 2.0, "phi0_dot": 0.5},
    )


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", ["radau", "bdf"])
def test_stiff_damped_legs(method: str, engine: str) -> None:
    """A leg with damping far beyond critical: implicit methods take far fewer steps than explicit ones, and agree."""
    made = stiff(4e4)
    implicit = vlmb.simulate(made, duration=0.3, method=method, engine=engine, rtol=1e-6, atol=1e-8)
    explicit = vlmb.simulate(made, duration=0.3, method="dop853", rtol=1e-9, atol=1e-11)
    assert implicit.status == explicit.status == "finished"
    assert implicit.stats["steps"] < 0.25 * explicit.stats["steps"]
    np.testing.assert_allclose(implicit.position("leg"), explicit.position("leg"), rtol=0, atol=1e-4)
    assert np.abs(implicit["balance"]).max() < 1e-2
