"""Random chains, given both to the closed forms and to the independent derivation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.reference.symbolic import coordinate_names, exact_equations, lagrange_equations, uniform_rod
from vlmb.equations.closed_form import ChainParameters, ChainState, chain_parameters, chain_state

Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True)
class Case:
    """A chain of n links with all lengths free, at a random state with random accelerations."""

    n: int
    ski: bool
    q: Array  # (N,) in the order x y phi0 phi1 psi1 xi1_1 xi1_2 phi2 ...
    v: Array
    a: Array
    data: Array  # gravity, slope, ski mass, inertia, offset, then length, mass, tip, com, inertia of each link
    uniform: bool

    @property
    def names(self) -> list[str]:
        """Coordinate names in the order of q."""
        return coordinate_names(self.n, self.ski)

    def parameters(self, present: Any = True) -> ChainParameters:
        """Constants for the closed forms; uniform rods rely on their defaults."""
        gravity, slope, ski_mass, ski_inertia, offset = self.data[:5]
        length, mass, tip, com, inertia = self.data[5:].reshape(-1, 5).T
        rods: dict[str, Any] = {} if self.uniform else {"rod_com": com, "rod_inertia": inertia}
        ski = {"ski_mass": ski_mass, "ski_inertia": ski_inertia, "com_offset": offset} if self.ski else {}
        return chain_parameters(length, mass, tip, present=present, gravity=gravity, slope=slope, **rods, **ski)

    def state(self) -> ChainState:
        """State for the closed forms."""
        rates = {f"{name}_dot": value for name, value in zip(self.names, self.v, strict=True)}
        return chain_state(self.n, dict(zip(self.names, self.q, strict=True)), rates)


def make_case(n: int, ski: bool, seed: int, tips: str = "all", uniform: bool = False) -> Case:
    """Draw a case. `tips` is all, last or none; `uniform` gives thin rods, a level surface and no offset."""
    rng = np.random.default_rng([n, ski, seed])
    size = len(coordinate_names(n, ski))
    q, v, a = rng.uniform(-3, 3, size), *(rng.choice([-1, 1], (2, size)) * rng.uniform(0.3, 2, (2, size)))
    chain = slice(3 if ski else 0, None)
    for k in (2, 3):
        q[chain][k::4] = rng.uniform(0.1, 0.6, n)
    if ski:
        q[2] = rng.uniform(-1.2, 1.2)
    length, mass, tip = rng.uniform(0.3, 1, n), rng.uniform(1, 5, n), rng.uniform(0.5, 3, n)
    tip *= {"all": np.ones(n), "last": np.arange(n) == n - 1, "none": np.zeros(n)}[tips]
    com, inertia = length * rng.uniform(0.2, 0.8, n), mass * length**2 * rng.uniform(0.02, 0.1, n)
    slope, offset = rng.uniform(-0.5, 0.5), rng.uniform(-0.4, 0.4)
    if uniform:
        slope = offset = 0.0
        com, inertia = (np.array([f(*pair) for pair in zip(length, mass, strict=True)]) for f in uniform_rod())
    ski_mass, ski_inertia = rng.uniform(2, 6), rng.uniform(0.3, 1)
    links = np.column_stack([length, mass, tip, com, inertia])
    return Case(n, ski, q, v, a, np.array([9.81, slope, ski_mass, ski_inertia, offset, *links.ravel()]), uniform)


def reference(case: Case, v: Array | None = None, gravity: float | None = None) -> tuple[Array, Array]:
    """Independent mass matrix and bias: symbolic up to three links, particle by particle beyond."""
    data = case.data.copy()
    data[0] = data[0] if gravity is None else gravity
    v = case.v if v is None else v
    if case.n <= 3:
        return lagrange_equations(case.n, case.ski)(case.q, v, data)
    return exact_equations(case.n, case.ski, case.q, v, data)


def reference_form(case: Case, form: str) -> tuple[Array, Array]:
    """Independent mass matrix and bias of a form: the full rows projected on motions that keep the knife edge.

    With v = B u the reduced rows are B^T (M B u' + M B' u + h).
    """
    if form in ("pivot", "full"):
        return reference(case)
    size, phi0 = len(case.q), case.q[2]
    cos, sin = np.cos(phi0), np.sin(phi0)
    basis, drift, u = np.zeros((size, size - 1)), np.zeros(size), case.v[1:].copy()
    basis[2:, 1:] = np.eye(size - 2)
    if form == "chaplygin":
        u[0] = case.v[0]
        basis[:2, 0] = 1.0, np.tan(phi0)
        drift[1] = u[0] * case.v[2] / cos**2
    else:
        u[0] = cos * case.v[0] + sin * case.v[1]
        basis[:2, 0] = cos, sin
        drift[:2] = u[0] * case.v[2] * np.array([-sin, cos])
    matrix, h = reference(case, basis @ u)
    return basis.T @ matrix @ basis, basis.T @ (matrix @ drift + h)


def products(case: Case) -> Array:
    """Coefficients T of the velocity products, bias - gravity = sum_jk T[:, j, k] v_j v_k, symmetric, (N, N, N)."""
    size = len(case.q)
    unit = np.eye(size)

    def h(v: Array) -> Array:
        return reference(case, v, gravity=0.0)[1]

    squares = [h(e) for e in unit]
    out = np.zeros((size, size, size))
    for j in range(size):
        out[:, j, j] = squares[j]
        for k in range(j):
            out[:, j, k] = out[:, k, j] = (h(unit[j] + unit[k]) - squares[j] - squares[k]) / 2
    return out


def mismatch(actual: Any, expected: Any, scale: float | None = None) -> float:
    """Largest difference relative to the largest expected entry, or to `scale`."""
    actual, expected = np.asarray(actual, dtype=float), np.asarray(expected, dtype=float)
    assert actual.shape == expected.shape
    largest = float(np.max(np.abs(expected), initial=0.0)) if scale is None else scale
    return float(np.max(np.abs(actual - expected), initial=0.0)) / (largest or 1.0)
