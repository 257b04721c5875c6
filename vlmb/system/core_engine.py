"""The compiled core as an engine: the buffers of one run, its requests answered, its codes as sentences."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vlmb.core.calls import onto_edge, run
from vlmb.core.constraints import SIDEWAYS
from vlmb.core.contacts import ALONG
from vlmb.core.driver import (
    ACCEPT,
    EVALUATE,
    FAILED,
    FAILURE,
    FIRST_FAILURE,
    GO,
    INDICATE,
    LOOK,
    RATE,
    TIME,
    VALUE,
    Driver,
    make_driver,
)
from vlmb.core.plant import FROM_SIDE, SOURCES
from vlmb.core.row_arrays import PROJECTION, WORTH, WORTH_BOUND, parts, sizes_of
from vlmb.core.scratch import GROUND
from vlmb.core.sliding import ANSWER, FOUND, MODE, MU, NORMAL, SLIDES
from vlmb.core.tree import AT_P
from vlmb.errors import SimulationError, VlmbError
from vlmb.model.layout import State
from vlmb.model.mechanism import Mechanism
from vlmb.model.reading import read_along
from vlmb.system.answering import march_answered
from vlmb.system.contacts import ContactLook
from vlmb.system.core_faults import fault
from vlmb.system.core_plan import CorePlan
from vlmb.system.core_rows import solved_programme
from vlmb.system.diagnostics import HUGE
from vlmb.system.events import DEPENDENT, Event
from vlmb.system.forces import Control, ControlReader, StateView, known_rows
from vlmb.system.friction import NO_HOLD, Hold, hold_of, refuse_lift
from vlmb.system.programme import weakness
from vlmb.system.readings import beside_pole
from vlmb.system.worth import LOOKED_AT, RowState

Array = NDArray[np.float64]

FIRST_SLICE = 200  # evaluations with a control
NO_BOUNDS = np.zeros((0, 3))
QUICK = 1_000_000  # numbers of states that evaluations take in about 0.01 s


class CoreEngine:
    """Accelerations of one run by the compiled core; y = (positions, velocities, work). One thread at a time."""

    name = "core"

    def __init__(self, mechanism: Mechanism, plan: CorePlan, control: Control | None, inputs: Sequence[str]) -> None:
        self.mechanism, self.plan = mechanism, plan
        self.size = plan.positions + plan.velocities + int(plan.plant.size[0])
        self.memory = plan.memory(len(inputs))
        self.reader = None if control is None else ControlReader(control, inputs)
        self.branch = self.start = np.zeros(0)  # coordinates near which angles are read, now and at the start: see `take_branch`
        self.asked: list[Array] = []  # the forces of the control at the samples taken so far
        self.branches: list[Array] = []  # and the coordinates near which it read angles
        self.errors: list[VlmbError] = []  # of the control, since the last accepted step
        self.dependent = next((k for k, event in enumerate(plan.events) if event.kind == DEPENDENT), -1)
        self.look_at(LOOKED_AT[0])
        self.programme, self.grip = plan.programme, 0.0  # smallest singular value of G at the first accepted state

    @cached_property
    def single(self) -> Driver:
        """The driver of single questions."""
        return make_driver("euler", self.size, directions=np.zeros(len(self.plan.events)))

    @property
    def first_slice(self) -> int:
        """Evaluations of the first slice."""
        return FIRST_SLICE if self.reader is not None else max(FIRST_SLICE, QUICK // self.size)

    @property
    def events(self) -> tuple[Event, ...]:
        """What is looked for after every step."""
        return self.plan.events

    def pack(self, state: State) -> Array:
        """Return y for Pinocchio's state, with no work done."""
        known = next((y for before, y in self.plan.packed if before is state), None)
        if known is None:
            known = np.concatenate([self.plan.arrays.pack(state.q, state.v), np.zeros(int(self.plan.plant.size[0]))])
            self.plan.packed[:] = [(state, known)]
        return np.array(known)

    def take_branch(self, coordinates: Sequence[float] | Array) -> None:
        """Read angles near these coordinates (N,) from now on."""
        self.branch = self.start = np.array(coordinates)
        if len(self.memory.reference):
            self.memory.reference[:] = self.plan.table.reference(self.start)
        if len(self.memory.near):
            self.memory.near[:] = self.plan.spring_angles(self.start)

    def run(self, driver: Driver, bounds: Array, h_max: float) -> int:
        """Go on to the next thing that only the caller can answer: see the codes of `vlmb.core.driver`."""
        if self.reader is None:
            if self.programme is not None and not self.grip:
                self.accept(float(driver.real[TIME]), driver.point)
            if self.plan.reads_angles and not len(self.memory.branches):
                self.memory = self.memory._replace(branches=np.zeros((len(driver.times), *self.memory.reference.shape)))
            return run(self.plan.plant, self.memory, driver, bounds, h_max, GO)
        return march_answered(self, driver, bounds, h_max)

    def evaluate(self, t: float, y: Array) -> Array:
        """Return y' at (t, y). Raises what `fault` names."""
        if self.reader is not None:
            self._ask(t, y)
        self._question(t, y)
        dy = np.array(self.single.slope)
        if not np.isfinite(dy).all():
            raise SimulationError("the accelerations are not finite: a position, velocity or force is too large to compute with")
        return dy

    def accept(self, t: float, y: Array) -> None:
        """Take a state as the one near which angles are read. Raises SingularError beyond a programme's singular posture."""
        if self.programme is not None:
            self.evaluate(t, y)
            self.grip = self.grip or float(np.linalg.svd(self._matrix(), compute_uv=False)[-1])
        self._accepted(t, y)

    def _accepted(self, t: float, y: Array) -> None:
        if self._answer(ACCEPT, t, y) == FAILED:
            raise self.fault(FROM_SIDE * SOURCES)
        self._follow(t, y)

    def _follow(self, t: float, y: Array) -> None:
        if self.reader is not None:
            self.branch = self.view(t, y).coordinates

    def _answer(self, wanted: int, t: float, y: Array) -> int:
        """Have one question at (t, y) answered in `single`; return its code."""
        self.single.real[TIME], self.single.point[:] = t, y
        return int(run(self.plan.plant, self.memory, self.single, NO_BOUNDS, np.inf, wanted))

    def settle(self, t: float, y: Array) -> Hold:
        """Let the ski slide or stand from (t, y) on, as friction has it there. Raises SimulationError where it would lift."""
        if not len(self.plan.plant.sliding):
            return NO_HOLD
        found = self.memory.sliding[FOUND]
        found[MODE] = np.nan
        self.evaluate(t, y)
        found[MODE], mu = found[SLIDES], float(self.plan.plant.sliding[MU])
        refuse_lift(float(found[NORMAL]), float(found[ANSWER]), mu)
        return hold_of(found, mu)

    def in_line(self, event: Event, t: float, y: Array) -> float:
        """Return the sine of the angle between the two directions of a spring; of one between points its length [m]."""
        return self.plan.in_line(event, self.memory, t, y)

    def why(self, t: float, y: Array) -> str:
        """Add what the programme and azimuths say about a place where a run failed; the core's codes name all else."""
        weak = "" if self.programme is None else weakness(self.programme, self._matrix(), self.grip)
        seen = dict(zip(self.mechanism.layout.names, self.view(t, y).coordinates.tolist(), strict=True))
        return weak + beside_pole(self.mechanism, seen)

    def _matrix(self) -> Array:
        """Return G of the programme at the last solution."""
        return solved_programme(self.plan.plant.rows, self.memory.rows)[0]

    def raised(self, error: BaseException) -> bool:
        """Whether an error is one that the control raised."""
        return self.reader is not None and error is self.reader.failure

    def note(self, t: float, y: Array) -> None:
        """Record the forces of the control, and the branch of angles, at a state that is kept as a sample."""
        if self.reader is not None:
            self.branches.append(self.branch)
            self.asked.append(np.array(self._ask(t, y)))

    def stored(self, t: Array, states: Array) -> Array:
        """Return the samples as a trajectory stores them: velocities on the knife edge where they are projected."""
        if not self.plan.projected:
            return states
        found, dy = np.array(states), np.zeros(self.size)
        for time, y in zip(t.tolist(), found, strict=True):
            if onto_edge(self.plan.plant, self.memory, time, y, dy) == 0:
                y[:] = self.memory.rows.state[PROJECTION]
        return found

    def sampled(self, t: Array, states: Array) -> tuple[Array, Array]:
        """Return the forces (N, S) of the control at samples, nan where not known, and the branches (N or 1, coordinates)."""
        return known_rows(self.asked, len(t), len(self.memory.inputs)), self._branches_at(t, states)

    def _branches_at(self, t: Array, states: Array) -> Array:
        """Return the branches at samples where a force or the control reads angles; others go on from that of the start."""
        if self.reader is not None:
            return np.array([*self.branches[: len(t)], *[self.branch] * (len(t) - len(self.branches))])
        if not self.plan.reads_angles:
            return self.start[None]
        found = read_along(self.plan.postures(t, states), t, self.start[None])[0]
        kept = min(int(self.memory.kept[0]), len(t))
        references = np.concatenate([self.memory.branches[:kept], np.tile(self.memory.reference, (len(t) - kept, 1, 1))])
        for k, at in self.plan.table.angles():
            found[:, at - 1 : at + 1] = references[:, k]
        return found

    def indicators(self, t: float, y: Array) -> Array:
        """Return the indicators of all events and their rates (2, e)."""
        slides = len(self.plan.plant.sliding) > 0 or len(self.plan.plant.rows.contacts) > 0
        if self.dependent >= 0 or slides:
            self._answer(EVALUATE, t, y)
        if not slides:
            self.single.slope[:] = 0.0
        self._answer(LOOK, t, y)
        return np.array(self.single.indicators[VALUE : RATE + 1])

    def inputs_at(self, t: float, y: Array) -> list[float]:
        """Ask the control, once, for the forces (S,) that it gives at a state."""
        return list(self._ask(t, y)) if self.reader is not None else []

    def hold_inputs(self, values: Sequence[float] | Array) -> None:
        """Let forces from outside have these values (S,), where no control is asked for them."""
        self.memory.inputs[:] = values

    def controls(self) -> dict[str, float]:
        """Return the controls of the programme at the last evaluation, by name."""
        rows = self.plan.plant.rows
        if self.programme is None:
            return {}
        sizes = sizes_of(rows)
        count = int(sizes.controls)
        values = parts(sizes, self.memory.rows).shares[:count] * self.programme.scales
        return dict(zip(self.plan.controls, values.tolist(), strict=True))

    def look_at_contacts(self, t: float, y: Array) -> ContactLook:
        """Return places and gaps of all contacts with two derivatives, and what holds closed ones, at (t, y)."""
        self.evaluate(t, y)
        self._answer(LOOK, t, y)
        plan, rows = self.plan, self.plan.plant.rows
        assert plan.contacts is not None
        count = 4 * len(plan.contacts.points)
        jets = np.array(self.memory.buffers.slots[plan.plant.tape.root[plan.seen : plan.seen + count]])
        multipliers, ways = np.zeros(0), np.zeros((0, 3))
        if len(rows.table) and len(rows.contacts):
            sizes = sizes_of(rows)
            first = int(sizes.controls + sizes.held)
            multipliers = np.array(parts(sizes, self.memory.rows).shares[first : int(sizes.controls + sizes.ideal)])
        if len(rows.contacts):
            ways = np.array(self.memory.rows.contacts[:, ALONG : ALONG + 3])
        ground = np.array(self.memory.scratch.rows[-1, GROUND : GROUND + 3])
        return ContactLook(jets.reshape(-1, 4, 3), multipliers, ways, np.array(self.single.slope), ground)

    def look_at(self, worth: float) -> None:
        """Let the event of rows that lose their independence happen where one is worth so little."""
        if self.dependent >= 0:
            parts(sizes_of(self.plan.plant.rows), self.memory.rows).state[WORTH_BOUND] = worth

    def rows(self, t: float, y: Array) -> RowState:
        """Return the ideal rows at (t, y). Raises what `fault` names."""
        self._question(t, y)
        plan, sizes = self.plan, sizes_of(self.plan.plant.rows)
        space, e = parts(sizes, self.memory.rows), int(sizes.ideal)
        held, controls = int(sizes.held), int(sizes.controls)
        z, rate = np.zeros(e), np.zeros(e)
        z[held:], rate[held:] = space.residual[: e - held, 0], space.residual[: e - held, 1]
        if held:
            rate[0] = y[plan.positions + SIDEWAYS]
        answers, square = np.array(space.answers[controls : controls + e]), np.array(space.square[:e, :e])
        scale = np.sqrt(np.maximum(space.largest[:e], np.diag(square)))
        return RowState(plan.row_names[:e], z, rate, answers, square, scale, float(space.state[WORTH]))

    def moved(self, t: float, y: Array, change: Array) -> Array:
        """Return y with its positions moved as velocities `change` (nv,) would move them in a second."""
        places, moving = slice(0, self.plan.positions), np.array(y)
        moving[self.velocities] = change
        self._question(t, moving)
        moving[self.velocities] = y[self.velocities]
        moving[places] += self.single.slope[places]
        return self.tidied(moving)

    def tidied(self, y: Array) -> Array:
        """Return a copy of y with its directions of unit length."""
        found = np.array(y)
        for at in self.plan.arrays.tree.link[:, AT_P].tolist():
            found[at : at + 3] /= np.linalg.norm(found[at : at + 3])
        return found

    def _question(self, t: float, y: Array) -> None:
        """Evaluate at (t, y) under the forces that the control gave last."""
        self._answer(EVALUATE, t, y)
        if self.single.counts[FAILURE]:
            raise self.fault(int(self.single.counts[FAILURE]))

    @property
    def velocities(self) -> slice:
        """Where the velocities stand in a state."""
        return slice(self.plan.positions, self.plan.positions + self.plan.velocities)

    def failure(self, driver: Driver) -> VlmbError | None:
        """Return the first failure of an evaluation that led to the end of a run; None where there was none."""
        code = int(driver.counts[FIRST_FAILURE])
        if 0 < code <= len(self.errors):
            return self.errors[code - 1]
        return self.fault(code) if code else None

    def fault(self, code: int) -> VlmbError:
        """Make the error of an evaluation's code."""
        return fault(self.mechanism, self.plan, self.memory, code)

    def answer(self, driver: Driver, bounds: Array, h_max: float) -> None:
        """Write y' into `slope`, with the control asked before."""
        self._ask(float(driver.real[TIME]), driver.point)
        run(self.plan.plant, self.memory, driver, bounds, h_max, EVALUATE)

    def look(self, driver: Driver, bounds: Array, h_max: float) -> None:
        """Write the indicators of an accepted step, and how long the next may be."""
        if run(self.plan.plant, self.memory, driver, bounds, h_max, INDICATE) == FAILED:
            raise self.fault(FROM_SIDE * SOURCES)
        self._follow(float(driver.real[TIME]), driver.point)

    def _ask(self, t: float, y: Array) -> list[float]:
        assert self.reader is not None
        if not np.abs(y).max() < HUGE:
            raise SimulationError("a position or velocity is too large to compute with")
        values = self.reader.ask(self.view(t, y))
        self.memory.inputs[:] = values
        return values

    def view(self, t: float, y: Array) -> StateView:
        """Return what a control sees at (t, y)."""
        given = self.plan.given_at(self.memory, np.array([t]))[0]
        seen = self.plan.arrays.postures(np.array(y[: self.plan.positions + self.plan.velocities]), given)
        return StateView(self.mechanism, t, seen, self.branch)
