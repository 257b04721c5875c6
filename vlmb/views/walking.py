"""Legs that hang from hips: thigh, knee in front, shank and a shoe at the tip, which stands flat."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from vlmb.model.reading import Postures
from vlmb.views import shapes
from vlmb.views.shapes import Mesh

Array = NDArray[np.float64]

ANKLE, HEEL, TOES = 0.09, 0.17, 0.09  # [m] of a body of scale 1: the ankle over the sole, what is behind and ahead of the tip
APART = 0.085  # half of what lies between two legs of a body in a plane


def hangs(seen: Postures, i: int) -> bool:
    """Whether a leg hangs from its hinge."""
    return float(np.mean(seen.directions[:, i, 2])) < 0.0


def aside(name: str, plane: bool) -> float:
    """Return the side [m] of a body of scale 1 on which a leg is drawn that a plane scene has in its middle."""
    if not plane or not re.search(r"left|right", name, re.IGNORECASE):
        return 0.0
    return APART if re.search("left", name, re.IGNORECASE) else -APART


def whole(reach: Array) -> float:
    """Return the length [m] of the stretched leg: that which the hip is seldom farther from the ankle than."""
    return 1.005 * float(np.quantile(reach, 0.9))


def bent(reach: Array, whole: float, share: float) -> tuple[float, float, Array, Array, Array]:
    """Return lengths of thigh and shank, the knee (N, 3), and the directions (N, 3) of both, in frames with x to the ankle.

    reach : (N,) [m] from hip to ankle; whole: of the stretched leg; share: of the thigh. The knee is ahead, along z.
    """
    thigh, shank = share * whole, (1.0 - share) * whole
    reach = np.clip(reach, 1.02 * abs(thigh - shank) + 1e-6, 0.9999 * whole)
    cosine = np.clip((thigh**2 + reach**2 - shank**2) / (2.0 * thigh * reach), -1.0, 1.0)
    sine, zero = np.sqrt(1.0 - cosine**2), np.zeros(len(reach))
    upper = np.stack([cosine, zero, sine], axis=1)
    knee = thigh * upper
    lower = (np.stack([reach, zero, zero], axis=1) - knee) / shank
    return thigh, shank, knee, upper, lower


def shoe(b: float) -> Mesh:
    """Return a shoe about the point that it stands on."""
    return shapes.moved(shapes.boot((HEEL + TOES) * b, 0.07 * b, 0.045 * b), (-HEEL * b, 0.0, 0.0))
