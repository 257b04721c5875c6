"""How a run changes with a number of its scene, through events: runs a little beside it are compared event by event.

Between two events a history is smooth in the number, and so is the time of each event; across one it is not, for runs beside have
it earlier or later. Samples that an event passes over are compared at the same share of the time between events, and moved back
by how that time changes: S = D - Q' T', where D is the derivative at the same share, Q' the rate of a history and T' the
derivative of the time. At an event S jumps thereby as the saltation matrix says, for D and Q' before and after it are others.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import StudyError, VlmbError
from vlmb.scene.names import listed
from vlmb.simulation.phases import Turn
from vlmb.studies.derivatives import FIRST, LEVELS, SHRINK, extrapolated
from vlmb.studies.runs import Ran, Runs, size_of

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Counts = NDArray[np.int64]

NEAREST = 1e-5  # the narrowest step, in units of a number
FEW = 5  # steps that have a sample in one phase on both sides, so that it is not compared by shares
KNOWN = 1e-6  # relative error of a derivative, at most
STEADY = 1e-3  # relative error of the change of an event's time, at most: that of one that grazes grows as steps shrink
TOGETHER = 1e-3  # [s] how near to each other events change their order: else one grazes
WIDTHS, NODES = (1.0, 0.3, 0.1, 0.03, 0.01), 9  # of a phase, in which a rate is sought; samples in each


class Side(NamedTuple):
    """A run beside, and how many of its first turns are those of the run itself."""

    ran: Ran
    step: float
    at: float  # what the step is after rounding
    alike: int


def slope(runs: Runs, values: Array, k: int, middle: Ran) -> tuple[Array, float]:
    """Return derivatives of histories (names, N) by number k, at given values of all (keys,), and their relative error.

    middle : the run at these values

    Raises StudyError naming an event that grazes, or comes together with another, and a history that is not smooth.
    """
    return _Slope(runs, values, k, middle).found()


class _Slope:
    """Derivatives by one number z in units of its size."""

    def __init__(self, runs: Runs, values: Array, k: int, middle: Ran) -> None:
        self.runs, self.values, self.k, self.middle = runs, values, k, middle
        self.key, self.size = runs.keys[k], size_of(runs.keys[k], float(values[k]))
        self.t = runs.times
        self.times = np.array([turn.t for turn in middle.turns])
        self.phase: Counts = np.searchsorted(self.times, self.t, side="right").astype(np.int64)
        self.ends = np.array([0.0, *self.times, self.t[-1]])  # of phases; the last one ends with the run
        self.needed = int(self.phase[-1])
        self.steps, self.sides = self._beside()

    def found(self) -> tuple[Array, float]:
        """Return the derivatives."""
        turns, errors = self._times_of_turns()
        self._require_steady(turns, errors)
        slopes, error = self._at_fixed_times()
        near = np.asarray(~np.isfinite(slopes).all(axis=0))
        if near.any():
            slopes[:, near], error[:, near] = self._by_shares(near, turns, errors)
        floor = 1e-6 * np.maximum(np.abs(self.middle.values).max(axis=1, initial=0.0), 1.0)  # what is held is but rounding
        largest = np.maximum(np.abs(slopes).max(axis=1, initial=0.0), floor)
        relative = error / largest[:, None]
        at = np.unravel_index(int(np.argmax(np.nan_to_num(relative, nan=np.inf))), relative.shape)
        if not relative[at] <= KNOWN:
            raise StudyError(self._unknown(self.runs.names[at[0]], float(self.t[at[1]]), float(relative[at])))
        return slopes / self.size, float(relative[at])

    # runs beside

    def _beside(self) -> tuple[Array, list[tuple[Side, Side]]]:
        """Return steps and pairs of runs, until enough of them have all events of the run."""
        h, steps, sides, full, why = FIRST, list[float](), list[tuple[Side, Side]](), 0, ""
        while full < LEVELS and h > NEAREST:
            try:
                pair = self._side(h), self._side(-h)
            except VlmbError as error:
                why = str(error)
            else:
                steps.append(h)
                sides.append(pair)
                full += min(side.alike for side in pair) >= self.needed
            h /= SHRINK
        if not sides:
            raise StudyError(f"sensitivities: to {self.key}: no run beside this one is there: {why}")
        return np.array(steps), sides

    def _side(self, z: float, times: Array | None = None) -> Side:
        moved = self.values.copy()
        moved[self.k] += z * self.size
        ran = self.runs.ran(moved, times)
        alike = 0
        for own, other in zip(self.middle.turns, ran.turns, strict=False):
            if own[1:] != other[1:]:
                break
            alike += 1
        return Side(ran, z, (moved[self.k] - self.values[self.k]) / self.size, alike)

    def _differences(self, pick: Sequence[tuple[Array, Array]]) -> Array:
        """Return central differences of pairs."""
        spans = [ahead.at - behind.at for ahead, behind in self.sides]
        return np.array([(ahead - behind) / span for (ahead, behind), span in zip(pick, spans, strict=True)])

    # times of events

    def _times_of_turns(self) -> tuple[Array, Array]:
        """Return how the times of turns change (M,), and the errors of that; nan where runs beside have none."""
        count = len(self.times)

        def of(side: Side) -> Array:
            return np.array([side.ran.turns[k].t if k < side.alike else np.nan for k in range(count)])

        differences = self._differences([(of(ahead), of(behind)) for ahead, behind in self.sides])
        found = [extrapolated(self.steps, differences[:, k : k + 1]) for k in range(count)]
        return np.array([float(value[0]) for value, _ in found]), np.array([error for _, error in found])

    def _require_steady(self, turns: Array, errors: Array) -> None:
        """Refuse the first turn whose time has no derivative, if a sample comes after it."""
        for j in range(self.needed):
            late = max(abs(float(turns[j])), 1e-3 * self.t[-1]) if np.isfinite(turns[j]) else 0.0
            if errors[j] <= STEADY * late:
                continue
            ahead, behind = self.sides[-1]
            raise StudyError(f"sensitivities: to {self.key}: {self._why(j, min((ahead, behind), key=lambda side: side.alike))}")

    def _why(self, j: int, side: Side) -> str:
        """Return why turn j has no derivative, told by a run beside."""
        own, others = self.middle.turns, side.ran.turns
        turn, at = own[j], f"at t = {own[j].t:.6g} s"
        if side.alike > j:
            return (
                f"{turn.what} {at} grazes: the more the number changes, the more its time does, without bound; move the start "
                "so that it comes with some speed, or does not come"
            )
        near = [other for other in others[j : j + 2] if abs(other.t - turn.t) < TOGETHER]
        mine = [other for other in own[j : j + 2] if abs(other.t - turn.t) < TOGETHER]
        parts = [name for entry in near for name in entry.contacts]
        together = [entry.what for entry in mine] if len(mine) > 1 else [f"contact {name}" for name in turn.contacts]
        if len(together) > 1 and (len(mine) > 1 or any(name in turn.contacts for name in parts)):
            return (
                f"{listed(together)} come together {at}: which is first, and all that follows, changes with the number, and so "
                "there is one derivative to each side; part them by another start, or end before"
            )
        if near and near[0].what == turn.what:
            return (
                f"after {turn.what} {at} contacts go on in one way in this run, and in another beside it: it stands between the "
                "two; move the start off that, or end before"
            )
        return (
            f"{turn.what} {at} is not there in runs a little beside, or another comes before it: it grazes, or is the first of "
            "many; move the start so that it comes with some speed, or end before"
        )

    def _unknown(self, name: str, t: float, error: float) -> str:
        return (
            f"sensitivities: {name} is no smooth function of {self.key} at t = {t:.6g} s: its derivative is known to {error:.1g} "
            "of the largest only; runs diverge, or rtol cannot be met there: ask for less time"
        )

    # samples

    def _at_fixed_times(self) -> tuple[Array, Array]:
        """Return derivatives (names, N) of samples that most runs beside have in the same phase, nan of others, and errors."""
        names, count = self.middle.values.shape
        found, error = np.full((names, count), np.nan), np.full((names, count), np.nan)
        usable = np.array([self._same(ahead) & self._same(behind) for ahead, behind in self.sides])
        differences = self._differences([(ahead.ran.values, behind.ran.values) for ahead, behind in self.sides])
        for pattern in np.unique(usable, axis=1).T:
            if pattern.sum() < min(FEW, len(pattern)):
                continue
            own = np.flatnonzero((usable == pattern[:, None]).all(axis=0))
            for phase in np.unique(self.phase[own]):
                part = own[self.phase[own] == phase]
                for at in range(names):
                    found[at, part], error[at, part] = extrapolated(self.steps[pattern], differences[pattern, at][:, part])
        return found, error

    def _same(self, side: Side) -> Flags:
        """Tell which samples (N,) a run beside has in the phase in which the run has them."""
        times = np.array([turn.t for turn in side.ran.turns])
        return np.asarray((np.searchsorted(times, self.t, side="right") == self.phase) & (self.phase <= side.alike))

    def _by_shares(self, near: Flags, turns: Array, errors: Array) -> tuple[Array, Array]:
        """Return derivatives (names, n) of samples near events, and errors: by runs at the same shares of their phases."""
        t, phase = self.t[near], self.phase[near]
        ended = np.append(np.isfinite(turns), True)  # phases whose end is known in runs beside
        sides = [[self._at_shares(side, t, phase, ended) for side in pair] for pair in self.sides]
        pairs = [(ahead, behind) for ahead, behind in sides]
        differences = self._differences(pairs)
        found, error = np.full(pairs[0][0].shape, np.nan), np.full(pairs[0][0].shape, np.nan)
        usable = np.isfinite(differences).all(axis=1)
        for pattern in np.unique(usable, axis=1).T:
            own = np.flatnonzero((usable == pattern[:, None]).all(axis=0))
            for j in np.unique(phase[own]):
                part = own[phase[own] == j]
                for at in range(len(found)):
                    found[at, part], error[at, part] = extrapolated(self.steps[pattern], differences[pattern, at][:, part])
        share = self._shares(t, phase, ended)
        known, off = np.array([0.0, *np.nan_to_num(turns), 0.0]), np.array([0.0, *np.nan_to_num(errors), 0.0])
        shift = (1.0 - share) * known[phase] + share * known[phase + 1]
        rates, rough = self._rates(t, phase)
        return found - rates * shift, error + np.abs(rough * shift) + np.abs(rates) * (off[phase] + off[phase + 1])

    def _shares(self, t: Array, phase: Counts, ended: Flags) -> Array:
        """Return which shares (n,) of their phases samples are at; 0 in phases that have no end."""
        span = self.ends[phase + 1] - self.ends[phase]
        return np.asarray(np.where(ended[phase] & (span > 0.0), (t - self.ends[phase]) / np.where(span > 0.0, span, 1.0), 0.0))

    def _at_shares(self, side: Side, t: Array, phase: Counts, ended: Flags) -> Array:
        """Return histories (names, n) of a run beside at the same shares; nan of samples whose phase it does not have."""
        turns, last = [turn.t for turn in side.ran.turns], float(self.t[-1])
        own = np.array([0.0, *turns[: side.alike]])
        own = np.append(own, np.full(len(self.ends) - len(own), np.nan))
        if side.alike == len(self.times):
            own[-1] = last
        begins = own[phase]
        ends = np.where(ended[phase], own[phase + 1], begins + self.ends[phase + 1] - self.ends[phase])
        share = np.where(ended[phase], self._shares(t, phase, ended), self._shares(t, phase, np.ones_like(ended)))
        asked = np.where(share == 0.0, begins, begins + share * (ends - begins))
        next_turn = np.array([*turns, np.inf])[np.minimum(phase, len(turns))]
        with np.errstate(invalid="ignore"):
            there = (asked < next_turn) & (asked <= last)
        unique, place = np.unique(np.append(np.where(there, asked, last), last), return_inverse=True)
        values = self._side(side.step, unique).ran.values[:, place[:-1]]
        return np.where(there, values, np.nan)

    def _rates(self, t: Array, phase: Counts) -> tuple[Array, Array]:
        """Return rates (names, n) of histories of the run itself, and errors, by polynomials inside the phases."""
        begun, ends = self.ends[phase], self.ends[phase + 1]
        nodes = np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
        lows, asked = [], []
        for width in WIDTHS:
            w = width * (ends - begun)
            low = np.clip(t - 0.5 * w, begun, ends - w)
            lows.append((low, w))
            asked.append(low[:, None] + 0.5 * w[:, None] * (1.0 + nodes))
        unique, place = np.unique(np.append(np.array(asked).ravel(), self.t[-1]), return_inverse=True)
        values = self.runs.ran(self.values, unique).values[:, place[:-1]].reshape(-1, len(WIDTHS), len(t), NODES)
        by_width = []
        for at, (low, w) in enumerate(lows):
            x = np.where(w > 0.0, 2.0 * (t - low) / np.where(w > 0.0, w, 1.0) - 1.0, 0.0)
            sums = np.polynomial.chebyshev.chebfit(nodes, values[:, at].reshape(-1, NODES).T, NODES - 1)
            slopes = np.polynomial.chebyshev.chebder(sums)
            where = np.tile(x, len(self.runs.names))
            powers = np.polynomial.chebyshev.chebvander(where, NODES - 2)
            rate = np.einsum("ij,ji->i", powers, slopes).reshape(len(self.runs.names), len(t))
            by_width.append(rate * 2.0 / np.where(w > 0.0, w, np.inf))
        apart = np.abs(np.diff(np.array(by_width), axis=0))
        best = np.argmin(apart, axis=0)
        rates = np.take_along_axis(np.array(by_width), best[None] + 1, axis=0)[0]
        return rates, np.take_along_axis(apart, best[None], axis=0)[0]


def unlike(middle: Sequence[Turn], other: Sequence[Turn]) -> str:
    """Say where a run beside has other events than a run, or in another order; nothing where it has the same."""
    for own, its in zip(middle, other, strict=False):
        if own[1:] != its[1:]:
            return f"{own.what} at t = {own.t:.6g} s is {its.what} at t = {its.t:.6g} s in a run beside"
    if len(middle) == len(other):
        return ""
    longer = max(middle, other, key=len)[min(len(middle), len(other))]
    return f"{longer.what} at t = {longer.t:.6g} s is there only in this run, or only beside it"
