"""Following a path and not only its heading: what a ski is off it decays as exp(-c (x - x0)), or over the way travelled."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import vlmb

MODELS = Path(__file__).resolve().parents[2] / "models"
SLALOMS = ("skier_slalom", "skier_slalom_two_links", "skier_slalom_whole_body")


def off_course(run: vlmb.Trajectory) -> np.ndarray:
    """How far left of y = A sin(k x) the ski is, along y [m]."""
    of = run.scene.parameters
    return np.asarray(run["y"] - of["A"] * np.sin(of["k"] * run["x"]))


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
@pytest.mark.parametrize("name", SLALOMS)
def test_the_slaloms_come_back_to_their_course(name: str, engine: str) -> None:
    """A start off the course with the heading that the row asks for: e = e0 exp(-c (x - x0)) exactly."""
    if engine == "pinocchio" and name != "skier_slalom":
        pytest.skip("one is enough")
    made = vlmb.load_scene(MODELS / f"{name}.toml")
    of = made.parameters
    heading = math.atan(of["A"] * of["k"] - of["c"] * 0.2)
    run = vlmb.simulate(made.changed_at({"start.y": 0.2, "start.phi0": heading}), 4.0, rtol=1e-11, atol=1e-12, engine=engine)
    assert run.status == "finished", run.message
    z, rate = run.residuals["course"]
    assert np.abs(z).max() < 1e-9 and np.abs(rate).max() < 1e-8
    np.testing.assert_allclose(off_course(run), 0.2 * np.exp(-of["c"] * (run["x"] - run["x"][0])), rtol=0, atol=1e-9)
    assert abs(off_course(run)[-1]) < 0.01 < off_course(run)[0]


def test_the_error_of_a_wrong_heading_decays_too() -> None:
    run = vlmb.simulate(MODELS / "skier_slalom.toml")
    off, way = np.abs(off_course(run)), run["x"]
    assert off.max() > 0.02
    late = way > 20.0
    np.testing.assert_array_less(off[late], off.max() * np.exp(-0.19 * (way[late] - 10.0)))


def test_a_heading_alone_never_comes_back() -> None:
    changes = {"parameters.c": 0.0, "start.phi0": math.atan(0.36), "start.y": 0.2}
    made = vlmb.load_scene(MODELS / "skier_slalom.toml").changed_at(changes)
    run = vlmb.simulate(made, 4.0, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(off_course(run), 0.2, rtol=0, atol=1e-9)


@pytest.mark.parametrize("inside", [2.0, -1.5])
def test_the_distance_from_a_circle_decays_along_the_way(inside: float) -> None:
    """sin(phi0 - theta) = -c d with d = R - r, left of a circle ridden counter-clockwise: d = d0 exp(-c s), s = v t."""
    radius, c, speed = 12.0, 0.3, 5.0
    at = radius - inside
    heading = math.pi / 2 + math.asin(-c * inside)
    scene = {
        "base": {"kind": "ski", "mass": 10.0, "inertia": 1.0}, "parameters": {"R": radius, "c": c},
        "programme": {
            "constraints": ["circle: -(x*cos(phi0) + y*sin(phi0))/sqrt(x**2 + y**2) = -c*(R - sqrt(x**2 + y**2))"],
            "controls": ["M_phi0"], "frequency": 6.0,
        },
        "start": {"x": at, "y": 0.0, "phi0": heading, "speed": speed},
    }  # fmt: skip
    run = vlmb.simulate(scene, 20.0, rtol=1e-11, atol=1e-12)
    assert run.status == "finished", run.message
    np.testing.assert_allclose(run["speed"], speed, rtol=1e-9)
    left = radius - np.hypot(run["x"], run["y"])
    np.testing.assert_allclose(left, inside * np.exp(-c * speed * run.t), rtol=0, atol=1e-8)
    assert np.unwrap(np.arctan2(run["y"], run["x"]))[-1] > 2 * math.pi
