"""Contacts that push and rub: which of them open, stick or slip, and their impulses or forces.

One problem, of velocities at an impact and of accelerations after an event. Rows are velocities (accelerations) of contact points
along normals and tangents, and of ideal constraints; G = J M^-1 J^T says what reactions p do to them:

    v = G p + v_free
    v_n >= -e v_n^-   perpendicular to   p_n >= 0             (Signorini; Moreau and Newton at an impact, e = 0 for accelerations)
    |p_t| <= hold p_n  where v_t = 0,   p_t = -slip p_n v_t/|v_t|  elsewhere                                            (Coulomb)
    v = 0                                                                                        (rows of no contact: ideal ones)

Modes are tried from the most sticking one on; in each the problem is linear but for the directions of slipping, which Newton's
method finds (cone_modes.py). G may be singular (feet that share a load): then reactions are the least admissible ones
(least_reactions.py). Everything is numpy: a run has few events, and compiling would take longer than all of them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from vlmb.system.cone_guess import likely
from vlmb.system.cone_modes import answers
from vlmb.system.cone_problem import (
    Answer,
    Array,
    Contact,
    Directions,
    Frame,
    Grip,
    Mode,
    Problem,
    Refusal,
    fixed,
    frame_of,
    inverse_of,
)
from vlmb.system.least_reactions import RANK

__all__ = ["Answer", "Contact", "Grip", "Refusal", "impact", "modes", "reactions"]

GENTLE = 1e-6  # m/s: an approach that is slower has no restitution
SAME = 1e-9  # two answers whose velocities differ by less are one
MANY = 300  # modes: beyond, only the most sticking and the guessed one are tried
FEW = 2  # frictions whose directions are to be found: up to here every mode is looked at


def impact(g: Array, v: Array, contacts: Sequence[Contact]) -> Answer | Refusal:
    """Return impulses p (N s) and velocities after: v^+ = G p + v^-, Moreau's and Newton's law.

    All contacts that are closed or touch take part; slower than GENTLE there is no restitution. The kinetic energy lost to fixed
    surfaces is -p.(v^- + v^+)/2: never negative with one restitution and no friction, or with friction and none. With both it may
    be (the velocity along the ground is not restored, that along the normal is): who calls looks at it. A contact that leaves
    already may be hit by others and approach afterwards, by no more than e v_n^-: then it takes part in an impact of its own.
    """
    shift = np.zeros(v.size)
    for contact in contacts:
        if abs(v[contact.normal]) > GENTLE:
            shift[contact.normal] = contact.restitution * v[contact.normal]
    found = _solve(g, v + shift, contacts, rough_limit=True)
    return found if isinstance(found, Refusal) else found._replace(v=fixed(found.v - shift))


def modes(g: Array, a: Array, contacts: Sequence[Contact]) -> Answer | Refusal:
    """Return forces p (N) and accelerations of all rows, from the accelerations `a` without contact forces.

    Contacts are those whose gap and normal velocity are zero; a grip that slides has its direction in `sliding`.
    """
    return _solve(g, a, contacts, rough_limit=False)


def reactions(
    g: Array, a: Array, contacts: Sequence[Contact], closed: Sequence[bool], slipping: Sequence[Sequence[bool]]
) -> Answer | None:
    """Return what `modes` would if contacts are in these modes, or None where they cannot stay in them."""
    mode = tuple(tuple(slips) if shut else None for shut, slips in zip(closed, slipping, strict=True))
    return next(answers(Problem(g, a, tuple(contacts)), mode), None)


def _solve(g: Array, b: Array, contacts: Sequence[Contact], *, rough_limit: bool) -> Answer | Refusal:
    problem = Problem(g, b, tuple(contacts))
    every = _modes(problem.contacts, rough_limit)
    free = sum(0.0 < grip.slip < math.inf and grip.sliding is None for contact in contacts for grip in contact.grips)
    best: Answer | None = None
    pressed = False
    for thorough in (False, True):
        for found in _found(problem, every, free, thorough):
            if not rough_limit and _is_pressed(problem, found):
                pressed = True  # the least push aside grows at once: what may happen instead does
                continue
            if best is None:
                best = found._replace(several=pressed)
            elif not _equal(best, found, problem):
                return best._replace(several=True)
            if free == 0 or free > FEW:  # smooth or rough ground makes a convex problem: one answer
                return best
        if best is not None:
            return best
    return _refusal(problem)


def _found(problem: Problem, every: Sequence[Mode], free: int, thorough: bool) -> Iterator[Answer]:
    """Yield admissible answers, of the most sticking mode first; of many contacts guesses come next."""
    yield from answers(problem, every[0], thorough=thorough)
    start: Directions = {}
    if free > (1 if thorough else FEW):
        for mode, start in likely(problem):
            yield from answers(problem, mode, start=start)
    for mode in every[1:]:
        yield from answers(problem, mode, start=start, thorough=thorough)


def _equal(one: Answer, other: Answer, problem: Problem) -> bool:
    size = np.abs(problem.b) + np.abs(problem.g) @ np.maximum(np.abs(one.p), np.abs(other.p))
    return bool(np.all(np.abs(one.v - other.v) <= SAME * np.max(size, initial=0.0)))


def _modes(contacts: Sequence[Contact], rough_limit: bool) -> list[Mode]:
    """All modes, from the most sticking one on; those with a rough contact that slips, the limit of much friction, come last."""
    choices: list[list[tuple[bool, ...] | None]] = []
    for contact in contacts:
        states: list[tuple[bool, ...]] = []
        for grip in contact.grips:
            if grip.sliding is not None or grip.hold == 0.0:
                states.append((True,))
            elif math.isinf(grip.slip):
                states.append((False, True) if rough_limit and len(contact.grips) == 1 else (False,))
            else:
                states.append((False, True))
        choices.append([None, *itertools.product(*states)])  # the second sticks most

    def key(mode: Mode) -> tuple[bool, int, int]:
        pairs = list(zip(contacts, mode, strict=True))
        limits = any(
            slips and math.isinf(grip.slip)
            for contact, state in pairs
            for grip, slips in zip(contact.grips, state or (), strict=False)
        )
        return limits, -sum(state.count(False) for state in mode if state), sum(state is None for state in mode)

    if math.prod(len(states) for states in choices) > MANY:
        return [tuple(states[1] for states in choices)]  # the most sticking one; the rest is left to the guess
    return sorted(itertools.product(*choices), key=key)


def _is_pressed(problem: Problem, found: Answer) -> bool:
    """Whether friction presses a contact that slips down more than its normal force pushes it out (Painleve).

    The force that keeps it on its surface all the same grows with how deep it is: no such motion lasts.
    """
    held: Array | None = None
    for contact, slips in zip(problem.contacts, found.slipping, strict=True):
        push = float(found.p[contact.normal])
        rows = [row for grip, goes in zip(contact.grips, slips, strict=True) if goes for row in grip.rows]
        if push > 0.0 and np.any(found.p[rows]):
            held = _held(problem)[0] if held is None else held
            if held[contact.normal, contact.normal] + float(held[contact.normal, rows] @ found.p[rows]) / push <= 0.0:
                return True
    return False


def _held(problem: Problem) -> tuple[Array, Frame, Array]:
    """Return what is left of G once ideal rows are held, with these and the inverse of their part."""
    frame = frame_of(problem, (None,) * len(problem.contacts), {})
    inverse = inverse_of(problem, frame)
    return problem.g - problem.g[:, frame.rows] @ inverse @ problem.g[frame.rows], frame, inverse


def _refusal(problem: Problem) -> Refusal:
    """Say why no mode is admissible, from what is left of G once ideal rows are held."""
    held, frame, inverse = _held(problem)
    free = problem.b - problem.g[:, frame.rows] @ (inverse @ problem.b[frame.rows])
    if np.any(np.abs(free[frame.rows]) > 1e-9 * np.max(np.abs(problem.b), initial=0.0)):
        return Refusal("rows")
    numbers = []
    for k, contact in enumerate(problem.contacts):
        normal = contact.normal
        if free[normal] < 0.0 and held[normal, normal] <= RANK * problem.g[normal, normal]:
            return Refusal("prescribed", k)
        number = held[normal, normal]
        for grip in contact.grips:
            if grip.sliding is not None:
                number -= grip.slip * float(held[normal, list(grip.rows)] @ np.array(grip.sliding))
        numbers.append((number, k))
    number, k = min(numbers, default=(math.nan, 0))
    return Refusal("friction", k, number) if number <= 0.0 else Refusal("none")
