"""A guess of modes: alternating directions on the cones, as far as it takes to see who opens, sticks and slips."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from vlmb.system.cone_problem import Array, Directions, Mode, Problem

SHORT, LONG = 1000, 20_000  # steps
CLOSE = 1e-9
ZERO = 1e-6  # parts of the largest below this are zero


def likely(problem: Problem) -> Iterator[tuple[Mode, Directions]]:
    """Yield modes and directions of slipping that may be the answer, again after more steps; of one grip each, at rest.

    Split p = z with z in the cones, scaled multiplier u; -rho u is the velocity with de Saxce's term slip |v_t| on the normal,
    by which Coulomb's law is a complementarity of cones (Acary and Cadoux).
    """
    grips = [contact.grips[0] for contact in problem.contacts if len(contact.grips) == 1]
    if len(grips) < len(problem.contacts) or any(grip.sliding is not None for grip in grips):
        return
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
            yield _read(problem, z, -rho * u, rows)
        if step % 20 == 19 and not 0.1 < primal / max(dual, 1e-300) < 10.0:
            factor = 3.0 if primal > dual else 1.0 / 3.0
            rho *= factor
            u /= factor
    yield _read(problem, z, -rho * u, rows)


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


def _read(problem: Problem, z: Array, v: Array, rows: Array) -> tuple[Mode, Directions]:
    largest = ZERO * float(np.max(np.abs(z[rows]), initial=0.0))
    fastest = ZERO * float(np.max(np.abs(v[rows]), initial=0.0))
    mode: list[tuple[bool, ...] | None] = []
    directions: Directions = {}
    for k, contact in enumerate(problem.contacts):
        n, tangents = contact.normal, list(contact.grips[0].rows)
        speed = float(np.linalg.norm(v[tangents]))
        if speed > 0.0:
            directions[k, 0] = v[tangents] / speed
        slips = contact.grips[0].hold == 0.0 or (speed > fastest and not math.isinf(contact.grips[0].slip))
        mode.append(None if z[n] <= largest else (slips,))
    return tuple(mode), directions
