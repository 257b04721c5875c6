"""A run in phases: intervals in which each contact stays open, held or sliding, and what happens between them.

Each phase is a run of its own, of the system that has the rows of what is closed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, VlmbError
from vlmb.scene.names import listed
from vlmb.scene.tables import Run
from vlmb.simulation.contact_view import Engine
from vlmb.simulation.loop import Loop, Recorded
from vlmb.simulation.motion import Motion
from vlmb.simulation.phases import Event, Stretch
from vlmb.simulation.samples import Samples, samples_of
from vlmb.simulation.settling import Outcome, Settling
from vlmb.system.contacts import AWAY, CLOSED, LIGHT, OPEN, Footing
from vlmb.system.events import OPENS, REARMS, SLIPS, TOUCHES
from vlmb.system.events import Event as Watched
from vlmb.system.forces import Control
from vlmb.system.system import System

Array = NDArray[np.float64]

NEAR, NEAR_AT_START = 1e-9, 1e-6  # [m] a gap that counts as none
MANY, SPAN = 1000, 0.1  # more events within so many seconds end a run


class PhasedRun(Settling):
    """Takes a state through all phases; to its caller it is what a Loop is."""

    def __init__(
        self, system: System, run: Run, y: Array, times: Array, breaks: Sequence[float], start: float, bounds: Array,
        branch: Sequence[float], control: Control | None, progress: Callable[[float], None] | None = None,
        longest: float = np.inf, until: str = "",
    ) -> None:  # fmt: skip
        self.system, self.options, self.points, self.control = system, run, system.points, control
        super().__init__(system, y, start, branch, control)
        self.options, self.until = run, until
        self.times, self.breaks, self.bounds, self.tell, self.longest = times, breaks, bounds, progress, longest
        self.stretches: list[Stretch] = []
        self.events: list[Event] = []
        self.parts: list[Samples] = []
        self.steps, self.evaluations, self.quiet = 0, 0, False
        self.switched: list[tuple[float, str]] = []  # the last events of contacts, told or not
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
                if not self.stretches:
                    self._begin(out, self.times)
                return "stopped", f"stopped at t = {self.t:.6g} s: {out.sentence}."
            rest = self.times[self.times > self.t] if self.stretches else self.times
            if self.stretches and doubled:
                rest = np.concatenate([[self.t], rest])
            if not len(rest):
                return _finished(last)
            mover, loop = self._begin(out, rest)
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

    def _begin(self, out: Outcome, times: Array) -> tuple[Engine, Loop]:
        """Begin a phase."""
        mover = self._mover(out.footings)
        breaks = [at for at in self.breaks if at > self.t]
        loop = Loop(mover, self.options, out.y, times, breaks, self.t, self.bounds, self.tell, self.longest)
        self.begun, self.mover = (mover, loop, out.footings), mover
        return mover, loop

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


def _finished(last: float) -> tuple[str, str]:
    return "finished", f"finished at t = {last:.6g} s."


def _with(footings: tuple[Footing, ...], k: int, footing: Footing) -> tuple[Footing, ...]:
    return (*footings[:k], footing, *footings[k + 1 :])
