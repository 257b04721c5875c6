"""The state of the core from Pinocchio's (q, v), a vocabulary for equations, and what today's engine says of the same rows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vlmb.core import opcodes, quantities, tree
from vlmb.core.rows import OF_ANGLES, OF_POSITIONS, OF_VELOCITIES
from vlmb.model.coordinates import kinematics
from vlmb.model.mechanism import Mechanism
from vlmb.model.tape import CompiledTape, Leaf

AXES = "xyz"


def make_tree(mechanism: Mechanism) -> tuple[tree.Tree, np.ndarray]:
    """A ski free to slip sideways, so that all of Pinocchio's velocities have their like; and the given lengths."""
    layout, scene = mechanism.layout, mechanism.scene
    n = len(layout.links)
    assert layout.order == tuple(range(n)) and layout.base == "ski"
    link, real, given = np.zeros((n, 8), np.int64), np.zeros((n, 16)), np.zeros((n, 6))
    p = v = 3
    for i, (index, text) in enumerate(zip(layout.links, scene.links, strict=True)):
        free = [segment.joint > 0 for segment in (index.lower, index.upper)]
        link[i, :6] = index.parent, int(index.point != "tip"), p, v, *free
        real[i, :5] = index.rod_length, text.rod.mass, text.rod.com or 0.0, text.rod.inertia or 0.0, text.tip_mass
        given[i, 0], given[i, 3] = index.lower.length or 0.0, index.upper.length or 0.0
        p, v = p + 3 + sum(free), v + 3 + sum(free)
    base = scene.base
    constants = np.array([base.mass, base.inertia or 0.0, getattr(base, "com_offset", 0.0) or 0.0, 0.0, 0.0, -9.81])
    return tree.Tree(np.array([tree.SLIDING, p, v, n, 0, 0], np.int64), constants, link, real), given


class State(NamedTuple):
    y: np.ndarray
    v: np.ndarray  # the core's velocities
    change: np.ndarray  # (nv, Pinocchio's nv): v = change . Pinocchio's
    drift: np.ndarray  # v' where Pinocchio's v does not change


def make_state(mechanism: Mechanism, shape: tree.Tree, q: np.ndarray, v: np.ndarray) -> State:
    layout, nv = mechanism.layout, int(shape.shape[2])
    change, drift = np.zeros((nv, layout.nv)), np.zeros(nv)
    heading = np.arctan2(q[3], q[2])
    change[:3, :3] = np.eye(3)
    found = kinematics(layout, q, v)
    growth = {-1: np.zeros(3)}
    omega = {-1: np.array([0.0, 0.0, v[2]])}
    y = [q[0], q[1], heading]
    for i, index in enumerate(layout.links):
        at, d = int(shape.link[i, tree.AT_V]), found.directions[i]
        for k in range(layout.nv):
            unit = np.zeros(layout.nv)
            unit[k] = 1.0
            change[at : at + 3, k] = kinematics(layout, q, unit).direction_rates[i]
        omega[i] = found.omegas[i]
        growth[i] = growth[index.parent] + np.cross(omega[index.parent], omega[i])
        drift[at : at + 3] = np.cross(growth[i], d) + np.cross(omega[i], np.cross(omega[i], d))
        y += list(d)
        place = at + 3
        for segment in (index.lower, index.upper):
            if segment.joint:
                y.append(q[segment.q])
                change[place, segment.v] = 1.0
                place += 1
    rates = change @ v
    return State(np.array([*y, *rates]), rates, change, drift)


class Vocabulary:
    """Names -> quantities, as they are met."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism, self.layout = mechanism, mechanism.layout
        self.parameters = list(mechanism.scene.parameters)
        self.known: dict[tuple[tuple[int, int, int, int], float], int] = {}
        self.links = [link.name for link in self.layout.links]

    def quantity(self, kind: tuple[int, int, int, int], offset: float = 0.0) -> int:
        return self.known.setdefault((kind, offset), len(self.known))

    def __call__(self, name: str) -> Leaf:
        if name == "t":
            return Leaf(opcodes.TIME)
        if name in self.parameters:
            return Leaf(opcodes.PARAMETER, self.parameters.index(name))
        if name == "speed":
            return Leaf(opcodes.RATE, self.quantity((quantities.SPEED, 0, 0, 0)))
        plain = name.removesuffix("_dot")
        kind = opcodes.VALUE if plain == name else opcodes.RATE
        if plain in ("x", "y"):
            return Leaf(kind, self.quantity((quantities.BASE_PLACE, 0, AXES.index(plain), 0)))
        if plain == "phi0":
            return Leaf(kind, self.quantity((quantities.YAW, 0, 0, 0)), True)
        if plain.startswith("xi"):
            i, side = (int(part) for part in plain[2:].split("_"))
            return Leaf(kind, self.quantity((quantities.DISTANCE, i - 1, 0, side)))
        if plain[:3] in ("phi", "psi"):
            turn = quantities.AZIMUTH if plain[:3] == "phi" else quantities.ELEVATION
            return Leaf(kind, self.quantity((turn, int(plain[3:]) - 1, 0, 0)), True)
        link, what, *axis = plain.split(".")
        i = self.links.index(link)
        length = self.layout.links[i].rod_length
        if what == "direction":
            return Leaf(kind, self.quantity((quantities.DIRECTION, i, AXES.index(axis[0]), 0)))
        offset, along = {"hinge": (0.0, 0), "rod_start": (0.0, 1), "rod_end": (length, 1)}.get(what, (length, 3))
        if what == "length":
            return Leaf(kind, self.quantity((quantities.DISTANCE, i, 0, along), offset))
        return Leaf(kind, self.quantity((quantities.POINT, i, AXES.index(axis[0]), along), offset))

    def table(self, shape: tree.Tree) -> quantities.Quantities:
        return quantities.make_quantities(shape, [kind for kind, _ in self.known], [offset for _, offset in self.known])

    def reference(self, coordinates: dict[str, float]) -> np.ndarray:
        near = np.zeros((len(self.known), 2))
        for ((_, link, _, _), _), k in self.known.items():
            near[k] = coordinates.get(f"phi{link + 1}", 0.0), coordinates.get(f"psi{link + 1}", 0.0)
        return near


def forms(compiled: CompiledTape) -> np.ndarray:
    return np.array([OF_VELOCITIES if not row.position else OF_ANGLES if row.angle else OF_POSITIONS for row in compiled.rows])
