"""Numbered formulas of the skier, (7.2) and (7.7)-(7.16), in their correct form (docs/errata.md lists the misprints).

Links are thin uniform rods, m_B is the last tip mass and the only one, the surface is level, the ski's centre of mass
is at A. Equations return their left side, the right side being the generalized force of section 9. Accelerations are
vectors in the order of `coordinate_names`: (x, phi0, phi1, psi1, xi1_1, xi1_2) for (7.7)-(7.12).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .parameters import Array, ChainParameters, ChainState


class _Skier(NamedTuple):
    """Abbreviations under (7.12) and trigonometry of ski and link 1."""

    zeta: float  # zeta_1 [kg m^2]
    first: float  # eta_1 + vartheta_1 [kg m]
    vartheta: float  # vartheta_1 [kg m]
    m_b: float  # m_B [kg]
    theta: float  # m_0 + m_1 + m_B [kg]
    theta_1: float  # m_1 + m_B [kg]
    tan: float
    sec2: float  # of phi_0
    cos_phi: float
    sin_phi: float
    c: float
    s: float  # cos and sin of psi_1


def _skier(parameters: ChainParameters, state: ChainState) -> _Skier:
    m, length, m_b = parameters.rod_mass[0], parameters.rod_length[0], parameters.tip_mass[0]
    lower, upper = state.xi[0]
    eta, vartheta = m * (lower + length / 2), m_b * (lower + length + upper)
    return _Skier(
        zeta=m * length**2 / 3 + m * lower * (length + lower) + m_b * (length + lower + upper) ** 2,
        first=eta + vartheta,
        vartheta=vartheta,
        m_b=m_b,
        theta=parameters.ski_mass + m + m_b,
        theta_1=m + m_b,
        tan=np.tan(state.phi0),
        sec2=1 / np.cos(state.phi0) ** 2,
        cos_phi=np.cos(state.phi[0]),
        sin_phi=np.sin(state.phi[0]),
        c=np.cos(state.psi[0]),
        s=np.sin(state.psi[0]),
    )


def eq_7_2(parameters: ChainParameters, state: ChainState) -> float:
    """Kinetic energy of the ski with one link, (7.2) [J]; x_dot and y_dot are independent here."""
    k = _skier(parameters, state)
    phi, psi, x, y = state.phi_dot[0], state.psi_dot[0], state.x_dot, state.y_dot
    lower, both = state.xi_dot[0, 0], state.xi_dot[0].sum()
    stretch = (k.theta_1 - k.m_b) * lower + k.m_b * both
    return float(
        0.5 * (k.theta * (x**2 + y**2) + parameters.ski_inertia * state.phi0_dot**2)
        + 0.5 * ((k.theta_1 - k.m_b) * lower**2 + k.m_b * both**2 + k.zeta * (psi**2 + phi**2 * k.c**2))
        + x * (stretch * k.cos_phi * k.c - k.first * (k.sin_phi * k.c * phi + k.cos_phi * k.s * psi))
        + y * (stretch * k.sin_phi * k.c + k.first * (k.cos_phi * k.c * phi - k.sin_phi * k.s * psi))
    )


def eq_7_7(parameters: ChainParameters, state: ChainState, accelerations: ArrayLike) -> float:
    """Row of x after Chaplygin's elimination, (7.7) = Q_x + Q_y tan(phi_0) [N].

    `accelerations` (6,): x [m/s^2], phi0, phi1, psi1 [rad/s^2], xi1_1, xi1_2 [m/s^2].
    """
    x_2, _, phi_2, psi_2, lower_2, upper_2 = np.asarray(accelerations, dtype=float)
    k = _skier(parameters, state)
    phi, psi, (lower, upper) = state.phi_dot[0], state.psi_dot[0], state.xi_dot[0]
    alpha, beta = k.sin_phi * k.tan + k.cos_phi, k.cos_phi * k.tan - k.sin_phi
    return float(
        k.theta * k.sec2 * x_2
        + k.first * beta * k.c * phi_2
        - k.first * alpha * k.s * psi_2
        + k.theta_1 * alpha * k.c * lower_2
        + k.m_b * alpha * k.c * upper_2
        - k.first * alpha * k.c * (phi**2 + psi**2)
        - 2 * k.first * beta * k.s * phi * psi
        + 2 * k.theta_1 * beta * k.c * phi * lower
        + 2 * k.m_b * beta * k.c * phi * upper
        - 2 * k.theta_1 * alpha * k.s * psi * lower
        - 2 * k.m_b * alpha * k.s * psi * upper
        + k.theta * k.sec2 * k.tan * state.x_dot * state.phi0_dot
    )


def eq_7_8(parameters: ChainParameters, state: ChainState, accelerations: ArrayLike) -> float:
    """Row of phi_0, (7.8) = Q_phi0 [N m].

    `accelerations` (6,): x [m/s^2], phi0, phi1, psi1 [rad/s^2], xi1_1, xi1_2 [m/s^2].
    """
    _, phi0_2, _, _, _, _ = np.asarray(accelerations, dtype=float)
    return float(parameters.ski_inertia * phi0_2)


def eq_7_9(parameters: ChainParameters, state: ChainState, accelerations: ArrayLike) -> float:
    """Row of phi_1, (7.9) = Q_phi1 [N m].

    `accelerations` (6,): x [m/s^2], phi0, phi1, psi1 [rad/s^2], xi1_1, xi1_2 [m/s^2].
    """
    x_2, _, phi_2, _, _, _ = np.asarray(accelerations, dtype=float)
    k = _skier(parameters, state)
    phi, psi, (lower, upper) = state.phi_dot[0], state.psi_dot[0], state.xi_dot[0]
    return float(
        k.first * (k.cos_phi * k.tan - k.sin_phi) * k.c * x_2
        + k.zeta * k.c**2 * phi_2
        + 2 * k.first * k.c**2 * lower * phi
        + 2 * k.vartheta * k.c**2 * upper * phi
        - 2 * k.zeta * k.c * k.s * phi * psi
        + k.first * k.c * k.cos_phi * k.sec2 * state.x_dot * state.phi0_dot
    )


def eq_7_10(parameters: ChainParameters, state: ChainState, accelerations: ArrayLike) -> float:
    """Row of psi_1, (7.10) = Q_psi1 [N m].

    `accelerations` (6,): x [m/s^2], phi0, phi1, psi1 [rad/s^2], xi1_1, xi1_2 [m/s^2].
    """
    x_2, _, _, psi_2, _, _ = np.asarray(accelerations, dtype=float)
    k = _skier(parameters, state)
    phi, psi, (lower, upper) = state.phi_dot[0], state.psi_dot[0], state.xi_dot[0]
    return float(
        -k.first * (k.sin_phi * k.tan + k.cos_phi) * k.s * x_2
        + k.zeta * psi_2
        + k.zeta * k.c * k.s * phi**2
        + 2 * k.first * lower * psi
        + 2 * k.vartheta * upper * psi
        + parameters.gravity * k.first * k.c
        - k.first * k.sin_phi * k.s * k.sec2 * state.x_dot * state.phi0_dot
    )


def eq_7_11(parameters: ChainParameters, state: ChainState, accelerations: ArrayLike) -> float:
    """Row of xi_11, (7.11) = F_11 [N].

    `accelerations` (6,): x [m/s^2], phi0, phi1, psi1 [rad/s^2], xi1_1, xi1_2 [m/s^2].
    """
    x_2, _, _, _, lower_2, upper_2 = np.asarray(accelerations, dtype=float)
    k = _skier(parameters, state)
    phi, psi = state.phi_dot[0], state.psi_dot[0]
    return float(
        k.theta_1 * (k.sin_phi * k.tan + k.cos_phi) * k.c * x_2
        + k.theta_1 * lower_2
        + k.m_b * upper_2
        - k.first * k.c**2 * phi**2
        - k.first * psi**2
        + parameters.gravity * k.theta_1 * k.s
        + k.theta_1 * k.sin_phi * k.c * k.sec2 * state.x_dot * state.phi0_dot
    )


def eq_7_12(parameters: ChainParameters, state: ChainState, accelerations: ArrayLike) -> float:
    """Row of xi_12, (7.12) = F_12 [N].

    `accelerations` (6,): x [m/s^2], phi0, phi1, psi1 [rad/s^2], xi1_1, xi1_2 [m/s^2].
    """
    x_2, _, _, _, lower_2, upper_2 = np.asarray(accelerations, dtype=float)
    k = _skier(parameters, state)
    phi, psi = state.phi_dot[0], state.psi_dot[0]
    return float(
        k.m_b * (k.sin_phi * k.tan + k.cos_phi) * k.c * x_2
        + k.m_b * lower_2
        + k.m_b * upper_2
        - k.vartheta * k.c**2 * phi**2
        - k.vartheta * psi**2
        + parameters.gravity * k.m_b * k.s
        + k.m_b * k.sin_phi * k.c * k.sec2 * state.x_dot * state.phi0_dot
    )


def _zeta_eta_vartheta(parameters: ChainParameters, state: ChainState) -> tuple[Array, Array, Array]:
    """Abbreviations under (7.16) for n links, m_B on the last tip alone, each (n,)."""
    m, rod, lower, upper = parameters.rod_mass, parameters.rod_length, state.xi[:, 0], state.xi[:, 1]
    m_b = parameters.tip_mass[-1]
    after = np.cumsum(m[::-1])[::-1] - m  # sum of m_k over k > j
    zeta = (
        m * rod**2 / 3
        + m * lower * (rod + lower)
        + rod * (2 * (lower + upper) + rod) * after
        + (lower + upper) ** 2 * after
        + m_b * (rod + (lower + upper)) ** 2
    )
    return zeta, m * (lower + rod / 2) + (rod + lower + upper) * after, m_b * (lower + rod + upper)


def eq_7_14(parameters: ChainParameters, state: ChainState) -> tuple[float, float]:
    """Elements a_11 [kg] and a_22 [kg m^2] of (7.13), (7.14)."""
    total = parameters.ski_mass + parameters.rod_mass.sum() + parameters.tip_mass[-1]
    return total / np.cos(state.phi0) ** 2, parameters.ski_inertia


def eq_7_15(parameters: ChainParameters, state: ChainState) -> Array:
    """Elements a_1j, j = 3..n+2, of (7.13), (7.15), (n,) [kg m]."""
    _, eta, vartheta = _zeta_eta_vartheta(parameters, state)
    value: Array = (eta + vartheta) * (np.cos(state.phi) * np.tan(state.phi0) - np.sin(state.phi)) * np.cos(state.psi)
    return value


def eq_7_16(parameters: ChainParameters, state: ChainState) -> Array:
    """Elements a_ij, i, j = 3..n+2, of (7.13), (7.16), (n, n) [kg m^2]."""
    zeta, eta, vartheta = _zeta_eta_vartheta(parameters, state)
    length, c = state.xi.sum(axis=1) + parameters.rod_length, np.cos(state.psi)
    upper_half = np.triu(np.outer(length, eta + vartheta), 1)
    planar = np.cos(state.phi[:, None] - state.phi) * np.outer(c, c)
    value: Array = (np.diag(zeta) + upper_half + upper_half.T) * planar
    return value


def eq_7_13(parameters: ChainParameters, state: ChainState) -> Array:
    """Matrix A on the accelerations of (x, phi_0, phi_1, ..., phi_n), (7.13), (n + 2, n + 2) [kg, kg m, kg m^2]."""
    matrix = np.zeros((parameters.n + 2, parameters.n + 2))
    matrix[0, 0], matrix[1, 1] = eq_7_14(parameters, state)
    matrix[0, 2:] = matrix[2:, 0] = eq_7_15(parameters, state)
    matrix[2:, 2:] = eq_7_16(parameters, state)
    return matrix
