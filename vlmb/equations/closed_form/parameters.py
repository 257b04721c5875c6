"""Data of a chain, its state, and the masses, moments and directions every formula is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

FORMS = ("pivot", "full", "chaplygin", "speed")


@dataclass(frozen=True, eq=False)
class ChainParameters:
    """Constants of a chain of n links; build it with `chain_parameters`."""

    rod_length: Array  # (n,) l_i [m]
    rod_mass: Array  # (n,) m_i [kg]
    tip_mass: Array  # (n,) mu_i at A_(i+1) [kg]
    rod_com: Array  # (n,) centre of mass, from the rod's start [m]
    rod_inertia: Array  # (n,) transverse, about the rod's centre of mass [kg m^2]
    present: NDArray[np.bool_]  # (n, 2): does the lower, upper length exist as a coordinate
    ski_mass: float  # m_0 [kg]
    ski_inertia: float  # I_0, vertical axis through the ski's centre of mass [kg m^2]
    com_offset: float  # ski's centre of mass ahead of A [m]
    gravity: float  # g [m/s^2]
    slope: float  # [rad], the fall line points along +x

    @property
    def n(self) -> int:
        """Number of links."""
        return len(self.rod_length)

    @property
    def up(self) -> Array:
        """Direction against gravity in the surface frame, (3,)."""
        return np.array([-np.sin(self.slope), 0.0, np.cos(self.slope)])


def chain_parameters(
    rod_length: ArrayLike,
    rod_mass: ArrayLike,
    tip_mass: ArrayLike = 0.0,
    *,
    rod_com: ArrayLike | None = None,
    rod_inertia: ArrayLike | None = None,
    present: ArrayLike | None = None,
    ski_mass: float = 0.0,
    ski_inertia: float = 0.0,
    com_offset: float = 0.0,
    gravity: float = 9.81,
    slope: float = 0.0,
) -> ChainParameters:
    """Build the constants of a chain; scalars hold for every link.

    Rods are thin and uniform unless `rod_com` and `rod_inertia` say otherwise. `present` is an (n, 2) mask of the
    segments that are coordinates; without it all are, except the last upper segment when no mass hangs on it.
    """
    length = np.atleast_1d(np.asarray(rod_length, dtype=float))
    n = len(length)

    def per_link(value: ArrayLike) -> Array:
        values: Array = np.broadcast_to(np.asarray(value, dtype=float), (n,)).copy()
        return values

    mass, tip = per_link(rod_mass), per_link(tip_mass)
    if present is None:
        mask = np.ones((n, 2), dtype=bool)
        if n:
            mask[-1, 1] = tip[-1] > 0
    else:
        mask = np.broadcast_to(np.asarray(present, dtype=bool), (n, 2)).copy()
    return ChainParameters(
        rod_length=length,
        rod_mass=mass,
        tip_mass=tip,
        rod_com=length / 2 if rod_com is None else per_link(rod_com),
        rod_inertia=mass * length**2 / 12 if rod_inertia is None else per_link(rod_inertia),
        present=mask,
        ski_mass=float(ski_mass),
        ski_inertia=float(ski_inertia),
        com_offset=float(com_offset),
        gravity=float(gravity),
        slope=float(slope),
    )


@dataclass(frozen=True, eq=False)
class ChainState:
    """Coordinates and rates; the pivoted chain leaves those of the ski at zero."""

    phi: Array  # (n,) absolute azimuths [rad]
    psi: Array  # (n,) absolute elevations [rad]
    xi: Array  # (n, 2) lower and upper lengths [m]
    phi_dot: Array  # (n,) [rad/s]
    psi_dot: Array  # (n,) [rad/s]
    xi_dot: Array  # (n, 2) [m/s]
    x: float = 0.0  # knife-edge point A [m]
    y: float = 0.0
    phi0: float = 0.0  # heading [rad]
    x_dot: float = 0.0  # [m/s]
    y_dot: float = 0.0
    phi0_dot: float = 0.0  # [rad/s]

    @property
    def speed(self) -> float:
        """Velocity of A along the ski [m/s]."""
        return float(self.x_dot * np.cos(self.phi0) + self.y_dot * np.sin(self.phi0))


def chain_state(
    n: int,
    coordinates: Mapping[str, float],
    rates: Mapping[str, float] | None = None,
    lengths: ArrayLike = 0.0,
) -> ChainState:
    """Build a state from names such as `phi1`, `xi2_1`, `x` and `phi1_dot`, `speed`; absent rates are 0.

    Segments that are no coordinates take their length from `lengths`, (n, 2). A rate `speed` sets both velocities
    of the ski and replaces `x_dot`, `y_dot`.
    """
    xi = np.broadcast_to(np.asarray(lengths, dtype=float), (n, 2)).copy()
    for i, a in np.ndindex(n, 2):
        xi[i, a] = coordinates.get(f"xi{i + 1}_{a + 1}", xi[i, a])
    given = dict(rates or {})
    phi0 = float(coordinates.get("phi0", 0.0))
    if "speed" in given:
        speed = given.pop("speed")
        given |= {"x_dot": speed * float(np.cos(phi0)), "y_dot": speed * float(np.sin(phi0))}
    return ChainState(
        phi=np.array([coordinates[f"phi{i + 1}"] for i in range(n)], dtype=float),
        psi=np.array([coordinates[f"psi{i + 1}"] for i in range(n)], dtype=float),
        xi=xi,
        phi_dot=np.array([given.get(f"phi{i + 1}_dot", 0.0) for i in range(n)], dtype=float),
        psi_dot=np.array([given.get(f"psi{i + 1}_dot", 0.0) for i in range(n)], dtype=float),
        xi_dot=np.array([[given.get(f"xi{i + 1}_{a}_dot", 0.0) for a in (1, 2)] for i in range(n)]).reshape(n, 2),
        x=float(coordinates.get("x", 0.0)),
        y=float(coordinates.get("y", 0.0)),
        phi0=phi0,
        x_dot=float(given.get("x_dot", 0.0)),
        y_dot=float(given.get("y_dot", 0.0)),
        phi0_dot=float(given.get("phi0_dot", 0.0)),
    )


@dataclass(frozen=True, eq=False)
class Moments:
    """Masses and moments a link carries, each (n,)."""

    above: Array  # M_i^+ = sum_{k>i} m_k + sum_{k>=i} mu_k [kg]
    total: Array  # N_i = m_i + M_i^+ [kg]
    length: Array  # Lambda_i = xi_i1 + l_i + xi_i2 [m]
    first: Array  # S_i = m_i (xi_i1 + com_i) + M_i^+ Lambda_i [kg m]
    second: Array  # J_i = I_i + m_i (xi_i1 + com_i)^2 + M_i^+ Lambda_i^2 [kg m^2]
    mass: float  # M_t = m_0 + N_1, ski and chain [kg]


def moments(parameters: ChainParameters, state: ChainState) -> Moments:
    """Compute the masses and moments of section 9 (for the skier S_i = eta_i + vartheta_i, J_i = zeta_i)."""
    total = np.cumsum((parameters.rod_mass + parameters.tip_mass)[::-1])[::-1]
    above = parameters.tip_mass + np.append(total[1:], 0.0) if parameters.n else total
    length = state.xi[:, 0] + parameters.rod_length + state.xi[:, 1]
    arm = state.xi[:, 0] + parameters.rod_com
    return Moments(
        above=above,
        total=total,
        length=length,
        first=parameters.rod_mass * arm + above * length,
        second=parameters.rod_inertia + parameters.rod_mass * arm**2 + above * length**2,
        mass=parameters.ski_mass + float(total[:1].sum()),
    )


@dataclass(frozen=True, eq=False)
class Directions:
    """Link directions d_i and their derivatives, each (n, 3)."""

    d: Array  # along the link
    e_phi: Array  # d d_i / d phi_i, length cos(psi_i)
    e_psi: Array  # d d_i / d psi_i
    d_phi_phi: Array
    d_phi_psi: Array


def directions(state: ChainState) -> Directions:
    """Compute d_i = (cos phi cos psi, sin phi cos psi, sin psi) and its derivatives (d_psi_psi = -d)."""
    cos_phi, sin_phi, cos_psi, sin_psi = np.cos(state.phi), np.sin(state.phi), np.cos(state.psi), np.sin(state.psi)
    zero = np.zeros_like(cos_phi)
    return Directions(
        d=np.column_stack([cos_phi * cos_psi, sin_phi * cos_psi, sin_psi]),
        e_phi=np.column_stack([-sin_phi * cos_psi, cos_phi * cos_psi, zero]),
        e_psi=np.column_stack([-cos_phi * sin_psi, -sin_phi * sin_psi, cos_psi]),
        d_phi_phi=np.column_stack([-cos_phi * cos_psi, -sin_phi * cos_psi, zero]),
        d_phi_psi=np.column_stack([sin_phi * sin_psi, -cos_phi * sin_psi, zero]),
    )
