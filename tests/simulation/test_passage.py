"""Closed loops through postures in which their rows lose their independence: windows of bars against one pendulum's equation."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import vlmb
from vlmb.core.jit import COMPILED

Array = NDArray[np.float64]
Scene = dict[str, Any]

BAR = {"rod": {"length": 1.0, "mass": 1.0}}
G = 9.81
FIRST_LINE_UPS = (0.70845, 1.21526, 2.63216)  # [s] of one window from the top at 1 m/s
STILL = math.sqrt(2.4 * G)  # [1/s] at the bottom: one window comes to rest as it lines up


def windows(count: int, rate: float = -1.0, angle: float = 0.5 * math.pi, **run: Any) -> Scene:
    """Standing bars joined by couplers of one length, all of 1 m and 1 kg: all turn by one angle, the couplers stay level."""
    links: list[Scene] = [{"name": "p0", **BAR}]
    start, rows = {"psi1": angle, "psi1_dot": rate}, []
    for i in range(1, count + 1):
        links.append({"name": f"c{i}", "parent": f"p{i - 1}", **BAR})
        links.append({"name": f"p{i}", "parent": "base", "anchor": [float(i), 0.0, 0.0], **BAR})
        start |= {f"psi{2 * i}": 0.0, f"psi{2 * i + 1}": angle}
        rows += [f"c{i}.tip.{axis} = p{i}.tip.{axis}" for axis in "xz"]
    return {"plane": True, "base": {"kind": "pivot"}, "links": links, "constraints": rows, "start": start, "run": run}


def pendulum(count: int, rate: float, angle: float, duration: float) -> Callable[[Array], Array]:
    """Angle over time, by the energy of the windows: bars turn, couplers are carried."""
    pull = G * ((count + 1) / 2 + count) / ((count + 1) / 3 + count)
    y = solve_ivp(
        lambda t, y: (y[1], -pull * np.cos(y[0])), (0.0, duration), [angle, rate], "DOP853", rtol=1e-13, atol=1e-13,
        dense_output=True,
    )  # fmt: skip
    return lambda t: y.sol(t)[0]


def off(trajectory: vlmb.Trajectory, angle: Callable[[Array], Array]) -> float:
    """Largest distance [m] of the first bar's tip from where it should be."""
    where, tip = angle(trajectory.t), trajectory.position("p0", "tip")
    return float(np.hypot(tip[:, 0] - np.cos(where), tip[:, 2] - np.sin(where)).max())


@pytest.mark.parametrize("engine", ["core", "pinocchio"] if COMPILED else ["core"])
@pytest.mark.parametrize("count", [1, 2, 3])
def test_windows_pass_every_line_up_on_their_branch(count: int, engine: str) -> None:
    trajectory = vlmb.simulate(windows(count), 10.0 if COMPILED else 1.5, rtol=1e-10, atol=1e-11, engine=engine)
    assert trajectory.status == "finished", trajectory.message
    assert off(trajectory, pendulum(count, -1.0, 0.5 * math.pi, 10.0)) < 1e-7
    assert np.abs(trajectory["balance"]).max() < 1e-6
    assert not trajectory.doubts


@pytest.mark.parametrize("engine", ["core", "pinocchio"] if COMPILED else ["core"])
@pytest.mark.parametrize(
    "twice", [["c1.tip.x + c1.tip.z = p1.tip.x + p1.tip.z"], ["c1.tip.x = p1.tip.x + 0*t", "2*c1.tip.z = 2*p1.tip.z"]]
)
def test_rows_that_repeat_others_are_watched_as_well(twice: list[str], engine: str) -> None:
    scene = windows(1)
    scene["constraints"] += twice
    trajectory = vlmb.simulate(scene, 3.0, rtol=1e-10, atol=1e-11, engine=engine)
    assert trajectory.status == "finished", trajectory.message
    assert off(trajectory, pendulum(1, -1.0, 0.5 * math.pi, 3.0)) < 1e-7
    still = windows(1, STILL, -0.5 * math.pi, engine=engine)
    still["constraints"] += twice
    stopped = vlmb.simulate(still, 2.0, rtol=1e-9, atol=1e-10)
    assert off(stopped, pendulum(1, STILL, -0.5 * math.pi, 2.0)) < 1e-6
    assert stopped.status == "finished" or "two motions meet" in stopped.message


def test_a_parallelogram_given_by_its_ends() -> None:
    links = [{"name": "a", **BAR}, {"name": "b", "parent": "a", **BAR}, {"name": "c", "parent": "b", **BAR}]
    scene = {
        "plane": True, "base": {"kind": "pivot"}, "links": links, "constraints": ["c.tip.x = 1", "c.tip.z = 0"],
        "start": {"psi1": 0.5 * math.pi, "psi2": 0.0, "psi3": -0.5 * math.pi, "psi1_dot": -1.0},
    }  # fmt: skip
    found = vlmb.simulate(scene, 3.0, rtol=1e-9, atol=1e-10, t_eval=[*FIRST_LINE_UPS, 3.0])
    assert np.sin(found["psi1"][:3]) == pytest.approx(np.zeros(3), abs=1e-4)
    truth = float(pendulum(1, -1.0, 0.5 * math.pi, 3.0)(np.array([3.0]))[0])
    assert math.remainder(float(found["psi1"][-1]) - truth, math.tau) == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize("method", ["adams", "radau", "rk4", "gauss"])
def test_every_method_passes(method: str) -> None:
    step = {"step": 1e-3} if method in ("rk4", "gauss") else {"rtol": 1e-8, "atol": 1e-9}
    trajectory = vlmb.simulate(windows(1), 1.0, method, **step)
    assert trajectory.status == "finished", trajectory.message
    assert off(trajectory, pendulum(1, -1.0, 0.5 * math.pi, 1.0)) < 1e-6


@pytest.mark.parametrize("engine", ["core", "pinocchio"] if COMPILED else ["core"])
def test_at_rest_in_the_line_up_two_motions_meet(engine: str) -> None:
    trajectory = vlmb.simulate(windows(1, STILL, -0.5 * math.pi), 2.0, rtol=1e-9, atol=1e-10, engine=engine)
    if trajectory.status != "finished":  # where rounding leaves it a way, it may go on
        assert trajectory.status == "stopped"
        assert "c1.tip.x = p1.tip.x" in trajectory.message
        assert "two motions meet" in trajectory.message
    assert off(trajectory, pendulum(1, STILL, -0.5 * math.pi, 2.0)) < 1e-7  # what was computed is right


@pytest.mark.parametrize("share", [0.9, 0.99, 0.999, 1.0 - 1e-7, 1.0 + 1e-7, 1.001, 1.01, 1.1])
@pytest.mark.parametrize("engine", ["core", "pinocchio"] if COMPILED else ["core"])
def test_near_its_rest_it_turns_back_or_passes_twice_or_says_so(share: float, engine: str) -> None:
    trajectory = vlmb.simulate(windows(1, share * STILL, -0.5 * math.pi), 2.0, rtol=1e-9, atol=1e-10, engine=engine)
    assert off(trajectory, pendulum(1, share * STILL, -0.5 * math.pi, 2.0)) < 1e-6
    assert trajectory.status == "finished" or abs(share - 1.0) < 0.002


@pytest.mark.parametrize(("engine", "method"), [("core", "dop853"), ("core", "adams"), ("core", "radau"), ("pinocchio", "adams")])
@pytest.mark.parametrize(("angle", "rate"), [(0.0, 0.01), (math.pi, 0.5), (0.0, -2.0)])
def test_a_start_in_line_leaves_on_the_branch_of_its_rates(angle: float, rate: float, engine: str, method: str) -> None:
    """The first two turn back soon after, and pass the line-up again; all do after a swing."""
    if not COMPILED and engine == "pinocchio":
        pytest.skip("too slow in plain Python")
    scene = windows(1, rate, angle, engine=engine)
    scene["start"] |= {"psi2_dot": 0.0, "psi3_dot": rate}
    trajectory = vlmb.simulate(scene, 1.5 if COMPILED else 0.1, method, rtol=1e-9, atol=1e-10)
    assert trajectory.status == "finished", trajectory.message
    assert off(trajectory, pendulum(1, rate, angle, 1.5)) < 1e-7


def test_a_limit_met_while_passing_ends_the_run_there() -> None:
    scene = windows(1)
    scene["links"].append({"name": "slide", "parent": "p0", "rod": {"length": 0.2, "mass": 1e-9},
                           "lower": {"length": 5.0}})  # fmt: skip
    free = vlmb.simulate(scene, 1.0, rtol=1e-9, atol=1e-10, t_eval=[FIRST_LINE_UPS[0] + 1e-3, 1.0])
    assert free.status == "finished", free.message
    scene["links"][-1]["lower"]["limits"] = [float(free["slide.lower"][0]), 9.0]
    met = vlmb.simulate(scene, 1.0, rtol=1e-9, atol=1e-10)
    assert met.status == "stopped"
    assert "limit" in met.message
    assert met.t[-1] == pytest.approx(FIRST_LINE_UPS[0] + 1e-3, abs=1e-8)


@pytest.mark.parametrize("lean", [-0.9, -0.87, -0.84])
@pytest.mark.parametrize("row", ["phi1 = 0.2", "phi1 = 0.2 + 0*t", "2*p.azimuth - 0.4 = 0"])
def test_an_azimuth_that_is_given_through_the_pole_is_no_loss(row: str, lean: float) -> None:
    """Its row is worth more the nearer to the pole, and no less beyond: the motion is that of the same links in a plane."""
    links = [{"name": name, "rod": {"length": 0.5, "mass": 1.0}} for name in "pq"]
    start, run = {"psi1": lean, "psi1_dot": -1.0, "psi2": 0.3}, {"rtol": 1e-11, "atol": 1e-12}
    scene = {"base": {"kind": "pivot"}, "links": links, "run": run}
    found = vlmb.simulate({**scene, "constraints": [row], "start": start | {"phi1": 0.2, "phi2": 0.2}}, 1.0)
    plane = vlmb.simulate({**scene, "plane": True, "start": start}, 1.0)
    assert found.status == "finished", found.message
    out = math.cos(0.2) * found.position("q", "tip")[:, 0] + math.sin(0.2) * found.position("q", "tip")[:, 1]
    np.testing.assert_allclose(out, plane.position("q", "tip")[:, 0], atol=1e-9)


@pytest.mark.parametrize("engine", ["core", "pinocchio"] if COMPILED else ["core"])
@pytest.mark.parametrize("before", [-2e-2, -3e-3, -1e-4, 0.0, 1e-4, 3e-3])
def test_a_break_of_a_law_within_a_passage_is_passed_or_named(before: float, engine: str) -> None:
    """A moment on the first bar sets in while it passes the line-up: it has 5/3 kg m^2, the coupler among them."""
    sets_in, moment, until = FIRST_LINE_UPS[0] + before, 2.0, 0.9
    scene = windows(1, engine=engine, rtol=1e-9, atol=1e-10)
    scene["forces"] = [{"on": "M_psi1", "law": f"where(t < {sets_in!r}, 0, {moment!r})"}]
    found = vlmb.simulate(scene, until)
    if found.status == "stopped":
        assert "two motions meet" in found.message
        assert abs(before) < 1e-3
        return
    at, pull = [0.5 * math.pi, -1.0], 2.0 * G / (5.0 / 3.0)
    for begin, end, push in ((0.0, sets_in, 0.0), (sets_in, until, moment / (5.0 / 3.0))):
        turned = solve_ivp(
            lambda t, y, push=push: (y[1], -pull * np.cos(y[0]) + push), (begin, end), at, "DOP853", rtol=1e-13, atol=1e-13
        )  # fmt: skip
        at = turned.y[:, -1]
    assert found["psi1"][-1] == pytest.approx(at[0], abs=1e-7)
