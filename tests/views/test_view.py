"""The view: scenery, pages, stills, the command; with a Chromium, also what a browser really draws."""

from __future__ import annotations

import base64
import dataclasses
import io
import json
import re
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.anchored import anchored
from tests.small_scenes import random_state
from tests.views.browser import Browser
from tests.views.scenes import MODELS, SKIER, TREE
from vlmb import Scene, Trajectory, build, load_scene, simulate
from vlmb.cli import main, make_parser
from vlmb.scene.expressions import parse_equation
from vlmb.views import appearance, shapes
from vlmb.views import view as view_module
from vlmb.views.canvas import Camera, Canvas
from vlmb.views.live import Live
from vlmb.views.notebook import card
from vlmb.views.page import page
from vlmb.views.reference_path import course, solved
from vlmb.views.shapes import Mesh
from vlmb.views.stills import movie
from vlmb.views.view import Shot, View, export_html, has_display, picture, show
from vlmb.views.visual_model import Scenery, of_state, of_trajectory

umsgpack = pytest.importorskip("umsgpack", reason="meshcat is not installed")
Image = pytest.importorskip("PIL.Image", reason="pillow is not installed")
av = pytest.importorskip("av", reason="PyAV is not installed")

TIMES = (0.1, 0.25, 0.45)  # [s] at which there is a sample and a frame


def commands_of(text: str) -> list[dict[str, Any]]:
    """Read meshcat's commands back from a page, arrays of floats included."""
    blocks = re.findall(r'<script type="application/octet-stream">([^<]*)</script>', text)
    handlers = {0x17: lambda ext: np.frombuffer(ext.data, "<f4"), 0x16: lambda ext: np.frombuffer(ext.data, "<u4")}
    return [umsgpack.unpackb(base64.b64decode(block), ext_handlers=handlers) for block in blocks]


def tracks_of(text: str) -> dict[tuple[str, str], tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]]:
    """Return times and values of the tracks of a page, by path and property."""
    found = {}
    for command in commands_of(text):
        for entry in command.get("animations", []):
            for track in entry["clip"]["tracks"]:
                times = track["times"]
                found[entry["path"], track["name"]] = (times, track["values"].reshape(len(times), -1))
    return found


def at(trajectory: Trajectory, name: str, when: float) -> float:
    return float(np.interp(when, trajectory.t, trajectory[name]))


def longer(trajectory: Trajectory, seconds: float) -> Trajectory:
    """Play a motion forth and back until it lasts so long."""
    n, period = len(trajectory.t), trajectory.t[-1]
    turns = int(np.ceil(seconds / period))
    order = np.concatenate(
        [np.arange(n), *(np.arange(n - 2, -1, -1) if k % 2 == 0 else np.arange(1, n) for k in range(turns - 1))]
    )
    t = np.concatenate([trajectory.t, *(trajectory.t[1:] + (k + 1) * period for k in range(turns - 1))])
    changes = {name: getattr(trajectory, name)[order][t <= seconds] for name in ("states", "inputs")}
    return dataclasses.replace(trajectory, t=t[t <= seconds], **changes)


# scenery -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["skier", "tree"])
def test_bodies_are_where_the_points_of_the_links_are(name: str, request: pytest.FixtureRequest) -> None:
    run: Trajectory = request.getfixturevalue(name)
    made = of_trajectory(run, fps=1.0 / (run.t[1] - run.t[0]))
    np.testing.assert_allclose(made.t, run.t, atol=1e-12)
    origin, unit = np.array([0.0, 0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0, 1.0])
    for frame in (0, len(run) // 2, len(run) - 1):
        poses = made.poses(frame)
        for link in run.scene.links:
            ends = {
                "hinge": poses[f"links/{link.name}"] @ origin,
                "rod_start": poses[f"links/{link.name}/rod"] @ origin,
                "rod_end": poses[f"links/{link.name}/rod"] @ [link.rod.length, 0.0, 0.0, 1.0],
                "tip": poses.get(
                    f"links/{link.name}/rod/upper", poses[f"links/{link.name}/rod"] @ np.diag([link.rod.length, 1, 1, 1])
                )
                @ unit,
            }
            for point, place in ends.items():
                np.testing.assert_allclose(place[:3], run.position(link.name, point)[frame], atol=1e-9)


@pytest.mark.parametrize("base", ["pivot", "ski"])
def test_anchors_are_drawn_where_the_links_stand(base: str) -> None:
    mechanism = vlmb.build(anchored(base))
    state = random_state(mechanism, 2)
    made = of_state(mechanism, state)
    poses, scene = made.poses(0), mechanism.scene
    for name in ("front", "back"):
        hinge = mechanism.position(state, name, "hinge")
        np.testing.assert_allclose((poses[f"links/{name}"] @ [0.0, 0.0, 0.0, 1.0])[:3], hinge, atol=1e-12)
        if base == "ski":  # a bar from the middle of the ski to the anchor
            bar = poses[f"ski/binding_{name}"]
            np.testing.assert_allclose((bar @ [1.0, 0.0, 0.0, 1.0])[:3], hinge, atol=1e-12)
            foot = (np.linalg.inv(poses["ski"]) @ bar @ [0.0, 0.0, 0.0, 1.0])[:3]
            np.testing.assert_allclose(foot[1:], 0.0, atol=1e-12)
            assert abs(foot[0]) < 0.5
    stands = [body.position for body in made.bodies if body.path.startswith("stand")]
    anchors = [link.anchor or (0.0, 0.0, 0.0) for link in scene.links if link.parent == "base"]
    assert len(stands) == (3 if base == "pivot" else 0)
    if base == "pivot":
        np.testing.assert_allclose(sorted(map(tuple, stands)), sorted(anchors), atol=1e-15)


def test_spheres_grow_with_the_cube_root_of_their_mass() -> None:
    radii = []
    for mass in (1.0, 8.0):
        scene = {
            "base": {"kind": "pivot"},
            "links": [{"rod": {"length": 1.0, "mass": 1.0}, "tip_mass": mass}],
            "start": {"psi1": 0.3},
        }
        mechanism = build(Scene.from_dict(scene))
        bodies = {body.path: body.shape for body in view_module.posture(mechanism).bodies}
        ball = bodies["links/link1/rod/mass"]
        assert isinstance(ball, Mesh)
        radii.append(np.linalg.norm(ball.vertices, axis=1).max())
    assert radii[1] == pytest.approx(2.0 * radii[0])


def test_gravity_points_down_on_the_screen(skier: Trajectory) -> None:
    down = of_trajectory(skier).turn @ np.array(skier.scene.surface_gravity)
    np.testing.assert_allclose(down, [0.0, 0.0, -9.81], atol=1e-12)


def test_arrows_show_gravity_and_the_edge_force(skier: Trajectory) -> None:
    made = of_trajectory(skier, arrows=True)
    bodies = {body.path: body for body in made.bodies}
    last = len(made.t) - 1
    gravity, edge = (made.poses(last)[path][:3, 0] for path in ("gravity", "ski/edge_force"))
    np.testing.assert_allclose(gravity, np.array(skier.scene.surface_gravity) / 9.81, atol=1e-9)
    heading = skier["phi0"][-1]
    share = skier.reactions["knife_edge"][-1] / (75.0 * 9.81)
    np.testing.assert_allclose(edge, share * np.array([-np.sin(heading), np.cos(heading), 0.0]), atol=1e-9)
    assert bodies["gravity"].in_front
    assert not {"gravity", "ski/edge_force"} & {body.path for body in of_trajectory(skier).bodies}


SOLIDS = [shapes.ball(0.3), shapes.tube(0.2), shapes.bellows(0.2), shapes.torso(0.5, 0.13, 1.3, 0.8),
          shapes.barrel(0.3, 0.1, 1.3, 0.8),
          shapes.boot(0.3, 0.1, 0.05), shapes.between(np.array([0.1, 0.2, 0.3]), np.array([0.4, -0.2, 0.1]), 0.05),
          shapes.limb(1.0, 0.1), shapes.limb(0.2, 0.3, 1.3, 0.7), shapes.arrow(1.0),
          shapes.cone(1.0, 0.4), shapes.turned_over(shapes.cone(1.0, 0.4)), shapes.ski(1.8)]  # fmt: skip


@pytest.mark.parametrize("mesh", SOLIDS)
def test_solids_are_closed_and_face_outwards(mesh: Mesh) -> None:
    corners = mesh.vertices[mesh.faces]
    assert np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() > 0.0
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
    np.testing.assert_allclose(area, 0.0, atol=1e-9)


def test_a_way_that_stands_still_and_a_dashed_way_are_drawn() -> None:
    still_way = shapes.ribbon(np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.0, 0.0]]), 0.1, 0.0)
    assert np.isfinite(still_way.vertices).all()
    dashed = shapes.dashes(np.column_stack([np.linspace(0, 4, 50), np.zeros(50)]), 0.1, 0.0, 0.5)
    assert len(dashed.faces) == 4 * 4 * 2


def follows(equation: str, **start: float) -> dict[str, Any]:
    """Return a skate whose heading follows a programme."""
    return {
        "base": {"kind": "ski", "mass": 5.0, "inertia": 0.6}, "parameters": {"A": 1.0, "k": 0.4},
        "programme": {"constraints": [equation], "controls": ["M_phi0"], "frequency": 8.0},
        "start": {"speed": 4.0, **start}, "run": {"duration": 6.0},
    }  # fmt: skip


def test_a_programme_prescribes_a_course() -> None:
    t, speed = np.linspace(0.0, 6.0, 361), np.full(361, 4.0)
    waves = course(Scene.from_dict(follows("tan(phi0) = A*k*cos(k*x)")), t, speed, (1.0, 2.0, 0.3))
    assert waves is not None and len(waves) == 361
    np.testing.assert_allclose(waves[:, 1] - 2.0, np.sin(0.4 * waves[:, 0]) - np.sin(0.4), atol=2e-4)
    np.testing.assert_allclose(np.linalg.norm(np.diff(waves, axis=0), axis=1), 4.0 / 60.0, rtol=1e-9)
    circle = course(Scene.from_dict(follows("phi0_dot = 0.2*speed")), t, speed, (0.0, 0.0, 0.0))
    assert circle is not None
    np.testing.assert_allclose(np.linalg.norm(circle - [0.0, 5.0], axis=1), 5.0, atol=1e-3)
    in_time = course(Scene.from_dict(follows("phi0 = 0.1*t")), t, speed, (0.0, 0.0, 0.0))
    assert in_time is not None
    np.testing.assert_allclose(in_time[-1], [40.0 * np.sin(0.6), 40.0 * (1.0 - np.cos(0.6))], atol=1e-3)


def test_where_no_course_is_prescribed() -> None:
    t, speed, place = np.linspace(0.0, 6.0, 361), np.full(361, 4.0), (0.0, 0.0, 0.0)
    assert course(Scene.from_dict(SKIER), t, speed, place) is None
    programme = {"constraints": ["phi1 = phi0", "psi1 = 1.4"], "controls": ["M_phi1", "M_psi1"], "frequency": 5.0}
    lean = {**SKIER, "programme": programme}
    assert course(Scene.from_dict(lean), t, speed, place) is None
    assert course(Scene.from_dict(follows("sin(phi0) = 2 + x")), t, speed, place) is None
    ends = course(Scene.from_dict(follows("phi0 = 0.2*sqrt(5 - x)")), t, speed, place)
    assert ends is not None and 4.9 < ends[-1, 0] < 5.01 and len(ends) < 100  # beyond x = 5 there is no heading
    many = course(Scene.from_dict(follows("phi0 = 0.1*t")), np.linspace(0.0, 6.0, 50_000), np.full(50_000, 4.0), place)
    assert many is not None and len(many) == 3000  # a long run has as many points at most
    assert solved(parse_equation("phi0**2 = 4"), "phi0", {}, 1.0) == pytest.approx(2.0)
    assert solved(parse_equation("phi0**2 = -1"), "phi0", {}, 1.0) is None


def test_the_course_is_drawn_dashed_and_the_track_on_it() -> None:
    scene = Scene.from_dict(follows("tan(phi0) = A*k*cos(k*x)"))
    run = simulate(scene)
    bodies = {body.path: body for body in of_trajectory(run).bodies}
    dashed = bodies["programme"].shape
    assert isinstance(dashed, Mesh) and len(dashed.vertices) > 40
    np.testing.assert_allclose(dashed.vertices[:, 1], np.sin(0.4 * dashed.vertices[:, 0]), atol=0.04)
    start = {body.path for body in view_module.posture(build(scene)).bodies}
    assert "programme" in start and "track" not in start
    (line,) = [line for line in vlmb.plots.path(run).axes[0].lines if line.get_label() == "course"]
    np.testing.assert_allclose(line.get_ydata(), np.sin(0.4 * line.get_xdata()), atol=2e-4)
    own = of_trajectory(run, programme=np.array([[0.0, 0.0], [5.0, 1.0]]))
    assert {body.path: body for body in own.bodies}["programme"].shape.vertices[:, 0].max() < 5.1


# the page ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["skier", "tree"])
def test_tracks_stretch_segments_as_simulated(name: str, request: pytest.FixtureRequest) -> None:
    run: Trajectory = request.getfixturevalue(name)
    tracks = tracks_of(page(of_trajectory(run)))
    for path, coordinate in {"skier": {"legs/lower": "xi1_1", "legs/rod/upper": "xi1_2"},
                             "tree": {"trunk/rod/upper": "xi1_2", "left/lower": "xi2_1"}}[name].items():  # fmt: skip
        times, values = tracks[f"/vlmb/links/{path}", ".scale"]
        for when in TIMES:
            assert np.interp(when, times, values[:, 0]) == pytest.approx(at(run, coordinate, when), abs=1e-4)
        assert (values[:, 1:] == 1.0).all()
    kinds = {kind for _, kind in tracks}
    assert kinds == {".position", ".quaternion", ".scale"}


def test_what_stands_still_has_no_track(tree: Trajectory) -> None:
    tracks = tracks_of(page(of_trajectory(tree)))
    assert ("/vlmb/links/right/rod", ".position") not in tracks
    assert ("/vlmb/links/right/lower", ".scale") not in tracks
    pivoted = simulate(Scene.from_dict({**TREE, "base": {"kind": "pivot"}, "start": {"psi1": 1.2, "psi2": 0.3, "psi3": 0.2}}))
    assert ("/vlmb/links/trunk", ".position") not in tracks_of(page(of_trajectory(pivoted)))


def test_a_page_refers_to_nothing_outside(skier: Trajectory) -> None:
    text = page(of_trajectory(skier))
    assert not re.search(r"""(?:src|href|action)\s*=\s*["']?\s*(?:https?:)?//""", text)
    assert not re.search(r"""(?:url\(|@import|import\(|fetch\()\s*["']?https?:""", text)
    assert "@TITLE@" not in text and "@INFO@" not in text and "@BLOCKS@" not in text and "@MESHCAT@" not in text


def test_a_hostile_name_stays_text(skier: Trajectory) -> None:
    name = '</title><script>alert("&")</script>@BLOCKS@'
    text = page(of_state(build(Scene.from_dict({**SKIER, "name": name})), (skier.q[0], skier.v[0])))
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert(&quot;&amp;&quot;)&lt;/script&gt;" in text


@pytest.mark.parametrize(("name", "megabytes"), [("one_link", 10.0), ("skier_whole_body", 20.0)])
def test_a_minute_exports_small_and_complete(name: str, megabytes: float, tmp_path: Path) -> None:
    minute = longer(simulate(load_scene(MODELS / f"{name}.toml")), 60.0)
    written = export_html(minute, tmp_path / "minute.html", fps=60.0)
    assert written.stat().st_size < 1e6 * megabytes
    tracks = tracks_of(written.read_text("utf-8"))
    times, _ = tracks[f"/vlmb/links/{minute.scene.links[-1].name}", ".quaternion"]
    assert len(times) == 3601
    thinned = [len(times) for times, _ in tracks.values()]
    assert min(thinned) > 1  # what stands still has no track at all


# in a browser ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def skier_page(skier: Trajectory, tmp_path_factory: pytest.TempPathFactory) -> str:
    return export_html(skier, tmp_path_factory.mktemp("page") / "a skier.html", arrows=True).as_uri()


def pixels_of(data: bytes) -> np.ndarray[Any, Any]:
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), dtype=int)


def test_the_page_loads_without_complaints(browser: Browser, skier_page: str) -> None:
    browser.open(skier_page)
    seen, until = {browser.run("time")}, time.monotonic() + 30.0
    while len(seen) < 3 and time.monotonic() < until:
        seen.add(browser.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(time))))"))
    assert len(seen) == 3  # it plays
    assert browser.complaints() == []
    assert [url for url in browser.requests() if not url.startswith(("file:", "data:"))] == []
    assert browser.run("document.title") == "skier"


@pytest.mark.parametrize("name", ["skier", "tree"])
def test_the_browser_draws_segments_as_long_as_simulated(
    browser: Browser, name: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    run: Trajectory = request.getfixturevalue(name)
    browser.open(export_html(run, tmp_path / "run.html").as_uri())
    paths = {
        "skier": {"legs/lower": "xi1_1", "legs/rod/upper": "xi1_2"},
        "tree": {"trunk/rod/upper": "xi1_2", "left/lower": "xi2_1"},
    }
    turn = of_trajectory(run).turn
    drawn = []
    for when in TIMES:
        browser.run(f"vlmb.seek({when})")
        for path, coordinate in paths[name].items():
            drawn.append(browser.run(f"vlmb.length('links/{path}')"))
            assert drawn[-1] == pytest.approx(at(run, coordinate, when), abs=1e-4)
        for link in run.scene.links:
            place = [np.interp(when, run.t, run.position(link.name, "rod_start")[:, axis]) for axis in range(3)]
            np.testing.assert_allclose(browser.run(f"vlmb.place('links/{link.name}/rod')"), turn @ place, atol=2e-3)
    assert len({round(length, 3) for length in drawn}) > 3  # they do stretch
    assert browser.complaints() == []


def test_the_browser_shows_the_link_the_ski_and_the_track(browser: Browser, skier_page: str) -> None:
    browser.open(skier_page)
    browser.run("vlmb.seek(0.3)")
    full = pixels_of(browser.picture())
    assert full.std() > 5.0
    for path in ("links/legs/rod", "links/legs/lower", "links/legs/rod/mass", "ski", "track", "ground", "gravity"):
        browser.run(f"node('{path}/<object>').object.visible = false; viewer.render()")
        changed = np.abs(pixels_of(browser.picture()) - full).max(axis=2) > 8
        assert changed.sum() > 60, path
        browser.run(f"node('{path}/<object>').object.visible = true; viewer.render()")
    browser.run("vlmb.seek(0.0)")
    assert browser.run("growing[0].drawRange.count") == 0
    browser.run("vlmb.seek(0.5)")
    assert browser.run("growing[0].drawRange.count") == browser.run("whole[0]")


def test_the_browser_shows_the_course(browser: Browser, tmp_path: Path) -> None:
    run = simulate(Scene.from_dict(follows("tan(phi0) = A*k*cos(k*x)")))
    browser.open(export_html(run, tmp_path / "course.html").as_uri())
    browser.run("vlmb.seek(2.0)")
    shown = pixels_of(browser.picture())
    browser.run("node('programme/<object>').object.visible = false; viewer.render()")
    changed = np.abs(pixels_of(browser.picture()) - shown).max(axis=2) > 8
    green = shown[changed].mean(axis=0)
    assert changed.sum() > 200 and green[1] > green[0] + 40
    assert browser.complaints() == []


def test_the_page_plays_pauses_scrubs_and_changes_speed(browser: Browser, skier_page: str) -> None:
    browser.open(skier_page + "#t=0.2")
    assert browser.run("[playing, time]") == [False, pytest.approx(0.2)]
    browser.run("bar('time').value = 0.4; bar('time').oninput({target: bar('time')})")
    assert browser.run("[playing, time]") == [False, pytest.approx(0.4)]
    browser.run("bar('speed').value = '0.25'; bar('speed').onchange({target: bar('speed')}); vlmb.seek(0); bar('play').onclick()")
    assert browser.run("[playing, speed]") == [True, 0.25]
    browser.run("bar('play').onclick()")
    assert browser.run("playing") is False
    assert browser.complaints() == []


def test_a_start_posture_has_views_and_no_slider(browser: Browser, tmp_path: Path) -> None:
    browser.open(export_html(build(Scene.from_dict(SKIER)), tmp_path / "start.html").as_uri())
    assert browser.run("[bar('motion').hidden, bar('more').hidden, bar('views').hidden]") == [True, True, False]
    assert browser.run("vlmb.length('links/legs/lower')") == pytest.approx(0.25, abs=1e-6)
    assert browser.complaints() == []


def test_a_drag_never_takes_the_camera_under_the_snow(browser: Browser, skier_page: str) -> None:
    browser.open(skier_page + "#t=0.2")
    middle = browser.run("[pane.clientWidth / 2, pane.clientHeight / 2]")
    drags = ((-40, 0, "left"), (-700, 30, "left"), (500, 0, "left"), (-900, -300, "left"), (-400, 0, "right"))
    for down, across, button in drags:
        start = {"x": middle[0], "y": middle[1], "button": button, "clickCount": 1}
        was = browser.run("camera.position.toArray()")
        browser.call("Input.dispatchMouseEvent", type="mousePressed", **start)
        for k in range(1, 6):
            place = {"x": middle[0] + k * across / 5, "y": middle[1] + k * down / 5}
            browser.call("Input.dispatchMouseEvent", type="mouseMoved", button=button, buttons=1 + (button == "right"), **place)
            assert browser.run("vlmb.height()") > 0.01
        browser.call("Input.dispatchMouseEvent", type="mouseReleased", x=middle[0] + across, y=middle[1] + down, button=button)
        assert browser.run("camera.position.toArray()") != was  # it did turn
    browser.run("vlmb.seek(0.5)")
    assert browser.run("vlmb.height()") > 0.01
    assert browser.complaints() == []


def test_buttons_turn_the_view_and_reset_it(browser: Browser, skier_page: str, skier: Trajectory) -> None:
    browser.open(skier_page + "#t=0.25")
    turned = "camera.position.clone().sub(controls.target).normalize()"
    first = browser.run(f"{turned}.toArray()")
    heading = at(skier, "phi0", 0.25)
    forwards = of_trajectory(skier).turn @ [np.cos(heading), np.sin(heading), 0.0]
    up = of_trajectory(skier).turn @ [0.0, 0.0, 1.0]
    found = {}
    for name in ("side", "front", "top"):
        browser.run(f"bar('{name}').click()")
        x, y, z = browser.run(f"{turned}.toArray()")
        found[name] = np.array([x, -z, y])
    assert found["front"] @ forwards > 0.98 and found["top"] @ up > 0.999
    assert found["side"] @ np.cross(forwards, up) > 0.98 and abs(found["side"] @ forwards) < 1e-3
    browser.run("bar('reset').click()")
    np.testing.assert_allclose(browser.run(f"{turned}.toArray()"), first, atol=1e-6)
    browser.run("bar('follow').click(); controls.target.set(0, 0, 0); vlmb.seek(0.1)")
    assert browser.run("controls.target.toArray()") == [0, 0, 0]  # it does not follow any more
    assert browser.complaints() == []


def test_a_page_opens_at_a_time_and_goes_to_another(browser: Browser, skier_page: str) -> None:
    browser.open(skier_page + "#t=0.4")
    assert browser.run("[playing, time]") == [False, pytest.approx(0.4)]
    moved = "new Promise(done => { addEventListener('hashchange', () => setTimeout(() => done([time, view]))); location.hash = "
    assert browser.run(moved + "'#t=0.1&view=top' })") == [pytest.approx(0.1), "top"]
    assert browser.run(moved + "'#t=nonsense' })") == [pytest.approx(0.1), "top"]
    assert browser.complaints() == []


def test_a_motion_ends_or_starts_again(browser: Browser, skier_page: str) -> None:
    browser.open(skier_page + "#t=0.49")
    waited = "new Promise(done => setTimeout(() => done([playing, time]), 400))"
    browser.run("bar('loop').click(); bar('play').click()")
    assert browser.run(waited) == [False, pytest.approx(0.5)]
    browser.run("bar('speed').value = '4'; bar('speed').onchange({target: bar('speed')})")
    browser.run("bar('loop').click(); bar('play').click()")
    assert browser.run(waited)[0] is True
    assert browser.complaints() == []


@pytest.mark.parametrize(("width", "height"), [(390, 844), (844, 390), (1280, 800)])
def test_controls_fit_phones_and_screens(browser: Browser, skier_page: str, width: int, height: int) -> None:
    browser.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 1000)
    try:
        browser.open(skier_page + "#t=0.2")
        boxes = browser.run(
            "[...document.querySelectorAll('#bar button, #bar input, #bar select, #clock')].map(entry => {"
            " const box = entry.getBoundingClientRect(); return [box.left, box.top, box.right, box.bottom]; })"
        )
        assert len(boxes) == 10
        for left, top, right, bottom in boxes:
            assert left >= 0.0 and top >= 0.0 and right <= width and bottom <= height
            assert bottom - top >= 17.0 and right - left >= 30.0
        slider = boxes[1]
        assert slider[2] - slider[0] > 150.0
        assert browser.run("pane.getBoundingClientRect().bottom <= bar('bar').getBoundingClientRect().top + 1")
        assert browser.run("document.documentElement.scrollWidth") <= width
        drawn = browser.run("viewer.renderer.domElement.clientHeight / pane.clientHeight")
        assert drawn == pytest.approx(1.0, abs=0.02)
        assert browser.complaints() == []
    finally:
        browser.call("Emulation.clearDeviceMetricsOverride")


def test_the_page_is_dark_where_the_system_is(browser: Browser, skier_page: str) -> None:
    browser.open(skier_page + "#t=0.2")
    light = pixels_of(browser.picture())
    try:
        browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])
        browser.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        dark = pixels_of(browser.picture())
    finally:
        browser.call("Emulation.setEmulatedMedia", features=[])
    assert light.mean() > 170.0 and dark.mean() < 90.0
    assert browser.complaints() == []


def test_arrows_stay_above_the_snow(skier: Trajectory, whole: Trajectory) -> None:
    for run in (skier, whole):
        made = of_trajectory(run, arrows=True)
        shown = {body.path: body.shape for body in made.bodies}
        for frame in range(0, len(made.t), 5):
            poses = made.poses(frame)
            for path in ("gravity", "ski/edge_force"):
                shape = shown[path]
                assert isinstance(shape, Mesh)
                corners = shape.vertices @ poses[path][:3, :3].T + poses[path][:3, 3]
                assert corners[:, 2].min() > 0.0, path


# the person --------------------------------------------------------------------------------------------------------


def test_knees_bend_as_legs_of_one_link_get_shorter(skier: Trajectory) -> None:
    made = of_trajectory(skier, fps=1.0 / (skier.t[1] - skier.t[0]))
    shapes_of = {body.path: body.shape for body in made.bodies}
    shank = shapes_of["links/legs/shank"]
    assert isinstance(shank, Mesh)
    length, bends = shank.vertices[:, 0].max(), []
    for frame in range(0, len(made.t), 10):
        poses = made.poses(frame)
        ankle, knee = poses["links/legs/shank"][:3, 3], poses["links/legs/thigh"][:3, 3]
        assert np.linalg.norm(knee - ankle) == pytest.approx(length, rel=1e-6)
        hip, hinge = skier.position("legs", "rod_end")[frame], skier.position("legs", "hinge")[frame]
        along = (hip - hinge) / np.linalg.norm(hip - hinge)
        offset = (knee - hinge) - along * ((knee - hinge) @ along)
        heading = np.array([np.cos(skier["phi0"][frame]), np.sin(skier["phi0"][frame]), 0.0])
        assert offset @ heading > 0.0  # the knee is in front
        bends.append((np.linalg.norm(hip - hinge), np.linalg.norm(offset)))
    bends.sort()
    assert bends[0][1] > bends[-1][1] + 0.01


def test_arms_are_outside_the_trunk_and_at_its_shoulders() -> None:
    run = simulate(MODELS / "skier_with_arms.toml")
    made = of_trajectory(run, fps=20.0)
    shapes_of = {body.path: body.shape for body in made.bodies}
    trunk = shapes_of["links/trunk/rod"]
    assert isinstance(trunk, Mesh)
    half = np.abs(trunk.vertices[:, 1]).max()
    for frame in range(len(made.t)):
        poses = made.poses(frame)
        inside = np.linalg.inv(poses["links/trunk/rod"])
        for name, side in (("left_arm", 1.0), ("right_arm", -1.0)):
            for x in (0.0, 0.3, 0.6):
                place = inside @ poses[f"person/{name}"] @ [x, 0.0, 0.0, 1.0]
                assert side * place[1] > half
        np.testing.assert_allclose(poses["links/left_arm"][:3, 3], poses["links/right_arm"][:3, 3], atol=1e-9)  # the links' own


PERSONS = ["skier_one_link", "skier_two_links", "skier_slalom_whole_body", "skier_paper", "flight", "ski_jump"]


@pytest.mark.parametrize("name", PERSONS)
def test_a_person_has_a_head_arms_and_two_legs(name: str) -> None:
    made = view_module.posture(build(load_scene(MODELS / f"{name}.toml")))
    colours = {body.colour for body in made.bodies}
    assert {appearance.SKIN, appearance.HELMET, appearance.SLEEVES, appearance.TROUSERS, appearance.JACKET} <= colours
    free = [link.name for link in load_scene(MODELS / f"{name}.toml").links if link.lower.motion == "free" and link.lower.length]
    stretched = {body.path for body in made.bodies if body.colour == appearance.STRETCH}
    assert {f"links/{link}/lower" for link in free} <= stretched


# stills ------------------------------------------------------------------------------------------------------------


def test_a_triangle_covers_its_pixels_and_the_nearest_wins() -> None:
    camera = Camera(np.array([0.0, 0.0, 10.0]), np.eye(3))
    canvas = Canvas(camera, 200, 100)
    reach = 10.0 * np.tan(np.radians(20.0))
    half = np.array([[-reach, -reach, 0.0], [reach, -reach, 0.0], [-reach, reach, 0.0]])
    red, blue = np.full((1, 3, 3), [255.0, 0.0, 0.0]), np.full((1, 3, 3), [0.0, 0.0, 255.0])
    canvas.triangles(half[None], red)
    picture_ = canvas.pixels()
    assert (picture_[:, :, 0] == 255).sum() == pytest.approx(5000, rel=0.03)
    assert picture_[80, 60, 0] == 255 and picture_[20, 140, 0] == 0
    canvas.triangles(half[None] - [0.0, 0.0, 1.0], blue)  # behind
    assert tuple(canvas.pixels()[80, 60]) == (255, 0, 0)
    canvas.triangles(half[None] + [0.0, 0.0, 1.0], blue)  # before
    assert tuple(canvas.pixels()[80, 60]) == (0, 0, 255)


def test_a_camera_around_points_sees_them_all_and_no_more() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (200, 3)) * [5.0, 1.0, 1.0]
    camera = Camera.around(points, np.array([-0.6, -1.0, 0.4]), 1.6)
    seen = camera.see(points)
    slope = np.tan(np.radians(20.0))
    share = np.abs(seen[:, :2] / seen[:, 2:] / [1.6 * slope, slope])
    assert share.max() == pytest.approx(1.0 / 1.12, rel=1e-6)


@pytest.mark.parametrize("name", ["skier", "tree"])
def test_a_still_shows_every_link_and_changes_with_time(name: str, request: pytest.FixtureRequest) -> None:
    run: Trajectory = request.getfixturevalue(name)
    first, last = (np.asarray(picture(run, when, size=(320, 200), arrows=True), dtype=int) for when in (0.0, 0.5))
    assert first.shape == (200, 320, 3)
    assert first.std() > 5.0 and np.abs(first - last).max() > 50
    ghosts = np.asarray(picture(run, 0.5, size=(320, 200), ghosts=3, since=0.1), dtype=int)
    assert ghosts.std() > 3.0
    with pytest.raises(vlmb.VlmbError, match=r"time 9 s: the motion lasts from 0 to"):
        picture(run, 9.0)


def test_a_still_of_a_long_chain_and_of_a_lone_ski() -> None:
    chain = {
        "base": {"kind": "pivot"},
        "links": [{"rod": {"length": 0.1, "mass": 0.1}}] * 40,
        "start": {f"psi{i}": 0.5 for i in range(1, 41)},
    }
    for scene in (chain, {"base": {"kind": "ski", "mass": 4.0, "inertia": 0.5}}):
        assert np.asarray(picture(build(Scene.from_dict(scene)), size=(160, 100))).std() > 3.0


def far_from_the_snow(shown: Any) -> np.ndarray[Any, Any]:
    """Rows and columns of strongly coloured pixels: what is neither snow nor sky nor pale."""
    values = np.asarray(shown, dtype=int)
    return np.argwhere(values.max(axis=2) - values.min(axis=2) > 110)


def test_the_camera_of_pictures_stands_where_it_is_told(skier: Trajectory) -> None:
    def width_of(shot: Shot) -> tuple[float, float]:
        found = far_from_the_snow(picture(skier, 0.3, size=(320, 200), shot=shot))
        return float(np.ptp(found[:, 1])), float(np.ptp(found[:, 0]))

    heading = float(np.degrees(at(skier, "phi0", 0.3)))
    side, front = width_of(Shot(side=True, follow=True)), width_of(Shot(azimuth=heading, elevation=8.0, follow=True))
    assert side[0] > 1.5 * front[0]  # the ski is seen along its whole length from the side alone
    np.testing.assert_allclose(width_of(Shot(azimuth=heading - 90.0, elevation=8.0, follow=True)), side, atol=2.0)
    near, far = (width_of(Shot(side=True, follow=True, zoom=zoom)) for zoom in (0.8, 0.4))
    assert near[0] == pytest.approx(2.0 * far[0], rel=0.05)
    refused = {Shot(zoom=0.0): "zoom 0", Shot(elevation=-5.0): "elevation -5 deg", Shot(azimuth=1e3): "azimuth 1000"}
    for wrong, what in refused.items():
        with pytest.raises(vlmb.VlmbError, match=what):
            picture(skier, shot=wrong)


def test_earlier_postures_fill_the_picture() -> None:
    run = simulate(MODELS / "skier_one_link.toml")
    shown = np.asarray(picture(run, size=(480, 300), ghosts=4), dtype=int)
    found = far_from_the_snow(shown)
    assert np.ptp(found[:, 0]) > 0.3 * 300  # the last posture alone is that high
    red = np.argwhere(shown[..., 0] - shown[..., 2] > 25)
    assert np.ptp(red[:, 1]) > 0.7 * 480


def test_a_film_from_where_it_is_told(skier: Trajectory) -> None:
    made = of_trajectory(skier, fps=10.0)
    follows_, stands = (list(movie(made, (160, 100), 10.0, shot=Shot(follow=follow))) for follow in (True, False))
    moved = []
    for pictures in (follows_, stands):
        places = [far_from_the_snow(shown).mean(axis=0) for shown in pictures]
        moved.append(np.ptp([place[1] for place in places]))
    assert len(follows_) == len(stands) == 5 and moved[1] > 2.0 * moved[0]


# the command and the server ----------------------------------------------------------------------------------------


def command(*arguments: str) -> int:
    args = make_parser().parse_args(["view", *arguments])
    return int(args.execute(args))


def test_the_command_writes_files(skier: Trajectory, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stored = str(skier.save(tmp_path / "run.npz"))
    names = {kind: str(tmp_path / f"out.{kind}") for kind in ("html", "png", "gif")}
    assert (
        command(stored, "--html", names["html"], "--png", names["png"], "--time", "0.3", "--ghosts", "2", "--size", "160", "100")
        == 0
    )
    assert capsys.readouterr().out == f"wrote {names['png']}, {names['html']}\n"
    assert ("/vlmb/links/legs/lower", ".scale") in tracks_of(Path(names["html"]).read_text("utf-8"))
    with Image.open(names["png"]) as still:
        assert still.size == (160, 100)
    assert command(stored, "--gif", names["gif"], "--size", "120", "80", "--fps", "10", "--speed", "0.5") == 0
    with Image.open(names["gif"]) as film:
        assert (film.n_frames, film.size, film.info["duration"]) == (10, (120, 80), 100)
    assert command(stored, "--mp4", str(tmp_path / "out.mp4"), "--size", "121", "81", "--fps", "20") == 0
    with av.open(str(tmp_path / "out.mp4")) as film:
        pictures = [np.asarray(frame.to_image(), dtype=int) for frame in film.decode(video=0)]
        assert (film.streams.video[0].average_rate, len(pictures), pictures[0].shape) == (20, 10, (80, 120, 3))
    assert np.abs(pictures[0] - pictures[-1]).max() > 50
    assert command(stored, "--frames", str(tmp_path / "film"), "--size", "120", "80", "--fps", "10") == 0
    assert [path.name for path in sorted((tmp_path / "film").iterdir())] == [f"frame_{k:05d}.png" for k in range(5)]
    assert command(str(MODELS / "skier_one_link.toml"), "--png", names["png"], "--size", "160", "100") == 0
    with Image.open(names["png"]) as still:
        usual = np.asarray(still, dtype=int)
    camera = ["--azimuth", "20", "--elevation", "50", "--zoom", "0.7", "--follow"]
    assert command(str(MODELS / "skier_one_link.toml"), "--png", names["png"], "--size", "160", "100", *camera) == 0
    with Image.open(names["png"]) as still:
        assert np.abs(np.asarray(still, dtype=int) - usual).max() > 50


def test_the_command_explains_what_is_wrong(tmp_path: Path, skier: Trajectory) -> None:
    damaged = tmp_path / "damaged.npz"
    damaged.write_bytes(b"damaged")
    skier.save(tmp_path / "run.npz")
    with pytest.raises(vlmb.VlmbError, match="not a trajectory of vlmb"):
        command(str(damaged), "--html", str(tmp_path / "out.html"))
    with pytest.raises(vlmb.VlmbError, match="no such"):
        command(str(tmp_path / "nothing.toml"))
    with pytest.raises(vlmb.VlmbError, match="--speed 0: must be positive"):
        command(str(tmp_path / "run.npz"), "--speed", "0")
    with pytest.raises(vlmb.VlmbError, match="elevation -3 deg: must be above 0"):
        command(str(tmp_path / "run.npz"), "--elevation", "-3", "--png", str(tmp_path / "out.png"))
    with pytest.raises(vlmb.VlmbError, match=r"a scene shows its start; --time and --ghosts need a stored run"):
        command(str(MODELS / "one_link.toml"), "--png", str(tmp_path / "out.png"), "--time", "1")


def test_a_foreign_file_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], skier: Trajectory) -> None:
    foreign = tmp_path / "foreign.npz"
    np.savez(foreign, weights=np.zeros(3))
    cut = tmp_path / "cut.npz"
    cut.write_bytes(skier.save(tmp_path / "run.npz").read_bytes()[:-2000])
    for path in (foreign, cut):
        for words in (["view", str(path), "--html", str(tmp_path / "out.html")], ["plot", str(path), "-o", str(tmp_path)]):
            assert main(words) == 1
            assert f"{path}: not a trajectory of vlmb" in capsys.readouterr().err
    assert not (tmp_path / "out.html").exists()


def test_run_looks_for_a_display_before_it_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(view_module, "has_display", lambda: False)
    assert main(["run", str(MODELS / "one_link.toml"), "--view", "--quiet"]) == 1
    assert "no display here to open a browser on" in capsys.readouterr().err
    assert not (tmp_path / "results").exists()


def test_run_shows_the_motion_while_and_after_it_is_computed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    seen: dict[str, str] = {}

    def fetch(url: str) -> str:
        with urllib.request.urlopen(url, timeout=20) as answer:
            return str(answer.read().decode())

    def look(url: str) -> bool:
        seen["first"] = fetch(url)
        return True

    def wait(view: View) -> None:
        seen["last"], seen["more"] = fetch(view.url), fetch(view.url + "more?have=0")
        view.close()

    monkeypatch.setattr(view_module, "has_display", lambda: True)
    monkeypatch.setattr("webbrowser.open", look)
    monkeypatch.setattr(View, "wait", wait)
    words = ["run", str(MODELS / "one_link.toml"), "--view", "--quiet", "--no-plots", "--duration", "0.5", "-o", "out"]
    assert main(words) == 0
    assert "(Ctrl-C ends)" in capsys.readouterr().out
    assert '"live": true' in seen["first"] and tracks_of(seen["first"]) == {}  # opened before the run
    assert {".quaternion", ".position", ".scale"} == {kind for _, kind in tracks_of(seen["last"])}
    more = json.loads(seen["more"])
    assert more["info"]["live"] is False and more["info"]["duration"] == pytest.approx(0.5) and more["commands"]


def until(condition: Any, seconds: float = 30.0) -> Any:
    """Wait for something that is true; return it."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end
        time.sleep(0.05)
    return found


def test_a_page_plays_a_motion_that_is_being_computed_at_real_time(browser: Browser) -> None:
    scene = load_scene(MODELS / "skier_one_link.toml")
    pieces: list[Any] = []
    run = simulate(scene, watch=lambda *samples: pieces.append(samples))
    t, q, v = (np.concatenate(part) for part in zip(*pieces, strict=True))
    assert np.array_equal(t, run.t) and np.array_equal(q, run.q) and np.array_equal(v, run.v)
    live = Live(scene, browser=False)
    try:
        live.take(t[:150], q[:150], v[:150])
        browser.open(live.view.url)
        assert browser.run("[info.live, info.whole, bar('motion').hidden]") == [True, 5.0, False]
        known = until(lambda: browser.run("info.duration"))
        assert known < 5.0 and browser.run("info.live")  # the rest is not computed yet
        until(lambda: re.search(r"computed to \d", browser.run("bar('note').textContent")))
        live.take(t[150:250], q[150:250], v[150:250])
        until(lambda: browser.run("info.duration > 2.4"))
        begun, shown = time.monotonic(), browser.run("(show(0), setPlaying(true), time)")
        time.sleep(1.5)
        passed, advanced = time.monotonic() - begun, browser.run("time") - shown
        assert advanced == pytest.approx(passed, rel=0.35)  # at real time
        for path, coordinate in {"legs/lower": "xi1_1", "legs/rod/upper": "xi1_2"}.items():
            browser.run("vlmb.seek(0.4)")
            assert browser.run(f"vlmb.length('links/{path}')") == pytest.approx(at(run, coordinate, 0.4), abs=1e-4)
        live.finish(run)
        until(lambda: browser.run("!info.live"))
        assert browser.run("[info.duration, bar('note').textContent]") == [5.0, ""]
        browser.run("vlmb.seek(4.5)")
        assert browser.run("vlmb.length('links/legs/lower')") == pytest.approx(at(run, "xi1_1", 4.5), abs=1e-4)
        assert browser.run("growing[0].drawRange.count > 0 && shadows.length > 5")
        assert browser.complaints() == []
        assert {url.split("?")[0] for url in browser.requests() if not url.startswith("data:")} <= {
            live.view.url, live.view.url + "more"}  # fmt: skip
    finally:
        live.close()


def test_a_page_says_when_its_run_has_gone(browser: Browser) -> None:
    scene = Scene.from_dict({**SKIER, "run": {"duration": 1.0}})
    live = Live(scene, browser=False)
    simulate(scene, watch=live.take)
    browser.open(live.view.url)
    until(lambda: browser.run("info.duration > 0"))
    live.close()
    until(lambda: browser.run("bar('note').textContent.includes('has gone')"))
    assert browser.run("info.live") is False


def test_the_page_is_served_until_closed(skier: Trajectory) -> None:
    served = show(build(Scene.from_dict(SKIER)), (skier.q[0], skier.v[0]), browser=False)
    with urllib.request.urlopen(served.url, timeout=20) as answer:
        assert answer.read().decode() == served.text
    with pytest.raises(urllib.error.HTTPError) as missing:
        urllib.request.urlopen(served.url + "etc/passwd", timeout=20)
    missing.value.close()
    assert served._repr_html_().startswith("<iframe srcdoc=")
    served.close()
    with pytest.raises(OSError, match=r"refused|reset"):
        urllib.request.urlopen(served.url, timeout=20)


def test_a_busy_port_is_explained() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(vlmb.VlmbError, match=f"port {port} is in use by another program: choose another"):
            View("", port)
    with pytest.raises(vlmb.VlmbError, match="port 99999 cannot be opened"):
        View("", 99999)


def test_no_display_is_explained(monkeypatch: pytest.MonkeyPatch, skier: Trajectory) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    assert not has_display()
    with pytest.raises(vlmb.VlmbError, match=r"no display here to open a browser on: write a file .*--html"):
        show(skier.mechanism, (skier.q[0], skier.v[0]), browser=True)
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("webbrowser.open", lambda url: False)
    with pytest.raises(vlmb.VlmbError, match="no browser could be opened"):
        show(skier.mechanism, (skier.q[0], skier.v[0]), browser=True)


def test_missing_packages_are_explained(skier: Trajectory, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "umsgpack", None)
    with pytest.raises(vlmb.VlmbError, match=r"the 3D view needs meshcat.*pip install vlmb\[view\]"):
        export_html(skier, tmp_path / "out.html")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(vlmb.VlmbError, match=r"the 3D view needs meshcat.*pip install vlmb\[view\]"):
        export_html(skier, tmp_path / "out.html")
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(vlmb.VlmbError, match=r"stills need pillow.*pip install vlmb\[view\]"):
        picture(skier, size=(40, 30))
    for what in (skier, skier.mechanism):  # in a notebook the table does without a picture
        assert "<img" not in what._repr_html_() and "<td>xi1_1</td>" in what._repr_html_()


def test_a_film_without_its_encoder_is_explained(skier: Trajectory, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(vlmb.VlmbError, match=r"an MP4 needs PyAV.*pip install vlmb\[film\]; a GIF does without"):
        command(str(skier.save(tmp_path / "run.npz")), "--mp4", str(tmp_path / "out.mp4"))
    assert not (tmp_path / "out.mp4").exists()


def cells(shown: str) -> list[list[str]]:
    """Read the table of a card back."""
    return [re.findall(r"<td>([^<]*)</td>", row) for row in re.findall(r"<tr>(.*?)</tr>", shown)][1:]


def test_notebooks_show_a_trajectory(skier: Trajectory) -> None:
    shown = skier._repr_html_()
    with Image.open(io.BytesIO(base64.b64decode(re.findall(r'base64,([^"]*)"', shown)[0]))) as shown_picture:
        assert shown_picture.size == (480, 300)
        assert np.asarray(shown_picture).std() > 5.0
    assert "energy balance" in shown
    rows = {row[0]: row for row in cells(shown)}
    assert tuple(rows) == skier.mechanism.coordinate_names
    values = skier["xi1_1"]
    assert rows["xi1_1"][1:3] == ["legs.lower", "m"]
    found = [float(number) for number in rows["xi1_1"][3:]]
    np.testing.assert_allclose(found, [values[0], values.min(), values.max(), values[-1]], rtol=1e-3)
    shown = f"<Trajectory of 'skier': {len(skier)} samples, finished at t = 0.5 s; x y phi0 phi1 psi1 xi1_1 xi1_2; reactions "
    assert repr(skier).startswith(shown)


def test_notebooks_show_a_mechanism(skier: Trajectory) -> None:
    shown = skier.mechanism._repr_html_()
    assert '<img alt="skier" src="data:image/png;base64,' in shown
    assert ["phi0", "heading", "rad", "0.4"] in cells(shown)
    assert repr(skier.mechanism) == "<Mechanism of 'skier': ski base; x y phi0 phi1 psi1 xi1_1 xi1_2>"
    strange = build(Scene.from_dict({**SKIER, "name": "<b>&"}))
    assert "<b>" not in card(strange, 60)
    body = build(load_scene(MODELS / "skier_whole_body.toml"))
    assert "<summary>27 coordinates</summary>" in card(body, 60)
    impossible = build(Scene.from_dict({**SKIER, "constraints": ["legs.length = 0.1", "legs.length = 2"]}))
    shown = card(impossible, 60)
    assert "no start  " in shown and "<img" not in shown and ["phi0", "heading", "rad", ""] in cells(shown)


def test_heavy_packages_are_imported_only_when_needed() -> None:
    code = "import sys, vlmb\n"
    code += "assert not {'vlmb.views.view', 'vlmb.views.plots', 'vlmb.views.notebook', 'sympy'} & set(sys.modules)\n"
    code += "vlmb.view.show, vlmb.plots.path\n"
    code += "assert not {'matplotlib', 'meshcat', 'PIL', 'umsgpack', 'tornado', 'av'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
    assert {"view", "plots"} <= set(dir(vlmb))
    with pytest.raises(AttributeError, match="module 'vlmb' has no attribute 'veiw'"):
        vlmb.veiw()


def test_a_run_that_fails_at_once_is_shown() -> None:
    failed = simulate(load_scene(MODELS / "straight_legs.toml"))
    assert failed.status == "failed"
    shown = failed._repr_html_()
    assert "<img" in shown and "the mass matrix is singular" in shown and cells(shown)


def test_one_sample_is_a_posture(skier: Trajectory) -> None:
    one = simulate(Scene.from_dict(SKIER), t_eval=[0.0])
    made = of_trajectory(one)
    assert isinstance(made, Scenery) and len(made.t) == 1
    assert tracks_of(page(made)) == {}


def test_phases_are_seen_in_the_scenery() -> None:
    run = simulate(MODELS / "slip_walker.toml", duration=0.7)
    made = of_trajectory(run, 30.0, arrows=True)
    drawn = {body.path: body for body in made.bodies}
    assert {"legs/left/spring", "legs/right/foot", "forces/left", "footprints/0", "footprints/2"} <= set(drawn)
    assert [words for _, words in made.events] == ["right touches", "left opens", "left touches"]
    for k, t in enumerate(made.t.tolist()):
        foot = made.poses(k)["legs/left/foot"][:3, 3]
        stands = t < run.events[1].t or t >= run.events[2].t
        if stands:
            assert foot == pytest.approx([run["left.foot.x"][0 if t < run.events[1].t else -1], 0.0, 0.0], abs=1e-9)
        else:
            assert foot[2] > -1e-6
        arrow = made.poses(k)["forces/left"]
        push = np.array([np.interp(t, run.t, run.reactions["left"][:, axis]) for axis in (0, 2)])
        along = arrow[[0, 2], 0] / np.linalg.norm(arrow[[0, 2], 0])
        if stands and np.linalg.norm(push) > 50.0:
            assert along == pytest.approx(push / np.linalg.norm(push), abs=0.02)
    scale = drawn["footprints/1"].scale[:, 0]
    assert scale[made.t < run.events[0].t].max() < 1e-3 and scale[made.t > run.events[0].t].min() == 1.0
    hit = of_trajectory(simulate(MODELS / "compass_gait.toml", duration=0.9), 60.0, arrows=True)
    impulse = next(body for body in hit.bodies if body.path == "impulses/r")
    seen = hit.t[impulse.scale[:, 0] > 0.1]
    assert 0.73 < seen.min() < 0.76 and seen.max() < 0.734346 + 0.16 and hit.events[0][1].startswith("r touches, ")
