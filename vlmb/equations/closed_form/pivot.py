"""Numbered formulas of the pivoted chain, (2.3)-(4.2), in their correct form (docs/errata.md lists the misprints).

Links are thin uniform rods without tip masses, gravity points along -z. Equations return their left side, the right
side being the generalized force. Accelerations are vectors in the order of `coordinate_names`:
(phi1, psi1, xi1_1) for (2.7)-(2.9), (phi1, psi1, xi1_1, xi1_2, phi2, psi2, xi2_1) for (3.3).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .parameters import Array, ChainParameters, ChainState


def eq_2_3(parameters: ChainParameters, state: ChainState, distance: ArrayLike) -> Array:
    """Squared speed of link 1's particle at `distance` [m] from the rod's start, (2.3) [m^2/s^2]."""
    arm = np.asarray(distance, dtype=float) + state.xi[0, 0]
    value: Array = state.xi_dot[0, 0] ** 2 + arm**2 * (
        state.psi_dot[0] ** 2 + (state.phi_dot[0] * np.cos(state.psi[0])) ** 2
    )
    return value


def _pivoted_link(parameters: ChainParameters, state: ChainState) -> tuple[float, float, float, float, float]:
    """Abbreviations of section 2: m_1, zeta_1 [kg m^2], lambda_11 [m], cos and sin of psi_1."""
    m, length, xi = parameters.rod_mass[0], parameters.rod_length[0], state.xi[0, 0]
    inertia = m * length**2 / 3  # (2.4)
    zeta = inertia + m * length * xi + m * xi**2
    return m, zeta, xi + length / 2, np.cos(state.psi[0]), np.sin(state.psi[0])


def eq_2_5(parameters: ChainParameters, state: ChainState) -> float:
    """Kinetic energy of the pivoted link, (2.5) [J]."""
    m, zeta, _, c, _ = _pivoted_link(parameters, state)
    return float(0.5 * (m * state.xi_dot[0, 0] ** 2 + zeta * (state.psi_dot[0] ** 2 + state.phi_dot[0] ** 2 * c**2)))


def eq_2_6(parameters: ChainParameters, state: ChainState) -> float:
    """Potential energy of the pivoted link, (2.6) [J]."""
    m, _, arm, _, s = _pivoted_link(parameters, state)
    return float(parameters.gravity * m * arm * s)


def eq_2_7(parameters: ChainParameters, state: ChainState, accelerations: ArrayLike) -> float:
    """Row of phi_1 of the pivoted link, (2.7) = M_1phi [N m].

    `accelerations` (3,): phi1, psi1 [rad/s^2], xi1_1 [m/s^2].
    """
    phi_2, _, _ = np.asarray(accelerations, dtype=float)
    m, zeta, arm, c, s = _pivoted_link(parameters, state)
    phi, psi, xi = state.phi_dot[0], state.psi_dot[0], state.xi_dot[0, 0]
    return float(zeta * c**2 * phi_2 + 2 * m * arm * c**2 * phi * xi - 2 * zeta * c * s * phi * psi)


def eq_2_8(parameters: ChainParameters, state: ChainState, accelerations: ArrayLike) -> float:
    """Row of psi_1 of the pivoted link, (2.8) = M_1psi [N m].

    `accelerations` (3,): phi1, psi1 [rad/s^2], xi1_1 [m/s^2].
    """
    _, psi_2, _ = np.asarray(accelerations, dtype=float)
    m, zeta, arm, c, s = _pivoted_link(parameters, state)
    phi, psi, xi = state.phi_dot[0], state.psi_dot[0], state.xi_dot[0, 0]
    return float(zeta * psi_2 + zeta * c * s * phi**2 + 2 * m * arm * psi * xi + parameters.gravity * m * arm * c)


def eq_2_9(parameters: ChainParameters, state: ChainState, accelerations: ArrayLike) -> float:
    """Row of xi_11 of the pivoted link, (2.9) = F_11 [N].

    `accelerations` (3,): phi1, psi1 [rad/s^2], xi1_1 [m/s^2].
    """
    _, _, xi_2 = np.asarray(accelerations, dtype=float)
    m, _, arm, c, s = _pivoted_link(parameters, state)
    phi, psi = state.phi_dot[0], state.psi_dot[0]
    return float(m * xi_2 - m * arm * c**2 * phi**2 - m * arm * psi**2 + parameters.gravity * m * s)


def eq_3_1(parameters: ChainParameters, state: ChainState) -> float:
    """Squared speed of the hinge A_2, (3.1) [m^2/s^2]."""
    length, rate = state.xi[0].sum() + parameters.rod_length[0], state.xi_dot[0].sum()
    return float(length**2 * (state.psi_dot[0] ** 2 + (state.phi_dot[0] * np.cos(state.psi[0])) ** 2) + rate**2)


def eq_3_2(parameters: ChainParameters, state: ChainState, distance: ArrayLike) -> Array:
    """Squared speed of link 2's particle at `distance` [m] from the rod's start, (3.2) [m^2/s^2]."""
    c1, c2 = np.cos(state.psi)
    s1, s2 = np.sin(state.psi)
    cos, sin = np.cos(state.phi[0] - state.phi[1]), np.sin(state.phi[0] - state.phi[1])
    (phi1, phi2), (psi1, psi2) = state.phi_dot, state.psi_dot
    arm, xi = np.asarray(distance, dtype=float) + state.xi[1, 0], state.xi_dot[1, 0]
    length, rate = state.xi[0].sum() + parameters.rod_length[0], state.xi_dot[0].sum()
    mixed = (
        (arm * rate * phi2 - length * phi1 * xi) * sin * c1 * c2
        + (arm * length * phi1 * phi2 + rate * xi) * cos * c1 * c2
        + arm * psi2 * (length * phi1 * sin * c1 * s2 - rate * cos * c1 * s2 + rate * s1 * c2)
        + rate * xi * s1 * s2
        - length * psi1 * (cos * s1 * c2 - c1 * s2) * xi
        - length * psi1 * arm * (sin * s1 * c2 * phi2 - (c1 * c2 + cos * s1 * s2) * psi2)
    )
    value: Array = eq_3_1(parameters, state) + arm**2 * (psi2**2 + (phi2 * c2) ** 2) + xi**2 + 2 * mixed
    return value


def eq_3_3(parameters: ChainParameters, state: ChainState, accelerations: ArrayLike) -> float:
    """Row of xi_21 of two pivoted links, (3.3) = F_21 [N].

    `accelerations` (7,): phi1, psi1 [rad/s^2], xi1_1, xi1_2 [m/s^2], phi2, psi2, xi2_1.
    """
    phi1_2, psi1_2, xi11_2, xi12_2, _, _, xi21_2 = np.asarray(accelerations, dtype=float)
    c1, c2 = np.cos(state.psi)
    s1, s2 = np.sin(state.psi)
    cos, sin = np.cos(state.phi[0] - state.phi[1]), np.sin(state.phi[0] - state.phi[1])
    (phi1, phi2), (psi1, psi2) = state.phi_dot, state.psi_dot
    length, rate = state.xi[0].sum() + parameters.rod_length[0], state.xi_dot[0].sum()
    arm = state.xi[1, 0] + parameters.rod_length[1] / 2
    along, across = cos * c1 * c2 + s1 * s2, cos * s1 * c2 - c1 * s2
    return float(
        parameters.rod_mass[1]
        * (
            -length * sin * c1 * c2 * phi1_2
            - length * across * psi1_2
            + along * (xi11_2 + xi12_2)
            + xi21_2
            - length * cos * c1 * c2 * phi1**2
            - arm * (1 + np.cos(2 * state.psi[1])) * phi2**2 / 2
            - length * along * psi1**2
            - arm * psi2**2
            - 2 * sin * c1 * c2 * phi1 * rate
            + 2 * length * sin * s1 * c2 * phi1 * psi1
            - 2 * across * psi1 * rate
            + parameters.gravity * s2
        )
    )


def eq_4_2(parameters: ChainParameters, state: ChainState) -> Array:
    """Block A_phi of the pivoted chain without tip masses, (4.2), (n, n) [kg m^2]."""
    m, rod, lower, upper = parameters.rod_mass, parameters.rod_length, state.xi[:, 0], state.xi[:, 1]
    delta = np.eye(parameters.n)
    after = np.cumsum(m[::-1])[::-1] - m  # sum of m_k over k > j
    length, c = rod + lower + upper, np.cos(state.psi)
    first = (rod + lower)[:, None] + (1 - delta) * upper[:, None]
    second = m * (0.5 * (1 - delta) * rod + lower)
    upper_half = np.triu(delta * (m * rod**2 / 3) + first * second + np.outer(length, length * after))
    value: Array = (upper_half + np.triu(upper_half, 1).T) * np.cos(state.phi[:, None] - state.phi) * np.outer(c, c)
    return value
