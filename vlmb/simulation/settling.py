"""What follows an event of a contact: an impact, and which contacts open, slip and stick from then on.

An impact changes velocities; modes follow from accelerations, never from a step that is tried.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.model.frozen import read_only
from vlmb.scene.by_phase import acting, goes_by_phase
from vlmb.scene.names import listed
from vlmb.simulation.phases import Event
from vlmb.simulation.resting import Resting, Strikes, ends_now
from vlmb.system.cone import Answer, Contact, Refusal, impact, modes
from vlmb.system.contacts import CLOSED, HELD, LIGHT, OPEN, RESTING, SLIDING, STILL, Footing
from vlmb.system.events import BOUNCES, OPENS, SLIPS, STICKS, TOUCHES
from vlmb.system.events import Event as Watched
from vlmb.system.probe import Answers
from vlmb.system.sharing import carrying, carrying_again, foot_of, let_go
from vlmb.system.ski_contact import ALONG

Array = NDArray[np.float64]

AGREE = 4  # tries to find what is closed under what acts then
FEW = 6  # contacts of which every set is looked at
GAIN = 1e-9  # of the kinetic energy: what an impact may not add


class Outcome(NamedTuple):
    """What follows an event: how contacts stand, the state, what is told of it (None: nothing), a sentence where the run ends."""

    footings: tuple[Footing, ...]
    y: Array
    event: Event | None = None
    sentence: str = ""
    happened: frozenset[str] = frozenset()  # as `until` has it: "touch left"


def _fewer(names: Sequence[str]) -> Iterator[frozenset[str]]:
    """Yield the sets of all but one, but two, ... of a few contacts."""
    for count in range(len(names) - 1, -1, -1) if len(names) <= FEW else ():
        yield from map(frozenset, itertools.combinations(names, count))


def told_state(footing: Footing) -> str:
    """Return the state of a contact as it is told: one that carries nothing is held."""
    return HELD if footing.state == RESTING else footing.state


class Settling(Resting):
    """Finds what follows."""

    several = False  # whether other modes were admissible at the last event
    strikes: Strikes
    halts: Strikes  # of contacts that stopped along their last direction and had some speed across it

    def _settled(
        self, hit: Watched | None, footings: tuple[Footing, ...], near: Sequence[int], opening: Collection[int],
        leaving: Mapping[int, tuple[int, Array]], landing: Collection[int] = (), before: Sequence[Footing] | None = None,
    ) -> Outcome:  # fmt: skip
        """Return what follows for the contacts that are closed or touch: an impact where one approaches, then their modes.

        opening : those whose normal force has become 0; leaving: those at the edge of their cones, which grip, their friction;
        landing: legs with a law, which are closed in `footings`; before: how contacts stood before legs landed or let go
        """
        self.standing, before = footings, footings if before is None else before
        y, frames, self.several = self.y, {k: self._frame(k) for k in near}, False
        found = self._without_forces(y)
        approach = {k: self._local(found.jets[k], k, frames[k]) for k in near}
        halted = self._halted(hit, y, found, footings, frames, approach)
        if halted is not None:
            y, found = halted, self._without_forces(halted)
            approach = {k: self._local(found.jets[k], k, frames[k]) for k in near}
        fired = -1 if hit is None or hit.name != TOUCHES else hit.which
        strikes = [
            k for k in near if k in landing or (footings[k].state not in CLOSED and (approach[k][-1] < -STILL or k == fired))
        ]
        fast = max((abs(float(approach[k][-1])) for k in near), default=0.0)
        self.strikes.note(self.t, {k: -float(approach[k][-1]) for k in strikes})
        left = self.strikes.left(strikes)
        ends = ends_now(left, fast)
        taking = [k for k in near if footings[k].state in CLOSED or approach[k][-1] <= (fast if ends else STILL)]
        told: dict[str, Any] = {}
        if any(approach[k][-1] < 0.0 for k in taking):  # rows that were held are a little off, too
            struck, impact_told, refusal = self._impact(y, found, taking, frames, approach)
            if refusal and strikes:
                return Outcome(footings, self.y, None, refusal)
            y, told = (y if refusal else struck), (impact_told if strikes else {})  # without strikes it only mends what is off
            found = self._without_forces(y)
            approach = {k: self._local(found.jets[k], k, frames[k]) for k in near}
        if hit is not None and hit.name in (OPENS, SLIPS) and not strikes:
            light = {*opening} if hit.name == OPENS else {hit.which}
            shared, others = self._carried_by_others(y, footings, taking, frames, light)
            if shared is not None and shared != footings:  # else it slips as it stands
                return Outcome(shared, y)
            opening = {*opening, *others} if hit.name == OPENS else opening
        fast = max((abs(float(approach[k][-1])) for k in near), default=0.0)
        for still in (fast, STILL) if ends and ends_now(left, fast) else (STILL,):
            resting = [k for k in taking if approach[k][-1] <= still and k not in opening]
            states, ways, refusal = self._modes(y, resting, frames, approach, leaving)
            leaves = [k for k in resting if approach[k][-1] > STILL]
            if not refusal and all(states[k] in CLOSED for k in leaves):
                break
        if refusal:
            return Outcome(footings, self.y, None, refusal)
        if hit is not None:
            y, stops, lost = self._stopped(y, found, frames, states, ways)
            told = self._with_stops(told, stops, lost, left) if leaves else told
        after = list(footings)
        for k in near:
            at, point = footings[k], self.points[k]
            state, place = states.get(k, OPEN), found.jets[k, :3, 0]
            if state == OPEN:
                gap = float(found.jets[k, 3, 0])
                after[k] = point.let_go(self.t, gap, at) if at.state in CLOSED or k in strikes or k in taking else at
            elif state == HELD and at.state == HELD and point.edge is None:
                after[k] = at
            else:
                ahead, aside, up = map(float, ways.get(k, np.zeros(3)))
                after[k] = point.footing_at(state, self.t, place, self.plane, (ahead, aside, up), at)
        event, happened = self._event(hit, before, after, strikes, told), self._happened(hit, before, after, strikes)
        shared, _ = self._carried_by_others(y, tuple(after), resting, frames, set())
        return Outcome(shared or tuple(after), y, event, "", happened)

    def _halted(
        self, hit: Watched | None, y: Array, found: Answers, footings: Sequence[Footing], frames: Mapping[int, Array],
        speeds: Mapping[int, Array],
    ) -> Array | None:  # fmt: skip
        """Return the state in which a contact stands that stops along one direction after the other, faster and faster.

        None where it does not, or has far to go. Then it slides on across its last direction.
        """
        if hit is None or hit.name != STICKS or self.points[hit.which].edge is not None:
            return None
        fast = float(np.linalg.norm(speeds[hit.which][:-1]))
        self.halts.note(self.t, {hit.which: fast})
        if fast <= STILL or not ends_now(self.halts.left([hit.which]), fast):
            return None
        closed = {k: footings[k].state for k in frames if footings[k].state in (HELD, SLIDING)} | {hit.which: HELD}
        return self._stopped(y, found, frames, closed, {k: np.array(footings[k].towards) for k in closed})[0]

    def _with_stops(self, told: Mapping[str, Any], stops: Array, lost: float, left: float) -> dict[str, Any]:
        """Return what is told of an impact that is the last one taken of those that would end in a time [s]."""
        impulses = dict(told.get("impulses", {}))
        for k, point in enumerate(self.points):
            more = stops[3 * k : 3 * k + 3]
            if np.any(more):
                impulses[point.name] = read_only(impulses.get(point.name, np.zeros(3)) + more)
        return {"impulses": MappingProxyType(impulses), "lost": told.get("lost", 0.0) + lost, "early": left}

    def _carried_by_others(
        self, y: Array, footings: tuple[Footing, ...], among: Sequence[int], frames: Mapping[int, Array], light: Collection[int]
    ) -> tuple[tuple[Footing, ...] | None, set[int]]:
        """Let contacts whose rows others hold already carry nothing, so that each force is determined and none pulls.

        light : those that carry too little, or slip; they rest on the others, or nothing follows (None), and those that rested
        on them are let go, too
        """
        closed = [k for k in among if footings[k].state in CLOSED]
        if len(closed) < 2 or not all(self.points[k].shares for k in closed):
            return None, set()
        found = self._under_forces(y, frozenset(self.points[k].name for k in closed))
        turn, rows = self._problem(closed, frames)
        a = np.concatenate([self._local(found.jets[k], k, frames[k], 2) for k in closed])
        feet = {k: foot_of(self.points[k], footings[k], frames[k], rows[at][0]) for at, k in enumerate(closed)}
        g = turn @ found.matrix @ turn.T
        carry = carrying(g, a, feet, light, LIGHT * self.weight)
        if carry is None and light:  # with others than now they may well carry
            carry = carrying(g, a, feet, (), LIGHT * self.weight)
        if carry is None:
            rests = [k for k in closed if footings[k].state == RESTING]
            return None, let_go(g, feet, [k for k in closed if k not in light and k not in rests], rests)
        after = list(footings)
        for k in closed:
            if k not in carry:
                after[k] = footings[k]._replace(state=RESTING, planted=False)
            elif footings[k].state == RESTING:
                after[k] = carrying_again(self.points[k], footings[k], self.t, found.jets[k, :3, 0], self.plane)
        return tuple(after), set()

    def _happened(
        self, hit: Watched | None, before: Sequence[Footing], after: Sequence[Footing], strikes: Sequence[int]
    ) -> frozenset[str]:
        """Return what has happened in the words of `until`; to stick is to come to rest, not to turn back.

        At a start only what strikes happens: a foot that stands there has not touched.
        """
        found = {f"{TOUCHES} {self.points[k].name}" for k in strikes}
        if hit is None:
            return frozenset(found)
        if hit.name == SLIPS and not self.points[hit.which].closed(after[hit.which]):
            found.add(f"{SLIPS} {self.points[hit.which].name}")  # a leg outside its cone
        for point, one, other in zip(self.points, before, after, strict=True):
            if point.closed(one) and not point.closed(other):
                found.add(f"{OPENS} {point.name}")
            elif point.closed(other) and not point.closed(one):
                found.add(f"{TOUCHES} {point.name}")
            elif (told_state(one), told_state(other)) in ((HELD, SLIDING), (SLIDING, HELD)):
                found.add(f"{SLIPS if other.state == SLIDING else STICKS} {point.name}")
        return frozenset(found)

    def _event(
        self, hit: Watched | None, before: Sequence[Footing], after: Sequence[Footing], strikes: Sequence[int],
        told: Mapping[str, Any],
    ) -> Event | None:  # fmt: skip
        """Return what is told of an event; nothing at a start without an impact."""
        if hit is None and not strikes:
            return None
        mode = {point.name: point.shown(at) for point, at in zip(self.points, after, strict=True)}
        changed = [k for k, (one, other) in enumerate(zip(before, after, strict=True)) if told_state(one) != told_state(other)]
        first = hit.which if hit is not None and not strikes else strikes[0]  # of several at once the first of the scene
        kind = TOUCHES if strikes else OPENS if hit is None else hit.name
        if strikes and all(after[k].state == OPEN for k in strikes):
            kind = BOUNCES
        along = hit is not None and self.points[first].edge is not None and hit.part == ALONG
        if kind == STICKS and (after[first].towards[0] if along else after[first].state == SLIDING):
            kind = SLIPS  # it turns back at once
        involved = tuple(self.points[k].name for k in dict.fromkeys([first, *strikes, *changed]))
        return Event(self.t, kind, self.points[first].name, involved, modes=MappingProxyType(mode), several=self.several, **told)

    def _impact(
        self, y: Array, found: Answers, taking: Sequence[int], frames: Mapping[int, Array], before: Mapping[int, Array]
    ) -> tuple[Array, dict[str, Any], str]:
        """Return the state after an impact, what is told of it, and a sentence where there is none."""
        turn, rows = self._problem(taking, frames)
        v = np.concatenate([before[k] for k in taking])
        matrix = turn @ found.matrix @ turn.T
        shaped = []
        for k, (normal, across) in zip(taking, rows, strict=True):
            grips = self._grips(k, across, [None] * len(across), [False] * len(across))
            shaped.append(Contact(normal, grips, self.points[k].contact.restitution))
        answer = impact(matrix, v, shaped)
        if isinstance(answer, Refusal):
            return y, {}, self._why_not(answer, taking, "impact")
        self.several = self.several or answer.several
        jammed = self._jammed(answer, taking)
        if jammed:
            return y, {}, jammed
        struck, lost = self._pushed(y, found, taking, frames, answer.p, v, answer.v)
        scale = 0.5 * float(np.abs(answer.p) @ (np.abs(answer.v) + np.abs(v)))
        if lost < -GAIN * scale:
            names = listed([self.points[k].name for k in taking])
            why = (
                "with friction, restitution may give back more than there was, with one value for all contacts too (Kane's "
                "paradox); take a smaller restitution, or less friction"
            )
            return y, {}, f"the impact of {names} would raise the kinetic energy by {-lost:.3g} J: {why}"
        p = turn.T @ answer.p
        named = {self.points[k].name: read_only(p[3 * k : 3 * k + 3]) for k in taking if np.any(p[3 * k : 3 * k + 3])}
        return struck, {"impulses": MappingProxyType(named), "lost": lost}, ""

    def _modes(
        self, y: Array, resting: Sequence[int], frames: Mapping[int, Array], speeds: Mapping[int, Array],
        leaving: Mapping[int, tuple[int, Array]],
    ) -> tuple[dict[int, str], dict[int, Array], str]:  # fmt: skip
        """Return how contacts that touch and do not leave go on, along what they slide, and a sentence where none may.

        What acts goes by what is closed, and what is closed by what acts: they are made to agree. First from all closed on, then
        under what else may act, that of most closed contacts first.
        """
        scene, names = self.systems.scene, [self.points[k].name for k in resting]
        closed, tried, refused = frozenset(names), set[object](), ""
        for begin in [closed, *_fewer(names)] if goes_by_phase(scene) else [closed]:
            closed = begin
            for _ in range(AGREE):
                if acting(scene, closed) in tried:
                    break
                tried.add(acting(scene, closed))
                states, ways, refusal = self._modes_under(closed, y, resting, frames, speeds, leaving)
                found = frozenset(self.points[k].name for k, state in states.items() if state in CLOSED)
                if refusal:
                    refused = refused or self._asked(refusal, closed)
                    break
                if acting(scene, found) == acting(scene, closed):
                    return states, ways, ""
                closed = found
        if refused:
            return {}, {}, refused
        why = "what acts while they are closed opens them, and without it they close; let it act in both, or in neither"
        return {}, {}, f"programmes or forces by phase contradict what they do at the contacts {listed(names)}: {why}"

    def _asked(self, refusal: str, closed: frozenset[str]) -> str:
        """Say why nothing may follow where a programme acts: no law of friction, for its controls answer to every push."""
        programmes, _ = acting(self.systems.scene, closed)
        if not programmes:
            return refusal
        return (
            f"no motion is admissible under what the rows of {listed(programmes)} ask for while these are closed: "
            f"{listed(sorted(closed))}. The ground would have to pull, or to hold with more than its friction: ask for less, or "
            "let another programme act where a contact opens"
        )

    def _modes_under(
        self, closed: frozenset[str], y: Array, resting: Sequence[int], frames: Mapping[int, Array],
        speeds: Mapping[int, Array], leaving: Mapping[int, tuple[int, Array]],
    ) -> tuple[dict[int, str], dict[int, Array], str]:  # fmt: skip
        """Return the same under what acts while some contacts are closed."""
        if not resting:
            return {}, {}, ""
        found = self._under_forces(y, closed)
        turn, rows = self._problem(resting, frames)
        shaped, known = [], dict[tuple[int, int], Array]()
        for k, (normal, across) in zip(resting, rows, strict=True):
            point, goes = self.points[k], [part == leaving[k][0] if k in leaving else False for part in range(len(across))]
            for part, axes in enumerate(across):
                v = speeds[k][[axis - across[0][0] for axis in axes]]
                speed = float(np.linalg.norm(v))
                if speed > STILL and point.contact.slips:
                    known[k, part], goes[part] = v / speed, False
                elif goes[part] and (point.at_rest == point.coefficient or len(axes) == 1):
                    friction = leaving[k][1][[axis - across[0][0] for axis in axes]]
                    known[k, part] = -friction / np.linalg.norm(friction)  # else what pushes is new, and so is the direction
            sliding = [known.get((k, part)) for part in range(len(across))]
            shaped.append(Contact(normal, self._grips(k, across, sliding, goes)))
        a = np.concatenate([self._local(found.jets[k], k, frames[k], 2) for k in resting])
        answer = modes(turn @ found.matrix @ turn.T, a, shaped)
        if isinstance(answer, Refusal):
            return {}, {}, self._why_not(answer, resting, "motion")
        self.several = self.several or answer.several
        states, ways = {}, {}
        for at, (k, (_, across)) in enumerate(zip(resting, rows, strict=True)):
            if not answer.closed[at]:
                states[k] = OPEN
                continue
            slips, edge = answer.slipping[at], self.points[k].edge
            slides = (edge is None and self.points[k].smooth) or slips[0]
            states[k] = SLIDING if slides else HELD
            found_ways = np.zeros(2)
            for part, axes in enumerate(across):
                if slips[part] and not (edge is None and self.points[k].smooth):
                    way = known.get((k, part))
                    if way is None:
                        moved, push = answer.v[list(axes)], answer.p[list(axes)]
                        way = moved / np.linalg.norm(moved) if np.linalg.norm(moved) > 0.0 else -push / np.linalg.norm(push)
                    if edge is None:
                        ways[k] = frames[k][:-1].T @ way
                    else:
                        found_ways[part] = float(way[0]) * (edge.skid, edge.friction)[part]
            if edge is not None:
                ways[k] = np.array([found_ways[1], found_ways[0], 0.0])
        return states, ways, ""

    def _jammed(self, answer: Answer, taking: Sequence[int]) -> str:
        """Say where an impact lets a rough contact slip: friction without bound stops it from below, and nothing presses it."""
        for at, k in enumerate(taking):
            if self.points[k].rough and answer.closed[at] and answer.slipping[at][0]:
                return (
                    f"contact {self.points[k].name!r} strikes so flat that its rough ground would have to pull to hold it: it "
                    "scuffs; give it a finite friction, or a `when` if it is not meant to land here"
                )
        return ""

    def _why_not(self, refusal: Refusal, taking: Sequence[int], what: str) -> str:
        """Say why nothing may follow."""
        if refusal.contact is None:
            names = listed([self.points[k].name for k in taking])
            return f"no {what} of the contacts {names} is admissible: none of their modes keeps them out of their surfaces"
        point = self.points[taking[refusal.contact]]
        if refusal.why == "prescribed":
            return (
                f"contact {point.name!r}: its point meets the surface with a speed that laws prescribe, and no impulse can stop "
                "it; let the law end softly, or leave the length free"
            )
        found, k = self._without_forces(self.y), taking[refusal.contact]
        x = found.jets[k, :3, 0]
        angle = self._angle_to(point)
        told = f" at {angle:.4g} rad" if angle is not None else ""
        return (
            f"contact {point.name!r}{told}: with friction {point.coefficient:g} no {what} is admissible there (Painleve): "
            f"friction would press the point into the surface at ({', '.join(f'{value:.4g}' for value in x)}) more than it is "
            "pushed out; take a smaller friction"
        )
