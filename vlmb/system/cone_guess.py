"""A guess of modes, as far as it takes to see who opens, sticks and slips: by alternating directions on the cones, or in turn."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from vlmb.system.cone_problem import Array, Directions, Grip, Mode, Problem

SHORT, LONG = 1000, 20_000  # steps
ROUNDS = 2000  # of all contacts in turn
CLOSE = 1e-9
ZERO = 1e-6  # parts of the largest below this are zero


def likely(problem: Problem) -> Iterator[tuple[Mode, Directions]]:
    """Yield modes and directions of slipping that may be the answer, again after more steps."""
    grips = [grip for contact in problem.contacts for grip in contact.grips]
    single = all(len(contact.grips) == 1 for contact in problem.contacts)
    if single and not any(grip.sliding is not None for grip in grips):
        yield from _alternating(problem, grips)
    else:
        yield _in_turn(problem)


def _in_turn(problem: Problem) -> tuple[Mode, Directions]:
    """Return a guess for contacts of any grips, of which some slide already: each in turn is given what it needs by itself."""
    g, b, p = problem.g, problem.b, np.zeros(problem.b.size)
    of_contacts = {row for k in problem.contacts for row in (k.normal, *(row for grip in k.grips for row in grip.rows))}
    ideal = [row for row in range(p.size) if row not in of_contacts and g[row, row] > 0.0]
    least = [[float(np.trace(g[np.ix_(grip.rows, grip.rows)])) for grip in contact.grips] for contact in problem.contacts]
    for _ in range(ROUNDS):
        before = p.copy()
        for row in ideal:
            p[row] -= (g[row] @ p + b[row]) / g[row, row]
        for contact, sizes in zip(problem.contacts, least, strict=True):
            n = contact.normal
            if g[n, n] > 0.0:
                p[n] = max(p[n] - (g[n] @ p + b[n]) / g[n, n], 0.0)
            for grip, size in zip(contact.grips, sizes, strict=True):
                rows = list(grip.rows)
                if grip.sliding is not None:
                    p[rows] = -grip.slip * p[n] * np.array(grip.sliding)
                elif size > 0.0:
                    pull = p[rows] - (g[rows] @ p + b[rows]) / size
                    most, across = (grip.hold * p[n] if p[n] > 0.0 else 0.0), float(np.linalg.norm(pull))
                    p[rows] = pull if across <= most else pull * (0.0 if p[n] == 0.0 else grip.slip * p[n] / across)
        if np.linalg.norm(p - before) <= CLOSE * np.linalg.norm(p):
            break
    return _read(problem, p, g @ p + b)


def _read(problem: Problem, p: Array, v: Array) -> tuple[Mode, Directions]:
    largest = ZERO * float(np.max(np.abs(p), initial=0.0))
    fastest = ZERO * max((float(np.abs(v[list(grip.rows)]).max()) for k in problem.contacts for grip in k.grips), default=0.0)
    mode: list[tuple[bool, ...] | None] = []
    directions: Directions = {}
    for k, contact in enumerate(problem.contacts):
        slips = []
        for j, grip in enumerate(contact.grips):
            across = v[list(grip.rows)]
            speed = float(np.linalg.norm(across))
            if speed > 0.0:
                directions[k, j] = across / speed
            free = grip.hold == 0.0 or grip.sliding is not None
            slips.append(free or (speed > fastest and not math.isinf(grip.slip)))
        mode.append(None if p[contact.normal] <= largest else tuple(slips))
    return tuple(mode), directions


def _alternating(problem: Problem, grips: list[Grip]) -> Iterator[tuple[Mode, Directions]]:
    """Yield guesses for contacts of one grip each, at rest.

    Split p = z with z in the cones, scaled multiplier u; -rho u is the velocity with de Saxce's term slip |v_t| on the normal,
    by which Coulomb's law is a complementarity of cones (Acary and Cadoux).
    """
    size = problem.b.size  # one more place, always zero, is the second tangent of contacts in a plane
    rows = np.array([(k.normal, *grip.rows, size)[:3] for k, grip in zip(problem.contacts, grips, strict=True)])
    slopes = np.array([grip.slip for grip in grips])
    diagonal = np.append(np.diag(problem.g), 0.0)
    diagonal[rows] = (np.sum(diagonal[rows], axis=1) / np.sum(rows < size, axis=1))[:, None]
    diagonal = diagonal[:size]
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    b = scale * problem.b
    values, vectors = np.linalg.eigh(scale[:, None] * problem.g * scale)
    if not values[-1] > 0.0:
        return
    rho = math.sqrt(values[-1] * values[values > 1e-9 * values[-1]][0])
    z, u = np.zeros(size + 1), np.zeros(size + 1)
    for step in range(LONG):
        pull = rho * (z - u)[:size] - b
        pull[rows[:, 0]] -= np.where(np.isinf(slopes), 0.0, slopes) * rho * np.hypot(u[rows[:, 1]], u[rows[:, 2]])
        p = np.append(vectors @ ((vectors.T @ pull) / (values + rho)), 0.0)
        last, z = z, _project(p + u, rows, slopes)
        u += p - z
        primal, dual = float(np.linalg.norm(p - z)), float(np.linalg.norm(z - last))
        if max(primal, dual) < CLOSE * max(float(np.linalg.norm(z)), 1e-300):
            break
        if step == SHORT:
            yield _read(problem, z[:size], -rho * u[:size])
        if step % 20 == 19 and not 0.1 < primal / max(dual, 1e-300) < 10.0:
            factor = 3.0 if primal > dual else 1.0 / 3.0
            rho *= factor
            u /= factor
    yield _read(problem, z[:size], -rho * u[:size])


def _project(q: Array, rows: Array, slopes: Array) -> Array:
    """Return the nearest point of the cones; rows of no contact stay."""
    found = q.copy()
    for (n, one, two), slope in zip(rows, slopes, strict=True):
        first, across = float(q[n]), math.hypot(q[one], q[two])
        if math.isinf(slope):
            found[n] = max(first, 0.0)
        elif across > slope * first:
            along = max(first + slope * across, 0.0) / (1.0 + slope * slope)
            found[n] = along
            factor = slope * along / across if across > 0.0 else 0.0
            found[one], found[two] = factor * q[one], factor * q[two]
    return found
