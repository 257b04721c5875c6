"""What every peer is given: a chain of spring links on a pivot or a ski, read from a scene, as plain numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.scene.scene import Scene
from vlmb.scene.tables import Link, Segment

Array = NDArray[np.float64]


class UnsupportedError(Exception):
    """A peer, or this reader, cannot express the scene; the sentence goes into the table."""


class Outcome(NamedTuple):
    """End of one run: points (1 + n, 3) [m] = the ski's point A (or the pivot) and the tips, and what it took."""

    points: Array
    evaluations: int | None
    steps: int | None


Run = Callable[[float], Outcome]  # of a tolerance, or of a step [s] for methods with fixed steps


@dataclass(frozen=True)
class Leg:
    """A massless segment [m, N/m]; without stiffness and not free: a fixed length."""

    free: bool
    stiffness: float
    rest: float
    start: float
    rate: float


@dataclass(frozen=True)
class ChainLink:
    """A rod between two legs, and where it starts."""

    length: float
    mass: float
    com: float
    inertia: float
    tip_mass: float
    lower: Leg
    upper: Leg
    phi: float
    psi: float
    phi_dot: float
    psi_dot: float

    def direction(self) -> tuple[Array, Array, Array]:
        """d, u_phi and u_psi (3,) at the start."""
        cf, sf, cp, sp = math.cos(self.phi), math.sin(self.phi), math.cos(self.psi), math.sin(self.psi)
        return np.array([cf * cp, sf * cp, sp]), np.array([-sf, cf, 0.0]), np.array([-cf * sp, -sf * sp, cp])

    def rotation(self) -> Array:
        """R (3, 3) with d as its first column, then u_phi and u_psi: no roll."""
        return np.column_stack(self.direction())

    def omega(self) -> Array:
        """Absolute angular velocity (3,) [rad/s] without spin: phidot cos(psi) u_psi - psidot u_phi."""
        _, across, up = self.direction()
        return self.phi_dot * math.cos(self.psi) * up - self.psi_dot * across


@dataclass(frozen=True)
class Chain:
    """A serial chain on a pivot or a ski."""

    on_ski: bool
    ski_mass: float
    ski_inertia: float
    com_offset: float
    gravity: tuple[float, float, float]
    x: float
    y: float
    phi0: float
    phi0_dot: float
    speed: float
    links: tuple[ChainLink, ...]


def read_chain(scene: dict[str, Any]) -> Chain:
    """Read a scene; raise UnsupportedError for anything but undamped springs in a serial chain."""
    read = Scene.from_dict(scene)
    plain = not (read.constraints or read.forces or read.programme or read.plane)
    if not plain or read.base.kind == "free":
        raise UnsupportedError("written for chains of springs on a pivot or a ski: no programme, constraints or applied forces")
    for number, link in enumerate(read.links):
        before = read.links[number - 1].name or f"link{number}" if number else "base"
        if link.parent not in ("", before) or link.parent_point != "tip":
            raise UnsupportedError("written for serial chains")
    start = dict(read.start)
    names = {"x", "y", "phi0", "phi0_dot", "speed"}
    links = []
    for i, link in enumerate(read.links, start=1):
        names |= {f"{name}{i}{end}" for name in ("phi", "psi") for end in ("", "_dot")}
        names |= {f"xi{i}_{which}{end}" for which in (1, 2) for end in ("", "_dot")}
        hangs = i < len(read.links) or link.tip_mass > 0.0
        links.append(_link(link, i, start, hangs))
    if unknown := set(start) - names:
        raise UnsupportedError(f"start values {', '.join(sorted(unknown))} are not read")
    pull = read.gravity
    return Chain(
        read.base.kind == "ski", read.base.mass, read.base.inertia, read.base.com_offset,
        (pull * math.sin(read.slope), 0.0, -pull * math.cos(read.slope)),
        *(start.get(name, 0.0) for name in ("x", "y", "phi0", "phi0_dot", "speed")),
        tuple(links),
    )  # fmt: skip


def two_angles(chain: Chain) -> list[tuple[float, float, float, float]]:
    """Start (a, b, adot, bdot) of each link for joints of two angles: R_i = R_(i-1) Rz(a) Ry(-b), which may roll.

    A rod without axial inertia does not feel its roll, so the directions move as in the paper.
    """
    before, spin = np.eye(3), np.zeros(3)
    if chain.on_ski:
        c, s = math.cos(chain.phi0), math.sin(chain.phi0)
        before, spin = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([0.0, 0.0, chain.phi0_dot])
    found = []
    for link in chain.links:
        d = link.direction()[0]
        x, y, z = before.T @ d
        x_dot, y_dot, z_dot = before.T @ np.cross(link.omega() - spin, d)
        across = math.hypot(x, y)
        a, b = math.atan2(y, x), math.atan2(z, across)
        a_dot, b_dot = (x * y_dot - y * x_dot) / across**2, z_dot / across
        found.append((a, b, a_dot, b_dot))
        ca, sa, cb, sb = math.cos(a), math.sin(a), math.cos(b), math.sin(b)
        spin = spin + before @ np.array([b_dot * sa, -b_dot * ca, a_dot])
        before = before @ np.array([[ca * cb, -sa, -ca * sb], [sa * cb, ca, -sa * sb], [sb, 0.0, cb]])
    return found


def _link(link: Link, i: int, start: dict[str, float], hangs: bool) -> ChainLink:
    angles = (start.get(f"phi{i}", 0.0), start.get(f"psi{i}", math.pi / 2), start.get(f"phi{i}_dot", 0.0))
    lower, upper = _leg(link.lower, f"xi{i}_1", start, True), _leg(link.upper, f"xi{i}_2", start, hangs)
    return ChainLink(
        link.rod.length, link.rod.mass, link.rod.centre, link.rod.transverse_inertia, link.tip_mass, lower, upper,
        *angles, start.get(f"psi{i}_dot", 0.0),
    )  # fmt: skip


def _leg(segment: Segment, name: str, start: dict[str, float], hangs: bool) -> Leg:
    if segment.motion == "prescribed" or segment.damping:
        raise UnsupportedError("written for undamped springs; no prescribed lengths")
    length = start.get(name, segment.length or 0.0)
    rest = (segment.length if segment.rest is None else segment.rest) or 0.0
    free = segment.motion == "free" and hangs
    return Leg(free, segment.stiffness, rest, length, start.get(f"{name}_dot", 0.0))
