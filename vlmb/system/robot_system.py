"""A mechanism with robots and all that acts on it, compiled once: rows, forces by law, springs, a programme."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple, cast

import msgspec
import numpy as np
from numpy.typing import NDArray

from vlmb.core import bodies as of_bodies
from vlmb.core.bodies import move
from vlmb.core.packed import FORM, MEASURED, RESIDUAL, Packed, pack, tape_parts
from vlmb.core.readings import TRACE, Readings
from vlmb.errors import SceneError
from vlmb.model.laws import breaks_within, law_breaks, parameter_values, prepared, tape_breaks
from vlmb.model.names import AXES
from vlmb.model.robot_mechanism import RobotMechanism
from vlmb.model.robot_names import RobotForce
from vlmb.model.tape import CompiledTape, compile_tape
from vlmb.scene.by_phase import goes_by_phase, numbers_of, programme_at, programmes_of
from vlmb.scene.expressions import Expression, parse_equation
from vlmb.scene.names import DAMPERS
from vlmb.scene.rows import rows_of
from vlmb.scene.scene import Scene, with_values
from vlmb.scene.tables import Posture, Run
from vlmb.system.constraints import Constraint
from vlmb.system.contacts import ContactPoint, Footing, PhaseContacts, always, contact_points, phase_scene, work_names_of
from vlmb.system.core_rows import gain_table
from vlmb.system.events import Event, events_of
from vlmb.system.gains import MovingGains, require_decay
from vlmb.system.pace import names_phase_time
from vlmb.system.prescribed import Prescribed, require_inside, require_smooth
from vlmb.system.programme import ProgrammePlan
from vlmb.system.readings import form_of_row
from vlmb.system.robot_forces import DRAG, Elastic, Quantities, Segments, drives_of, laws_of, row_of, segments_of, ties_of
from vlmb.system.robot_programme import make_robot_plan, posture_of, read_moving_gains

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

KEPT = ("robots", "names", "table", "roots", "reference", "_readings")  # of a mechanism, whatever phase it is in


class OfPhases(NamedTuple):
    """What results tell of all phases of a run."""

    rows: tuple[Constraint, ...]  # of programmes
    forces: tuple[RobotForce, ...]  # by law, then inputs, then controls
    controls: tuple[str, ...]  # names


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
    drives: tuple[Prescribed, ...]  # lengths that follow laws
    plan: ProgrammePlan | None
    posture: Posture | None
    compiled: CompiledTape
    parameters: Array
    packed: Packed
    readings: Readings  # without `reference` of its own
    along: Integers
    gains: Array  # (rows, 3 rows) of z, z' and drift: what W vdot shall be
    seen: Integers  # (contacts, 3) quantities that are their points' x, y, z; -1 where there is none
    own: OfPhases  # of all phases: what results tell
    events: tuple[Event, ...] = ()  # of the scene, then that of `until`; their expressions are the last laws
    until: Expression | None = None  # a run ends where it falls through 0
    ends_at: str = ""  # the event of the scene at which a run ends
    contacts: PhaseContacts | None = None  # of a phase
    mover: Callable[[RobotSystem, Sequence[Any], Any], Any] | None = None  # makes its engine: (system, branch, control)

    @property
    def engine(self) -> str:
        """What evaluates the motion."""
        return "pinocchio"

    @property
    def eliminated(self) -> int:
        """Rows that are held by reactions: they come first."""
        return self.first_drive + len(self.drives) + len(self.mechanism.robots.ties) + len(self.mechanism.scene.constraints)

    @property
    def knife_edge(self) -> int:
        """Place of the row of the ski's knife edge, where there is one."""
        return 6 * len(self.welds) + len(self.edges)

    @property
    def first_drive(self) -> int:
        """Place of the first row of a length that follows a law; joints that mimic others, then ideal rows stand behind these."""
        return self.knife_edge + self.on_ski

    @property
    def on_ski(self) -> bool:
        """Whether there is a ski with its knife edge."""
        return self.mechanism.scene.on_snow

    @property
    def prescribed(self) -> tuple[Prescribed, ...]:
        """Lengths by laws."""
        return self.drives

    @property
    def servo(self) -> int:
        """Rows of the programme."""
        return 0 if self.plan is None else len(self.plan.texts)

    @cached_property
    def named(self) -> tuple[RobotForce, ...]:
        """Forces that results tell: those by law that are no springs and not of the air, inputs, controls."""
        springs = {at for at, _ in self.elastic}
        return tuple(force for at, force in enumerate(self.own.forces) if at not in springs and force.name != DRAG)

    @cached_property
    def work_names(self) -> tuple[str, ...]:
        """Names of the work states: forces, ideal rows that work, contacts, and "dissipation"; in a phase the run's."""
        if self.contacts is not None:
            return self.contacts.works
        names = [force.name for force in self.named] + [drive.force for drive in self.drives]
        first = self.eliminated - len(self.mechanism.scene.constraints)
        names += [row.text for row in self.info[first : self.eliminated] if row.working]
        scene = self.mechanism.scene
        lossy = bool(self.segments.damping.any()) or any(spring.damping for spring in scene.springs)
        lossy = lossy or bool(scene.base.drag or scene.base.friction)
        names += work_names_of(self.points)
        return (*dict.fromkeys(names), *((DAMPERS,) if lossy else ()))

    @property
    def size(self) -> int:
        """Numbers in y = (q, v, work)."""
        return int(self.mechanism.model.nq + self.mechanism.model.nv) + len(self.work_names)

    def breaks(self, start: float, end: float) -> tuple[float, ...]:
        """Return the times in [start, end] where a law or a row switches. Raises SceneError for too many."""
        texts = ", ".join(row.text for row in self.compiled.rows)
        found = set[float]()
        if self.compiled.rows:
            found = breaks_within(lambda low, high: tape_breaks(self.compiled, self.parameters, low, high, texts), start, end)
        names, links = {drive.name: drive for drive in self.drives}, self.mechanism.scene.links
        for name, drive in names.items():
            number, which = map(int, name.removeprefix("xi").split("_"))
            its = breaks_within(partial(law_breaks, drive.law), start, end)
            require_smooth(drive, its - {end}, start)
            found |= its
            require_inside(drive, links[number - 1].segment(which).bounds, start, end)
        return tuple(sorted(found))

    def with_inputs(self, names: Sequence[str]) -> RobotSystem:
        """Return the same system with forces from outside, by name."""
        made = make_robot_system(self.mechanism, self.run, names, self.until, self.ends_at)
        return dataclasses.replace(made, contacts=self.contacts, mover=self.mover)

    def commanded(self, names: Sequence[str]) -> RobotSystem:
        """Return the same system without a programme, with forces from outside in its place."""
        scene = with_values(self.mechanism.scene, {"programme": None, "programmes": ()})
        made = with_scene(self.mechanism, scene)
        return dataclasses.replace(make_robot_system(made, self.run, names), mover=self.mover)

    def moved_by(self, mover: Callable[[RobotSystem, Sequence[Any], Any], Any]) -> RobotSystem:
        """Return the same system with what makes its engine."""
        return dataclasses.replace(self, mover=mover)

    @cached_property
    def points(self) -> tuple[ContactPoint, ...]:
        """The contacts of the scene."""
        return contact_points(cast(Any, self.mechanism))

    @property
    def by_phase_time(self) -> bool:
        """Whether a law or an equation goes by the time since a phase began."""
        return bool(self.points) and names_phase_time(self.mechanism.scene)

    def phase(
        self, footings: Sequence[Footing], bare: bool = False, began: float = 0.0, closed: Collection[str] | None = None
    ) -> RobotSystem:
        """Return the system of a phase, compiled anew; see `phase_scene`. Its work states are those of this one."""
        scene = self.mechanism.scene
        made = with_scene(self.mechanism, phase_scene(scene, self.points, footings, bare, began, closed))
        contacts = PhaseContacts(self.points, tuple(footings), len(scene.constraints), self.work_names, began)
        given = (None, None) if bare else (self.inputs or None, self.until)
        system = make_robot_system(made, self.run, *given, self.ends_at)
        return dataclasses.replace(system, contacts=contacts, mover=self.mover)


def make_robot_system(
    mechanism: RobotMechanism, run: Run | None = None, inputs: Sequence[str] | None = None, until: Expression | None = None,
    ends_at: str = "", **options: Any,
) -> RobotSystem:  # fmt: skip
    """Compile all that acts on a mechanism with robots; a run ends where `until` falls through 0, or at the event `ends_at`.

    Of what goes by phases that acts which does while no contact is closed; `RobotSystem.phase` has the others.

    Raises SceneError for what is wrong with it.
    """
    scene = mechanism.scene
    run = msgspec.structs.replace(scene.run if run is None else run, **options)
    if run.engine == "core":
        raise SceneError("run.engine = 'core': scenes with robots run on 'pinocchio' ('auto')")
    if run.knife_edge == "projection":
        raise SceneError("run.knife_edge = 'projection': with robots there are 'reduction' and 'multiplier'")
    quantities, programme = Quantities(mechanism), programme_at(scene)
    names = mechanism.allowed
    welds, edges, held = _frames_held(quantities)
    rows = rows_of(scene if programme is scene.programme else with_values(scene, {"programme": programme, "programmes": ()}))
    drives = drives_of(mechanism)
    ties = ties_of(mechanism)
    equations = [parse_equation(row_of(drive), "links", names) for drive in drives]
    equations += [parse_equation(text, "robots", names) for text in ties.values()]
    equations += [parse_equation(row.equation, row.key, names) for row in (*rows.ideal, *rows.servo, *rows.secondary)]
    roots, forces, elastic = laws_of(quantities, names)
    laws = len(forces)
    forces += [mechanism.names.force(name, "control") for name in inputs or ()]
    controls = mechanism.names.chosen(programme.controls, "programme.controls") if programme else ()
    forces += controls
    along = np.array([_along(quantities, force) for force in forces], np.int64)
    moving = MovingGains() if programme is None else read_moving_gains(mechanism, programme, controls, names)
    asked, events = events_of(scene, names, until, ends_at)
    roots += [*moving.laws, *asked]
    compiled = compile_tape([*equations, *roots], quantities.resolve, mechanism.signals.pieces)
    parameters = parameter_values(numbers_of(scene))
    info = [Constraint(name, not name.startswith("edge:"), False, frozenset(), False) for name in held]
    if scene.on_snow:
        info.append(Constraint("knife_edge", False, False, frozenset(), False))
    info += [Constraint(drive.force, True, False, frozenset(), True) for drive in drives]
    info += [Constraint(name, True, False, frozenset(), False) for name in ties]
    ideal, servo, own = len(info) + len(rows.ideal), len(rows.servo), slice(len(drives) + len(ties), len(equations))
    every = zip((*rows.ideal, *rows.servo, *rows.secondary), equations[own], compiled.rows[own], strict=True)
    for row, equation, facts in every:
        if not facts.moves:
            raise SceneError(f"{row.key}: {equation.text!r} contains no coordinate or rate: nothing can make it true or false")
        info.append(Constraint(row.name, facts.position, facts.angle, equation.names, facts.working))
    if ideal:
        require_decay(run)
    first, second = info[ideal : ideal + servo], info[ideal + servo :]
    plan = None if programme is None else make_robot_plan(mechanism, programme, controls, first, second, run, moving)
    forms = [form_of_row(facts.position, facts.angle) for facts in compiled.rows[: len(equations)]]
    points = contact_points(cast(Any, mechanism))
    seen = np.array([[_seen(quantities, name) for name in point.names] for point in points], np.int64)
    readings = quantities.made()
    parts = tape_parts(compiled.tape, prepared(compiled, parameters, [*equations, *roots]), parameters) | {
        FORM: np.array(forms, np.int64), MEASURED: np.zeros(3 * len(readings.kind)), RESIDUAL: np.zeros(3 * len(forms)),
    }  # fmt: skip
    h, k = gain_table(info, plan, ideal, run.gain)
    law = np.hstack([h, k, -np.eye(len(info))])
    if scene.on_snow and run.knife_edge == "reduction":  # it begins at 0 and stays there
        law[len(held)] = 0.0
    posture = None if programme is None or programme.u0 is not None else posture_of(programme)
    told = _of_phases(mechanism, run, inputs) if goes_by_phase(scene) else None
    told = told or OfPhases(tuple(first), tuple(forces), tuple(force.name for force in controls))
    return RobotSystem(
        mechanism, run, tuple(inputs or ()), tuple(info), welds, edges, held, tuple(forces), laws, tuple(elastic),
        segments_of(mechanism), drives, plan, posture, compiled, parameters, pack(parts), readings, along, law,
        seen.reshape(-1, 3), told, events, until, ends_at,
    )  # fmt: skip


def with_scene(mechanism: RobotMechanism, scene: Scene) -> RobotMechanism:
    """Return a mechanism with a scene whose robots and links are those of its own."""
    made = dataclasses.replace(mechanism, scene=scene)
    made.__dict__.update({name: value for name, value in mechanism.__dict__.items() if name in KEPT})
    return made


def _of_phases(mechanism: RobotMechanism, run: Run, inputs: Sequence[str] | None) -> OfPhases:
    """Collect what acts in some phase. Raises SceneError for a programme that is wrong by itself."""
    scene = mechanism.scene
    without = with_values(scene, {"programme": None, "programmes": (), "forces": tuple(map(always, scene.forces))})
    bare = make_robot_system(with_scene(mechanism, without), run, inputs)
    rows, controls = dict[str, Constraint](), dict[str, RobotForce]()
    for _, part in programmes_of(scene):
        alone = make_robot_system(with_scene(mechanism, phase_scene(scene, (), (), closed=part.closed)), run, inputs)
        rows |= {row.text: row for row in alone.own.rows}
        controls |= {force.name: force for force in alone.forces if force.name in alone.own.controls}
    return OfPhases(tuple(rows.values()), (*bare.forces, *controls.values()), tuple(controls))


def _seen(quantities: Quantities, name: str) -> int:
    return quantities.of(quantities.names.find(name)) if name else -1


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


