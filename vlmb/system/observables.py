"""Observables: every name an equation may use, as a function of few variables whose rates are linear in v.

Variables b: x y z, phi0, phi_i, psi_i, xi, and direction components d_i. For each: its value, its rate b' = L_b v, and its
drift, the second derivative at vdot = 0, so that b'' = L_b vdot + drift. Points and lengths are sums of these.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SingularError
from vlmb.model.coordinates import POLE, read_angles
from vlmb.model.layout import Coordinate, Layout, segment_of
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import AXES, DOT, Names, Quantity
from vlmb.system.frames import LinkFrames

if TYPE_CHECKING:
    import sympy

Array = NDArray[np.float64]
YAW = 2  # index of the ski's yaw rate in v


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


def allowed_names(mechanism: Mechanism) -> Collection[str]:
    """Every name an equation of this scene may use."""
    return _Allowed({"t": None, **dict.fromkeys(mechanism.scene.parameters)}, mechanism.names)


class _Allowed(Collection[str]):
    """The time, the parameters, and the vocabulary of a mechanism."""

    def __init__(self, own: Mapping[str, None], names: Names) -> None:
        self.own, self.names = own, names

    def __contains__(self, name: object) -> bool:
        return name in self.own or name in self.names

    def __iter__(self) -> Iterator[str]:
        return itertools.chain(self.own, self.names)

    def __len__(self) -> int:
        return len(self.own) + len(self.names)


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
        quantity = self.mechanism.names.find(name)
        if quantity.name.removesuffix(DOT) in self.value:
            plain = quantity.name.removesuffix(DOT)
            return self.rate[plain] if quantity.rate else self.value[plain]
        value = self._composed(quantity)
        return self._rate_of(value) if quantity.rate else value

    def _composed(self, quantity: Quantity) -> Any:
        """Expression of a length, a direction, a point, or the centre of mass."""
        i, axis = quantity.link, quantity.axis
        if quantity.kind == "length":
            return self._distance(i, "tip")
        if quantity.kind == "direction":
            return self.direction(i)[axis]
        return self._point(i, quantity.point)[axis] if quantity.kind == "point" else self._centre_of_mass(axis)

    def _rate_of(self, value: Any) -> Any:
        """Rate of an expression of values: the sum of its slopes times the rates."""
        names = [name for name, symbol in self.value.items() if symbol in value.free_symbols]
        return sum((value.diff(self.value[name]) * self.rate[name] for name in names), self.sympy.Integer(0))

    def _centre_of_mass(self, axis: int) -> Any:
        scene, base = self.mechanism.scene, self.mechanism.scene.base
        total, moment = base.mass, base.mass * self._base()[axis]
        if base.mass and self.layout.base == "ski":
            heading = self.value["phi0"]
            ahead = [self.sympy.cos(heading), self.sympy.sin(heading), self.sympy.Integer(0)]
            moment += base.mass * base.com_offset * ahead[axis]
        for i, link in enumerate(scene.links):
            hinge, along = self._point(i, "hinge")[axis], self._distance(i, "rod_start") + self.sympy.Float(link.rod.centre)
            moment += link.rod.mass * (hinge + along * self.direction(i)[axis]) + link.tip_mass * self._point(i, "tip")[axis]
            total += link.rod.mass + link.tip_mass
        return moment / total

    def _base(self) -> list[Any]:
        return [self.value.get(axis, self.sympy.Integer(0)) for axis in AXES]

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

    def _anchored(self, i: int) -> list[Any]:
        """Place of the hinge of a link on the base."""
        base, anchor = self._base(), self.layout.links[i].anchor
        if not any(anchor):
            return base
        (ahead, left, up), heading = anchor, self.value.get("phi0", self.sympy.Integer(0))
        cosine, sine = self.sympy.cos(heading), self.sympy.sin(heading)
        return [base[0] + ahead * cosine - left * sine, base[1] + ahead * sine + left * cosine, base[2] + up]

    def _point(self, i: int, point: str) -> list[Any]:
        base = self._anchored(self.layout.path(i)[0])
        for k, after in itertools.pairwise((*self.layout.path(i), -1)):
            on = self.layout.links[after]
            distance = self._distance(k, point if after < 0 else "tip" if on.point == "tip" else "rod_start")
            distance += on.on_rod if after >= 0 else 0
            base = [b + distance * d for b, d in zip(base, self.direction(k), strict=True)]
        return base


class Motion:
    """Straight-line code for chosen variables: b, b' = L_b v and its drift, as steps from numbers read at a state.

    `steps` holds intermediate results for `compile_scalar`, value and rate of every variable among them; `drifts` the second
    derivatives at vdot = 0. What turns with a link has a torque N_b on the link conjugate to b instead of a row of L:
    b' = N_b . omega, so that L_b = N_b . (axes of the balls on the link's path, and of the ski's yaw).
    """

    def __init__(self, symbols: Symbols, names: Sequence[str]) -> None:
        layout = symbols.layout
        self.symbols, self.layout, self.names = symbols, layout, tuple(names)
        self.steps: dict[Any, Any] = {}
        self.drifts: dict[str, Any] = {}
        self.rows: dict[str, dict[int, Any]] = {}  # L_b of what does not turn with a link, by velocity
        self.torques: dict[str, tuple[int, list[Any]]] = {}  # link and N_b of what does
        chosen = {name: symbols.variables[name] for name in names}
        turning = {name: b for name, b in chosen.items() if b.kind in ("phi", "psi", "d") and not layout.plane}
        self.chain = [i for i in layout.order if any(i in layout.path(b.link) for b in turning.values())]
        self.headed = "phi0" in chosen
        self.angled = [i for i in self.chain if {f"phi{i + 1}", f"psi{i + 1}"} & turning.keys()]
        self.azimuths = {i for i in self.angled if f"phi{i + 1}" in turning}  # those that have no azimuth at the pole
        balls = [layout.links[i].v for i in self.chain]
        first, end = min(balls, default=0), max(balls, default=-3) + 3
        self.span = slice(first, end)  # of all velocities: where the balls of the chain are
        self.places = {i: layout.links[i].v - first for i in self.chain}
        self.q, self.v = self._symbols("q", layout.nq), self._symbols("v", layout.nv)
        columns = [self._symbols(f"e{axis}", end - first) for axis in AXES]
        self.heading = self._symbols("heading", int(self.headed))
        self.angles = {i: self._symbols(f"angle{i}", 2) for i in self.angled}
        read = [angle for pair in self.angles.values() for angle in pair]
        self.arguments = [symbols.time, *self.q, *self.v, *(e for axis in columns for e in axis), *self.heading, *read]
        self.balls = {i: [[axis[at + k] for axis in columns] for k in range(3)] for i, at in self.places.items()}
        for name, b in chosen.items():
            if name not in turning:
                self._plain(name, b)
        self._turn(turning)

    def numbers(
        self, frames: LinkFrames, t: float, q: Array, v: Array, branch: Sequence[float], needed: Container[int] | None = None
    ) -> list[float]:
        """Read the arguments at a state whose frames are up to date; angles on the branch nearest to `branch`.

        Raises SingularError for an azimuth at the pole; with `needed`, of those links alone.
        """
        qs = q.tolist()
        found = [t, *qs, *v.tolist()]
        xs: list[float] = []
        if self.chain:
            xs, ys, zs = frames.angular[:, self.span].tolist()
            found += xs
            found += ys
            found += zs
        if self.headed:
            near = branch[2]
            found.append(near + math.remainder(math.atan2(qs[3], qs[2]) - near, math.tau))
        for i in self.angled:
            k, at = self.places[i], self.layout.index[f"psi{i + 1}"]
            x, y = xs[k], ys[k]
            if i in self.azimuths and x * x + y * y < POLE * POLE and (needed is None or i in needed):
                raise self._no_azimuth(i)
            found += read_angles((x, y, zs[k]), (branch[at - 1], branch[at]))
        return found

    def covector(self, slopes: Mapping[str, Any]) -> dict[int, Any]:
        """Return the nonzero entries of sum(slope_b L_b) by velocity."""
        row: dict[int, Any] = {}
        on: dict[int, list[Any]] = {i: [0, 0, 0] for i in (-1, *self.chain)}
        for name, slope in slopes.items():
            if name in self.rows:
                for at, entry in self.rows[name].items():
                    row[at] = row.get(at, 0) + slope * entry
            else:
                link, torque = self.torques[name]
                on[link] = [total + slope * part for total, part in zip(on[link], torque, strict=True)]
        for i in reversed(self.chain):  # a ball carries the torques on all that hangs on it
            on[i] = [self._let(part) for part in on[i]]
            for k, axis in enumerate(self.balls[i]):
                row[self.layout.links[i].v + k] = _dot(on[i], axis)
            parent = self.layout.links[i].parent
            on[parent] = [total + part for total, part in zip(on[parent], on[i], strict=True)]
        if self.layout.base == "ski":
            row[YAW] = row.get(YAW, 0) + on[-1][2]
        return {at: entry for at, entry in row.items() if entry != 0}

    def _symbols(self, name: str, count: int) -> list[Any]:
        return [self.symbols.sympy.Symbol(f"{name}_{k}", real=True) for k in range(count)]

    def _let(self, expression: Any) -> Any:
        """Name an intermediate result; what is named already keeps its name."""
        if self.symbols.sympy.sympify(expression).is_Atom:
            return expression
        for symbol, known in self.steps.items():
            if known == expression:
                return symbol
        symbol = self.symbols.sympy.Symbol(f"k{len(self.steps)}", real=True)
        self.steps[symbol] = expression
        return symbol

    def _found(self, name: str, value: Any, rate: Any, drift: Any) -> None:
        self.steps[self.symbols.value[name]], self.steps[self.symbols.rate[name]] = value, rate
        self.drifts[name] = drift

    def _plain(self, name: str, b: Variable) -> None:
        """Coordinates that are entries of q, or of the ski, or elevations in a plane."""
        q, v, layout, one, zero = self.q, self.v, self.layout, self.symbols.sympy.Integer(1), self.symbols.sympy.Integer(0)
        if b.kind in "xy" and layout.base == "ski":
            c, s, forward, left, yaw = q[2], q[3], v[0], v[1], v[YAW]
            x_rate, y_rate = self._let(c * forward - s * left), self._let(s * forward + c * left)
            self.rows[name] = {0: c, 1: -s} if b.kind == "x" else {0: s, 1: c}
            self._found(name, q[b.at], *((x_rate, -yaw * y_rate) if b.kind == "x" else (y_rate, yaw * x_rate)))
        elif b.kind == "phi0":
            self.rows[name] = {YAW: one}
            self._found(name, self.heading[0], v[YAW], zero)
        elif b.kind == "psi":
            path = [layout.links[i] for i in layout.path(b.link)]
            self.rows[name] = {link.v: one for link in path}
            self._found(name, sum(q[link.q] for link in path), sum(v[link.v] for link in path), zero)
        else:  # x y z of another base, xi, speed, which has no value
            self.rows[name] = {b.v: one}
            self._found(name, zero if b.kind == "speed" else q[b.at], v[b.v], zero)

    def _turn(self, turning: Mapping[str, Variable]) -> None:
        """What turns with a link: d' = omega x d, d'' at vdot = 0 is omega' x d + omega x d', omega' = -sum omega_k x omega_p."""
        sympy, let, zero = self.symbols.sympy, self._let, self.symbols.sympy.Integer(0)
        base = [zero, zero, self.v[YAW] if self.layout.base == "ski" else zero]
        turns: dict[int, tuple[list[Any], list[Any]]] = {-1: (base, [zero] * 3)}
        for i in self.chain:
            link = self.layout.links[i]
            before, growth = turns[link.parent]
            axes, w = self.balls[i], self.v[link.v : link.v + 3]
            omega = [let(before[c] + sum(axes[k][c] * w[k] for k in range(3))) for c in range(3)]
            alpha = [let(g + part) for g, part in zip(growth, _cross(before, omega), strict=True)]
            turns[i] = omega, alpha
            mine = [(name, b) for name, b in turning.items() if b.link == i]
            if not mine:
                continue
            d = axes[0]
            rate = [let(part) for part in _cross(omega, d)]
            bend = [let(first + second) for first, second in zip(_cross(alpha, d), _cross(omega, rate), strict=True)]
            for name, b in mine:
                if b.kind == "d":
                    unit = [sympy.Integer(int(c == b.at)) for c in range(3)]
                    self.torques[name] = i, _cross(d, unit)
                    self._found(name, d[b.at], rate[b.at], bend[b.at])
            if i not in self.angles:
                continue
            phi, psi = self.angles[i]
            sin_phi, cos_phi = let(sympy.sin(phi)), let(sympy.cos(phi))
            sin_psi, cos_psi = let(sympy.sin(psi)), let(sympy.cos(psi))
            lateral = let(cos_phi * rate[1] - sin_phi * rate[0])
            up = let(cos_psi * rate[2] - sin_psi * (cos_phi * rate[0] + sin_phi * rate[1]))
            for name, b in mine:
                if b.kind == "psi":
                    steep = sympy.Piecewise((lateral**2 * sin_psi / cos_psi, sympy.Abs(cos_psi) > POLE), (zero, True))
                    curve = cos_psi * bend[2] - sin_psi * (cos_phi * bend[0] + sin_phi * bend[1])
                    self.torques[name] = i, [sin_phi, -cos_phi, zero]
                    self._found(name, psi, up, curve - let(steep))
                elif b.kind == "phi":
                    turn, steep = let(lateral / cos_psi), let(-sin_psi / cos_psi)
                    self.torques[name] = i, [let(steep * cos_phi), let(steep * sin_phi), sympy.Integer(1)]
                    self._found(name, phi, turn, (cos_phi * bend[1] - sin_phi * bend[0] + 2 * turn * up * sin_psi) / cos_psi)

    def _no_azimuth(self, i: int) -> SingularError:
        name = self.layout.links[i].name
        return SingularError(
            f"phi{i + 1} is used by an equation or a control while link {name!r} stands at the pole (|cos psi| < {POLE:g}), "
            f"where it has no azimuth; write the equation with {name}.direction.x and .y, and use a hinge torque T_{name}"
        )


def _dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
