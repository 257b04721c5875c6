"""The snow under a ski that carries robots: its normal force and moments, and friction along the ski."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.core.bodies import AT
from vlmb.core.readings import BETWEEN, CENTRE_OF_MASS, POINT
from vlmb.core.sliding import SLIDES
from vlmb.system.friction import SkiFriction
from vlmb.system.robot_forces import DRAG
from vlmb.system.robot_solving import RobotSolving

Array = NDArray[np.float64]

SKI = 1  # its joint: the first
Push = tuple[Array, Array, Array]  # force, place, moment, in the surface frame


class Snow:
    """What the snow bears of a ski and all that hangs on it."""

    def __init__(self, space: RobotSolving) -> None:
        system, self.space = space.system, space
        self.carried = {*space.model.subtrees[SKI]}
        kinds, self.outer = system.readings.kind, list[tuple[int, int, int, int, int]]()
        for slot, force in enumerate(system.forces):
            kind, first, component, second = kinds[system.along[slot]].tolist()
            if kind == BETWEEN or force.name.startswith("R_") or force.name == DRAG:
                self.outer.append((slot, kind, first, component, second))
        pin.computeSubtreeMasses(space.model, space.data)
        self.share = float(space.data.mass[SKI]) / float(space.data.mass[0])
        base = system.mechanism.scene.base
        self.friction = RubbedSki(space, float(space.data.mass[SKI])) if base.friction else None

    def bears(self, q: Array, v: Array, vdot: Array) -> Array:
        """Return normal force [N], roll and pitch moment [N m] about A under accelerations."""
        space = self.space
        pin.rnea(space.model, space.data, q, v, vdot)
        carried = space.data.f[SKI]
        force, moment = np.array(carried.linear), np.array(carried.angular)
        turn, place = space.bodies.state[SKI, :9].reshape(3, 3), space.bodies.state[SKI, AT : AT + 3]
        for pushed, at, twist in self._pushes():
            force -= turn.T @ pushed
            moment -= turn.T @ (np.cross(at - place, pushed) + twist)
        return np.array([force[2], moment[0], moment[1]])

    def _pushes(self) -> list[Push]:
        """List the forces from outside on what the ski carries: at points, of springs, of welds and edges."""
        space, found, still = self.space, list[Push](), np.zeros(3)
        for slot, kind, first, component, second in self.outer:
            value = float(space.values[slot])
            if kind == BETWEEN:
                ends = [self._place(frame) for frame in (first, second)]
                along = ends[1] - ends[0]
                push = value * along / max(float(np.linalg.norm(along)), 1e-300)
                for frame, end, way in zip((first, second), ends, (-push, push), strict=True):
                    if self._carries(frame):
                        found.append((way, end, still))
            elif kind == POINT and self._carries(first):
                found.append((value * np.eye(3)[component], self._place(first), still))
            elif kind == CENTRE_OF_MASS:
                pin.centerOfMass(space.model, space.data, space.q, True)
                turn, place = space.bodies.state[SKI, :9].reshape(3, 3), space.bodies.state[SKI, AT : AT + 3]
                found.append((self.share * value * np.eye(3)[component], place + turn @ space.data.com[SKI], still))
        for number, pair in enumerate(space.system.welds.tolist()):
            held, at = space.multipliers[6 * number : 6 * number + 6], self._place(pair[0])
            for frame, side in zip(pair, (1.0, -1.0), strict=True):
                if self._carries(frame):
                    found.append((side * held[:3], at, side * held[3:]))
        return found

    def _carries(self, frame: int) -> bool:
        return int(self.space.system.readings.frame[frame]) in self.carried

    def _place(self, frame: int) -> Array:
        readings = self.space.system.readings
        body, own = self.space.bodies.state[readings.frame[frame]], readings.place[frame]
        found: Array = body[AT : AT + 3] + body[:9].reshape(3, 3) @ own[9:]
        return found


class RubbedSki(SkiFriction):
    """Friction along a ski under robots."""

    def __init__(self, space: RobotSolving, mass: float) -> None:
        base = space.system.mechanism.scene.base
        self.mu, self.mass = base.friction, mass
        self.push = mass * (space.system.mechanism.scene.gravity or 1.0)
        self.found = np.full(6, np.nan)
        self.force = 0.0
        self.carves = base.friction_on == "resultant"

    @property
    def stands(self) -> bool:
        """Whether it came out standing."""
        return bool(self.found[SLIDES] == 0.0)
