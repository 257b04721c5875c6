"""Friction under a ski for Pinocchio's engine, and what is looked for along a run in both; vlmb/core/sliding.py has the law."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.core.sliding import ANSWER, FRICTION, MODE, NORMAL, PRESS, ROUNDED, SLIDES, choose
from vlmb.errors import SimulationError
from vlmb.model.layout import State
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import GeneralizedForce
from vlmb.model.quantities import SQUARE
from vlmb.system.events import BOTH_WAYS, FALLING, GRIP, LIMIT, Event
from vlmb.system.programme import total_mass

Array = NDArray[np.float64]
Acting = Sequence[tuple[GeneralizedForce, float]]

LIFTED = "the normal force became 0: the ski would leave the snow, and nothing here lets it"
YIELDING = (
    "mu |dN/dF| reached 1: friction presses the ski down as much as it grows by that, and no one friction force is defined; a "
    "smaller friction, or a higher posture, keeps it below"
)
# in the order of the core's STANDS, SLIPS, LIFTS, YIELDS
FRICTION_EVENTS = (
    Event(GRIP, BOTH_WAYS, "friction", ""), Event(GRIP, FALLING, "friction", ""),
    Event(LIMIT, FALLING, "normal", LIFTED), Event(LIMIT, FALLING, "friction", YIELDING),
)  # fmt: skip


class Hold(NamedTuple):
    """How friction holds a ski."""

    side: float  # that it slides to; 0 where it stands, nan where there is no friction
    left: float  # what friction could hold beyond what it does, over the most it can


NO_HOLD = Hold(math.nan, math.inf)


def refuse_lift(normal: float, answer: float, mu: float) -> None:
    """Raise SimulationError where the snow would have to hold the ski down, or friction is not defined."""
    if not normal >= 0.0:
        raise SimulationError(LIFTED)
    if not mu * abs(answer) < 1.0:
        raise SimulationError(YIELDING)


def indicators_of(found: Array, mu: float, speed: float, rate: float) -> Array:
    """Return values and rates (2, 4; nan: not known) of the events of friction; see `look_at_ski` of the core."""
    values = np.array([[1.0, 1.0, found[NORMAL], 1.0 - mu * abs(found[ANSWER])], np.full(4, np.nan)])
    if found[SLIDES]:
        values[:, 0] = speed, rate
    else:
        values[0, 1] = ROUNDED * mu * found[PRESS] - abs(found[FRICTION])
    return values


def hold_of(found: Array, mu: float) -> Hold:
    """Return how a ski is held, as it came out last."""
    most = mu * float(found[PRESS])
    left = (most - abs(float(found[FRICTION]))) / most if most > 0.0 else math.inf
    return Hold(float(found[SLIDES]), left)


class SkiFriction:
    """Friction of a ski in Pinocchio's engine. Its side is that of a run, or nan: as the state says."""

    def __init__(self, mechanism: Mechanism, data: Any) -> None:
        self.mechanism, self.data = mechanism, data
        self.mu, self.mass = mechanism.scene.base.friction, total_mass(mechanism)
        self.push = self.mass * (mechanism.scene.gravity or 1.0)
        self.found = np.full(6, np.nan)
        self.force = 0.0  # [N] that acts now
        self.carves = mechanism.scene.base.friction_on == "resultant"

    def normal(self, state: State, vdot: Array, acting: Acting) -> float:
        """Return the normal force [N] of accelerations and outer forces."""
        pin.centerOfMass(self.mechanism.model, self.data, state.q, state.v, vdot)
        rise = float(self.data.acom[0][2])
        return self.mass * (rise - self.mechanism.scene.surface_gravity[2]) - self._lift(state, acting)

    def _lift(self, state: State, acting: Acting) -> float:
        total, seen = 0.0, None
        for force, value in acting:
            if force.coordinate.endswith(".z"):
                total += value
            elif force.ends and len({len(end) for end in force.ends}) == 2:
                seen = seen or self.mechanism.postures(state)
                first, second = (seen.position(end[0], end[1]) if len(end) == 2 else np.array(end) for end in force.ends)
                line, side = second - first, 1.0 if len(force.ends[0]) == 3 else -1.0
                length = 1.0 if force.coordinate == SQUARE else max(float(np.linalg.norm(line)), 1e-300)
                total += value * side * float(line[2]) / length
        return total

    def solve(self, speed: float, answer: Callable[[float], tuple[float, float, float]]) -> None:
        """Find the friction from what two forces along the ski make of normal force, edge force and acceleration along it."""
        (n0, e0, a0), (n1, e1, a1) = answer(0.0), answer(self.push)
        more = (n1 - n0) / self.push, (e1 - e0) / self.push, (a1 - a0) / self.push
        choose(self.found, self.mu, speed, (n0, e0, a0), more)
        self.force = float(self.found[FRICTION])

    def settle(self) -> Hold:
        """Let the ski slide or stand from now on as it came out last. Raises SimulationError where the ski would lift."""
        self.found[MODE] = self.found[SLIDES]
        refuse_lift(float(self.found[NORMAL]), float(self.found[ANSWER]), self.mu)
        return hold_of(self.found, self.mu)

    def forget(self) -> None:
        """Let the state say whether the ski slides or stands."""
        self.found[MODE] = math.nan
