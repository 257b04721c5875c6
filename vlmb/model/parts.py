"""What a mechanism is made of: joints, bodies and points as plain data, and a Pinocchio model of them.

The model is a matter of its own because the core runs without it: a scene whose numbers change needs the parts alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

Place = tuple[float, float, float]
ORIGIN: Place = (0.0, 0.0, 0.0)
JOINTS: dict[str, tuple[Callable[[], Any], int, int]] = {  # how Pinocchio makes one; numbers in q and v
    "planar": (pin.JointModelPlanar, 4, 3), "translation": (pin.JointModelTranslation, 3, 3), "x": (pin.JointModelPX, 1, 1),
    "z": (pin.JointModelPZ, 1, 1), "ball": (pin.JointModelSpherical, 4, 3),
    "hinge": (lambda: pin.JointModelRevoluteUnaligned(0.0, -1.0, 0.0), 1, 1),
}  # fmt: skip


class Joint(NamedTuple):
    """A joint at a place [m] in its parent joint's frame; kind as in JOINTS."""

    parent: int
    kind: str
    at: Place
    name: str


class Body(NamedTuple):
    """A mass [kg] with its centre [m] and diagonal inertia [kg m^2], at a place [m] in a joint's frame."""

    joint: int
    mass: float
    centre: Place
    inertia: Place
    at: Place


class Point(NamedTuple):
    """A named place [m] in a joint's frame."""

    name: str
    joint: int
    at: Place


Part = Joint | Body | Point


def make_model(name: str, gravity: Place, parts: Iterable[Part]) -> Any:
    """Make the pinocchio.Model of joints, bodies and points, in gravity [m/s^2]."""
    model = pin.Model()
    model.name = name
    model.gravity.linear = np.array(gravity)
    for part in parts:
        at = pin.SE3(np.eye(3), np.array(part.at))
        if isinstance(part, Joint):
            model.addJoint(part.parent, JOINTS[part.kind][0](), at, part.name)
        elif isinstance(part, Body):
            model.appendBodyToJoint(part.joint, pin.Inertia(part.mass, np.array(part.centre), np.diag(part.inertia)), at)
        else:
            model.addFrame(pin.Frame(part.name, part.joint, 0, at, pin.FrameType.OP_FRAME), False)
    return model
