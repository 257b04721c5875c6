"""Drivers of an initial-value problem y' = f(t, y): fixed-step methods, and adaptive ones from SciPy.

Every driver has `advance(t) -> y`, which goes forward to t and returns the solution there; steps beyond t are kept inside.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import integrate

from vlmb.errors import SceneError, SimulationError, VlmbError, nearest
from vlmb.system.types import Rhs

Array = NDArray[np.float64]

MAX_ITERATIONS = 60
ROOT = 3.0**0.5 / 6.0  # of the Gauss-Legendre nodes 1/2 -+ sqrt(3)/6
MAX_STEPS = 20_000  # adaptive steps between two stops before a run is called stuck


class Driver(Protocol):
    """Goes forward in time."""

    @property
    def steps(self) -> int:
        """Accepted steps so far."""
        ...

    @property
    def step(self) -> float:
        """Length [s] of the next step."""
        ...

    def advance(self, t: float) -> Array:
        """Return y(t); t never decreases. Raises SimulationError where the motion cannot be continued."""
        ...


@dataclass(frozen=True)
class Method:
    """An integration method: its order, whether its steps adapt, and what it is for."""

    name: str
    order: int
    adaptive: bool
    purpose: str
    make: Callable[..., Driver] = field(repr=False)
    stride: float = 1.0  # steps between two looks at what ends a run; those of a multistep method are short
    stiff: bool = False


def euler(rhs: Rhs, t: float, y: Array, h: float) -> Array:
    """Explicit Euler, the paper's first-order difference scheme: y + h f."""
    return y + h * rhs(t, y)


def rk4(rhs: Rhs, t: float, y: Array, h: float) -> Array:
    """Classical Runge-Kutta of order 4."""
    k1 = rhs(t, y).copy()
    k2 = rhs(t + 0.5 * h, y + 0.5 * h * k1).copy()
    k3 = rhs(t + 0.5 * h, y + 0.5 * h * k2).copy()
    return y + (h / 6.0) * (k1 + 2.0 * (k2 + k3) + rhs(t + h, y + h * k3))


def gauss(rhs: Rhs, t: float, y: Array, h: float) -> Array:
    """Gauss-Legendre with two stages, order 4: symmetric, keeps quadratic invariants; stages by functional iteration.

    Its energy error stays bounded over long reversible motions, where explicit methods drift.
    """
    first = second = rhs(t, y).copy()
    size = max(1.0, float(np.abs(y).max(initial=0.0)))
    for _ in range(MAX_ITERATIONS):
        new_first = rhs(t + (0.5 - ROOT) * h, y + h * (0.25 * first + (0.25 - ROOT) * second)).copy()
        new_second = rhs(t + (0.5 + ROOT) * h, y + h * ((0.25 + ROOT) * new_first + 0.25 * second)).copy()
        change = h * max(np.abs(new_first - first).max(), np.abs(new_second - second).max())
        first, second = new_first, new_second
        if change <= 4e-16 * size:
            return y + 0.5 * h * (first + second)
    if change > 1e-10 * size:
        raise SimulationError("the stages of the Gauss method do not converge: the step is too large for this motion; reduce it")
    return y + 0.5 * h * (first + second)


class FixedStep:
    """Equal steps from the start to the end, the last one on it; cubic Hermite values between them."""

    def __init__(self, scheme: Callable[..., Array], rhs: Rhs, t: float, y: Array, end: float, size: float) -> None:
        self.scheme, self.rhs, self.t, self.y = scheme, rhs, t, np.array(y)
        self.start, self.steps = t, 0
        self.count = max(1, round((end - t) / size)) if end > t else 1
        if abs(self.count * size - (end - t)) > 1e-9 * size:
            self.count = int(np.ceil((end - t) / size))
        self.step = (end - t) / self.count
        self.previous = (t, self.y)

    def advance(self, t: float) -> Array:
        """Step until t is reached, then interpolate."""
        while self.t < t - 1e-12 * self.step and self.steps < self.count:
            self.previous = (self.t, self.y)
            self.y = self.scheme(self.rhs, self.t, self.y, self.step)
            self.steps += 1
            self.t = self.start + self.steps * self.step
            if not np.isfinite(self.y).all():
                raise SimulationError("the state is no longer finite: the step is too large for this motion; reduce `step`")
        if abs(t - self.t) <= 1e-12 * max(1.0, abs(t)):
            return self.y
        t0, y0 = self.previous
        h, s = self.t - t0, (t - t0) / (self.t - t0)
        f0, f1 = self.rhs(t0, y0).copy(), self.rhs(self.t, self.y)
        return (
            (1 + 2 * s) * (1 - s) ** 2 * y0 + s * (1 - s) ** 2 * h * f0 + s * s * (3 - 2 * s) * self.y + s * s * (s - 1) * h * f1
        )


class _Guarded:
    """Keeps an exception away from a compiled driver: `call` gives it nan, so that it gives up, then `check` raises."""

    def __init__(self, rhs: Rhs, size: int) -> None:
        errors: list[BaseException] = []
        nothing = np.full(size, np.nan)

        def call(t: float, y: Array) -> Array:
            if errors:
                return nothing
            try:
                return rhs(t, y)
            except BaseException as error:  # KeyboardInterrupt too: nothing may cross compiled code
                errors.append(error)
                return nothing

        self.errors, self.call = errors, call

    def check(self, integrator: Any) -> None:
        """Raise what stopped the right-hand side, or SimulationError if the driver gave up by itself."""
        if self.errors:
            raise self.errors[0]
        if integrator.success != 1:
            raise SimulationError(STUCK)


def short_run(rhs: Rhs, t: float, y: Array, end: float, rtol: float, atol: float, steps: int | None = None) -> Array:
    """y(end) from (t, y) by compiled DOP853, which ends exactly there."""
    guarded = _Guarded(rhs, len(y))
    solver = integrate.ode(guarded.call).set_integrator("dop853", rtol=rtol, atol=atol, nsteps=steps or MAX_STEPS)
    solver.set_initial_value(y, t)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        answer = np.array(solver.integrate(end))
    guarded.check(solver._integrator)
    return answer


class Multistep:
    """VODE: variable-order Adams-Moulton with functional iteration, or BDF with Newton's; compiled, in SciPy.

    Its interpolant reaches back one step, so a step may pass the requested time; `end` is met by a short DOP853 run where
    the right-hand side must not be asked beyond it (a law's break point). SciPy warns when VODE gives up; callers silence that
    around a whole run: `advance` raises what it is about, and silencing each look would cost as much as the look.
    """

    busy = False  # VODE remembers one right-hand side for the whole process

    def __init__(
        self, kind: str, rhs: Rhs, t: float, y: Array, end: float, rtol: float, atol: float, hard_end: bool
    ) -> None:
        self.rhs, self.end, self.tolerances, self.hard_end = rhs, end, (rtol, atol), hard_end
        self.guarded = _Guarded(rhs, len(y))
        self.solver = integrate.ode(self.guarded.call).set_integrator(
            "vode", method=kind, with_jacobian=kind == "bdf", rtol=rtol, atol=atol, nsteps=MAX_STEPS
        )
        self.solver.set_initial_value(y, t)
        self.integrator = self.solver._integrator
        self.node = (t, np.array(y))  # start of the step under way, for a hard end
        self.reached = t
        self.passed = False

    @property
    def steps(self) -> int:
        """Accepted steps: VODE's counter NST."""
        return int(self.integrator.iwork[10])

    @property
    def step(self) -> float:
        """Length [s] of the next step: VODE's HCUR."""
        return float(self.integrator.rwork[11])

    def advance(self, t: float) -> Array:
        """Let VODE pass t and interpolate; a step that passed a hard end is not used."""
        if not self.hard_end:
            return self._integrate(t) if t > self.node[0] else self.node[1]
        limit = self.steps + MAX_STEPS
        while not self.passed and self.reached < t:
            if self.steps >= limit:
                raise SimulationError(STUCK)
            here = self.solver.t == self.reached
            self.node = (self.reached, np.array(self.solver.y) if here else self._integrate(self.reached))
            self._integrate(self.end, one_step=True)
            self.reached = float(self.solver.t)
            self.passed = self.reached > self.end
        if self.passed:
            return short_run(self.rhs, *self.node, t, *self.tolerances) if t > self.node[0] else self.node[1]
        return self._integrate(t) if t > self.node[0] else self.node[1]

    def _integrate(self, t: float, one_step: bool = False) -> Array:
        if Multistep.busy:
            raise SimulationError("adams and bdf cannot run inside another of their runs: use method = 'dop853' for one of them")
        Multistep.busy = True
        try:
            y: Array = self.solver.integrate(t, step=one_step)  # a new array each time
        except UserWarning:  # where warnings are errors, the solver has not noted that it gave up
            self.integrator.success = 0
        except RuntimeError:  # SciPy before 1.17: another run has taken VODE's one memory since
            raise SimulationError(INTERLEAVED) from None
        finally:
            Multistep.busy = False
        self.guarded.check(self.integrator)
        return y


class OneStep:
    """DOP853 or Radau from SciPy, with their own dense output."""

    def __init__(self, kind: Any, rhs: Rhs, t: float, y: Array, end: float, rtol: float, atol: float) -> None:
        self.rhs, self.error, self.nothing = rhs, VlmbError(STUCK), np.full(len(y), np.nan)
        rhs(t, y)  # an error at the start is told as it is; later ones make a trial step be tried again, shorter
        self.solver = kind(self._try, t, np.array(y), end, rtol=rtol, atol=atol)
        self.dense: Any = None
        self.tried = False  # whether the right-hand side failed since the last accepted step
        self.steps = 0

    def _try(self, t: float, y: Array) -> Array:
        try:
            return self.rhs(t, y).copy()
        except VlmbError as error:
            self.error, self.tried = error, True
            return self.nothing

    @property
    def step(self) -> float:
        """Length [s] of the next step."""
        return float(self.solver.h_abs)

    def advance(self, t: float) -> Array:
        """Step until t is reached, then interpolate."""
        limit = self.steps + MAX_STEPS
        while self.solver.t < t:
            if self.solver.status != "running" or self.steps >= limit:
                raise SimulationError(STUCK)
            message = self.solver.step()
            self.steps += 1
            self.dense = None
            if self.solver.status == "failed":
                raise self.error if self.tried else SimulationError(f"{STUCK} ({message})")
            self.tried = False
        if t == self.solver.t:
            return np.array(self.solver.y)
        if self.dense is None:
            self.dense = self.solver.dense_output()
        return np.array(self.dense(t))


INTERLEAVED = (
    "another run by adams or bdf began before this one ended, and this SciPy has room for one: end one first, use "
    "method = 'dop853' for one of them, or SciPy 1.17 or later"
)
STUCK = "the steps became too small to go on: the motion is too stiff, or singular, here"


def _fixed(scheme: Callable[..., Array]) -> Callable[..., Driver]:
    def make(rhs: Rhs, t: float, y: Array, end: float, *, step_size: float, **_: Any) -> Driver:
        return FixedStep(scheme, rhs, t, y, end, step_size)

    return make


def _multistep(kind: str) -> Callable[..., Driver]:
    def make(rhs: Rhs, t: float, y: Array, end: float, *, rtol: float, atol: float, hard_end: bool = False, **_: Any) -> Driver:
        return Multistep(kind, rhs, t, y, end, rtol, atol, hard_end)

    return make


def _one_step(kind: Any) -> Callable[..., Driver]:
    def make(rhs: Rhs, t: float, y: Array, end: float, *, rtol: float, atol: float, **_: Any) -> Driver:
        return OneStep(kind, rhs, t, y, end, rtol, atol)

    return make


METHODS = {
    method.name: method
    for method in (
        Method("euler", 1, False, "the paper's first-order scheme; for comparison", _fixed(euler)),
        Method("rk4", 4, False, "fixed steps, known cost", _fixed(rk4)),
        Method("gauss", 4, False, "long runs: energy error stays bounded", _fixed(gauss)),
        Method("dop853", 8, True, "smooth motions at tight tolerances", _one_step(integrate.DOP853)),
        Method("adams", 12, True, "smooth motions; fewest right-hand sides", _multistep("adams"), 4.0),
        Method("bdf", 5, True, "stiff scenes at moderate tolerances", _multistep("bdf"), 4.0, True),
        Method("radau", 5, True, "stiff scenes", _one_step(integrate.Radau), stiff=True),
    )
}


def find_method(name: str) -> Method:
    """Return a method by name; SceneError lists the valid ones."""
    if name not in METHODS:
        raise SceneError(f"method = {name!r}: no such method; {nearest(name, METHODS)}")
    return METHODS[name]
