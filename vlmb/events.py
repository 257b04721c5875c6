"""Events that end a run with a sentence: a segment at its limit, a rider on the snow."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.optimize import brentq

from vlmb.coordinates import segment_of
from vlmb.dynamics import Dynamics
from vlmb.errors import SceneError, VlmbError
from vlmb.integrate import short_run
from vlmb.start import limits_of

Array = NDArray[np.float64]
SHORT_STEPS = 500  # of a short run that looks for an event
SCAN = 64  # points looked at where a segment may have crossed its limit between two samples


class Watch:
    """Looks at every accepted sample, and between two where a cubic through them could leave the limits."""

    def __init__(self, dynamics: Dynamics, fall: bool, rtol: float, atol: float) -> None:
        self.dynamics, self.tolerances = dynamics, (rtol, atol)
        mechanism, layout = dynamics.mechanism, dynamics.layout
        segments = [c for c in layout.coordinates if c.kind == "xi"]
        self.names = [c.name for c in segments]
        self.q = np.array([segment_of(layout, c).q for c in segments], dtype=np.intp)
        self.v = np.array([segment_of(layout, c).v for c in segments], dtype=np.intp) + layout.nq
        bounds = np.array([limits_of(mechanism, c.link, c.segment) for c in segments], dtype=float).reshape(-1, 2)
        self.low, self.high = bounds[:, 0], bounds[:, 1]
        self.points: list[str] = []
        if fall and layout.base == "ski":
            self.points = [f"{link.name}.{point}" for link in layout.links for point in ("rod_end", "tip")]

    def refuse_start(self, y: Array) -> None:
        """Raise SceneError for a start with a point under the snow."""
        for name in self.points:
            height = self._height(name, y)
            if height < -1e-12:
                raise SceneError(f"start: {name} is {-height:.3g} m under the snow; raise psi, or set run.fall = false")

    def between(self, t0: float, y0: Array, t1: float, y1: Array) -> tuple[float, str] | None:
        """Return (time, sentence) of the first event in (t0, t1], or None."""
        found: list[tuple[float, str]] = []
        if len(self.q):
            third = (t1 - t0) / 3.0
            hull = np.array([y1[self.q], y0[self.q] + third * y0[self.v], y1[self.q] - third * y1[self.v]])
            beyond = (hull.min(axis=0) < self.low) | (hull.max(axis=0) > self.high)
            for k in np.flatnonzero(beyond):
                for bound, sign in ((self.low[k], 1.0), (self.high[k], -1.0)):
                    if math.isfinite(bound):
                        crossing = self._crossing(t0, y0, t1, y1, self._room(int(self.q[k]), float(bound), sign))
                        if crossing is not None:
                            found.append((crossing, f"{self.names[k]} reached its limit {bound:g} m"))
        for name in self.points:
            if self._height(name, y1) < 0.0:
                crossing = self._crossing(t0, y0, t1, y1, partial(self._height, name))
                if crossing is not None:
                    found.append((crossing, f"fall: {name} reached the snow"))
        return min(found) if found else None

    def _room(self, q: int, bound: float, sign: float) -> Callable[[Array], float]:
        return lambda y: sign * (float(y[q]) - bound)

    def _height(self, name: str, y: Array) -> float:
        mechanism = self.dynamics.mechanism
        pin.forwardKinematics(mechanism.model, mechanism.data, pin.normalize(mechanism.model, y[: self.dynamics.nq]))
        return float(pin.updateFramePlacement(mechanism.model, mechanism.data, mechanism.frames[name]).translation[2])

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
        return y0 if t <= t0 else short_run(self.dynamics.rhs, t0, y0, t, *self.tolerances, steps=SHORT_STEPS)
