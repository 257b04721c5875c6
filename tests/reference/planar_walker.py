"""Equations of the walker of figure 3 by hand: point masses and rods in a plane, numpy alone.

Coordinates: x, z of the hip, then elevation of the trunk and length of its neck, elevation and lower length of each leg, and
elevations of the arms. Every mass has a place r, its Jacobian J and J' c'; rods turn besides:
M = sum m J^T J + I, h = sum m J^T (J' c' + g).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ORDER = ("x", "z", "psi1", "xi1_2", "psi2", "xi2_2", "psi3", "xi3_2", "psi4", "psi5")
AT = {name: k for k, name in enumerate(ORDER)}


class Place(NamedTuple):
    """A point: Jacobian (2, N) and acceleration (2,) where c'' = 0."""

    jacobian: Array
    drift: Array


class Walker(NamedTuple):
    """Mass matrix, velocity products with gravity, rows and drifts of both feet (z, x)."""

    mass: Array
    bias: Array
    feet: dict[str, Place]


def along(start: Place, c: Array, rates: Array, angle: str, reach: float, length: str | None = None) -> Place:
    """Return the point at a distance from another one along a link, whose last part may be a coordinate."""
    k = AT[angle]
    d, e = np.array([np.cos(c[k]), np.sin(c[k])]), np.array([-np.sin(c[k]), np.cos(c[k])])
    jacobian, drift = start.jacobian.copy(), start.drift.copy()
    growth = 0.0
    if length is not None:
        reach, growth = reach + c[AT[length]], rates[AT[length]]
        jacobian[:, AT[length]] += d
    jacobian[:, k] += reach * e
    return Place(jacobian, drift - reach * rates[k] ** 2 * d + 2.0 * growth * rates[k] * e)


def walker(scene: Any, c: Array, rates: Array) -> Walker:
    """Return the equations of a scene's walker at a posture."""
    mass, bias, gravity = np.zeros((len(c), len(c))), np.zeros(len(c)), np.array([0.0, scene.gravity])

    def add(m: float, place: Place) -> None:
        nonlocal mass, bias
        mass = mass + m * place.jacobian.T @ place.jacobian
        bias = bias + m * place.jacobian.T @ (place.drift + gravity)

    def rod(link: Any, start: Place, angle: str) -> None:
        com = link.rod.length / 2 if link.rod.com is None else link.rod.com
        inertia = link.rod.mass * link.rod.length**2 / 12 if link.rod.inertia is None else link.rod.inertia
        add(link.rod.mass, along(start, c, rates, angle, com))
        mass[AT[angle], AT[angle]] += inertia

    hip = Place(np.eye(len(c))[:2], np.zeros(2))
    add(scene.base.mass, hip)
    trunk, left, right, *arms = scene.links
    rod(trunk, hip, "psi1")
    add(trunk.tip_mass, along(hip, c, rates, "psi1", trunk.rod.length, "xi1_2"))
    feet = {}
    for name, link, angle, length in (("left", left, "psi2", "xi2_2"), ("right", right, "psi3", "xi3_2")):
        rod(link, hip, angle)
        tip = along(hip, c, rates, angle, link.rod.length, length)
        add(link.tip_mass, tip)
        feet[name] = Place(tip.jacobian[::-1], tip.drift[::-1])
    shoulder = along(hip, c, rates, "psi1", trunk.rod.length)
    for link, angle in zip(arms, ("psi4", "psi5"), strict=True):
        rod(link, shoulder, angle)
    return Walker(mass, bias, feet)


def forces_of(scene: Any, c: Array, rates: Array, controls: dict[str, float]) -> Array:
    """Return generalized forces of controls, and of the neck's spring and damper."""
    found, neck = np.zeros(len(c)), scene.links[0].upper
    rest = neck.length if neck.rest is None else neck.rest
    found[AT["xi1_2"]] -= neck.stiffness * (c[AT["xi1_2"]] - rest) + neck.damping * rates[AT["xi1_2"]]
    found[AT["xi2_2"]] += controls["F2_2"]
    found[AT["xi3_2"]] += controls["F3_2"]
    for name, angle in (("left_leg", "psi2"), ("right_leg", "psi3"), ("left_arm", "psi4"), ("right_arm", "psi5")):
        found[AT[angle]] += controls[f"T_{name}"]
        found[AT["psi1"]] -= controls[f"T_{name}"]
    return found
