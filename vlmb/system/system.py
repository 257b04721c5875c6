"""The system: a mechanism and all that acts on it, compiled once."""

from __future__ import annotations

import dataclasses
import operator
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, nearest
from vlmb.model.frozen import copied
from vlmb.model.laws import breaks_within
from vlmb.model.layout import SegmentIndex
from vlmb.model.mechanism import Mechanism
from vlmb.scene.by_phase import goes_by_phase, numbers_of, programme_at, programmes_of
from vlmb.scene.expressions import Expression
from vlmb.scene.names import listed
from vlmb.scene.renumbered import differ_in_numbers
from vlmb.scene.rows import rows_of
from vlmb.scene.scene import Scene
from vlmb.scene.tables import Run, Segment
from vlmb.system.constrained import SIDEWAYS
from vlmb.system.constraints import Constraint, ConstraintSet
from vlmb.system.contacts import ContactPoint, Footing, PhaseContacts, phase_scene
from vlmb.system.core_plan import CorePlan, make_core_plan
from vlmb.system.forces import AppliedForces, Control, applied_forces
from vlmb.system.gains import require_decay
from vlmb.system.pace import names_phase_time, timed_laws
from vlmb.system.prescribed import Prescribed, prescribed_segments
from vlmb.system.programme import ProgrammePlan, control_channels, make_plan
from vlmb.system.programme_rows import read_rows
from vlmb.system.springs import DirectionSpring, direction_springs, free_segments
from vlmb.system.stops import all_points
from vlmb.system.work_names import names_of_work
from vlmb.system.workspace import Workspace

Array = NDArray[np.float64]

KNIFE_EDGES = ("reduction", "multiplier", "projection")
OF_THE_MARCH = ("duration", "rtol", "atol", "samples", "max_step")  # options that are no equation's
_of_equations = operator.attrgetter(*(key for key in Run.__struct_fields__ if key not in OF_THE_MARCH))
RECENT = 4
_made: tuple[tuple[System, tuple[Any, ...]], ...] = ()  # the last ones: runs of one mechanism share what is compiled
_akin: tuple[Scene, Scene] | None = None  # the last two scenes that were seen to differ in numbers


class OfPhases(NamedTuple):
    """What has been compiled of the phases of a system: its runs share it. By how contacts stand; by what acts beside them."""

    systems: dict[object, System]
    probes: dict[object, Any]


@dataclass(frozen=True, eq=False)
class System:
    """A mechanism, all that acts on it, and the options that its equations depend on. Nothing in it changes.

    It serves check, start, run and trajectory; every run has a `workspace` of its own. A pickle carries what it was made of.
    """

    mechanism: Mechanism
    run: Run
    segments: tuple[tuple[Segment, SegmentIndex], ...]  # free ones, with their springs
    direction_springs: tuple[DirectionSpring, ...]
    prescribed: tuple[Prescribed, ...]
    forces: AppliedForces
    constraints: ConstraintSet | None  # ideal rows, rows of the programme, secondary ones
    programme: ProgrammePlan | None
    contacts: PhaseContacts | None = None  # of a phase
    until: Expression | None = None  # a run ends where it falls through 0
    ends_at: str = ""  # the event of the scene at which a run ends
    by_phase: tuple[Constraint, ...] = ()  # rows of programmes that act in some phases only

    def __repr__(self) -> str:
        parts = [f"{self.engine} engine, knife edge {self.knife_edge}"]
        for what, names in (
            ("forces", [channel.name for channel in self.forces.named]),
            ("prescribed", [at.name for at in self.prescribed]),
            ("rows", [row.name for row in (*rows_of(self.mechanism.scene).ideal, *rows_of(self.mechanism.scene).servo)]),
            ("controls", list(self.programme.names if self.programme else ())),
        ):
            parts += [f"{what} {listed(names)}"] if names else []
        return f"<System of {self.mechanism.scene.name!r}: {'; '.join(parts)}>"

    def __reduce__(self) -> tuple[Any, ...]:
        return make_system, (self.mechanism, self.run, self.forces.inputs)

    def workspace(self, control: Control | None = None, branch: Sequence[float] | None = None) -> Workspace:
        """Make the buffers of one run. `control` gives the inputs; `branch` (N,) is the one that angles are first read on."""
        return Workspace(self, control, branch)

    def with_run(self, run: Run) -> System:
        """Return this system with a run of the same equations: nothing is compiled again."""
        return copied(self, run=run)

    def with_inputs(self, names: Sequence[str]) -> System:
        """Return this system with forces from outside, by name; nothing is compiled again."""
        return dataclasses.replace(self, forces=applied_forces(self.mechanism, names))

    def with_numbers(self, mechanism: Mechanism, run: Run) -> System:
        """Return this system for a mechanism whose scene differs in numbers, and a run of the same equations. For the core.

        Nothing is compiled again.
        """
        for name in ("timed", "work_names", "points", "reads_angles", "angled", "starts"):  # found once, for all of these
            getattr(self, name)
        plan, segments = self.core_plan.with_numbers(mechanism), tuple(free_segments(mechanism))
        made = copied(self, mechanism=mechanism, run=run, segments=segments, core_plan=plan)
        for name in ("watch_plan", "of_phases"):  # what has such numbers
            made.__dict__.pop(name, None)
        return made

    @property
    def knife_edge(self) -> str:
        """Form of the knife edge; "none" without a ski, and where its edge is held by a contact."""
        return self.run.knife_edge if self.mechanism.layout.edged else "none"

    @property
    def info(self) -> tuple[Constraint, ...]:
        """The ideal rows, then those of the programme."""
        count = len(self.mechanism.scene.constraints) + len(self.programme.texts if self.programme else ())
        return self.constraints.info[:count] if self.constraints else ()

    @property
    def prescribed_dofs(self) -> list[int]:
        """Velocities of known acceleration: prescribed segments', and what is crossed out: a planted base's, a ski's sideways."""
        sideways = [SIDEWAYS] if self.knife_edge == "reduction" else []
        return [*(at.v for at in self.prescribed), *self.planted_dofs, *sideways]

    @property
    def planted_dofs(self) -> list[int]:
        """Velocities of a free base that a contact holds."""
        planted = self.contacts is not None and self.contacts.planted
        return [*range(self.mechanism.layout.base_size)] if planted else []

    @cached_property
    def work_names(self) -> tuple[str, ...]:
        """Names of the work states: forces, ideal rows that work, what contacts take, and "dissipation"; in a phase the run's."""
        if self.contacts is not None:
            return self.contacts.works
        working = [row.text for row in self.info[: len(self.mechanism.scene.constraints)] if row.working]
        dampers = [spring.damping for spring in self.direction_springs] + [segment.damping for segment, _ in self.segments]
        dampers += [leg.damping for leg in self.mechanism.scene.legs]
        return names_of_work(self.mechanism, working, self.forces, self.prescribed, self.points, dampers)

    @cached_property
    def points(self) -> tuple[ContactPoint, ...]:
        """The contacts of the scene, then its legs, then stops of lengths."""
        return all_points(self.mechanism)

    @cached_property
    def of_phases(self) -> OfPhases:
        """What its runs have compiled of its phases."""
        return OfPhases({}, {})

    @cached_property
    def starts(self) -> dict[float, tuple[Mapping[str, float], Any]]:
        """The start that was found last where it goes by [start] alone, with that; by the time."""
        return {}

    def placed(self, footings: Sequence[Footing]) -> System:
        """Return this system of a phase with its contacts at other places: nothing is compiled again. For the core."""
        assert self.contacts is not None
        contacts, plan = dataclasses.replace(self.contacts, footings=tuple(footings)), self.core_plan
        made = dataclasses.replace(self, contacts=contacts)
        made.__dict__.update(core_plan=plan.placed(contacts), work_names=self.work_names)
        return made

    def with_scene(self, scene: Scene) -> Mechanism:
        """Return the mechanism with a scene whose links are those of this one."""
        return copied(self.mechanism, scene=scene)

    def phase(
        self, footings: Sequence[Footing], bare: bool = False, began: float = 0.0, closed: Collection[str] | None = None
    ) -> System:
        """Return the system of a phase, compiled anew; see `phase_scene`. Its work states are those of this one."""
        scene = self.mechanism.scene
        made = self.with_scene(phase_scene(scene, self.points, footings, bare, began, closed))
        contacts = PhaseContacts(self.points, tuple(footings), len(scene.constraints), self.work_names, began)
        system = make_system(made, self.run, None if bare else self.forces.inputs, contacts)
        return dataclasses.replace(system, until=None if bare else self.until, ends_at=self.ends_at)

    @cached_property
    def timed(self) -> bool:
        """Whether a law or an equation goes by the time."""
        return bool(timed_laws(self.mechanism.scene))

    @property
    def size(self) -> int:
        """Numbers in y = (q, v, work)."""
        return self.mechanism.layout.nq + self.mechanism.layout.nv + len(self.work_names)

    @cached_property
    def engine(self) -> str:
        """What evaluates the motion: `core`, or `pinocchio` where it is asked for, and where rows hold what has no inertia."""
        weak = self.mechanism.massless or (self.mechanism.warnings and self.mechanism.scene.constraints)
        return "pinocchio" if self.run.engine == "pinocchio" or (weak and self.run.engine == "auto") else "core"

    @cached_property
    def core_plan(self) -> CorePlan:
        """What the compiled core runs."""
        return make_core_plan(
            self.mechanism, self.run, self.direction_springs, self.prescribed, self.forces.inputs, self.work_names,
            self.constraints, self.programme, contacts=self.contacts, until=self.until, ends_at=self.ends_at,
        )  # fmt: skip

    @cached_property
    def watch_plan(self) -> CorePlan:
        """What the core looks for where Pinocchio moves."""
        return make_core_plan(
            self.mechanism, self.run, self.direction_springs, self.prescribed, None, (), watching=True, contacts=self.contacts,
            until=self.until, ends_at=self.ends_at,
        )  # fmt: skip

    @cached_property
    def reads_angles(self) -> bool:
        """Whether forces need the branch of an angle, and so the last accepted sample."""
        angular = any(channel.kind in ("phi", "psi") for channel in self.forces.channels)
        outside = self.forces.inputs is not None
        return self.constraints is not None or outside or (bool(angular or self._named) and not self.mechanism.layout.plane)

    @cached_property
    def angled(self) -> frozenset[int]:
        """Links whose azimuth or elevation a force or an equation goes by; those of a regular form do not count."""
        layout = self.mechanism.layout
        if self.forces.inputs is not None:
            return frozenset(range(len(layout.links)))
        acting = {*self.forces.channels, *control_channels(self.mechanism)}
        return self._named | {channel.link for channel in acting if channel.kind in ("phi", "psi")}

    @cached_property
    def _named(self) -> frozenset[int]:
        """Links whose azimuth or elevation an equation or a law names."""
        info = self.constraints.info if self.constraints else ()
        rows = [row.regular.names if row.regular else row.names for row in info]
        rows += [law.names for law in self.constraints.behind] if self.constraints else []
        names, own = self.mechanism.names, {"t", *numbers_of(self.mechanism.scene), *self.mechanism.signals}
        read = [names.find(name) for group in (*rows, *(law.names for law in self.forces.written)) for name in group - own]
        return frozenset(quantity.link for quantity in read if quantity.kind in ("phi", "psi"))

    def breaks(self, start: float, end: float) -> set[float]:
        """Return the times in [start, end] where a law, an equation or a gain switches. Raises SceneError for too many."""
        acting = (self.forces if self.forces.channels else None, self.constraints)
        return set().union(*(breaks_within(made.breaks, start, end) for made in acting if made))

    @cached_property
    def by_phase_time(self) -> bool:
        """Whether a law or an equation goes by the time since a phase began."""
        return bool(self.points) and names_phase_time(self.mechanism.scene)

    def is_holonomic(self, text: str) -> bool:
        """Whether a row, by its equation, is one of positions."""
        return any(row.holonomic for row in (*self.info, *self.by_phase) if row.text == text)


def make_system(
    mechanism: Mechanism, run: Run | None = None, inputs: Sequence[str] | None = None,
    contacts: PhaseContacts | None = None, **options: Any,
) -> System:  # fmt: skip
    """Compile all that acts on a mechanism.

    Parameters
    ----------
    run : None means the scene's; `options` are put over it, such as knife_edge="multiplier", gain=0.0
    inputs : names of forces whose values come from outside, as of a control; contacts: of a phase

    Raises SceneError for what is wrong with forces, equations, programme, gains or options.
    """
    run = mechanism.scene.run if run is None else run
    run = msgspec.structs.replace(run, **options) if options else run
    if inputs is None and contacts is None:
        return _shared(mechanism, run)
    return _compiled(mechanism, run, inputs, contacts)


def known_mechanism(scene: object) -> Mechanism | None:
    """Return the mechanism of a scene that differs from those of the last runs in numbers alone; None for another."""
    if not isinstance(scene, Scene):
        return None
    for made, _ in _made:
        if made.mechanism.scene is scene:
            return made.mechanism
    akin = next((made for made, _ in _made if _are_akin(made.mechanism.scene, scene)), None)
    return None if akin is None else akin.with_scene(scene)


def _are_akin(one: Scene, other: Scene) -> bool:
    """Whether scenes differ in numbers alone; a run asks it twice, once for its mechanism and once for its equations."""
    global _akin
    last = _akin
    if last is not None and last[0] is one and last[1] is other:
        return True
    if not differ_in_numbers(one, other):
        return False
    _akin = one, other
    return True


def _shared(mechanism: Mechanism, run: Run) -> System:
    """Return a system made before of the same mechanism and equations, with other options of its march; else a new one.

    It is compiled again only where the scene differs from others before in more than numbers.
    """
    global _made
    own = _of_equations(run)
    before = [made for made, equations in _made if equations == own]
    for made in before:
        if made.mechanism is mechanism:
            return made.with_run(run)
    ran = [made for made in before if "core_plan" in made.__dict__ and made.engine == "core"]
    akin = next((made for made in ran if _are_akin(made.mechanism.scene, mechanism.scene)), None)
    system = _compiled(mechanism, run) if akin is None else akin.with_numbers(mechanism, run)
    _made = ((system, own), *_made[: RECENT - 1])
    return system


def _compiled(
    mechanism: Mechanism, run: Run, inputs: Sequence[str] | None = None, contacts: PhaseContacts | None = None
) -> System:
    scene = mechanism.scene
    if run.knife_edge not in KNIFE_EDGES:
        raise SceneError(f"knife_edge = {run.knife_edge!r}: no such knife_edge; {nearest(run.knife_edge, KNIFE_EDGES)}")
    if scene.base.friction_on == "resultant" and run.knife_edge == "reduction":
        raise SceneError(
            'base.friction_on = "resultant": it goes by the edge force, which the knife edge as a reduction leaves out; set '
            'run.knife_edge = "multiplier"'
        )
    if mechanism.massless and (run.engine == "core" or run.knife_edge == "projection"):
        key, value = ("engine", "pinocchio") if run.engine == "core" else ("knife_edge", "multiplier")
        raise SceneError(f'{mechanism.massless[0]}, or let ideal rows hold it with run.{key} = "{value}"')
    springs, prescribed = direction_springs(mechanism), prescribed_segments(mechanism)
    forces, (rows, moving), plan = applied_forces(mechanism, inputs), read_rows(mechanism, contacts), None
    held = mechanism.layout.edged and run.knife_edge != "reduction"
    if held or scene.constraints:
        require_decay(run)
    programme = programme_at(scene)
    if programme is not None:
        assert rows is not None
        servo = len(scene.constraints) + len(programme.constraints)
        plan = make_plan(mechanism, programme, rows.info[len(scene.constraints) : servo], rows.info[servo:], run, moving)
    system = System(mechanism, run, tuple(free_segments(mechanism)), springs, prescribed, forces, rows, plan, contacts)
    return dataclasses.replace(system, by_phase=_rows_by_phase(system, run)) if goes_by_phase(scene) else system


def _rows_by_phase(system: System, run: Run) -> tuple[Constraint, ...]:
    """Return the rows of all programmes that act in some phases only. Raises SceneError for one that is wrong by itself."""
    found = list[Constraint]()
    for _, part in programmes_of(system.mechanism.scene):
        alone = make_system(system.with_scene(phase_scene(system.mechanism.scene, (), (), closed=part.closed)), run)
        found += alone.info[len(system.mechanism.scene.constraints) :]
    return tuple(found)
