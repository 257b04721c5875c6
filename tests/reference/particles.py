"""Any scene as mass points whose places are written down, and its equations from them by differences with many digits.

    M = sum m J^T J,    bias = sum m J^T (r'' - g),    J = dr/dq,    r'' along q + v t + a t^2/2

A rod is two equal particles on its axis with its mass, centre and inertia; a ski two on its own. Coordinates are the paper's, by
name. Knows no joints, no velocities and none of the project's code.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import mpmath
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
BASES = {"pivot": (), "ski": ("x", "y", "phi0"), "free": ("x", "y", "z")}


class Instant(NamedTuple):
    """What the particles do at one instant."""

    mass: Array  # (P,)
    place: Array  # (P, 3)
    velocity: Array  # (P, 3)
    acceleration: Array  # (P, 3)


class Particles:
    """The particles of a scene's dict; every link has a name, a parent and a point there."""

    def __init__(self, table: Mapping[str, Any], digits: int = 40) -> None:
        self.table, self.digits = table, digits
        self.plane, self.kind = bool(table.get("plane")), table["base"]["kind"]
        self.links = {link["name"]: link for link in table["links"]}
        self.numbers = {name: i + 1 for i, name in enumerate(self.links)}
        names = [name for name in BASES[self.kind] if not (self.plane and self.kind == "free" and name == "y")]
        for name, link in self.links.items():
            i = self.numbers[name]
            names += [f"psi{i}"] if self.plane else [f"phi{i}", f"psi{i}"]
            names += [f"xi{i}_{side}" for side in (1, 2) if self._moves(link, side)]
        self.names = tuple(names)

    def _moves(self, link: Mapping[str, Any], side: int) -> bool:
        segment = link.get("lower" if side == 1 else "upper", {"motion": "fixed"})
        tip = link.get("tip_mass") or any(
            other["parent"] == link["name"] and other.get("parent_point", "tip") == "tip" for other in self.links.values()
        )
        return segment.get("motion", "free") != "fixed" and (side == 1 or bool(tip))

    def _length(self, name: str, side: int, at: Mapping[str, Any]) -> Any:
        segment = self.links[name].get("lower" if side == 1 else "upper", {"length": 0.0})
        return at.get(f"xi{self.numbers[name]}_{side}", segment.get("length"))

    def _direction(self, name: str, at: Mapping[str, Any]) -> Any:
        i = self.numbers[name]
        psi, phi = at[f"psi{i}"], (at.get("phi0", 0) if self.plane else at[f"phi{i}"])
        return np.array([mpmath.cos(phi) * mpmath.cos(psi), mpmath.sin(phi) * mpmath.cos(psi), mpmath.sin(psi)])

    def _base(self, at: Mapping[str, Any], ahead: Any = 0, left: Any = 0, up: Any = 0) -> Any:
        origin = np.array([at.get(axis, mpmath.mpf(0)) for axis in "xyz"])
        c, s = mpmath.cos(at.get("phi0", 0)), mpmath.sin(at.get("phi0", 0))
        return origin + np.array([ahead * c - left * s, ahead * s + left * c, mpmath.mpf(up)])

    def place(self, name: str, distance: Any, at: Mapping[str, Any]) -> Any:
        """Place (3,) at a distance from the hinge of a link."""
        link = self.links[name]
        if link["parent"] == "base":
            hinge = self._base(at, *link.get("anchor", (0, 0, 0)))
        else:
            parent, point = self.links[link["parent"]], link.get("parent_point", "tip")
            lower, upper = (self._length(link["parent"], side, at) for side in (1, 2))
            rod = parent["rod"]["length"]
            along = {"rod_start": lower, "rod_end": lower + rod, "tip": lower + rod + upper}.get(point, point)
            hinge = self.place(link["parent"], along, at)
        return hinge + distance * self._direction(name, at)

    def _all(self, at: Mapping[str, Any]) -> tuple[list[Any], list[Any]]:
        """Masses and places of all particles."""
        base, masses, places = self.table["base"], [], []
        if base.get("mass"):
            arm = mpmath.sqrt(mpmath.mpf(base.get("inertia", 0)) / base["mass"])
            for sign in (-1, 1):
                masses.append(mpmath.mpf(base["mass"]) / 2)
                places.append(self._base(at, base.get("com_offset", 0) + sign * arm))
        for name, link in self.links.items():
            rod, lower, upper = link["rod"], self._length(name, 1, at), self._length(name, 2, at)
            length, mass = mpmath.mpf(rod["length"]), mpmath.mpf(rod["mass"])
            if mass:
                arm = mpmath.sqrt(rod.get("inertia", mass * length**2 / 12) / mass)
                for sign in (-1, 1):
                    masses.append(mass / 2)
                    places.append(self.place(name, lower + rod.get("com", length / 2) + sign * arm, at))
            masses.append(mpmath.mpf(link.get("tip_mass", 0)))
            places.append(self.place(name, lower + length + upper, at))
        return masses, places

    def _moved(self, q: list[Any]) -> Any:
        return np.array(self._all(dict(zip(self.names, q, strict=True)))[1], dtype=object)

    @property
    def gravity(self) -> Any:
        """Gravity (3,) in the surface frame."""
        g, slope = mpmath.mpf(self.table.get("gravity", 9.81)), mpmath.mpf(self.table.get("slope", 0.0))
        return np.array([g * mpmath.sin(slope), mpmath.mpf(0), -g * mpmath.cos(slope)])

    def _read(self, values: Mapping[str, float], end: str = "") -> list[Any]:
        return [mpmath.mpf(values.get(f"{name}{end}", 0.0)) for name in self.names]

    def equations(self, coordinates: Mapping[str, float], rates: Mapping[str, float]) -> tuple[Array, Array]:
        """Mass matrix (N, N) and bias (N,) in all coordinates."""
        with mpmath.workdps(self.digits):
            step = mpmath.mpf(10) ** (-self.digits // 3)
            q, v = self._read(coordinates), self._read(rates, "_dot")
            columns = []
            for k in range(len(q)):
                ahead, behind = list(q), list(q)
                ahead[k], behind[k] = q[k] + step, q[k] - step
                columns.append((self._moved(ahead) - self._moved(behind)) / (2 * step))
            jacobian = np.array(columns, dtype=object)
            ahead, behind = ([a + sign * step * b for a, b in zip(q, v, strict=True)] for sign in (1, -1))
            load = (self._moved(ahead) - 2 * self._moved(q) + self._moved(behind)) / step**2 - self.gravity
            masses = np.array(self._all(dict(zip(self.names, q, strict=True)))[0], dtype=object)
            weighted = (jacobian * masses[:, None]).reshape(len(q), -1)
            return (weighted @ jacobian.reshape(len(q), -1).T).astype(float), (weighted @ load.reshape(-1)).astype(float)

    def instant(
        self, coordinates: Mapping[str, float], rates: Mapping[str, float], accelerations: Mapping[str, float]
    ) -> Instant:
        """Places, velocities and accelerations of the particles; accelerations by coordinate."""
        with mpmath.workdps(self.digits):
            step = mpmath.mpf(10) ** (-self.digits // 3)
            q, v, a = self._read(coordinates), self._read(rates, "_dot"), self._read(accelerations)
            ahead, behind = (
                self._moved([x + sign * step * w + step**2 * b / 2 for x, w, b in zip(q, v, a, strict=True)]) for sign in (1, -1)
            )
            here = self._moved(q)
            masses = np.array(self._all(dict(zip(self.names, q, strict=True)))[0], dtype=object)
            bend = (ahead - 2 * here + behind) / step**2
            return Instant(*(part.astype(float) for part in (masses, here, (ahead - behind) / (2 * step), bend)))
