"""A ski that leaves the snow, lands, skids and holds, against closed forms and the ski that cannot."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

import vlmb
from tests.simulation.walkers import TIGHT

ENGINES = ["core", "pinocchio"]
G, MASS = 9.81, 80.0


def ski(start, duration=0.3, links=(), **changes):
    """A ski of 80 kg that may lift; `changes` of the base, then of the scene."""
    base = {key: changes.pop(key) for key in ("hold", "skid", "friction", "lift", "com_offset") if key in changes}
    return vlmb.Scene.from_dict({
        "base": {"kind": "ski", "mass": MASS, "inertia": 0.6, "lift": True, **base}, "links": list(links), "start": start,
        "run": {**TIGHT, "duration": duration, "fall": False}, **changes,
    })  # fmt: skip


LEGS = {"name": "legs", "rod": {"length": 0.5, "mass": 40.0}, "lower": {"length": 0.3, "stiffness": 9000.0, "rest": 0.35}}


def balanced(run):
    return np.abs(run["balance"]).max() < 1e-8 * max(1.0, run["kinetic"].max())


@pytest.mark.parametrize("engine", ENGINES)
def test_ski_lands_and_carves(engine):
    run = vlmb.simulate(ski({"phi0": 0.2, "x_dot": 10.0, "z_dot": -3.0}), engine=engine)
    landing, (c, s) = run.events[0], (np.cos(0.2), np.sin(0.2))
    x, y, z = landing.impulses["ski"]
    assert (landing.kind, landing.name, landing.modes) == ("touch", "ski", {"ski": "held"})
    assert run["speed"][-1] == pytest.approx(9.80066577841242, rel=1e-13)
    assert c * y - s * x == pytest.approx(158.935464636, rel=1e-11) and z == pytest.approx(240.0, rel=1e-13)
    assert c * x + s * y == pytest.approx(0.0, abs=1e-11) and landing.lost == pytest.approx(517.878011994, rel=1e-11)
    assert run.reactions["normal"][1:] == pytest.approx(MASS * G) and balanced(run) and run["z"] == pytest.approx(0.0, abs=1e-12)
    skids = vlmb.simulate(ski({"phi0": 0.2, "x_dot": 10.0, "z_dot": -3.0}, hold=0.6, skid=0.5), engine=engine)
    x, y, z = skids.events[0].impulses["ski"]
    assert c * y - s * x == pytest.approx(0.5 * z, rel=1e-12) and skids.phases[0].slipping == ("ski",) and balanced(skids)


@pytest.mark.parametrize("engine", ENGINES)
def test_skate_lets_go_and_holds_again(engine):
    run = vlmb.simulate(ski({"phi0_dot": 1.0}, 3.2, hold=0.4, slope=0.3), engine=engine)
    slip, stick = run.events[:2]
    assert (slip.kind, stick.kind) == ("slip", "stick")
    assert slip.t == pytest.approx(0.70304760494854, abs=1e-10) and stick.t == pytest.approx(2.901142665463, abs=1e-10)
    assert [phase.slipping for phase in run.phases[:3]] == [(), ("ski",), ()] and balanced(run)
    between = (run.t > slip.t) & (run.t < stick.t)
    assert run.reactions["knife_edge"][between] == pytest.approx(np.full(between.sum(), 0.4 * MASS * G * np.cos(0.3)), rel=1e-12)
    assert run.work_by_force["friction ski"][-1] < 0.0
    held = run.residuals["knife_edge"].velocity
    assert np.isnan(held[between]).all() and np.nanmax(np.abs(held)) < 1e-8
    again = vlmb.simulate(run.scene, engine=engine, until="slip ski")
    assert again.t[-1] == pytest.approx(slip.t, abs=1e-10)


@pytest.mark.parametrize("engine", ENGINES)
def test_skid_and_friction_along_the_ski_are_independent(engine):
    run = vlmb.simulate(ski({"y_dot": 2.0}, 1.0, hold=0.4), engine=engine)
    assert run.events[0].kind == "stick" and run.events[0].t == pytest.approx(0.50968399592253, abs=1e-11)
    run = vlmb.simulate(ski({"x_dot": 2.0, "y_dot": -1.5}, 1.0, hold=0.5, friction=0.4), engine=engine)
    aside, along = (speed / (ratio * G) for speed, ratio in ((1.5, 0.5), (2.0, 0.4)))
    assert [event.kind for event in run.events] == ["stick", "stick"]
    assert [event.t for event in run.events] == pytest.approx([aside, along], abs=1e-10)
    assert run["y"][-1] == pytest.approx(-0.5 * 1.5 * aside, abs=1e-10) and balanced(run)
    assert run["x"][-1] == pytest.approx(0.5 * 2.0 * along, abs=1e-10)
    assert run.reactions["friction"][5] == pytest.approx(-0.4 * MASS * G) and run.reactions["knife_edge"][5] > 0.0
    lost = -run.work_by_force["friction ski"][-1]
    assert lost == pytest.approx(0.5 * MASS * (2.0**2 + 1.5**2), rel=1e-9)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("way", ["along", "aside"])
def test_a_ski_that_stops_on_a_slope_turns_back(engine, way):
    """Beside a contact that never touches: what is looked at of each has its own numbers."""
    feather = {"name": "feather", "rod": {"length": 0.1, "mass": 1e-9}}
    contacts = [{"name": "top", "point": "feather.rod_end", "surface": "z + 9", "friction": 0.3}]
    start = {"x_dot": -2.0, "z": 0.0, "phi0": 0.0 if way == "along" else np.pi / 2, "psi1": 1.2, "phi1": 0.3}
    held = {"friction": 0.1} if way == "along" else {"hold": 0.1}
    run = vlmb.simulate(ski(start, 0.7, [feather], slope=0.3, contacts=contacts, **held), engine=engine)
    stops = 2.0 / (G * (np.sin(0.3) + 0.1 * np.cos(0.3)))
    assert [(event.kind, event.name) for event in run.events if event.name == "ski"] == [("slip", "ski")]
    assert run.events[0].t == pytest.approx(stops, abs=1e-7) and run.status == "finished"
    assert run["x_dot"][-1] == pytest.approx(G * (np.sin(0.3) - 0.1 * np.cos(0.3)) * (0.7 - stops), abs=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_momentum_is_kept_in_flight_and_handed_on_at_a_landing(engine):
    start = {"z": 0.4, "phi0": 0.3, "psi1": 1.2, "phi1": 0.5, "phi0_dot": 0.7, "phi1_dot": 0.4, "x_dot": 3.0, "y_dot": 2.0}
    run = vlmb.simulate(ski(start, 0.4, [LEGS]), engine=engine)
    landing = run.events[0]
    before, after = np.flatnonzero(run.t == landing.t)
    flight, total = slice(0, before + 1), MASS + 40.0
    for axis in "xy":
        values = run[f"com.{axis}_dot"][flight]
        assert values == pytest.approx(np.full(len(values), values[0]), rel=1e-9)
    assert run["com.z_dot"][flight] == pytest.approx(-G * run.t[flight], abs=1e-9)
    assert run["phi0_dot"][flight] == pytest.approx(0.7, rel=1e-12)  # no moment about its normal
    legs = run["legs.rod_start.x"], run["legs.rod_start.y"]
    centre = [run[f"com.{axis}"] for axis in "xyz"]
    d = np.array([run[f"legs.direction.{axis}"] for axis in "xyz"])
    u = np.array([run[f"legs.direction.{axis}_dot"] for axis in "xyz"])
    rod = np.array([0.5 * (run[f"legs.rod_start.{axis}"] + run[f"legs.rod_end.{axis}"]) for axis in "xyz"])
    rate = np.array([0.5 * (run[f"legs.rod_start.{axis}_dot"] + run[f"legs.rod_end.{axis}_dot"]) for axis in "xyz"])
    foot, speed = np.array([run[axis] for axis in "xyz"]), np.array([run[f"{axis}_dot"] for axis in "xyz"])
    spin = 40.0 * np.cross(rod - centre, rate, axis=0) + MASS * np.cross(foot - centre, speed, axis=0)
    spin += 40.0 * 0.5**2 / 12.0 * np.cross(d, u, axis=0)
    assert spin[:, flight] == pytest.approx(np.tile(spin[:, :1], before + 1), rel=1e-9) and len(legs) == 2
    change = [total * (run[f"com.{axis}_dot"][after] - run[f"com.{axis}_dot"][before]) for axis in "xyz"]
    assert landing.impulses["ski"] == pytest.approx(change, rel=1e-9, abs=1e-9) and balanced(run)
    assert run["phi0_dot"][after] == pytest.approx(run["phi0_dot"][before], rel=1e-12)  # a landing turns no ski


@pytest.mark.parametrize("engine", ENGINES)
def test_a_ski_that_stays_down_is_the_ski_that_cannot_lift(engine):
    start = {"phi0": 0.3, "psi1": 1.5, "phi1": 0.5, "phi0_dot": 0.2, "x_dot": 3.0 * np.cos(0.3), "y_dot": 3.0 * np.sin(0.3)}
    programme = {"constraints": ["psi1 = 1.4"], "controls": ["M_psi1"], "frequency": 6.0}
    scene = ski(start, 0.5, [LEGS], slope=0.2, programme={**programme, "closed": ["ski"]})
    free = scene.to_dict()
    free["base"].pop("lift")
    bound = vlmb.simulate({**free, "programme": programme}, engine="core", knife_edge="multiplier")
    run = vlmb.simulate(scene, engine=engine)
    assert not run.events and run.phases[0].closed == ("ski",) and balanced(run)
    for name in ("x", "y", "phi0", "phi1", "psi1", "xi1_1", "speed"):
        assert run[name] == pytest.approx(bound[name], abs=1e-8)
    for name in ("knife_edge", "normal", "roll_moment", "pitch_moment"):
        assert run.reactions[name] == pytest.approx(bound.reactions[name], rel=1e-6, abs=1e-4)
    assert run.controls["M_psi1"] == pytest.approx(bound.controls["M_psi1"], rel=1e-6, abs=1e-4)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_ski_jumps_by_its_legs(engine, tmp_path):
    law = "0.4 - 0.12*cos(12*t)"
    legs = {"name": "legs", "rod": {"length": 0.0, "mass": 0.0}, "tip_mass": 70.0, "lower": {"motion": "prescribed", "law": law}}
    scene = ski({"psi1": np.pi / 2, "speed": 8.0}, 0.6, [legs], constraints=["legs.direction.z = 1"])
    scene = scene.changed(base={"mass": 10.0}, constraints=["legs.direction.x = 0", "legs.direction.y = 0"])
    run = vlmb.simulate(scene, engine=engine)
    opens, lands = run.events[0], run.events[1]
    assert (opens.kind, lands.kind) == ("open", "touch")
    # m l'' = -M g where the snow stops pushing: 70 * 0.12 * 144 cos 12 t = -80 g
    t = np.arccos(-80.0 * G / (70.0 * 0.12 * 144.0)) / 12.0
    assert opens.t == pytest.approx(t, abs=1e-10) and run["z"].min() > -1e-9 and balanced(run)
    again = vlmb.load_trajectory(run.save(tmp_path / "run.npz"))
    assert again.phases == run.phases and again.reactions["normal"] == pytest.approx(run.reactions["normal"], abs=0.0)
    flying = (run.t > t + 1e-9) & (run.t < lands.t)
    assert "ski              open 0.1" in run.summary() and np.all(run.reactions["normal"][flying] == 0.0)
    assert np.all(again.reactions["roll_moment"][flying] == 0.0)


def test_what_else_sees_a_ski_that_lifts():
    run = vlmb.simulate("ski_jump", duration=1.7)
    again = pickle.loads(pickle.dumps(run))  # noqa: S301
    assert again.phases == run.phases and again.events[0].modes == run.events[0].modes
    assert again.events[2].impulses["ski"] == pytest.approx(run.events[2].impulses["ski"], abs=0.0)
    for draw in (vlmb.plots.residuals, vlmb.plots.reactions, vlmb.plots.deviations):
        assert draw(run).axes
    posture = {"x": 0.0, "y": 0.0, "z": 1.0, "phi0": 0.0, "phi1": 0.0, "psi1": 1.4}
    free = vlmb.accelerations(run.scene, posture)
    assert free["z"] < 0.0 and free["x"] == pytest.approx(G * np.sin(0.3), rel=0.2)
    with pytest.raises(vlmb.SceneError, match="contacts: ski touch here"):
        vlmb.accelerations(run.scene, {**posture, "z": 0.0})
    assert any("leaves the snow" in note for note in vlmb.check(run.scene).notes)


def test_what_a_ski_in_the_air_cannot_take_is_named():
    start = {"z": 0.1, "psi1": 1.2}
    for changes, what in (
        ({"com_offset": 0.1}, "centre of mass at A only"), ({"plane": True}, "moves in space"),
        ({"skid": 0.3}, "without hold it never does"), ({"hold": 0.3, "skid": 0.4}, "is above hold"),
        ({"lift": False, "hold": 0.3}, "need lift = true"),
        ({"links": [{**LEGS, "parent": "base", "anchor": [0.1, 0.0, 0.0]}]}, "all hinges at A only"),
        ({"links": [LEGS], "forces": [{"on": "M_psi1", "law": 1.0}]}, "closed = \\['ski'\\]"),
        ({"links": [LEGS], "forces": [{"on": "T_legs", "law": 1.0}]}, "closed = \\['ski'\\]"),
        ({"links": [LEGS], "forces": [{"between": ["base", "legs"], "stiffness": 1.0}]}, "takes no such moment"),
        ({"links": [LEGS], "programme": {"constraints": ["psi1 = 1"], "controls": ["M_psi1"], "frequency": 3.0}}, "snow only"),
    ):  # fmt: skip
        with pytest.raises(vlmb.SceneError, match=what):
            ski(start, **changes)
    with pytest.raises(vlmb.SceneError, match="lift, hold and skid belong to kind = 'ski'"):
        vlmb.Scene.from_dict({"base": {"kind": "free", "mass": 1.0, "lift": True}})
    with pytest.raises(vlmb.SceneError, match="under the surface of contact 'ski'"):
        vlmb.simulate(ski({"z": -0.1}))


def test_an_edge_lets_go_where_the_ideal_one_asks_for_more():
    scene = vlmb.load_scene(Path(__file__).resolve().parents[2] / "models" / "skier_skids.toml")
    slips = vlmb.simulate(scene, duration=8.3)
    slip, data = slips.events[0], scene.to_dict()
    for key in ("lift", "hold", "skid"):
        del data["base"][key]
    data |= {"programme": {**data["programme"], "closed": []}, "expect": {}}
    run = vlmb.simulate(data, duration=8.3, t_eval=[slip.t - 1e-3, slip.t, slip.t + 1e-3])
    before, at, after = np.abs(run.reactions["knife_edge"]) / run.reactions["normal"]
    assert slip.kind == "slip" and at == pytest.approx(0.65, abs=1e-7) and before < at < after


@pytest.mark.parametrize("start", [{"speed": 7.0}, {}, {"x_dot": 5.0, "y_dot": 4.0}])
def test_a_start_keeps_a_ski_on_the_snow_along_itself(start):
    rows = {"constraints": ["tan(phi0) = 0.4 - 0.1*y"], "controls": ["M_phi0"], "closed": ["ski"], "frequency": 5.0}
    begun = vlmb.check(ski({"phi0": 0.4, **start}, programme=rows))
    across = begun.start.rates["y_dot"] * np.cos(0.4) - begun.start.rates["x_dot"] * np.sin(0.4)
    along = begun.start.rates["x_dot"] * np.cos(0.4) + begun.start.rates["y_dot"] * np.sin(0.4)
    assert begun.start.coordinates["z"] == begun.start.rates["z_dot"] == 0.0
    if "x_dot" in start:
        assert (begun.start.rates["x_dot"], begun.start.rates["y_dot"]) == (5.0, 4.0)
    else:
        assert abs(across) < 1e-12 and along == pytest.approx(start.get("speed", 0.0), abs=1e-12)
