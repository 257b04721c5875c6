"""Events are roots on the dense output: limits, the snow, links that line up; in order, with direction, whatever the samples."""

from __future__ import annotations

import math
import re

import msgspec
import numpy as np
import pytest

import vlmb
from tests.small_scenes import FIXED, PIVOT, SKI, TIGHT, link, scene

ENGINES = ("core", "pinocchio")
both_engines = pytest.mark.parametrize("engine", ENGINES)
# Oscillations ----------------------------------------------------------------------------------------------------------

MASS, STIFFNESS, SWING = 2.0, 800.0, 0.1
OMEGA = math.sqrt(STIFFNESS / MASS)
MIDDLE = 1.0 + MASS * 9.81 / STIFFNESS
PERIOD = 2 * math.pi / OMEGA


def oscillator(limits: list[float]) -> vlmb.Scene:
    """A hanging mass on a spring, released `SWING` above its equilibrium: xi = MIDDLE - SWING cos(OMEGA t)."""
    leg = {"length": 1.0, "rest": 1.0, "stiffness": STIFFNESS, "limits": limits}
    bob = {"name": "bob", "rod": {"length": 0.0, "mass": 0.0}, "lower": leg, "tip_mass": MASS}
    return scene(PIVOT, [bob], start={"psi1": -math.pi / 2, "xi1_1": MIDDLE - SWING})


SAMPLES = {
    "fine": np.linspace(0.0, 2.5 * PERIOD, 400),
    "coarse": np.linspace(0.0, 2.4 * PERIOD, 9),
    "in step with the swing": np.arange(3) * PERIOD,  # every sample sees the same posture at rest
    "the end alone": np.array([2 * PERIOD]),
}


@both_engines
@pytest.mark.parametrize("method", ["adams", "dop853", "rk4"])
@pytest.mark.parametrize("samples", SAMPLES)
@pytest.mark.parametrize("share", [0.3, 0.9, 1 - 1e-6])
def test_a_segment_at_its_limit_stops_the_run(share: float, samples: str, method: str, engine: str) -> None:
    """Also where it only grazes the limit, between two samples."""
    limit = MIDDLE + share * SWING
    options = {"method": method, "engine": engine, "rtol": 1e-10, "atol": 1e-12}
    trajectory = vlmb.simulate(oscillator([0.5, limit]), duration=3 * PERIOD, t_eval=SAMPLES[samples], **options)
    assert trajectory.status == "stopped"
    assert f"xi1_1 reached its limit {limit:g} m" in trajectory.message
    expected = math.acos(-share) / OMEGA
    tolerance = 1e-7 if method == "rk4" else 1e-9 if share < 0.95 else 1e-4
    assert trajectory.t[-1] == pytest.approx(expected, abs=tolerance)
    assert trajectory["xi1_1"][-1] == pytest.approx(limit, abs=1e-9)
    assert (trajectory.t[:-1] < trajectory.t[-1]).all()
    assert f"{trajectory.t[-1]:.6g} s" in trajectory.message


@both_engines
@pytest.mark.parametrize("samples", SAMPLES)
def test_a_segment_within_its_limits_does_not_stop(samples: str, engine: str) -> None:
    limits = [MIDDLE - SWING * (1 + 1e-6), MIDDLE + SWING * (1 + 1e-6)]
    options = {"t_eval": SAMPLES[samples], "method": "dop853", "engine": engine}
    trajectory = vlmb.simulate(oscillator(limits), duration=3 * PERIOD, **options)
    assert trajectory.status == "finished", trajectory.message


@both_engines
@pytest.mark.parametrize("method", ["adams", "dop853", "rk4", "bdf"])
def test_a_limit_far_from_the_start_is_met_by_long_steps(method: str, engine: str) -> None:
    """A free segment flies from 0.7 m to its limits at constant speed, or passes near one and is thrown back."""
    bob = {"rod": {"length": 0.0, "mass": 0.0}, "lower": {"length": 0.7, "limits": [0.1, 2.0]}, "tip_mass": 1.0}
    for rate, limit in ((-0.4, 0.1), (0.8, 2.0)):
        flying = scene(PIVOT, [bob], gravity=0.0, start={"psi1": 0.3, "xi1_1_dot": rate})
        trajectory = vlmb.simulate(flying, duration=9.0, t_eval=[9.0], method=method, engine=engine)
        assert f"xi1_1 reached its limit {limit:g} m" in trajectory.message
        assert trajectory.t[-1] == pytest.approx((limit - 0.7) / rate, abs=1e-10)
    # without forces a mass passes the hinge on a straight line: xi^2 = b^2 + (v t - x)^2, nearest at t = x / v
    x, nearest, speed = 0.6, 0.3, 1.5
    start = {"psi1": 0.0, "phi1": 0.0, "xi1_1": math.hypot(x, nearest)}
    start |= {"xi1_1_dot": -speed * x / start["xi1_1"], "phi1_dot": speed * nearest / start["xi1_1"] ** 2}
    for low, stops in ((nearest - 1e-5, False), (nearest + 1e-5, True)):
        leg = {"length": 0.7, "limits": [low, 2.0]}
        trajectory = vlmb.simulate(
            scene(PIVOT, [{**bob, "lower": leg}], gravity=0.0, start=start), duration=0.9, t_eval=[0.9], method=method,
            engine=engine, rtol=1e-10, atol=1e-12,
        )  # fmt: skip
        assert (trajectory.status == "stopped") == stops, trajectory.message
        if stops:
            expected = (x - math.sqrt(low**2 - nearest**2)) / speed
            assert trajectory.t[-1] == pytest.approx(expected, abs=1e-6)


# Long steps ----------------------------------------------------------------------------------------------------------


@both_engines
@pytest.mark.parametrize("method", ["adams", "dop853", "bdf"])
@pytest.mark.parametrize("beyond", [1e-3, 1e-4])
@pytest.mark.parametrize("stiffness", [40.0, 47.0, 55.0])
def test_a_leg_that_starts_far_from_the_limit_at_its_length(method: str, beyond: float, stiffness: float, engine: str) -> None:
    """One swing of a leg crouched at the start just passes its full length, which is its limit."""
    leg = {"length": 2.0, "rest": 1.25, "stiffness": stiffness, "limits": [0.1, 2.0]}
    bob = {"rod": {"length": 0.0, "mass": 0.0}, "tip_mass": 1.0, "lower": leg}
    swinging = scene(PIVOT, [bob], gravity=0.0, start={"psi1": 0.3, "xi1_1": 0.5 - beyond}, run={})
    trajectory = vlmb.simulate(swinging, duration=0.9, method=method, t_eval=[0.9], engine=engine)
    assert "xi1_1 reached its limit 2 m" in trajectory.message
    assert trajectory.t[-1] == pytest.approx(math.acos(-0.75 / (0.75 + beyond)) / math.sqrt(stiffness), abs=1e-5)


def swinger(high: float) -> vlmb.Scene:
    leg = {"length": 0.7, "rest": 0.6, "stiffness": 40.0, "limits": [0.01, high]}
    bob = {"rod": {"length": 0.0, "mass": 0.0}, "tip_mass": 1.0, "lower": leg}
    return scene(PIVOT, [bob], start={"psi1": -0.4, "phi1_dot": 2.0, "psi1_dot": 1.0, "xi1_1_dot": 0.5})


@both_engines
@pytest.mark.parametrize("below", [1e-12, 1e-10, 1e-8, 1e-6, 1e-4])
@pytest.mark.parametrize("when", [1.0 / 60.0 + 0.5, 0.5])
def test_an_event_on_a_sample_is_not_lost(below: float, when: float, engine: str) -> None:
    options = {"engine": engine, "rtol": 1e-6, "atol": 1e-8}
    free = vlmb.simulate(swinger(50.0), duration=3.0, t_eval=[when, 3.0], **options)
    trajectory = vlmb.simulate(swinger(free["xi1_1"][0] - below), duration=3.0, t_eval=[3.0], **options)
    assert trajectory.status == "stopped"
    assert trajectory.t[-1] == pytest.approx(when, abs=1e-3)


@both_engines
@pytest.mark.parametrize("method", ["adams", "dop853"])
def test_a_failure_tells_its_time_however_sparse_the_samples(method: str, engine: str) -> None:
    bob = {"rod": {"length": 0.0, "mass": 0.0}, "tip_mass": 1.0, "lower": {"length": 0.7, "limits": [0.1, math.inf]}}
    forces = [{"on": "F1_1", "law": "exp(exp(8*t))"}]
    runaway = scene(PIVOT, [bob], gravity=0.0, start={"psi1": -0.4}, forces=forces)
    told = []
    for times in ([0.0, 3.0], np.linspace(0.0, 3.0, 3001)):
        run = vlmb.simulate(runaway, duration=3.0, t_eval=times, method=method, engine=engine)
        assert run.status == "failed"
        told.append(float(re.findall(r"failed at t = (\S+) s", run.message)[0]))
    assert told[0] == told[1]
    assert run.t[-1] == pytest.approx(told[1], abs=1e-3)
    assert 0.45 < told[0] < math.log(math.log(1.8e308)) / 8  # where the force has no finite value


def test_many_steps_between_two_samples_are_no_failure() -> None:
    """A stiff leg takes any number of steps from one sample to the next."""
    leg = {"length": 0.5, "stiffness": 4e6, "limits": [0.1, 3.0]}
    bob = {"rod": {"length": 0.0, "mass": 0.0}, "tip_mass": 1.0, "lower": leg}
    stiff = scene(PIVOT, [bob], start={"psi1": -0.4, "xi1_1": 0.5001})
    for method in ("adams", "dop853"):
        trajectory = vlmb.simulate(stiff, duration=30.0, t_eval=[30.0], rtol=1e-8, atol=1e-10, method=method)
        assert trajectory.status == "finished", trajectory.message
        assert trajectory.stats["steps"] > 40_000


@both_engines
def test_a_prescribed_length_that_leaves_its_limits_for_a_moment(engine: str) -> None:
    law = "0.5 + 0.3*exp(-((t - 3.335)/0.002)**2)"  # between two of the points that are looked at beforehand
    made = scene(PIVOT, [link("a", lower={"motion": "prescribed", "law": law, "limits": [0.1, 0.7]})], gravity=0.0)
    trajectory = vlmb.simulate(made, duration=10.0, t_eval=[10.0], method="dop853", engine=engine)
    assert "xi1_1 reached its limit 0.7 m" in trajectory.message


def random_swing(seed: int) -> vlmb.Scene:
    """One to three links on springs between limits, started anywhere between them."""
    random = np.random.default_rng(seed)
    count, links, start = int(random.integers(1, 4)), [], {}
    for i in range(1, count + 1):
        length = random.uniform(0.2, 0.6)
        low, high = length * random.uniform(0.0, 0.7), length * random.uniform(1.2, 2.5)
        leg = {"length": length, "rest": length * random.uniform(0.8, 1.2), "stiffness": random.uniform(50.0, 3000.0)}
        rod = {"length": 0.3, "mass": random.uniform(0.5, 3.0)}
        links.append({"rod": rod, "lower": {**leg, "limits": [low, high]}, "tip_mass": random.uniform(0.1, 2.0)})
        start |= {f"psi{i}": random.uniform(-1.2, 1.2), f"phi{i}": random.uniform(-2.0, 2.0)}
        start |= {f"psi{i}_dot": random.uniform(-3.0, 3.0), f"xi{i}_1": low + (high - low) * random.uniform(0.1, 0.9)}
    base = [PIVOT, SKI, {"kind": "free", "mass": 1.0}][seed % 3]
    return scene(base, links, start=start, gravity=float(random.choice([0.0, 3.0, 9.81])))


@both_engines
@pytest.mark.parametrize("method", ["adams", "dop853"])
def test_long_steps_find_what_short_ones_find(method: str, engine: str) -> None:
    ended = []
    for seed in range(30):
        options = {"duration": 2.0, "method": method, "rtol": 1e-9, "atol": 1e-11, "t_eval": [2.0]}
        long = vlmb.simulate(random_swing(seed), engine=engine, **options)
        short = vlmb.simulate(random_swing(seed), engine="core", max_step=1e-3, **options)
        assert short.stats["steps"] >= 1000.0 * (short.t[-1] - 1e-3)
        assert long.status == short.status, seed
        assert long.message.rpartition(":")[2] == short.message.rpartition(":")[2] or long.status == "finished"
        assert long.t[-1] == pytest.approx(short.t[-1], abs=1e-5)
        ended.append(long.status)
    assert min(ended.count("stopped"), ended.count("finished")) >= 5


@both_engines
@pytest.mark.parametrize("after, status", [(0.2, "interrupted"), (0.46, "stopped")])
def test_an_interrupt_near_a_limit_keeps_no_sample_beyond_it(after: float, status: str, engine: str) -> None:
    bob = {"rod": {"length": 0.0, "mass": 0.0}, "tip_mass": 1.0, "lower": {"length": 0.7, "limits": [0.1, 1.0]}}
    flying = scene(PIVOT, [bob], gravity=0.0, start={"psi1": 0.3, "xi1_1_dot": 1.0})

    def interrupt(t: float) -> None:
        if t > after:
            raise KeyboardInterrupt

    options = {"t_eval": np.linspace(0.0, 3.0, 601), "progress": interrupt, "engine": engine}
    trajectory = vlmb.simulate(flying, duration=3.0, **options)
    assert trajectory["xi1_1"].max() <= 1.0
    assert trajectory.status == status
    assert trajectory.t[-1] == pytest.approx(min(after, 0.3), abs=0.01)


@both_engines
@pytest.mark.parametrize("method", ["dop853", "radau", "adams"])
@pytest.mark.parametrize("law", ["0.3 + 0.02*max(0, t - 0.37)**2", "0.3 + 0.05*abs(t - 0.5)**3"])
def test_laws_with_kinks_under_every_driver(method: str, law: str, engine: str) -> None:
    made = scene(PIVOT, [link("a", lower={"motion": "prescribed", "law": law})], start={"psi1": 0.3})
    options = {"method": method, "engine": engine, "rtol": 1e-6, "atol": 1e-8}
    assert vlmb.simulate(made, duration=1.0, t_eval=[1.0], **options).status == "finished"


@both_engines
def test_the_lower_limit_and_the_default_one(engine: str) -> None:
    low = MIDDLE - 0.5 * SWING
    start = {"psi1": -math.pi / 2, "xi1_1": MIDDLE + SWING}
    made = msgspec.structs.replace(oscillator([low, 2.0]), start=start)
    stopped = vlmb.simulate(made, duration=1.0, engine=engine)
    assert f"limit {low:g} m" in stopped.message
    assert stopped.t[-1] == pytest.approx(math.acos(-0.5) / OMEGA, abs=1e-7)
    # without limits a segment may not shrink past zero
    bob = {"rod": {"length": 0.0, "mass": 0.0}, "lower": {"length": 0.2}, "tip_mass": 1.0}
    thrown = scene(PIVOT, [bob], start={"psi1": -math.pi / 2, "xi1_1_dot": -3.0}, gravity=0.0)
    trajectory = vlmb.simulate(thrown, duration=1.0, engine=engine)
    assert "xi1_1 reached its limit 0 m" in trajectory.message
    assert trajectory.t[-1] == pytest.approx(0.2 / 3.0, abs=1e-10)


@both_engines
def test_a_start_on_the_limit(engine: str) -> None:
    leaving = msgspec.structs.replace(oscillator([MIDDLE - SWING, 3.0]))
    assert vlmb.simulate(leaving, duration=0.2 * PERIOD, engine=engine).status == "finished"
    bob = {"rod": {"length": 0.0, "mass": 0.0}, "lower": {"length": 0.5, "limits": [0.1, 0.5]}, "tip_mass": 1.0}
    beyond = scene(PIVOT, [bob], gravity=0.0, start={"psi1": 0.3, "xi1_1_dot": 1.0})
    trajectory = vlmb.simulate(beyond, duration=1.0, engine=engine)
    assert trajectory.status == "stopped"
    assert trajectory.t.tolist() == [0.0]


RIDER = link("legs", lower=FIXED, upper=FIXED)


@both_engines
def test_a_fall_stops_the_run_at_the_snow(engine: str) -> None:
    made = scene(SKI, [RIDER], start={"psi1": 1.2, "speed": 2.0, "phi1": 0.4}, run={**TIGHT, "fall": True})
    trajectory = vlmb.simulate(made, duration=5.0, engine=engine)
    assert trajectory.status == "stopped"
    assert "fall: legs." in trajectory.message
    assert trajectory.position("legs")[-1, 2] == pytest.approx(0.0, abs=1e-10)
    assert trajectory.position("legs")[:-1, 2].min() > 0.0
    going_on = vlmb.simulate(scene(SKI, [RIDER], start={"psi1": 1.2, "speed": 2.0, "phi1": 0.4}), duration=1.5)
    assert going_on.status == "finished"
    assert going_on.position("legs")[:, 2].min() < 0.0


@both_engines
def test_a_fall_between_two_samples_is_not_missed(engine: str) -> None:
    """A rider who swings through the snow and up again: above it at every sample."""
    keys = {"start": {"psi1": 0.5}, "plane": True}
    free = vlmb.simulate(scene(SKI, [RIDER], **keys), duration=3.0, t_eval=np.linspace(0, 3, 3001))
    turning = float(free.t[np.argmax(free["psi1"] < -math.pi - 0.45)])
    assert turning > 0.5
    made = scene(SKI, [RIDER], **{**keys, "run": {**TIGHT, "fall": True}})
    trajectory = vlmb.simulate(made, duration=3.0, t_eval=[0.0, turning])
    assert trajectory.status == "stopped", trajectory.message
    assert trajectory.t[-1] == pytest.approx(float(free.t[np.argmax(free["psi1"] < 0.0)]), abs=2e-3)


def test_a_pivoted_chain_does_not_fall() -> None:
    trajectory = vlmb.simulate(scene(PIVOT, [RIDER], start={"psi1": -1.0}, run={"fall": True}), duration=0.5)
    assert trajectory.status == "finished"


# Roots ---------------------------------------------------------------------------------------------------------------

PISTON = {"rod": {"length": 0.0, "mass": 0.0}, "tip_mass": 1.0}


def pistons(speeds: list[float], limits: list[list[float]]) -> vlmb.Scene:
    """Masses on sticks from one hinge, free of forces, that slide out or in at constant speeds from 1 m."""
    links = [
        {**PISTON, "name": f"p{i}", "parent": "base", "lower": {"length": 1.0, "limits": span}}
        for i, span in enumerate(limits, 1)
    ]
    start = {f"psi{i}": 0.2 * i for i in range(1, len(links) + 1)} | {f"xi{i}_1_dot": v for i, v in enumerate(speeds, 1)}
    return scene(PIVOT, links, gravity=0.0, start=start)


@both_engines
@pytest.mark.parametrize("method", ["dop853", "adams", "radau", "rk4"])
def test_the_first_of_several_events_in_a_step_ends_the_run(method: str, engine: str) -> None:
    """The steps of so plain a motion are as long as the run: three limits lie in one."""
    made = pistons([1.0, -1.0, 2.0], [[0.0, 1.35], [0.68, 2.0], [0.0, 1.66]])
    run = vlmb.simulate(made, duration=1.0, method=method, engine=engine, step=1.0, t_eval=[0.1, 0.3, 0.5])
    assert run.stats["steps"] < 20
    assert run.message == "stopped at t = 0.32 s: xi2_1 reached its limit 0.68 m."
    assert run.t[:-1].tolist() == [0.1, 0.3]
    assert run.t[-1] == pytest.approx(0.32, abs=1e-10)
    np.testing.assert_allclose(run["xi3_1"], 1.0 + 2.0 * run.t, rtol=0, atol=1e-10)


@both_engines
@pytest.mark.parametrize("method", ["dop853", "adams", "radau"])
@pytest.mark.parametrize("beyond", [1e-2, 1e-5, -1e-5])
def test_two_crossings_within_one_step(method: str, beyond: float, engine: str) -> None:
    """x = 1 + t - t^2 goes past a limit and comes back; a step of any method spans it whole."""
    limit = 1.25 - beyond
    slide = {**PISTON, "lower": {"length": 1.0, "limits": [0.0, limit]}}
    forces = [{"on": "F1_1", "law": -2.0}]
    made = scene(PIVOT, [slide], gravity=0.0, plane=True, start={"psi1": 0.0, "xi1_1_dot": 1.0}, forces=forces)
    run = vlmb.simulate(made, duration=0.9, method=method, engine=engine, t_eval=[0.9], rtol=1e-10, atol=1e-12)
    assert run.status == ("stopped" if beyond > 0.0 else "finished"), run.message
    if beyond > 0.0:
        assert run.t[-1] == pytest.approx(0.5 - math.sqrt(beyond), abs=1e-10 / math.sqrt(beyond))


@both_engines
@pytest.mark.parametrize("rate", [0.5, 1.7])
def test_a_line_up_is_an_event_where_a_spring_has_no_axis_then(rate: float, engine: str) -> None:
    """Two rods from one hinge turn at constant rates in one plane; told whatever the tolerance."""
    rods = [{"name": name, "parent": "base", "rod": {"length": 0.5, "mass": 1.0}} for name in "ab"]
    spring = {"between": ["a", "b"], "stiffness": 1e-50, "rest": 0.8}
    start = {"psi1": 0.1, "psi2": 1.0, "psi1_dot": 1.0, "psi2_dot": -rate, "phi1": 0.3, "phi2": 0.3}
    made = scene(PIVOT, rods, gravity=0.0, start=start, forces=[spring])
    for rtol in (1e-3, 1e-11):
        run = vlmb.simulate(made, duration=2.0, engine=engine, rtol=rtol, atol=rtol, t_eval=[2.0])
        assert run.status == "stopped" and "a and b line up" in run.message, run.message
        assert run.t[-1] == pytest.approx(0.9 / (1.0 + rate), abs=1e-10 if rtol < 1e-9 else 1e-3)


@both_engines
def test_two_directions_that_pass_each_other_do_not_line_up(engine: str) -> None:
    rods = [{"name": name, "parent": "base", "rod": {"length": 0.5, "mass": 1.0}} for name in "ab"]
    spring = {"between": ["a", "b"], "stiffness": 1e-50, "rest": 0.8}
    start = {"psi1": 0.1, "psi2": 1.0, "psi1_dot": 1.0, "psi2_dot": -1.0, "phi1": 0.3, "phi2": 0.301}
    made = scene(PIVOT, rods, gravity=0.0, start=start, forces=[spring])
    assert vlmb.simulate(made, duration=2.0, engine=engine).status == "finished"


@both_engines
def test_an_event_at_the_end_and_one_right_after_the_start(engine: str) -> None:
    late = vlmb.simulate(pistons([1.0], [[0.0, 1.5 + 1e-9]]), duration=0.5, engine=engine)
    assert late.status == "finished" and late.t[-1] == 0.5
    soon = vlmb.simulate(pistons([1.0], [[0.0, 1.0 + 1e-9]]), duration=0.5, engine=engine)
    assert soon.status == "stopped" and soon.t[-1] == pytest.approx(1e-9, abs=1e-12)


@both_engines
@pytest.mark.parametrize("method", ["dop853", "adams", "radau", "gauss"])
def test_the_longest_step_is_kept(method: str, engine: str) -> None:
    run = vlmb.simulate(pistons([1.0], [[0.0, 9.0]]), duration=1.0, method=method, engine=engine, max_step=0.01, step=0.01)
    assert run.stats["steps"] >= 100
    with pytest.raises(vlmb.SceneError, match="max_step"):
        vlmb.simulate(pistons([1.0], [[0.0, 9.0]]), max_step=0.0)


@both_engines
@pytest.mark.parametrize("share", [0.3, 0.9])
def test_the_end_is_as_good_as_the_steps(share: float, engine: str) -> None:
    """At the default tolerance, by an exact solution: what is left is what the steps before have lost."""
    made = oscillator([0.5, MIDDLE + share * SWING])
    trajectory = vlmb.simulate(made, 1.0, rtol=1e-6, atol=1e-9, engine=engine)
    assert trajectory.t[-1] == pytest.approx(math.acos(-share) / OMEGA, abs=1e-8)
    assert trajectory["xi1_1"][-1] <= MIDDLE + share * SWING


@both_engines
def test_a_switch_of_the_state_is_located_as_well_as_the_steps_are(engine: str) -> None:
    """A push that ends at the middle: from there on the swing is larger, by v^2 of energy."""
    made = oscillator([0.1, 3.0])
    push = 40.0  # [N] shifts the equilibrium of the first quarter by push / STIFFNESS
    pushed = made.changed(forces=[{"on": "F1_1", "law": f"where(xi1_1 < {MIDDLE!r}, {push!r}, 0)"}])
    first = SWING + push / STIFFNESS
    at = math.acos(push / STIFFNESS / first) / OMEGA
    speed = first * OMEGA * math.sin(OMEGA * at)
    found = vlmb.simulate(pushed, at + 0.4 * PERIOD, rtol=1e-6, atol=1e-9, engine=engine)
    exact = MIDDLE + speed / OMEGA * math.sin(OMEGA * (found.t[-1] - at))
    assert found["xi1_1"][-1] == pytest.approx(exact, abs=5e-8)
