"""Programmes, forces and laws that go by phases, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import vlmb
from tests.simulation.walkers import TIGHT

ENGINES = ["core", "pinocchio"]
G = 9.81


def hopper(**changes):
    """A mass of 2 kg on a leg without mass, which a programme drives: another length in the air than on the ground."""
    return vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "free", "mass": 1.0},
        "links": [{
            "name": "leg", "rod": {"length": 0.5, "mass": 1.0}, "lower": {"motion": "free", "length": 0.5},
        }],
        "constraints": ["psi1 = 1.5707963267948966"],
        "contacts": [{"name": "foot", "point": "base", "friction": "rough"}],
        "start": {"z": 0.3, "psi1": np.pi / 2, "xi1_1": 0.5},
        "run": {**TIGHT, "duration": 1.0}, **changes,
    })


STANDS = {"constraints": ["xi1_1 = 0.4"], "controls": ["F1_1"], "frequency": 20.0, "closed": ["foot"]}
FLIES = {"constraints": ["xi1_1 = 0.6"], "controls": ["F1_1"], "frequency": 15.0, "open": ["foot"]}


def of_error(t, z0, rate0, w):
    """Critically damped error: (5.5) with H = -w^2, K = -2 w."""
    return (z0 + (rate0 + w * z0) * t) * np.exp(-w * t)


@pytest.mark.parametrize("engine", ENGINES)
def test_programmes_switch_with_the_phase(engine):
    run = vlmb.simulate(hopper(programmes=[STANDS, FLIES]), engine=engine)
    touch = run.events[0]
    assert touch.kind == "touch" and run.phases[1].closed == ("foot",)
    after = np.flatnonzero(run.t == touch.t)[1]
    t = run.t[after:] - touch.t
    own = slice(after, after + int((t < run.phases[1].end - touch.t).sum()))
    error = of_error(run.t[own] - touch.t, run["xi1_1"][after] - 0.4, run["xi1_1_dot"][after], 20.0)
    assert run["xi1_1"][own] - 0.4 == pytest.approx(error, abs=1e-8)
    flying = slice(0, after)
    start = run["xi1_1"][0] - 0.6
    assert run["xi1_1"][flying] - 0.6 == pytest.approx(of_error(run.t[flying], start, 0.0, 15.0), abs=1e-8)
    assert np.isnan(run.residuals["xi1_1 = 0.4"].position[flying]).all() and np.isfinite(run.controls["F1_1"]).all()
    assert np.abs(run["balance"]).max() < 1e-8 and run.status == "finished" and "F1_1" in run.summary()


@pytest.mark.parametrize("engine", ENGINES)
def test_a_programme_of_one_phase_leaves_its_controls_at_nothing_in_others(engine):
    scene = hopper(programme=STANDS, start={"z": 0.3, "xi1_1": 0.5, "psi1": np.pi / 2, "xi1_1_dot": 0.2})
    run = vlmb.simulate(scene, engine=engine, until="touch foot")
    assert np.all(run.controls["F1_1"][:-1] == 0.0) and abs(run.controls["F1_1"][-1]) > 1.0
    assert run["xi1_1"][-1] == pytest.approx(0.5 + 0.2 * run.t[-1], abs=1e-9)


@pytest.mark.parametrize("engine", ENGINES)
def test_forces_act_in_their_phase_and_by_its_time(engine):
    scene = vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "free", "mass": 2.0}, "contacts": [{"name": "floor", "point": "base", "friction": 0.0}],
        "forces": [
            {"on": "F_x", "law": "6*phase_t", "closed": ["floor"]}, {"on": "F_z", "law": "30*step(t - 0.5)"},
        ],
        "start": {"z": 0.5}, "run": {**TIGHT, "duration": 0.8},
    })
    run = vlmb.simulate(scene, engine=engine)
    fall = np.sqrt(2 * 0.5 / G)
    assert [event.kind for event in run.events[:2]] == ["touch", "open"]
    assert run.events[0].t == pytest.approx(fall, abs=1e-11) and run.events[1].t == pytest.approx(0.5, abs=1e-9)
    at, last = np.flatnonzero(run.t == run.events[1].t)[-1], 0.5 - fall
    assert run["x_dot"][at] == pytest.approx(1.5 * last**2, abs=1e-9) and run["x"][at] == pytest.approx(0.5 * last**3, abs=1e-9)
    assert np.abs(run["balance"]).max() < 1e-8 and np.all(run.controls["F_x"][at:] == 0.0)
    assert run["z_dot"][-1] == pytest.approx((15.0 - G) * 0.3, abs=1e-9)


def test_a_given_length_by_the_time_of_a_phase(tmp_path):
    """A leg that is pulled in while it flies goes on where it stands; one that would jump is named."""
    law = "0.5 + 0.1*(1 - cos(6*phase_t))*(1 - cos(6*phase_t))"
    links = [{"name": "leg", "rod": {"length": 0.5, "mass": 1.0}, "lower": {"motion": "prescribed", "law": law}}]
    start = {"z": 0.02, "psi1": np.pi / 2}
    run = vlmb.simulate(hopper(links=links, start=start, run={**TIGHT, "duration": 0.3}), t0=2.0)
    assert run["leg.lower"][0] == pytest.approx(0.5) and run.status == "failed"
    assert "its length jumps" in run.message and len(run) > 1
    again = vlmb.load_trajectory(run.save(tmp_path / "run.npz"))
    assert again.controls["F1_1"] == pytest.approx(run.controls["F1_1"], abs=0.0, nan_ok=True)


def test_programmes_that_do_not_go_together_are_named():
    with pytest.raises(vlmb.SceneError, match="no contact 'feet'; did you mean 'foot'"):
        hopper(programme={**STANDS, "closed": ["feet"]})
    with pytest.raises(vlmb.SceneError, match=r"programmes\[1\].*the control 'F1_1' both"):
        hopper(programmes=[STANDS, {**FLIES, "open": []}])
    with pytest.raises(vlmb.SceneError, match="two ways to write the same"):
        hopper(programme=STANDS, programmes=[FLIES])
    with pytest.raises(vlmb.SceneError, match="stores energy and acts always"):
        hopper(forces=[{"between": ["leg", "base"], "stiffness": 1.0, "closed": ["foot"]}])
    with pytest.raises(vlmb.SceneError, match="this scene has no contacts"):
        hopper(programme=STANDS, contacts=None or [])
    with pytest.raises(vlmb.SceneError, match="phase_t is the time since a phase began"):
        vlmb.simulate(hopper(contacts=[], forces=[{"on": "F_x", "law": "phase_t"}]))
    with pytest.raises(vlmb.SceneError, match="unknown force 'F9_1'"):
        vlmb.simulate(hopper(programmes=[{**STANDS, "controls": ["F9_1"]}, FLIES]))


@pytest.mark.parametrize("engine", ENGINES)
def test_two_programmes_that_act_at_once_are_united(engine):
    """While the foot stands one holds the leg's length by its force, another the lean by a torque at the base."""
    lean = {"constraints": ["lean: psi1 = 1.4"], "controls": ["M_psi1"], "frequency": 10.0}
    stands, start = {**STANDS, "frequency": 6.0}, {"z": 0.05, "psi1": 1.5, "xi1_1": 0.5}
    scene = hopper(constraints=[], programmes=[stands, lean, FLIES], start=start)
    run = vlmb.simulate(scene, engine=engine, duration=0.3)
    at, lean_, rate = np.flatnonzero(run.t == run.events[0].t)[1], run.residuals["lean"].position, run["psi1_dot"]
    assert lean_[at:] == pytest.approx(of_error(run.t[at:] - run.t[at], lean_[at], rate[at], 10.0), abs=1e-7)
    assert lean_[:at] == pytest.approx(of_error(run.t[:at], lean_[0], 0.0, 10.0), abs=1e-7)
    assert run.events[0].kind == "touch" and abs(rate[at] - rate[at - 1]) > 0.01 and np.abs(run["balance"]).max() < 1e-8
    against = scene.changed(programmes=[STANDS, lean, FLIES])  # it pulls the foot up as soon as it stands
    run = vlmb.simulate(against, engine=engine, duration=0.3)
    assert run.status == "stopped" and "contradict what they do at the contacts foot" in run.message
    feet = [{"name": "foot", "point": "base"}, {"name": "heel", "point": "base"}]
    twice = hopper(contacts=feet, programmes=[STANDS, {**STANDS, "closed": ["heel"]}])
    run = vlmb.simulate(twice, engine=engine, duration=0.4)
    assert run.status == "failed" and "'F1_1' both, and act at once with foot, heel closed" in run.message and len(run) > 1
