"""Contacts that touch, open, slip and stick, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import vlmb

ENGINES = ["core", "pinocchio"]
TIGHT = {"rtol": 1e-11, "atol": 1e-12}
G = 9.81


def mass(contact, start, forces=(), duration=1.0, **changes):
    """Make a point mass of 1 kg in the plane with one contact."""
    return vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "free", "mass": 1.0}, "contacts": [{"point": "base", **contact}], "start": start,
        "forces": list(forces), "run": {**TIGHT, "duration": duration}, **changes,
    })


def rod(contacts, start, duration=0.1, **changes):
    """Make a uniform rod of 1 m and 1 kg in the plane, its lower end a free base without mass."""
    return vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "free"}, "links": [{"name": "rod", "rod": {"length": 1.0, "mass": 1.0}}],
        "contacts": contacts, "start": start, "run": {**TIGHT, "duration": duration}, **changes,
    })


def of_kind(run, kind, name=None):
    return [event for event in run.events if event.kind == kind and name in (None, event.name)]


def balanced(run, share=1e-8):
    energy = max(np.abs(run["kinetic"]).max(), np.abs(run["potential"] - run["potential"][0]).max())
    return np.abs(run["balance"]).max() <= share * max(energy, 1e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_ball_comes_to_rest_before_its_zeno_time(engine):
    run = vlmb.simulate(mass({"friction": 0.0, "restitution": 0.8}, {"z": 1.0}, duration=4.2), engine=engine)
    t0 = np.sqrt(2 / G)
    times, speed, t = [t0], np.sqrt(2 * G), t0
    for _ in range(4):
        speed *= 0.8
        t += 2 * speed / G
        times.append(t)
    assert [event.t for event in of_kind(run, "bounce")[:5]] == pytest.approx(times, abs=1e-11)
    zeno = t0 * 1.8 / 0.2
    assert 0.0 <= zeno - run.events[-1].t <= 2e-6 and run.events[-1].kind == "touch"
    assert run.work_by_force["impacts"][-1] == pytest.approx(-G, abs=1e-10)
    assert run["z"].min() > -1e-9 and balanced(run) and run.reactions["base"][-1] == pytest.approx([0.0, 0.0, G])
    assert run.phases[-1].closed == ("base",) and not run.phases[0].closed


@pytest.mark.parametrize("engine", ENGINES)
def test_oscillator_with_friction_rests(engine):
    scene = mass({"friction": 0.3}, {"x": 0.5, "z": 0.0}, [{"on": "F_x", "law": "-100*x"}], duration=3.0)
    run = vlmb.simulate(scene, engine=engine)
    rest = run.events[-1]
    assert rest.kind == "stick" and rest.t == pytest.approx(8 * np.pi / 10, abs=1e-9)
    assert run["x"][-1] == pytest.approx(0.02912, abs=1e-9) and balanced(run)
    assert run.phases[-1].closed == ("base",) and run.phases[-1].slipping == () and run.phases[0].slipping == ("base",)
    assert run.work_by_force["friction base"][-1] < 0.0


@pytest.mark.parametrize("engine", ENGINES)
def test_block_that_a_spring_pulls_slips_and_sticks(engine):
    scene = mass(
        {"friction": 0.2, "friction_static": 0.3}, {"z": 0.0}, [{"on": "F_x", "law": "100*(0.2*t - x)"}], duration=2.0
    )
    run = vlmb.simulate(scene, engine=engine)
    slips, sticks = of_kind(run, "slip"), of_kind(run, "stick")
    assert slips[0].t == pytest.approx(0.14715, abs=1e-9)
    assert sticks[0].t - slips[0].t == pytest.approx(0.53711477735011, abs=1e-9)
    assert slips[1].t - slips[0].t == pytest.approx(0.63521477735011, abs=1e-9)
    assert balanced(run)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(("slope", "times"), [(0.3, (0.62847975900299, 1.98495384632264)), (0.15, (0.88080972769583, None))])
def test_block_thrown_up_a_slope(engine, slope, times):
    run = vlmb.simulate(mass({"friction": 0.2}, {"z": 0.0, "x_dot": -3.0}, slope=slope, duration=2.5), engine=engine)
    assert run.events[0].t == pytest.approx(times[0], abs=1e-9)
    if times[1] is None:
        assert run.events[0].kind == "stick" and np.ptp(run["x"][run.t > times[0]]) < 1e-12
    else:
        a = G * (np.sin(slope) - 0.2 * np.cos(slope))
        back = run.t > run.events[0].t
        assert run["x_dot"][back] == pytest.approx(a * (run.t[back] - times[0]), abs=1e-9)
    assert balanced(run)


@pytest.mark.parametrize("engine", ENGINES)
def test_rod_strikes_a_floor(engine):
    start = {"psi1": 0.7, "z": 0.0, "z_dot": -2.0}
    run = vlmb.simulate(rod([{"point": "base", "friction": 0.0, "restitution": 0.5}], start), engine=engine)
    event = run.events[0]
    assert event.impulses["base"] == pytest.approx([0.0, 0.0, 1.08894870037899], rel=1e-12, abs=1e-13)
    assert event.lost == pytest.approx(0.54447435018950, rel=1e-12) and event.t == 0.0 and balanced(run)
    run = vlmb.simulate(rod([{"point": "base", "friction": 0.66}], start), engine=engine)
    assert run.events[0].impulses["base"] == pytest.approx([0.7390873, 0.0, 1.12252464], abs=1e-7)
    assert run.events[0].modes == {"base": "held"} and balanced(run)
    run = vlmb.simulate(rod([{"point": "base", "friction": 0.65}], start), engine=engine)
    x, _, z = run.events[0].impulses["base"]
    assert x / z == pytest.approx(0.65) and run.events[0].modes == {"base": "sliding"} and balanced(run)


@pytest.mark.parametrize("engine", ENGINES)
def test_ladder_leaves_the_wall_and_falls_flat(engine):
    contacts = [
        {"point": "base", "friction": 0.0}, {"name": "wall", "point": "rod.tip", "surface": "x", "friction": 0.0},
        {"name": "flat", "point": "rod.tip", "friction": 0.0},
    ]
    run = vlmb.simulate(rod(contacts, {"psi1": np.pi - 1.2, "x": np.cos(1.2), "z": 0.0}, duration=1.2), engine=engine)
    leaves, flat = of_kind(run, "open", "wall"), of_kind(run, "touch", "flat")
    assert leaves[0].t == pytest.approx(0.407707335856, abs=1e-9)
    assert np.pi - np.interp(leaves[0].t, run.t, run["psi1"]) == pytest.approx(0.67047647842666, abs=1e-6)
    assert flat[0].t - leaves[0].t == pytest.approx(0.576918677127 - 0.407707335856, abs=1e-9) or flat[0].t == pytest.approx(
        0.576918677127, abs=1e-9
    )
    assert balanced(run)


def test_run_in_phases_is_saved_and_read(tmp_path):
    run = vlmb.simulate(mass({"friction": 0.3, "restitution": 0.5}, {"x_dot": 1.0, "z": 0.2}, duration=1.5))
    again = vlmb.load_trajectory(run.save(tmp_path / "run.npz"))
    assert again.phases == run.phases and len(again.events) == len(run.events) > 3
    assert [event[:4] for event in again.events] == [event[:4] for event in run.events]
    assert again.events[0].impulses["base"] == pytest.approx(run.events[0].impulses["base"], abs=0.0)
    assert again.reactions["base"] == pytest.approx(run.reactions["base"], abs=0.0)
    assert (np.diff(run.t) == 0.0).sum() == len(run.events)
    table = run.save_csv(tmp_path / "run.csv").read_text().splitlines()
    assert "contact:base.z [N]" in table[0] and len(table) == len(run) + 1
    assert "contact          base: force" in run.summary()
