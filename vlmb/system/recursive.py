"""The recursive route: one articulated-body pass an evaluation, for spring-dampers and the reduced knife edge."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.model.mechanism import Mechanism
from vlmb.system.bars import HEAVY
from vlmb.system.constrained import SIDEWAYS
from vlmb.system.diagnostics import HUGE, Diagnostics
from vlmb.system.frames import LinkFrames
from vlmb.system.springs import SegmentSprings
from vlmb.system.types import Rhs

Array = NDArray[np.float64]


def recursive(
    mechanism: Mechanism, frames: LinkFrames, springs: SegmentSprings, sliding: bool, size: int, calls: list[int],
    diagnostics: Diagnostics,
) -> Rhs:  # fmt: skip
    """Make the right-hand side of y = (q, v, work): ABA in LOCAL convention on tau = springs.

    `sliding`: the sideways velocity of the ski stays zero. Its joint then carries an inertia of HEAVY, which takes its row and
    column out of the elimination, in a model of its own.
    """
    model, data = _sliding_model(mechanism) if sliding else (mechanism.model, frames.data)
    nq, end = model.nq, model.nq + model.nv
    aba, normalize, product = pin.aba, pin.normalize, pin.tangentMapProduct
    tau, dy, write, few = np.zeros(model.nv), np.zeros(size), springs.write, springs.few
    qdot, vdot, (root, *others) = dy[:nq], dy[nq:end], _roots(mechanism)
    planar = nq == model.nv  # no quaternions, and rates are velocities

    def any_chain(t: float, y: Array) -> Array:
        calls[0] += 1
        raw, v = y[:nq], y[nq:end]
        write(y, tau)
        vdot[...] = found = aba(model, data, raw if planar else normalize(model, raw), v, tau)
        total = found.item(root)
        for k in others:
            total += found.item(k)
        if not -HUGE < total < HUGE:
            raise diagnostics.not_finite(normalize(model, raw), v, tau)
        qdot[...] = v if planar else product(model, raw, v)
        return dy

    def short_chain(t: float, y: Array) -> Array:  # the same with the springs in line: a tenth of the time of one or two links
        calls[0] += 1
        raw, v, item = y[:nq], y[nq:end], y.item
        for at, to, k, preload, low, high in few:
            xi = item(at)
            tau[to] = preload - k * xi
            if not low < xi < high:
                springs.near = True
        vdot[...] = found = aba(model, data, raw if planar else normalize(model, raw), v, tau)
        if not -HUGE < found.item(root) < HUGE:
            raise diagnostics.not_finite(normalize(model, raw), v, tau)
        qdot[...] = v if planar else product(model, raw, v)
        return dy

    rhs: Rhs = any_chain if others or springs.dampers or not springs.guarded else short_chain
    if sliding:
        rhs = along_heading(rhs, nq)
    return _with_loss(rhs, springs) if springs.dampers else rhs


def along_heading(rhs: Rhs, nq: int) -> Rhs:
    """Let the ski's point move along its heading alone; the tangent map would bring the norm of (cos, sin) along."""
    hypot, sideways = math.hypot, nq + SIDEWAYS

    def gliding(t: float, y: Array) -> Array:
        dy, cosine, sine = rhs(t, y), y.item(2), y.item(3)
        rate = y.item(nq) / hypot(cosine, sine)
        dy[0], dy[1], dy[sideways] = cosine * rate, sine * rate, 0.0
        return dy

    return gliding


def _with_loss(rhs: Rhs, springs: SegmentSprings) -> Rhs:
    """Add the power lost in dampers, the last rate."""

    def losing(t: float, y: Array) -> Array:
        dy = rhs(t, y)
        dy[-1] = springs.dissipation(y)
        return dy

    return losing


def _roots(mechanism: Mechanism) -> tuple[int, ...]:
    """First velocity of every tree: nan and infinity anywhere spread to its root."""
    layout = mechanism.layout
    return (0,) if layout.base_size else tuple(link.v for link in layout.links if link.parent < 0)


def _sliding_model(mechanism: Mechanism) -> tuple[Any, Any]:
    model = pin.Model(mechanism.model)
    armature = np.zeros(model.nv)
    armature[SIDEWAYS] = HEAVY
    model.armature = armature
    return model, pin.Data(model)
