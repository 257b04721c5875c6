"""A run in phases: intervals in which each contact stays open, held or sliding, and what happens between them.

Each phase is a run of its own, of the system that has the rows of what is closed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, VlmbError
from vlmb.scene.by_phase import goes_by_phase
from vlmb.scene.names import listed
from vlmb.scene.tables import Run
from vlmb.simulation.breaks import breaks_of, require_going_on
from vlmb.simulation.contact_view import Engine
from vlmb.simulation.leg_steps import NEAR, LegSteps
from vlmb.simulation.loop import Loop, Recorded
from vlmb.simulation.motion import Motion
from vlmb.simulation.phases import Event, Stretch, Turn
from vlmb.simulation.resting import Strikes
from vlmb.simulation.samples import Samples, samples_of
from vlmb.simulation.settling import Outcome
from vlmb.system.beginning import NEAR_AT_START
from vlmb.system.contacts import AWAY, CLOSED, HELD, LIGHT, OPEN, RESTING, SLIDING, STILL, TURNING, ContactPoint, Footing
from vlmb.system.engines import make_engine
from vlmb.system.events import OPENS, REARMS, SLIPS, TOUCHES
from vlmb.system.events import Event as Watched
from vlmb.system.forces import Control
from vlmb.system.legs import LegPoint
from vlmb.system.pace import longest_steps
from vlmb.system.system import System

Array = NDArray[np.float64]

SLIDES = 1e-6  # [m/s] along rough ground that counts as sliding at a start
MANY, SPAN = 1000, 0.1  # more events within so many seconds end a run
SURE = 1.0 - 1e-9  # of what friction may do: so much is surely not too much
BESIDE = 1e-6  # of what a normal force does to its contact: what is left of it beside Painleve's paradox


class PhasedRun(LegSteps):
    """Takes a state through all phases; to its caller it is what a Loop is."""

    def __init__(
        self, system: System, run: Run, y: Array, times: Array, breaks: Sequence[float], start: float, bounds: Array,
        branch: Sequence[float], control: Control | None, progress: Callable[[float], None] | None = None,
        longest: float = np.inf, until: str = "", hand: Callable[[Array, Array, float], None] | None = None,
    ) -> None:  # fmt: skip
        super().__init__(system, y, start, branch, control)
        self.options, self.until, self.hand = run, until, hand
        self.times, self.breaks, self.bounds, self.tell, self.longest = times, breaks, bounds, progress, longest
        self.stretches: list[Stretch] = []
        self.events: list[Event] = []
        self.turns: list[Turn] = []
        self.parts: list[Samples] = []
        self.steps, self.evaluations, self.quiet = 0, 0, False
        self.now: System | None = None  # of the phase under way
        self.switched: list[tuple[float, str]] = []  # the last events of contacts, told or not
        self.begun: tuple[Engine, Loop, tuple[Footing, ...]] | None = None  # the phase under way
        self.ready: Engine | None = None  # of the first phase, where its start has been looked at in it
        self.strikes, self.halts = Strikes(), Strikes(every=2)
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
        if len(self.parts) == 1:
            return self.parts[0]
        single = all(len(part.branch) == 1 for part in self.parts)
        branches = self.parts[0].branch if single else np.vstack([self._branches(part) for part in self.parts])
        t, states, inputs = (np.concatenate([part[k] for part in self.parts]) for k in range(3))
        return Samples(t, states, inputs, branches)

    def _branches(self, part: Samples) -> Array:
        if len(part.branch) > 1 or len(part.t) == 1:
            return part.branch
        return Motion(self.system, self.system.engine, part.t, part.states, part.branch, self.began).coordinates[0]

    def run(self) -> tuple[str, str]:
        """Go to the last sample; return a status and a sentence. What user code raises goes through."""
        last, doubled = float(self.times[-1]), False
        out = self.begins
        while True:
            if out.event is not None:
                self.events.append(out.event)
            if out.sentence:
                if not self.parts:
                    self._keep_start(out)
                return "stopped", f"stopped at t = {self.t:.6g} s: {out.sentence}."
            rest = self.times[self.times > self.t] if self.stretches else self.times
            if self.stretches and doubled:
                rest = np.concatenate([[self.t], rest])
            if not len(rest):
                return _finished(last)
            try:
                mover, loop = self._begin(out, rest, doubled)
            except VlmbError as error:
                if not self.parts:
                    raise
                return "failed", f"failed at t = {self.t:.6g} s: {error}"
            asked = self.until in out.happened
            if self.t >= last or asked:
                mover.note(self.t, out.y)
                self._keep(told=True)
                return ("stopped", f"stopped at t = {self.t:.6g} s: {self.until}.") if asked else _finished(last)
            status, message = loop.run()
            self.y = np.array(loop.driver.point)
            if status != "switched":
                self._keep(told=True, goes_on=status == "failed")
                self.t = loop.t
                return status, message + (self._beside_paradox(out.footings) if status == "failed" else "")
            assert loop.hit is not None
            self.t = loop.t
            try:
                out = self._after(loop.hit, mover, out.footings)
            except VlmbError as error:
                self._keep(told=True)
                return "failed", f"failed at t = {self.t:.6g} s: {error}"
            doubled = out.event is not None
            self._keep(told=doubled or bool(out.sentence), goes_on=True)
            self.turns.append(self._turned(loop.hit, out))

    def _beside_paradox(self, footings: tuple[Footing, ...]) -> str:
        """Name a contact that slides where friction takes all that its normal force pushes it out with, if there is one."""
        self.standing = footings
        for k, (point, at) in enumerate(zip(self.points, footings, strict=True)):
            if at.state != SLIDING or not point.contact.slips or point.edge is not None:
                continue
            frame, matrix = self._frame(k), self._without_forces(self.y).matrix[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
            own = frame @ matrix @ frame.T
            left = float(own[-1, -1] - point.coefficient * own[-1, :-1] @ (frame[:-1] @ np.array(at.towards)))
            if abs(left) < BESIDE * own[-1, -1]:
                angle = self._angle_to(point)
                told = f" at {angle:.4g} rad" if angle is not None else ""
                return (
                    f"; contact {point.name!r}{told}: with friction {point.coefficient:g} its force grows without bound there, "
                    "beside where none is admissible (Painleve); take a smaller friction"
                )
        return ""

    def _turned(self, hit: Watched, out: Outcome) -> Turn:
        """Return how a run goes on after the event of a contact."""
        modes = tuple((point.name, point.shown(at)) for point, at in zip(self.points, out.footings, strict=True))
        told = out.event
        if told is None:
            name = self.points[hit.which].name
            return Turn(self.t, f"{hit.name} {name}", (name,), modes)
        return Turn(self.t, f"{told.kind} {told.name}", told.contacts, modes)

    def _keep_start(self, out: Outcome) -> None:
        """Keep the start of a run that goes no further."""
        mover, _ = self._begin(out, self.times[:1], told=False)
        mover.note(self.t, out.y)
        self._keep(told=True)

    def _begin(self, out: Outcome, times: Array, told: bool) -> tuple[Engine, Loop]:
        """Begin a phase."""
        mover = self._next(out.footings, told)
        breaks = [at for at in self.breaks if at >= self.t]
        goes = (self.t, self.bounds, self.tell, self.longest)
        give, began = self.hand, self.began
        hand = None if give is None else (lambda t, states: give(t, states, began))
        y = self._planted(out, mover)
        loop = Loop(mover, self.options, y, times, breaks, *goes, hand, self._slides_on)
        self.begun, self.mover = (mover, loop, out.footings), mover
        return mover, loop

    def _planted(self, out: Outcome, mover: Engine) -> Array:
        """Return the state after an event, in which a base that a contact holds has no speed left by rounding."""
        if not any(at.planted for at in out.footings):
            return out.y
        y, first = np.array(out.y), mover.velocities.start
        y[first : first + (3 if mover.name == "core" else self.system.mechanism.layout.base_size)] = 0.0
        return y

    def _slides_on(self, c: int, t: float, y: Array) -> bool:
        """Whether a sliding contact that is at a right angle to its last direction at (t, y) has a speed there."""
        point = self.points[c]
        if self.plane or point.edge is not None or self.begun is None:
            return False
        mover, _, footings = self.begun
        jet = mover.look_at_contacts(t, y).jets[c]
        frame, _ = point.frame(t, jet[:3, 0], self.plane, footings[c])
        across = frame[:-1] @ (jet[:3, 1] - np.array(point.contact.surface_velocity))
        return bool(np.linalg.norm(across) > TURNING)

    def _next(self, footings: tuple[Footing, ...], told: bool) -> Engine:
        """Return the engine of the next phase; it goes on from the last one where nothing was told."""
        before, began, last = self.now, self.began, float(self.times[-1])
        self.began = self.t if told else began
        self.now = self.systems.of(footings, self.began)
        if before is not None and told and self.systems.timed:
            require_going_on(before, began, self.now, self.t)
        lawful = any(leg.leg.law is not None for leg in self.legs)
        if self.t < last and (self.systems.timed or lawful or goes_by_phase(self.systems.scene)):
            self.breaks = self._breaks(self.now, self.t, last)
            self.bounds = longest_steps(self.now.mechanism.scene, self.t, last)
        ready, self.ready = self.ready, None
        return make_engine(self.now, self.branch, self.control) if ready is None else ready

    def _breaks(self, system: System, start: float, end: float) -> Sequence[float]:
        """Return the times at which what acts in a phase is not smooth."""
        return breaks_of(system, start, end)

    def _keep(self, told: bool, goes_on: bool = False) -> None:
        """Keep the samples of the phase under way; without `told` its last instant is none unless it was asked for.

        goes_on : whether angles are read from here on
        """
        assert self.begun is not None
        mover, loop, footings = self.begun
        self.begun = None
        recorded = loop.recorded
        self.steps += loop.steps
        self.evaluations += loop.evaluations
        self.events += [Event(*happened) for happened in loop.happened]
        self.turns += loop.turns
        start = self.stretches[-1].end if self.stretches else loop.start
        if not told and len(recorded.t) and recorded.t[-1] not in self.times:
            recorded = Recorded(recorded.t[:-1], recorded.states[:-1])
        first = sum(len(part.t) for part in self.parts)
        if len(recorded.t):
            part = samples_of(mover, recorded)
            self.parts.append(part)
            self.branch = list(self._branches(part)[-1]) if goes_on else self.branch
        self.stretches.append(Stretch(start, loop.t, footings, first, first + len(recorded.t), self.quiet))
        self.quiet = not told

    def _at_start(self) -> Outcome:
        """Find how contacts stand at the start. Raises SceneError for a start under a surface."""
        planted = self._planted_at_start()
        if planted is not None:
            return planted
        found = self._without_forces(self.y)
        footings, near = [], []
        for point, jet in zip(self.points[: len(self.points) - len(self.legs)], found.jets, strict=False):
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
                self._require_hold(point, jet)
        footings += self._legs_at_start(found.jets)
        lawful = [point for point in self.legs if footings[point.index].state == SLIDING]
        held, landing = [leg.index for leg in lawful], [leg.index for leg in lawful if leg.leg.foot is None]
        return self._settled(None, tuple(footings), [*near, *held], set(), {}, landing)

    def _planted_at_start(self) -> Outcome | None:
        """Return how contacts stand where a base rests that the ground holds, and nothing else touches; None anywhere else.

        The phase in which it holds shows by its own forces that it goes on: no mode sticks more. A control is not asked here.
        """
        planting = [point for point in self.points if point.plants]
        if len(planting) != 1 or self.control is not None or not self.systems.kept or self.legs:
            return None
        (point,), index, first = planting, self.system.mechanism.layout.index, self.system.core_plan.positions
        if point.smooth or point.contact.when or math.hypot(*self.y[first : first + 3].tolist()) > STILL:
            return None
        place = np.array([self.branch[index[name]] if name else 0.0 for name in point.names])
        if abs(point.gap(self.t, place)) > NEAR_AT_START:
            return None
        footings = _with((Footing(),) * len(self.points), point.index, point.footing_at(HELD, self.t, place, self.plane))
        try:
            mover = self._mover(footings)
            look = mover.look_at_contacts(self.t, self.y)
        except VlmbError:
            return None  # other modes are looked for
        if any(self._gap(other, look.jets[other.index]) <= NEAR_AT_START for other in self.points if other is not point):
            return None
        jet = look.jets[point.index]
        if jet[3, 1] < 0.0 or jet[:3, 0].tolist() != place.tolist():
            return None
        *across, push = (point.frame(self.t, place, self.plane, footings[point.index])[0] @ look.ground).tolist()
        if not (push > LIGHT * self.weight and math.hypot(*across) < SURE * point.at_rest * push):
            return None
        self.ready = mover
        return Outcome(footings, self.y)

    def _require_hold(self, point: ContactPoint, jet: Array) -> None:
        """Refuse a start that slides along rough ground: nothing holds it there at once, and nothing lets it slide."""
        if not point.rough or point.edge is not None:
            return
        speed = self._local(jet, point.index, self._frame(point.index))
        across = float(np.linalg.norm(speed[:-1]))
        if across > SLIDES and abs(speed[-1]) <= STILL:  # else it leaves, or an impact stops it
            raise SceneError(
                f"start: contact {point.name!r} slides at {across:.3g} m/s along rough ground, which never lets a point slip: "
                "give rates with which it rests, or the contact a finite friction"
            )

    def _after(self, hit: Watched, mover: Engine, footings: tuple[Footing, ...]) -> Outcome:
        """Return what follows the event of a contact."""
        c = hit.which
        self.switched = [*self.switched[1 - MANY :], (self.t, self.points[c].name)]
        if len(self.switched) == MANY and self.t - self.switched[0][0] <= SPAN:
            names = listed(sorted({name for _, name in self.switched}))
            gives = any(self.points[k].contact.restitution for k in self.strikes.last)
            why = f"they would never end{'; a restitution of 0 ends them' if gives else ''}"
            return Outcome(footings, self.y, None, f"{MANY} events of contacts within {SPAN} s ({names}): {why}")
        if hit.name == REARMS:
            return Outcome(_with(footings, c, footings[c]._replace(state=OPEN)), self.y)
        if hit.name == TOUCHES and not self._allows(self.points[c], self.y):
            return Outcome(_with(footings, c, Footing(AWAY)), self.y)
        self.standing = footings
        forces = self._forces(mover.look_at_contacts(self.t, self.y), footings)
        weight = max([self.weight, *(abs(force[2]) for force in forces.values())])
        if hit.name == SLIPS and c in forces and forces[c][2] <= LIGHT * weight:
            hit = hit._replace(name=OPENS)  # nothing is left of its force: it lifts, and does not slip
        before, (hit, stand, landing, lost) = footings, self._with_legs(hit, footings)
        footings = tuple(stand)
        self._take_lost(lost)
        jets = self._without_forces(self.y).jets
        near = [c] if not isinstance(self.points[c], LegPoint) else []
        for point, jet, at in zip(self.points, jets, footings, strict=True):
            touches = not isinstance(point, LegPoint) and at.state == OPEN and self._gap(point, jet) - min(at.gap, 0.0) <= NEAR
            if at.state in CLOSED or (touches and point.index != c):
                near.append(point.index)
        opening, leaving = set[int](), dict[int, tuple[int, Array]]()
        if hit.name == OPENS:
            carry = [k for k in forces if footings[k].state != RESTING]
            opening = {k for k in carry if forces[k][2] <= LIGHT * weight} | {c}
        elif hit.name == SLIPS and c in forces:
            leaving[c] = hit.part, forces[c][:2]
        near, landing = sorted(set(near)), [k for k in landing if footings[k].state in CLOSED]
        out = self._settled(hit, footings, near, opening, leaving, landing, before)
        if not lost or out.event is None:
            return out
        return out._replace(event=out.event._replace(lost=out.event.lost + lost))


def _finished(last: float) -> tuple[str, str]:
    return "finished", f"finished at t = {last:.6g} s."


def _with(footings: tuple[Footing, ...], k: int, footing: Footing) -> tuple[Footing, ...]:
    return (*footings[:k], footing, *footings[k + 1 :])
