"""Pinocchio as an engine: the workspace of a run answers the requests of a method; y = (q, v, work)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.core.calls import run
from vlmb.core.driver import (
    FAILURE,
    FIRST_FAILURE,
    H_MAX,
    INDICATE,
    LOOK,
    RATE,
    TIME,
    VALUE,
    Driver,
    make_driver,
)
from vlmb.core.run import follow_worth
from vlmb.core.tree import AT_P
from vlmb.errors import VlmbError
from vlmb.model.layout import State
from vlmb.system.answering import march_answered
from vlmb.system.constrained import SIDEWAYS
from vlmb.system.constraints import ConstraintSet
from vlmb.system.contacts import ContactLook
from vlmb.system.core_reading import CoreReading
from vlmb.system.events import CONTACT, DEPENDENT, GRIP, LIMIT, OPENS, QUIET, SLIPS, STICKS, Event
from vlmb.system.forces import Control, known_rows
from vlmb.system.friction import FRICTION_EVENTS, NO_HOLD, Hold, indicators_of
from vlmb.system.readings import beside_pole
from vlmb.system.system import System
from vlmb.system.worth import LOOKED_AT, RowState

Array = NDArray[np.float64]

NO_BOUNDS = np.zeros((0, 3))
CLOSEST = 1e-7  # [s] of a step, at least, where azimuths swing


class PinocchioEngine:
    """Accelerations of one run by Pinocchio's mass matrix, bias and one Cholesky. One thread at a time.

    What is looked for after a step is read by the core, on directions and lengths: `watch` has the events and no forces.
    """

    name = "pinocchio"
    first_slice = 200

    def __init__(self, system: System, control: Control | None, branch: Sequence[float]) -> None:
        self.system, self.watch = system, system.watch_plan
        watch = self.watch
        self.workspace, self.start = system.workspace(control, branch), list(branch)
        self.memory = watch.memory()
        kinds = {event.kind for event in watch.events} - {QUIET, DEPENDENT, GRIP}
        self.reading = CoreReading(watch.arrays, self.workspace.frames, kinds != {LIMIT}) if kinds else None
        self.still = np.zeros(watch.positions + watch.velocities)
        self.still[watch.arrays.tree.link[:, AT_P]] = 1.0  # directions have unit length
        self.size = self.workspace.size
        self.errors: list[VlmbError] = []  # of evaluations since the last accepted step
        self.seen = make_driver("euler", len(self.still), directions=np.zeros(len(watch.events)))  # what the core looks at
        self.asked: list[Array] = []
        self.branches: list[list[float]] = []
        self.room = np.inf
        self.dependent = next((k for k, event in enumerate(watch.events) if event.kind == DEPENDENT), -1)
        at = next((k for k, event in enumerate(self.watch.events) if event.kind == GRIP), None)
        self.sliding = slice(0, 0) if at is None else slice(at, at + len(FRICTION_EVENTS))
        self.gripping = [k for k, e in enumerate(watch.events) if e.kind == CONTACT and e.name in (OPENS, SLIPS, STICKS)]
        self.places: ConstraintSet | None = None  # of contacts, once they are looked at
        self.bound = LOOKED_AT[0]
        self.worth, self.looked = 0.0, 0.0  # of the ideal rows at the last accepted step, and its time

    @property
    def events(self) -> tuple[Event, ...]:
        """What is looked for after every step."""
        return self.watch.events

    def pack(self, state: State) -> Array:
        """Return y for Pinocchio's state, with no work done."""
        return self.workspace.pack(state)

    def run(self, driver: Driver, bounds: Array, h_max: float) -> int:
        """Go on to the next thing that only the caller can answer: see the codes of `vlmb.core.driver`."""
        return march_answered(self, driver, bounds, h_max)

    def answer(self, driver: Driver, bounds: Array, h_max: float) -> None:
        """Write y' into `slope`."""
        driver.slope[:] = self.workspace.rhs(float(driver.real[TIME]), driver.point)
        driver.counts[FAILURE] = 0

    def look(self, driver: Driver, bounds: Array, h_max: float) -> None:
        """Write the indicators of an accepted step, and how long the next may be."""
        real, t, y = driver.real, float(driver.real[TIME]), driver.point
        self.accept(t, y)
        self._look(INDICATE, t, y, bounds, h_max)
        real[H_MAX] = min(self.seen.real[H_MAX], max(self.room, CLOSEST))
        driver.indicators[VALUE : RATE + 1] = self.seen.indicators[VALUE : RATE + 1]
        self._look_at_ski(t, y, driver.indicators)
        self._look_at_grip(t, y, driver.indicators)
        if self.workspace.slips is not None:
            self.workspace.slips.keep()
        if self.dependent >= 0:
            real[H_MAX] = min(float(real[H_MAX]), self._note_worth(t, driver.indicators))

    def evaluate(self, t: float, y: Array) -> Array:
        """Return y' at (t, y)."""
        return np.array(self.workspace.rhs(t, y))

    def accept(self, t: float, y: Array) -> None:
        """Take a state as the one near which angles are read. Raises SingularError beyond a programme's singular posture."""
        _, self.room = self.workspace.accept(t, y)

    def indicators(self, t: float, y: Array) -> Array:
        """Return the indicators of all events and their rates (2, e)."""
        self._look(LOOK, t, y, NO_BOUNDS, np.inf)
        found = np.array(self.seen.indicators[VALUE : RATE + 1])
        if self.sliding.stop or self.gripping:
            both = np.array(self.seen.indicators)
            self._look_at_ski(t, y, both)
            self._look_at_grip(t, y, both)
            found = np.array(both[VALUE : RATE + 1])
        if self.dependent >= 0:
            self.workspace.rhs(t, y)
            found[:, self.dependent] = self.workspace.solver.worth - self.bound, 0.0
        return found

    def _note_worth(self, t: float, indicators: Array) -> float:
        """Write what the ideal rows are worth at an accepted step; return half the time [s] in which one is worth nothing."""
        solver = self.workspace.solver
        solver.note_largest()
        rate, self.bound, room = follow_worth(solver.worth, self.worth, t - self.looked, self.bound)
        self.worth, self.looked = solver.worth, t
        indicators[VALUE, self.dependent], indicators[RATE, self.dependent] = solver.worth - self.bound, rate
        return room

    def look_at(self, worth: float) -> None:
        """Let the event of rows that lose their independence happen where one is worth so little."""
        self.bound = worth

    def rows(self, t: float, y: Array) -> RowState:
        """Return the ideal rows at (t, y). Raises what the right-hand side does."""
        self.workspace.rhs(t, y)
        solver, count = self.workspace.solver, self.workspace.solver.count
        z, rate = np.zeros(count), np.zeros(count)
        if solver.held:
            rate[0] = y[self.workspace.nq + SIDEWAYS]
        z[solver.held :], rate[solver.held :] = solver.numbers[:2, : solver.ideal]
        answers = np.array(solver.answers)
        square = answers @ solver.jacobian[:, :count]
        scale = np.sqrt(np.maximum(solver.largest, np.diag(square)))
        return RowState(solver.names, z, rate, answers, square, scale, solver.worth)

    def moved(self, t: float, y: Array, change: Array) -> Array:
        """Return y with its positions moved as velocities `change` (nv,) would move them in a second."""
        model, nq, moving = self.workspace.mechanism.model, self.workspace.nq, np.array(y)
        moving[:nq] = pin.integrate(model, pin.normalize(model, y[:nq]), change)
        return moving

    def tidied(self, y: Array) -> Array:
        """Return a copy of y with its quaternions of unit length."""
        found = np.array(y)
        found[: self.workspace.nq] = pin.normalize(self.workspace.mechanism.model, y[: self.workspace.nq])
        return found

    @property
    def velocities(self) -> slice:
        """Where the velocities stand in a state."""
        return slice(self.workspace.nq, self.workspace.nq + self.workspace.nv)

    def _look(self, wanted: int, t: float, y: Array, bounds: Array, h_max: float) -> None:
        """Have the core read the indicators of events, and the longest step, at directions and lengths of a state."""
        self.seen.real[TIME], self.seen.point[:] = t, self._core_state(y)
        run(self.watch.plant, self.memory, self.seen, bounds, h_max, wanted)

    def settle(self, t: float, y: Array) -> Hold:
        """Let the ski slide or stand from (t, y) on, as friction has it there. Raises SimulationError where it would lift."""
        friction = self.workspace.friction
        if friction is None:
            return NO_HOLD
        friction.forget()
        self.workspace.rhs(t, y)
        return friction.settle()

    def _look_at_ski(self, t: float, y: Array, indicators: Array) -> None:
        """Write the indicators of friction under the ski at (t, y) into rows VALUE and RATE of `indicators`."""
        friction, at = self.workspace.friction, self.workspace.nq
        if friction is not None:
            rate = float(self.workspace.rhs(t, y)[at])
            indicators[VALUE : RATE + 1, self.sliding] = indicators_of(friction.found, friction.mu, y.item(at), rate)

    def _look_at_grip(self, t: float, y: Array, indicators: Array) -> None:
        """Write the indicators of closed contacts at (t, y) into row VALUE of `indicators`, after `_look`."""
        slips, contacts = self.workspace.slips, self.watch.contacts
        if not self.gripping or slips is None or contacts is None:
            return
        self.workspace.rhs(t, y)
        count = 4 * len(contacts.points)
        jets = self.memory.buffers.slots[self.watch.plant.tape.root[self.watch.seen : self.watch.seen + count]].reshape(-1, 4, 3)
        solver = self.workspace.solver
        indicators[VALUE, self.gripping] = slips.indicators(
            t, jets, solver.multipliers[solver.held :], y, self.workspace.ground()
        )
        indicators[RATE, self.gripping] = np.nan

    def hold_inputs(self, values: Sequence[float] | Array) -> None:
        """Let forces from outside have these values (S,), where no control is asked for them."""
        self.workspace.applied.held = list(values)

    def inputs_at(self, t: float, y: Array) -> list[float]:
        """Ask the control, once, for the forces (S,) that it gives at a state."""
        reader = self.workspace.applied.reader
        return [] if reader is None else self.workspace.inputs(t, self.workspace.unpack(t, y)).tolist()

    def controls(self) -> dict[str, float]:
        """Return the controls of the programme at the last evaluation, by name."""
        solver = self.workspace.solver
        return {} if solver.programme is None else dict(zip(solver.programme.names, solver.controls.tolist(), strict=True))

    def look_at_contacts(self, t: float, y: Array) -> ContactLook:
        """Return places and gaps of all contacts with two derivatives, and what holds closed ones, at (t, y)."""
        work, contacts = self.workspace, self.system.contacts
        assert contacts is not None
        if self.places is None:
            texts = [(f"{root.text} = 0", "contacts", True) for root in contacts.roots if root.names]
            self.places = ConstraintSet(work.mechanism, texts)
        rates = np.array(work.rhs(t, y))
        q, v = work.unpack(t, y)
        work.frames.update(q)
        values = self.places.evaluate(work.frames, t, q, v, np.array(work.branch))
        second = values.jacobian @ rates[work.nq : work.nq + work.nv] + values.drift
        known = np.array([bool(name) for point in contacts.points for name in (*point.names, "gap")])
        jets = np.zeros((len(known), 3))
        jets[known] = np.column_stack([values.z, values.rate, second])
        ways = np.array(work.slips.last).reshape(-1, 3) if work.slips is not None else np.zeros((0, 3))
        multipliers, ground = np.array(work.solver.multipliers[work.solver.held :]), work.ground()
        return ContactLook(jets.reshape(-1, 4, 3), multipliers, ways, rates, ground)

    def in_line(self, event: Event, t: float, y: Array) -> float:
        """Return the sine of the angle between the two directions of a spring; of one between points its length [m]."""
        return self.watch.in_line(event, self.memory, t, self._core_state(y))

    def failure(self, driver: Driver) -> VlmbError | None:
        """Return the first failure of an evaluation that led to the end of a run; None where there was none."""
        code = int(driver.counts[FIRST_FAILURE])
        return self.errors[code - 1] if 0 < code <= len(self.errors) else None

    def why(self, t: float, y: Array) -> str:
        """Add what the mass matrix or the programme says about a place where a run failed."""
        condition, names = self.workspace.diagnostics.conditioning(y[: self.workspace.nq])
        if condition > 1e10:
            weak = ", ".join(names)
            return f" The mass matrix is nearly singular there (condition {condition:.1e}): {weak} move almost without inertia."
        programme, mechanism = self.workspace.solver.programme, self.workspace.mechanism
        seen = mechanism.coordinates(self.workspace.unpack(t, y))
        return (programme.weakness() if programme else "") + beside_pole(mechanism, seen)

    def raised(self, error: BaseException) -> bool:
        """Whether an error is one that the control raised."""
        reader = self.workspace.applied.reader
        return reader is not None and error is reader.failure

    def stored(self, t: Array, states: Array) -> Array:
        """Return the samples as a trajectory stores them: unit quaternions, prescribed lengths exact, the knife edge kept."""
        nq, nv = self.workspace.nq, self.workspace.nv
        found = np.array(states)
        for i, (time, y) in enumerate(zip(t.tolist(), states, strict=True)):
            found[i, :nq], found[i, nq : nq + nv] = self.workspace.unpack(time, y)
        return found

    def sampled(self, t: Array, states: Array) -> tuple[Array, Array]:
        """Return the forces (N, S) of the control at samples, nan where not known, and the branches (N or 1, coordinates)."""
        inputs = known_rows(self.asked, len(t), len(self.workspace.applied.inputs))
        if not self.system.reads_angles:
            return inputs, np.array([self.start])
        branches = [*self.branches[: len(t)], *[self.workspace.branch] * (len(t) - len(self.branches))]
        return inputs, np.array(branches)

    def note(self, t: float, y: Array) -> None:
        """Record the forces of the control and the branch of angles at a sample."""
        self.asked.append(self.workspace.inputs(t, self.workspace.unpack(t, y)))
        self.branches.append(self.workspace.branch)

    def _core_state(self, y: Array) -> Array:
        """Return directions and lengths of a state, and their rates; where nothing is looked for, nothing."""
        if self.reading is None:
            return self.still
        nq, nv = self.workspace.nq, self.workspace.nv
        return self.reading.read(pin.normalize(self.workspace.mechanism.model, y[:nq]), y[nq : nq + nv])
