"""Events of a scene by name, with contacts and without, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import vlmb
from tests.simulation.walkers import TIGHT

ENGINES = ["core", "pinocchio"]
G = 9.81


def thrown(events, **changes):
    """A point mass that is thrown up at 3 m/s from 1 m."""
    return vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "free", "mass": 1.0}, "events": events,
        "start": {"z": 1.0, "z_dot": 3.0, "x_dot": 2.0}, "run": {**TIGHT, "duration": 0.7}, **changes,
    })  # fmt: skip


@pytest.mark.parametrize("engine", ENGINES)
def test_events_happen_in_their_direction(engine, tmp_path):
    events = [
        {"name": "apex", "when": "z_dot = 0", "direction": "down"}, {"name": "level", "when": "z = 1.2"},
        {"name": "rises", "when": "z = 1.2", "direction": "up"}, {"name": "never", "when": "x_dot = 0"},
        {"name": "half", "when": "t = 0.5", "direction": "up"},
    ]
    run = vlmb.simulate(thrown(events), engine=engine)
    up, down = (3.0 - np.sqrt(9.0 - 0.4 * G)) / G, (3.0 + np.sqrt(9.0 - 0.4 * G)) / G
    assert [(event.kind, event.name) for event in run.events] == [
        ("event", "level"), ("event", "rises"), ("event", "apex"), ("event", "half"), ("event", "level"),
    ]
    assert [event.t for event in run.events] == pytest.approx([up, up, 3.0 / G, 0.5, down], abs=1e-9)
    assert run.status == "finished" and "level: 0.076147 s, 0.535474 s" in run.summary() and "never: never" in run.summary()
    assert len(run) == 201 and len(np.unique(run.t)) == len(run)
    again = vlmb.load_trajectory(run.save(tmp_path / "run.npz"))
    assert again.events == run.events and again.phases == run.phases


@pytest.mark.parametrize("engine", ENGINES)
def test_events_end_a_run(engine):
    ends = [{"name": "apex", "when": "z_dot = 0", "direction": "down", "end": True}]
    run = vlmb.simulate(thrown(ends), engine=engine)
    assert run.status == "stopped" and run.message.endswith("apex: z_dot = 0.")
    assert run.t[-1] == pytest.approx(3.0 / G, abs=1e-12) and run.events[-1].t == run.t[-1]
    events = [{"name": "over", "when": "x = z"}]
    run = vlmb.simulate(thrown(events), engine=engine, until="over")
    assert run["x"][-1] == pytest.approx(run["z"][-1], abs=1e-12) and run.status == "stopped" and len(run.events) == 1
    assert vlmb.simulate(thrown(events), engine=engine).status == "finished"


@pytest.mark.parametrize("engine", ENGINES)
def test_events_stand_among_those_of_contacts(engine, tmp_path):
    late = {"name": "late", "when": "phase_t = 0.3", "direction": "up"}
    events = [{"name": "apex", "when": "z_dot = 0", "direction": "down"}, late]
    contacts = [{"name": "floor", "point": "base", "friction": 0.0, "restitution": 0.5}]
    start = {"z": 0.5, "z_dot": 0.0}
    run = vlmb.simulate(thrown(events, contacts=contacts, start=start, run={**TIGHT, "duration": 0.75}), engine=engine)
    fall = np.sqrt(2 * 0.5 / G)
    assert [(event.kind, event.name) for event in run.events] == [
        ("event", "late"), ("bounce", "floor"), ("event", "apex"), ("event", "late"), ("bounce", "floor"), ("event", "apex"),
    ]
    assert [event.t for event in run.events][:5] == pytest.approx([0.3, fall, 1.5 * fall, fall + 0.3, 2 * fall], abs=1e-9)
    again = vlmb.load_trajectory(run.save(tmp_path / "run.npz"))
    assert [event[:4] for event in again.events] == [event[:4] for event in run.events]
    second = vlmb.simulate(run.scene, engine=engine, until="apex")
    assert second["z"][-1] == pytest.approx(0.125, abs=1e-9) and second.t[-1] == pytest.approx(1.5 * fall, abs=1e-9)


def test_a_foot_that_stands_at_the_start_has_not_touched():
    """`until` waits for the touch of a mass that jumps first, at 0.1 s and 2 m/s, or for that of one that starts by an impact."""
    jumps = vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "free", "mass": 2.0}, "contacts": [{"name": "floor", "point": "base"}],
        "forces": [{"on": "F_z", "law": "59.62*step(0.1 - t)"}], "start": {"z": 0.0}, "run": {"duration": 2.0},
    })
    run = vlmb.simulate(jumps, until="touch floor")
    flight = (2.0 + np.sqrt(4.0 + 2 * G * 0.1)) / G
    assert run.message.endswith("touch floor.") and run.t[-1] == pytest.approx(0.1 + flight, abs=1e-6)
    assert vlmb.simulate(jumps.changed(start={"z_dot": -1.0}), until="touch floor").t[-1] == 0.0


def test_a_limit_is_told_as_an_event():
    link = {"name": "leg", "rod": {"length": 0.5, "mass": 1.0}, "lower": {"length": 0.3, "limits": [0.1, 0.5]}}
    scene = vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "pivot"}, "links": [link], "start": {"psi1": -np.pi / 2},
        "run": {**TIGHT, "duration": 1.0},
    })  # fmt: skip
    run = vlmb.simulate(scene)
    assert [(event.kind, event.name) for event in run.events] == [("limit", "xi1_1")]
    assert run.events[0].t == pytest.approx(np.sqrt(2 * 0.2 / G), abs=1e-10) and run.t[-1] == run.events[0].t


def test_events_that_cannot_be_are_named():
    for event, what in (
        ({"name": "z_dot", "when": "z = 1"}, "is that of a coordinate"), ({"name": "a", "when": "z"}, "found 0 equals signs"),
        ({"name": "a", "when": "z = 1", "direction": "left"}, "direction"), ({"name": "speed", "when": "z = 1"}, "ski's speed"),
    ):  # fmt: skip
        with pytest.raises(vlmb.SceneError, match=what):
            vlmb.simulate(thrown([event]))
    with pytest.raises(vlmb.SceneError, match="unknown name 'q'"):
        vlmb.check(thrown([{"name": "a", "when": "q = 1"}]))
    with pytest.raises(vlmb.SceneError, match="has this name already"):
        thrown([{"name": "a", "when": "z = 1"}, {"name": "a", "when": "z = 2"}])
