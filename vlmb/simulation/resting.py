"""Feet that come to rest: impacts that would go on for ever, each a share of the one before, and what brings contacts onto rows.

A body on two feet may rattle: one lands, and its impact lifts the other, which lands in its turn. If every cycle takes the same
share r < 1 of the one before, in times and in speeds, infinitely many impacts end at a time T, and then the feet rest. What the
rest of them do until T, impulses P under forces f, is to first order in T - t

    J M^-1 (B P + f (T - t)) = -J v,    B P = B p + B lambda (T - t),    J M^-1 (B lambda + f) = 0,    J M^-1 B p = -J v

with J the rows of what is closed and B what their reactions push on, friction of those that slide included: an impulse p that
takes the speeds to zero at once, and the closed phase with its reactions lambda from t on. So the run goes on at t, and what that
leaves out is of second order: speeds times T - t.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vlmb.simulation.contact_view import ContactView
from vlmb.system.cone import GENTLE
from vlmb.system.cone_problem import Frame, Problem, inverse_of
from vlmb.system.contacts import CLOSED, HELD, STILL, UNDER
from vlmb.system.probe import Answers
from vlmb.system.ski_contact import ALONG, EDGE, ski_way

Array = NDArray[np.float64]

SOON = 2e-6  # [s] from which on the end of impacts is near
EXACT = 1e-15  # [m/s] a speed that is none but for rounding
BEGINS = 1e-12  # [m/s] a speed with which a contact begins to slide: more than rounding, that could turn it back at once


class Strikes:
    """The last impacts of every contact, or every second one: when, and how fast it approached."""

    def __init__(self, every: int = 1) -> None:
        self.last: dict[int, tuple[tuple[float, float], ...]] = {}
        self.every = every

    def note(self, t: float, speeds: Mapping[int, float]) -> None:
        """Take impacts at a time [s] by the speeds [m/s] of approach."""
        for k, speed in speeds.items():
            self.last[k] = (*self.last.get(k, ())[-2 * self.every :], (t, speed))

    def left(self, which: Iterable[int]) -> float:
        """Return the time [s] in which the impacts of contacts end if their cycles go on as they have; inf where they do not end.

        By the slowest of the last ratios, so that it is rather too long.
        """
        return max((_left(self.last.get(k, ())[:: self.every]) for k in which), default=np.inf)


def _left(last: Sequence[tuple[float, float]]) -> float:
    if len(last) < 3:
        return np.inf
    (t0, v0), (t1, v1), (t2, v2) = last
    if not (v0 > 0.0 and v1 > 0.0 and t2 > t1 > t0):
        return np.inf
    ratio = max(v1 / v0, v2 / v1, (t2 - t1) / (t1 - t0))
    return (t2 - t1) * ratio / (1.0 - ratio) if ratio < 1.0 else np.inf


def ends_now(left: float, speed: float) -> bool:
    """Whether impacts that end in a time [s] may end at once: speeds [m/s] are gentle, or the flights left have no height."""
    return left < np.inf and (speed < GENTLE or (left <= SOON and speed * left <= UNDER))


class Resting(ContactView):
    """Brings contacts to rest, and books impulses."""

    def _pushed(
        self, y: Array, found: Answers, which: Sequence[int], frames: Mapping[int, Array], p: Array, before: Array, after: Array
    ) -> tuple[Array, float]:  # fmt: skip
        """Return a state after impulses p along rows of contacts, and the energy lost [J]; before, after: speeds of the rows."""
        along = self._problem(which, frames)[0].T @ p
        lost = float(-0.5 * p @ (after + before))
        y = np.array(y)
        y[len(y) - len(found.moved) :] += found.moved @ along
        works, first, at = self.system.work_names, len(y) - self.works, 0
        y[first + works.index("impacts")] -= lost
        for k in which:
            count = len(frames[k])
            if self.points[k].moving:
                carried = found.jets[k, :3, 1] - frames[k].T @ before[at : at + count]
                y[first + works.index(self.points[k].carried)] += float(along[3 * k : 3 * k + 3] @ carried)
            at += count
        return y, lost

    def _stopped(
        self, y: Array, found: Answers, frames: Mapping[int, Array], states: Mapping[int, str], ways: Mapping[int, Array]
    ) -> tuple[Array, Array, float]:  # fmt: skip
        """Return the state in which what is closed has no speed along its rows, impulses along x, y, z, the energy lost [J].

        Impulses push as reactions do from now on: with friction where a contact slides. One that begins to slide goes its way.
        """
        closed = [k for k, state in states.items() if state in CLOSED]
        turn, rows = self._problem(closed, frames)
        v = np.concatenate([np.zeros(0), *(self._local(found.jets[k], k, frames[k]) for k in closed)])
        unit, kept, columns, speeds = np.eye(len(v)), list[int](), list[Array](), np.zeros(len(v))
        for k, (normal, across) in zip(closed, rows, strict=True):
            way = ways.get(k, np.zeros(3))
            friction, held = self._friction(k, states[k], way, frames[k], len(across))
            columns.append(unit[normal].copy())
            columns[-1][normal - len(friction) : normal] = friction
            kept.append(normal)
            for part, axes in enumerate(across):
                begins = part not in held and self.points[k].contact.slips and np.linalg.norm(v[list(axes)]) <= STILL
                if begins and self.points[k].edge is not None:
                    speeds[list(axes)] = BEGINS * np.sign(way[1 - part])
                elif begins:
                    speeds[list(axes)] = BEGINS * (frames[k][:-1] @ way)
                if begins or part in held:
                    kept += axes
                    columns += [unit[row] for row in axes]
        off = v[kept] - speeds[kept]
        if float(np.abs(off).max(initial=0.0)) <= EXACT:
            return y, np.zeros(turn.shape[1]), 0.0
        g, frame = turn @ found.matrix @ turn.T, Frame(np.array(columns).T, np.array(kept), {}, [])
        p = -frame.columns @ (inverse_of(Problem(g, v, ()), frame) @ off)
        y, lost = self._pushed(y, found, closed, frames, p, v, v + g @ p)
        return y, turn.T @ p, lost

    def _friction(self, k: int, state: str, way: Array, frame: Array, grips: int) -> tuple[Array, list[int]]:
        """Return the friction of a closed contact across its normal for a unit of normal force, and which of its grips hold."""
        point = self.points[k]
        if point.edge is not None:
            held = ([EDGE] if state == HELD else []) + ([ALONG] if grips > 1 and not way[0] else [])
            return -(frame[:-1] @ ski_way(self._heading(), (way[0], way[1], 0.0))), held
        if state == HELD:
            return np.zeros(len(frame) - 1), [*range(grips)]
        return -(0.0 if point.smooth else point.coefficient) * (frame[:-1] @ way), []
