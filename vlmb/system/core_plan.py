"""What the compiled core runs of a scene: the plant, and what its numbers mean."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vlmb.core import opcodes as op
from vlmb.core import places, quantities
from vlmb.core import plant as core
from vlmb.core import springs as core_springs
from vlmb.core.along import given_along
from vlmb.core.plant import Memory, Plant, make_memory
from vlmb.core.row_arrays import HELD, PROJECTED, no_rows
from vlmb.core.springs import AngleSprings, line_ups
from vlmb.model.arrays import Arrays, make_arrays, renumbered_arrays
from vlmb.model.frozen import Blank, copied
from vlmb.model.layout import State
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import LOST, STORED, GeneralizedForce, counted
from vlmb.model.quantities import QuantityTable, allowed_names
from vlmb.model.reading import Postures
from vlmb.model.tape import CompiledTape, compile_tape
from vlmb.scene.by_phase import numbers_of
from vlmb.scene.expressions import Equation, Expression
from vlmb.scene.names import PHASE_START, listed
from vlmb.scene.tables import BOUNCE, Run
from vlmb.system.constraints import ConstraintSet
from vlmb.system.contacts import CLOSED, LIGHT, OPEN, RESTING, STANDING, STILL, UNDER, Footing, Look, PhaseContacts
from vlmb.system.contacts import HELD as HELD_STATE
from vlmb.system.core_rows import grip_of, make_rows
from vlmb.system.events import (
    BOTH_WAYS,
    CONTACT,
    DEPENDENT,
    FALL,
    FALLING,
    LIMIT,
    LINE_UP,
    OPENS,
    QUIET,
    REARMS,
    RISING,
    SLIPS,
    STICKS,
    SWITCH,
    TOUCHES,
    Event,
    events_of,
)  # fmt: skip
from vlmb.system.friction import FRICTION_EVENTS
from vlmb.system.point_forces import lengths_of, scene_forces, singular_lengths
from vlmb.system.prescribed import Prescribed
from vlmb.system.programme import ProgrammePlan, control_channels, total_mass
from vlmb.system.ski_contact import ALONG, EDGE, Edge, ski_rows
from vlmb.system.springs import DirectionSpring

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CorePlan:
    """The plant of a scene; nothing in it changes. Every run has a memory of its own."""

    mechanism: Mechanism
    arrays: Arrays
    plant: Plant
    table: QuantityTable
    tape: CompiledTape
    springs: tuple[DirectionSpring, ...]
    laws: tuple[tuple[str, str], ...]  # of every root: the force or length it gives, and its text
    acting: tuple[GeneralizedForce, ...]  # laws first, then inputs
    events: tuple[Event, ...]
    row_names: tuple[str, ...] = ()  # the knife edge where a multiplier holds it, ideal rows, those of the programme, secondary
    controls: tuple[str, ...] = ()  # of the programme
    programme: ProgrammePlan | None = None
    contacts: PhaseContacts | None = None
    seen: int = -1  # the first root of the tape of what is read of contacts: places and gaps

    def __repr__(self) -> str:
        forces = listed([force.name for force in self.acting])
        sizes = f"{self.positions} positions, {self.velocities} velocities, {counted(len(self.events), 'event')}"
        return f"<CorePlan of {self.arrays.scene.name!r}: {sizes}; forces {forces or 'none'}>"

    def with_numbers(self, mechanism: Mechanism) -> CorePlan:
        """Return this plan for a mechanism that differs in its start and in the springs of its segments alone."""
        for name in ("reads_angles", "_blanks", "packed"):  # found once, for all of these
            getattr(self, name)
        arrays = renumbered_arrays(self.arrays, mechanism.scene)
        return copied(self, mechanism=mechanism, arrays=arrays, plant=self.plant._replace(tree=arrays.tree))

    def placed(self, contacts: PhaseContacts) -> CorePlan:
        """Return this plan with the contacts of its phase at other places."""
        numbers = {**self.mechanism.scene.parameters, **contacts.numbers()}
        parameters = np.array([float(numbers[name]) for name in self.table.parameters])
        rows = self.plant.rows._replace(grip=grip_of(contacts))
        return replace(self, plant=self.plant._replace(parameters=parameters, rows=rows), contacts=contacts)

    def begun(self, t: float) -> CorePlan:
        """Return this plan for a phase that began at a time [s]."""
        parameters = np.array(self.plant.parameters)
        parameters[[at for at, name in enumerate(self.table.parameters) if name == PHASE_START]] = t
        return replace(self, plant=self.plant._replace(parameters=parameters))

    def memory(self, inputs: int = 0) -> Memory:
        """Make what evaluations write, with so many forces from outside."""
        if inputs not in self._blanks:
            self._blanks[inputs] = Blank(make_memory(self.plant, self.arrays.given, inputs))
        return self._blanks[inputs].copy()

    @cached_property
    def _blanks(self) -> dict[int, Blank[Memory]]:
        return {}

    @cached_property
    def packed(self) -> list[tuple[State, Array]]:
        """The state that a run began with last, and as the core has it."""
        return []

    @cached_property
    def reads_angles(self) -> bool:
        """Whether a force or a law goes by an azimuth or an elevation in space, whose branch is kept then."""
        return bool(self.table.angles())

    @property
    def positions(self) -> int:
        """Number of positions in a state."""
        return self.arrays.positions

    @property
    def velocities(self) -> int:
        """Number of velocities in a state."""
        return self.arrays.velocities

    @property
    def projected(self) -> bool:
        """Whether velocities are projected onto the knife edge."""
        return len(self.plant.rows.table) > 0 and bool(self.plant.rows.table[0, PROJECTED])

    def spring_angles(self, coordinates: Array) -> Array:
        """Return the signed angles (springs,) [rad] of springs in a plane that coordinates (N,) are on the branch of."""
        layout, found = self.arrays.layout, np.zeros(len(self.springs))
        for k, spring in enumerate(self.springs):
            if layout.plane and min(spring.first, spring.second) >= 0:
                found[k] = coordinates[layout.place("psi", spring.second)] - coordinates[layout.place("psi", spring.first)]
        return found

    def in_line(self, event: Event, memory: Memory, t: float, y: Array) -> float:
        """Return the sine of the angle between the two directions of the spring whose line-up an event is, at a core's state.

        Of a spring between points its length [m].
        """
        if event.which >= 0:
            seen = self.postures(np.array([t]), np.array([y]))
            return float(lengths_of(self.mechanism, event.which, seen)[0])
        line_ups(self.plant.springs, self.plant.tree, y, memory.lines)
        names = [spring.name for spring in self.springs]
        return float(memory.lines[names.index(event.name), 0])

    def given_at(self, memory: Memory, t: Array) -> Array:
        """Return the lengths (N, n, 6) that are not free, with two derivatives, at times t (N,)."""
        found = np.empty((len(t), *self.arrays.given.shape))
        given_along(self.plant, memory, t, found)
        return found

    def postures(self, t: Array, states: Array) -> Postures:
        """Return where every point is at the samples t (N,), states (N, ny)."""
        moving = states[:, : self.positions + self.velocities]
        if not len(self.plant.driven):
            return self.arrays.postures(moving, self.arrays.given)
        return self.arrays.postures(moving, self.given_at(self.memory(), t))


def make_core_plan(
    mechanism: Mechanism, run: Run, springs: Sequence[DirectionSpring], prescribed: Sequence[Prescribed],
    inputs: Sequence[str] | None, work_names: Sequence[str], constraints: ConstraintSet | None = None,
    programme: ProgrammePlan | None = None, watching: bool = False, contacts: PhaseContacts | None = None,
    until: Expression | None = None, ends_at: str = "",
) -> CorePlan:  # fmt: skip
    """Compile what acts on a mechanism for the core.

    Parameters
    ----------
    inputs : forces whose values come from outside; None where nobody is asked for any
    work_names : of the work states in their order
    constraints : ideal rows, those of the programme, secondary ones
    watching : the core only looks for events, on a ski that may slip sideways; another engine moves

    Raises SceneError for an unknown force, ExpressionError for a law that cannot be read.
    """
    sliding = watching or run.knife_edge != "reduction"
    planted = contacts is not None and contacts.planted and not watching
    scene, arrays = mechanism.scene, make_arrays(mechanism.scene, mechanism.layout, sliding, planted=planted)
    numbers = numbers_of(scene)
    table = QuantityTable(mechanism.names, arrays, tuple(numbers), mechanism.signals)
    works = {name: at for at, name in enumerate(work_names)}
    roots: list[Expression | Equation] = []
    laws, forces, acting = list[tuple[str, str]](), [], list[GeneralizedForce]()
    for force, law in scene_forces(mechanism):
        along = table.along(force)
        if not watching:
            account = {STORED: core.IN_SPRING, LOST: core.IN_LOSS}
            forces.append((along, len(roots), account[force.kind] if force.kind in account else works[force.name]))
        roots.append(law)
        laws.append((force.name, law.text))
        acting.append(force)
    if inputs is not None and not arrays.layout.plane:  # a control may read any angle: no step may swing one past its branch
        for i in range(len(arrays.layout.links)):
            table.of(mechanism.names.find(f"psi{i + 1}"))
    for at, name in enumerate(inputs or ()):
        force = mechanism.names.force(name, "control")
        forces.append((table.along(force), -1 - at, works[name]))
        acting.append(force)
    driven = []
    for length in prescribed:
        link, side = _owner(mechanism, length.name)
        driven.append((arrays.rows[link], 3 * (side - 1), len(roots), works.get(length.force, 0)))
        roots.append(length.law.expression)
        laws.append((length.name, roots[-1].text))
    rows = no_rows() if watching else make_rows(mechanism, run, constraints, programme, table, len(roots), works, contacts)
    if len(rows.table) and constraints is not None:
        roots += constraints.roots
    seen = len(roots)
    looks = [] if contacts is None else contacts.looks
    roots += [] if contacts is None else [*contacts.roots, *(look.expression for look in looks)]
    named = len(roots)
    asked, own = events_of(scene, allowed_names(mechanism.names, numbers_of(scene), mechanism.signals), until, ends_at)
    roots += asked
    pushing = [*acting, *(control_channels(mechanism) if programme is not None else ())]
    reaches = bool(driven) and any(force.kind in ("point", STORED, LOST) for force in pushing)
    slides = scene.base.friction > 0.0 and not watching and not scene.base.lift
    centre, mass = table.of(mechanism.names.find("com.z")) if slides else -1, total_mass(mechanism)
    friction = scene.base.friction, mass, mass * (scene.gravity or 1.0), float(scene.base.friction_on == "resultant")
    compiled = compile_tape(roots, table.resolve, table.signals.pieces, seen)
    pairs, constants = _angle_springs(arrays, springs)
    watch, bounds, events = _watched(mechanism, run, table, compiled, springs)
    tape = compiled.tape
    if contacts is not None:
        light = LIGHT * total_mass(mechanism) * (scene.gravity or 1.0)
        tape = _watch_contacts(contacts, looks, compiled, seen, light, watch, bounds, events)
    if asked:
        watch += [(core.SWITCH, len(tape.switch) + k) for k in range(len(asked))]
        bounds += [(1.0, 0.0)] * (len(watch) - len(bounds))
        events += own
        tape = _with_switches(tape, range(named, named + len(asked)))
    timed = any(root.names & {"t", *table.signals} for root in roots)
    looked_at = watching or inputs is not None or _reads_angles(table) or timed
    if not events and (looked_at or len(rows.table)):
        watch, bounds, events = [(core.NOTHING, 0)], [(1.0, 0.0)], [Event(QUIET, FALLING, "", "")]
    read = [which for form, which in watch if form in (core.QUANTITY, core.GROWTH)]
    looked = sorted({*read, *(tape.used.tolist() if len(tape.switch) else ())})
    plant = Plant(
        tree=arrays.tree, quantities=table.made(), tape=tape,
        parameters=np.array([float(numbers[name]) for name in table.parameters]),
        force=np.array(forces, np.int64).reshape(-1, 3), driven=np.array(driven, np.int64).reshape(-1, 4),
        springs=AngleSprings(pairs, constants), watch=np.array(watch, np.int64).reshape(-1, 2), looked=np.array(looked, np.int64),
        bound=np.array(bounds, float).reshape(-1, 2), rows=rows, sliding=np.array(friction if centre >= 0 else ()),
        size=np.array([len(works), works.get("dissipation", -1), centre, reaches], np.int64),
    )  # fmt: skip
    names = (*(("knife_edge",) if len(rows.table) and rows.table[0, HELD] else ()), *(constraints.texts if constraints else ()))
    return CorePlan(
        mechanism, arrays, plant, table, compiled, tuple(springs), tuple(laws), tuple(acting), tuple(events), names,
        programme.names if programme is not None else (), programme, contacts, seen,
    )  # fmt: skip


def _watch_contacts(
    contacts: PhaseContacts, looks: Sequence[Look], compiled: CompiledTape, seen: int, light: float,
    watch: list[tuple[int, int]], bounds: list[tuple[float, float]], events: list[Event],
) -> op.Tape:  # fmt: skip
    """Add the indicators of contacts, and return the tape with their gaps among what is looked at after a step."""
    tape, closed = compiled.tape, 0
    first = len(tape.switch)
    for k, (point, footing) in enumerate(zip(contacts.points, contacts.footings, strict=True)):
        if footing.state == RESTING:
            closed += 1
        elif footing.state in CLOSED and point.edge is not None:
            at = next(at for other, _, at, _ in contacts.closed if other is point)
            bounds += [(1.0, 0.0)] * (len(watch) - len(bounds))
            for form, which, kind, part, side in _looks_of_ski(point.edge, footing, at):
                watch.append((form, closed if form == core.HOLDS else which))
                bounds.append((side, float(at)))
                events.append(Event(CONTACT, FALLING, kind, "", k, part, STILL if kind == STICKS else light))
            closed += 1
        elif footing.state in CLOSED:
            forms = [(core.HOLDS, OPENS)]
            if point.contact.slips:
                forms.append((core.GRIPS, SLIPS) if footing.state == HELD_STATE else (core.STOPS, STICKS))
            for form, kind in forms:
                watch.append((form, closed))
                events.append(Event(CONTACT, FALLING, kind, "", k, slack=STILL if kind == STICKS else light))
            closed += 1
        elif footing.state != STANDING and point.lands:
            armed = footing.state == OPEN
            watch.append((core.SWITCH, first + k))
            name = TOUCHES if armed else REARMS
            events.append(Event(CONTACT, FALLING if armed else RISING, name, "", k, slack=UNDER if armed else 0.0))
    gaps = [seen + 4 * k + 3 for k in range(len(contacts.points))]
    first += len(gaps)
    for k, look in enumerate(looks):
        watch.append((core.SWITCH, first + k))
        events.append(look.event)
    bounds += [(1.0, 0.0)] * (len(watch) - len(bounds))
    after = seen + 4 * len(gaps)
    return _with_switches(tape, [*gaps, *range(after, after + len(looks))])


def _looks_of_ski(edge: Edge, footing: Footing, at: int) -> Iterator[tuple[int, int, str, int, float]]:
    """Yield form, which, kind, part and side of the indicators of a closed ski, whose rows begin at an ideal row."""
    rows = ski_rows(footing.state == HELD_STATE, footing.first)
    yield core.HOLDS, at, OPENS, EDGE, 1.0
    ratios, ways = (edge.hold if edge.limited else 0.0, edge.friction), footing.towards[1::-1]
    for part, velocity in ((EDGE, 1), (ALONG, 0)):  # the sideways velocity is the second
        if ratios[part] > 0.0 and part in rows:
            yield core.BITES, at + rows.index(part), SLIPS, part, ratios[part]
        elif ratios[part] > 0.0:
            yield core.MOVES, velocity, STICKS, part, math.copysign(1.0, ways[part])


def _with_switches(tape: op.Tape, roots: Iterable[int]) -> op.Tape:
    """Return a tape with more that is looked at after a step: the values of roots."""
    more = [[int(tape.root[root]), -1, op.EDGE, op.OF_STATE] for root in roots]
    return tape._replace(switch=np.vstack([tape.switch.reshape(-1, 4), np.array(more, np.int64)]))


def _owner(mechanism: Mechanism, coordinate: str) -> tuple[int, int]:
    """Return link and segment (1 lower, 2 upper) of a length by its coordinate's name."""
    found = mechanism.names.find(coordinate)
    return found.link, found.segment


def _angle_springs(arrays: Arrays, springs: Sequence[DirectionSpring]) -> tuple[NDArray[np.int64], Array]:
    pairs, constants = np.zeros((len(springs), 3), np.int64), np.zeros((len(springs), 3))
    for k, spring in enumerate(springs):
        ends = [spring.first, spring.second]
        on_base = min(ends) < 0
        if on_base:
            ends.sort()
        form = core_springs.ON_BASE if on_base else core_springs.IN_PLANE if arrays.layout.plane else core_springs.LINKS
        own = {-1: places.NORMAL, -2: places.HEADING}
        pairs[k] = *(arrays.rows[end] if end >= 0 else own[end] for end in ends), form
        constants[k] = spring.stiffness, spring.damping, spring.rest
    return pairs, constants


def _watched(
    mechanism: Mechanism, run: Run, table: QuantityTable, compiled: CompiledTape, springs: Sequence[DirectionSpring]
) -> tuple[list[tuple[int, int]], list[tuple[float, float]], list[Event]]:
    """List the indicators: lengths against their limits, points against the snow, switches of laws, line-ups of springs."""
    watch: list[tuple[int, int]] = []
    bounds: list[tuple[float, float]] = []
    events: list[Event] = []

    def add(form: int, which: int, side: float, bound: float, event: Event) -> None:
        watch.append((form, which))
        bounds.append((side, bound))
        events.append(event)

    for c in mechanism.layout.coordinates:
        if c.kind == "xi" and mechanism.segment(c).at_limit != BOUNCE:
            for bound, side in zip(mechanism.segment(c).bounds, (1.0, -1.0), strict=True):
                if math.isfinite(bound):
                    place = table.of(mechanism.names.find(c.name))
                    sentence = f"{c.name} reached its limit {bound:g} m"
                    add(core.QUANTITY, place, side, bound, Event(LIMIT, FALLING, c.name, sentence))
    if run.fall and mechanism.layout.on_snow:
        for link in mechanism.layout.links:
            for point in (f"{link.name}.rod_end", f"{link.name}.tip"):
                place = table.of(mechanism.names.find(f"{point}.z"))
                add(core.QUANTITY, place, 1.0, 0.0, Event(FALL, FALLING, point, f"fall: {point} reached the snow"))
    for k, (_, operation, kind, depends) in enumerate(compiled.tape.switch.tolist()):
        if depends == op.OF_STATE and kind != op.EDGE:
            add(core.SWITCH, k, 1.0, 0.0, Event(SWITCH, BOTH_WAYS, compiled.source(operation), ""))
    for k, spring in enumerate(springs):
        way = spring.singular_line_up(mechanism.layout)
        if way is not None:
            own = {-1: "the base", -2: "the heading"}
            first, second = (own.get(i) or mechanism.layout.links[i].name for i in (spring.first, spring.second))
            sentence = f"{spring.name}: {first} and {second} line up, where its torque has no axis to turn about"
            add(core.LINE_UP, k, 1.0, way, Event(LINE_UP, way, spring.name, sentence))
    for index, sentence in singular_lengths(mechanism):
        name = f"springs[{index}]"
        at = table.place((quantities.HALF_SQUARE, *list(table.rows)[table.lengths[name]][1:]), name)
        add(core.GROWTH, at, 1.0, 0.0, Event(LINE_UP, RISING, name, sentence, index))
    if mechanism.scene.base.friction and not mechanism.scene.base.lift:
        for form, event in zip((core.STANDS, core.SLIPS, core.LIFTS, core.YIELDS), FRICTION_EVENTS, strict=True):
            add(form, 0, 1.0, 0.0, event)
    held = mechanism.layout.edged and run.knife_edge != "reduction"
    if len(mechanism.scene.constraints) + held:
        add(core.WORTH_OF_ROWS, 0, 1.0, 0.0, Event(DEPENDENT, FALLING, "the ideal constraints", ""))
    return watch, bounds, events


def _reads_angles(table: QuantityTable) -> bool:
    return any(name.removesuffix("_dot").startswith(("phi", "psi")) for name in table.labels)
