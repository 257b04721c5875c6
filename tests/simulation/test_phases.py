"""Contacts that touch, open, slip and stick, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import vlmb
from tests.metamorphic import Words
from tests.metamorphic_kinds import contacts
from tests.simulation.walkers import TIGHT, compass, simplest, wheel

ENGINES = ["core", "pinocchio"]
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
        assert run.events[0].kind == "stick" and np.ptp(run["x"][run.t > times[0]]) < 1e-11
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


@pytest.mark.parametrize("engine", ENGINES)
def test_compass_gait_keeps_its_steps(engine):
    run = vlmb.simulate(compass(), engine=engine)
    touches = of_kind(run, "touch")
    assert np.diff([0.0, *(event.t for event in touches)]) == pytest.approx(np.full(9, 0.734346391159), abs=1e-10)
    assert [event.lost for event in touches] == pytest.approx(np.full(9, 5.498121984723), abs=1e-9)
    assert [event.name for event in touches[:2]] == ["r", "l"] and touches[0].contacts == ("r", "l")
    assert run.phases[0].closed == ("l",) and run.phases[1].closed == ("r",) and balanced(run) and not run.doubts
    run = vlmb.simulate(compass(rtol=1e-8, atol=1e-10), engine=engine)
    assert np.diff([event.t for event in run.events]) == pytest.approx(np.full(8, 0.734346391159), abs=1e-6)


def test_rimless_wheel_follows_its_map():
    run = vlmb.simulate(wheel(duration=4.0))
    alpha, mass_, inertia, speed = np.pi / 8, 1.08, 8 * 0.01 / 3, 1.2
    share = (inertia + mass_ * np.cos(2 * alpha)) / (inertia + mass_)
    assert len(run.events) == 4 and balanced(run)
    for event in run.events:
        after = np.flatnonzero(run.t == event.t)[-1]
        speed = share * np.sqrt(speed**2 + 4 * mass_ * G * np.sin(alpha) * np.sin(0.08) / (inertia + mass_))
        assert -run["psi1_dot"][after] == pytest.approx(speed, abs=1e-10)


def test_simplest_walker_is_the_limit_of_light_feet():
    times = [vlmb.simulate(simplest(beta)).events[0].t for beta in (1e-3, 1e-4, 1e-5)]
    assert times == pytest.approx([3.90032, 3.88424, 3.88264], abs=5e-6)
    errors = np.array(times) - 3.88246375285
    assert errors[0] / errors[1] == pytest.approx(10.0, rel=0.01) and errors[1] / errors[2] == pytest.approx(10.0, rel=0.01)
    assert (10.0 * times[2] - times[1]) / 9.0 == pytest.approx(3.88246375285, abs=1e-5)


@pytest.mark.parametrize("engine", ENGINES)
def test_block_slides_in_space(engine):
    slope, mu, start = 0.3, 0.2, {"x": 0.0, "y": 0.0, "z": 0.0, "x_dot": -1.0, "y_dot": 2.0}
    run = vlmb.simulate(mass({"friction": mu}, start, duration=1.5, plane=False, slope=slope), engine=engine)
    normal, along = G * np.cos(slope), G * np.sin(slope)

    def rates(t, s):
        speed = np.hypot(s[2], s[3])
        return [s[2], s[3], along - mu * normal * s[2] / speed, -mu * normal * s[3] / speed]

    exact = solve_ivp(rates, (0.0, 1.5), [0.0, 0.0, -1.0, 2.0], method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    assert [run[name][-1] for name in ("x", "y", "x_dot", "y_dot")] == pytest.approx(exact, abs=1e-9)
    assert balanced(run) and run["z"] == pytest.approx(0.0, abs=1e-12)
    flat = vlmb.simulate(mass({"friction": mu}, start, duration=1.5, plane=False), engine=engine)
    assert flat.events[-1].kind == "stick" and flat.events[-1].t == pytest.approx(np.sqrt(5.0) / (mu * G), abs=1e-9)


@pytest.mark.parametrize("engine", ENGINES)
def test_belt_takes_a_block_along(engine):
    run = vlmb.simulate(mass({"friction": 0.3, "surface_velocity": [1.5, 0.0, 0.0]}, {"z": 0.0}, duration=1.0), engine=engine)
    assert run.events[-1].kind == "stick" and run.events[-1].t == pytest.approx(1.5 / (0.3 * G), abs=1e-9)
    assert run["x_dot"][-1] == pytest.approx(1.5, abs=1e-12) and balanced(run)
    heat = -run.work_by_force["friction base"][-1]
    assert heat == pytest.approx(0.5 * 1.5**2, rel=1e-9) and run.work_by_force["surface base"][-1] == pytest.approx(2 * heat)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("friction", [0.3, "rough"])
def test_account_closes_with_a_driven_length(engine, friction):
    scene = rod(
        [{"point": "rod.tip", "friction": friction, "restitution": 0.3}], {"psi1": -1.2, "z": 1.4, "x_dot": 1.0}, duration=0.8
    )
    lower = {"motion": "prescribed", "law": "0.2 + 0.05*sin(9*t)"}
    links = [{"name": "rod", "lower": lower, "rod": {"length": 1.0, "mass": 1.0}}]
    run = vlmb.simulate(scene.changed(links=links, base={"kind": "free", "mass": 2.0}), engine=engine)
    assert len(run.events) >= 2 and run["rod.tip.z"].min() > -1e-9
    assert np.abs(run["balance"]).max() < 1e-8 and abs(run.work_by_force["F1_1"][-1]) > 0.01


@pytest.mark.parametrize("restitution", [0.0, 0.3])
def test_two_feet_dropped_at_once_stay_alike(restitution):
    leg = {"parent": "base", "rod": {"length": 1.0, "mass": 1.0}}
    scene = vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "free", "mass": 5.0}, "links": [{"name": "a", **leg}, {"name": "b", **leg}],
        "contacts": [{"point": f"{name}.tip", "friction": 0.5, "restitution": restitution} for name in "ab"],
        "forces": [{"between": ["a", "b"], "stiffness": 300.0, "damping": 3.0, "rest": 0.8}],
        "start": {"z": 1.0, "psi1": -np.pi / 2 + 0.4, "psi2": -np.pi / 2 - 0.4}, "run": {**TIGHT, "duration": 0.8},
    })
    run = vlmb.simulate(scene)
    assert set(run.events[0].contacts) == {"a.tip", "b.tip"}
    assert run["psi1"] + np.pi / 2 == pytest.approx(-(run["psi2"] + np.pi / 2), abs=1e-9)
    assert run["x"] == pytest.approx(0.0, abs=1e-9) and balanced(run) and run["a.tip.z"].min() > -1e-9


def test_starts_and_scenes_that_cannot_be_are_named():
    with pytest.raises(vlmb.SceneError, match="under the surface of contact 'base'"):
        vlmb.simulate(mass({}, {"z": -0.1}))
    with pytest.raises(vlmb.SceneError, match="unknown point"):
        vlmb.simulate(mass({"point": "leg.tip"}, {"z": 1.0}))
    with pytest.raises(vlmb.SceneError, match="one comparison"):
        mass({"when": "x"}, {"z": 1.0})
    with pytest.raises(vlmb.SceneError, match="names none of x, y, z"):
        mass({"surface": "t"}, {"z": 1.0})
    with pytest.raises(vlmb.SceneError, match="friction_static"):
        mass({"friction": 0.3, "friction_static": 0.2}, {"z": 1.0})


def test_curved_surface_carries_a_mass_that_slides_over_it():
    """A mass slides without friction from near the top of a cylinder and leaves it at cos = 2/3."""
    surface = "sqrt(x**2 + z**2) - 1"
    start = {"x": np.sin(0.1), "z": np.cos(0.1)}
    run = vlmb.simulate(mass({"friction": 0.0, "surface": surface}, start, duration=1.2))
    leaves = of_kind(run, "open")[0]
    at = np.flatnonzero(run.t == leaves.t)[0]
    assert run["z"][at] == pytest.approx(2.0 / 3.0 * np.cos(0.1), abs=1e-9) and balanced(run)


@pytest.mark.parametrize("engine", ENGINES)
def test_until_ends_a_run(engine):
    ball = mass({"friction": 0.3, "restitution": 0.5}, {"z": 1.0, "x_dot": 0.5}, duration=9.0)
    run = vlmb.simulate(ball, engine=engine, until="touch base")
    assert run.status == "stopped" and run.message.endswith("touch base.")
    assert run.t[-2:] == pytest.approx([np.sqrt(2 / G)] * 2, abs=1e-11)
    assert run["z_dot"][-1] == pytest.approx(0.5 * np.sqrt(2 * G))
    apex = vlmb.simulate(ball, engine=engine, start=run.end, t0=run.end.time, until="z_dot")
    assert apex["z"][-1] == pytest.approx(0.25, abs=1e-10) and apex["z_dot"][-1] == pytest.approx(0.0, abs=1e-10)
    rest = vlmb.simulate(ball, engine=engine, until="stick base")
    assert rest["x_dot"][-1] == pytest.approx(0.0, abs=1e-9) and rest.events[-1].kind in ("stick", "touch")
    with pytest.raises(vlmb.SceneError, match="no contact or leg 'foot'"):
        vlmb.simulate(ball, until="touch foot")
    with pytest.raises(vlmb.SceneError, match="no such event"):
        vlmb.simulate(ball, until="tuch base")


@pytest.mark.parametrize("engine", ENGINES)
def test_a_run_goes_on_where_a_foot_is_held(engine):
    """The foot that the first run leaves moves by rounding, in any direction: no impact."""
    scene = contacts(25, Words())
    first = vlmb.simulate(scene, 0.3, engine=engine)
    assert first.phases[-1].closed == ("foot_a",)
    second = vlmb.simulate(scene, 0.1, start=first.end, t0=0.3, engine=engine)
    assert second.status == "finished" and not second.events and second.phases[0].closed == ("foot_a",)
    whole = vlmb.simulate(scene, 0.4, engine=engine)
    assert second.position("a", "tip")[-1] == pytest.approx(whole.position("a", "tip")[-1], abs=1e-9)


def test_figures_and_tables_show_forces_of_contacts():
    run = vlmb.simulate(mass({"friction": 0.3, "restitution": 0.5}, {"x_dot": 1.0, "z": 0.2}, duration=0.5))
    figure = vlmb.plots.reactions(run)
    assert "contact force [N]" in [ax.get_ylabel() for ax in figure.axes]
    assert list(run.controls) == [] and set(run.work_by_force) == {"friction base", "impacts"}
