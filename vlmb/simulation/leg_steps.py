"""What follows where a massless leg lands, or lets go."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError
from vlmb.simulation.commanded import Commanded
from vlmb.system.beginning import NEAR_AT_START
from vlmb.system.contacts import AWAY, OPEN, SLIDING, STANDING, Footing
from vlmb.system.events import LETS_GO, OPENS, SLIPS, TIPS, TOUCHES
from vlmb.system.events import Event as Watched
from vlmb.system.legs import LegPoint

Array = NDArray[np.float64]

NEAR = 1e-9  # [m] a gap that counts as none


class LegSteps(Commanded):
    """Lands legs and lets them go: those with springs change no velocity, those with laws are smooth contacts of their length."""

    @property
    def legs(self) -> list[LegPoint]:
        """The legs among the contacts."""
        return [point for point in self.points if isinstance(point, LegPoint)]

    def _legs_at_start(self, jets: Array) -> list[Footing]:
        """Return how legs stand at the start. Raises SceneError for one that would pull, or is not as long as its law has it."""
        found = []
        for point in self.legs:
            jet, foot = jets[point.index], point.leg.foot
            if foot is None:
                gap, falling = float(jet[3, 0]), float(jet[3, 1]) < 0.0
                swings = Footing(since=self.t)
                found.append(self._landed(point, jet, swings) if abs(gap) < NEAR_AT_START and falling else swings)
                continue
            standing = Footing(STANDING if point.sprung else SLIDING, (foot[0], foot[1], 0.0), since=self.t)
            off, rate, _ = map(float, point.gap_jet(self.t, jet, standing))
            if not point.sprung:
                if abs(off) > NEAR_AT_START:
                    raise SceneError(
                        f"start: the leg {point.name!r} is {off:+.6g} m longer than its law has it at t = {self.t:g} s; "
                        "start its point elsewhere, or move its foot"
                    )
            elif off > NEAR or (off > -NEAR and rate > 0.0):
                if off > NEAR_AT_START:
                    raise SceneError(
                        f"start: the leg {point.name!r} is {off:.6g} m longer than at rest and would pull, and legs only push; "
                        "start its point nearer to its foot, or leave `foot` out"
                    )
                standing = Footing(place=standing.place, since=self.t)
            found.append(standing)
        return found

    def _landed(self, point: LegPoint, jet: Array, swings: Footing) -> Footing:
        return Footing(STANDING if point.sprung else SLIDING, point.foot_at(self.t, jet[:3, 0], swings), since=self.t)

    def _with_legs(self, hit: Watched, footings: Sequence[Footing]) -> tuple[Watched, list[Footing], list[int], float]:
        """Return an event as it is told, how contacts stand with the legs that land or let go, which land, what springs lose [J].

        One that would land with its force outside the cone of friction slips instead: it goes on swinging.
        """
        after, landing, lost = list(footings), list[int](), 0.0
        self.standing = tuple(footings)
        jets = self._without_forces(self.y).jets
        for point in self.legs:
            k, jet = point.index, jets[point.index]
            if k == hit.which and hit.name in (LETS_GO, TIPS):
                lost += float(point.stored(jet[:3, 0], footings[k]))
                after[k] = point.let_go(self.t, 0.0, footings[k])
            elif footings[k].state == OPEN and point.lands:
                gap, falling = float(jet[3, 0]), float(jet[3, 1]) < 0.0
                if (k == hit.which and hit.name == TOUCHES) or (abs(gap) <= NEAR and falling):
                    landed = self._landed(point, jet, footings[k])
                    if point.grips(jet[:3, 0], landed):
                        after[k] = landed
                        landing.append(k)
                    elif k == hit.which:
                        hit, after[k] = hit._replace(name=TIPS), Footing(AWAY, landed.place, since=footings[k].since)
        return as_told(hit), after, landing, lost

    def _take_lost(self, lost: float) -> None:
        """Book what springs lose that let go."""
        first = len(self.y) - self.works
        self.y[first + self.system.work_names.index("impacts")] -= lost


def as_told(hit: Watched) -> Watched:
    """Return the event of a leg as it is told: where its spring no longer pushes it opens, where it leaves the cone it slips."""
    names = {LETS_GO: OPENS, TIPS: SLIPS}
    return hit._replace(name=names.get(hit.name, hit.name))
