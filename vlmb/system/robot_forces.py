"""Forces of a scene with robots: by law, of springs between points, of the air, in segments; and lengths that follow laws."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.core import readings as core
from vlmb.core.opcodes import RATE, VALUE
from vlmb.core.readings import Readings
from vlmb.errors import SceneError
from vlmb.model.laws import time_law
from vlmb.model.names import AXES, DOT
from vlmb.model.robot_mechanism import RobotMechanism
from vlmb.model.robot_names import RobotForce, RobotQuantity, Row
from vlmb.model.tape import Leaf, leaf_of
from vlmb.scene.by_phase import numbers_of
from vlmb.scene.expressions import Expression, parse
from vlmb.scene.tables import SURFACE, Place, Spring
from vlmb.system.prescribed import Prescribed

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

DRAG = "drag"  # its forces are in the account of energy alone


class Elastic(NamedTuple):
    """A spring between two points, as a force by a law along their distance."""

    quantity: int
    stiffness: float
    rest: float
    rope: bool


class Segments(NamedTuple):
    """Springs and dampers in segments of links: where their lengths stand."""

    q: Integers
    v: Integers
    stiffness: Array
    damping: Array
    rest: Array


class Quantities:
    """Collects what equations, laws and forces read, each once; and frames that no body of the model has."""

    def __init__(self, mechanism: RobotMechanism) -> None:
        self.mechanism, self.names, self.table = mechanism, mechanism.names, mechanism.table
        self.scene, self.signals = mechanism.scene, mechanism.signals
        self.parameters = {name: at for at, name in enumerate(numbers_of(self.scene))}
        self.rows: dict[tuple[Row, float], int] = {}
        self.lengths: dict[str, int] = {}  # of springs, by the names that their laws use
        self.frames = [(int(body), *place) for body, place in zip(self.table.frame, self.table.place.tolist(), strict=True)]

    def of(self, quantity: RobotQuantity) -> int:
        """Return where a quantity stands."""
        return self.place(quantity.row, quantity.offset)

    def place(self, row: Row, offset: float = 0.0) -> int:
        """Return where a row of the core's table stands."""
        return self.rows.setdefault((row, offset), len(self.rows))

    def new_frame(self, body: int, turn: Array, place: Array) -> int:
        """Add a frame on a body."""
        self.frames.append((body, *np.asarray(turn, float).ravel().tolist(), *np.asarray(place, float).tolist()))
        return len(self.frames) - 1

    def resolve(self, name: str) -> Leaf:
        """Return what a name of an equation is to the tape."""
        known = leaf_of(name, self.parameters, self.signals, self.lengths)
        if known is not None:
            return known
        quantity = self.names.find(name)
        return Leaf(RATE if quantity.rate else VALUE, self.of(quantity), quantity.angle)

    def made(self) -> Readings:
        """Return the table for the core."""
        frames = np.array(self.frames, float).reshape(-1, 13)
        kinds = np.array([row for row, _ in self.rows], np.int64).reshape(-1, 4)
        offsets = np.array([offset for _, offset in self.rows], float)
        return Readings(
            frames[:, 0].astype(np.int64), np.ascontiguousarray(frames[:, 1:]), kinds, offsets, np.zeros((len(kinds), 2)),
            np.array([self.table.mass or 1.0]),
        )  # fmt: skip


def laws_of(
    quantities: Quantities, names: Collection[str]
) -> tuple[list[Expression], list[RobotForce], list[tuple[int, Elastic]]]:
    """Return the laws of a scene's forces, springs and drag, what they act along, and which are springs; drag stands last."""
    scene, roots, forces = quantities.scene, list[Expression](), list[RobotForce]()
    for at, force in enumerate(scene.forces):
        key = f"forces[{at}]"
        if force.on is not None:
            forces.append(quantities.names.force(force.on, f"{key}.on"))
            roots.append(parse(0.0 if force.law is None else force.law, f"{key}.law", names))
        elif force.at is not None:
            if force.frame != SURFACE:
                raise SceneError(f"{key}.frame = {force.frame!r}: with robots forces at points are given in the surface frame")
            for axis, law in zip(AXES, force.force or (), strict=True):
                forces.append(quantities.names.force_at(force.at, axis, f"{key}.at"))
                roots.append(parse(law, f"{key}.force", names))
    elastic = []
    for at, spring in enumerate(scene.springs):
        key, name = f"springs[{at}]", f"spring_{at}"
        ends = [_end(quantities, place, f"{key}.between[{k}]") for k, place in enumerate(spring.between)]
        where = quantities.place((core.BETWEEN, ends[0], 0, ends[1]))
        quantities.lengths[name] = where
        elastic.append((len(forces), Elastic(where, spring.stiffness, spring.rest, spring.tension_only)))
        forces.append(RobotForce(name, "N", name))
        roots.append(parse(_spring_law(spring, name), key, [name, name + DOT]))
    base = scene.base
    if base.drag:
        rates = [f"{base.drag_at}.{axis}{DOT}" for axis in AXES]
        speed = f"sqrt({' + '.join(f'({rate})**2' for rate in rates)})"
        for axis, rate in zip(AXES, rates, strict=True):
            along = quantities.names.force_at(base.drag_at, axis, "base.drag_at").along
            forces.append(RobotForce(DRAG, "N", along))
            roots.append(parse(f"-{base.drag!r}*{speed}*{rate}", "base.drag", names))
    return roots, forces, elastic


def drives_of(mechanism: RobotMechanism) -> tuple[Prescribed, ...]:
    """Collect the segments of links whose lengths follow laws. Raises ExpressionError."""
    scene, model, found = mechanism.scene, mechanism.model, []
    for at, link in enumerate(scene.links):
        for which, side in ((1, "lower"), (2, "upper")):
            segment = link.segment(which)
            if segment.motion == "prescribed":
                joint = model.joints[model.getJointId(f"{link.name}.{side}")]
                law = time_law(segment.law or 0.0, numbers_of(scene), f"links[{at}].{side}.law", mechanism.signals)
                found.append(Prescribed(f"xi{at + 1}_{which}", f"F{at + 1}_{which}", joint.idx_q, joint.idx_v, law))
    return tuple(found)


def ties_of(mechanism: RobotMechanism) -> dict[str, str]:
    """Return the equations of joints that mimic others, by the names of their rows."""
    names = {mechanism.model.names[entry.joint]: entry.name for entry in mechanism.names.entries}
    found = {}
    for tie in mechanism.robots.ties:
        turned = f"{tie.multiplier!r}*{names[tie.other]} + " if tie.other else ""
        found[f"mimic:{names[tie.joint]}"] = f"{names[tie.joint]} = {turned}{tie.offset!r}"
    return found


def row_of(drive: Prescribed) -> str:
    """Return the equation that holds a given length."""
    return f"{drive.name} - ({drive.law.text}) = 0"


def _spring_law(spring: Spring, name: str) -> str:
    pull = f"({spring.stiffness!r}*({name} - {spring.rest!r}) + {spring.damping!r}*{name}{DOT})"
    if spring.tension_only:
        return f"where({name} < {spring.rest!r}, 0, -max(0, {pull}))"
    return f"-{pull}"


def _end(quantities: Quantities, place: Place, key: str) -> int:
    if isinstance(place, str):
        return quantities.mechanism.frame(place, key)
    return quantities.new_frame(0, np.eye(3), np.array(place))


def segments_of(mechanism: RobotMechanism) -> Segments:
    """Return the springs and dampers of the links' segments."""
    model, found = mechanism.model, []
    for link in mechanism.scene.links:
        for side, segment in (("lower", link.lower), ("upper", link.upper)):
            name = f"{link.name}.{side}"
            if segment.motion == "free" and model.existJointName(name) and (segment.stiffness or segment.damping):
                joint = model.joints[model.getJointId(name)]
                found.append((joint.idx_q, joint.idx_v, segment.stiffness, segment.damping, segment.rest_length))
    columns = np.array(found, float).reshape(-1, 5).T
    return Segments(columns[0].astype(np.int64), columns[1].astype(np.int64), *columns[2:])
