"""Scenes that once went wrong, each with the value that is right."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import pytest

import vlmb
from vlmb.core.jit import COMPILED

BAR: dict[str, Any] = {"rod": {"length": 1.0, "mass": 1.0}}
LONG = pytest.mark.skipif(not COMPILED, reason="long runs need the compiled core")


@LONG
@pytest.mark.parametrize("options", [{}, {"rtol": 1e-10, "atol": 1e-11}, {"method": "adams", "rtol": 1e-9, "atol": 1e-10}])
def test_the_parallelogram_after_ten_seconds_and_all_its_line_ups(options: dict[str, Any]) -> None:
    links = [{"name": "a", **BAR}, {"name": "b", "parent": "a", **BAR}, {"name": "c", "parent": "b", **BAR}]
    start = {"psi1": 0.5 * math.pi, "psi2": 0.0, "psi3": -0.5 * math.pi, "psi1_dot": -1.0}
    rows = ["c.tip.x = 1", "c.tip.z = 0"]
    scene = {"plane": True, "base": {"kind": "pivot"}, "links": links, "constraints": rows, "start": start}
    found = vlmb.simulate(scene, 10.0, **options)
    assert found.position("a", "tip")[-1, [0, 2]] == pytest.approx([0.4783851, 0.8781502], abs=2e-6)


@pytest.mark.parametrize("keys", [{"gravity": 1e20}, {"gravity": 1e40}, {"forces": [{"on": "M_psi1", "law": 1e45}]}], ids=str)
def test_a_gravity_out_of_all_reason_is_told_soon(keys: dict[str, Any]) -> None:
    scene = {"base": {"kind": "pivot"}, "links": [{"name": "a", **BAR}], "start": {"psi1": 0.3}, **keys}
    found = vlmb.simulate(scene, 1.0)
    assert found.status == "failed"
    assert found.stats["rhs_evaluations"] < 1000


@pytest.mark.parametrize("plane", [True, False], ids=["plane", "space"])
@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_a_spring_between_the_one_link_and_the_ground(plane: bool, damping: float) -> None:
    spring = {"between": ["base", "a"], "stiffness": 20.0, "damping": damping}
    scene = {"base": {"kind": "pivot"}, "links": [{"name": "a", **BAR}], "forces": [spring], "start": {"psi1": 0.3}}
    scene["plane"] = plane
    found = vlmb.simulate(scene, 1.0, rtol=1e-9, atol=1e-10)
    assert found.status == "finished"
    assert np.abs(found["balance"]).max() < 1e-8


def swung(rows: list[str]) -> dict[str, Any]:
    """Three links that swing through the nadir, in one upright plane."""
    start = {"psi1": -1.2, "psi2": -1.0, "psi3": -0.8, "phi1": 0.3, "phi2": 0.3, "phi3": 0.3}
    return {"base": {"kind": "pivot"}, "links": [{"name": name, **BAR} for name in "abc"], "constraints": rows, "start": start}


@pytest.mark.parametrize("engine", ["core", "pinocchio"] if COMPILED else ["core"])
@pytest.mark.parametrize("rows", [["phi2=phi1", "phi3=phi1"], ["phi2=phi1", "phi3=phi1", "phi2=phi3"]])
def test_azimuths_that_are_equal_pass_the_pole_however_often_it_is_said(rows: list[str], engine: str) -> None:
    flat = swung([]) | {"plane": True, "start": {"psi1": -1.2, "psi2": -1.0, "psi3": -0.8}}
    plane = vlmb.simulate(flat, 1.0, rtol=1e-9, atol=1e-10)
    found = vlmb.simulate(swung(rows), 1.0, rtol=1e-9, atol=1e-10, engine=engine)
    assert found.status == "finished", found.message
    out = found.position("c", "tip") @ np.array([math.cos(0.3), math.sin(0.3), 0.0])
    np.testing.assert_allclose(out, plane.position("c", "tip")[:, 0], atol=1e-6)


@pytest.mark.parametrize("engine", ["core", "pinocchio"] if COMPILED else ["core"])
def test_a_repeated_row_that_an_azimuth_at_the_pole_keeps_apart_is_told_as_that(engine: str) -> None:
    found = vlmb.simulate(swung(["phi2=phi1", "phi3=phi1", "phi2=phi3", "2*phi1-phi2-phi3=0"]), 1.0, engine=engine)
    if found.status == "failed":
        assert "goes by an azimuth, and a link stands next to the pole" in found.message
        assert "contradict each other" not in found.message


@pytest.mark.parametrize("engine", ["core", "pinocchio"] if COMPILED else ["core"])
def test_rows_that_contradict_each_other_away_from_a_pole_are_told_as_that(engine: str) -> None:
    made = swung(["phi1 = 0.3 + 0*t", "phi1 = 0.3 + 0.5*t**2"])
    found = vlmb.simulate(made, 1.0, engine=engine)
    assert found.status == "failed"
    assert "contradict each other here: drop one" in found.message


@LONG
@pytest.mark.parametrize(("method", "most"), [("dop853", 10_000), ("adams", 5_000), ("radau", 60_000)])
def test_the_end_of_a_law_is_not_crawled_up_to(method: str, most: int) -> None:
    """At t = 1 the root has no slope, beyond it no value."""
    scene = {"base": {"kind": "pivot"}, "links": [{"name": "a", **BAR}], "forces": [{"on": "M_psi1", "law": "sqrt(1 - t)"}]}
    found = vlmb.simulate(scene, 2.0, method, start={"psi1": 0.3})
    assert found.message == "failed at t = 1 s: the law 'sqrt(1 - t)' of the force on M_psi1 has no finite value"
    assert found.stats["rhs_evaluations"] < most


@pytest.mark.parametrize("method", ["dop853", "adams", "bdf"])
def test_what_rests_takes_long_steps(method: str) -> None:
    scene = {"base": {"kind": "free", "mass": 1.0}, "links": [{"name": "a", **BAR}], "gravity": 0.0}
    found = vlmb.simulate(scene, 30.0, method)
    assert found.status == "finished" and found.stats["rhs_evaluations"] < 300


@LONG
def test_a_glide_under_a_control_keeps_to_its_samples() -> None:
    """With a control a step is a sample long at most, and hardly shorter."""
    scene = {"base": {"kind": "ski", "mass": 5.0, "inertia": 0.6}, "links": [{"name": "a", **BAR}], "start": {"speed": 5.0}}
    run = {"fall": False, "samples": 60.0}
    found = vlmb.simulate({**scene, "run": run}, 5.0, "adams", control=lambda t, view: {"F_x": 0.1})
    assert found.status == "finished" and 300 <= found.stats["steps"] < 900


def test_samples_beyond_memory_are_refused() -> None:
    scene = {"base": {"kind": "pivot"}, "links": [{"name": "a", **BAR}]}
    for run in ({"samples": 1e12}, {"duration": 1e9, "samples": 1e3}):
        with pytest.raises(vlmb.SceneError, match="at most 10000000 samples"):
            vlmb.simulate({**scene, "run": run})


@LONG
@pytest.mark.parametrize("engine", ["core", "pinocchio"])
def test_a_short_run_of_a_scene_that_is_built_takes_few_milliseconds(engine: str) -> None:
    scene = {"base": {"kind": "pivot"}, "links": [{"name": "a", **BAR}], "forces": [{"on": "M_psi1", "law": "sin(3*t)*exp(-t)"}]}
    made, spent = vlmb.build(scene), []
    for _ in range(6):
        began = time.thread_time()
        vlmb.simulate(made, 0.01, engine=engine)
        spent.append(time.thread_time() - began)
    assert min(spent) < 0.012


@LONG
@pytest.mark.parametrize(("on", "law", "engine"), [
    ("M_phi1", "-0.5*phi1_dot", "core"), ("M_phi1", "-0.3*a.azimuth_dot", "core"), ("M_phi1", "-phi1_dot", "pinocchio"),
])  # fmt: skip
def test_a_run_that_ends_beside_a_pole_names_the_link_and_what_to_use(on: str, law: str, engine: str) -> None:
    """A damper of the azimuth grows without bound where its link swings through the nadir; one of the hinge does not."""
    scene = {"base": {"kind": "pivot"}, "links": [{"name": "a", **BAR}], "start": {"psi1": -1.2, "phi1": 0.3}}
    options = {"rtol": 1e-8, "atol": 1e-9, "engine": engine}
    ends = vlmb.simulate(scene | {"forces": [{"on": on, "law": law}]}, 1.0, **options)
    assert ends.status == "failed"
    assert "Link 'a' stands next to the pole" in ends.message and "use a hinge torque T_a" in ends.message
    assert vlmb.simulate(scene | {"forces": [{"on": "T_a", "law": "-0.5*psi1_dot"}]}, 1.0, **options).status == "finished"


@pytest.mark.parametrize("engine", ["core", "pinocchio"] if COMPILED else ["core"])
@pytest.mark.parametrize("law", ["0*t", "0*psi1_dot", "where(t < 9, 0, 1)", None])
def test_a_moment_of_nothing_has_no_pole(law: str | None, engine: str) -> None:
    """M_phi acts as M / cos(psi): where M is 0 a link stands upright, and swings through, as without it."""
    bare = {"base": {"kind": "pivot"}, "links": [{"name": "a", **BAR}], "start": {"psi1": 0.5 * math.pi, "psi1_dot": -1.0}}
    acting = bare if law is None else bare | {"forces": [{"on": "M_phi1", "law": law}]}
    control = (lambda t, view: {"M_phi1": 0.0}) if law is None else None
    found, free = vlmb.simulate(acting, 1.0, engine=engine, control=control), vlmb.simulate(bare, 1.0, engine=engine)
    assert found.status == "finished", found.message
    np.testing.assert_allclose(found.position("a", "tip"), free.position("a", "tip"), atol=1e-6)


@pytest.mark.parametrize("keys", [
    {"constraints": ["psi1 = 1.2 + t"]}, {"constraints": ["a.elevation = 1.2 + t"]},
    {"programme": {"constraints": ["psi1 = 1.2 + t"], "controls": ["M_psi1"], "frequency": 4.0}},
])  # fmt: skip
def test_an_elevation_that_is_driven_into_the_pole_is_told_as_that(keys: dict[str, Any]) -> None:
    """A link that goes round while it rises cannot rise beyond the vertical."""
    start = {"psi1": 1.2, "phi1": 0.2, "phi1_dot": 0.1}
    found = vlmb.simulate({"base": {"kind": "pivot"}, "links": [{"name": "a", **BAR}], "start": start, **keys}, 1.0)
    assert found.status == "failed" and "Link 'a' stands next to the pole" in found.message and "plane = true" in found.message


@pytest.mark.parametrize("method", ["radau", "bdf"])
@pytest.mark.parametrize("law", ["sqrt(0.3 - t)", "log(psi1 + 1)", "1e300*t"])
def test_an_implicit_method_keeps_what_it_computed_before_numbers_end(law: str, method: str) -> None:
    scene = {"base": {"kind": "pivot"}, "links": [{"name": "a", **BAR}], "forces": [{"on": "M_psi1", "law": law}]}
    found = vlmb.simulate(scene, 1.0, method, start={"psi1": 0.3})
    assert found.status == "failed" and np.isfinite(found["psi1"]).all()
    assert found.stats["rhs_evaluations"] < 10_000 and "infs or NaNs" not in found.message
    assert len(found) == np.searchsorted(np.linspace(0.0, 1.0, 201), found.t[-1]) + 1
