"""What has no mass and is held by ideal rows: the motion is the one that ever smaller masses lead to."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vlmb
from vlmb.core.jit import COMPILED

Scene = dict[str, Any]

TIGHT = {"rtol": 1e-11, "atol": 1e-12}
DURATION = 0.5 if COMPILED else 0.05
SMALL = 1e-6  # [kg]
LIGHT = 3e-4  # [kg]; at a hinge between free segments less mass needs a passage of its own, which takes seconds


def bar(name: str, mass: float = 1.0, **keys: Any) -> Scene:
    return {"name": name, "rod": {"length": 0.5, "mass": mass}, **keys}


def scene(plane: bool, kind: str, links: list[Scene], rows: list[str], start: dict[str, float], **base: Any) -> Scene:
    """In space all stands in a plane that is not turned about a pole."""
    return {"plane": plane, "base": {"kind": kind, **base}, "links": links, "constraints": rows, "start": start, "run": TIGHT}


def flying(mass: float, plane: bool) -> Scene:
    """A free segment beside a first hinge that flies, led by rows."""
    leg = bar("leg", lower={"length": 0.3, "stiffness": 500.0}, tip_mass=1.0)
    rows = ["x = 0.1*sin(3*t)", "z = 0", *([] if plane else ["y = 0"])]
    turning = {} if plane else {"phi1": 0.3, "phi1_dot": 1.0}
    return scene(plane, "free", [leg], rows, {"psi1": 0.5, **turning}, **({"mass": mass} if mass else {}))


def hinged(mass: float, plane: bool) -> Scene:
    """A hinge between two free segments, led by rows; the second link falls through the line of the first."""
    links = [
        bar("a", upper={"length": 0.4, "stiffness": 300.0}, tip_mass=mass),
        bar("b", lower={"length": 0.3, "stiffness": 300.0}, tip_mass=0.5),
    ]
    rows = ["a.tip.x = 0.9 + 0.1*sin(2*t)", "a.tip.z = 0.3", *([] if plane else ["a.tip.y = 0"])]
    return scene(plane, "pivot", links, rows, {"psi1": 0.3, "psi2": 0.6})


def coupled(mass: float, plane: bool) -> Scene:
    """Two pendulums coupled by a link without mass, which closes a loop; in space one of them swings in a plane."""
    links = [bar("p"), bar("c", mass, parent="p"), bar("q", parent="base", anchor=[0.6, 0.0, 0.0])]
    links[1]["rod"]["length"] = 0.7
    rows = ["c.tip.x = q.tip.x", "c.tip.z = q.tip.z", *([] if plane else ["c.tip.y = q.tip.y", "p.direction.y = 0"])]
    start = {"psi1": -0.9, "psi1_dot": -1.0, "psi2": 0.1, "psi3": -0.9}
    return scene(plane, "pivot", links, rows, start)


def ending(mass: float, plane: bool) -> Scene:
    """A last link without mass, whose direction is given."""
    rows = ["g.elevation = 0.3 + 0.2*sin(t)", *([] if plane else ["g.azimuth = 0.2*t"])]
    return scene(plane, "pivot", [bar("p"), bar("g", mass)], rows, {"psi1": 0.2})


def sliding(mass: float, plane: bool) -> Scene:
    """A rod without mass between two free segments, whose place is given."""
    between = {"lower": {"length": 0.3, "stiffness": 200.0}, "upper": {"length": 0.3, "stiffness": 300.0}}
    return scene(plane, "pivot", [bar("g", mass, tip_mass=1.0, **between)], ["g.lower = 0.3 + 0.05*sin(4*t)"], {"psi1": 0.2})


MAKERS = {"flying": flying, "hinged": hinged, "coupled": coupled, "ending": ending, "sliding": sliding}


def tips(trajectory: vlmb.Trajectory) -> np.ndarray:
    assert trajectory.status == "finished", trajectory.message
    assert not trajectory.doubts
    return np.stack([trajectory.position(link.name, "tip") for link in trajectory.mechanism.layout.links])


@pytest.mark.parametrize("plane", [True, False], ids=["plane", "space"])
@pytest.mark.parametrize("case", MAKERS)
def test_the_motion_is_the_limit_of_small_masses(case: str, plane: bool) -> None:
    limit_of_small_masses(case, plane, LIGHT if case == "hinged" else SMALL)


def limit_of_small_masses(case: str, plane: bool, small: float) -> None:
    """What a mass m changes is of first order in m: y(0) = 2 y(m) - y(2 m)."""
    make = MAKERS[case]
    found = vlmb.simulate(make(0.0, plane), DURATION)
    run = {"engine": "pinocchio"}  # the second link passes the line, where the core has no inertia left to divide by
    one, two = (tips(vlmb.simulate(make(mass, plane), DURATION, **run)) for mass in (small, 2.0 * small))
    np.testing.assert_allclose(tips(found), 2.0 * one - two, rtol=0.0, atol=5e-9)
    assert np.abs(found["balance"]).max() < 1e-9


@pytest.mark.parametrize("plane", [True, False], ids=["plane", "space"])
def test_a_massless_bar_pulls_along_itself(plane: bool) -> None:
    """The reactions at its end have its direction."""
    found = vlmb.simulate(coupled(0.0, plane), DURATION)
    force = np.stack([found.reactions[f"c.tip.{axis} = q.tip.{axis}"] for axis in ("x", "z")])
    along = (found.position("c", "tip") - found.position("c", "hinge"))[:, [0, 2]].T
    sideways = (force[0] * along[1] - force[1] * along[0]) / 0.7
    assert np.abs(sideways).max() < 1e-7 * np.abs(force).max()


@pytest.mark.parametrize(
    ("rows", "moves"),
    [(["p.elevation = 0.2"], "hinge of g"), (["g.tip.z - g.hinge.z = 0.1"], "hinge of g"), (["g.azimuth = 0"], "hinge of g")],
)
def test_what_rows_do_not_hold_is_refused_by_name(rows: list[str], moves: str) -> None:
    made = ending(0.0, plane=False) | {"constraints": rows}
    for ask in (vlmb.check, vlmb.simulate):
        with pytest.raises(vlmb.SceneError, match=f"have no mass.*the ideal rows do not hold it: .*{moves}"):
            ask(made)


def test_the_start_says_who_computes_it_and_what_cannot() -> None:
    notes = "\n".join(vlmb.check(coupled(0.0, plane=True)).notes)
    assert "ideal rows hold it, and Pinocchio's engine computes the motion" in notes
    with pytest.raises(vlmb.SceneError, match=r'let ideal rows hold it with run.engine = "pinocchio"'):
        vlmb.simulate(coupled(0.0, plane=True), 0.1, engine="core")
    made = coupled(0.0, plane=False) | {"base": {"kind": "ski", "mass": 5.0, "inertia": 1.0}}
    with pytest.raises(vlmb.SceneError, match=r'let ideal rows hold it with run.knife_edge = "multiplier"'):
        vlmb.simulate(made, 0.1, knife_edge="projection")


def test_rows_that_let_go_of_what_has_no_mass_for_an_instant() -> None:
    """psi (xi - 0.2 + 0.1 psi) = 0 holds a rod along its link but for psi = 0: it goes through, or says so, on its branch."""
    strut = bar("s", 0.0, lower={"length": 0.171}, upper={"length": 0.2, "stiffness": 300.0}, tip_mass=1.0)
    row = "psi1*(xi1_1 - 0.2 + 0.1*psi1) = 0"
    found = vlmb.simulate(scene(True, "pivot", [strut], [row], {"psi1": 0.29, "psi1_dot": -1.0}), 0.5)
    np.testing.assert_allclose(found["xi1_1"], 0.2 - 0.1 * found["psi1"], atol=1e-7)
    assert found.status == "finished" or repr(row) in found.message
    assert found["psi1"].min() < 0.01
