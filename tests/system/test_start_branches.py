"""Starts in postures in which ideal rows lose their independence: the branch that the given rates tell, else by name none."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.simulation.test_passage import off, pendulum, windows
from vlmb.core.jit import COMPILED

Scene = dict[str, Any]

DURATION = 1.0 if COMPILED else 0.05
TIGHT = {"rtol": 1e-9, "atol": 1e-10}


def flat(**rates: float) -> Scene:
    """A parallelogram that starts in line."""
    scene = windows(1, 0.0, 0.0, **TIGHT)
    del scene["start"]["psi1_dot"]
    scene["start"] |= rates
    return scene


def four_bar(crank: float, coupler: float, rocker: float, ground: float, **rates: float) -> Scene:
    """A crank on the left, a rocker on the right, both level, and a coupler between them: all in line."""
    far = crank + coupler + rocker
    assert far == pytest.approx(ground)
    links = [
        {"name": "a", "rod": {"length": crank, "mass": 1.0}},
        {"name": "c", "parent": "a", "rod": {"length": coupler, "mass": 1.0}},
        {"name": "b", "parent": "base", "anchor": [ground, 0.0, 0.0], "rod": {"length": rocker, "mass": 1.0}},
    ]
    rows, start = ["c.tip.x = b.tip.x", "c.tip.z = b.tip.z"], {"psi1": 0.0, "psi2": 0.0, "psi3": math.pi} | rates
    return {"plane": True, "base": {"kind": "pivot"}, "links": links, "constraints": rows, "start": start, "run": TIGHT}


@pytest.mark.parametrize("engine", ["core", "pinocchio"] if COMPILED else ["core"])
@pytest.mark.parametrize("rate", [-1.0, 2.0, 3.0])
def test_rates_that_are_on_a_branch_go_on_there(rate: float, engine: str) -> None:
    found = vlmb.simulate(flat(psi1_dot=rate, psi2_dot=0.0, psi3_dot=rate), DURATION, engine=engine)
    assert found.status == "finished", found.message
    assert off(found, pendulum(1, rate, 0.0, DURATION)) < 1e-7


@pytest.mark.parametrize("given", [{"psi1_dot": -1.0, "psi3_dot": -1.0}, {"psi1_dot": -1.0, "psi2_dot": 0.0}, {"psi1_dot": -1.0}])
def test_given_rates_that_one_branch_alone_has_tell_the_others(given: dict[str, float]) -> None:
    found = vlmb.simulate(flat(**given), DURATION)
    assert off(found, pendulum(1, -1.0, 0.0, DURATION)) < 1e-7


def test_the_other_branch_is_taken_where_its_rates_are_given() -> None:
    """All bars are of one length: the coupler and the second one turn together, about where the first one ends, which rests."""
    found = vlmb.simulate(flat(psi1_dot=0.0, psi3_dot=-1.0), 0.5 if COMPILED else 0.02)
    assert found.status == "finished", found.message
    np.testing.assert_allclose(found["psi1"], 0.0, atol=1e-8)
    np.testing.assert_allclose(found["psi2"], found["psi3"], atol=1e-8)
    pull = 9.81 / (2.0 / 3.0)  # two rods about one point: 2 m g l/2 over 2 m l^2/3
    assert found["psi3"][1] - found["psi3"][0] < 0.0
    rate, fall = found["psi3_dot"], np.sin(found["psi3"])
    np.testing.assert_allclose(0.5 * rate**2 + pull * fall, 0.5, atol=1e-5)
    assert np.abs(found["balance"]).max() < 1e-6


@pytest.mark.parametrize("given", [{}, {"psi3_dot": 0.3}, {"psi1_dot": 0.0}])
def test_where_rates_tell_no_branch_both_are_named(given: dict[str, float]) -> None:
    for ask in (vlmb.check, vlmb.simulate):
        with pytest.raises(vlmb.SceneError) as caught:
            ask(flat(**given))
        said = str(caught.value)
        assert "'c1.tip.z = p1.tip.z'" in said or "'c1.tip.x = p1.tip.x'" in said
        assert "(psi1_dot = 1, psi3_dot = 1) or (psi2_dot = 1, psi3_dot = 1)" in said


def test_rates_between_the_branches_are_refused() -> None:
    """They meet the rows to first order, and no motion has them."""
    with pytest.raises(vlmb.SceneError, match="the rates do not tell which"):
        vlmb.simulate(flat(psi1_dot=-1.0, psi2_dot=0.5, psi3_dot=-0.5))


def test_a_chain_that_is_stretched_out_leaves_by_no_motion() -> None:
    """A crank, a coupler and a rocker in line between their hinges: only tension, and no second posture near it."""
    with pytest.raises(vlmb.SceneError, match="no motion leaves it"):
        vlmb.simulate(four_bar(0.5, 0.7, 0.6, 1.8))


def test_rows_that_repeat_each_other_everywhere_lose_nothing() -> None:
    scene = windows(1)
    scene["constraints"].append("c1.tip.x + c1.tip.z = p1.tip.x + p1.tip.z")
    assert vlmb.check(scene).degrees_of_freedom == 1
    lone = {"base": {"kind": "pivot"}, "links": [{"name": "a", "rod": {"length": 1.0, "mass": 1.0}}], "start": {"psi1": 0.3}}
    assert vlmb.check({**lone, "constraints": ["psi1 = 0.3", "2*psi1 = 0.6"]}).degrees_of_freedom == 1
