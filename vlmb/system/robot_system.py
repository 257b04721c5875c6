"""A mechanism with robots and all that acts on it, compiled once: rows, forces by law, springs, a programme."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from vlmb.core import bodies as of_bodies
from vlmb.core import readings as core
from vlmb.core.bodies import move
from vlmb.core.opcodes import RATE, VALUE
from vlmb.core.packed import FORM, MEASURED, RESIDUAL, Packed, pack, tape_parts
from vlmb.core.readings import TRACE, Readings
from vlmb.errors import SceneError
from vlmb.model.laws import parameter_values, prepared, tape_breaks
from vlmb.model.names import AXES, DOT
from vlmb.model.robot_mechanism import RobotMechanism
from vlmb.model.robot_names import RobotForce, RobotQuantity, Row, allowed_names
from vlmb.model.tape import CompiledTape, Leaf, compile_tape, leaf_of
from vlmb.scene.expressions import Expression, parse, parse_equation
from vlmb.scene.names import DAMPERS
from vlmb.scene.rows import rows_of
from vlmb.scene.tables import SURFACE, Place, Posture, Run, Spring
from vlmb.system.constraints import Constraint
from vlmb.system.core_rows import gain_table
from vlmb.system.gains import require_decay
from vlmb.system.programme import ProgrammePlan
from vlmb.system.readings import form_of_row
from vlmb.system.robot_programme import make_robot_plan

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


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


@dataclass(frozen=True, eq=False)
class RobotSystem:
    """What acts on a mechanism with robots. Nothing in it changes; a run has a workspace of its own."""

    mechanism: RobotMechanism
    run: Run
    inputs: tuple[str, ...]  # names of forces from outside
    info: tuple[Constraint, ...]  # of all rows: welds (six each), edges, the ski's knife edge, ideal, servo, secondary
    welds: Integers  # (any, 2) frames
    edges: Integers  # (any, 2) frame and axis
    held: tuple[str, ...]  # names of what welds and edges hold, in order
    forces: tuple[RobotForce, ...]  # by law, then inputs, then controls
    laws: int
    elastic: tuple[tuple[int, Elastic], ...]  # which forces by law are springs
    segments: Segments
    plan: ProgrammePlan | None
    posture: Posture | None
    compiled: CompiledTape
    parameters: Array
    packed: Packed
    readings: Readings  # without `reference` of its own
    along: Integers
    gains: Array  # (rows, 3 rows) of z, z' and drift: what W vdot shall be

    @property
    def engine(self) -> str:
        """What evaluates the motion."""
        return "pinocchio"

    @property
    def eliminated(self) -> int:
        """Rows that are held by reactions: they come first."""
        return 6 * len(self.welds) + len(self.edges) + self.on_ski + len(self.mechanism.scene.constraints)

    @property
    def on_ski(self) -> bool:
        """Whether there is a ski with its knife edge."""
        return self.mechanism.scene.base.kind == "ski"

    @property
    def servo(self) -> int:
        """Rows of the programme."""
        return 0 if self.plan is None else len(self.plan.texts)

    @cached_property
    def named(self) -> tuple[RobotForce, ...]:
        """Forces that results tell: those by law that are no springs, inputs, controls."""
        springs = {at for at, _ in self.elastic}
        return tuple(force for at, force in enumerate(self.forces) if at not in springs)

    @cached_property
    def work_names(self) -> tuple[str, ...]:
        """Names of the work states: forces, ideal rows that work, and "dissipation"."""
        names = [force.name for force in self.named]
        first = self.eliminated - len(self.mechanism.scene.constraints)
        names += [row.text for row in self.info[first : self.eliminated] if row.working]
        lossy = bool(self.segments.damping.any()) or any(spring.damping for spring in self.mechanism.scene.springs)
        return (*dict.fromkeys(names), *((DAMPERS,) if lossy else ()))

    @property
    def size(self) -> int:
        """Numbers in y = (q, v, work)."""
        return int(self.mechanism.model.nq + self.mechanism.model.nv) + len(self.work_names)

    def breaks(self, start: float, end: float) -> tuple[float, ...]:
        """Return the times in (start, end) where a law or a row switches. Raises SceneError for too many."""
        texts = ", ".join(row.text for row in self.compiled.rows)
        found = {*tape_breaks(self.compiled, self.parameters, start, end, texts)} if self.compiled.rows else set[float]()
        return tuple(sorted(found))

    def with_inputs(self, names: Sequence[str]) -> RobotSystem:
        """Return the same system with forces from outside, by name."""
        return make_robot_system(self.mechanism, self.run, names)


class Quantities:
    """Collects what equations, laws and forces read, each once; and frames that no body of the model has."""

    def __init__(self, mechanism: RobotMechanism) -> None:
        self.mechanism, self.names, self.table = mechanism, mechanism.names, mechanism.table
        self.scene, self.signals = mechanism.scene, mechanism.signals
        self.parameters = {name: at for at, name in enumerate(self.scene.parameters)}
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


def make_robot_system(
    mechanism: RobotMechanism, run: Run | None = None, inputs: Sequence[str] | None = None, **options: Any
) -> RobotSystem:
    """Compile all that acts on a mechanism with robots. Raises SceneError for what is wrong with it."""
    scene = mechanism.scene
    run = msgspec.structs.replace(scene.run if run is None else run, **options)
    if run.engine == "core":
        raise SceneError("run.engine = 'core': scenes with robots run on 'pinocchio' ('auto')")
    if run.knife_edge == "projection":
        raise SceneError("run.knife_edge = 'projection': with robots there are 'reduction' and 'multiplier'")
    quantities, programme = Quantities(mechanism), scene.programme
    names = allowed_names(mechanism.names, [*scene.parameters, *mechanism.signals])
    welds, edges, held = _frames_held(quantities)
    rows = rows_of(scene)
    equations = [parse_equation(row.equation, row.key, names) for row in (*rows.ideal, *rows.servo, *rows.secondary)]
    roots, forces, elastic = _laws(quantities, names)
    laws = len(forces)
    forces += [mechanism.names.force(name, "control") for name in inputs or ()]
    controls = mechanism.names.chosen(programme.controls, "programme.controls") if programme else ()
    forces += controls
    along = np.array([_along(quantities, force) for force in forces], np.int64)
    compiled = compile_tape([*equations, *roots], quantities.resolve, mechanism.signals.pieces)
    parameters = parameter_values(scene.parameters)
    info = [Constraint(name, not name.startswith("edge:"), False, frozenset(), False) for name in held]
    if scene.base.kind == "ski":
        info.append(Constraint("knife_edge", False, False, frozenset(), False))
    ideal, servo = len(info) + len(rows.ideal), len(rows.servo)
    for row, equation, facts in zip((*rows.ideal, *rows.servo, *rows.secondary), equations, compiled.rows, strict=False):
        if not facts.moves:
            raise SceneError(f"{row.key}: {equation.text!r} contains no coordinate or rate: nothing can make it true or false")
        info.append(Constraint(row.name, facts.position, facts.angle, equation.names, facts.working))
    if ideal:
        require_decay(run)
    first, second = info[ideal : ideal + servo], info[ideal + servo :]
    plan = None if programme is None else make_robot_plan(mechanism, programme, controls, first, second, run)
    forms = [form_of_row(facts.position, facts.angle) for facts in compiled.rows[: len(equations)]]
    readings = quantities.made()
    parts = tape_parts(compiled.tape, prepared(compiled, parameters, [*equations, *roots]), parameters) | {
        FORM: np.array(forms, np.int64), MEASURED: np.zeros(3 * len(readings.kind)), RESIDUAL: np.zeros(3 * len(forms)),
    }  # fmt: skip
    h, k = gain_table(info, plan, ideal, run.gain)
    law = np.hstack([h, k, -np.eye(len(info))])
    if scene.base.kind == "ski" and run.knife_edge == "reduction":  # it begins at 0 and stays there
        law[len(held)] = 0.0
    posture = None if programme is None else programme.posture or Posture()
    return RobotSystem(
        mechanism, run, tuple(inputs or ()), tuple(info), welds, edges, held, tuple(forces), laws, tuple(elastic),
        _segments(mechanism), plan, posture, compiled, parameters, pack(parts), readings, along, law,
    )  # fmt: skip


def _along(quantities: Quantities, force: RobotForce) -> int:
    if force.along in quantities.lengths:
        return quantities.lengths[force.along]
    return quantities.of(quantities.names.find(force.along))


def _frames_held(quantities: Quantities) -> tuple[Integers, Integers, tuple[str, ...]]:
    """Return the frames of welds and of edges, and the names of their rows."""
    mechanism, welds, edges, names = quantities.mechanism, [], [], []
    scene = mechanism.scene
    short = {name: f"{robot.name}." for robot in scene.robots for name in (robot.name,) if len(scene.robots) == 1}

    def shown(frame: str) -> str:
        owner = frame.partition(".")[0]
        return frame.removeprefix(short.get(owner, ""))

    bodies = _start_poses(mechanism) if scene.welds else None
    for at, weld in enumerate(scene.welds):
        key = f"welds[{at}].frames"
        first, second = (mechanism.frame(frame, f"{key}[{k}]") for k, frame in enumerate(weld.frames))
        one, other = quantities.table.frame[first], quantities.table.frame[second]
        if one == other:
            raise SceneError(f"{key}: {weld.frames[0]!r} and {weld.frames[1]!r} are on one body already")
        assert bodies is not None
        turn, place = _pose_of(quantities, bodies, first)
        if weld.pose is None:  # the first frame as it stands at the start, on the second one's body
            body = bodies.state[other]
            about = body[:9].reshape(3, 3)
            fixed = quantities.new_frame(int(other), about.T @ turn, about.T @ (place - body[9:12]))
        else:  # second = first times pose
            import pinocchio as pin

            given = pin.SE3(pin.rpy.rpyToMatrix(*weld.pose[3:]), np.array(weld.pose[:3])).inverse()
            own = quantities.frames[second]
            back = pin.SE3(np.array(own[1:10]).reshape(3, 3), np.array(own[10:])) * given
            fixed = quantities.new_frame(int(other), back.rotation, back.translation)
        name = f"weld:{shown(weld.frames[0])}"
        if name in names:
            raise SceneError(f"{key}: {weld.frames[0]!r} is welded twice; name the other frame first")
        welds.append((first, fixed))
        names += [name] * 6
    for at, edge in enumerate(scene.edges):
        frame = mechanism.frame(edge.frame, f"edges[{at}].frame")
        if not quantities.table.frame[frame]:
            raise SceneError(f"edges[{at}].frame = {edge.frame!r}: this frame does not move")
        edges.append((frame, TRACE if edge.axis == "trace" else AXES.index(edge.axis)))
        name = f"edge:{shown(edge.frame)}"
        if name in names:
            raise SceneError(f"edges[{at}]: {edge.frame!r} has an edge already")
        names.append(name)
    return np.array(welds, np.int64).reshape(-1, 2), np.array(edges, np.int64).reshape(-1, 2), tuple(names)


def _start_poses(mechanism: RobotMechanism) -> of_bodies.Bodies:
    """Return the bodies at the posture that the scene gives for the start."""
    given = mechanism.names.canonical(mechanism.scene.start, "start")
    posture = {name: value for name, value in given.items() if name in mechanism.names.index}
    q, v = mechanism.state(posture)
    bodies = mechanism.table.bodies()
    move(bodies, q, v)
    return bodies


def _pose_of(quantities: Quantities, bodies: of_bodies.Bodies, frame: int) -> tuple[Array, Array]:
    body, place = bodies.state[quantities.table.frame[frame]], quantities.table.place[frame]
    about = body[:9].reshape(3, 3)
    return about @ place[:9].reshape(3, 3), body[9:12] + about @ place[9:]


def _laws(quantities: Quantities, names: Any) -> tuple[list[Expression], list[RobotForce], list[tuple[int, Elastic]]]:
    """Return the laws of a scene's forces and springs, what they act along, and which are springs."""
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
    return roots, forces, elastic


def _spring_law(spring: Spring, name: str) -> str:
    pull = f"({spring.stiffness!r}*({name} - {spring.rest!r}) + {spring.damping!r}*{name}{DOT})"
    if spring.tension_only:
        return f"where({name} < {spring.rest!r}, 0, -max(0, {pull}))"
    return f"-{pull}"


def _end(quantities: Quantities, place: Place, key: str) -> int:
    if isinstance(place, str):
        return quantities.mechanism.frame(place, key)
    return quantities.new_frame(0, np.eye(3), np.array(place))


def _segments(mechanism: RobotMechanism) -> Segments:
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
