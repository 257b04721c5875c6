"""Controls and accelerations that rows of a programme ask for, in the accelerations themselves: small matrices only.

    M vdot = b + P^T mu + T u,   J vdot = gamma,   W vdot = beta

`u` act each in a velocity of its own; other controls stand among the pushes `mu`, below those that hold the rows J. With U the
velocities without a control of their own and L P_U^T = 0, the rows and the equations of motion that nothing drives leave of vdot

    C vdot = d,   C = (J; W; L M_U).

Of these vdot the one whose joints come nearest to a posture is a projection. Forces follow: pushes from the equations U, then
u. What moves no joint of a posture, and what loads without moving, goes to the least controls.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vlmb.core.dense import cholesky, solve_cholesky, solve_upper
from vlmb.core.jit import inner, kernel
from vlmb.core.scalars import sqrt
from vlmb.core.tree import Array, Integers

SMALL = 1e-9  # relative size below which a direction counts as none
REPEATED = 1e-12  # of a Cholesky pivot squared over the diagonal: a row that others repeat
FINE, REPEATING, SHARED = range(3)  # answers: rows repeat each other or contradict; pushes are not determined


class Driven(NamedTuple):
    """What of a mechanism its controls drive, and room to solve in. Rows are e that are held, then those of the programme."""

    others: Integers  # (U,) velocities without a control of their own
    own: Integers  # (u,) those of controls of their own
    slots: Integers  # (u + o,) place of each control among all: of those of their own, then of the others
    rest: Integers  # velocities that a posture says nothing of
    posed: Integers  # (joints,) the others
    flexible: Array  # (joints,) 1 over the weight of a joint in the posture
    counts: Integers  # (6,) see below
    motion: Array  # (U, pushes + nv + 1) the equations U: pushes, M_U, b_U, reflected
    demands: Array  # (rows + U, nv + 1) C and d, columns of `rest` first
    pushes: Array  # (pushes, nv)
    moved: Array  # (5, nv) b, vdot, forces, room for two more
    mu: Array  # (pushes,)
    order: Integers  # (2, most) columns in the order of their pivots
    spread: Array  # (most, most + 1) room for the projection
    loads: Array  # (controls, most + 1) controls over their scales by what is left to choose
    choices: Array  # (most, pushes + nv) what that is of pushes and accelerations
    given: Array  # (most,) room


DEMANDS, RANK, REST, LEFT, CHOICES, LOADS = range(6)  # in `counts`


def make_driven(
    nv: int, rows: int, held: int, own: Integers, slots: Integers, others: int, posed: Integers, flexible: Array
) -> Driven:
    """Return what is constant, and the room; `others` controls have no velocity of their own."""
    every = np.arange(nv)
    free, rest = np.setdiff1d(every, own), np.setdiff1d(every, posed)
    pushes, controls = held + others, len(own) + others
    most = max(len(free) + rows, nv + pushes, controls) + 1
    return Driven(
        free, own, slots, rest, posed, flexible, np.zeros(6, np.int64), np.zeros((len(free), pushes + nv + 1)),
        np.zeros((rows + len(free), nv + 1)), np.zeros((pushes, nv)), np.zeros((5, nv)), np.zeros(pushes),
        np.zeros((2, most), np.int64), np.zeros((most, most + 1)), np.zeros((controls, most + 1)),
        np.zeros((most, pushes + nv)), np.zeros(most),
    )  # fmt: skip


@inner
def triangular(a: Array, m: int, n: int, width: int, order: Integers, room: Array) -> int:
    """Bring the first n columns of A (m, width) to an upper triangle by reflections, the longest first; return their rank.

    `order` tells which column stands where; all other columns go along.
    """
    for j in range(n):
        order[j] = j
    first = 0.0
    for k in range(min(m, n)):
        for j in range(k, n):
            room[j] = 0.0
        for i in range(k, m):
            for j in range(k, n):
                room[j] += a[i, j] * a[i, j]
        best = k
        for j in range(k + 1, n):
            if room[j] > room[best]:
                best = j
        size = sqrt(room[best])
        first = max(first, size)
        if not size > SMALL * first:
            return k
        if best != k:
            order[k], order[best] = order[best], order[k]
            for i in range(m):
                a[i, k], a[i, best] = a[i, best], a[i, k]
        if a[k, k] > 0.0:
            size = -size
        a[k, k] -= size
        scale = -1.0 / (size * a[k, k])
        for j in range(k + 1, width):
            room[j] = 0.0
        for i in range(k, m):
            own = a[i, k]
            for j in range(k + 1, width):
                room[j] += own * a[i, j]
        for i in range(k, m):
            share = scale * a[i, k]
            for j in range(k + 1, width):
                a[i, j] -= share * room[j]
        a[k, k] = size
        for i in range(k + 1, m):
            a[i, k] = 0.0
    return min(m, n)


@inner
def write_demands(
    driven: Driven, mass: Array, bias: Array, tau: Array, matrix: Array, values: Array, scales: Array, gains: Array, out: Array,
    first: int, beside: Array, beside_rows: Integers,
) -> None:  # fmt: skip
    """Write C and d, and what of the equations of motion is needed later.

    matrix : rows, then forces over the velocities; the controls from force `first` on
    beside (any, nv) : what else the held rows `beside_rows` push on
    """
    nv, rows, pushes = mass.shape[0], out.shape[1], driven.pushes.shape[0]
    count, held, own = len(driven.others), pushes - (len(driven.slots) - len(driven.own)), len(driven.own)
    b, push, motion, demands = driven.moved[0], driven.pushes, driven.motion, driven.demands
    for k in range(nv):
        b[k] = tau[k] - bias[k]
    for f in range(first):
        for k in range(nv):
            b[k] += values[f] * matrix[rows + f, k]
    for r in range(held):
        for k in range(nv):
            push[r, k] = matrix[r, k]
    for s in range(len(beside_rows)):
        for k in range(nv):
            push[beside_rows[s], k] += beside[s, k]
    for s in range(pushes - held):
        slot = driven.slots[own + s]
        for k in range(nv):
            push[held + s, k] = scales[slot] * matrix[rows + first + slot, k]
    for i in range(count):
        at = driven.others[i]
        for p in range(pushes):
            motion[i, p] = push[p, at]
        for k in range(nv):
            motion[i, pushes + k] = mass[at, k]
        motion[i, pushes + nv] = b[at]
    rank = triangular(motion, count, pushes, pushes + nv + 1, driven.order[0], driven.given)
    driven.counts[RANK], driven.counts[DEMANDS] = rank, rows + count - rank
    loose = len(driven.rest)
    for r in range(rows + count - rank):
        for k in range(nv):
            at = driven.rest[k] if k < loose else driven.posed[k - loose]
            demands[r, k] = matrix[r, at] if r < rows else motion[rank + r - rows, pushes + at]
        total = motion[rank + r - rows, pushes + nv] if r >= rows else 0.0
        if r < rows:
            for k in range(rows):
                total += gains[r, k] * out[0, k] + gains[r, rows + k] * out[1, k] + gains[r, 2 * rows + k] * out[2, k]
        demands[r, nv] = total
        size = 0.0
        for k in range(nv):
            size += demands[r, k] * demands[r, k]
        if size > 0.0:
            size = 1.0 / sqrt(size)
            for k in range(nv + 1):
                demands[r, k] *= size


@inner
def find_accelerations(driven: Driven, back: Array) -> bool:
    """Write vdot that meets C vdot = d and comes nearest to `back` (joints,); False where rows repeat each other."""
    nv, loose, joints, count = driven.moved.shape[1], len(driven.rest), len(driven.posed), driven.counts[DEMANDS]
    demands, spread, vdot, given = driven.demands, driven.spread, driven.moved[1], driven.given
    rank = triangular(demands, count, loose, nv + 1, driven.order[1], given)
    left = count - rank
    driven.counts[REST], driven.counts[LEFT] = rank, left
    for i in range(left):
        for j in range(i + 1):
            total = 0.0
            for k in range(joints):
                total += demands[rank + i, loose + k] * driven.flexible[k] * demands[rank + j, loose + k]
            spread[i, j] = total
        total = demands[rank + i, nv]
        for k in range(joints):
            total -= demands[rank + i, loose + k] * back[k]
        spread[i, left] = total
    if not cholesky(spread, left, REPEATED):
        return False
    solve_cholesky(spread, left, spread[:, left : left + 1], 1)
    for k in range(joints):
        total = 0.0
        for i in range(left):
            total += spread[i, left] * demands[rank + i, loose + k]
        vdot[driven.posed[k]] = back[k] + driven.flexible[k] * total
    for i in range(rank):
        given[i] = demands[i, nv]
        for k in range(joints):
            given[i] -= demands[i, loose + k] * vdot[driven.posed[k]]
    solve_upper(demands, rank, given)
    for j in range(loose):
        vdot[driven.rest[driven.order[1, j]]] = given[j] if j < rank else 0.0
    return True


@inner
def pushes_for(driven: Driven, force: Array, equations: Array) -> None:
    """Write the pushes that bear `equations` (rank,), those U as they are reflected, into the end of what is left of `force`."""
    rank, mu = driven.counts[RANK], driven.mu
    solve_upper(driven.motion, rank, equations)
    for p in range(len(mu)):
        mu[driven.order[0, p]] = equations[p] if p < rank else 0.0
    for p in range(len(mu)):
        if mu[p] != 0.0:
            for k in range(len(force)):
                force[k] -= mu[p] * driven.pushes[p, k]


@inner
def write_loads(driven: Driven, scales: Array, force: Array, column: int) -> None:
    """Write controls over their scales that a force over the velocities, and pushes, ask for into a column of `loads`."""
    own, held = len(driven.own), len(driven.mu) - (len(driven.slots) - len(driven.own))
    for s in range(own):
        driven.loads[s, column] = force[driven.own[s]] / scales[driven.slots[s]]
    for s in range(len(driven.slots) - own):
        driven.loads[own + s, column] = driven.mu[held + s]


@inner
def find_controls(driven: Driven, mass: Array, scales: Array, values: Array, first: int, multipliers: Array) -> bool:
    """Write controls and multipliers; what is left to choose goes to the least controls. False: pushes are not determined."""
    nv, pushes, loose = driven.moved.shape[1], len(driven.mu), len(driven.rest)
    b, vdot, force, change = driven.moved[0], driven.moved[1], driven.moved[2], driven.moved[3]
    rank, settled, motion, given, mu = driven.counts[RANK], driven.counts[REST], driven.motion, driven.given, driven.mu
    idle = pushes - rank
    choices = idle + loose - settled
    driven.counts[CHOICES], driven.counts[LOADS] = choices, choices
    for c in range(choices + 1):  # the last one is what there is
        for k in range(nv):
            change[k] = vdot[k] if c == choices else 0.0
        if idle <= c < choices:
            column = settled + c - idle
            for i in range(settled):
                given[i] = -driven.demands[i, column]
            solve_upper(driven.demands, settled, given)
            for j in range(settled):
                change[driven.rest[driven.order[1, j]]] = given[j]
            change[driven.rest[driven.order[1, column]]] = 1.0
        for i in range(rank):
            given[i] = -motion[i, c] if c < idle else 0.0
        if c < idle:
            for i in range(rank):
                given[i] = -motion[i, rank + c]
            for k in range(nv):
                force[k] = 0.0
        else:
            for k in range(nv):
                force[k] = -b[k] if c == choices else 0.0
            for j in range(nv):
                if change[j] != 0.0:
                    for k in range(nv):
                        force[k] += change[j] * mass[j, k]
            for i in range(rank):
                total = -motion[i, pushes + nv] if c == choices else 0.0
                for k in range(nv):
                    total += motion[i, pushes + k] * change[k]
                given[i] = total
        pushes_for(driven, force, given)
        if c < idle:
            at = driven.order[0, rank + c]
            mu[at] = 1.0
            for k in range(nv):
                force[k] -= driven.pushes[at, k]
        write_loads(driven, scales, force, c)
        if c < choices:
            for p in range(pushes):
                driven.choices[c, p] = mu[p]
            for k in range(nv):
                driven.choices[c, pushes + k] = change[k]
    own, fine = len(driven.own), True
    if choices > 0:
        found = triangular(driven.loads, len(driven.slots), choices, choices + 1, driven.order[1], driven.spread[0])
        driven.counts[LOADS], fine = found, found == choices
        for i in range(found):
            given[i] = -driven.loads[i, choices]
        solve_upper(driven.loads, found, given)
        for i in range(found):
            c = driven.order[1, i]
            for p in range(pushes):
                mu[p] += given[i] * driven.choices[c, p]
            for k in range(nv):
                vdot[k] += given[i] * driven.choices[c, pushes + k]
        for k in range(nv):
            force[k] = -b[k]
        for j in range(nv):
            for k in range(nv):
                force[k] += vdot[j] * mass[j, k]
        for p in range(pushes):
            for k in range(nv):
                force[k] -= mu[p] * driven.pushes[p, k]
    held = pushes - (len(driven.slots) - own)
    for s in range(own):
        values[first + driven.slots[s]] = force[driven.own[s]]
    for s in range(len(driven.slots) - own):
        slot = driven.slots[own + s]
        values[first + slot] = mu[held + s] * scales[slot]
    for r in range(held):
        multipliers[r] = mu[r]
    return fine


@kernel
def drive(
    others: Integers, own: Integers, slots: Integers, rest: Integers, posed: Integers, flexible: Array, counts: Integers,
    motion: Array, demands: Array, pushes: Array, moved: Array, mu: Array, order: Integers, spread: Array, loads: Array,
    choices: Array, given: Array, mass: Array, bias: Array, tau: Array, matrix: Array, values: Array, scales: Array,
    gains: Array, out: Array, first: int, beside: Array, beside_rows: Integers, back: Array, multipliers: Array, stage: int,
) -> int:  # fmt: skip
    """Find vdot (`moved[1]`), controls and multipliers. Stage 0: all; 1: C and d alone; 2: from C and d on."""
    driven = Driven(
        others, own, slots, rest, posed, flexible, counts, motion, demands, pushes, moved, mu, order, spread, loads, choices,
        given,
    )  # fmt: skip
    if stage != 2:
        write_demands(driven, mass, bias, tau, matrix, values, scales, gains, out, first, beside, beside_rows)
        if stage == 1:
            return FINE
    if not find_accelerations(driven, back):
        return REPEATING
    return FINE if find_controls(driven, mass, scales, values, first, multipliers) else SHARED
