"""What legs do along a run: lengths, forces, feet, and the energy in their springs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vlmb.model.names import AXES, Quantity
from vlmb.model.reading import Postures
from vlmb.scene.legs import FORCE, LENGTH
from vlmb.simulation.phases import Stretch
from vlmb.system.contacts import ContactPoint
from vlmb.system.legs import LegPoint
from vlmb.system.slips import motion_of

Array = NDArray[np.float64]


def read_leg(
    quantity: Quantity, points: Sequence[ContactPoint], stretches: Sequence[Stretch], seen: Postures, t: Array, forces: Array
) -> Array:
    """Return length, force or foot (N,) of a leg, or the rate of its length; `forces` (N, 3) [N] are its on the mechanism."""
    name, _, what = quantity.name.partition(".")
    point = next(point for point in points if isinstance(point, LegPoint) and point.name == name)
    places, speeds = motion_of(point, seen)
    found = np.zeros(len(t))
    for stretch in stretches:
        own, footing = slice(stretch.first, stretch.last), stretch.footings[point.index]
        away = places[own] - np.array(footing.place)
        length = np.linalg.norm(away, axis=1)
        along = away / np.maximum(length, 1e-300)[:, None]
        if quantity.point not in (LENGTH, FORCE):
            found[own] = footing.place[AXES.index(what[-1])]
        elif not point.closed(footing):
            found[own] = point.law(point.leg.reach).values(t[own]) if what == LENGTH else 0.0
        elif what == FORCE:
            found[own] = np.einsum("ij,ij->i", forces[own], along)
        else:
            found[own] = np.einsum("ij,ij->i", along, speeds[own]) if quantity.rate else length
    return found


def energy_of_legs(points: Sequence[ContactPoint], stretches: Sequence[Stretch], seen: Postures) -> Array:
    """Return the energy (N,) [J] in the springs of the legs that stand."""
    found = np.zeros(stretches[-1].last if stretches else 0)
    for point in points:
        if isinstance(point, LegPoint) and point.sprung:
            places = motion_of(point, seen)[0]
            for stretch in stretches:
                own = slice(stretch.first, stretch.last)
                found[own] += point.stored(places[own], stretch.footings[point.index])
    return found


def feet_at_end(points: Sequence[ContactPoint], stretches: Sequence[Stretch]) -> list[tuple[str, float, float]]:
    """Return the legs that stand at the end of a run, with x and y [m] of their feet."""
    found = []
    for point in points:
        footing = stretches[-1].footings[point.index]
        if isinstance(point, LegPoint) and point.closed(footing):
            found.append((point.name, footing.place[0], footing.place[1]))
    return found
