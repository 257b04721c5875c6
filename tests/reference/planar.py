"""Links of variable length that move in a plane, by Lagrange's equations in numpy alone: a witness for both engines.

Every point is r = (x, z) + sum_k s_k d(psi_k), s_k a number plus lengths, d = (cos psi, sin psi). With its Jacobian J and drift
J' q', M = sum m J^T J + I e_psi e_psi^T and h = sum m J^T (drift + g e_z). Nothing here is the package's but a scene's numbers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

import vlmb

Array = np.ndarray[Any, np.dtype[np.float64]]
Way = list[tuple[int, float, bool, bool]]  # links back to the base: a number [m], whether lower and upper lengths add


class Jet(NamedTuple):
    """A point: place (2,), Jacobian (2, n), J' q' (2,)."""

    place: Array
    rows: Array
    drift: Array


class Planar:
    """The mechanism of a scene with `plane = true` and a free base without mass."""

    def __init__(self, scene: vlmb.Scene) -> None:
        self.scene, self.links = scene, {link.name: i for i, link in enumerate(scene.links)}
        carrying = {link.parent for link in scene.links if link.parent_point == "tip"}
        self.names = ["x", "z"]
        for i, link in enumerate(scene.links, 1):
            self.names.append(f"psi{i}")
            if link.lower.motion == "free":
                self.names.append(f"xi{i}_1")
            if link.upper.motion == "free" and (link.tip_mass or link.name in carrying):
                self.names.append(f"xi{i}_2")
        self.at = {name: k for k, name in enumerate(self.names)}

    def way(self, name: str, point: str | float) -> Way:
        """Return how a point of a link is reached; a number is metres from the start of the rod."""
        i = self.links[name]
        link, rod = self.scene.links[i], self.scene.links[i].rod.length
        number = point if isinstance(point, float) else {"hinge": 0.0, "rod_start": 0.0, "rod_end": rod, "tip": rod}[point]
        found = [(i, number, point != "hinge", point == "tip")]
        if link.parent == "base":
            return found
        on, parent = link.parent_point, self.scene.links[self.links[link.parent]]
        return found + self.way(link.parent, on if isinstance(on, str) else on - parent.lower.length)

    def jet(self, way: Way, q: Array, v: Array) -> Jet:
        """Return a point at (q, v)."""
        place, rows, drift = q[:2].copy(), np.zeros((2, len(q))), np.zeros(2)
        rows[0, 0] = rows[1, 1] = 1.0
        for i, number, low, up in way:
            psi = self.at[f"psi{i + 1}"]
            d, turned = np.array([np.cos(q[psi]), np.sin(q[psi])]), np.array([-np.sin(q[psi]), np.cos(q[psi])])
            s, rate = number, 0.0
            link = self.scene.links[i]
            for wanted, segment, name in ((low, link.lower, f"xi{i + 1}_1"), (up, link.upper, f"xi{i + 1}_2")):
                if wanted and name in self.at:
                    s, rate = s + q[self.at[name]], rate + v[self.at[name]]
                    rows[:, self.at[name]] += d
                elif wanted:
                    s += segment.length
            place += s * d
            rows[:, psi] += s * turned
            drift += 2.0 * rate * v[psi] * turned - s * v[psi] ** 2 * d
        return Jet(place, rows, drift)

    def bodies(self) -> list[tuple[float, float, Way, int]]:
        """List masses, inertias, ways to their centres, and links."""
        found = []
        for i, link in enumerate(self.scene.links):
            rod = link.rod
            centre = rod.length / 2 if rod.com is None else rod.com
            inertia = rod.mass * rod.length**2 / 12 if rod.inertia is None else rod.inertia
            found.append((rod.mass, inertia, self.way(link.name, float(centre)), i))
            if link.tip_mass:
                found.append((link.tip_mass, 0.0, self.way(link.name, "tip"), i))
        return found

    def equations(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return M (n, n) and h (n,) of M q'' + h = forces, gravity in h."""
        mass, bias = np.zeros((len(q), len(q))), np.zeros(len(q))
        for m, inertia, way, i in self.bodies():
            point, psi = self.jet(way, q, v), self.at[f"psi{i + 1}"]
            mass += m * point.rows.T @ point.rows
            mass[psi, psi] += inertia
            bias += m * point.rows.T @ (point.drift + np.array([0.0, self.scene.gravity]))
        return mass, bias

    def springs(self, q: Array, v: Array) -> Array:
        """Return the forces (n,) of segments and of springs between the directions of two links."""
        found = np.zeros(len(q))
        for i, link in enumerate(self.scene.links):
            for segment, name in ((link.lower, f"xi{i + 1}_1"), (link.upper, f"xi{i + 1}_2")):
                if name in self.at:
                    k = self.at[name]
                    rest = segment.length if segment.rest is None else segment.rest
                    found[k] -= segment.stiffness * (q[k] - rest) + segment.damping * v[k]
        for force in self.scene.forces:
            a, b = (self.at[f"psi{self.links[name] + 1}"] for name in force.between)
            moment = -force.stiffness * (q[b] - q[a] - force.rest) - force.damping * (v[b] - v[a])
            found[b], found[a] = found[b] + moment, found[a] - moment
        return found

    def control(self, name: str) -> Array:
        """Return what 1 N or 1 N m of a control does (n,): F8_1 on a length, T_name in a hinge."""
        found = np.zeros(len(self.names))
        if name.startswith("F"):
            found[self.at[f"xi{name[1:]}"]] = 1.0
            return found
        i = self.links[name[2:]]
        found[self.at[f"psi{i + 1}"]] = 1.0
        parent = self.scene.links[i].parent
        if parent != "base":
            found[self.at[f"psi{self.links[parent] + 1}"]] -= 1.0
        return found
