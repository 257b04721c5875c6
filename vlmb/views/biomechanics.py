"""Published joint strengths, and what the joints of a rider have to give: moments about the ski's lateral axis.

A link's name says which joint its hinge is (`JOINTS`). A leg that is one link of variable length has no knee; the force F
along it stands for the knee moment F d, d being the distance of the knee from the line between hip and ankle.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.simulation.trajectory import Trajectory

Array = NDArray[np.float64]


class Strength(NamedTuple):
    """Largest voluntary isometric moment of a joint of one leg over body weight times height, mean and standard deviation."""

    way: str  # what it does
    sign: float  # +1 turns the body above the joint forwards
    mean: float
    deviation: float


# D. E. Anderson, M. L. Madigan, M. A. Nussbaum, J. Biomechanics 40 (2007) 3105-3113, table 3, C1, men of 18 to 25 years
STRENGTHS = {
    "ankle": (Strength("plantar flexion", -1.0, 0.095, 0.022), Strength("dorsiflexion", 1.0, 0.033, 0.005)),
    "knee": (Strength("extension", 1.0, 0.163, 0.040), Strength("flexion", -1.0, 0.087, 0.015)),
    "hip": (Strength("extension", -1.0, 0.161, 0.049), Strength("flexion", 1.0, 0.113, 0.025)),
}
JOINTS = {"legs": "ankle", "shin": "ankle", "thigh": "knee", "trunk": "hip", "lower_trunk": "hip"}  # at the link's hinge
BODY_WEIGHT, BODY_HEIGHT = 73.0 * 9.81, 1.741  # [N], [m]: de Leva's (1996) man, whose body the shipped skiers have
THIGH, SHANK = 0.4222, 0.4403  # [m], the same
LEGS = 2


def both_legs(strength: Strength) -> tuple[float, float]:
    """Mean and standard deviation [N m] of a strength, both legs together, with the sign of its way."""
    unit = strength.sign * LEGS * BODY_WEIGHT * BODY_HEIGHT
    return unit * strength.mean, abs(unit) * strength.deviation


def joint_moments(run: Trajectory) -> dict[str, tuple[Array, Array]]:
    """Moments (N,) [N m] of both legs at each joint of a skier: forwards about the ski's left, and to its right.

    The first is what muscles of flexion and extension give. Joints that no link of the scene stands for are left out.
    """
    found: dict[str, tuple[Array, Array]] = {}
    if not run.mechanism.layout.on_snow:
        return found
    cosine, sine = np.cos(run["phi0"]), np.sin(run["phi0"])
    for link in run.scene.links:
        if link.name in JOINTS:
            torque = run.hinge_torque(link.name)
            forwards = cosine * torque[:, 1] - sine * torque[:, 0]
            right = cosine * torque[:, 0] + sine * torque[:, 1]
            found[JOINTS[link.name]] = forwards, right
    names = [link.name for link in run.scene.links]
    if "legs" in names and "knee" not in found:
        i = names.index("legs")
        force = f"F{i + 1}_1"
        if force in run.controls:
            length = run[f"xi{i + 1}_1"] + run.scene.links[i].rod.length
            found["knee"] = run.controls[force] * knee_distance(length), np.zeros(len(run))
    return {joint: found[joint] for joint in STRENGTHS if joint in found}


def knee_distance(length: Array) -> Array:
    """Distance (N,) [m] of the knee from the line between hip and ankle, `length` (N,) [m] apart; 0 for a straight leg."""
    reach = np.clip(length, abs(THIGH - SHANK), THIGH + SHANK)
    half = (THIGH + SHANK + reach) / 2.0  # Heron's formula
    area = np.sqrt(np.maximum(half * (half - THIGH) * (half - SHANK) * (half - reach), 0.0))
    return np.asarray(2.0 * area / reach)
