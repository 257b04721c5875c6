"""Mass matrix, bias and energies of a chain, in the project's order of coordinates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .blocks import (
    ACCELERATIONS,
    CHAIN_ROWS,
    DRIFTS,
    HEADING_PRODUCT,
    PRODUCTS,
    SKI_ROWS,
    Blocks,
    equation_blocks,
)
from .parameters import Array, ChainParameters, ChainState, directions, moments


def coordinate_names(parameters: ChainParameters, form: str = "pivot") -> tuple[str, ...]:
    """Names of rows and columns: those of the ski, then `phi1 psi1 xi1_1 xi1_2 phi2 ...`."""
    names = list(SKI_ROWS[form])
    for link, (lower, upper) in enumerate(parameters.present, start=1):
        names += [f"phi{link}", f"psi{link}"]
        names += [f"xi{link}_{a}" for a, exists in ((1, lower), (2, upper)) if exists]
    return tuple(names)


def _order(parameters: ChainParameters, form: str) -> NDArray[np.intp]:
    """Permutation from (ski, all phi, all psi, all xi1, all xi2) to ski, then link by link."""
    every = np.arange(parameters.n)
    links = (every, every, every[parameters.present[:, 0]], every[parameters.present[:, 1]])
    kind = np.repeat(np.arange(4), [len(part) for part in links])
    ski = len(SKI_ROWS[form])
    return np.concatenate([np.arange(ski), ski + np.lexsort((kind, np.concatenate(links)))])


def assemble_mass_matrix(blocks: Blocks, parameters: ChainParameters, form: str = "pivot") -> Array:
    """Arrange the acceleration blocks A B C1 C2 of (4.1) and section 9c as one matrix (N, N), see `mass_matrix`."""
    rows = SKI_ROWS[form] + CHAIN_ROWS
    columns = [row.upper() for row in SKI_ROWS[form]] + list(ACCELERATIONS)
    parts = []
    for row in rows:
        height = 1 if row in SKI_ROWS[form] else len(blocks["K", row])
        if height:
            parts.append(np.hstack([blocks[column, row].reshape(height, -1) for column in columns]))
    order = _order(parameters, form)
    return np.vstack(parts)[np.ix_(order, order)]


def assemble_bias(blocks: Blocks, parameters: ChainParameters, state: ChainState, form: str = "pivot") -> Array:
    """Sum the velocity products D ... H2 of (4.1) and gravity g K, (N,) [N, N m], see `bias`."""
    rates = {
        "phi": state.phi_dot,
        "psi": state.psi_dot,
        "xi1": state.xi_dot[:, 0],
        "xi2": state.xi_dot[:, 1],
    }
    ski_products = {}
    if form != "pivot":
        ski_products[HEADING_PRODUCT] = state.phi0_dot**2
    if form in DRIFTS:
        ski_products[DRIFTS[form]] = (state.x_dot if form == "chaplygin" else state.speed) * state.phi0_dot
    parts = []
    for row in SKI_ROWS[form] + CHAIN_ROWS:
        value = parameters.gravity * blocks["K", row]
        for block, (first, second) in PRODUCTS.items():
            product = rates[first] * rates[second]
            if second in ("xi1", "xi2"):
                product = product[parameters.present[:, int(second[-1]) - 1]]
            value = value + (1.0 if first == second else 2.0) * (blocks[block, row] @ product)
        for name, square in ski_products.items():
            value = value + blocks[name, row] * square
        parts.append(np.atleast_1d(value))
    return np.concatenate(parts)[_order(parameters, form)]


def mass_matrix(parameters: ChainParameters, state: ChainState, form: str = "pivot") -> Array:
    """Mass matrix of section 9, (N, N) [kg, kg m, kg m^2], rows and columns in the order of `coordinate_names`.

    mass_matrix @ accelerations + bias = generalized forces, where the accelerations are those of `coordinate_names`
    (for `speed` the first is d(speed)/dt). The full form still needs the multiplier of the knife edge.
    """
    return assemble_mass_matrix(equation_blocks(parameters, state, form), parameters, form)


def bias(parameters: ChainParameters, state: ChainState, form: str = "pivot") -> Array:
    """Velocity products and gravity of section 9, (N,) [N for lengths, N m for angles]; see `mass_matrix`.

    The chaplygin form reads x_dot alone of the ski's velocity, the speed form its part along the ski.
    """
    return assemble_bias(equation_blocks(parameters, state, form), parameters, state, form)


def kinetic_energy(parameters: ChainParameters, state: ChainState) -> float:
    """Kinetic energy T of section 9 [J], ski included."""
    m, d = moments(parameters, state), directions(state)
    turn = state.phi_dot[:, None] * d.e_phi + state.psi_dot[:, None] * d.e_psi  # d/dt d_i
    lower, both = state.xi_dot[:, 0], state.xi_dot.sum(axis=1)
    tip = both[:, None] * d.d + m.length[:, None] * turn  # d/dt (Lambda_i d_i)
    stretch = parameters.rod_mass * lower + m.above * both
    momentum = stretch[:, None] * d.d + m.first[:, None] * turn  # d/dt (S_i d_i)
    base = np.array([state.x_dot, state.y_dot, 0.0])
    before = base + np.cumsum(tip, axis=0) - tip  # velocity of A_i
    links = np.sum(before * momentum) + 0.5 * np.sum(
        m.second * np.sum(turn**2, axis=1) + parameters.rod_mass * lower**2 + m.above * both**2
    )
    left = np.array([-np.sin(state.phi0), np.cos(state.phi0), 0.0])
    moment = parameters.ski_mass * parameters.com_offset
    inertia = parameters.ski_inertia + moment * parameters.com_offset
    ski = 0.5 * m.mass * (base @ base) + 0.5 * inertia * state.phi0_dot**2 + moment * state.phi0_dot * (left @ base)
    return float(links + ski)


def potential_energy(parameters: ChainParameters, state: ChainState) -> float:
    """Potential energy V = g sum S_j sin(psi_j) [J], on a slope that of the tilted gravity; zero at the origin."""
    m, d = moments(parameters, state), directions(state)
    ski = parameters.ski_mass * parameters.com_offset * np.array([np.cos(state.phi0), np.sin(state.phi0), 0.0])
    first = m.first @ d.d + m.mass * np.array([state.x, state.y, 0.0]) + ski
    return float(parameters.gravity * (first @ parameters.up))
