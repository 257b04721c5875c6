"""The recursive route: one articulated-body pass an evaluation, for spring-dampers and the reduced knife edge."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.constrained import SIDEWAYS
from vlmb.faults import HUGE, Faults
from vlmb.integrate import Rhs
from vlmb.mechanism import Mechanism
from vlmb.springs import SegmentSprings

Array = NDArray[np.float64]

HEAVY = 1e30  # [kg] inertia at which the ski's sideways acceleration is zero, its effect on the others below rounding


def recursive(
    mechanism: Mechanism, springs: SegmentSprings, sliding: bool, size: int, calls: list[int], faults: Faults
) -> Rhs:
    """Make the right-hand side of y = (q, v, work): ABA in LOCAL convention on tau = springs.

    `sliding`: the sideways velocity of the ski stays zero. Its joint then carries an inertia of HEAVY, which takes its row and
    column out of the elimination, in a model of its own.
    """
    model, data = _sliding_model(mechanism) if sliding else (mechanism.model, mechanism.data)
    nq, end = model.nq, model.nq + model.nv
    aba, normalize, product = pin.aba, pin.normalize, pin.tangentMapProduct
    sideways = nq + SIDEWAYS
    write, damped, dissipation, hypot = springs.write, bool(springs.dampers), springs.dissipation, math.hypot
    tau, dy = np.zeros(model.nv), np.zeros(size)
    qdot, vdot, last, roots = dy[:nq], dy[nq:end], model.nv - 1, _roots(mechanism)
    planar = nq == model.nv  # no quaternions, and rates are velocities

    def rhs(t: float, y: Array) -> Array:
        calls[0] += 1
        raw, v = y[:nq], y[nq:end]
        write(y, tau)
        found = aba(model, data, raw if planar else normalize(model, raw), v, tau)
        vdot[...] = found
        total = found.item(last)
        for k in roots:
            total += found.item(k)
        if not -HUGE < total < HUGE:
            raise faults.not_finite(normalize(model, raw), v, tau)
        qdot[...] = v if planar else product(model, raw, v)
        if sliding:  # along the heading alone; the map would bring the norm of (cos, sin) along
            cosine, sine = y.item(2), y.item(3)
            rate = y.item(nq) / hypot(cosine, sine)
            dy[0], dy[1], dy[sideways] = cosine * rate, sine * rate, 0.0
        if damped:
            dy[-1] = dissipation(y)
        return dy

    return rhs


def _roots(mechanism: Mechanism) -> tuple[int, ...]:
    """First velocity of every tree: with the last of all they tell of the others, to which what is not finite spreads."""
    layout = mechanism.layout
    return (0,) if layout.base_size else tuple(link.v for link in layout.links if link.parent < 0)


def _sliding_model(mechanism: Mechanism) -> tuple[Any, Any]:
    model = pin.Model(mechanism.model)
    armature = np.zeros(model.nv)
    armature[SIDEWAYS] = HEAVY
    model.armature = armature
    return model, pin.Data(model)
