"""Fifteen hard cases in their short forms: none ends in NaN, a hang, or a wrong answer without a word."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import vlmb
from tests.acceptance import hard_geometry, hard_rows
from tests.acceptance.hard_cases import CASES, keep, rows_of, section, stored, summary
from tests.acceptance.hard_finding import PIVOT, Finding, rod, scene
from tests.reference.two_rods import TwoRods

DOCS = Path(__file__).resolve().parents[2] / "docs"


def findings(case: int) -> list[Finding]:
    """Measure a case's short form; none of it may be off without a word."""
    found = CASES[case](True)
    wrong = [f for f in found if f.verdict == "WRONG"]
    assert not wrong, "\n".join(map(str, wrong))
    assert len(rows_of(found)) == len(found)
    return found


def named(found: list[Finding], what: str) -> Finding:
    """The one finding whose variant has these words."""
    (only,) = [f for f in found if what in f.what]
    return only


def test_there_are_fifteen() -> None:
    assert list(CASES) == list(range(1, 16))


def test_the_page_shows_the_stored_results_and_none_is_wrong() -> None:
    found = stored(DOCS / "acceptance")
    assert len(found) == 15
    assert all(f.verdict != "WRONG" for findings in found.values() for f in findings)
    assert summary(found) in (DOCS / "hard_cases.md").read_text(encoding="utf-8")
    table = (DOCS / "acceptance" / "hard_cases.md").read_text(encoding="utf-8")
    assert all(section(title, findings) in table for title, findings in found.items())


def test_cases_are_kept_beside_those_measured_before(tmp_path: Path) -> None:
    keep(tmp_path, 2, [Finding("one", "way", math.inf, limit=1.0, said="stopped")])
    keep(tmp_path, 1, [Finding("another", "way", 0.1, limit=1.0)])
    keep(tmp_path, 2, [Finding("one", "way", 0.2, limit=1.0)])
    found = stored(tmp_path)
    assert [title[:2] for title in found] == ["1.", "2."]
    assert [f.error for findings in found.values() for f in findings] == [0.1, 0.2]
    assert "2 right" in (tmp_path / "hard_cases.md").read_text(encoding="utf-8")


def test_a_finding_off_without_a_word_is_wrong() -> None:
    assert Finding("", "", 1.0, limit=0.5).verdict == "WRONG"
    assert Finding("", "", math.nan, limit=0.5).verdict == "WRONG"
    assert Finding("", "").verdict == "WRONG"
    assert Finding("", "", 0.1, limit=0.5).verdict == "right"
    assert Finding("", "", 1.0, limit=0.5, said="stopped").verdict == "said"


def test_1_link_through_the_vertical() -> None:
    found = findings(1)
    assert all(f.error < 1e-10 and not f.said for f in found)
    assert all(f.condition < 1e3 for f in found)
    assert "stuck" in named(found, "link, 1e-12 rad").naive and "stuck" in named(found, "link, 1e-06 rad").naive


@pytest.mark.parametrize("offset", [1e-3, 1e-6])
def test_1_the_link_comes_as_near_to_the_vertical_as_it_was_thrown(offset: float) -> None:
    way = vlmb.simulate(hard_geometry.over_the_top(offset), t_eval=np.linspace(0.0, 1.0, 20001), duration=1.0)
    nearest = np.hypot(way["link1.direction.x"], way["link1.direction.y"])[way["link1.direction.z"] > 0.0].min()
    assert nearest == pytest.approx(offset, rel=0.05, abs=2e-4)


def test_2_heading_through_90_degrees_and_full_turns() -> None:
    found = findings(2)
    assert found[0].error < 1e-10 and found[0].residual < 1e-13
    assert found[1].error < 1e-10 and found[1].residual < 1e-12
    assert "2.0 turns" in found[1].what
    assert all("stuck" in f.naive for f in found)


def test_3_two_links_through_a_straight_line() -> None:
    found = findings(3)
    started = named(found, "started on the line")
    assert started.error is None and "mass matrix is singular" in started.said and "link2" in started.said
    assert "no mass and free segments on both sides" in named(found, "before the line").said
    light, normal = named(found, "1e-6 of the rod"), named(found, "a quarter of the rod")
    assert light.error < 1e-8 and light.condition > 1e6 and "NaN" in light.naive
    assert normal.error < 1e-9 and normal.condition < 100.0


def test_4_mass_ratios_to_1e8_and_a_tip_mass_of_1e_9() -> None:
    found = findings(4)
    assert all(f.error < 1e-10 for f in found[:2])
    assert all(f.error < 1e-9 for f in found[2:])


def test_5_lengths_at_zero_and_below() -> None:
    found = findings(5)
    for f in found:
        if "rebounds" in f.what:
            assert f.error < 1e-9 and not f.said
    assert "reached its limit 0 m" in named(found, "limit 0").said
    assert all(f.error < 1e-9 for f in found if "far end" in f.what)
    assert "NaN" in named(found, "hinge at 1e-06 m").naive


def test_6_stiff_legs() -> None:
    found = findings(6)
    assert max(f.error for f in found) < 1e-8
    assert float(named(found, "1e+08 N/m, adams").naive.rpartition(" ")[2]) > 1e-4


def test_7_inconsistent_and_far_off_starts() -> None:
    found = findings(7)
    apart = named(found, "2 rad apart")
    assert apart.residual < 1e-12 and "given: 0" in apart.said and "given: 2" in apart.said
    assert "sideways velocity 5 m/s" in named(found, "sideways").said
    assert named(found, "0.7 rad off").error < 1e-12
    assert "cos(psi1) = 2" in named(found, "no posture").said
    assert "psi1 = 1.1" in named(found, "contradict").said
    assert "outside its limits" in named(found, "limits").said


def test_7_azimuths_given_apart_meet_halfway_and_the_link_keeps_its_lean() -> None:
    start = {"phi0": 0.2, "phi1": 3.0, "psi1": 1.0}
    case = scene(hard_rows.SKI, [hard_rows.WEIGHTY], constraints=["phi1 = phi0"], start=start)
    way = vlmb.simulate(case, duration=0.01)
    assert (way["phi0"][0], way["phi1"][0], way["psi1"][0]) == pytest.approx((1.6, 1.6, 1.0), abs=1e-9)


@pytest.mark.slow
def test_8_redundant_and_nearly_dependent_rows() -> None:
    found = findings(8)
    assert all(f.error < 1e-10 for f in found if "say the same" in f.what)
    assert named(found, "0.0001").error < 1e-8
    for apart in ("1e-07", "1e-09"):
        f = named(found, f"differs by {apart}")
        assert f.residual < 1e-7 and "1 of them independent" in f.said
    assert "cannot be met" in named(found, "rows that contradict").said
    assert "xi1_1 = 0.3" in named(found, "do not act").said
    assert "LinAlgError" in found[0].naive


@pytest.mark.slow
def test_9_gains() -> None:
    found = findings(9)
    for method in ("euler", "rk4"):
        for row in ("the knife edge", "a holonomic row"):
            assert named(found, f"{method}, {row}").error < 0.01
    assert "2, 2.5, 2.7, 2.8, 3" in named(found, "euler, gains").done.partition("named at")[2]
    assert "2.8, 3" in named(found, "rk4, gains").done.partition("named at")[2]
    assert all(f.error < 1e-7 and f.residual < 1e-6 for f in found if "per second" in f.what)


def test_10_programme_through_its_singular_posture() -> None:
    found = findings(10)
    assert "do not act on 'link1.tip.x" in found[0].said or "have no effect" in found[0].said
    assert found[1].error < 1e-5 and not found[1].said
    assert found[2].verdict == "right"
    assert "without a word" in found[0].naive


def test_11_ten_thousand_steps() -> None:
    found = findings(11)
    assert found[0].what.startswith("10000 steps")
    assert found[0].error < 1e-5 and found[0].residual == 0.0
    gauss = named(found, "gauss")
    assert gauss.error < 1e-8
    assert all(f.residual < 1e-14 for f in found)


def test_12_fast_spin() -> None:
    found = findings(12)
    assert found[0].error < 1e-9
    assert named(found, "order of rk4").error < 0.3
    assert named(found, "ski turning").error < 1e-11


def test_13_chaos_against_30_digits() -> None:
    found = findings(13)
    assert all(f.error < 1e-4 for f in found)


def test_13_the_reference_has_30_digits() -> None:
    rods, times = TwoRods(), [0.0, 0.5, 1.5]
    coarse, fine = (rods.motion([1.0, 0.5], [0.0, 0.0], times, digits) for digits in (30, 40))
    assert max(abs(a - b) for x, y in zip(coarse, fine, strict=True) for a, b in zip(x, y, strict=True)) < 1e-27
    assert rods.energy(fine[2]) == pytest.approx(rods.energy(fine[0]), rel=1e-14)


def test_14_rest_at_an_unstable_equilibrium() -> None:
    found = findings(14)
    assert all("unstable equilibrium" in f.said and "exp(5.42 t)" in f.said for f in found[:-1])
    assert math.sqrt(1.5 * 9.81 / 0.5) == pytest.approx(5.42, abs=5e-3)
    assert found[-1].error < 1e-5 and not found[-1].said


def test_14_a_stable_equilibrium_needs_no_word() -> None:
    hanging = scene(PIVOT, [rod()], start={"psi1": -math.pi / 2})
    way = vlmb.simulate(hanging, duration=1.0)
    assert way.adjustments == ()
    assert np.abs(way.position("link1") - [0.0, 0.0, -0.5]).max() < 1e-12


@pytest.mark.slow
def test_15_infinities_nan_and_denormals_in_every_input() -> None:
    found = findings(15)
    assert all(f.error == 0.0 for f in found), "\n".join(f.done for f in found)
    assert int(found[0].done.split()[0]) > 200


def test_a_run_may_begin_inside_another() -> None:
    case = scene(PIVOT, [rod()], start={"psi1": 0.3})
    inner: list[str] = []

    def look(t: float) -> None:
        if not inner:
            inner.append(vlmb.simulate(case, duration=0.1, method="adams").status)

    alone = vlmb.simulate(case, duration=1.0, method="adams")
    way = vlmb.simulate(case, duration=1.0, method="adams", progress=look)
    assert inner == ["finished"]
    assert way.status == "finished" and np.array_equal(way.q, alone.q)
