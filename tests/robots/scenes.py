"""Scenes with robots, and random states of them."""

from __future__ import annotations

from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from vlmb.model.building import build
from vlmb.model.robot_mechanism import RobotMechanism

DATA = Path(str(distribution("example-robot-data").locate_file("cmeel.prefix/share/example-robot-data/robots")))
UR5, TALOS = "ur_description/urdf/ur5_robot.urdf", "talos_data/robots/talos_reduced.urdf"
BENT = {"shoulder_lift_joint": -1.0, "elbow_joint": 1.2, "wrist_1_joint": 0.4, "wrist_2_joint": 0.7}


def arm(**changes: Any) -> dict[str, Any]:
    """A UR5 on the ground."""
    robot = {"name": "arm", "urdf": UR5, "posture": BENT, **changes.pop("robot", {})}
    return {"name": "arm", "base": {"kind": "pivot"}, "robots": [robot], "run": {"duration": 0.5, "rtol": 1e-9}, **changes}


def rider(**changes: Any) -> dict[str, Any]:
    """Talos with both feet welded to a ski."""
    robot = {
        "name": "talos", "urdf": TALOS, "attach": {"to": "ski", "root": "free"}, "posture": "half_sitting",
        "aliases": {"left_foot": "left_sole_link", "right_foot": "right_sole_link"},
    }  # fmt: skip
    return {
        "name": "rider", "base": {"kind": "ski", "mass": 5.0, "inertia": 0.6}, "robots": [robot],
        "welds": [{"frames": ["talos.left_foot", "ski"]}, {"frames": ["talos.right_foot", "ski"]}],
        "run": {"duration": 0.5, "rtol": 1e-9}, **changes,
    }  # fmt: skip


def everything() -> dict[str, Any]:
    """Talos on a ski with a chain of two variable-length links on a foot."""
    scene = rider(welds=[])
    leg = {"name": "leg", "parent": "talos.left_foot", "rod": {"length": 0.5, "mass": 2.0}, "lower": {"length": 0.2}}
    shank = {"name": "shank", "rod": {"length": 0.3, "mass": 1.0}, "upper": {"length": 0.1}, "tip_mass": 0.5}
    return {**scene, "links": [leg, shank]}


def random_state(mechanism: RobotMechanism, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A state anywhere, quaternions of length 1."""
    model = mechanism.model
    q = pin.integrate(model, mechanism.robots.reference, rng.uniform(-1.0, 1.0, model.nv))
    return q, rng.uniform(-1.0, 1.0, model.nv)


def built(scene: dict[str, Any]) -> RobotMechanism:
    mechanism = build(scene)
    assert isinstance(mechanism, RobotMechanism)
    return mechanism
