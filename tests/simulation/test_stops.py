"""Limits of lengths that are stops: bounces, rest, and letting go, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import vlmb
from tests.simulation.walkers import TIGHT

ENGINES = ["core", "pinocchio"]
G = 9.81


def hanging(restitution, forces=(), duration=2.0, **lower):
    """Make a mass of 2 kg on a sleeve that hangs from a pivot and slides down to its stop at 0.5 m."""
    segment = {"length": 0.2, "motion": "free", "limits": [0.1, 0.5], "at_limit": "bounce", "restitution": restitution, **lower}
    return vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "pivot"}, "forces": list(forces), "start": {"psi1": -np.pi / 2},
        "links": [{"name": "arm", "rod": {"length": 0.1, "mass": 0.0}, "tip_mass": 2.0, "lower": segment}],
        "run": {**TIGHT, "duration": duration},
    })


@pytest.mark.parametrize("engine", ENGINES)
def test_length_bounces_until_it_rests(engine):
    run = vlmb.simulate(hanging(0.6), engine=engine)
    t, speed, times = np.sqrt(0.6 / G), np.sqrt(0.6 * G), []
    for _ in range(4):
        times.append(t)
        speed *= 0.6
        t += 2.0 * speed / G
    hits = [event for event in run.events if event.kind == "bounce"]
    assert [event.t for event in hits[:4]] == pytest.approx(times, abs=1e-10) and hits[0].name == "arm.lower.max"
    assert hits[0].impulses["arm.lower.max"][0] == pytest.approx(-2.0 * 1.6 * np.sqrt(0.6 * G))
    assert run["xi1_1"][-1] == pytest.approx(0.5, abs=1e-9) and run.phases[-1].closed == ("arm.lower.max",)
    assert run.reactions["arm.lower.max"][-1] == pytest.approx(-2.0 * G) and run["xi1_1"].max() < 0.5 + 1e-9
    assert run.work_by_force["impacts"][-1] == pytest.approx(-2.0 * G * 0.3, abs=1e-9) and np.abs(run["balance"]).max() < 1e-8
    assert "stop             arm.lower.max: force" in run.summary()


@pytest.mark.parametrize("engine", ENGINES)
def test_stop_without_restitution_holds_until_the_force_pulls_back(engine):
    run = vlmb.simulate(hanging(0.0, [{"on": "F1_1", "law": "-30*t"}]), engine=engine)
    kinds = [(event.kind, event.name) for event in run.events]
    assert kinds[:2] == [("touch", "arm.lower.max"), ("open", "arm.lower.max")]
    assert run.events[1].t == pytest.approx(2.0 * G / 30.0, abs=1e-10)
    up = (run.t > run.events[1].t) & (run.t < run.events[2].t if len(run.events) > 2 else True)
    after = run.t[up] - run.events[1].t
    assert run["xi1_1"][up] == pytest.approx(0.5 - 30.0 / 2.0 * after**3 / 6.0, abs=1e-9)
    again = vlmb.simulate(hanging(0.0), engine=engine, until="touch arm.lower.max")
    assert again.status == "stopped" and again.t[-1] == pytest.approx(np.sqrt(0.6 / G), abs=1e-10)


@pytest.mark.parametrize("engine", ENGINES)
def test_stop_and_ground_share_an_impact(engine):
    """A telescope that falls with its length at its stop: foot and stop take the landing together."""
    lower = {"length": 0.3, "motion": "free", "limits": [0.3, 0.9], "at_limit": "bounce"}
    scene = vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "free", "mass": 1.0}, "contacts": [{"name": "foot", "point": "base"}],
        "links": [{"name": "leg", "rod": {"length": 0.4, "mass": 3.0}, "lower": lower}],
        "start": {"z": 0.2, "psi1": np.pi / 2}, "run": {**TIGHT, "duration": 0.4},
    })
    run = vlmb.simulate(scene, engine=engine)
    speed = np.sqrt(2.0 * G * 0.2)
    hit = next(event for event in run.events if "foot" in event.impulses)
    assert hit.impulses["foot"] == pytest.approx([0.0, 0.0, 4.0 * speed], abs=1e-9)
    assert hit.impulses["leg.lower.min"] == pytest.approx([3.0 * speed, 0.0, 0.0], abs=1e-9)
    assert run["xi1_1"].min() > 0.3 - 1e-9 and run.reactions["leg.lower.min"][-1] == pytest.approx(3.0 * G)
    assert np.abs(run["balance"]).max() < 1e-8


def test_runs_with_stops_are_saved_and_keys_are_checked(tmp_path):
    run = vlmb.simulate(hanging(0.6, duration=0.6))
    again = vlmb.load_trajectory(run.save(tmp_path / "run.npz"))
    assert again.reactions["arm.lower.max"] == pytest.approx(run.reactions["arm.lower.max"], abs=0.0)
    assert again.phases == run.phases and "arm.lower.max [N]" in run.save_csv(tmp_path / "run.csv").read_text().split("\n")[0]
    with pytest.raises(vlmb.SceneError, match="needs motion = 'free' and limits"):
        hanging(0.0, limits=None)
    with pytest.raises(vlmb.SceneError, match="belongs to at_limit"):
        hanging(0.5, at_limit="end")
    assert vlmb.simulate(hanging(0.0, at_limit="end")).message.startswith("stopped")
