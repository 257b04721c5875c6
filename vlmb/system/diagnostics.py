"""Diagnostics: why a right-hand side has no answer, as errors that name what is singular or not finite."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.errors import SimulationError, SingularError, VlmbError
from vlmb.model.layout import Layout
from vlmb.model.mechanism import Mechanism
from vlmb.system.constrained import ConstraintSolver
from vlmb.system.forces import ForceWriter
from vlmb.system.frames import LinkFrames

Array = NDArray[np.float64]

SOUND = 1e12  # condition of the scaled mass matrix below which it is not what fails
HUGE = 1e100  # an acceleration or velocity beyond this is no number to go on with


class Diagnostics:
    """Finds the cause of a failed evaluation; costs nothing until asked."""

    def __init__(self, mechanism: Mechanism, frames: LinkFrames, applied: ForceWriter, solver: ConstraintSolver) -> None:
        self.mechanism, self.frames, self.applied, self.solver = mechanism, frames, applied, solver

    def conditioning(self, q: Array) -> tuple[float, list[str]]:
        """Condition number of the mass matrix scaled to a unit diagonal, and the velocities of its weakest motion.

        Prescribed lengths stand apart: what moves them asks for no mass. So does what the rows of the last solution hold.
        """
        model = self.mechanism.model
        own = np.delete(np.arange(model.nv), self.solver.prescribed_dofs)
        mass = np.array(pin.crba(model, self.frames.data, pin.normalize(model, q))) + self.solver.added()
        mass = mass[np.ix_(own, own)]
        if not np.isfinite(mass).all():
            return math.inf, ["every coordinate"]
        scale = np.sqrt(np.maximum(np.diag(mass), 1e-300))
        values, vectors = np.linalg.eigh(mass / np.outer(scale, scale))
        motion, names = np.abs(vectors[:, 0]), np.array(velocity_names(self.mechanism.layout))[own].tolist()
        weakest = [names[k] for k in np.argsort(-motion)[:4] if motion[k] > 0.1 * motion.max()]
        condition = float(values[-1] / values[0]) if values[0] > 0.0 else math.inf
        return condition, list(dict.fromkeys(weakest))

    def singular(self, q: Array) -> VlmbError:
        """Name the motion without inertia at a configuration."""
        condition, weakest = self.conditioning(q)
        if condition < SOUND:
            return SimulationError("a position or velocity is too large to compute with: the motion has no finite continuation")
        return SingularError(
            f"the mass matrix is singular (condition {condition:.1e}): {', '.join(weakest)} can move without inertia. "
            f"{' '.join(self.mechanism.warnings)}".rstrip()
        )

    def not_finite(self, q: Array, v: Array, tau: Array) -> VlmbError:
        """Say which quantity is not finite."""
        self.solver.require_finite()
        names, applied = velocity_names(self.mechanism.layout), self.applied
        for law, channel, value in zip(applied.laws, applied.channels, applied.values.tolist(), strict=False):
            if not math.isfinite(value):
                reach = self.mechanism.signals.reach(law.text)
                return SimulationError(f"the law {law.text!r} of the force on {channel.name} has no finite value{reach}")
        for what, values in (("force", tau), ("velocity", v)):
            bad = [names[k] for k in np.flatnonzero(~np.isfinite(values))]
            if bad:
                return SimulationError(f"the {what} of {', '.join(bad)} is not finite")
        if not np.isfinite(q).all():
            return SimulationError("the configuration is not finite")
        if self.conditioning(q)[0] < SOUND:
            worst = int(np.argmax(np.abs(tau)))
            where = f"the largest force, {tau[worst]:.3g}, is on {names[worst]}"
            return SimulationError(f"accelerations are no longer finite: {where}")
        return self.singular(q)


def velocity_names(layout: Layout) -> list[str]:
    """Name every velocity of v for messages."""
    names = [""] * layout.nv
    base = ("forward", "sideways", "yaw", "up") if layout.headed else ("x", "y", "z")
    for k in range(layout.base_size):
        names[k] = f"base {base[k]}"
    for i, link in enumerate(layout.links):
        for k in range(1 if layout.plane else 3):
            names[link.v + k] = f"hinge of {link.name}"
        for which, segment in ((1, link.lower), (2, link.upper)):
            if segment.joint:
                names[segment.v] = f"xi{i + 1}_{which} of {link.name}"
    return names
