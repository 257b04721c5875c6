"""Scenes of links alone pay nothing for robots: what robots need is not even imported."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CODE = """
import sys, vlmb
trajectory = vlmb.simulate("models/one_link.toml", duration=0.1)
vlmb.check("models/one_link.toml"), trajectory.summary(), list(trajectory.columns())
print(*sorted(name for name in sys.modules if name.startswith("vlmb") and "robot" in name))
print(*sorted(name for name in ("vlmb.core.driven", "vlmb.core.frame_rows", "vlmb.core.bodies") if name in sys.modules))
"""


def test_a_scene_of_links_imports_nothing_of_robots() -> None:
    done = subprocess.run([sys.executable, "-c", CODE], cwd=ROOT, capture_output=True, text=True, check=True)
    modules, kernels = done.stdout.splitlines()
    assert modules == "vlmb.scene.robots"  # the checks of their tables
    assert kernels == ""
