"""A guess of modes: alternating directions on the cones, as far as it takes to see who opens, sticks and slips."""

from __future__ import annotations

import math

import numpy as np

from vlmb.system.cone_modes import Array, Directions, Mode, Problem

CLOSE = 1e-9
ZERO = 1e-6  # parts of the largest below this are zero


def likely(problem: Problem, steps: int) -> tuple[Mode, Directions] | None:
    """Return modes and directions of slipping that may be the answer; None for other contacts than of one grip in a plane.

    Split p = z with z in the cones, scaled multiplier u; -rho u is the velocity with de Saxce's term slip |v_t| on the normal,
    by which Coulomb's law is a complementarity of cones: (Acary and Cadoux).
    """
    if any(len(contact.grips) != 1 or len(contact.grips[0].rows) != 2 for contact in problem.contacts):
        return None
    rows = np.array([[contact.normal, *contact.grips[0].rows] for contact in problem.contacts])
    slopes = np.array([contact.grips[0].slip for contact in problem.contacts])
    diagonal = np.diag(problem.g).copy()
    diagonal[rows] = np.mean(diagonal[rows], axis=1)[:, None]
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    b = scale * problem.b
    values, vectors = np.linalg.eigh(scale[:, None] * problem.g * scale)
    rho = math.sqrt(max(values[-1], 1e-300) * max(values[values > 1e-9 * values[-1]][0], 1e-300))
    z, u = np.zeros(b.size), np.zeros(b.size)
    for step in range(steps):
        pull = rho * (z - u) - b
        pull[rows[:, 0]] -= np.where(np.isinf(slopes), 0.0, slopes) * rho * np.hypot(u[rows[:, 1]], u[rows[:, 2]])
        p = vectors @ ((vectors.T @ pull) / (values + rho))
        last, z = z, _project(p + u, rows, slopes)
        u += p - z
        primal, dual = float(np.linalg.norm(p - z)), float(np.linalg.norm(z - last))
        size = max(float(np.linalg.norm(z)), 1e-300)
        if primal < CLOSE * size and dual < CLOSE * size:
            break
        if step % 20 == 19 and not 0.1 < primal / max(dual, 1e-300) < 10.0:
            factor = 3.0 if primal > dual else 1.0 / 3.0
            rho *= factor
            u /= factor
    return _read(problem, z, -rho * u, rows)


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
            factor = slope * along / across
            found[one], found[two] = factor * q[one], factor * q[two]
    return found


def _read(problem: Problem, z: Array, v: Array, rows: Array) -> tuple[Mode, Directions]:
    largest = ZERO * float(np.max(np.abs(z[rows]), initial=0.0))
    fastest = ZERO * float(np.max(np.abs(v[rows]), initial=0.0))
    mode: list[tuple[bool, ...] | None] = []
    directions: Directions = {}
    for k, contact in enumerate(problem.contacts):
        n, tangents = rows[k, 0], rows[k, 1:]
        speed = float(np.linalg.norm(v[tangents]))
        if speed > 0.0:
            directions[k, 0] = v[tangents] / speed
        slips = contact.grips[0].hold == 0.0 or (speed > fastest and not math.isinf(contact.grips[0].slip))
        mode.append(None if z[n] <= largest else (slips,))
    return tuple(mode), directions
