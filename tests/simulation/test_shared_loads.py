"""Feet that share a load: none pulls, and none opens while others can take what it carried."""

from __future__ import annotations

import numpy as np
import pytest

import vlmb
from tests.simulation.walkers import TIGHT

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
