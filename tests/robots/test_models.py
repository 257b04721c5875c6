"""The models with robots keep what they promise, and their pages play in a browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import vlmb
from tests.views.browser import Browser, find_browser
from vlmb.cli import main
from vlmb.model.robot_files import drawn_shapes
from vlmb.views.meshes import simplified
from vlmb.views.robot_scenery import inertia_box
from vlmb.views.sceneries import of_state
from vlmb.views.shapes import ball

MODELS = sorted((Path(__file__).resolve().parents[2] / "models" / "robots").glob("*.toml"))
LARGEST = 5_000_000  # bytes of a page


def test_there_are_models() -> None:
    assert [path.stem for path in MODELS] == ["humanoid_on_its_soles", "humanoid_on_snowboard", "pole_on_an_arm", "ur5_circle"]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser | None]:
    """One for all pages; None where there is no Chromium."""
    if find_browser() is None:
        yield None
        return
    with Browser() as made:
        yield made


@pytest.mark.parametrize("path", MODELS, ids=[path.stem for path in MODELS])
def test_a_model_runs_and_is_seen(
    path: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], browser: Browser | None
) -> None:
    assert main(["run", str(path), "-o", str(tmp_path), "--quiet"]) == 0
    said, wrong = capfd.readouterr()
    assert not wrong or (wrong.startswith("vlmb: compiling") and wrong.count("\n") == 1)  # nor what a library prints by itself
    assert "finished" in said and "limits" in said and "WARNING" not in said
    trajectory = vlmb.load_trajectory(tmp_path / "run.npz")
    assert trajectory.status == trajectory.scene.expect["status"] and not trajectory.doubts
    assert np.abs(trajectory["balance"]).max() < 1e-6 * trajectory["kinetic"].max()
    page = tmp_path / "run.html"
    assert page.stat().st_size < LARGEST
    assert {"joints.png", "energy.png", "controls.png"} <= {entry.name for entry in tmp_path.iterdir()}
    chosen = vlmb.plots.save_all(trajectory, tmp_path / "dark", only=["energy"], dark=True)
    assert [entry.name for entry in chosen] == ["energy.png"]
    assert chosen[0].read_bytes() != (tmp_path / "energy.png").read_bytes()
    with pytest.raises(vlmb.VlmbError, match="no plot 'enrgy' of a run with robots; did you mean 'energy'"):
        vlmb.plots.save_all(trajectory, tmp_path, only=["enrgy"])
    with pytest.raises(vlmb.VlmbError, match="show one run: plot each run by itself"):
        vlmb.plots.save_all([trajectory, trajectory], tmp_path)
    if browser is None:
        pytest.skip("no Chromium is installed, so no page can be looked at")
    browser.open(page.as_uri())
    browser.run("vlmb.seek(1.0)")
    assert browser.complaints() == []
    assert [url for url in browser.requests() if not url.startswith(("file:", "data:"))] == []


def test_a_scene_with_robots_is_told_and_checked(capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("info", "check"):
        assert main([command, str(MODELS[1])]) == 0
    said = capsys.readouterr().out
    assert "degrees of freedom  26" in said and "root.yaw" in said
    assert "only load what is welded" in said


def test_shapes_are_those_of_the_urdf_or_of_its_inertia() -> None:
    shapes = drawn_shapes("talos_data/robots/talos_reduced.urdf")
    assert len(shapes) > 25 and any(shape.colour not in ("", "#ffffff") for shape in shapes)
    mechanism = vlmb.build({"base": {"kind": "pivot"}, "robots": [{"name": "box", "urdf": BOX}]})
    start = vlmb.check(mechanism).start
    made = of_state(mechanism, start.state)
    assert [body.path for body in made.bodies if body.path.startswith("robots/")] == ["robots/box/hinge"]
    body = next(body for body in made.bodies if body.path == "robots/box/hinge")
    assert np.ptp(body.shape.vertices, axis=0) == pytest.approx([0.4, 0.2, 0.1], rel=1e-9)
    seen = body.shape.vertices @ np.asarray(body.rotation).reshape(-1, 3, 3)[0].T + np.asarray(body.position).reshape(-1, 3)[0]
    assert np.linalg.norm(seen - made.focus[0], axis=1).max() < made.radius  # a camera sees it whole
    assert len(simplified(ball(1.0), 100).faces) <= 100
    assert inertia_box(mechanism.model.inertias[1]).faces.shape == (12, 3)


BOX = """<robot name="box"><link name="base"/><link name="body"><inertial><origin xyz="0.2 0 0"/><mass value="12"/>
<inertia ixx="0.05" iyy="0.17" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="body"/><axis xyz="0 1 0"/></joint></robot>"""
