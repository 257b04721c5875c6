"""Pinocchio as the engine of robots: the workspace of a run answers the requests of a method; y = (q, v, work)."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.core.calls import march
from vlmb.core.driver import (
    AT_START,
    EVALUATE,
    FAILURE,
    FIRST_FAILURE,
    H_MAX,
    INDICATE,
    NEXT_SAMPLE,
    PHASE,
    RATE,
    TIME,
    VALUE,
    Driver,
)
from vlmb.core.readings import ELEVATION, HEADING, measure
from vlmb.errors import SceneError, VlmbError
from vlmb.model.layout import State
from vlmb.scene.by_phase import programmes_of
from vlmb.system import interrupts
from vlmb.system.contacts import ContactLook
from vlmb.system.events import FALLING, LIMIT, Event
from vlmb.system.friction import FRICTION_EVENTS, NO_HOLD, Hold, indicators_of
from vlmb.system.robot_programme import NO_LIMIT, effort_limits
from vlmb.system.robot_system import RobotSystem
from vlmb.system.robot_workspace import SIDEWAYS, RobotWorkspace
from vlmb.system.worth import RowState

Array = NDArray[np.float64]
Answer = Mapping[str, float] | None


class RobotView:
    """What a control callable sees by name: coordinates, rates, `t`, parameters, data, frames such as `left_foot.z`."""

    def __init__(self, system: RobotSystem, workspace: RobotWorkspace, t: float, state: State) -> None:
        self.system, self.workspace, self.t = system, workspace, t
        self.q, self.v = state
        self.q.flags.writeable = self.v.flags.writeable = False

    def __getitem__(self, name: str) -> float:
        mechanism = self.system.mechanism
        if name == "t":
            return self.t
        if name in mechanism.scene.parameters:
            return float(mechanism.scene.parameters[name])
        if name in mechanism.signals:
            return float(mechanism.signals.along(name, np.array([self.t]))[0])
        quantity = mechanism.names.find(name, "control")
        return float(mechanism.along(quantity, self.q[None], self.v[None])[0])

    def __contains__(self, name: object) -> bool:
        mechanism = self.system.mechanism
        return name == "t" or name in mechanism.scene.parameters or name in mechanism.names or name in mechanism.signals


class RobotEngine:
    """Accelerations of one run. One thread at a time."""

    name = "pinocchio"
    first_slice = 200
    dependent = -1

    def __init__(self, system: RobotSystem, start: State, control: Callable[[float, Any], Answer] | None = None) -> None:
        self.system, self.control = system, control
        self.workspace = RobotWorkspace(system)
        self.workspace.start_posture(start.q)
        self.size = system.size
        self.errors: list[VlmbError] = []
        self.asked: list[Array] = []
        self.failed_by: BaseException | None = None
        self.friction = self.workspace.friction
        self.limits = _Limits(system, any(part.limits == "stop" for _, part in programmes_of(system.mechanism.scene)))
        self.branching = [k for k, row in enumerate(self.workspace.readings.kind.tolist()) if row[0] in (HEADING, ELEVATION)]

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """What is looked for after every step."""
        contacts = self.workspace.contacts
        rubbed, touching = () if self.friction is None else FRICTION_EVENTS, () if contacts is None else contacts.events
        return (*self.limits.events, *rubbed, *touching, *self.system.events)

    @property
    def velocities(self) -> slice:
        """Where the velocities stand in a state."""
        return slice(self.workspace.nq, self.workspace.end)

    def pack(self, state: State) -> Array:
        """Return y = (q, v, 0) for a state."""
        y = np.concatenate([state.q, state.v, np.zeros(len(self.system.work_names))])
        if self.workspace.crossed:
            y[self.workspace.nq + SIDEWAYS] = 0.0
        return y

    def run(self, driver: Driver, bounds: Array, h_max: float) -> int:
        """Go on to the next thing that only the caller can answer: see the codes of `vlmb.core.driver`."""
        counts, real, rhs, ask = driver.counts, driver.real, self._asked_rhs if self.control else self.workspace.rhs, march
        if counts[PHASE] == AT_START:
            self.accept(float(real[TIME]), driver.point)
        while True:
            code = ask(driver)
            self._take_samples(driver)
            if code == EVALUATE:
                try:
                    driver.slope[:] = rhs(float(real[TIME]), driver.point)
                    counts[FAILURE] = 0
                except VlmbError as error:
                    self.errors.append(error)
                    counts[FAILURE] = len(self.errors)
            elif code == INDICATE:
                self.errors.clear()
                t, y = float(real[TIME]), driver.point
                self.accept(t, y)
                real[H_MAX] = min([h_max, *(step for begin, end, step in bounds.tolist() if begin <= t < end)])
                if self.workspace.contacts is not None:
                    self.workspace.contacts.keep()
                if self.events:
                    driver.indicators[VALUE : RATE + 1] = self.indicators(t, y)
            else:
                return int(code)

    def evaluate(self, t: float, y: Array) -> Array:
        """Return y' at (t, y)."""
        return np.array((self._asked_rhs if self.control else self.workspace.rhs)(t, y))

    def _asked_rhs(self, t: float, y: Array) -> Array:
        self.workspace.take_inputs(self._ask(t, y))
        return self.workspace.rhs(t, y)

    def _ask(self, t: float, y: Array) -> Array:
        """Ask the control for the forces at a state, by the names of its first call."""
        assert self.control is not None
        try:
            interrupts.answer()
            answer = asked(self.control, RobotView(self.system, self.workspace, t, self.unpack(t, y)))
            for name in answer:
                if name not in self.system.inputs:
                    raise SceneError(f"control: {name!r:.80} is none of the forces of its first call")
        except BaseException as error:
            self.failed_by = error
            raise
        return np.array([answer.get(name, 0.0) for name in self.system.inputs])

    def accept(self, t: float, y: Array) -> None:
        """Take a state as the one near which angles are read."""
        if not self.branching:
            return
        space = self.workspace
        space.rhs(t, y) if not self.control else self._asked_rhs(t, y)
        q, v, kinds = y[: space.nq], y[space.nq : space.end], space.readings.kind
        pairs = {}
        for k in self.branching:
            value = measure(space.bodies, space.readings, k, q, v)[0]
            if math.isfinite(value):
                pairs[k] = value
        for k, value in pairs.items():
            column = 1 if kinds[k, 0] == ELEVATION else 0
            for other in self.branching:  # azimuth and elevation of a frame share their branch
                if kinds[other, 1] == kinds[k, 1]:
                    space.reference[other, column] = value

    def indicators(self, t: float, y: Array) -> Array:
        """Return the indicators of all events and their rates (2, e)."""
        if not self.events:
            return np.zeros((2, 0))
        dy, space = self.evaluate(t, y), self.workspace
        found = [self.limits.read(space.q, space.v, dy[self.velocities], space.values)]
        if self.friction is not None:
            speed, rate = float(space.v[0]), float(dy[space.nq])
            found.append(indicators_of(self.friction.found, self.friction.mu, speed, rate))
        if space.contacts is not None:
            found.append(space.contacts.look(t, space.q, space.v, dy[self.velocities], space.multipliers))
        count = len(self.system.events)
        if count:
            found.append(np.array([space.laws[len(space.laws) - count :], np.full(count, np.nan)]))
        return np.hstack(found)

    def look_at_contacts(self, t: float, y: Array) -> ContactLook:
        """Return places and gaps of all contacts with two derivatives, and what holds closed ones, at (t, y)."""
        rates, space = self.evaluate(t, y), self.workspace
        contacts = space.contacts
        assert contacts is not None
        jets = contacts.jets(t, space.q, space.v, rates[self.velocities])
        ways = np.array(contacts.last).reshape(-1, 3)
        return ContactLook(jets, np.array(space.multipliers[contacts.first :]), ways, rates)

    def hold_inputs(self, values: Sequence[float] | Array) -> None:
        """Let forces from outside have these values (S,), where no control is asked for them."""
        self.workspace.take_inputs(values)

    def inputs_at(self, t: float, y: Array) -> list[float]:
        """Ask the control, once, for the forces (S,) that it gives at a state."""
        return [float(value) for value in self._ask(t, y)] if self.control else []

    def branch(self) -> list[tuple[tuple[int, ...], float, float]]:
        """Return near which values angles are read, by how the core reads them."""
        space = self.workspace
        kinds, near = space.readings.kind.tolist(), space.reference.tolist()
        return [(tuple(kinds[k]), *near[k]) for k in self.branching]

    def take_branch(self, branch: Sequence[tuple[tuple[int, ...], float, float]]) -> None:
        """Read angles near values that another engine told."""
        known, space = {kind: near for kind, *near in branch}, self.workspace
        for k in self.branching:
            near = known.get(tuple(space.readings.kind[k].tolist()))
            if near is not None:
                space.reference[k] = near

    def rows(self, t: float, y: Array) -> RowState:  # pragma: no cover
        """Return the ideal rows; nothing asks for them here."""
        raise NotImplementedError

    def moved(self, t: float, y: Array, change: Array) -> Array:
        """Return y with its positions moved as velocities `change` (nv,) would move them in a second."""
        moving, nq = np.array(y), self.workspace.nq
        moving[:nq] = pin.integrate(self.workspace.model, pin.normalize(self.workspace.model, y[:nq]), change)
        return moving

    def tidied(self, y: Array) -> Array:  # pragma: no cover
        """Return a copy of y with its quaternions of unit length; nothing asks for it here."""
        raise NotImplementedError

    def look_at(self, worth: float) -> None:
        """Nothing is looked at more closely."""

    def settle(self, t: float, y: Array) -> Hold:
        """Let a ski slide or stand from (t, y) on, as friction has it there. Raises SimulationError where it would lift."""
        if self.friction is None:
            return NO_HOLD
        self.friction.forget()
        self.evaluate(t, y)
        return self.friction.settle()

    def in_line(self, event: Event, t: float, y: Array) -> float:
        """Nothing lines up here."""
        return math.inf

    def failure(self, driver: Driver) -> VlmbError | None:
        """Return the first failure of an evaluation that led to the end of a run; None where there was none."""
        code = int(driver.counts[FIRST_FAILURE])
        return self.errors[code - 1] if 0 < code <= len(self.errors) else None

    def why(self, t: float, y: Array) -> str:
        """Add what the mass matrix or the programme says about a place where a run failed."""
        space = self.workspace
        mass = pin.crba(space.model, space.data, pin.normalize(space.model, y[: space.nq]))
        condition = scaled_condition(mass)
        if condition > 1e10:
            return f" The mass matrix is nearly singular there (condition {condition:.1e})."
        with contextlib.suppress(VlmbError):
            space.evaluate(t, np.array(y))
        return space.programme.weakness() if space.programme else ""

    def raised(self, error: BaseException) -> bool:
        """Whether an error is one that the control raised."""
        return error is self.failed_by

    def unpack(self, t: float, y: Array) -> State:
        """Return the state of y, quaternions of length 1, given lengths as their laws have them."""
        space = self.workspace
        q, v = space.driven_state(t, y[: space.nq], y[space.nq : space.end])
        return State(pin.normalize(space.model, q), v)

    def stored(self, t: Array, states: Array) -> Array:
        """Return the samples as a trajectory stores them: unit quaternions, given lengths exact."""
        found, space = np.array(states), self.workspace
        for time, row in zip(t.tolist(), found, strict=True):
            row[: space.nq], row[space.nq : space.end] = self.unpack(time, row)
        return found

    def sampled(self, t: Array, states: Array) -> tuple[Array, Array]:
        """Return the forces (N, S) of the control at samples, nan where not known, and the branch at the start (1, 0)."""
        inputs = np.full((len(t), len(self.system.inputs)), np.nan)
        for i, row in enumerate(self.asked[: len(t)]):
            inputs[i] = row
        return inputs, np.zeros((1, 0))

    def _take_samples(self, driver: Driver) -> None:
        while len(self.asked) < driver.counts[NEXT_SAMPLE]:
            self.note(float(driver.times[len(self.asked)]), driver.samples[len(self.asked)])

    def note(self, t: float, y: Array) -> None:
        """Record the forces of the control at a sample."""
        self.asked.append(self._ask(t, y) if self.control else np.zeros(0))


class _Limits:
    """Events of the limits of links' segments, and of a URDF where it is asked for: positions, speeds, efforts."""

    def __init__(self, system: RobotSystem, robots: bool) -> None:
        model, names = system.mechanism.model, system.mechanism.names
        events, self.fast, self.strong = [], list[tuple[int, float]](), list[tuple[int, float]]()
        self.low, self.high = list[tuple[int, int, float]](), list[tuple[int, int, float]]()
        for at, link in enumerate(system.mechanism.scene.links):
            for which, side in ((1, "lower"), (2, "upper")):
                if link.segment(which).motion != "free" or not model.existJointName(f"{link.name}.{side}"):
                    continue
                joint, (low, high) = model.joints[model.getJointId(f"{link.name}.{side}")], link.segment(which).bounds
                for entries, way, value in ((self.low, "lower", low), (self.high, "upper", high)):
                    if math.isfinite(value):
                        entries.append((joint.idx_q, joint.idx_v, value))
                        events.append((way, f"xi{at + 1}_{which} reached its limit {value:g} m"))
        for force in names.forces.values() if robots else ():
            if not force.joint:
                continue
            joint, name = model.joints[force.joint], force.along
            low, high = float(model.lowerPositionLimit[joint.idx_q]), float(model.upperPositionLimit[joint.idx_q])
            fast = float(model.upperVelocityLimit[joint.idx_v])
            unit = "m" if force.unit == "N" else "rad"
            if -NO_LIMIT < low < high < NO_LIMIT:
                self.low.append((joint.idx_q, joint.idx_v, low))
                self.high.append((joint.idx_q, joint.idx_v, high))
                for way, value in (("lower", low), ("upper", high)):
                    events.append((way, f"{name} reached its {way} limit {value:g} {unit}"))
            if 0.0 < fast < NO_LIMIT:
                self.fast.append((joint.idx_v, fast))
                events.append(("fast", f"{name}_dot reached the speed limit {fast:g} {unit}/s"))
        efforts = effort_limits(system.mechanism, system.forces) if robots else ()
        for at, (force, limit) in enumerate(zip(system.forces, efforts, strict=False)):
            if math.isfinite(limit):
                self.strong.append((at, limit))
                events.append(("strong", f"{force.name} reached the effort limit {limit:g} {force.unit}"))
        order = ("lower", "upper", "fast", "strong")
        self.events = tuple(
            Event(LIMIT, FALLING, sentence, sentence) for way in order for kind, sentence in events if kind == way
        )

    def read(self, q: Array, v: Array, vdot: Array, values: Array) -> Array:
        """Return what is left to each limit, and its rate (2, e)."""
        left = [(q[i] - low, v[k]) for i, k, low in self.low] + [(high - q[i], -v[k]) for i, k, high in self.high]
        left += [(fast - abs(v[k]), -math.copysign(vdot[k], v[k] * vdot[k])) for k, fast in self.fast]
        left += [(limit - abs(values[k]), 0.0) for k, limit in self.strong]
        return np.array(left, float).reshape(-1, 2).T


def asked(control: Callable[[float, Any], Answer], view: RobotView) -> dict[str, float]:
    """Call a control and check what it returns: None, or numbers by name. Raises SceneError."""
    answer = control(view.t, view)
    if answer is None:
        return {}
    if not isinstance(answer, Mapping):
        raise SceneError(f"control returned {answer!r:.80}: it must return a dict of force names and numbers, or None")
    try:
        return {str(name): float(value) for name, value in answer.items()}
    except (TypeError, ValueError):
        raise SceneError(f"control returned {dict(answer)!r:.200}: every force must be a number") from None


def scaled_condition(mass: Array) -> float:
    """Return the condition of a mass matrix, its rows and columns scaled to a diagonal of ones."""
    whole = np.triu(mass) + np.triu(mass, 1).T
    diagonal = np.sqrt(np.maximum(np.diag(whole), 0.0))
    if not (diagonal > 0.0).all() or not np.isfinite(whole).all():
        return math.inf
    return float(np.linalg.cond(whole / np.outer(diagonal, diagonal)))


def singular_motion(mass: Array, names: Sequence[str]) -> list[str]:
    """Return the velocities, by name, that take part in a motion with the least inertia."""
    whole = np.triu(mass) + np.triu(mass, 1).T
    diagonal = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    motion = np.linalg.eigh(whole / np.outer(diagonal, diagonal))[1][:, 0]
    return [names[k] for k in np.argsort(-np.abs(motion))[:3] if abs(motion[k]) > 0.3 * np.abs(motion).max()]
