"""Contacts where they are hard: Painleve, endless bounces, scuffing, a pencil that slips, turns and falls flat."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import vlmb
from tests.simulation.test_phases import balanced, mass, of_kind, rod
from tests.simulation.walkers import MODELS
from vlmb.simulation.phased_run import PhasedRun
from vlmb.simulation.phases_data import phases_as_data, phases_from_data
from vlmb.system.contacts import HELD, by_rows
from vlmb.system.engines import make_engine
from vlmb.system.start import consistent_start
from vlmb.system.system import make_system

ENGINES = ["core", "pinocchio"]
G = 9.81


@pytest.mark.parametrize(("mu", "angle"), [(1.4, 1.03), (1.4, 1.2), (2.0, 0.9), (2.0, 1.3)])
def test_sliding_rod_that_friction_would_press_into_the_ground_stops_with_a_sentence(mu, angle):
    """A rod slides with its body behind; no force of the ground is admissible where 1 + 3 cos a (cos a - mu sin a) < 0."""
    assert 1.0 + 3.0 * np.cos(angle) * (np.cos(angle) - mu * np.sin(angle)) < 0.0
    scene = rod([{"name": "end", "point": "base", "friction": mu}], {"psi1": angle, "z": 0.0, "x_dot": -3.0})
    run = vlmb.simulate(scene)
    assert run.status == "stopped" and len(run) == 1 and np.isfinite(run.states).all()
    assert all(text in run.message for text in ("Painleve", "contact 'end'", f"at {angle:.4g} rad", f"friction {mu:g}"))
    other = vlmb.simulate(scene.changed(start={"x_dot": 3.0}))  # the other way friction lifts it
    assert other.status == "finished" and balanced(other)


@pytest.mark.parametrize(("mu", "edges", "inside"), [
    (1.4, (0.9701554159882795, 1.220890396789439), 1.1), (2.0, (0.652358139784479, 1.3820857960113346), 1.0),
])  # fmt: skip
def test_sliding_rod_about_the_paradox(mu, edges, inside):
    """A rod that turns fast leaves the ground where none of its forces lasts; from outside friction stops one before it is in."""
    contact = [{"name": "end", "point": "base", "friction": mu}]

    def slides(angle, rate, **changes):
        run = vlmb.simulate(rod(contact, {"psi1": angle, "z": 0.0, "x_dot": -3.0, "psi1_dot": rate}, **changes))
        assert len(run) and np.isfinite(run.states).all() and min(run.lowest_gaps.values()) > -1e-9
        return run

    for rate in (-6.0, 6.0):
        flies = slides(inside, rate, duration=0.01)
        assert flies.status == "finished" and not flies.phases[0].closed and balanced(flies)
    for edge, out in zip(edges, (-1.0, 1.0), strict=True):
        run = slides(edge + 0.05 * out, -0.5 * out, duration=0.03)
        assert run.status == "finished" and run.phases[0].closed and balanced(run)
    stuck = slides(edges[0] - 1e-9, 0.1, duration=0.01)
    assert stuck.status == "failed" and f"contact 'end' at {edges[0]:.4g} rad: with friction {mu:g} its force" in stuck.message


@pytest.mark.parametrize("engine", ENGINES)
def test_sliding_rod_that_cannot_turn_knows_no_paradox(engine):
    """Alone its foot would be pressed in; with its angle held it is a block."""
    scene = rod([{"name": "end", "point": "base", "friction": 2.0}], {"psi1": 1.0, "z": 0.0, "x_dot": -3.0}, duration=0.3)
    run = vlmb.simulate(scene.changed(constraints=["psi1 = 1.0"]), engine=engine)
    assert [event.kind for event in run.events] == ["stick"] and run.events[0].t == pytest.approx(1.5 / G, abs=1e-10)
    assert run.reactions["end"][3] == pytest.approx([2.0 * G, 0.0, G], rel=1e-9) and balanced(run)


def test_endless_bounces_end_with_a_sentence():
    run = vlmb.simulate(mass({"friction": 0.0, "restitution": 1.0}, {"z": 0.0, "z_dot": 3e-4}, duration=0.5))
    assert run.status == "stopped" and "1000 events of contacts within 0.1 s (base)" in run.message
    assert np.isfinite(run.states).all() and run["z"].min() > -1e-9 and len(run.events) == 999
    falling = rod([{"name": n, "point": p, "friction": 0.5, "restitution": 0.5} for n, p in (("a", "base"), ("b", "rod.tip"))],
                  {"psi1": 0.05, "z": 0.1}, duration=1.0)  # fmt: skip
    rests = vlmb.simulate(falling)
    assert rests.status == "finished" and balanced(rests) and rests.phases[-1].closed == ("a", "b")
    assert min(rests.lowest_gaps.values()) > -1e-9 and len(rests.events) < 100


def test_foot_that_scuffs_on_rough_ground_stops_with_a_sentence():
    data = vlmb.load_scene(MODELS / "compass_gait.toml").to_dict()
    bare = [{name: value for name, value in contact.items() if name != "when"} for contact in data["contacts"]]
    run = vlmb.simulate({**data, "contacts": bare})
    assert run.status == "stopped" and all(text in run.message for text in ("contact 'r'", "scuffs", "`when`"))
    assert len(run) > 10 and np.isfinite(run.states).all() and not run.doubts and np.abs(run["balance"]).max() < 1e-6
    slides = vlmb.simulate({**data, "contacts": [{**contact, "friction": 0.8} for contact in bare]}, duration=1.0)
    assert slides.status in ("finished", "stopped") and np.isfinite(slides.states).all() and not slides.doubts


def pencil(mu, begin, end):
    """Return the times of the events of a pencil that falls from `begin` [rad] off the vertical: it slips, turns, lies flat."""

    def stands(t, y):
        return [y[1], 1.5 * G * np.sin(y[0])]

    def share(y):  # of friction and normal force, per unit of weight, of a foot that holds
        w2, a = 3.0 * G * (np.cos(begin) - np.cos(y[0])), 1.5 * G * np.sin(y[0])
        return 0.5 * (a * np.cos(y[0]) - w2 * np.sin(y[0])), G - 0.5 * (a * np.sin(y[0]) + w2 * np.cos(y[0]))

    def slides(side):
        def rates(t, y):  # angle, rate, place and velocity of the foot
            angle, rate, _, v = y
            sine, cosine = np.sin(angle), np.cos(angle)
            lever = 6.0 * (sine + mu * side * cosine)
            normal = (G - 0.5 * cosine * rate**2) / (1.0 + 0.5 * sine * lever)
            turned = lever * normal
            return [rate, turned, v, -mu * side * normal - 0.5 * (cosine * turned - sine * rate**2)]

        return rates

    def to(rates, t, y, event, direction):
        event.terminal, event.direction = True, direction
        found = solve_ivp(rates, (t, end), y, events=event, method="DOP853", rtol=1e-13, atol=1e-14)
        return found.t[-1], found.y[:, -1]

    def grips(t, y):
        friction, normal = share(y)
        return mu * normal - abs(friction)

    t, y = to(stands, 0.0, [begin, 0.0], grips, -1)
    times, side = [t], -np.sign(share(y)[0])
    t, y = to(slides(side), t, [*y, 0.0, 1e-300 * side], lambda t, y: y[3] * side, -1)
    times.append(t)
    t, y = to(slides(-side), t, [*y[:3], 0.0], lambda t, y: y[0] - np.pi / 2, 1)
    return [*times, t], y


@pytest.mark.parametrize("engine", ENGINES)
def test_pencil_slips_turns_and_falls_flat(engine):
    contacts = [{"name": "foot", "point": "base", "friction": 0.3}, {"name": "flat", "point": "rod.tip", "friction": 0.3}]
    run = vlmb.simulate(rod(contacts, {"psi1": np.pi / 2 - 0.1, "z": 0.0}, duration=1.5), engine=engine)
    times, end = pencil(0.3, 0.1, 1.5)
    assert [(event.kind, event.name) for event in run.events[:3]] == [("slip", "foot"), ("slip", "foot"), ("touch", "flat")]
    assert [event.t for event in run.events[:3]] == pytest.approx(times, abs=1e-9)
    lands = np.flatnonzero(run.t == run.events[2].t)
    assert run["x_dot"][lands[0]] == pytest.approx(end[3], abs=1e-8)
    assert run["psi1_dot"][lands[0]] == pytest.approx(-end[1], abs=1e-8)
    slid = run["x_dot"][lands[1]]  # both ends slide on together, until friction has stopped them
    assert run.events[3].kind == "stick" and run.events[3].t - times[2] == pytest.approx(slid / (0.3 * G), abs=1e-9)
    assert len(run.events) == 4 and run.phases[-1].closed == ("foot", "flat") and not run.phases[-1].slipping
    assert balanced(run) and of_kind(run, "touch", "flat")[0].lost > 0.0
    rests = run.reactions["foot"][-1] + run.reactions["flat"][-1]
    assert rests == pytest.approx([0.0, 0.0, G], abs=1e-9) and abs(run.reactions["flat"][-1][0]) < 1e-9


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("count", [1, 2, 6])
def test_foot_at_the_root_that_is_held_moves_as_on_a_pivot(engine, count):
    """And the ground pushes as rows on the free base would have it."""
    part = {"rod": {"length": 0.8, "mass": 3.0}, "lower": {"length": 0.2, "motion": "free", "stiffness": 4000.0, "damping": 3.0}}
    draw = np.random.default_rng(3)
    for _ in range(3):
        names = [f"{angle}{i}{dot}" for angle in ("phi", "psi") for i in range(1, count + 1) for dot in ("", "_dot")]
        start = dict(zip(names, draw.uniform(-1.0, 1.0, 4 * count).tolist(), strict=True))
        turning = {"on": f"M_psi{count}", "law": "7 - 2*psi1_dot"}
        flying = {
            "base": {"kind": "free", "mass": 5.0}, "contacts": [{"point": "base", "friction": 0.4}], "start": start,
            "links": count * [{**part, "tip_mass": 1.0}], "forces": [turning, {"on": "F_x", "law": "20 + z"}],
        }  # fmt: skip
        pivoted = {**flying, "base": {"kind": "pivot"}, "contacts": [], "forces": [turning]}
        found, pushes = [], []
        for data, hold in ((pivoted, None), (flying, lambda at: at), (flying, by_rows)):
            scene = vlmb.Scene.from_dict(data)
            system = make_system(vlmb.build(scene), scene.run, engine=engine)
            begin = consistent_start(system, 0.0)
            if hold is not None:
                system = system.phase([hold(system.points[0].footing_at(HELD, 0.0, np.zeros(3), plane=False))])
            made = make_engine(system, begin.branch, None, engine)
            y = made.pack(begin.state)
            found.append(made.evaluate(0.0, y)[made.velocities])
            if hold is not None:
                look = made.look_at_contacts(0.0, y)
                pushes.append(look.ground if not len(look.multipliers) else look.multipliers[[1, 2, 0]])
                falls, slips = made.indicators(0.0, y)[0][-2:]
                assert [falls, slips] == pytest.approx(
                    [pushes[-1][2], 0.4 * pushes[-1][2] - np.hypot(*pushes[-1][:2])], abs=1e-9
                )
        on_pivot, on_foot, by_row = found
        assert np.abs(on_foot[:3]).max() == 0.0
        assert on_foot[3:] == pytest.approx(on_pivot, abs=1e-14 * np.abs(on_pivot).max())
        assert by_row[3:] == pytest.approx(on_pivot, abs=1e-12 * np.abs(on_pivot).max())
        assert pushes[0] == pytest.approx(pushes[1], abs=1e-12 * np.abs(pushes[1]).max())


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("plane", [False, True])
def test_foot_at_the_root_beside_rows_pushes_as_its_own_rows_would(engine, plane):
    """Beside another foot, an ideal constraint, a programme and a length that a law drives, which takes its part, too."""
    rigid = {"rod": {"length": 0.8, "mass": 3.0}, "tip_mass": 1.0}
    driven = {**rigid, "lower": {"motion": "prescribed", "law": "0.2 + 0.05*sin(3*t + 1)"}}
    start = {"psi1": 0.9, "psi2": 0.4, "psi3": -1.1, "psi4": 0.3, "psi1_dot": 0.7, "psi2_dot": -0.4, "psi3_dot": 0.5}
    scene = vlmb.Scene.from_dict({
        "plane": plane, "base": {"kind": "free", "mass": 5.0}, "links": [driven, rigid, rigid, rigid],
        "contacts": [{"name": "root", "point": "base"}, {"name": "tip", "point": "link3.tip", "surface": "z - 0.1*x"}],
        "constraints": ["psi4 - psi1 = 0.2"], "start": start, "forces": [{"on": "F_x", "law": "12 - x_dot"}],
        "programme": {"constraints": ["psi2 = 0.4 + 0.1*sin(t)"], "controls": ["M_psi2"], "frequency": 2.0},
    })  # fmt: skip
    found = []
    for hold in (lambda at: at, by_rows):
        system = make_system(vlmb.build(scene), scene.run, engine=engine)
        begin, place = consistent_start(system, 0.0), [np.zeros(3), np.array([1.0, 0.0, 0.1])]
        feet = [hold(point.footing_at(HELD, 0.0, at, plane)) for point, at in zip(system.points, place, strict=True)]
        made = make_engine(system.phase(feet), begin.branch, None, engine)
        y = made.pack(begin.state)
        look = made.look_at_contacts(0.0, y)
        rates, at = look.rates[made.velocities.start :], 1  # accelerations, and powers of forces
        push, own = look.ground, len(system.points[0].row_texts(feet[0]))
        if own:
            push, at = np.zeros(3), at + own
            push[[2, 0] if plane else [2, 0, 1]] = look.multipliers[1 : 1 + own]
        found.append((rates, push, look.multipliers[[0, *range(at, len(look.multipliers))]]))
    for planted, by_row in zip(*found, strict=True):
        assert planted == pytest.approx(by_row, abs=1e-11 * np.abs(by_row).max())


@pytest.mark.parametrize("engine", ENGINES)
def test_run_on_a_foot_at_the_root_lies_beside_one_on_a_pivot(engine, tmp_path):
    """The foot stays where it is to the last digit; files keep how it stands, and those that say nothing of it have its rows."""
    link = {"rod": {"length": 0.8, "mass": 3.0}, "tip_mass": 1.0}
    start = {"psi1": -1.3, "phi1": 0.4, "phi1_dot": 0.3, "psi2_dot": 0.5}
    data = {"links": [link, link], "start": start, "run": {"duration": 0.5, "rtol": 1e-10, "atol": 1e-11, "engine": engine}}
    pivot = vlmb.simulate(vlmb.Scene.from_dict({**data, "base": {"kind": "pivot"}}))
    flying = {"base": {"kind": "free", "mass": 2.0}, "contacts": [{"name": "foot", "point": "base", "friction": 0.9}]}
    run = vlmb.simulate(vlmb.Scene.from_dict({**data, **flying}))
    assert run.status == "finished" and not run.events and run.stretches[0].footings[0].planted and balanced(run)
    for name in ("x", "y", "z", "x_dot", "y_dot", "z_dot"):
        assert not np.any(run[name])
    assert run.position("link2") == pytest.approx(pivot.position("link2"), abs=1e-9)
    assert run.reactions["foot"] == pytest.approx(pivot.hinge_force("link1") + np.array([0.0, 0.0, 2.0 * G]), abs=1e-6)
    again = vlmb.load_trajectory(run.save(tmp_path / "run.npz"))
    assert again.stretches == run.stretches and np.array_equal(again.reactions["foot"], run.reactions["foot"])
    kept = phases_as_data(run.stretches, run.events)
    assert kept["phases"][0][2][0].pop() is True
    older, _ = phases_from_data(kept, ["foot"], len(run.t))
    by_row = dataclasses.replace(run, stretches=older)
    assert not older[0].footings[0].planted and by_row.reactions["foot"] == pytest.approx(run.reactions["foot"], abs=1e-9)


@pytest.mark.parametrize(("what", "at_once"), [
    ({"friction": "rough"}, True), ({"friction": 0.9}, True), ({"friction": 0.2, "friction_static": 0.9}, True),
    ({"friction": 0.05}, False), ({"friction": 0.0}, False), ({"when": "z_dot <= 0"}, False),
    ({"surface": "z - 0.1*x"}, True), ({"friction": 0.9, "surface_velocity": [0.1, 0.0, 0.0]}, False), ({"z_dot": 1e-3}, False),
    ({"z": 0.01}, False), ({"gravity": 0.0}, True), ({"psi1": 1.2, "psi1_dot": 9.0}, False),
])  # fmt: skip
def test_foot_at_the_root_that_its_phase_shows_to_hold_starts_as_any_other(what, at_once, monkeypatch):
    """Where its own forces keep it, nothing else is asked; where they do not, modes are looked for, and the run is the same."""
    link, start = {"rod": {"length": 0.8, "mass": 3.0}, "tip_mass": 1.0}, {"psi1": -1.2, "phi1_dot": 0.3}
    start |= {name: what.pop(name) for name in ("z", "z_dot", "psi1", "psi1_dot") if name in what}
    data = {"gravity": what.pop("gravity", G), "base": {"kind": "free", "mass": 2.0}, "links": [link], "start": start}
    mechanism = vlmb.build(vlmb.Scene.from_dict({**data, "contacts": [{"name": "foot", "point": "base", **what}]}))
    run = vlmb.simulate(mechanism, duration=0.3)
    assert (not run.system.of_phases.probes) == at_once
    monkeypatch.setattr(PhasedRun, "_planted_at_start", lambda self: None)
    other = vlmb.simulate(mechanism, duration=0.3)
    assert run.stretches == other.stretches and run.turns == other.turns and repr(run.events) == repr(other.events)
    assert run.message == other.message and np.array_equal(run.states, other.states)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(("lift", "leaves"), [
    ("9.81 - 20*((x - 0.5)**2 - 1e-4)", 0.49), ("9.81 - 1.5*(exp(x - 0.6) + exp(0.6 - x) - 2) + 1.5e-4", 0.59),
    ("9.81 - 4*(1 - sin(2*x)) + 2e-5", 0.25 * np.pi - np.sqrt(2.5e-6)),
])  # fmt: skip
def test_point_that_would_be_pulled_for_a_moment_within_a_step_leaves_there(engine, lift, leaves):
    """No other force changes: steps are as long as they may be, and the normal force dips below 0 between their ends."""
    scene = mass({"friction": 0.0}, {"z": 0.0, "x_dot": 1.0}, [{"at": "com", "force": [0, 0, lift]}])
    run = vlmb.simulate(scene, engine=engine, duration=leaves + 0.05)
    assert run.events[0].kind == "open" and run.events[0].t == pytest.approx(leaves, abs=1e-6) and run["z"].max() > 0.0


@pytest.mark.parametrize(("engine", "method"), [("core", "dop853"), ("core", "adams"), ("pinocchio", "dop853")])
@pytest.mark.parametrize(("speed", "angle"), [(1e-4, -1.2), (3e-3, -1.5), (1e-3, 1.4)])
def test_point_that_a_force_across_turns_at_once_slides_on(engine, method, speed, angle):
    """With friction mu g = f/2 along, a force f across keeps v_x (|v| + v_y): d ln v / d theta = tan - sec/2."""
    contact, force = {"friction": 0.25}, {"at": "com", "force": [0, 0.5 * G, 0]}
    start = {"z": 0.0, "x_dot": speed * np.cos(angle), "y_dot": speed * np.sin(angle)}
    run = vlmb.simulate(mass(contact, start, [force], 0.05, plane=False), engine=engine, method=method)
    kept = run["x_dot"] * (np.hypot(run["x_dot"], run["y_dot"]) + run["y_dot"])
    assert run.status == "finished" and not run.events and run["y_dot"][-1] > 0.1
    np.testing.assert_allclose(kept, kept[0], rtol=2e-4)


def test_a_start_that_slides_on_rough_ground_is_refused():
    """Held by rows it would be stopped by no force that is accounted for."""
    scene = {
        "plane": True, "base": {"kind": "free", "mass": 1.0}, "contacts": [{"name": "foot", "point": "base"}],
        "start": {"z": 0.0, "x_dot": 0.5},
    }
    with pytest.raises(vlmb.SceneError, match=r"contact 'foot' slides at 0\.5 m/s along rough ground"):
        vlmb.simulate(vlmb.Scene.from_dict(scene), duration=0.1)
    contact = {"name": "foot", "point": "base", "friction": 0.4}
    slides = vlmb.simulate(vlmb.Scene.from_dict({**scene, "contacts": [contact]}), duration=0.2)
    assert slides.events[0].kind == "stick" and abs(slides["balance"]).max() < 1e-9
