"""A model has what its scene needs: one revolute joint a link in a plane, with the same motion; nothing that nobody asked for."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import vlmb
from tests.small_scenes import FIXED, FLYING, PIVOT, SKI, link, scene
from vlmb.system.workspace import Workspace

ROOT = Path(__file__).resolve().parents[1]
UNASKED = (
    "sympy",
    "mpmath",
    "matplotlib",
    "meshcat",
    "tqdm",
    "PIL",
    "vlmb.plots",
    "vlmb.view",
    "vlmb.views.page",
    "vlmb.views.canvas",
)


def joints(mechanism: vlmb.Mechanism) -> list[str]:
    """Kinds of joints, without the universe."""
    return [joint.shortname().removeprefix("JointModel") for joint in list(mechanism.model.joints)[1:]]


@pytest.mark.parametrize("base", [PIVOT, FLYING, SKI], ids=["pivot", "free", "ski"])
def test_a_link_in_a_plane_has_one_revolute_joint(base: dict[str, Any]) -> None:
    links = [link("a"), link("b"), link("c", parent="a", lower=FIXED)]
    planar, spatial = (vlmb.build(scene(base, links, plane=plane)) for plane in (True, False))
    assert [kind for kind in joints(planar) if kind.startswith("Revolute")] == ["RevoluteUnaligned"] * 3
    assert joints(spatial).count("Spherical") == 3
    assert not any(kind in ("Spherical", "Planar", "Translation") for kind in joints(planar) if base is not SKI)
    assert spatial.model.nv - planar.model.nv == 2 * 3 + (1 if base is FLYING else 0)
    assert {name for name in spatial.coordinate_names if name not in planar.coordinate_names} == {
        "phi1", "phi2", "phi3", *(["y"] if base is FLYING else [])
    }  # fmt: skip


@pytest.mark.parametrize("base", [PIVOT, FLYING], ids=["pivot", "free"])
def test_motion_in_the_plane_is_that_in_space(base: dict[str, Any]) -> None:
    links = [link("a"), link("b", rod={"length": 0.4, "mass": 2.0}), link("c", parent="a", parent_point="rod_end", lower=FIXED)]
    start = {"psi1": 0.4, "psi2": -0.7, "psi3": 1.1, "psi1_dot": 3.0, "psi2_dot": -2.0, "xi1_1_dot": 0.4}
    if base is FLYING:
        start |= {"z_dot": 2.0, "x_dot": 1.0}
    t = np.linspace(0.0, 1.0, 11)
    planar, spatial = (
        vlmb.simulate(scene(base, links, plane=plane, start=start, slope=0.2), 1.0, t_eval=t) for plane in (True, False)
    )
    assert planar.status == spatial.status == "finished"
    for name in "abc":
        for point in ("hinge", "rod_start", "rod_end", "tip"):
            np.testing.assert_allclose(planar.position(name, point), spatial.position(name, point), atol=1e-8)
    np.testing.assert_allclose(planar["energy"], spatial["energy"], rtol=1e-9)
    assert np.abs(spatial.position("b", "tip")[:, 1]).max() < 1e-9


def test_motion_in_the_plane_of_the_ski_is_that_of_links_held_in_it() -> None:
    links = [link("a"), link("b", rod={"length": 0.4, "mass": 2.0})]
    start = {"psi1": 1.3, "psi2": 0.9, "psi2_dot": 0.5, "phi0": 0.2, "phi0_dot": 0.8, "speed": 2.0}
    t = np.linspace(0.0, 0.5, 6)
    planar = vlmb.simulate(scene(SKI, links, plane=True, start=start, slope=0.1), 0.5, t_eval=t)
    rows = ["phi1 = phi0", "phi2 = phi0"]
    held = {**start, "phi1": 0.2, "phi2": 0.2, "phi1_dot": 0.8, "phi2_dot": 0.8}
    spatial = vlmb.simulate(scene(SKI, links, constraints=rows, start=held, slope=0.1), 0.5, t_eval=t)
    assert planar.status == spatial.status == "finished"
    for name in "ab":
        np.testing.assert_allclose(planar.position(name, "tip"), spatial.position(name, "tip"), atol=1e-7)
    np.testing.assert_allclose(planar["phi0"], spatial["phi0"], atol=1e-7)
    np.testing.assert_allclose(planar.reactions["knife_edge"], spatial.reactions["knife_edge"], rtol=1e-5)


def test_what_is_left_out_makes_no_joint() -> None:
    stiff = link("a", lower=FIXED, upper=FIXED)
    bare = link("b", tip_mass=None)
    mechanism = vlmb.build(scene(PIVOT, [stiff, bare]))
    assert joints(mechanism) == ["Spherical", "Spherical", "PX"]
    assert [entry.partition(",")[0] for entry in mechanism.left_out] == ["xi1_1", "xi1_2", "xi2_2"]


def test_a_run_computes_no_reactions_and_no_geometry_unasked(monkeypatch: pytest.MonkeyPatch) -> None:
    def unasked(*_: object) -> None:
        raise AssertionError("nobody asked for this")

    evaluate = Workspace.evaluate
    monkeypatch.setattr(Workspace, "evaluate", unasked)
    monkeypatch.setattr(pin, "rnea", unasked)
    for name in ("GeometryModel", "GeometryData", "updateGeometryPlacements"):
        monkeypatch.setattr(pin, name, unasked)
    trajectory = vlmb.simulate(
        scene(SKI, [link("a"), link("b")], start={"psi1": 1.2, "speed": 3.0, "phi0_dot": 0.4}), duration=0.05
    )
    assert trajectory.status == "finished"
    assert np.isfinite(trajectory["energy"]).all()
    assert np.isfinite(trajectory.position("b", "tip")).all()
    with pytest.raises(AssertionError, match="nobody asked"):
        _ = trajectory.reactions["knife_edge"]
    monkeypatch.undo()
    assert Workspace.evaluate is evaluate
    assert np.abs(trajectory.reactions["knife_edge"]).max() > 0.0


@pytest.mark.parametrize("name", ["chain", "flight", "plane_two_links", "skier_one_link", "skier_with_arms"])
def test_a_run_of_a_shipped_scene_loads_nothing_heavy(name: str) -> None:
    code = f"""
import sys
import vlmb
trajectory = vlmb.simulate("models/{name}.toml", duration=0.01)
trajectory["energy"], trajectory.position(trajectory.scene.links[-1].name)
print(*sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert not set(UNASKED) & set(done.stdout.split())
