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
