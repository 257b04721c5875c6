"""Events that end a run with a sentence: a segment at its limit, a rider on the snow."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.optimize import brentq

from vlmb.errors import SceneError, VlmbError
from vlmb.model.coordinates import segment_of
from vlmb.simulation.integrate import short_run
from vlmb.system.system import Workspace

Array = NDArray[np.float64]
SHORT_STEPS = 500  # of a short run that looks for an event
SCAN = 64  # points looked at where a segment may have crossed its limit between two samples


class Watch:
    """Looks at a state, and between two where a cubic through them could leave the limits.

    `quiet`: right-hand sides look at all lengths themselves, and none came near a limit since the start: looks may be rare.
    """

    def __init__(self, workspace: Workspace, y: Array, fall: bool, rtol: float, atol: float) -> None:
        self.workspace, self.tolerances = workspace, (rtol, atol)
        mechanism, layout = workspace.mechanism, workspace.layout
        self.names: list[str] = []
        self.segments: list[tuple[int, int, float, float]] = []  # where length and rate are in y, and their limits
        for c in layout.coordinates:
            if c.kind == "xi":
                at, (low, high) = segment_of(layout, c), mechanism.segment(c).bounds
                self.names.append(c.name)
                self.segments.append((at.q, layout.nq + at.v, low, high))
        workspace.springs.watch(y)
        self.told = workspace.springs.guarded and not (workspace.system.prescribed or workspace.route == "subchains")
        self.points: list[str] = []
        self.frames: Mapping[str, int] = {}
        if fall and layout.base == "ski":
            self.frames = mechanism.frames
            self.points = [f"{link.name}.{point}" for link in layout.links for point in ("rod_end", "tip")]

    @property
    def quiet(self) -> bool:
        """Whether nothing can have happened that was not told."""
        return self.told and not (self.points or self.workspace.springs.near)

    def refuse_start(self, y: Array) -> None:
        """Raise SceneError for a start with a point under the snow."""
        for name in self.points:
            height = self._height(name, y)
            if height < -1e-12:
                raise SceneError(f"start: {name} is {-height:.3g} m under the snow; raise psi, or set run.fall = false")

    def between(self, t0: float, y0: Array, t1: float, y1: Array) -> tuple[float, str] | None:
        """Return (time, sentence) of the first event in (t0, t1], or None."""
        found: list[tuple[float, str]] = []
        third, before, after = (t1 - t0) / 3.0, y0.item, y1.item
        for name, (q, v, low, high) in zip(self.names, self.segments, strict=True):  # scalars: a fraction of numpy's time
            a, b, c = before(q) + third * before(v), after(q) - third * after(v), after(q)
            if low <= a <= high and low <= b <= high and low <= c <= high:
                continue
            for bound, sign in ((low, 1.0), (high, -1.0)):
                if math.isfinite(bound):
                    crossing = self._crossing(t0, y0, t1, y1, self._room(q, bound, sign))
                    if crossing is not None:
                        found.append((crossing, f"{name} reached its limit {bound:g} m"))
        for name, height in zip(self.points, self._heights(y1), strict=True):
            if height < 0.0:
                crossing = self._crossing(t0, y0, t1, y1, partial(self._height, name))
                if crossing is not None:
                    found.append((crossing, f"fall: {name} reached the snow"))
        return min(found) if found else None

    def _room(self, q: int, bound: float, sign: float) -> Callable[[Array], float]:
        return lambda y: sign * (float(y[q]) - bound)

    def _height(self, name: str, y: Array) -> float:
        return self._heights(y)[self.points.index(name)]

    def _heights(self, y: Array) -> list[float]:
        """Heights [m] of all points that must stay above the snow."""
        if not self.points:
            return []
        model, data = self.workspace.mechanism.model, self.workspace.frames.data
        pin.forwardKinematics(model, data, pin.normalize(model, y[: self.workspace.nq]))
        return [pin.updateFramePlacement(model, data, self.frames[name]).translation.item(2) for name in self.points]

    def _crossing(self, t0: float, y0: Array, t1: float, y1: Array, value: Callable[[Array], float]) -> float | None:
        """First time in (t0, t1] at which `value` is negative, by one run through the interval in short pieces."""
        if value(y0) < 0.0:
            return None  # it starts outside: the start was checked
        before, state = t0, y0
        for t in np.linspace(t0, t1, SCAN + 1)[1:].tolist():
            here = self._go_on(before, state, t, t0, y0, t1, y1)
            if value(here) < 0.0:
                left, from_state = before, state

                def at(time: float, left: float = left, from_state: Array = from_state) -> float:
                    return value(self._go_on(left, from_state, time, t0, y0, t1, y1))

                return float(brentq(at, before, t, xtol=1e-12)) if value(state) > 0.0 else before
            before, state = t, here
        return None

    def _go_on(self, t: float, y: Array, end: float, t0: float, y0: Array, t1: float, y1: Array) -> Array:
        """y(end) by a short run; where that fails, on the line between the two samples."""
        try:
            return self.state_at(t, y, end)
        except VlmbError:
            share = (end - t0) / (t1 - t0)
            return y0 + share * (y1 - y0)

    def state_at(self, t0: float, y0: Array, t: float) -> Array:
        """y(t) by a short run from (t0, y0)."""
        return y0 if t <= t0 else short_run(self.workspace.rhs, t0, y0, t, *self.tolerances, steps=SHORT_STEPS)
