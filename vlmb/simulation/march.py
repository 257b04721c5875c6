"""The march of a run through its time: from break to break of its laws, from look to look, from sample to sample."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SimulationError, SingularError, VlmbError
from vlmb.model.coordinates import State
from vlmb.scene.tables import DEFAULT_STEP, Run
from vlmb.simulation.events import Watch
from vlmb.simulation.integrate import Driver, find_method, short_run
from vlmb.simulation.trajectory import Sample
from vlmb.system.diagnostics import HUGE
from vlmb.system.system import Workspace
from vlmb.system.types import Rhs

Array = NDArray[np.float64]

INSIDE = 1e-12  # relative distance kept from a break of a law
LOOKS = 60.0  # [1/s] looks at events and angles; at times of their own, so that the choice of samples changes no motion
LONGEST = 0.1  # [s] between two looks where a driver's steps are longer than 1 / LOOKS and no angle is read
QUIET = 0.5  # [s] between two looks while right-hand sides themselves look at all that could happen
MANY = 1000  # steps between two looks, about, at most: drivers give up after more than MAX_STEPS
CLOSEST = 1e-7  # [s] between two looks
SAME = 1e-9  # [s] a sample this near to a look is one


class _CloserLookError(Exception):
    """Something may have happened since the last look."""


class March:
    """Advances a state through all samples; keeps what was recorded, whatever stops it."""

    def __init__(
        self,
        workspace: Workspace,
        run: Run,
        y: Array,
        times: Array,
        breaks: tuple[float, ...],
        progress: Callable[[float], None] | None = None,
    ) -> None:
        self.workspace, self.options, self.times, self.breaks = workspace, run, times, breaks
        self.tell = progress
        self.method = find_method(run.method)
        self.watch = Watch(workspace, y, run.fall, run.rtol, run.atol)
        self.watch.refuse_start(y)
        self.timed = bool(workspace.applied.channels or workspace.system.prescribed)
        self.angles, self.start = workspace.system.reads_angles, np.array(workspace.branch)
        self.calm = self.method.adaptive and not (self.method.stiff or self.angles)  # looks may be rare
        self.wanted = set(times.tolist())
        self.recorded: list[Sample] = []
        self.driver: Driver | None = None
        self.done = 0  # steps of drivers before this one
        self.t, self.y = 0.0, y
        self.step = 0.0  # [s] of the driver, at the last look
        self.room = 0.0  # [s] for which forces may rely on the branches of angles
        self.seen, self.quiet, self.look = (0.0, y), False, 0.0

    @property
    def steps(self) -> int:
        """Accepted steps so far."""
        return self.done + (self.driver.steps if self.driver is not None else 0)

    def run(self) -> tuple[str, str]:
        """Go to the last sample; return a status and a sentence.

        An error of the user's control or progress goes through, once what was recorded is in order: see `failed_by`.
        """
        last = float(self.times[-1])
        try:
            try:
                if 0.0 in self.wanted:
                    self._record(0.0, self.y)
                for end in [*(b for b in self.breaks if b < last), last] if last > 0.0 else []:
                    sentence = self._stretch(end, last)
                    if sentence is not None:
                        return "stopped", sentence
            except VlmbError as error:
                with contextlib.suppress(VlmbError):
                    sentence = self._ended()  # an event before what failed
                    if sentence is not None:
                        return "stopped", sentence
                self._keep_something()
                why = "" if isinstance(error, SingularError) else self._why()
                return "failed", f"failed at t = {self.t:.6g} s: {error}{why}{self._unknown()}"
        except KeyboardInterrupt:
            self._keep_what_is_sure()
            return "interrupted", f"interrupted at t = {self.t:.6g} s; the part so far is kept{self._unknown()}."
        except Exception:
            self._keep_what_is_sure()
            raise
        return "finished", f"finished at t = {last:.6g} s."

    def failed_by(self, error: Exception) -> str:
        """Return the sentence for an error that went through."""
        reader = self.workspace.applied.reader
        source = "the control raised " if reader is not None and error is reader.failure else ""
        return f"failed at t = {self.t:.6g} s: {source}{type(error).__name__}: {error}{self._unknown()}"

    def _stretch(self, end: float, last: float) -> str | None:
        """Go to a break, or the end; return a sentence if an event stops the run before.

        What fails or comes near a limit between two rare looks is gone through again with close ones.
        """
        rhs = _between(self.workspace.rhs, self.t, end, last) if self.timed else self.workspace.rhs
        self._leave_driver()
        self.room = max(CLOSEST, self.workspace.accept(self.t, self.y)[1])
        self.seen, self.quiet, self.look = (self.t, self.y), False, self.t + min(1.0 / LOOKS, self.room)
        while True:
            try:
                return self._through(rhs, end)
            except _CloserLookError:
                pass
            except VlmbError:
                if not self.quiet:
                    raise
            self._forget_since(self.seen[0])
            self._leave_driver()
            (self.t, self.y), self.calm, self.quiet = self.seen, False, False
            self.look = self.t + min(1.0 / LOOKS, self.room)

    def _through(self, rhs: Rhs, end: float) -> str | None:
        for target in [*self.times[(self.times > self.t) & (self.times < end)].tolist(), end]:
            while self.look < target - SAME:
                self._advance(rhs, self.look, end)
                sentence = self._look()
                if sentence is not None:
                    return sentence
            self._advance(rhs, target, end)
            if target >= min(self.look, end) - SAME:
                sentence = self._look()
                if sentence is not None:
                    return sentence
            if target in self.wanted:
                self._record(target, self.y)
            if self.tell is not None:
                self.tell(target)
        return None

    def _advance(self, rhs: Rhs, stop: float, end: float) -> None:
        driver, run, method = self.driver, self.options, self.method
        if method.adaptive and self.room < 2.0 * self.step:  # a step could pass over the swing of an azimuth
            self._leave_driver()
            self.done += 1
            self.y = short_run(rhs, self.t, self.y, stop, run.rtol, run.atol)
        else:
            if driver is None:
                size = run.step or DEFAULT_STEP
                driver = self.driver = method.make(
                    rhs, self.t, self.y, end, rtol=run.rtol, atol=run.atol, step_size=size, hard_end=self.timed
                )
            self.y = driver.advance(stop)
            if self.angles:
                self.step = driver.step
        self.t = stop

    def _leave_driver(self) -> None:
        self.done, self.driver = self.steps, None

    def _look(self) -> str | None:
        """Take an event since the last look for the end of the run; else choose the time of the next look."""
        if not self.y.dot(self.y) < HUGE * HUGE:
            self.t, self.y = self.seen
            self._forget_since(self.t)
            raise SimulationError("the state is no longer finite")
        if self.quiet and not self.watch.quiet:
            raise _CloserLookError
        sentence = self._ended()
        if sentence is not None:
            return sentence
        if self.driver is not None:
            self.step = self.driver.step
        self.room = max(CLOSEST, self.workspace.accept(self.t, self.y)[1])
        self.seen, self.quiet = (self.t, self.y), self.calm and self.watch.quiet
        if self.quiet:
            self.look += min(QUIET, max(1.0 / LOOKS, MANY * self.step))
        else:
            stride = 0.0 if self.angles else min(self.method.stride * self.step, LONGEST)
            self.look += min(self.room, max(1.0 / LOOKS, stride))
        return None

    def _ended(self) -> str | None:
        """Look back at what came since the last look."""
        (since, before) = self.seen
        event = None if self.quiet else self.watch.between(since, before, self.t, self.y)
        if event is None:
            return None
        when, sentence = event
        state = self.watch.state_at(since, before, when)
        while self.recorded and self.recorded[-1].t >= when:
            self.recorded.pop()
        self._record(when, state)
        return f"stopped at t = {when:.6g} s: {sentence}."

    def _forget_since(self, t: float) -> None:
        while self.recorded and self.recorded[-1].t > t:
            self.recorded.pop()

    def _record(self, t: float, y: Array) -> None:
        """Take a sample with the forces that the control gives there, asked once, now."""
        state = self.workspace.unpack(t, y)
        self._keep(t, y, state, self.workspace.inputs(t, state))

    def _keep(self, t: float, y: Array, state: State, inputs: Array) -> None:
        branch = np.array(self.workspace.branch) if self.angles else self.start
        self.recorded.append(Sample(t, *state, y[self.workspace.nq + self.workspace.nv :], inputs, branch))

    def _keep_what_is_sure(self) -> None:
        if self.quiet and not self.watch.quiet:  # what came since the last look may be beyond an event
            self._forget_since(self.seen[0])
        self._keep_something()

    def _keep_something(self) -> None:
        """Keep one sample at least; a control that has failed is not asked again."""
        if not self.recorded:
            nothing = np.full(len(self.workspace.applied.inputs), np.nan)
            self._keep(self.t, self.y, self.workspace.unpack(self.t, self.y), nothing)

    def _unknown(self) -> str:
        lost = self.recorded and np.isnan(self.recorded[-1].inputs).any()
        return "; the forces of the control at this sample are not known" if lost else ""

    def _why(self) -> str:
        """Add what the mass matrix says about a place where a run failed."""
        workspace = self.workspace
        condition, names = workspace.diagnostics.conditioning(self.y[: workspace.nq])
        if condition > 1e10:
            weak = ", ".join(names)
            return f" The mass matrix is nearly singular there (condition {condition:.1e}): {weak} move almost without inertia."
        return workspace.solver.programme.weakness() if workspace.solver.programme else ""


def _between(rhs: Rhs, start: float, end: float, last: float) -> Rhs:
    """Keep the time of a right-hand side inside two breaks: no law is asked for its other side, nor beyond the last time."""
    low = start + INSIDE * start
    high = end if end == last else end - INSIDE * end
    return lambda t, y: rhs(min(max(t, low), high), y)
