"""Vectors of space as tuples, which the compiler keeps in registers."""

from __future__ import annotations

from vlmb.core.jit import kernel

Vector = tuple[float, float, float]


@kernel(inline=True)
def dot(a: Vector, b: Vector) -> float:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel(inline=True)
def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel(inline=True)
def scaled(k: float, a: Vector) -> Vector:
    """Return k a."""
    return k * a[0], k * a[1], k * a[2]


@kernel(inline=True)
def plus(a: Vector, k: float, b: Vector) -> Vector:
    """Return a + k b."""
    return a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]


@kernel(inline=True)
def across(a: Vector, d: Vector) -> Vector:
    """Return the part of a across the unit vector d."""
    return plus(a, -dot(a, d), d)
