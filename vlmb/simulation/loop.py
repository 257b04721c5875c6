"""The loop of a run: from break to break of its laws, from event to event; what was recorded is kept, whatever stops it."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.core.calls import begin, state_at
from vlmb.core.driver import (
    ANSWER,
    AT_START,
    CROSSING,
    DONE,
    EVALUATIONS,
    FIRST_STEP_SIZE,
    GO_ON,
    HIT,
    NEXT_SAMPLE,
    NOISY,
    OVER,
    PHASE,
    SIDE,
    SLICE,
    SLICE_SIZE,
    STEPS,
    STOP,
    STOP_TIME,
    STOPPED,
    STUCK,
    TIME,
    TIME_BEFORE,
    ZERO,
    ZERO_RATE,
    H,
    Y,
    make_driver,
)  # fmt: skip
from vlmb.core.locate import Crossing, crossings
from vlmb.errors import SimulationError, SingularError, VlmbError
from vlmb.scene.tables import DEFAULT_STEP, Run
from vlmb.simulation.engine import Engine
from vlmb.simulation.grips import set_out, take_hold
from vlmb.simulation.methods import find_method
from vlmb.simulation.onto import step_onto
from vlmb.simulation.passage import Passage, Passing
from vlmb.simulation.phases import Turn
from vlmb.simulation.stretch_ends import arrive, gap_at, leave, looked_for, refuse_start
from vlmb.simulation.stuck import why_stuck
from vlmb.simulation.switches import TOO_MANY, drives_back, earliest, go_beyond
from vlmb.system import interrupts
from vlmb.system.events import CONTACT, DEPENDENT, FALL, GRIP, IN_LINE, LINE_UP, NAMED, OPENS, SLIPS, STICKS, SWITCH, TOLD, Event

Array = NDArray[np.float64]

SLICE_SECONDS = 0.03  # of a slice, between two looks at signals
CLOSE = 1e-6  # of a run: so near before a break a law that has no value there is what stops it
SHORTER, SHORTEST = 0.25, 1e-12  # of a step that is begun anew; [s] one that is not
JUMPS = (OPENS, SLIPS)  # forces jump, motions do not


class Recorded(NamedTuple):
    """The samples of a run so far."""

    t: Array  # (N,)
    states: Array  # (N, size)


class Loop:
    """Takes a state through all samples."""

    def __init__(
        self, engine: Engine, run: Run, y: Array, times: Array, breaks: Sequence[float], start: float, bounds: Array,
        progress: Callable[[float], None] | None = None, longest: float = np.inf,
        hand: Callable[[Array, Array], None] | None = None, slides_on: Callable[[int, float, Array], bool] | None = None,
    ) -> None:  # fmt: skip
        self.engine, self.breaks, self.bounds, self.tell = engine, breaks, bounds, progress
        self.method, self.controlled = find_method(run.method), longest < np.inf
        self.h_max = longest if run.max_step is None else run.max_step
        step = 0.0 if self.method.adaptive else run.step or DEFAULT_STEP
        self.looked = looked_for(tuple(engine.events))
        self.driver = make_driver(
            self.method.driver, engine.size, times, self.looked.directions, rtol=run.rtol, atol=run.atol, step=step,
            h_max=self.h_max, slice_size=engine.first_slice,
        )  # fmt: skip
        self.driver.point[:], self.driver.indicators[ZERO : ZERO_RATE + 1] = y, self.looked.near
        self.t, self.start, self.last = start, start, float(times[-1])
        self.extra: tuple[float, Array] | None = None  # the instant of the event that ended the run
        self.switched: list[float] = []  # times of the last switches
        self.hit: Event | None = None  # of a contact, that ended a phase
        self.happened: list[tuple[float, str, str]] = []  # time, kind and name of what is told
        self.turns: list[Turn] = []  # where it began anew
        self.passing, self.gripped = Passing(engine), -np.inf  # when a ski stopped or slipped last
        self.hand, self.handed = hand, 0  # what takes samples (times, states) while the run goes on, and how many it has
        self.told, self.kept = start, len(times)  # time that progress was told last; samples, at most
        self.slides_on, self.again = slides_on, False  # whether a contact has a speed at (t, y); whether this step is begun anew
        if FALL in self.looked.kinds:
            refuse_start(engine, start, y)

    @property
    def steps(self) -> int:
        """Accepted steps so far."""
        return int(self.driver.counts[STEPS])

    @property
    def evaluations(self) -> int:
        """Right-hand sides so far."""
        return int(self.driver.counts[EVALUATIONS])

    def failed_by(self, error: BaseException) -> str:
        """Return the sentence for an error that went through."""
        self._go_back()
        source = "the control raised " if self.engine.raised(error) else ""
        return f"failed at t = {self.t:.6g} s: {source}{type(error).__name__}: {error}"

    @property
    def recorded(self) -> Recorded:
        """The samples so far; the instant of the event that ended the run is the last; one at least."""
        count = min(int(self.driver.counts[NEXT_SAMPLE]), self.kept)
        t, states = self.driver.times[:count], self.driver.samples[:count]
        instant = self.extra or (None if count else (self.t, np.array(self.driver.point)))
        if instant is not None and not (count and t[-1] >= instant[0]):
            return Recorded(np.append(t, instant[0]), np.vstack([states, instant[1]]))
        whole = count == len(self.driver.times)  # else what is not filled would be kept with it
        return Recorded(t, states) if whole else Recorded(np.array(t), np.array(states))

    def run(self) -> tuple[str, str]:
        """Go to the last sample, or to the end of a phase; return a status and a sentence. What user code raises goes through."""
        try:
            for end in [*(b for b in self.breaks if self.start < b < self.last), self.last]:
                if self.t != self.start:
                    self.turns.append(Turn(self.t, "a break of a law"))
                sentence = self._stretch(end)
                if self.hit is not None:
                    return "switched", ""
                if sentence is not None:
                    return "stopped", f"stopped at t = {self.t:.6g} s: {sentence}."
        except VlmbError as error:
            self._go_back()
            why = ""
            if not isinstance(error, SingularError):
                with contextlib.suppress(VlmbError):
                    why = self.engine.why(self.t, self.driver.point)
            return "failed", f"failed at t = {self.t:.6g} s: {error}{why}"
        except KeyboardInterrupt:
            self._go_back()
            return "interrupted", f"interrupted at t = {self.t:.6g} s; the part so far is kept"
        return "finished", f"finished at t = {self.last:.6g} s."

    def _stretch(self, end: float) -> str | None:
        """Go to a break, or the end; return a sentence if an event ends the run before."""
        before, after = [gap_at(t, self.breaks, self.last - self.start) for t in (self.t, end)]
        inside, until = self.t + before, end - after
        if before or SWITCH in self.looked.kinds:
            leave(self.engine, self.driver, self.t, before, self.t == self.start)
        inside, side = take_hold(self.engine, self.driver.point, min(inside, until), until)
        set_out(self.looked.grips, self.driver, inside, until, side)
        if self.t != self.start and self._is_dependent():  # a break on the way through: the event itself has been
            self.t = min(inside, until)
            sentence = self._pass(until)
            if sentence is not None:
                return sentence
        if self.t != self.start and self._lets_go():
            return None
        found = self.passing.leave(self.driver, self.t, until) if self.t == self.start and self.engine.dependent >= 0 else None
        sentence = self._along(found, until) if found is not None else None
        if sentence is not None:
            return sentence
        while True:
            code = self._slice()
            if code == DONE:
                self.t = end
                arrive(self.engine, self.driver, end, after)
                self._tell()
                return None
            if code == CROSSING:
                self._answer()
            elif code == STOPPED and self.again:
                self._begin_again(until)
            elif code == STOPPED:
                self._note_time()
                self._step_onto()
                self._tell()
                sentence = self._after_stop(until)
                if sentence is not None:
                    return sentence
            elif code != SLICE:
                self._note_time()
                beyond = go_beyond(self.engine, self.driver, self.t) if code in (STUCK, NOISY) else None
                self.t = self.t if beyond is None else beyond
                sentence = self._in_line(self._failure(code, end)) if beyond is None else self._after_stop(until)
                if sentence is not None:
                    return sentence

    def _lets_go(self) -> bool:
        """Whether what holds a closed contact has jumped below 0 at a break: no step shows it as a crossing."""
        watched = [(k, event) for k, event in enumerate(self.engine.events) if event.kind == CONTACT and event.name in JUMPS]
        values = self.engine.indicators(self.t, self.driver.point)[0] if watched else ()
        for k, event in watched:
            if values[k] < -event.slack:
                self.hit = event
                self._end_here()
                return True
        return False

    def _slice(self) -> int:
        """Run for a bounded time, so that interrupts are looked at."""
        began = time.perf_counter()
        code = self.engine.run(self.driver, self.bounds, self.h_max)
        if code in (SLICE, CROSSING):
            interrupts.answer()
        if code == SLICE:
            share = SLICE_SECONDS / max(time.perf_counter() - began, 1e-6)
            size = int(self.driver.counts[SLICE_SIZE])
            self.driver.counts[SLICE_SIZE] = int(min(max(size * min(max(share, 0.2), 5.0), 20), 1e9))
            self._note_time()
            self._tell()
        return code

    def _tell(self) -> None:
        """Hand out the samples taken since, and tell their times, or the time reached where there are none.

        A progress that raises ends the run at the time it was told: what was computed beyond is not kept.
        """
        count = int(self.driver.counts[NEXT_SAMPLE])
        if self.hand is not None and count > self.handed:
            new = slice(self.handed, count)
            self.handed = count
            self.hand(self.driver.times[new], self.driver.samples[new])
        if self.tell is None:
            return
        taken = self.driver.times[:count]
        for reached in taken[np.searchsorted(taken, self.told, side="right") :].tolist() or [self.t]:
            if reached > self.told:
                self.told = reached
                try:
                    self.tell(reached)
                except BaseException:
                    self.kept = int(np.searchsorted(taken, reached, side="right"))
                    raise

    def _answer(self) -> None:
        """Note the first crossing of a step that counts, and answer."""
        driver = self.driver
        found = crossings(driver, lambda t, y: self.engine.indicators(t, y)[0])
        driver.indicators[HIT] = 0.0
        driver.counts[ANSWER] = GO_ON
        stop = next((crossing for crossing in found if self._counts(crossing)), None)
        if stop is not None:
            stop = earliest(self.engine, driver, stop)
        for crossing in found:
            event = self.engine.events[crossing.indicator]
            if event.kind == NAMED and not event.sentence and not self._left(crossing) and not (stop and stop.t < crossing.t):
                self.happened.append((float(crossing.t), TOLD[NAMED], event.name))
        if stop is not None:
            self.again = self._turns(self.engine.events[stop.indicator], stop.t)
            driver.indicators[HIT, stop.indicator] = stop.direction
            driver.counts[ANSWER] = STOP
            driver.real[STOP_TIME] = driver.real[TIME_BEFORE] if self.again else stop.t

    def _left(self, crossing: Crossing) -> bool:
        """Whether an event of the scene began on its 0, and has left it."""
        return bool(crossing.t <= self.driver.real[TIME_BEFORE] and not self.driver.indicators[SIDE, crossing.indicator])

    def _counts(self, crossing: Crossing) -> bool:
        """Whether a crossing ends a step: two directions must really line up."""
        event = self.engine.events[crossing.indicator]
        if event.kind == NAMED:
            return bool(event.sentence) and not self._left(crossing)
        if event.kind != LINE_UP:
            return True
        y = np.empty_like(self.driver.point)
        state_at(self.driver, crossing.t, y)
        return self.engine.in_line(event, crossing.t, y) < IN_LINE

    def _turns(self, event: Event, t: float) -> bool:
        """Whether a contact that no longer slides along its last direction has turned there, and not stopped."""
        if self.slides_on is None or event.kind != CONTACT or event.name != STICKS or not self.method.adaptive:
            return False
        y = np.empty_like(self.driver.point)
        state_at(self.driver, t, y)
        return bool(self.driver.real[H] > SHORTEST * max(1.0, abs(t)) and self.slides_on(event.which, t, y))

    def _begin_again(self, until: float) -> None:
        """Begin a step anew with a shorter one: friction knew no direction in the part after the turn."""
        driver = self.driver
        self.again, wanted = False, float(driver.real[FIRST_STEP_SIZE])
        driver.point[:], driver.real[FIRST_STEP_SIZE] = driver.rows[Y, : self.engine.size], SHORTER * driver.real[H]
        driver.counts[STEPS] -= 1
        begin(driver, float(driver.real[TIME_BEFORE]), until)
        driver.real[FIRST_STEP_SIZE] = wanted

    def _in_line(self, error: VlmbError) -> str:
        """Return the sentence of a line-up that a step could not get nearer to: beyond it the torque has no axis; else raise."""
        for event in self.engine.events if isinstance(error, SingularError) else ():
            if event.kind == LINE_UP and self.engine.in_line(event, self.t, self.driver.point) < IN_LINE:
                self._end_here()
                return event.sentence
        raise error

    def _step_onto(self) -> None:
        """Find the time and the state of an event by a step that ends there; a control is not asked again."""
        if not self.controlled:
            self.t = step_onto(self.engine, self.driver, int(np.flatnonzero(self.driver.indicators[HIT])[0]), self.t)
            self.driver.real[TIME] = self.t

    def _after_stop(self, until: float) -> str | None:
        """Return the sentence of an event that ends the run, or a phase; a switch only begins a new step."""
        event = self.engine.events[int(np.flatnonzero(self.driver.indicators[HIT])[0])]
        if event.kind in TOLD:
            self.happened.append((float(self.t), TOLD[event.kind], event.name))
        if event.kind == SWITCH:
            self.switched = [*self.switched[-TOO_MANY:], self.t]
            if not drives_back(self.switched, self.last - self.start):
                self.turns.append(Turn(self.t, f"the switch {event.name}"))
                self.t, side = take_hold(self.engine, self.driver.point, self.t, until)
                set_out(self.looked.grips, self.driver, self.t, until, side, resumed=True)
                return None
            self._end_here()
            return (
                f"{event.name}: both sides of this switch drive back to it, and no motion along it is defined; a force that "
                "holds until it is overcome is friction, not a sign of the velocity"
            )
        if event.kind == DEPENDENT:
            return self._pass(until)
        if event.kind == GRIP:
            self.turns.append(Turn(self.t, "the ski that stops or slips"))
            self._grip(until)
            return None
        self._end_here()
        if event.kind == CONTACT:
            self.hit = event
        if event.kind == FALL and self.t == self.start:
            return f"{event.sentence} as it starts; raise psi, or set run.fall = false to go on"
        return event.sentence

    def _grip(self, until: float) -> None:
        """Go on with a ski that has stopped: it stands, or slides back; or with one that slips."""
        self.driver.point[self.engine.velocities.start] = 0.0
        self.t, side = take_hold(self.engine, self.driver.point, self.t, until, self.t <= self.gripped)
        self.gripped = self.t
        set_out(self.looked.grips, self.driver, self.t, until, side)

    def _is_dependent(self) -> bool:
        """Whether ideal rows are worth less than what is to be looked at."""
        at = self.engine.dependent
        return at >= 0 and self.engine.indicators(self.t, self.driver.point)[0].item(at) < 0.0

    def _pass(self, until: float) -> str | None:
        """Go on through a posture in which ideal rows lose their independence; return a sentence where no one way is known."""
        driver, found = self.driver, self.passing.seek(self.driver, self.t, until)
        if isinstance(found, str):
            self._end_here()
            return found
        if found is None:
            set_out(self.looked.grips, driver, self.t, until)
            return None
        return self._along(found, until)

    def _along(self, found: Passage, until: float) -> str | None:
        """Go along a passage to its end, or to the first event; return its sentence if it ends the run."""
        driver, crossing = self.driver, found.first_crossing(self.engine)
        self.t = float(found.t if crossing is None else crossing.t)
        found.write(driver, self.t)
        if crossing is None:
            set_out(self.looked.grips, driver, self.t, until)
            return None
        driver.indicators[HIT] = 0.0
        driver.indicators[HIT, crossing.indicator] = crossing.direction
        return self._after_stop(until)

    def _end_here(self) -> None:
        """Keep the instant at which an event ends the run."""
        self.extra = self.t, np.array(self.driver.point)
        self.engine.note(*self.extra)

    def _failure(self, code: int, end: float) -> VlmbError:
        """Return why a method could not go on to an end; raises at once what a law without a value there says."""
        error = self.engine.failure(self.driver)
        if error is None and end in self.breaks and end - self.t < CLOSE * (self.last - self.start):
            self.engine.evaluate(end, np.array(self.driver.point))
        return SimulationError(why_stuck(code, self.driver, self.method.adaptive)) if error is None else error

    def _note_time(self) -> None:
        """Note the time reached: of the last accepted state, or of the stop or the end within its step."""
        over = self.driver.counts[PHASE] == OVER
        self.t = float(self.driver.real[TIME if over else TIME_BEFORE])

    def _go_back(self) -> None:
        """Take the last accepted state as the one reached, where a run is left in the middle of a step."""
        if self.driver.counts[PHASE] not in (AT_START, OVER):
            self.driver.point[:] = self.driver.rows[Y, : self.engine.size]
            self._note_time()
        if self.kept < len(self.driver.times):
            self.t = min(self.t, self.told)
