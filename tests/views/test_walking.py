"""Legs that hang from hips look like legs: thighs and shanks that meet in front, shoes flat where the feet stand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import vlmb
from vlmb.views.shapes import Mesh
from vlmb.views.visual_model import of_trajectory

WALKER = Path(__file__).resolve().parents[2] / "models" / "figure_walker.toml"


def test_a_walker_has_knees_in_front_and_shoes_on_the_ground() -> None:
    run = vlmb.simulate(WALKER, duration=2.2, rtol=1e-6)
    made = of_trajectory(run, fps=20.0)
    paths = {body.path: body for body in made.bodies}
    assert "base" not in paths and {"links/trunk/rod/pelvis", "links/trunk/rod/mass"} <= set(paths)
    for side, aside in (("left", 1.0), ("right", -1.0)):
        thigh = paths[f"links/{side}_leg/thigh"].shape
        shank = paths[f"links/{side}_leg/shank"].shape
        assert isinstance(thigh, Mesh) and isinstance(shank, Mesh)
        for frame, t in enumerate(made.t):
            poses, at = made.poses(frame), {name: np.interp(t, run.t, run[name]) for name in ("x", "z")}
            hip, knee = (poses[f"links/{side}_leg/{part}"] for part in ("thigh", "shank"))
            shoe = poses[f"person/{side}_leg/shoe"]
            assert hip[:3, 3] == pytest.approx([at["x"], hip[1, 3], at["z"]], abs=5e-3) and aside * hip[1, 3] > 0.05
            assert np.linalg.norm(knee[:3, 3] - hip[:3, 3]) == pytest.approx(0.5 * 0.9, abs=0.1)
            ankle = knee[:3, 3] + knee[:3, 0] * np.linalg.norm(knee[:3, 3] - hip[:3, 3]) * 0.4403 / 0.4222
            foot = [float(np.interp(t, run.t, run[f"{side}_leg.tip.{axis}"])) for axis in "xz"]
            assert shoe[[0, 2], 3] == pytest.approx(foot, abs=5e-3) and shoe[:3, 2] == pytest.approx([0.0, 0.0, 1.0])
            assert np.linalg.norm((ankle - shoe[:3, 3])[[0, 2]]) < 0.2
            line = np.array(foot) - hip[[0, 2], 3]
            offset = knee[[0, 2], 3] - hip[[0, 2], 3]
            assert offset[0] - line[0] * (offset @ line) / (line @ line) > -1e-6  # in front of the line from hip to foot
