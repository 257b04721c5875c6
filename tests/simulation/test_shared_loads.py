"""Feet that share a load: none pulls, and none opens while others can take what it carried."""

from __future__ import annotations

import numpy as np
import pytest

import vlmb
from tests.simulation.walkers import TIGHT
from vlmb.system.least_reactions import face_of

G = 9.81


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
@pytest.mark.parametrize("friction", [0.0, "rough"])
def test_a_rod_on_three_feet_is_loaded_at_one_end(engine, friction):
    """Feet at 0, 1 and 1.5 m, a load that grows at the last: least forces would soon pull at the first foot."""
    rod = {"name": "rod", "rod": {"length": 1.0, "mass": 1.0}, "upper": {"length": 0.5, "motion": "fixed"}, "tip_mass": 0.5}
    scene = vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "free"}, "links": [rod],
        "contacts": [{"name": name, "point": point, "friction": friction} for name, point in (
            ("left", "base"), ("middle", "rod.rod_end"), ("right", "rod.tip"),
        )],
        "forces": [{"at": "rod.tip", "force": [0.0, 0.0, "-60*t"]}],
        "start": {"z": 0.0, "psi1": 0.0}, "run": {**TIGHT, "duration": 1.0},
    })  # fmt: skip
    run = vlmb.simulate(scene, engine=engine)
    assert not run.events and run.phases[0].closed == ("left", "middle", "right") and len(run.phases) == 1
    x, load = np.array([0.0, 1.0, 1.5]), 1.5 * G + 60.0 * run.t
    moment = 0.5 * G + 1.5 * (0.5 * G + 60.0 * run.t)
    least = np.array([[len(x), x.sum()], [x.sum(), (x * x).sum()]])
    a, b = np.linalg.solve(least, np.array([load, moment]))
    forces = a + b * x[:, None]
    pulls = forces[0] < 0.0
    forces[:, pulls] = np.array([0.0 * load, 2.0 * (1.5 * load - moment), 2.0 * (moment - load)])[:, pulls]
    assert pulls.any() and not pulls.all()
    found = np.array([run.reactions[name][:, 2] for name in ("left", "middle", "right")])
    assert found == pytest.approx(forces, abs=1e-7) and np.abs(run["psi1"]).max() < 1e-9
    assert np.abs(run["balance"]).max() < 1e-9


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
def test_a_rod_on_three_feet_tips_where_none_can_take_more(engine):
    """The load moves beyond the last foot: there both others open at once."""
    rod = {"name": "rod", "rod": {"length": 2.0, "mass": 1.0}}
    places = (("left", "base"), ("middle", "post.rod_end"), ("right", "post.tip"))
    post = {
        "name": "post", "parent": "base", "rod": {"length": 0.5, "mass": 0.0}, "upper": {"length": 0.5, "motion": "fixed"},
        "tip_mass": 1e-3,
    }
    scene = vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "free"}, "links": [rod, post], "constraints": ["psi2 = psi1"],
        "contacts": [{"name": name, "point": point, "friction": "rough"} for name, point in places],
        "forces": [{"at": "rod.tip", "force": [0.0, 0.0, "2 - 20*t"]}],
        "start": {"z": 0.0, "psi1": 0.0}, "run": {**TIGHT, "duration": 0.2, "fall": False},
    })  # fmt: skip
    run = vlmb.simulate(scene, engine=engine)
    opens = [event for event in run.events if event.kind == "open"]
    assert set(opens[0].contacts) == {"left", "middle"} and opens[0].modes["right"] == "held"
    # about the right foot, 1 m from the base: the rod's weight acts at it, the force 1 m beyond, the post's ball at it
    assert opens[0].t == pytest.approx(0.1, abs=1e-9) and len(opens) == 1


def bar(base, feet, more=(), **changes):
    """A bar on a base, with feet at 1 and 1.5 m, and a load that grows at the last."""
    rod = {"name": "rod", "rod": {"length": 1.0, "mass": 1.0}, "upper": {"length": 0.5, "motion": "fixed"}, "tip_mass": 0.5}
    named = (("middle", "rod.rod_end"), ("right", "rod.tip"))
    return vlmb.Scene.from_dict({
        "base": {"mass": 2.0, **base}, "links": [rod], "start": {"z": 0.0, "psi1": 0.0},
        "contacts": [*more, *({"name": name, "point": point, **feet} for name, point in named)],
        "forces": [{"at": "rod.tip", "force": [0.0, 0.0, "-60*t"]}], "run": {**TIGHT, "duration": 1.5, "fall": False}, **changes,
    })  # fmt: skip


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
@pytest.mark.parametrize("friction", [0.0, "rough"])
def test_a_ski_carries_what_a_foot_in_its_place_would(engine, friction):
    """The least loads of three supports are linear in their places; none of them opens, slips or is let go."""
    ski = {"kind": "ski", "inertia": 0.5, "lift": True, **({"friction": 0.2, "hold": 0.5} if friction else {})}
    run = vlmb.simulate(bar(ski, {"friction": friction}), engine=engine)
    names, x = ("ski", "middle", "right"), np.array([0.0, 1.0, 1.5])
    load, moment = 3.5 * G + 60.0 * run.t, 0.5 * G + 1.5 * (0.5 * G + 60.0 * run.t)
    a, b = np.linalg.solve(np.array([[3.0, x.sum()], [x.sum(), (x * x).sum()]]), np.array([load, moment]))
    found = np.array([run.reactions[name] for name in names])
    assert not run.events and run.phases[0].closed == ("middle", "right", "ski") and len(run.phases) == 1
    assert found[:, :, 2] == pytest.approx(a + b * x[:, None], abs=1e-7) and np.abs(found[:, :, :2]).max() < 1e-7
    assert run.reactions["normal"] == pytest.approx(found[0, :, 2]) and np.abs(run["balance"]).max() < 1e-9
    assert "share a load" in run.summary() and {at.state for entry in run.stretches for at in entry.footings} > {"resting"}
    if engine == "core" and not friction:
        foot = {"name": "instead", "point": "base", "friction": 0.0}
        stands = vlmb.simulate(bar({"kind": "free"}, {"friction": 0.0}, [foot], constraints=["y = 0"]))
        assert not stands.events and stands.reactions["instead"][:, 2] == pytest.approx(found[0, :, 2], abs=1e-7)


def test_the_nearest_point_of_a_pyramid():
    """What is left out pushes on no edge of it, and stands at a right angle on what is kept."""
    draw, each = np.random.default_rng(5), (0.5, 1.3)
    edges = np.array([[1.0, side * each[0], other * each[1]] for side in (-1.0, 1.0) for other in (-1.0, 1.0)])
    for z in draw.normal(size=(200, 3)):
        y = face_of(z, each) @ z
        assert y[0] >= 0.0 and (np.abs(y[1:]) <= np.array(each) * y[0] + 1e-12).all()
        assert (edges @ (z - y)).max() < 1e-12 and abs(y @ (z - y)) < 1e-12


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
def test_a_fallen_one_lies_on_two_points_that_hold_while_a_third_slides(engine):
    """Two held points of one rod have a row across too many. The other rod turns about the hip until friction has stopped it."""
    scene = vlmb.Scene.from_dict({
        "base": {"kind": "free", "mass": 5.0},
        "links": [
            {"name": "body", "rod": {"length": 0.8, "mass": 20.0}, "tip_mass": 3.0},
            {"name": "leg", "parent": "base", "rod": {"length": 0.5, "mass": 10.0}, "tip_mass": 2.0},
        ],
        "contacts": [{"name": name, "point": point, "friction": mu} for name, point, mu in (
            ("hip", "base", 0.6), ("hand", "body.tip", 0.6), ("foot", "leg.tip", 0.3),
        )],
        "start": {"z": 0.0, "psi1": 0.0, "psi2": 0.0, "phi1": 0.4, "phi2": 1.9, "phi2_dot": 3.0},
        "run": {**TIGHT, "duration": 0.5},
    })  # fmt: skip
    run = vlmb.simulate(scene, engine=engine)
    carried, inertia = (5.0 + 2.0) * G, (10.0 / 3.0 + 2.0) * 0.5**2
    slows = 0.3 * carried * 0.5 / inertia
    assert run.status == "finished" and [(event.kind, event.name) for event in run.events] == [("stick", "foot")]
    assert run.events[0].t == pytest.approx(3.0 / slows, abs=1e-9)
    assert run["phi2"][-1] == pytest.approx(1.9 + 4.5 / slows, abs=1e-9)
    pull = np.sum([run.reactions[name][0] for name in ("hip", "hand", "foot")], axis=0)  # of the least, whose sum is determined
    mass_moment, along = 10.0 * 0.25 + 2.0 * 0.5, np.array([np.cos(1.9), np.sin(1.9), 0.0])
    across = np.array([-along[1], along[0], 0.0])
    assert pull == pytest.approx(-mass_moment * (9.0 * along + slows * across) + [0.0, 0.0, 40.0 * G], abs=1e-7)
    assert max(abs(run.reactions[name]).max() for name in ("hip", "hand")) < 23.0 * G and np.abs(run["balance"]).max() < 1e-9
