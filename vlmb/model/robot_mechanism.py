"""A mechanism with robots: its Pinocchio model, its vocabulary, its arrays for the core, and states by coordinate names."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.core import bodies as core
from vlmb.core.bodies import Bodies, move
from vlmb.core.frame_rows import read_all
from vlmb.core.readings import HEADING, Readings
from vlmb.errors import SceneError, finite, nearest
from vlmb.model.display import Displayed
from vlmb.model.frozen import Remade
from vlmb.model.layout import State
from vlmb.model.names import DOT, counted
from vlmb.model.robot_model import HINGES, Robots, assemble, wrapped
from vlmb.model.robot_names import Coordinate, RobotNames, RobotQuantity, allowed_names
from vlmb.model.signals import Signals, signals_of
from vlmb.scene.by_phase import numbers_of
from vlmb.scene.names import listed
from vlmb.scene.scene import Scene

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

KINDS = {"free": core.FREE, "planar": core.PLANAR, "ball": core.BALL}


@dataclass(frozen=True)
class Table:
    """The arrays of a tree of bodies and its frames; constant. `bodies` and `readings` add room to write."""

    joint: Integers
    real: Array
    frame: Integers
    place: Array
    mass: float
    joints: int  # of the model, the world counted in; beside them stand roots by themselves
    velocities: int

    def bodies(self) -> Bodies:
        """Return the tree with room of its own."""
        state = np.zeros((len(self.joint), 24))
        state[0, [0, 4, 8]] = 1.0
        return Bodies(self.joint, self.real, state, np.zeros((int(self.joint[:, core.COUNT].sum()) or 1, 6)))


@dataclass(frozen=True, eq=False)
class RobotMechanism(Remade, Displayed):
    """What `build` makes of a scene with robots, or of a pinocchio.Model. It is never changed."""

    scene: Scene
    given: Any = None  # a pinocchio.Model that was made elsewhere

    def __repr__(self) -> str:
        robots = listed([robot.name for robot in self.scene.robots])
        return f"<Mechanism of {self.scene.name!r}: {self.scene.base.kind} base; robots {robots}; {self.names.shown}>"

    @cached_property
    def robots(self) -> Robots:
        """The model and what is known of its parts. Raises SceneError."""
        return assemble(self.scene) if self.given is None else wrapped(self.given, self.scene.robots[0].name)

    @property
    def model(self) -> Any:
        """The pinocchio.Model."""
        return self.robots.model

    @property
    def frames(self) -> Mapping[str, int]:
        """Frame ids of the model by every name that a scene may use."""
        return self.robots.frames

    @cached_property
    def names(self) -> RobotNames:
        """Every name that equations, forces, tables and figures of this mechanism may use."""
        return RobotNames(self.robots, {joint: len(self.model.frames) + at for at, joint in enumerate(self.roots)})

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of all coordinates, in their order."""
        return tuple(self.names.index)

    @property
    def left_out(self) -> tuple[str, ...]:
        """What of the scene is not in the model, and why."""
        return self.robots.left_out

    @property
    def warnings(self) -> tuple[str, ...]:
        """What may go wrong later."""
        return ()

    @property
    def allowed(self) -> Collection[str]:
        """Every name that an equation may use."""
        return allowed_names(self.names, [*numbers_of(self.scene), *self.signals])

    @property
    def signals(self) -> Signals:
        """The measured data of the scene."""
        return signals_of(self.scene)

    @cached_property
    def roots(self) -> tuple[int, ...]:
        """Joints of robots that fly or slide: their coordinates are relative to what they are attached to."""
        model = self.model
        kinds = [HINGES.get(joint.shortname().partition("<")[0]) for joint in model.joints]
        return tuple(
            at for at, kind in enumerate(kinds)
            if at and kind in ("free", "planar") and model.names[at].partition(".")[0] in self.robots.names
        )  # fmt: skip

    @cached_property
    def table(self) -> Table:
        """The arrays of the tree for the core."""
        model, roots = self.model, self.roots
        count = model.njoints + len(roots)
        joint, real = np.zeros((count, 6), np.int64), np.zeros((count, 19))
        real[:, [0, 4, 8]] = 1.0
        at_j = 0
        for row in range(1, count):
            own = row < model.njoints
            at = row if own else roots[row - model.njoints]
            made = model.joints[at]
            kind, axis = joint_kind(model, at)
            joint[row] = model.parents[at] if own else 0, kind, made.idx_q, made.idx_v, made.nv, at_j
            at_j += made.nv
            real[row, core.AXIS : core.AXIS + 3] = axis
            if own:
                place, inertia = model.jointPlacements[at], model.inertias[at]
                real[row, :9], real[row, core.PLACE : core.PLACE + 3] = place.rotation.ravel(), place.translation
                real[row, core.MASS], real[row, core.CENTRE : core.CENTRE + 3] = inertia.mass, inertia.lever
        frames = list(model.frames)
        frame = np.array([*(f.parentJoint for f in frames), *range(model.njoints, count)], np.int64)
        place = np.zeros((len(frame), 12))
        place[:, [0, 4, 8]] = 1.0
        for row, entry in enumerate(frames):
            place[row, :9], place[row, 9:] = entry.placement.rotation.ravel(), entry.placement.translation
        mass = float(real[1 : model.njoints, core.MASS].sum())
        return Table(joint, real, frame, place, mass, model.njoints, model.nv)

    def frame(self, name: str, key: str) -> int:
        """Return a frame by a scene's name; `ground` and `base` are the world. Raises SceneError."""
        if name in ("ground", "base"):
            return 0
        if name not in self.frames:
            raise SceneError(f"{key}: no frame {name!r:.80}; {nearest(name, self.frames)}")
        return int(self.frames[name])

    # States

    @cached_property
    def _readings(self) -> Readings:
        """The coordinates as the core reads them."""
        entries, table = self.names.entries, self.table
        kinds = np.array([entry.row for entry in entries], np.int64).reshape(-1, 4)
        return Readings(table.frame, table.place, kinds, np.zeros(len(kinds)), np.zeros((len(kinds), 2)), np.array([table.mass]))

    def read(self, q: Array, v: Array, near: Array | None = None) -> tuple[Array, Array]:
        """Read coordinates and rates (N, coordinates) of samples, angles on the branch that goes on from `near`."""
        readings, bodies, entries = self._readings, self.table.bodies(), self.names.entries
        reference = np.zeros((len(entries), 2))
        readings = readings._replace(reference=reference)
        chosen, out = np.arange(len(entries)), np.zeros((len(entries), 3))
        values, rates = np.zeros((len(q), len(entries))), np.zeros((len(q), len(entries)))
        branches = [at for at, entry in enumerate(entries) if entry.row[0] == HEADING and entry.row[2] == 0]
        last = near
        for i in range(len(q)):
            if last is not None:
                reference[:, 0] = reference[:, 1] = last
                for at in branches:  # azimuth and elevation of a link, next to each other
                    reference[at : at + 2] = last[at], last[at + 1]
            arguments: tuple[Any, ...] = (*bodies, *readings, chosen, np.ascontiguousarray(q[i]), np.ascontiguousarray(v[i]), out)
            read_all(*arguments)
            bad = np.isnan(out[:, 0])
            values[i], rates[i] = out[:, 0], np.nan_to_num(out[:, 1])
            if bad.any():  # an azimuth at the pole: it stays
                values[i, bad] = 0.0 if last is None else last[bad]
            last = values[i]
        return values, rates

    def along(self, quantity: RobotQuantity, q: Array, v: Array) -> Array:
        """Return a quantity (N,) at samples (q, v); an angle goes on without jumps of whole turns."""
        table, bodies = self.table, self.table.bodies()
        row, offset = np.array([quantity.row], np.int64), np.array([quantity.offset])
        readings = Readings(table.frame, table.place, row, offset, np.zeros((1, 2)), np.array([table.mass or 1.0]))
        out, chosen, found = np.zeros((1, 3)), np.zeros(1, np.int64), np.zeros(len(q))
        for i in range(len(q)):
            arguments: tuple[Any, ...] = (*bodies, *readings, chosen, np.array(q[i]), np.array(v[i]), out)
            read_all(*arguments)
            found[i] = out[0, 1] if quantity.rate else out[0, 0]
        return np.unwrap(found) if quantity.angle and not quantity.rate else found

    def coordinates(self, state: tuple[Any, Any], near: Mapping[str, float] | None = None) -> dict[str, float]:
        """Read coordinates and rates of a state (q, v), angles on the branch nearest to `near`."""
        reference = None
        if near is not None:
            named = self.names.canonical(near, "near")
            reference = np.array([float(named.get(name, 0.0)) for name in self.names.index])
        values, rates = self.read(np.array([state[0]], float), np.array([state[1]], float), reference)
        found = dict(zip(self.names.index, values[0].tolist(), strict=True))
        return found | {f"{name}{DOT}": rate for name, rate in zip(self.names.index, rates[0].tolist(), strict=True)}

    def state(self, coordinates: Mapping[str, float], rates: Mapping[str, float] | None = None) -> State:
        """Turn coordinates, and rates (missing ones 0), into Pinocchio's (q, v).

        Those that are missing are as the reference posture has them. Raises SceneError naming an unknown or non-finite one.
        """
        given = self.names.canonical(coordinates, "coordinates")
        moving = self.names.canonical(rates or {}, "rates")
        for what, values, end in (("coordinates", given, ""), ("rates", moving, DOT)):
            for name, value in values.items():
                if name.removesuffix(DOT) not in self.names.index or name.endswith(DOT) != bool(end):
                    raise SceneError(f"{what}: no such coordinate {name!r:.80}; {self.names.hint(name)}")
                finite(f"{what}.{name}", value)
        whole = {**self.reference, **given}
        q, v = self.robots.reference.copy(), np.zeros(self.model.nv)
        by_joint: dict[int, list[Coordinate]] = {}
        for entry in self.names.entries:
            by_joint.setdefault(entry.joint, []).append(entry)
        bodies = self.table.bodies()
        for joint in range(1, self.model.njoints):
            entries = by_joint.get(joint, [])
            self._set(joint, [(e, whole[e.name], float(moving.get(e.name + DOT, 0.0))) for e in entries], q, v, bodies)
        return State(q, v)

    @cached_property
    def reference(self) -> dict[str, float]:
        """Coordinates of the posture that the scene's tables tell; links stand upright."""
        q = self.robots.reference
        values, _ = self.read(q[None], np.zeros((1, self.model.nv)))
        found = dict(zip(self.names.index, values[0].tolist(), strict=True))
        for _, number in self.robots.links:
            found |= {f"phi{number}": 0.0, f"psi{number}": 0.5 * math.pi}
        return found

    def _set(self, joint: int, values: list[tuple[Coordinate, float, float]], q: Array, v: Array, bodies: Bodies) -> None:
        """Write a joint's part of (q, v); links need those of their parents written before."""
        made = self.model.joints[joint]
        at, k = made.idx_q, made.idx_v
        kind = joint_kind(self.model, joint)[0]
        if kind in (core.REVOLUTE, core.PRISMATIC):
            _, q[at], v[k] = values[0]
        elif kind == core.PLANAR:
            (x, y, angle), (dx, dy, spin) = [entry[1] for entry in values], [entry[2] for entry in values]
            c, s = math.cos(angle), math.sin(angle)
            q[at : at + 4], v[k : k + 3] = (x, y, c, s), (c * dx + s * dy, c * dy - s * dx, spin)
        elif kind == core.FREE:
            place, change = np.array([entry[1] for entry in values]), np.array([entry[2] for entry in values])
            turn = pin.rpy.rpyToMatrix(*place[3:])
            q[at : at + 7] = pin.SE3ToXYZQUAT(pin.SE3(turn, place[:3]))
            v[k : k + 3] = turn.T @ change[:3]
            v[k + 3 : k + 6] = turn.T @ (pin.rpy.computeRpyJacobian(place[3:], pin.LOCAL_WORLD_ALIGNED) @ change[3:])
        elif kind == core.BALL:
            (phi, psi), (dphi, dpsi) = [entry[1] for entry in values[:2]], [entry[2] for entry in values[:2]]
            d = np.array([math.cos(phi) * math.cos(psi), math.sin(phi) * math.cos(psi), math.sin(psi)])
            side = np.array([-math.sin(phi), math.cos(phi), 0.0])
            up = np.cross(d, side)
            turn, omega = np.column_stack([d, side, up]), dphi * math.cos(psi) * up - dpsi * side
            move(bodies, q, v)
            parent = int(self.model.parents[joint])
            before = bodies.state[parent, :9].reshape(3, 3) @ self.model.jointPlacements[joint].rotation
            q[at : at + 4] = pin.Quaternion(before.T @ turn).coeffs()
            v[k : k + 3] = turn.T @ (omega - bodies.state[parent, core.ANGULAR : core.ANGULAR + 3])

    def position(self, state: tuple[Any, Any], frame: str, point: str = "") -> Array:
        """Position (3,) [m] of a frame, or of a point of a link, in the surface frame."""
        name = f"{frame}.{point}" if point else frame
        if name not in self.frames:
            raise SceneError(f"unknown frame {name!r:.80}; {nearest(name, self.frames)}")
        data = pin.Data(self.model)
        pin.framesForwardKinematics(self.model, data, np.asarray(state[0], float))
        return np.array(data.oMf[self.frames[name]].translation)

    @property
    def facts(self) -> str:
        """What it is made of, in a line."""
        return f"{counted(len(self.scene.robots), 'robot')}, {counted(len(self.scene.links), 'link')}, {self.table.mass:g} kg"


def joint_kind(model: Any, joint: int) -> tuple[int, Array]:
    """Return what a joint is to the core, and its axis (3,). Raises SceneError for one that the core does not have."""
    made, name = model.joints[joint], model.joints[joint].shortname().partition("<")[0]
    if name in HINGES:
        return KINDS[HINGES[name]], np.zeros(3)
    if name == "JointModelTranslation":
        return core.TRANSLATION, np.zeros(3)
    if made.nq == 1 and made.nv == 1 and not name.startswith(("JointModelMimic", "JointModelH")):
        data = made.createData()
        made.calc(data, np.zeros(model.nq), np.zeros(model.nv))
        subspace = np.array(data.S).reshape(6)
        turns = bool(np.abs(subspace[3:]).max() > 0.0)
        return (core.REVOLUTE if turns else core.PRISMATIC), subspace[3:] if turns else subspace[:3]
    raise SceneError(
        f"joint {model.names[joint]!r} is a {name.removeprefix('JointModel')}: joints turn about one axis or slide along it, and "
        "a root is free or planar"
    )
