"""Observables: every name an equation may use, as a function of few variables whose rates are linear in v.

Variables b: x y z, phi0, phi_i, psi_i, xi, and direction components d_i. For each: its value, its rate b' = L_b v, and its
drift, the second derivative at vdot = 0, so that b'' = L_b vdot + drift. Points and lengths are sums of these.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vlmb.coordinates import POLE, Coordinate, Layout, read_angles, segment_of
from vlmb.errors import SingularError
from vlmb.frames import LinkFrames
from vlmb.mechanism import POINTS, Mechanism

if TYPE_CHECKING:
    import sympy

Array = NDArray[np.float64]
AXES = "xyz"


@dataclass(frozen=True)
class Variable:
    """One variable: a coordinate, or the component `axis` of a link's direction (kind "d"); `speed` has a rate alone."""

    name: str
    kind: str  # x y z phi0 phi psi xi d speed
    link: int = -1
    at: int = -1  # q index of x y z xi; axis of d
    v: int = -1


def variables(layout: Layout) -> dict[str, Variable]:
    """List the variables by name: coordinates, then d_i components (`legs.direction.x`), then speed."""
    found: dict[str, Variable] = {}
    for position, coordinate in enumerate(layout.coordinates):
        found[coordinate.name] = _variable(layout, coordinate, position)
    if not layout.plane:
        for i, link in enumerate(layout.links):
            for axis in range(3):
                name = f"{link.name}.direction.{AXES[axis]}"
                found[name] = Variable(name, "d", i, axis)
    if layout.base == "ski":
        found["speed"] = Variable("speed", "speed", v=0)
    return found


def _variable(layout: Layout, coordinate: Coordinate, position: int) -> Variable:
    if coordinate.kind == "xi":
        segment = segment_of(layout, coordinate)
        return Variable(coordinate.name, "xi", coordinate.link, segment.q, segment.v)
    if coordinate.link < 0:
        return Variable(coordinate.name, coordinate.kind, -1, position, position)
    return Variable(coordinate.name, coordinate.kind, coordinate.link)


def allowed_names(mechanism: Mechanism) -> list[str]:
    """Every name an equation of this scene may use."""
    layout = mechanism.layout
    names = ["t", *mechanism.scene.parameters, *layout.names, *(f"{name}_dot" for name in layout.names)]
    if layout.base == "ski":
        names.append("speed")
    for link in layout.links:
        names.append(f"{link.name}.length")
        names += [f"{link.name}.{what}.{axis}" for what in ("direction", *POINTS) for axis in AXES]
    return names


class Symbols:
    """Sympy symbols of the variables and their rates, and the expressions of composed names."""

    def __init__(self, mechanism: Mechanism) -> None:
        import sympy

        self.sympy: Any = sympy
        self.mechanism, self.layout = mechanism, mechanism.layout
        self.variables = variables(mechanism.layout)
        self.value = {name: sympy.Symbol(f"b{k}", real=True) for k, name in enumerate(self.variables)}
        self.rate = {name: sympy.Symbol(f"r{k}", real=True) for k, name in enumerate(self.variables)}
        self.time = sympy.Symbol("t", real=True)

    def table(self, names: Sequence[str]) -> dict[str, sympy.Expr]:
        """Return the sympy expression of each name."""
        return {name: self.expression(name) for name in names}

    def expression(self, name: str) -> Any:
        """Expression of one allowed name."""
        if name == "t":
            return self.time
        if name in self.mechanism.scene.parameters:
            return self.sympy.Float(self.mechanism.scene.parameters[name])
        if name == "speed":
            return self.rate["speed"]
        if name in self.value:
            return self.value[name]
        if name.removesuffix("_dot") in self.value:
            return self.rate[name.removesuffix("_dot")]
        link, _, rest = name.partition(".")
        i = [entry.name for entry in self.layout.links].index(link)
        if rest == "length":
            return self._distance(i, "tip")
        what, _, axis = rest.partition(".")
        component = AXES.index(axis)
        if what == "direction":
            return self.direction(i)[component]
        return self._point(i, what)[component]

    def direction(self, i: int) -> list[Any]:
        """d_i as expressions; in a plane (cos psi h, sin psi) with the heading h."""
        if not self.layout.plane:
            return [self.value[f"{self.layout.links[i].name}.direction.{axis}"] for axis in AXES]
        psi, sympy = self.value[f"psi{i + 1}"], self.sympy
        heading = self.value["phi0"] if self.layout.base == "ski" else sympy.Integer(0)
        return [sympy.cos(psi) * sympy.cos(heading), sympy.cos(psi) * sympy.sin(heading), sympy.sin(psi)]

    def _distance(self, i: int, point: str) -> Any:
        link = self.layout.links[i]
        lower = self.value[f"xi{i + 1}_1"] if link.lower.joint else self.sympy.Float(link.lower.length)
        upper = self.value[f"xi{i + 1}_2"] if link.upper.joint else self.sympy.Float(link.upper.length)
        end = lower + self.sympy.Float(link.rod_length)
        return {"hinge": self.sympy.Integer(0), "rod_start": lower, "rod_end": end, "tip": end + upper}[point]

    def _point(self, i: int, point: str) -> list[Any]:
        base = [self.value.get(axis, self.sympy.Integer(0)) for axis in AXES]
        path = self.layout.path(i)
        ends = [self.layout.links[k].point for k in path[1:]] + [point]
        for k, end in zip(path, ends, strict=True):
            distance = self._distance(k, end)
            base = [b + distance * d for b, d in zip(base, self.direction(k), strict=True)]
        return base


class Motion:
    """Values, rates, drifts and the map L (b' = L v) of chosen variables, at the configuration of the frames."""

    def __init__(self, mechanism: Mechanism, frames: LinkFrames, names: Sequence[str]) -> None:
        layout = mechanism.layout
        known = variables(layout)
        names = sorted(names, key=lambda name: not layout.plane and known[name].kind in ("phi", "psi", "d"))
        self.layout, self.frames, self.names = layout, frames, tuple(names)  # those that turn with a link come last
        self.size = len(self.names)
        chosen = [known[name] for name in names]
        plain = [(k, b) for k, b in enumerate(chosen) if b.kind not in ("phi", "psi", "d") or layout.plane]
        straight = ("xi",) if layout.base == "ski" else ("xi", "x", "y", "z")  # read off q and v as they are
        self.lengths = [(k, b.at, b.v) for k, b in plain if b.kind in straight]
        self.others = [(k, b) for k, b in plain if b.kind not in straight]
        turning = [(k, b) for k, b in enumerate(chosen) if b.kind in ("phi", "psi", "d") and not layout.plane]
        self.links = {i: _LinkPlaces(layout, i, turning) for i in sorted({b.link for _, b in turning})}
        self.chain = [i for i in layout.order if any(i in layout.path(k) for k in self.links)]
        self.supports = frames.supports[self.chain]
        self.masks = np.array([frames.supports[b.link] for _, b in turning]).reshape(-1, layout.nv)
        self.map = np.zeros((self.size, layout.nv))
        self.turning = self.map[self.size - len(turning) :]
        for k, b in plain:
            if b.v >= 0 and not (layout.base == "ski" and b.kind in "xy"):
                self.map[k, b.v] = 1.0
            elif b.kind == "psi":
                for i in layout.path(b.link):
                    self.map[k, layout.links[i].v] = 1.0

    def evaluate(self, q: Array, v: Array, reference: Sequence[float]) -> tuple[list[float], list[float], list[float]]:
        """Return values, rates and drifts (lists of self.size); `self.map` is L. Angles near `reference`."""
        qs, vs = q.tolist(), v.tolist()
        values, rates, drifts = [0.0] * self.size, [0.0] * self.size, [0.0] * self.size
        for k, at, to in self.lengths:
            values[k], rates[k] = qs[at], vs[to]
        for k, b in self.others:
            self._base(k, b, qs, vs, reference, values, rates, drifts)
        if self.chain:
            moments: list[Sequence[float]] = [()] * len(self.turning)
            omegas = (self.supports * v).dot(self.frames.angular.T).tolist()
            self._turn(omegas, vs, reference, values, rates, drifts, moments)
            np.multiply(np.array(moments).dot(self.frames.angular), self.masks, self.turning)
        return values, rates, drifts

    def _base(self, k: int, b: Variable, qs: list[float], vs: list[float], reference: Sequence[float],
               values: list[float], rates: list[float], drifts: list[float]) -> None:  # fmt: skip
        kind = b.kind
        if kind == "phi0":
            near = reference[2]
            values[k] = near + math.remainder(math.atan2(qs[3], qs[2]) - near, math.tau)
            rates[k] = vs[2]
        elif kind == "speed":
            rates[k] = vs[0]
        elif kind == "psi":  # in a plane
            for i in self.layout.path(b.link):
                values[k] += qs[self.layout.links[i].q]
                rates[k] += vs[self.layout.links[i].v]
        else:  # x and y of a ski
            c, s, forward, left, yaw = qs[2], qs[3], vs[0], vs[1], vs[2]
            x_rate, y_rate, row = c * forward - s * left, s * forward + c * left, self.map[k]
            values[k] = qs[b.at]
            if kind == "x":
                row[0], row[1], rates[k], drifts[k] = c, -s, x_rate, -yaw * y_rate
            else:
                row[0], row[1], rates[k], drifts[k] = s, c, y_rate, yaw * x_rate

    def _turn(self, omegas: list[list[float]], vs: list[float], reference: Sequence[float],
              values: list[float], rates: list[float], drifts: list[float], moments: list[Sequence[float]]) -> None:  # fmt: skip
        """Fill in what turns with a link: d' = omega x d, d'' at vdot = 0 is omega' x d + omega x d'.

        omega' = -sum over the path of omega_k x omega_parent; N_b in `moments` is the torque conjugate to b.
        """
        yaw = vs[2] if self.layout.base == "ski" else 0.0
        turns: dict[int, tuple[float, ...]] = {-1: (0.0, 0.0, yaw, 0.0, 0.0, 0.0)}
        for (wx, wy, wz), i in zip(omegas, self.chain, strict=True):
            px, py, pz, ax, ay, az = turns[self.layout.links[i].parent]
            ax, ay, az = ax - wy * pz + wz * py, ay - wz * px + wx * pz, az - wx * py + wy * px
            turns[i] = (wx, wy, wz, ax, ay, az)
            places = self.links.get(i)
            if places is None:
                continue
            x, y, z = self.frames.direction(i)
            rx, ry, rz = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
            sx = ay * z - az * y + wy * rz - wz * ry
            sy = az * x - ax * z + wz * rx - wx * rz
            sz = ax * y - ay * x + wx * ry - wy * rx
            for k, row, axis in places.direction:
                values[k], rates[k], drifts[k] = (x, y, z)[axis], (rx, ry, rz)[axis], (sx, sy, sz)[axis]
                moments[row] = ((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0))[axis]  # d x e
            if not places.angles:
                continue
            at = places.at
            phi, psi = read_angles((x, y, z), (reference[at - 1], reference[at]))
            sin_phi, cos_phi, sin_psi, cos_psi = math.sin(phi), math.cos(phi), math.sin(psi), math.cos(psi)
            lateral = cos_phi * ry - sin_phi * rx
            up = cos_psi * rz - sin_psi * (cos_phi * rx + sin_phi * ry)
            pole = abs(cos_psi) < POLE
            for k, row, azimuth in places.angles:
                if not azimuth:
                    bend = 0.0 if pole else lateral * lateral * sin_psi / cos_psi
                    values[k], rates[k] = psi, up
                    drifts[k] = cos_psi * sz - sin_psi * (cos_phi * sx + sin_phi * sy) - bend
                    moments[row] = (sin_phi, -cos_phi, 0.0)
                elif pole:
                    raise self._no_azimuth(i)
                else:
                    rate, steep = lateral / cos_psi, -sin_psi / cos_psi
                    values[k], rates[k] = phi, rate
                    drifts[k] = (cos_phi * sy - sin_phi * sx + 2.0 * rate * up * sin_psi) / cos_psi
                    moments[row] = (steep * cos_phi, steep * sin_phi, 1.0)

    def _no_azimuth(self, i: int) -> SingularError:
        name = self.layout.links[i].name
        return SingularError(
            f"phi{i + 1} is used by an equation or a control while link {name!r} stands at the pole (|cos psi| < {POLE:g}), "
            f"where it has no azimuth; write the equation with {name}.direction.x and .y, and use a hinge torque T_{name}"
        )


class _LinkPlaces:
    """Where the variables of one link stand: (variable, row of moments, axis) and (variable, row, is azimuth)."""

    def __init__(self, layout: Layout, link: int, turning: Sequence[tuple[int, Variable]]) -> None:
        mine = [(k, row, b) for row, (k, b) in enumerate(turning) if b.link == link]
        self.direction = [(k, row, b.at) for k, row, b in mine if b.kind == "d"]
        self.angles = [(k, row, b.kind == "phi") for k, row, b in mine if b.kind != "d"]
        self.at = layout.index[f"psi{link + 1}"]
