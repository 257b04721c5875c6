"""The consistent start: what moves so that rows hold, and what is said of it. Postures are worked out by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.small_scenes import PIVOT, SKI
from vlmb.errors import SceneError
from vlmb.system.constraints import RowValues
from vlmb.system.row_sets import RowSet
from vlmb.system.start import Start, consistent_start
from vlmb.system.start_rows import row_sets
from vlmb.system.start_search import Search
from vlmb.system.system import make_system

Table = dict[str, Any]

ROD = {"name": "leg", "rod": {"length": 1.0, "mass": 1.0}}
FORE = "leg.direction.x*cos(phi0) + leg.direction.y*sin(phi0) = 0"
SIDE = "leg.direction.y*cos(phi0) - leg.direction.x*sin(phi0) = 0.5"


def begun(base: Table, rows: list[str], links: list[Table] | None = None, plane: bool = False, **start: float) -> Start:
    """The start of a scene, one rod of 1 m unless links are given."""
    table = {"base": base, "links": links or [ROD], "constraints": rows, "start": start, "plane": plane}
    return consistent_start(make_system(vlmb.build(vlmb.Scene.from_dict(table))))


def legs(*lengths: float) -> list[Table]:
    """Spring legs with a point mass at each end."""
    point = {"rod": {"length": 0.0, "mass": 0.0}, "tip_mass": 1.0}
    return [{"name": "abc"[at], "lower": {"length": length, "stiffness": 100.0}, **point} for at, length in enumerate(lengths)]


def holds(start: Start, **expected: float) -> None:
    for name, value in expected.items():
        assert start.coordinates[name] == pytest.approx(value, abs=1e-9), start


# ---- singular rows


CLOSED = ["b.tip.x = 0", "b.tip.z = 0"]


def tips(start: Start, count: int) -> tuple[float, float]:
    at = start.coordinates
    turns = [(at[f"xi{i}_1"], at[f"psi{i}"]) for i in range(1, count + 1)]
    return sum(xi * math.cos(psi) for xi, psi in turns), sum(xi * math.sin(psi) for xi, psi in turns)


@pytest.mark.parametrize("psi2", [-1.6416, -1.5])
def test_equal_legs_turn_and_keep_their_lengths(psi2: float) -> None:
    """|d1 + d2| = 0: the second leg points against the first, whatever their length."""
    start = begun(PIVOT, CLOSED, legs(0.2, 0.2), plane=True, psi1=1.5, psi2=psi2)
    holds(start, xi1_1=0.2, xi2_1=0.2)
    assert math.remainder(start.coordinates["psi2"] - start.coordinates["psi1"], math.tau) == pytest.approx(-math.pi, abs=1e-9)
    assert abs(start.coordinates["psi1"] - 1.5) < 0.1
    assert not any("MOVED FAR" in text for text in start.adjustments)


def test_three_legs_in_a_line_turn_and_keep_their_lengths() -> None:
    start = begun(PIVOT, ["c.tip.x = 0", "c.tip.z = 0"], legs(0.2, 0.2, 0.4), plane=True, psi1=1.0, psi2=1.01, psi3=1.0 - math.pi)
    holds(start, xi1_1=0.2, xi2_1=0.2, xi3_1=0.4)
    assert np.abs(tips(start, 3)).max() < 1e-9


def test_unequal_legs_meet_halfway_rather_than_vanish_and_it_is_loud() -> None:
    """No turning closes legs of 0.2 and 0.3 m; 0 m for both would."""
    start = begun(PIVOT, CLOSED, legs(0.2, 0.3), plane=True, psi1=1.5, psi2=-1.6)
    first, second = start.coordinates["xi1_1"], start.coordinates["xi2_1"]
    assert 0.2 < first < 0.3 and first == pytest.approx(second, abs=1e-9)
    assert start.adjustments[0].startswith("start: xi2_1") and "MOVED FAR, far from 0.3" in start.adjustments[0]


def test_a_length_at_its_limit_is_loud() -> None:
    leg = {"name": "leg", "lower": {"length": 0.2, "stiffness": 100.0, "limits": [0.1, 1.3]}, "rod": {"length": 1.0, "mass": 1.0}}
    start = begun(PIVOT, ["xi1_1 = 0.1"], [leg])
    holds(start, xi1_1=0.1)
    assert start.adjustments == ("start: xi1_1 = 0.1 so that the equations hold: MOVED FAR, at its limit, from 0.2",)


# ---- a lean from the vertical


@pytest.mark.parametrize("side", [0.5, -0.5, 1e-3])
def test_a_pivoted_link_leans_to_the_side_that_is_asked_for(side: float) -> None:
    start = begun(PIVOT, [f"leg.direction.y = {side}"])
    holds(start, phi1=math.copysign(math.pi / 2, side), psi1=math.acos(abs(side)))


def test_two_components_from_the_vertical() -> None:
    start = begun(PIVOT, ["leg.direction.y = 0.5", "leg.direction.x = -0.3"])
    holds(start, phi1=math.atan2(0.5, -0.3), psi1=math.acos(math.hypot(0.5, 0.3)))


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.5])
def test_a_rider_leans_to_the_side_of_the_ski(heading: float) -> None:
    start = begun(SKI, [FORE, SIDE], phi0=heading)
    holds(start, phi0=heading, psi1=math.pi / 3)
    assert math.remainder(start.coordinates["phi1"] - heading, math.tau) == pytest.approx(math.pi / 2, abs=1e-9)


@pytest.mark.parametrize("rows", [[FORE, SIDE], ["leg.direction.y = 0.5"], ["leg.tip.y = 0.5"]], ids=["named", "absolute", "tip"])
def test_a_heading_is_not_turned_to_lean_the_rider(rows: list[str]) -> None:
    start = begun(SKI, rows)
    holds(start, phi0=0.0, x=0.0, y=0.0, phi1=math.pi / 2, psi1=math.pi / 3)


def test_a_heading_that_a_row_equates_is_turned() -> None:
    start = begun(SKI, ["leg.direction.y = 0.5", "phi1 = phi0"])
    at = start.coordinates
    assert at["phi0"] == pytest.approx(at["phi1"], abs=1e-9)
    assert math.sin(at["phi1"]) * math.cos(at["psi1"]) == pytest.approx(0.5, abs=1e-9)


@pytest.mark.parametrize("azimuth", [None, 1.0, -2.0])
def test_the_azimuth_chooses_the_side_where_nothing_else_does(azimuth: float | None) -> None:
    start = begun(PIVOT, ["leg.direction.z = 0.5"], **({} if azimuth is None else {"phi1": azimuth}))
    holds(start, phi1=azimuth or 0.0, psi1=math.pi / 6)
    assert start.adjustments[-1] == (
        "start: at the vertical the equations choose no side for psi1: the link leans towards its azimuth, "
        f"phi1 = {azimuth or 0.0:g}"
    )


def test_the_side_of_a_hanging_link_and_of_one_in_a_plane() -> None:
    start = begun(PIVOT, ["leg.direction.z = -0.5"], psi1=-math.pi / 2, phi1=2.0)
    holds(start, phi1=2.0, psi1=-math.pi / 6)
    assert any("MOVED FAR, far from -1.5708" in text for text in start.adjustments)
    start = begun(PIVOT, ["leg.direction.z = 0.5"], plane=True)
    holds(start, psi1=math.pi / 6)
    assert start.adjustments[-1].endswith("for psi1: the link leans towards x")


def test_a_link_that_leans_back_keeps_its_azimuth() -> None:
    holds(begun(PIVOT, ["leg.direction.x = -0.5"]), phi1=0.0, psi1=2.0 * math.pi / 3)


def test_what_no_posture_meets_is_refused_by_what_was_given() -> None:
    with pytest.raises(SceneError, match=r"'leg.direction.y = 1.5' \(off by 1.5\)"):
        begun(PIVOT, ["leg.direction.y = 1.5"])


# ---- the Jacobian of the search, and what it costs


@pytest.mark.parametrize("base", [PIVOT, SKI, {"kind": "free", "mass": 1.0}], ids=["pivot", "ski", "free"])
def test_derivatives_by_coordinates_are_differences(base: Table) -> None:
    links = [ROD | {"name": "leg"}, ROD | {"name": "arm", "lower": {"length": 0.3, "stiffness": 10.0}}]
    table = {"base": base, "links": links, "constraints": ["arm.tip.y = 0.1", "leg.direction.z*psi2 = 0.3*phi2"]}
    mechanism = vlmb.build(vlmb.Scene.from_dict(table))
    random = np.random.default_rng(3)
    posture = {name: float(random.uniform(0.2, 0.9)) for name in mechanism.coordinate_names}
    sets = row_sets(make_system(mechanism))
    search = Search(mechanism, posture)
    _, matrix = search._linear(sets, posture)
    for at, name in enumerate(posture):
        ahead, back = (search.residual(sets, posture | {name: posture[name] + h}) for h in (1e-5, -1e-5))
        np.testing.assert_allclose(matrix[:, at], (ahead - back) / 2e-5, atol=1e-9)


def test_a_start_takes_few_evaluations(monkeypatch: pytest.MonkeyPatch) -> None:
    calls, evaluate = [], RowSet.at

    def counted(self: RowSet, *arguments: Any) -> RowValues:
        calls.append(1)
        return evaluate(self, *arguments)

    monkeypatch.setattr(RowSet, "at", counted)
    begun(SKI, [FORE, SIDE])
    assert len(calls) < 30


# ---- rates


PROGRAMMED = [
    (PIVOT, ["psi1 = -0.25"], {"psi1": -0.2, "psi1_dot": 0.1, "phi1": -0.9}),
    (PIVOT, ["leg.direction.z = -0.2"], {"psi1": -0.2, "psi1_dot": 0.1, "phi1": 0.7}),
    (SKI, ["leg.tip.z = 0.9"], {"psi1": 1.1, "psi1_dot": -0.2, "phi1": 0.4, "phi0": 0.3, "speed": 2.0}),
]


@pytest.mark.parametrize(("base", "rows", "start"), PROGRAMMED)
def test_a_rate_that_a_row_has_by_rounding_alone_stays(base: Table, rows: list[str], start: dict[str, float]) -> None:
    """Only the given rate of psi changes the row: its error decays, and the azimuth, which was not given, stays at rest."""
    programme = {"constraints": rows, "controls": ["M_psi1"], "frequency": 4.0}
    scene = vlmb.Scene.from_dict({"base": base, "links": [ROD], "start": start, "programme": programme})
    found = consistent_start(make_system(vlmb.build(scene)))
    assert found.rates["psi1_dot"] == start["psi1_dot"] and abs(found.rates["phi1_dot"]) < 1e-12
    assert any("the rate of" in text for text in found.adjustments)
