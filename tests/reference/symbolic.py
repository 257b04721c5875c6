"""Equations of motion derived afresh: symbolic Lagrange equations, and an exact evaluation for long chains.

Nothing here knows the closed forms. The chain is described by the positions of its particles alone; sums over a rod are
integrals over its length. Coordinates run in the order x y phi0 phi1 psi1 xi1_1 xi1_2 phi2 ..., every length exists.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import mpmath
import numpy as np
import sympy as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]

LINK_DATA = ("length", "mass", "tip", "com", "inertia")
SKI_DATA = ("ski_mass", "ski_inertia", "com_offset")


def coordinate_names(n: int, ski: bool) -> list[str]:
    """Names of all coordinates of a chain of n links."""
    chain = [name for i in range(1, n + 1) for name in (f"phi{i}", f"psi{i}", f"xi{i}_1", f"xi{i}_2")]
    return (["x", "y", "phi0"] if ski else []) + chain


def direction(phi: Any, psi: Any) -> sp.Matrix:
    """Unit vector of a link."""
    return sp.Matrix([sp.cos(phi) * sp.cos(psi), sp.sin(phi) * sp.cos(psi), sp.sin(psi)])


@dataclass(frozen=True)
class Lagrangian:
    """Symbols of a chain, its energies, and the velocity of any of its particles."""

    q: list[sp.Symbol]
    v: list[sp.Symbol]
    a: list[sp.Symbol]
    data: list[sp.Symbol]  # gravity, slope, the ski's, then each link's
    kinetic: sp.Expr
    potential: sp.Expr
    starts: list[sp.Matrix]  # position of A_i
    axes: list[sp.Matrix]  # d_i

    def velocity(self, position: sp.Matrix) -> sp.Matrix:
        """Time derivative of a position."""
        return position.jacobian(self.q) * sp.Matrix(self.v)


@cache
def lagrangian(n: int, ski: bool) -> Lagrangian:
    """Write the energies of a chain of n links from the positions of its particles."""
    names = coordinate_names(n, ski)
    q, v, a = (list(sp.symbols([name + end for name in names], real=True)) for end in ("", "_dot", "_ddot"))
    by_name = dict(zip(names, q, strict=True))
    gravity, slope = sp.symbols("gravity slope", real=True)
    ski_mass, ski_inertia, offset = sp.symbols(SKI_DATA, real=True)
    data = [gravity, slope, ski_mass, ski_inertia, offset]
    up = sp.Matrix([-sp.sin(slope), 0, sp.cos(slope)])

    def rate(position: sp.Matrix) -> sp.Matrix:
        return position.jacobian(q) * sp.Matrix(v)

    start = sp.zeros(3, 1)
    kinetic, height = sp.S.Zero, sp.S.Zero  # height: sum of mass times height
    if ski:
        phi0 = by_name["phi0"]
        start = sp.Matrix([by_name["x"], by_name["y"], 0])
        centre = start + offset * sp.Matrix([sp.cos(phi0), sp.sin(phi0), 0])
        phi0_dot = v[names.index("phi0")]
        kinetic += ski_mass * rate(centre).dot(rate(centre)) / 2 + ski_inertia * phi0_dot**2 / 2
        height += ski_mass * centre.dot(up)
    starts, axes = [], []
    for i in range(1, n + 1):
        length, mass, tip, com, inertia = link = sp.symbols([f"{name}{i}" for name in LINK_DATA], real=True)
        data += link
        d = direction(by_name[f"phi{i}"], by_name[f"psi{i}"])
        starts.append(start)
        axes.append(d)
        # Rod: the particle at s from its start moves with base + s * turn, so |velocity|^2 integrates to three moments.
        rod_start = start + by_name[f"xi{i}_1"] * d
        base, turn = rate(rod_start), rate(d)
        first, second = mass * com, inertia + mass * com**2
        kinetic += (mass * base.dot(base) + 2 * first * base.dot(turn) + second * turn.dot(turn)) / 2
        height += (mass * rod_start + first * d).dot(up)
        start = start + (by_name[f"xi{i}_1"] + length + by_name[f"xi{i}_2"]) * d
        kinetic += tip * rate(start).dot(rate(start)) / 2
        height += tip * start.dot(up)
    return Lagrangian(q, v, a, data, kinetic, gravity * height, starts, axes)


@cache
def uniform_rod() -> tuple[Callable[..., float], Callable[..., float]]:
    """Centre of mass and inertia about it of a thin uniform rod (length, mass), by integration."""
    length, mass, s = sp.symbols("length mass s", positive=True)
    com = sp.integrate(mass / length * s, (s, 0, length)) / mass
    inertia = sp.integrate(mass / length * (s - com) ** 2, (s, 0, length))
    return sp.lambdify([length, mass], com), sp.lambdify([length, mass], inertia)


def derived(
    kinetic: sp.Expr, potential: sp.Expr, q: Sequence[sp.Symbol], v: Sequence[sp.Symbol], data: Sequence[sp.Symbol] = ()
) -> Callable[..., tuple[Array, Array]]:
    """Derive d/dt dL/dv - dL/dq; return a function (q, v, data) -> mass matrix, bias.

    The momenta are derived symbolically. They are linear in v, so their values at unit rates are the mass matrix. Derivatives
    along q are taken in numbers, to all digits: Im f(q + i h e) / h with an h whose square is nothing.
    """
    size, h = len(q), 1e-30
    momenta = [sp.diff(kinetic, rate) for rate in v]
    compiled = sp.lambdify([*q, *v, *data], [*momenta, kinetic - potential], modules="numpy", cse=True)

    def evaluate(q: Sequence[float], v: Sequence[float], data: Sequence[float] = ()) -> tuple[Array, Array]:
        point, rates = np.asarray(q, dtype=float)[:, None], np.asarray(v, dtype=float)[:, None]
        flat, unit = np.zeros((size, size)), np.eye(size)
        along = np.hstack([flat, unit, rates])  # at rest with unit rates; along each coordinate; along the motion
        moving = np.hstack([unit, np.repeat(rates, size + 1, axis=1)])
        values = np.array(np.broadcast_arrays(*compiled(*(point + 1j * h * along), *moving, *data)))
        slope = values.imag / h
        return values[:size, :size].real, slope[:size, -1] - slope[-1, size:-1]

    return evaluate


@cache
def lagrange_equations(n: int, ski: bool) -> Callable[..., tuple[Array, Array]]:
    """Lagrange's equations of a chain: a function (q, v, data) -> mass matrix, bias."""
    model = lagrangian(n, ski)
    return derived(model.kinetic, model.potential, model.q, model.v, model.data)


@cache
def energies(n: int, ski: bool) -> Callable[..., tuple[float, float]]:
    """Return a function (q, v, data) -> kinetic, potential energy."""
    model = lagrangian(n, ski)
    compiled = sp.lambdify(
        [*model.q, *model.v, *model.data], [model.kinetic, model.potential], modules="math", cse=True
    )
    return lambda q, v, data: tuple(compiled(*q, *v, *data))


@cache
def squared_speed(n: int, link: int, end: bool = False) -> Callable[..., float]:
    """Squared speed of a pivoted chain's particle of `link` at s from its rod's start, or of the link's far end.

    Returns a function (q, v, data, s).
    """
    model = lagrangian(n, False)
    s = sp.Symbol("s", real=True)
    lower, upper = (model.q[4 * (link - 1) + k] for k in (2, 3))
    length = sp.Symbol(f"length{link}", real=True)
    arm = lower + (length + upper if end else s)
    velocity = model.velocity(model.starts[link - 1] + arm * model.axes[link - 1])
    compiled = sp.lambdify([*model.q, *model.v, *model.data, s], velocity.dot(velocity), modules="math", cse=True)
    return lambda q, v, data, s: float(compiled(*q, *v, *data, s))


def exact_equations(
    n: int,
    ski: bool,
    q: Sequence[float] | Array,
    v: Sequence[float] | Array,
    data: Sequence[float] | Array,
    digits: int = 60,
) -> tuple[Array, Array]:
    """Mass matrix and bias of a long chain from its particles, in `digits`-digit arithmetic.

    A rod is two equal particles on its axis (same mass, centre of mass and inertia). The mass matrix is
    sum m J^T J, the bias sum m J^T (r'' - g) with r'' taken along q + t v; central differences of step
    10^-(digits/3) leave errors far below double precision.
    """
    with mpmath.workdps(digits):
        step = mpmath.mpf(10) ** (-digits // 3)
        q_mp, v_mp = [mpmath.mpf(value) for value in q], [mpmath.mpf(value) for value in v]
        gravity, slope, ski_mass, ski_inertia, offset, *links = (mpmath.mpf(value) for value in data)

        def particles(point: Sequence[Any]) -> Any:
            """Positions (P, 3) of all particles, then the heading as a pseudo-particle's first component."""
            rest, out = list(point), []
            start = np.array([mpmath.mpf(0)] * 3)
            if ski:
                start = np.array([rest[0], rest[1], mpmath.mpf(0)])
                out.append(start + offset * np.array([mpmath.cos(rest[2]), mpmath.sin(rest[2]), 0]))
                out.append(np.array([rest[2], 0, 0]))
                rest = rest[3:]
            for i in range(n):
                phi, psi, lower, upper = rest[4 * i : 4 * i + 4]
                length, mass, _, com, inertia = links[5 * i : 5 * i + 5]
                c = mpmath.cos(psi)
                d = np.array([mpmath.cos(phi) * c, mpmath.sin(phi) * c, mpmath.sin(psi)])
                radius = mpmath.sqrt(inertia / mass)
                out += [start + (lower + com + side * radius) * d for side in (-1, 1)]
                start = start + (lower + length + upper) * d
                out.append(start)
            return np.array(out, dtype=object)

        weights, falls = [], []
        if ski:
            weights, falls = [ski_mass, ski_inertia], [1, 0]
        for i in range(n):
            mass, tip = links[5 * i + 1 : 5 * i + 3]
            weights += [mass / 2, mass / 2, tip]
            falls += [1, 1, 1]
        up = np.array([-mpmath.sin(slope), mpmath.mpf(0), mpmath.cos(slope)])
        columns = []
        for k in range(len(q_mp)):
            ahead, behind = list(q_mp), list(q_mp)
            ahead[k], behind[k] = ahead[k] + step, behind[k] - step
            columns.append((particles(ahead) - particles(behind)) / (2 * step))
        jacobian = np.array(columns, dtype=object)  # (N, P, 3)
        ahead, behind = ([a + side * step * b for a, b in zip(q_mp, v_mp, strict=True)] for side in (1, -1))
        acceleration = (particles(ahead) - 2 * particles(q_mp) + particles(behind)) / step**2
        load = acceleration + gravity * np.outer(np.array(falls, dtype=object), up)
        weighted = (jacobian * np.array(weights, dtype=object)[:, None]).reshape(len(q_mp), -1)
        matrix = weighted @ jacobian.reshape(len(q_mp), -1).T
        bias = weighted @ load.reshape(-1)
        return matrix.astype(float), bias.astype(float)
