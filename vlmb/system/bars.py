"""The links of a chain as bars between two hinges: their constants, where they sit in the state, and their energies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vlmb.model.coordinates import kinematics
from vlmb.model.mechanism import Mechanism
from vlmb.system.springs import free_segments

Array = NDArray[np.float64]

HEAVY = 1e30  # [kg] inertia of what cannot be accelerated; its effect on the rest is below rounding
FIRM = 1e3  # what a constraint counts beside the largest mass, so that elimination goes by it


class Bars:
    """Constants of n links in a chain. Pairs (2, n) are of the lower and the upper side of links.

    A last link without an upper joint is one body with its tip, and ends at its radius of gyration beyond its centre of mass.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        links, places, base = mechanism.scene.links, mechanism.layout.links, mechanism.scene.base
        count = len(links)
        free = np.array([[at.lower.joint > 0 for at in places], [at.upper.joint > 0 for at in places]])
        self.fixed = np.array([[at.lower.length for at in places], [at.upper.length for at in places]])
        self.mass = np.array([link.rod.mass for link in links])
        self.inertia = np.array([link.rod.transverse_inertia for link in links])
        centre, tips = np.array([link.rod.centre for link in links]), np.array([link.tip_mass for link in links])
        self.offsets = np.zeros((2, 2, count))  # of lengths: from segments to the rod's centre; of rates: none
        self.offsets[0] = centre, [link.rod.length for link in links] - centre
        if not free[1, -1]:
            end = links[-1].rod.length + self.fixed[1, -1]
            whole = self.mass[-1] + tips[-1]
            at = (self.mass[-1] * centre[-1] + tips[-1] * end) / whole
            self.inertia[-1] += self.mass[-1] * (centre[-1] - at) ** 2 + tips[-1] * (end - at) ** 2
            self.mass[-1], tips[-1] = whole, 0.0
            self.offsets[0, :, -1], self.fixed[1, -1] = (at, np.sqrt(self.inertia[-1] / whole)), 0.0
        lower, upper = ~free[0], ~free[1] & free[0]  # with which hinge the rod moves along the link
        self.with_lower, self.with_upper = lower.astype(float), upper.astype(float)
        self.along = np.array([lower * self.mass, upper * self.mass])
        self.lightness = 1.0 / np.where(free.all(axis=0), self.mass, np.inf)  # of rods between two springs
        self.handed_on, self.hands_on = 1.0 - free, not free.all()  # by a fixed segment: the force of the other
        self.rigid = np.logical_not(free.any(axis=0))
        self.rigid[-1] = False  # its end goes with its rod, without a force
        self.masses = np.zeros((3, count + 1))  # in the hinges: of points, along a link also of the rod fixed to it
        self.masses[:, 1:] += tips
        self.masses[0, 1:] += self.along[1]
        if not free[:, -1].any():
            self.masses[0, -1] = 1.0  # any
        if mechanism.layout.plane:
            self.masses[1] = HEAVY
        self.masses[:, 0] += {"pivot": (HEAVY, HEAVY, HEAVY), "ski": (base.mass, HEAVY, HEAVY)}.get(base.kind, base.mass)
        self.firm = FIRM * max(self.mass.max(), tips.max(), base.mass)
        self.tied = -self.firm * self.rigid
        self.lever = base.mass * base.com_offset  # of a ski
        self.yielding = self.lever / (base.inertia + self.lever * base.com_offset) if base.kind == "ski" else 0.0
        self._find(mechanism)

    def _find(self, mechanism: Mechanism) -> None:
        """Where lengths, their rates, spins (n + 1, 3) and turns of hinges sit in `state`, and velocities in what is found."""
        layout, count = mechanism.layout, len(self.mass)
        zero = layout.nq + layout.nv
        self.state = np.concatenate([np.zeros(zero + 1), self.fixed.ravel()])  # q, v, 0, fixed lengths
        lengths, rates = zero + 1 + np.arange(2 * count).reshape(2, -1), np.full((2, count), zero)
        spins = np.full((count + 1, 3), zero)
        found = np.arange(5 * count + 6)  # balls and the yaw, lengths, base
        balls, segments, base = found[: 3 * count + 3].reshape(3, -1), found[3 * count + 3 : -3].reshape(2, -1), found[-3:]
        self.sinks, size = np.zeros(layout.nv, dtype=np.intp), layout.base_size
        self.sinks[:size] = base[[0, 2]] if size == 2 else base[:size]
        if layout.base == "ski":
            spins[0, 2] = layout.nq + 2
        axes = [1] if layout.plane else [0, 1, 2]
        for i, place in enumerate(layout.links):
            turning = np.arange(place.v, place.v + len(axes))
            spins[i + 1, axes], self.sinks[turning] = layout.nq + turning, balls[axes, i + 1]
            for side, at in enumerate((place.lower, place.upper)):
                if at.joint:
                    lengths[side, i], rates[side, i], self.sinks[at.v] = at.q, layout.nq + at.v, segments[side, i]
        turns = np.array([place.q for place in layout.links])[:, None] + np.arange(1 if layout.plane else 4)
        self.sources = np.concatenate([part.ravel() for part in (lengths, rates, spins, turns.T)])
        self.springs, self.preload = np.zeros((2, 2, count)), np.zeros((2, count))  # stiffness and damping; force at length 0
        for segment, at in free_segments(mechanism):
            here = lengths == at.q
            self.springs[0, here], self.springs[1, here] = segment.stiffness, segment.damping
            self.preload[here] = segment.stiffness * segment.rest_length


def chain_energies(mechanism: Mechanism, q: Array, v: Array) -> tuple[Array, Array]:
    """Kinetic and potential energy (N,) [J] of a chain at states q (N, nq), v (N, nv), from the points of its links."""
    scene, layout, motion = mechanism.scene, mechanism.layout, kinematics(mechanism.layout, q, v)
    d, rate = motion.directions, motion.direction_rates
    gravity, base = np.array(scene.surface_gravity), scene.base
    at, velocity = np.zeros((len(q), 3)), np.zeros((len(q), 3))
    kinetic, potential = np.zeros(len(q)), np.zeros(len(q))
    if layout.base == "free":
        axes = [0, 2] if layout.plane else [0, 1, 2]
        at[:, axes], velocity[:, axes] = q[:, : layout.base_size], v[:, : layout.base_size]
    elif layout.base == "ski":
        ahead = np.stack([q[:, 2], q[:, 3], np.zeros(len(q))], axis=1)
        left = np.stack([-q[:, 3], q[:, 2], np.zeros(len(q))], axis=1)
        at[:, :2], velocity = q[:, :2], v[:, :1] * ahead + v[:, 1:2] * left
        kinetic += 0.5 * base.inertia * v[:, 2] ** 2

    def add(mass: float, place: Array, speed: Array) -> None:
        nonlocal kinetic, potential
        kinetic, potential = kinetic + 0.5 * mass * (speed**2).sum(axis=1), potential - mass * place @ gravity

    if layout.base == "ski":
        add(base.mass, at + base.com_offset * ahead, velocity + base.com_offset * v[:, 2:3] * left)
    elif base.mass:
        add(base.mass, at, velocity)
    for i, (link, entry) in enumerate(zip(scene.links, layout.links, strict=True)):
        (lower, lower_rate), (upper, upper_rate) = (
            (q[:, [side.q]], v[:, [side.v]]) if side.joint else (side.length, 0.0) for side in (entry.lower, entry.upper)
        )
        centre = lower + link.rod.centre
        add(link.rod.mass, at + centre * d[:, i], velocity + lower_rate * d[:, i] + centre * rate[:, i])
        kinetic += 0.5 * link.rod.transverse_inertia * (rate[:, i] ** 2).sum(axis=1)
        whole = lower + link.rod.length + upper
        at, velocity = at + whole * d[:, i], velocity + (lower_rate + upper_rate) * d[:, i] + whole * rate[:, i]
        add(link.tip_mass, at, velocity)
    return kinetic, potential
