"""The layout: where each of the paper's coordinates sits in Pinocchio's (q, v), and which link hangs on which."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.model.frozen import Remade

Array = NDArray[np.float64]

BASE_COORDINATES = {"pivot": (), "ski": ("x", "y", "phi0"), "free": ("x", "y", "z")}
LIFTED = (*BASE_COORDINATES["ski"], "z")  # of a ski that may leave the snow


class State(NamedTuple):
    """Pinocchio's configuration q (nq,) and velocity v (nv,)."""

    q: Array
    v: Array


@dataclass(frozen=True)
class SegmentIndex:
    """Where a massless segment sits: a joint with indices into q and v, or a fixed length."""

    motion: str  # free | fixed | prescribed
    length: float  # [m], fixed value or start value
    joint: int = 0  # 0: no joint
    q: int = -1
    v: int = -1
    loose: bool = False  # free in the scene, but nothing hangs on it: its length is drawn, and has no equation


@dataclass(frozen=True)
class LinkIndex:
    """Where a link sits: parent link (-1 is the base), rotation joint, segments."""

    name: str
    parent: int
    point: str  # of the parent: tip | rod_start | rod_end | rod, anywhere along it
    rod_length: float
    joint: int
    q: int  # ball: 4 numbers (x, y, z, w); revolute: 1
    v: int  # ball: 3 numbers; revolute: 1
    lower: SegmentIndex
    upper: SegmentIndex
    on_rod: float = 0.0  # [m] of a place that moves with the parent's rod, from its start
    anchor: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m] of a hinge on the base, in its axes; on a link: aside


@dataclass(frozen=True)
class Coordinate:
    """One of the paper's coordinates."""

    name: str
    kind: str  # x y z phi0 phi psi xi
    link: int  # -1: the base
    segment: int = 0  # 1 lower, 2 upper, for xi


@dataclass(frozen=True)
class Layout(Remade):
    """All indices of a mechanism. `order` lists the links parents first."""

    base: str
    plane: bool
    nq: int
    nv: int
    links: tuple[LinkIndex, ...]
    order: tuple[int, ...]
    coordinates: tuple[Coordinate, ...]
    lifts: bool = False  # whether the base is a ski that may leave the snow

    @property
    def headed(self) -> bool:
        """Whether the base itself turns, by a heading phi0 about the surface's normal: a ski does."""
        return self.base == "ski"

    @property
    def on_snow(self) -> bool:
        """Whether the base is carried by snow, which pushes and holds an edge: a ski is."""
        return self.base == "ski"

    @property
    def edged(self) -> bool:
        """Whether the base is a ski whose knife edge holds always."""
        return self.on_snow and not self.lifts

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Coordinate names: `x y phi0`, then link by link `phi1 psi1 xi1_1 xi1_2`."""
        return tuple(coordinate.name for coordinate in self.coordinates)

    @cached_property
    def index(self) -> dict[str, int]:
        """Position of each coordinate in `names`."""
        return {name: i for i, name in enumerate(self.names)}

    @cached_property
    def _places(self) -> dict[tuple[str, int, int], int]:
        return {(c.kind, c.link, c.segment): at for at, c in enumerate(self.coordinates)}

    def place(self, kind: str, link: int, segment: int = 0) -> int:
        """Position of a coordinate in `names` by its kind, link and segment."""
        return self._places[kind, link, segment]

    @cached_property
    def base_size(self) -> int:
        """Velocities of the base: 3 for a ski or a free base (2 in a plane, 4 for a ski that lifts), 0 for a pivot."""
        return 0 if self.base == "pivot" else 2 if self.base == "free" and self.plane else 4 if self.lifts else 3

    def subtree(self, link: int) -> tuple[int, ...]:
        """Return the link and everything that hangs on it, parents first."""
        members = {link}
        for i in self.order:
            if self.links[i].parent in members:
                members.add(i)
        return tuple(i for i in self.order if i in members)

    def path(self, link: int) -> tuple[int, ...]:
        """Return the links from the base to this one."""
        path = []
        while link >= 0:
            path.append(link)
            link = self.links[link].parent
        return tuple(reversed(path))


def segment_of(layout: Layout, coordinate: Coordinate) -> SegmentIndex:
    """Return the segment whose length a xi coordinate is."""
    link = layout.links[coordinate.link]
    return link.lower if coordinate.segment == 1 else link.upper
