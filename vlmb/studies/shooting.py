"""Shooting: starts from which a motion comes back, by Newton's method on what it lacks; and how deviations are multiplied."""

from __future__ import annotations

from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import VlmbError

Array = NDArray[np.float64]
U = TypeVar("U")

ROUNDS, CLOSE = 25, 1e-11  # iterations; what is lacking that ends them
HELD = 1e-9  # of what is sought, what may be lacking
FLAT, LONGEST = 1e-7, 0.3  # singular values over the largest that are none; the longest step, in units of a coordinate, or [s]
SHARES = (1.0, 0.5, 0.2, 0.05)  # of a step that are tried


class Target(Protocol[U]):
    """What is sought: u with lacking(u) = 0."""

    def lacking(self, u: U) -> Array:
        """Return what a motion from u lacks to come back. Raises VlmbError where it does not come so far."""
        ...

    def linear(self, u: U) -> Array:
        """Return the derivatives of what is lacking along the steps from u; below them rows that steps must meet."""
        ...

    def moved(self, u: U, step: Array) -> U:
        """Return u a step on."""
        ...


def shoot(target: Target[U], u: U) -> tuple[U, float]:
    """Search near u; return where the search ends and the largest that is lacking there. Raises what the first motion does."""
    lacking = target.lacking(u)
    for _ in range(ROUNDS):
        size = float(np.abs(lacking).max(initial=0.0))
        if size < CLOSE:
            break
        matrix = target.linear(u)
        step = newton_step(matrix, np.append(-lacking, np.zeros(len(matrix) - len(lacking))))
        for share in SHARES:
            trial = target.moved(u, share * step)
            try:
                found = target.lacking(trial)
            except VlmbError:
                continue
            if np.abs(found).max(initial=0.0) < size:
                u, lacking = trial, found
                break
        else:
            break
    return u, float(np.abs(lacking).max(initial=0.0))


def newton_step(matrix: Array, wanted: Array) -> Array:
    """Return a step of least norm.

    Directions that hardly change what is lacking, such as to a larger swing, are left out while they would lead far away.
    """
    left, sizes, right = np.linalg.svd(matrix, full_matrices=False)
    parts = (left.T @ wanted) / np.maximum(sizes, 1e-300)
    useful = int((sizes > FLAT * sizes[0]).sum())
    step = np.zeros(matrix.shape[1])
    for k in range(useful, 0, -1):
        step = right[:k].T @ parts[:k]
        if float(np.abs(step).max()) <= LONGEST:
            break
    return step * min(1.0, LONGEST / max(float(np.abs(step).max(initial=0.0)), LONGEST))


def multipliers_of(matrix: Array, error: float) -> tuple[NDArray[np.complex128], Array]:
    """Return the eigenvalues of a map's derivatives, the largest first, and how far they are known.

    error : of the entries, relative to the largest of a column, or to 1. To first order it moves an eigenvalue by itself over
    the cosine between its left and right vector.
    """
    values, right = np.linalg.eig(matrix)
    size = error * float(np.linalg.norm(np.maximum(np.abs(matrix).max(axis=0, initial=0.0), 1.0)))
    try:
        left = np.linalg.inv(right)
        condition = np.linalg.norm(left, axis=1) * np.linalg.norm(right, axis=0)
    except np.linalg.LinAlgError:
        condition = np.full(len(values), np.inf)
    order = np.argsort(-np.abs(values), kind="stable")
    return values[order].astype(complex), (size * condition)[order]


def stability_of(multipliers: NDArray[np.complex128], known: float = 1e-6) -> str:
    """"asymptotically stable", "neutral" or "unstable", to first order; within `known` of 1 it is neutral."""
    largest = float(np.abs(multipliers).max(initial=0.0))
    return "unstable" if largest > 1.0 + known else "neutral" if largest > 1.0 - known else "asymptotically stable"
