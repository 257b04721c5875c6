"""A run in phases: intervals in which each contact stays open, held or sliding, and what happens between them.

Each phase is a run of its own, of the system that has the rows of what is closed. Between two an impact changes velocities, and
what opens, sticks and slips follows from accelerations: never from a step that is tried.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, VlmbError
from vlmb.model.frozen import read_only
from vlmb.scene.contacts import condition_of
from vlmb.scene.expressions import evaluate
from vlmb.scene.names import listed
from vlmb.scene.tables import Run
from vlmb.simulation.loop import Loop, Recorded
from vlmb.simulation.motion import Motion
from vlmb.simulation.samples import Samples, samples_of
from vlmb.system.cone import Contact, Grip, Refusal, impact, modes
from vlmb.system.contacts import (
    AWAY,
    CLOSED,
    HELD,
    LIGHT,
    OPEN,
    SLIDING,
    STILL,
    ContactLook,
    ContactPoint,
    Footing,
    footing_at,
    row_vectors,
)
from vlmb.system.core_engine import CoreEngine
from vlmb.system.engines import make_engine
from vlmb.system.events import BOUNCES, OPENS, REARMS, SLIPS, STICKS, TOUCHES
from vlmb.system.events import Event as Watched
from vlmb.system.forces import Control, StateView
from vlmb.system.pinocchio_engine import PinocchioEngine
from vlmb.system.probe import Answers, Probe
from vlmb.system.system import System

Array = NDArray[np.float64]
Engine = CoreEngine | PinocchioEngine

NEAR, NEAR_AT_START = 1e-9, 1e-6  # [m] a gap that counts as none
MANY, SPAN = 1000, 0.1  # more events within so many seconds end a run
GAIN = 1e-9  # of the kinetic energy: what an impact may not add


KINDS = (TOUCHES, OPENS, SLIPS, STICKS, BOUNCES)


class Phase(NamedTuple):
    """An interval in which no contact changes: from start to end [s], what is closed, and which of these slide with friction."""

    start: float
    end: float
    closed: tuple[str, ...]
    slipping: tuple[str, ...]


class Event(NamedTuple):
    """Something that happened at a time [s]: `kind` is touch (it stays closed), bounce (it leaves at once), open, slip or stick.

    impulses : (3,) [N s] on the mechanism in the surface frame, by contact
    lost : [J] by the impact
    modes : what each contact does from now on: open, held or sliding
    """

    t: float
    kind: str
    name: str
    contacts: tuple[str, ...] = ()
    impulses: Mapping[str, Array] = MappingProxyType({})
    lost: float = 0.0
    modes: Mapping[str, str] = MappingProxyType({})


@dataclasses.dataclass(frozen=True)
class Stretch:
    """A phase as it was run: how contacts stood, and which samples (first, end) it has."""

    start: float
    end: float
    footings: tuple[Footing, ...]
    first: int
    last: int
    quiet: bool = False  # it began where nothing is told


class PhaseSystems:
    """The systems of the phases of one run: each set of closed contacts is compiled once."""

    def __init__(self, system: System, engine: str) -> None:
        self.system, self.engine = system, engine
        self.made: dict[tuple[str, ...], System] = {}

    def of(self, footings: Sequence[Footing]) -> System:
        """Return the system of a phase."""
        if self.engine != "core":
            return self.system.phase(footings)
        states = tuple(at.state for at in footings)
        if states not in self.made:
            self.made[states] = self.system.phase(footings)
        return self.made[states].placed(footings)


class Outcome(NamedTuple):
    """What follows an event: how contacts stand, the state, what is told of it (None: nothing), a sentence where the run ends."""

    footings: tuple[Footing, ...]
    y: Array
    event: Event | None = None
    sentence: str = ""
    happened: frozenset[str] = frozenset()  # as `until` has it: "touch left"


class PhasedRun:
    """Takes a state through all phases; to its caller it is what a Loop is."""

    def __init__(
        self, system: System, run: Run, y: Array, times: Array, breaks: Sequence[float], start: float, bounds: Array,
        branch: Sequence[float], control: Control | None, progress: Callable[[float], None] | None = None,
        longest: float = np.inf, until: str = "",
    ) -> None:  # fmt: skip
        self.system, self.options, self.points, self.control = system, run, system.points, control
        self.until = until
        self.t, self.y, self.branch = start, np.array(y), list(branch)
        self.times, self.breaks, self.bounds, self.tell, self.longest = times, breaks, bounds, progress, longest
        self.systems = PhaseSystems(system, system.engine)
        self.impulses, self.forces = Probe(system, system.engine, bare=True), Probe(system, system.engine, bare=False)
        self.works, self.plane = len(system.work_names), system.mechanism.scene.plane
        self.conditions = [
            condition_of(p.contact.when, f"contacts[{p.index}].when") if p.contact.when else None for p in self.points
        ]
        self.stretches: list[Stretch] = []
        self.events: list[Event] = []
        self.parts: list[Samples] = []
        self.steps, self.evaluations, self.quiet = 0, 0, False
        self.switched: list[tuple[float, str]] = []  # the last events of contacts, told or not
        self.known: dict[tuple[bool, float, bytes], Answers] = {}  # the last ones
        self.begun: tuple[Engine, Loop, tuple[Footing, ...]] | None = None  # the phase under way
        self.begins = self._at_start()

    def failed_by(self, error: BaseException) -> str:
        """Return the sentence for an error that went through."""
        if self.begun is None:
            return f"failed at t = {self.t:.6g} s: {type(error).__name__}: {error}"
        said = self.begun[1].failed_by(error)
        self._keep(told=True)
        return said

    @property
    def samples(self) -> Samples:
        """The samples of all phases."""
        if self.begun is not None:
            self._keep(told=True)
        single = all(len(part.branch) == 1 for part in self.parts)
        branches = self.parts[0].branch if single else np.vstack([self._branches(part) for part in self.parts])
        t, states, inputs = (np.concatenate([part[k] for part in self.parts]) for k in range(3))
        return Samples(t, states, inputs, branches)

    def _branches(self, part: Samples) -> Array:
        if len(part.branch) > 1 or len(part.t) == 1:
            return part.branch
        return Motion(self.system, self.system.engine, part.t, part.states, part.branch).coordinates[0]

    def run(self) -> tuple[str, str]:
        """Go to the last sample; return a status and a sentence. What user code raises goes through."""
        last, doubled = float(self.times[-1]), False
        out = self.begins
        while True:
            if out.event is not None:
                self.events.append(out.event)
            if out.sentence:
                return "stopped", f"stopped at t = {self.t:.6g} s: {out.sentence}."
            rest = self.times[self.times > self.t] if self.stretches else self.times
            if self.stretches and doubled:
                rest = np.concatenate([[self.t], rest])
            if not len(rest):
                return _finished(last)
            mover = self._mover(out.footings)
            breaks = [at for at in self.breaks if at > self.t]
            loop = Loop(mover, self.options, out.y, rest, breaks, self.t, self.bounds, self.tell, self.longest)
            self.begun = mover, loop, out.footings
            asked = self.until in out.happened
            if self.t >= last or asked:
                mover.note(self.t, out.y)
                self._keep(told=True)
                return ("stopped", f"stopped at t = {self.t:.6g} s: {self.until}.") if asked else _finished(last)
            status, message = loop.run()
            self.y = np.array(loop.driver.point)
            if status != "switched":
                self._keep(told=True)
                return status, message
            assert loop.hit is not None
            self.t = loop.t
            try:
                out = self._after(loop.hit, mover, out.footings)
            except VlmbError as error:
                self._keep(told=True)
                return "failed", f"failed at t = {self.t:.6g} s: {error}"
            doubled = out.event is not None
            self._keep(told=doubled or bool(out.sentence))

    def _mover(self, footings: Sequence[Footing]) -> Engine:
        return make_engine(self.systems.of(footings), self.branch, self.control)

    def _keep(self, told: bool) -> None:
        """Keep the samples of the phase under way; without `told` its last instant is none unless it was asked for."""
        assert self.begun is not None
        mover, loop, footings = self.begun
        self.begun = None
        recorded = loop.recorded
        self.steps += loop.steps
        self.evaluations += loop.evaluations
        start = self.stretches[-1].end if self.stretches else loop.start
        if not told and len(recorded.t) and recorded.t[-1] not in self.times:
            recorded = Recorded(recorded.t[:-1], recorded.states[:-1])
        first = sum(len(part.t) for part in self.parts)
        if len(recorded.t):
            part = samples_of(mover, recorded)
            self.parts.append(part)
            self.branch = list(self._branches(part)[-1])
        self.stretches.append(Stretch(start, loop.t, footings, first, first + len(recorded.t), self.quiet))
        self.quiet = not told

    # What an event leads to

    def _at_start(self) -> Outcome:
        """Find how contacts stand at the start. Raises SceneError for a start under a surface."""
        found = self._probe(self.impulses, self.y)
        footings, near = [], []
        for point, jet in zip(self.points, found.jets, strict=True):
            gap = self._gap(point, jet)
            refused = gap < NEAR_AT_START and not self._allows(point, self.y)
            if gap < -NEAR_AT_START and not refused:
                raise SceneError(
                    f"start: {point.contact.point} is {-gap:.3g} m under the surface of contact {point.name!r}; raise it, or "
                    "give the contact a `when`"
                )
            left = min(float(jet[3, 0]), 0.0) if abs(gap) < NEAR_AT_START else 0.0
            footings.append(Footing(AWAY if refused else OPEN, gap=left))
            if abs(gap) <= NEAR_AT_START and not refused:
                near.append(point.index)
        return self._settled(None, tuple(footings), near, set(), {})

    def _after(self, hit: Watched, mover: Engine, footings: tuple[Footing, ...]) -> Outcome:
        """Return what follows the event of a contact."""
        c = hit.which
        self.switched = [*self.switched[1 - MANY :], (self.t, self.points[c].name)]
        if len(self.switched) == MANY and self.t - self.switched[0][0] <= SPAN:
            names = listed(sorted({name for _, name in self.switched}))
            why = "they would never end; a restitution of 0 ends them"
            return Outcome(footings, self.y, None, f"{MANY} events of contacts within {SPAN} s ({names}): {why}")
        if hit.name == REARMS:
            return Outcome(_with(footings, c, Footing()), self.y)
        if hit.name == TOUCHES and not self._allows(self.points[c], self.y):
            return Outcome(_with(footings, c, Footing(AWAY)), self.y)
        forces = self._forces(mover.look_at_contacts(self.t, self.y), footings)
        jets = self._probe(self.impulses, self.y).jets
        near = [c]
        for point, jet, at in zip(self.points, jets, footings, strict=True):
            if at.state in CLOSED or (at.state == OPEN and self._gap(point, jet) - min(at.gap, 0.0) <= NEAR and point.index != c):
                near.append(point.index)
        opening, leaving = set[int](), dict[int, Array]()
        if hit.name == OPENS:
            weight = max([self.forces.push, *(abs(force[2]) for force in forces.values())])
            opening = {k for k, force in forces.items() if force[2] <= LIGHT * weight} | {c}
        elif hit.name == SLIPS:
            leaving[c] = forces[c][:2]
        return self._settled(hit, footings, sorted(set(near)), opening, leaving)

    def _settled(
        self, hit: Watched | None, footings: tuple[Footing, ...], near: Sequence[int], opening: Collection[int],
        leaving: Mapping[int, Array],
    ) -> Outcome:  # fmt: skip
        """Return what follows for the contacts that are closed or touch: an impact where one approaches, then their modes.

        opening : those whose normal force has become 0; leaving: friction of those at the edge of their cones
        """
        y, frames = self.y, {k: self._frame(k) for k in near}
        found = self._probe(self.impulses, y)
        approach = {k: self._local(found.jets[k], k, frames[k]) for k in near}
        fired = -1 if hit is None or hit.name != TOUCHES else hit.which
        strikes = [k for k in near if footings[k].state not in CLOSED and (approach[k][-1] < -STILL or k == fired)]
        taking = [k for k in near if footings[k].state in CLOSED or approach[k][-1] <= STILL]
        told: dict[str, Any] = {}
        if any(approach[k][-1] < 0.0 for k in taking):  # rows that were held are a little off, too
            y, impact_told, refusal = self._impact(found, taking, frames, approach)
            if refusal:
                return Outcome(footings, self.y, None, refusal)
            told = impact_told if strikes else {}
            found = self._probe(self.impulses, y)
            approach = {k: self._local(found.jets[k], k, frames[k]) for k in near}
        resting = [k for k in taking if approach[k][-1] <= STILL and k not in opening]
        states, ways, refusal = self._modes(y, resting, frames, approach, leaving)
        if refusal:
            return Outcome(footings, self.y, None, refusal)
        after = list(footings)
        for k in near:
            at, point = footings[k], self.points[k]
            state, place = states.get(k, OPEN), found.jets[k, :3, 0]
            if state == OPEN:
                gap = float(found.jets[k, 3, 0])
                after[k] = Footing(gap=min(gap, 0.0)) if at.state in CLOSED or k in strikes or k in taking else at
            elif state == HELD and at.state == HELD:
                after[k] = at
            else:
                way = ways.get(k, np.zeros(3))
                towards = (float(way[0]), float(way[1]), float(way[2]))
                after[k] = footing_at(point, state, self.t, place, self.plane, towards=towards)
        event = self._event(hit, footings, after, strikes, told)
        return Outcome(tuple(after), y, event, "", self._happened(footings, after, strikes))

    def _happened(self, before: Sequence[Footing], after: Sequence[Footing], strikes: Sequence[int]) -> frozenset[str]:
        """Return what has happened in the words of `until`; to stick is to come to rest, not to turn back."""
        found = {f"{TOUCHES} {self.points[k].name}" for k in strikes}
        for point, one, other in zip(self.points, before, after, strict=True):
            if one.state in CLOSED and other.state == OPEN:
                found.add(f"{OPENS} {point.name}")
            elif (one.state, other.state) in ((HELD, SLIDING), (SLIDING, HELD)):
                found.add(f"{SLIPS if other.state == SLIDING else STICKS} {point.name}")
        return frozenset(found)

    def _event(
        self, hit: Watched | None, before: Sequence[Footing], after: Sequence[Footing], strikes: Sequence[int],
        told: Mapping[str, Any],
    ) -> Event | None:  # fmt: skip
        """Return what is told of an event; nothing at a start without an impact."""
        if hit is None and not strikes:
            return None
        shown = {OPEN: "open", AWAY: "open", HELD: "held", SLIDING: "sliding"}
        mode = {point.name: shown[at.state] for point, at in zip(self.points, after, strict=True)}
        changed = [k for k, (one, other) in enumerate(zip(before, after, strict=True)) if one.state != other.state]
        first = strikes[0] if hit is None else hit.which
        kind = TOUCHES if strikes else OPENS if hit is None else hit.name
        if strikes and all(after[k].state == OPEN for k in strikes):
            kind = BOUNCES
        if kind == STICKS and after[first].state == SLIDING:
            kind = SLIPS  # it turns back at once
        involved = tuple(self.points[k].name for k in dict.fromkeys([first, *strikes, *changed]))
        return Event(self.t, kind, self.points[first].name, involved, modes=MappingProxyType(mode), **told)

    def _impact(
        self, found: Answers, taking: Sequence[int], frames: Mapping[int, Array], before: Mapping[int, Array]
    ) -> tuple[Array, dict[str, Any], str]:
        """Return the state after an impact, what is told of it, and a sentence where there is none."""
        turn, rows = self._problem(taking, frames)
        v = np.concatenate([before[k] for k in taking])
        matrix = turn @ found.matrix @ turn.T
        shaped = []
        for k, (normal, across) in zip(taking, rows, strict=True):
            point = self.points[k]
            shaped.append(Contact(normal, (Grip(across, point.at_rest, point.coefficient),), point.contact.restitution))
        answer = impact(matrix, v, shaped)
        if isinstance(answer, Refusal):
            return self.y, {}, self._why_not(answer, taking, "impact")
        p = turn.T @ answer.p
        lost = float(-0.5 * answer.p @ (answer.v + v))
        scale = 0.5 * float(np.abs(answer.p) @ (np.abs(answer.v) + np.abs(v)))
        if lost < -GAIN * scale:
            names = listed([self.points[k].name for k in taking])
            why = "with friction, different restitutions of contacts that meet at once do not go together; give them the same one"
            return self.y, {}, f"the impact of {names} would raise the kinetic energy by {-lost:.3g} J: {why}"
        y = np.array(self.y)
        y[len(y) - len(found.moved) :] += found.moved @ p
        works, first = self.system.work_names, len(y) - self.works
        y[first + works.index("impacts")] -= lost
        for k in taking:
            if self.points[k].moving:
                force, jet = p[3 * k : 3 * k + 3], found.jets[k]
                carried = jet[:3, 1] - frames[k].T @ before[k]
                y[first + works.index(f"surface {self.points[k].name}")] += float(force @ carried)
        named = {self.points[k].name: read_only(p[3 * k : 3 * k + 3]) for k in taking if np.any(p[3 * k : 3 * k + 3])}
        return y, {"impulses": MappingProxyType(named), "lost": lost}, ""

    def _modes(
        self, y: Array, resting: Sequence[int], frames: Mapping[int, Array], speeds: Mapping[int, Array],
        leaving: Mapping[int, Array],
    ) -> tuple[dict[int, str], dict[int, Array], str]:  # fmt: skip
        """Return how contacts that touch and do not leave go on, along what they slide, and a sentence where none may."""
        if not resting:
            return {}, {}, ""
        found = self._probe(self.forces, y)
        turn, rows = self._problem(resting, frames)
        shaped, known = [], {}
        for k, (normal, across) in zip(resting, rows, strict=True):
            point, v = self.points[k], speeds[k][:-1]
            speed = float(np.linalg.norm(v))
            hold, sliding = point.at_rest, None
            if speed > STILL and point.contact.slips:
                sliding = v / speed
            elif k in leaving:
                friction, hold = leaving[k][: len(across)], 0.0
                if point.at_rest == point.coefficient:  # else what pushes is new, and so is the direction
                    sliding = -friction / np.linalg.norm(friction)
            if sliding is not None:
                known[k] = sliding
            grip = Grip(across, hold, point.coefficient, None if sliding is None else tuple(sliding.tolist()))
            shaped.append(Contact(normal, (grip,)))
        a = np.concatenate([self._local(found.jets[k], k, frames[k], 2) for k in resting])
        answer = modes(turn @ found.matrix @ turn.T, a, shaped)
        if isinstance(answer, Refusal):
            return {}, {}, self._why_not(answer, resting, "motion")
        states, ways = {}, {}
        for at, (k, (_, across)) in enumerate(zip(resting, rows, strict=True)):
            if not answer.closed[at]:
                states[k] = OPEN
                continue
            slides = self.points[k].smooth or answer.slipping[at][0]
            states[k] = SLIDING if slides else HELD
            if slides and not self.points[k].smooth:
                way = known.get(k)
                if way is None:
                    moved, push = answer.v[list(across)], answer.p[list(across)]
                    way = moved / np.linalg.norm(moved) if np.linalg.norm(moved) > 0.0 else -push / np.linalg.norm(push)
                ways[k] = frames[k][:-1].T @ way
        return states, ways, ""

    def _why_not(self, refusal: Refusal, taking: Sequence[int], what: str) -> str:
        """Say why nothing may follow."""
        if refusal.contact is None:
            names = listed([self.points[k].name for k in taking])
            return f"no {what} of the contacts {names} is admissible: none of their modes keeps them out of their surfaces"
        point = self.points[taking[refusal.contact]]
        if refusal.why == "prescribed":
            return (
                f"contact {point.name!r}: its point meets the surface with a speed that laws prescribe, and no impulse can stop "
                "it; let the law end softly, or leave the length free"
            )
        found, k = self._probe(self.impulses, self.y), taking[refusal.contact]
        x = found.jets[k, :3, 0]
        angle = self._angle_to(point)
        told = f" at {angle:.4g} rad" if angle is not None else ""
        return (
            f"contact {point.name!r}{told}: with friction {point.coefficient:g} no {what} is admissible there (Painleve): "
            f"friction would press the point into the surface at ({', '.join(f'{value:.4g}' for value in x)}) more than it is "
            "pushed out; take a smaller friction"
        )

    def _angle_to(self, point: ContactPoint) -> float | None:
        """Return the elevation [rad] of the link that a contact is a point of."""
        link = self.system.mechanism.names.links.get(point.contact.point.partition(".")[0])
        if link is None:
            return None
        layout = self.system.mechanism.layout
        return float(self._view(self.y)[layout.coordinates[layout.place("psi", link)].name])

    def _problem(
        self, taking: Sequence[int], frames: Mapping[int, Array]
    ) -> tuple[Array, list[tuple[int, tuple[int, ...]]]]:
        """Return what takes forces along x, y, z at all contacts to rows across and along the normals of some; and their rows."""
        size = 2 if self.plane else 3
        turn, rows = np.zeros((size * len(taking), 3 * len(self.points))), []
        for at, k in enumerate(taking):
            turn[size * at : size * at + size, 3 * k : 3 * k + 3] = frames[k]
            rows.append((size * at + size - 1, tuple(range(size * at, size * at + size - 1))))
        return turn, rows

    # What is read of a state

    def _probe(self, probe: Probe, y: Array) -> Answers:
        key = probe.bare, self.t, y.tobytes()
        if key not in self.known:
            given: Sequence[float] = ()
            if probe.given:
                mover = self.begun[0] if self.begun else self._mover([Footing()] * len(self.points))
                given = mover.inputs_at(self.t, y)
            self.known = dict([*self.known.items()][-3:])
            self.known[key] = probe.at(self.t, y, self._branch_at(y), self.works, given)
        return self.known[key]

    def _branch_at(self, y: Array) -> list[float]:
        """Return the coordinates of a state, near those of the last sample."""
        motion = Motion(self.system, self.system.engine, np.array([self.t]), y[None], np.array([self.branch]))
        return list(map(float, motion.coordinates[0][0]))

    def _frame(self, k: int) -> Array:
        """Return the rows across the surface and its normal, (3, 3) or (2, 3) in the plane, where a contact is."""
        place = self._probe(self.impulses, self.y).jets[k, :3, 0]
        frame, _ = self.points[k].frame(self.t, place, self.plane)
        return frame[[0, 2]] if self.plane else frame

    def _gap(self, point: ContactPoint, jet: Array) -> float:
        """Return the distance [m] from a surface: its value over its slope."""
        return float(jet[3, 0]) / self._size(point, jet)

    def _size(self, point: ContactPoint, jet: Array) -> float:
        return point.frame(self.t, jet[:3, 0], self.plane)[1]

    def _local(self, jet: Array, k: int, frame: Array, order: int = 1) -> Array:
        """Return velocity (order 1) or acceleration (2) of a contact over its surface, across it and away from it."""
        point = self.points[k]
        moving = np.array(point.contact.surface_velocity) if order == 1 else np.zeros(3)
        found = frame @ (jet[:3, order] - moving)
        found[-1] = jet[3, order] / self._size(point, jet)
        return found

    def _forces(self, look: ContactLook, footings: Sequence[Footing]) -> dict[int, Array]:
        """Return friction (2 or 1 rows across) and normal force [N] of closed contacts: (3,) friction x, friction y, normal."""
        found, at = {}, len(self.system.mechanism.scene.constraints)
        for point, footing in zip(self.points, footings, strict=True):
            if footing.state in CLOSED:
                place = look.jets[point.index, :3, 0]
                slope = point.surface.at(self.t, place)[1]
                rows = row_vectors(point, footing, slope)
                force = look.multipliers[at : at + len(rows)] @ rows
                at += len(rows)
                local = self._frame(point.index) @ force
                flat = np.zeros(2)
                flat[: len(local) - 1] = local[:-1]
                found[point.index] = np.array([*flat, local[-1]])
        return found

    def _view(self, y: Array) -> StateView:
        motion = Motion(self.system, self.system.engine, np.array([self.t]), y[None], np.array([self.branch]))
        return StateView(self.system.mechanism, self.t, motion.postures.sample(0), self.branch)

    def _allows(self, point: ContactPoint, y: Array) -> bool:
        """Whether a contact's `when` is true, or it has none."""
        condition = self.conditions[point.index]
        if condition is None:
            return True
        view = self._view(y)
        return evaluate(condition.expression, {name: view[name] for name in condition.expression.names}) > 0.0


def _finished(last: float) -> tuple[str, str]:
    return "finished", f"finished at t = {last:.6g} s."


def _with(footings: tuple[Footing, ...], k: int, footing: Footing) -> tuple[Footing, ...]:
    return (*footings[:k], footing, *footings[k + 1 :])


def phases_of(points: Sequence[ContactPoint], stretches: Sequence[Stretch]) -> tuple[Phase, ...]:
    """Return the phases that are told: intervals with constant states of contacts."""
    found: list[Phase] = []
    for stretch in stretches:
        states = list(zip(points, stretch.footings, strict=True))
        closed = tuple(point.name for point, at in states if at.state in CLOSED)
        slipping = tuple(point.name for point, at in states if at.state == SLIDING and point.contact.slips)
        if found and stretch.quiet:
            found[-1] = found[-1]._replace(end=stretch.end)
        else:
            found.append(Phase(stretch.start, stretch.end, closed, slipping))
    return tuple(found)
