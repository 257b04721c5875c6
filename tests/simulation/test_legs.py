"""Massless legs against closed forms and independent programs: running, walking, jumping, landing."""

from __future__ import annotations

import numpy as np
import pytest

import vlmb
from tests.simulation.walkers import TIGHT, model

ENGINES = ["core", "pinocchio"]
G, MASS = 9.81, 80.0
APEX = 0.940267144380  # [m] of the run's fixed point


def runner(apex=APEX, duration=1.0, **changes):
    """Make the SLIP runner at an apex."""
    return model("slip_runner", duration, {"parameters.apex": apex}).changed(**changes)


def hopper(law="0.9 - 0.12*cos(12*t)", z=0.78, leg=None, **changes):
    """Make a mass over a massless leg whose length a law gives."""
    return vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "free", "mass": 70.0}, "start": {"z": z},
        "legs": [{"name": "leg", "from": "base", "law": law, "foot": [0.0, 0.0], **(leg or {})}],
        "run": {**TIGHT, "duration": 0.4}, **changes,
    })


def balanced(run, share=1e-8):
    return np.abs(run["balance"]).max() <= share * max(np.abs(run["kinetic"]).max(), 1e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_runner_keeps_its_steps(engine):
    run = vlmb.simulate(runner(), engine=engine)
    assert [event.kind for event in run.events[:4]] == ["touch", "open", "touch", "open"]
    steps = np.diff([event.t for event in run.events])
    assert steps == pytest.approx(np.resize([0.149240070570, 0.103292543248], len(steps)), abs=1e-9)
    assert balanced(run) and not run.doubts and run.phases[1].closed == ("leg",)
    stands = run["leg.force"] > 1e-6
    assert run.reactions["leg"][stands, 2].min() > 0.0 and np.abs(run.reactions["leg"][~stands]).max() < 1e-6
    length = np.hypot(run["x"] - run["leg.foot.x"], run["z"])
    assert run["leg.length"][stands] == pytest.approx(length[stands], abs=1e-12) and run["leg.length"].max() <= 1.0 + 1e-9


def test_runner_over_a_hundred_strides():
    run = vlmb.simulate(runner(duration=25.3))
    assert sum(event.kind == "touch" for event in run.events) >= 100
    assert np.ptp(run["energy"]) <= 1e-8 * run["energy"][0] and balanced(run)
    apexes = []
    for side in (1e-5, -1e-5):
        scene = runner(APEX + side)
        lands = vlmb.simulate(scene, until="open leg")
        apexes.append(vlmb.simulate(scene, start=lands.end, t0=lands.end.time, until="z_dot")["z"][-1])
    assert (apexes[0] - apexes[1]) / 2e-5 == pytest.approx(-0.161308, abs=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_walker_keeps_its_steps(engine):
    run = vlmb.simulate(model("slip_walker", 2.0), engine=engine)
    single, double = 0.138984856485, 0.166562990043
    times = [event.t for event in run.events]
    assert times[0] == pytest.approx(single, abs=1e-9)
    assert np.diff(times) == pytest.approx(np.resize([double, 2.0 * single], len(times) - 1), abs=1e-9)
    assert [(event.kind, event.name) for event in run.events[:3]] == [("touch", "right"), ("open", "left"), ("touch", "left")]
    both = np.flatnonzero(run.t == times[0])[-1]
    assert run["right.foot.x"][both] - run["left.foot.x"][both] == pytest.approx(0.514236114439, abs=1e-9) and balanced(run)
    assert run.phases[0].closed == ("left",) and run.phases[1].closed == ("left", "right")


@pytest.mark.parametrize("engine", ENGINES)
def test_jump_from_a_leg_with_a_law(engine):
    run = vlmb.simulate(hopper(), engine=engine)
    (leaves,) = run.events
    assert (leaves.kind, leaves.name) == ("open", "leg") and leaves.t == pytest.approx(0.18120964585726, abs=1e-10)
    flight = run.t > leaves.t
    z, v, t = 0.9 - 0.12 * np.cos(12 * leaves.t), 1.18545086359579, run.t[flight] - leaves.t
    assert run["z"][flight] == pytest.approx(z + v * t - 0.5 * G * t**2, abs=1e-10)
    assert run["z_dot"][run.t == leaves.t] == pytest.approx(v, abs=1e-10) and balanced(run)
    stands = run.t < leaves.t
    push = 70.0 * (0.12 * 144.0 * np.cos(12 * run.t[stands]) + G)
    assert run["leg.force"][stands] == pytest.approx(push, rel=1e-9)
    assert run.work_by_force["leg leg"][-1] == pytest.approx(run["energy"][-1] - run["energy"][0], rel=1e-9)


@pytest.mark.parametrize("engine", ENGINES)
def test_leg_by_the_time_since_it_came_down_hops(engine):
    """Each stance begins at 0.78 m, after an impact that takes all, and is the first one again."""
    scene = hopper("0.9 - 0.12*cos(12*phase_t)", leg={"attack": "pi/2 + 0*phase_t"}, run={**TIGHT, "duration": 1.6})
    pushed = scene.changed(forces=[{"on": "F_x", "law": "7.0", "closed": ["leg"]}])
    run = vlmb.simulate(scene, engine=engine)
    stance, speed, rises = 0.18120964585726, 1.18545086359579, 0.9 - 0.12 * np.cos(12 * 0.18120964585726) - 0.78
    flight = (speed + np.sqrt(speed**2 + 2.0 * G * rises)) / G
    ends = np.cumsum(np.resize([stance, flight], len(run.events)))
    assert [event.t for event in run.events] == pytest.approx(ends, abs=1e-10) and len(ends) > 4 and balanced(run)
    assert run.events[1].impulses["leg"][2] == pytest.approx(70.0 * (G * flight - speed), rel=1e-9)
    run = vlmb.simulate(pushed, engine=engine, duration=0.3)
    off = run.events[0].t
    assert (run.controls["F_x"][run.t < off] == 7.0).all() and (run.controls["F_x"][run.t > off] == 0.0).all()


@pytest.mark.parametrize("engine", ENGINES)
def test_mass_lands_on_a_leg_with_a_law(engine):
    """A stiff leg at an angle takes the velocity along it; what is left swings over it as an inverted pendulum."""
    leg = {"law": 1.0, "attack": 1.2, "foot": None}
    scene = hopper(1.0, leg=leg, start={"z": 1.2, "x_dot": 2.0}, run={**TIGHT, "duration": 0.6})
    run = vlmb.simulate(scene, engine=engine)
    lands = run.events[0]
    fall = np.sqrt(2.0 * G * (1.2 - np.sin(1.2)))
    along = np.array([-np.cos(1.2), 0.0, np.sin(1.2)])
    speed = float(along @ [2.0, 0.0, -fall])
    assert lands.kind == "touch" and lands.t == pytest.approx(fall / G, abs=1e-10)
    assert lands.impulses["leg"] == pytest.approx(-70.0 * speed * along, rel=1e-9)
    assert lands.lost == pytest.approx(0.5 * 70.0 * speed**2, rel=1e-9) and balanced(run)
    stands = (run.t > lands.t) & (run["leg.force"] > 0.0)
    assert stands.any() and np.hypot(run["x"] - run["leg.foot.x"], run["z"])[stands] == pytest.approx(1.0, abs=1e-10)


@pytest.mark.parametrize("engine", ENGINES)
def test_damped_leg_lets_go_before_its_rest_length(engine):
    leg = {"name": "leg", "from": "base", "length": 1.0, "stiffness": 20e3, "damping": 300.0, "attack": "pi/2"}
    scene = runner(legs=[leg], start={"z": 1.3, "x_dot": 0.0}, run={**TIGHT, "duration": 1.2})
    run = vlmb.simulate(scene, engine=engine)
    leaves = next(event for event in run.events if event.kind == "open")
    before = np.flatnonzero(run.t == leaves.t)[0]
    short = 1.0 - run["z"][before]
    assert short > 1e-3 and short == pytest.approx(300.0 * run["z_dot"][before] / 20e3, rel=1e-8)
    assert leaves.lost == pytest.approx(0.5 * 20e3 * short**2, rel=1e-8) and balanced(run)
    omega, decay = 20e3 / MASS, 300.0 / (2.0 * MASS)
    wd, fall = np.sqrt(omega - decay**2), np.sqrt(2.0 * G * 0.3)
    t = run.t[(run.t >= run.events[0].t) & (run.t < leaves.t)] - run.events[0].t
    sag = G / omega
    swing = np.exp(-decay * t) * (sag * np.cos(wd * t) + (decay * sag - fall) / wd * np.sin(wd * t))
    assert run["z"][(run.t >= run.events[0].t) & (run.t < leaves.t)] == pytest.approx(1.0 - sag + swing, abs=1e-9)


@pytest.mark.parametrize("engine", ENGINES)
def test_runs_go_on_from_a_leg_that_stands(engine):
    whole = vlmb.simulate(runner(duration=0.6), engine=engine)
    first = vlmb.simulate(runner(duration=0.1), engine=engine)
    assert [name for name, _, _ in first.end.feet] == ["leg"]
    rest = vlmb.simulate(runner(duration=0.5), engine=engine, start=first.end, t0=first.end.time)
    assert rest["x"][-1] == pytest.approx(whole["x"][-1], abs=1e-9) and rest.phases[0].closed == ("leg",)
    assert [event.t for event in rest.events] == pytest.approx([event.t for event in whole.events[1:]], abs=1e-10)
    jump = vlmb.simulate(hopper(), engine=engine, until="open leg")
    flies = vlmb.simulate(hopper(), duration=0.1, engine=engine, start=jump.end, t0=jump.end.time)
    assert not jump.end.feet and not flies.events and flies["z_dot"][-1] == pytest.approx(1.18545086359579 - 0.1 * G, abs=1e-9)


def test_leg_lets_go_outside_its_cone_and_says_so():
    leg = {"name": "leg", "from": "base", "length": 1.0, "stiffness": 20e3, "attack": "68*pi/180", "friction": 0.35}
    run = vlmb.simulate(runner(legs=[leg]))
    assert [event.kind for event in run.events] == ["slip"] and run.events[0].modes["leg"] == "open"  # cot(68 deg) is more
    assert run.events[0].t == pytest.approx(0.0516462716246, abs=1e-9) and (run["leg.force"] == 0.0).all()
    leg["friction"] = 0.41
    run = vlmb.simulate(runner(legs=[leg], duration=0.3))
    assert [event.kind for event in run.events[:2]] == ["touch", "open"]
    leg |= {"friction": 0.3, "attack": "75*pi/180"}
    run = vlmb.simulate(runner(legs=[leg], start={"z": 1.0, "x_dot": 5.0}))
    slip = run.events[1]
    at = np.flatnonzero(run.t == slip.t)[0]
    assert slip.kind == "slip" and slip.lost > 0.0 and balanced(run)
    assert abs(run["x"][at] - run["leg.foot.x"][at]) == pytest.approx(0.3 * run["z"][at], abs=1e-9)
    assert "left its cone" in run.summary()


def test_leg_in_space_carries_a_link_and_is_read_by_laws():
    links = [{"name": "trunk", "rod": {"length": 0.6, "mass": 40.0}}]
    legs = [{"name": "leg", "from": "trunk.hinge", "length": 0.9, "stiffness": 9e3, "attack": 1.2, "heading": 0.4}]
    scene = vlmb.Scene.from_dict({
        "base": {"kind": "free", "mass": 30.0}, "links": links, "legs": legs,
        "forces": [{"on": "F_x", "law": "0.01*leg.force*(1 - leg.length)"}],
        "start": {"z": 1.0, "x_dot": 1.0, "y_dot": 0.5, "psi1": 1.5}, "run": {**TIGHT, "duration": 0.4},
    })
    runs = [vlmb.simulate(scene, engine=engine) for engine in ENGINES]
    for run in runs:
        stands = run["leg.force"] > 0.0
        law = 0.01 * run["leg.force"] * (1.0 - run["leg.length"])
        assert run.controls["F_x"] == pytest.approx(law, abs=1e-9) and stands.any() and balanced(run)
        foot = np.array([run[f"leg.foot.{axis}"][-1] for axis in "xyz"])
        lands = np.flatnonzero(run.t == run.events[0].t)[0]
        away = 0.9 * np.array([np.cos(1.2) * np.cos(0.4), np.cos(1.2) * np.sin(0.4), -np.sin(1.2)])
        assert foot == pytest.approx(run.position("trunk", "hinge")[lands] + away, abs=1e-9)
    assert runs[0]["x"][-1] == pytest.approx(runs[1]["x"][-1], abs=1e-9)
    assert runs[0].events[-1].t == pytest.approx(runs[1].events[-1].t, abs=1e-9)


def test_leg_and_contact_share_a_load():
    """A block on the ground under a leg that pushes it down: the contact carries both, and opens when the leg pulls it up."""
    links = [{"name": "rod", "rod": {"length": 1.0, "mass": 6.0}}]
    scene = vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "free", "mass": 1.0}, "links": links,
        "contacts": [{"name": "heel", "point": "base"}],
        "legs": [{"name": "leg", "from": "rod.tip", "length": 0.5, "stiffness": 400.0, "damping": 20.0, "attack": "pi/2"}],
        "start": {"psi1": 0.7, "z": 0.0}, "run": {**TIGHT, "duration": 1.2},
    })
    for engine in ENGINES:
        run = vlmb.simulate(scene, engine=engine)
        assert run.events[0].kind == "touch" and run.events[0].name == "leg"
        assert run.phases[1].closed == ("heel", "leg") and balanced(run) and run["z"].min() > -1e-9
        both = (run.t > run.events[0].t) & (run.t < run.phases[1].end)
        pushed = run.reactions["heel"][both, 2] + run.reactions["leg"][both, 2] - 7.0 * G
        momentum = 7.0 * np.ptp(run["com.z_dot"][both][[0, -1]])
        assert abs(np.trapezoid(pushed, run.t[both])) == pytest.approx(momentum, rel=1e-3)


def test_runs_with_legs_are_saved_and_read(tmp_path):
    run = vlmb.simulate(runner(duration=0.3))
    again = vlmb.load_trajectory(run.save(tmp_path / "run.npz"))
    assert again.phases == run.phases and [event[:4] for event in again.events] == [event[:4] for event in run.events]
    for name in ("leg.length", "leg.force", "leg.foot.x", "spring", "balance"):
        assert again[name] == pytest.approx(run[name], abs=0.0)
    assert again.reactions["leg"] == pytest.approx(run.reactions["leg"], abs=0.0)
    assert vlmb.load_trajectory(tmp_path / "run.npz").scene == run.scene
    assert "leg:leg.z [N]" in run.save_csv(tmp_path / "run.csv").read_text().splitlines()[0]
    assert "leg              leg: force" in run.summary()
    made = vlmb.Leg(from_="base", length=1.0, stiffness=1.0, attack=1.0)
    assert vlmb.Scene(base=vlmb.Base(kind="free", mass=1.0), legs=[made]).legs[0].name == "leg1"


def test_legs_that_cannot_be_are_named():
    for leg, why in (
        ({"attack": 1.0}, "needs length"),
        ({"law": "1.0", "length": 1.0, "attack": 1.0}, "has no length"),
        ({"law": "x", "attack": 1.0}, "unknown name 'x'"), ({"law": 1.0, "attack": 1.0, "heading": 0.3}, "against it"),
        ({"law": 1.0, "attack": 1.0, "friction": 0.0}, "friction"),
        ({"law": 1.0, "attack": 1.0, "name": "com"}, "choose another"),
    ):
        with pytest.raises(vlmb.SceneError, match=why):
            runner(legs=[{"from": "base", **leg}])
    with pytest.raises(vlmb.SceneError, match="longer than its law has it"):
        vlmb.simulate(hopper(z=0.8))
    leg = {"name": "leg", "from": "base", "length": 1.0, "stiffness": 2e4, "foot": [0.0, 0.0]}
    with pytest.raises(vlmb.SceneError, match="would pull"):
        vlmb.simulate(runner(legs=[leg], start={"z": 1.1, "x_dot": 0.0}))
    with pytest.raises(vlmb.SceneError, match="which is a result"):
        vlmb.simulate(hopper(forces=[{"on": "F_x", "law": "leg.force"}]))
    run = vlmb.simulate(hopper("0.78 - 2*t", leg={"attack": 1.0}))
    assert run.status == "stopped"
    crushed = vlmb.simulate(runner(legs=[leg | {"stiffness": 300.0}], start={"z": 0.9, "x_dot": 0.0}))
    assert crushed.status == "stopped" and "came down to its foot" in crushed.message
