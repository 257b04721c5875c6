r"""Through a posture in which ideal rows lose their independence, where the motion through it is determined.

There J M^-1 J^T has no inverse, and near it every error of the position is magnified: what is a little off the rows turns into
another branch. The motion on its own branch is smooth all the same. So the passage is integrated by Gauss collocation,

    k_i = f(t + c_i h, y_i),   y_i = y + h sum_j a_ij k_j,   each y_i brought onto the rows before f is asked,

over a stretch whose middle is the singular posture, or where the motion turns back near it: no node of an even number comes near
the middle. The same with more stages, or in odd numbers of parts, tells the error.
"""

from __future__ import annotations

import math
from functools import cache, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.core.driver import ATOL, EVALUATIONS, NEXT_SAMPLE, RATE, RTOL, STEPS, Driver
from vlmb.core.locate import LOOKS, Crossing, root, with_turns
from vlmb.errors import SimulationError, VlmbError
from vlmb.simulation.engine import Engine
from vlmb.system.events import IN_LINE, LINE_UP
from vlmb.system.worth import LOOKED_AT, REPEATING, TINIEST

Array = NDArray[np.float64]

ROUNDS, STEADY = 80, 1e-14  # of the iteration for the slopes, and the relative change that ends it
STALLED, IDLE = 1e-9, 20  # relative change at which rounding may end it; rounds without a gain that end it without an answer
WAYS = ((4, 1), (6, 1), (8, 1), (10, 1), (4, 3), (4, 9))  # stages, parts: one part leaves most room around the middle
SPANS = (1.0, 2.0, 4.0, 1.4, 2.8)  # of twice the way to the posture
LEFT = 0.5  # of what rows are worth at the start: that at the end
FINEST = 1e-10  # of a tolerance, what rounding leaves near the posture
AGAIN = 0.8  # of what a row is worth: where it is looked at next
NEARER = 0.1
PROBE = 0.02  # of the time to the posture: how far ahead the rows are looked at
BESIDE, LEAVING = 1e-3, 0.2  # [rad, m] that the fastest part goes: to a look beside a start, and at most to leave it
SHARE, TRIES = 4.0, 8  # by what that is cut, and how often
ON_ROWS = 2e-16  # [m, rad, per s] of a residual: what is left is magnified by the third power of what the rows are worth


@cache
def _tableau(stages: int) -> tuple[Array, Array, Array]:
    """Nodes c (s,) and integrals of the Lagrange polynomials: a (s, s) up to the nodes, weights (s, s) of their powers."""
    nodes = 0.5 + 0.5 * np.polynomial.legendre.leggauss(stages)[0]
    powers = np.linalg.inv(np.vander(nodes, increasing=True))  # l_j(x) = sum_k powers[k, j] x^k
    integrals = powers / np.arange(1, stages + 1)[:, None]
    return nodes, np.vander(nodes, stages + 1, increasing=True)[:, 1:] @ integrals, integrals


class Part(NamedTuple):
    """A part of a passage: the polynomial of collocation."""

    t: float
    h: float
    y: Array
    slopes: Array  # (s, ny)

    def at(self, t: float) -> Array:
        """Return y at a time [s] within it."""
        x = (t - self.t) / self.h
        count = len(self.slopes)
        answer: Array = self.y + self.h * (x ** np.arange(1, count + 1) @ _tableau(count)[2]) @ self.slopes
        return answer


class Passage(NamedTuple):
    """A way through: its parts in order of time, and the state at their end."""

    parts: list[Part]
    t: float
    y: Array
    evaluations: int

    def at(self, t: float) -> Array:
        """Return y at a time [s] within it."""
        part = next((part for part in self.parts if t < part.t + part.h), self.parts[-1])
        return part.at(t) if t < self.t else self.y

    def first_crossing(self, engine: Engine) -> Crossing | None:
        """Return the first event within it; looked for as within a step, but at all indicators."""
        ends, crossed = [*(part.t for part in self.parts), self.t], list[Crossing]()
        times = [*(t for a, b in pairwise(ends) for t in np.linspace(a, b, LOOKS + 1)[:-1].tolist()), float(self.t)]
        seen = np.array([engine.indicators(t, self.at(t))[0] for t in times])
        for k, event in enumerate(engine.events):
            if k == engine.dependent:
                continue
            value = partial(self._indicator, engine, k)
            for (a, at_a), (b, at_b) in pairwise(with_turns(list(zip(times, seen[:, k].tolist(), strict=True)), value)):
                way = np.sign(at_b)
                if at_a * at_b >= 0.0 or event.direction * way < 0.0:
                    continue
                at = root(value, a, b, at_a, at_b)
                if event.kind != LINE_UP or engine.in_line(event, at, self.at(at)) < IN_LINE:
                    crossed.append(Crossing(at, k, int(way)))
        return min(crossed, default=None)

    def _indicator(self, engine: Engine, k: int, t: float) -> float:
        return float(engine.indicators(t, self.at(t))[0][k])

    def write(self, driver: Driver, t: float) -> None:
        """Write the samples up to a time [s] within it, and the state there."""
        for k in range(int(driver.counts[NEXT_SAMPLE]), len(driver.times)):
            if driver.times[k] > t:
                break
            driver.samples[k] = self.at(float(driver.times[k]))
            driver.counts[NEXT_SAMPLE] = k + 1
        driver.point[:] = self.at(t)


class Passing:
    """Seeks a way through for a run that has come near to a singular posture: ever nearer, where none is found."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self.closer = 0  # which of LOOKED_AT the rows are worth

    def leave(self, driver: Driver, t: float, until: float) -> Passage | None:
        """Return a way out of a start in which rows are dependent that are not so beside it; None where nothing is lost."""
        y, tolerances = np.array(driver.point), (float(driver.real[RTOL]), float(driver.real[ATOL]))
        fastest = float(np.abs(y[self.engine.velocities]).max(initial=0.0))
        if fastest == 0.0 or not t < until or not _loses(self.engine, t, y, min(BESIDE / fastest, until - t)):
            return None
        counted = _Counted(self.engine)
        for span in (LEAVING / fastest / SHARE**k for k in range(TRIES)):
            found = _agreed(counted, t, y, min(span, until - t), *tolerances)
            if found is not None:
                driver.counts[EVALUATIONS] += counted.count
                driver.counts[STEPS] += len(found.parts)
                return found
        return None

    def seek(self, driver: Driver, t: float, until: float) -> Passage | str | None:
        """Return a passage; None where the run goes on as it is; a sentence where no one way is known."""
        engine, y = self.engine, np.array(driver.point)
        rate = -float(driver.indicators[RATE, engine.dependent])
        bound, worth = LOOKED_AT[self.closer], engine.rows(t, y).worth
        bound = worth if worth < NEARER * bound else bound  # a break may have led nearer to the posture than was looked at
        ahead = time_to_dependence(engine, t, y, bound / rate) if rate > 0.0 else np.inf
        if ahead == np.inf:
            engine.look_at(AGAIN * engine.rows(t, y).worth)
            return None
        found = pass_through(engine, t, y, ahead, until, float(driver.real[RTOL]), float(driver.real[ATOL]))
        self.closer = 0 if found is not None else self.closer + 1
        if self.closer < len(LOOKED_AT):  # a motion that turns back near the posture comes to it again before it has left it
            left = engine.rows(t, y).worth if found is None else engine.rows(found.t, found.y).worth
            cut = found is not None and found.t >= until  # by a break, from which the way is sought anew
            engine.look_at(LOOKED_AT[0] if cut else min(LOOKED_AT[self.closer], AGAIN * left))
        if found is not None:
            driver.counts[EVALUATIONS] += found.evaluations
            driver.counts[STEPS] += len(found.parts)
            return found
        if self.closer < len(LOOKED_AT):
            return None
        names = " and ".join(repr(name) for name in engine.rows(t, y).dependent)
        return (
            f"the ideal constraints {names} lose their independence {ahead:.3g} s on: two motions meet there, and what is "
            "known does not tell which of them goes on; start with more speed through that posture, or leave a little play"
        )


def _loses(mover: Engine, t: float, y: Array, ahead: float) -> bool:
    """Whether rows depend on each other that do not so a time [s] ahead, as far as they have an answer there."""
    try:
        beside = _Counted(mover).on_rows(t + ahead, y + ahead * mover.evaluate(t, y))
        answers = [mover.rows(t, y).answers, mover.rows(t + ahead, beside).answers]
    except VlmbError:
        return False
    sizes = np.maximum(np.max([np.linalg.norm(each, axis=1) for each in answers], axis=0), TINIEST)
    here, there = ((np.linalg.svd(each / sizes[:, None], compute_uv=False) > math.sqrt(REPEATING)).sum() for each in answers)
    return bool(here < there)


class _Counted:
    """An engine, and how often it was asked."""

    def __init__(self, mover: Engine) -> None:
        self.mover, self.count = mover, 0

    def on_rows(self, t: float, y: Array) -> Array:
        """Bring a state onto the ideal rows, by the least change in kinetic energy: positions first, then velocities."""
        mover, y, last = self.mover, self.mover.tidied(y), np.inf
        for _ in range(12):
            rows = mover.rows(t, y)
            self.count += 1
            off = float(np.abs(rows.z).max())
            if off <= ON_ROWS or off >= 0.5 * last:
                break
            y, last = mover.moved(t, y, -rows.shares(rows.z)), off
            self.count += 1
        y[mover.velocities] -= rows.shares(rows.rate)
        return y

    def slope(self, t: float, y: Array) -> Array:
        """Return y' at (t, y)."""
        self.count += 1
        return self.mover.evaluate(t, y)


def time_to_dependence(mover: Engine, t: float, y: Array, guess: float) -> float:
    """Return the time [s] in which the rows would lose their independence; inf where they do not.

    guess : [s] a first one
    """
    here, slope = mover.rows(t, y).worth, mover.evaluate(t, y)
    ahead = PROBE * guess
    rate = (mover.rows(t + ahead, y + ahead * slope).worth - here) / ahead
    return -here / rate if rate < 0.0 else np.inf


def pass_through(mover: Engine, t: float, y: Array, ahead: float, until: float, rtol: float, atol: float) -> Passage | None:
    """Integrate from (t, y) past the singular posture, which is `ahead` [s], and not beyond `until`.

    None where no answer repeats itself, or none leads away from the posture: one that turns back near it passes it twice.
    """
    counted, left = _Counted(mover), LEFT * mover.rows(t, y).worth
    for times in SPANS:
        span = min(2.0 * times * ahead, until - t)
        found = _agreed(counted, t, y, span, rtol, atol)
        if found is not None and (found.t >= until or mover.rows(found.t, found.y).worth > left):
            return found._replace(evaluations=counted.count)
    return None


def _agreed(counted: _Counted, t: float, y: Array, span: float, rtol: float, atol: float) -> Passage | None:
    """Return the finer of two passages that agree."""
    scale, before = atol + rtol * np.abs(y) + FINEST * max(1.0, float(np.abs(y).max())), None
    for stages, count in WAYS:
        try:
            found = _in_parts(counted, t, counted.on_rows(t, y), span, count, stages)
        except (VlmbError, np.linalg.LinAlgError):
            before = None
            continue
        if before is not None and float((np.abs(found.y - before.y) / scale).max()) < 1.0:
            return found
        before = found
    return None


def _in_parts(counted: _Counted, t: float, y: Array, span: float, count: int, stages: int) -> Passage:
    parts, h = [], span / count
    for k in range(count):
        part, y = _collocate(counted, t + k * h, y, h, stages)
        parts.append(part)
    return Passage(parts, t + span, y, 0)


def _collocate(counted: _Counted, t: float, y: Array, h: float, stages: int) -> tuple[Part, Array]:
    """Go one part further; raises VlmbError where the iteration does not come to rest."""
    nodes, to_nodes, integrals = _tableau(stages)
    slopes, last, size = np.tile(counted.slope(t, y), (stages, 1)), np.inf, max(1.0, float(np.abs(y).max()))
    idle = 0
    for _ in range(ROUNDS):
        new = np.empty_like(slopes)
        for i, stage in enumerate(y + h * to_nodes @ slopes):
            at = t + nodes[i] * h
            new[i] = counted.slope(at, counted.on_rows(at, stage))
        change = h * float(np.abs(new - slopes).max()) / size
        slopes, idle = new, idle + (change > 0.5 * last)
        if change <= STEADY or (change <= STALLED and change > 0.5 * last):
            end = counted.on_rows(t + h, y + h * integrals.sum(axis=0) @ slopes)
            return Part(t, h, y, slopes), end
        if idle > IDLE:
            break
        last = min(change, last)
    raise SimulationError("the iteration does not come to rest")
