"""Coefficient blocks of the rows of (4.1), on the pivot and on the ski, by outer products in O(n^2)."""

from __future__ import annotations

import numpy as np

from .parameters import FORMS, Array, ChainParameters, ChainState, Directions, Moments, directions, moments

Blocks = dict[tuple[str, str], Array]

CHAIN_ROWS = ("phi", "psi", "xi1", "xi2")
ACCELERATIONS = {"A": "phi", "B": "psi", "C1": "xi1", "C2": "xi2"}  # block -> the acceleration it multiplies
PRODUCTS = {  # block -> the two rates it multiplies; F, G and H carry a factor 2 in (4.1)
    "D": ("phi", "phi"),
    "E": ("psi", "psi"),
    "F1": ("phi", "xi1"),
    "F2": ("phi", "xi2"),
    "G": ("phi", "psi"),
    "H1": ("psi", "xi1"),
    "H2": ("psi", "xi2"),
}
SKI_ROWS = {"pivot": (), "full": ("x", "y", "phi0"), "chaplygin": ("x", "phi0"), "speed": ("speed", "phi0")}
DRIFTS = {"chaplygin": "xdot_phi0dot", "speed": "speed_phi0dot"}  # product that the knife edge adds
HEADING_PRODUCT = "phi0dot_phi0dot"  # zero when the ski's centre of mass is at A


def _by_position(before: Array, diagonal: Array, after: Array) -> Array:
    """Matrix equal to `before` where i < j, `diagonal` where i = j, `after` where i > j."""
    return np.triu(before, 1) + np.diag(diagonal) + np.tril(after, -1)


def _coefficients(m: Moments) -> tuple[dict[str, Array], dict[tuple[str, str], Array]]:
    """Tables K^kappa and L^(kappa, alpha) of section 9, each (n, n)."""
    one = np.ones_like(m.length)
    k_angle = _by_position(np.outer(m.length, m.first), m.second, np.outer(m.first, m.length))
    k_lower = _by_position(np.outer(one, m.first), m.first, np.outer(m.total, m.length))
    k_upper = _by_position(np.outer(one, m.first), m.above * m.length, np.outer(m.above, m.length))
    mixed = _by_position(np.outer(one, m.above), m.above, np.outer(m.total, one))
    by_angle = {"phi": k_angle, "psi": k_angle, "xi1": k_lower, "xi2": k_upper}
    by_length = {
        ("phi", "1"): k_lower.T,
        ("psi", "1"): k_lower.T,
        ("phi", "2"): k_upper.T,
        ("psi", "2"): k_upper.T,
        ("xi1", "1"): _by_position(np.outer(one, m.total), m.total, np.outer(m.total, one)),
        ("xi1", "2"): mixed,
        ("xi2", "1"): mixed.T,
        ("xi2", "2"): _by_position(np.outer(one, m.above), m.above, np.outer(m.above, one)),
    }
    return by_angle, by_length


def _row_vectors(d: Directions, m: Moments) -> dict[str, tuple[Array, Array]]:
    """Row kappa: its direction v_kappa (n, 3) and its first moment or mass sigma_kappa (n,)."""
    return {
        "phi": (d.e_phi, m.first),
        "psi": (d.e_psi, m.first),
        "xi1": (d.d, m.total),
        "xi2": (d.d, m.above),
    }


def chain_blocks(parameters: ChainParameters, state: ChainState) -> Blocks:
    """Compute the blocks of (4.1) for the pivoted chain.

    Keys are (block, row): blocks A B C1 C2 D E F1 F2 G H1 H2 of shape (n, n) and K of shape (n,), for the rows phi
    psi xi1 xi2. F, G and H come without their factor 2 and K without g, as (4.1) prints them. Rows and columns of
    segments that are no coordinates are left out, so C2, F2 and H2 have as many columns as there are xi_i2.
    Units: [kg m^2] between two angles, [kg m] between an angle and a length, [kg] between two lengths, where D, E, G count
    as columns of angles and F, H as columns of lengths; K [kg m] in the rows of angles, [kg] in those of lengths.
    """
    m, d = moments(parameters, state), directions(state)
    by_angle, by_length = _coefficients(m)
    blocks: Blocks = {}
    for row, (v, sigma) in _row_vectors(d, m).items():
        k = by_angle[row]
        blocks["A", row] = k * (v @ d.e_phi.T)
        blocks["B", row] = k * (v @ d.e_psi.T)
        blocks["D", row] = k * (v @ d.d_phi_phi.T)
        blocks["E", row] = -k * (v @ d.d.T)
        blocks["G", row] = k * (v @ d.d_phi_psi.T)
        for alpha in ("1", "2"):
            length = by_length[row, alpha]
            blocks["C" + alpha, row] = length * (v @ d.d.T)
            blocks["F" + alpha, row] = length * (v @ d.e_phi.T)
            blocks["H" + alpha, row] = length * (v @ d.e_psi.T)
        blocks["K", row] = sigma * (v @ parameters.up)
    return {key: _existing(parameters, *key, value) for key, value in blocks.items()}


def _existing(parameters: ChainParameters, block: str, row: str, value: Array) -> Array:
    """Leave out rows and columns of lengths that are no coordinates."""
    if row in ("xi1", "xi2"):
        value = value[parameters.present[:, int(row[-1]) - 1]]
    if block in ("C1", "C2", "F1", "F2", "H1", "H2"):
        value = value[..., parameters.present[:, int(block[-1]) - 1]]
    return value


def equation_blocks(parameters: ChainParameters, state: ChainState, form: str = "pivot") -> Blocks:
    """Compute all blocks of a form: `pivot`, `full`, `chaplygin` or `speed` (section 9).

    A chain row has shape (n, ...), a ski row drops that axis; a link column has shape (..., n), a ski column, a
    product of ski rates and K drop that axis. So ("A", "x") and ("X", "phi") are (n,), ("X", "x") and ("K", "x") ().

    The ski adds
        full       rows x y phi0,    columns X Y PHI0,     product phi0dot_phi0dot
        chaplygin  rows x phi0,      columns X PHI0,       products xdot_phi0dot, phi0dot_phi0dot
        speed      rows speed phi0,  columns SPEED PHI0,   products speed_phi0dot, phi0dot_phi0dot
    The chaplygin form divides by cos(phi0); the others are regular at any heading. Units as in `chain_blocks`; x, y and
    speed count as lengths, phi0 as an angle.
    """
    if form not in FORMS:
        raise ValueError(f"unknown form {form!r}; choose one of {', '.join(FORMS)}")
    blocks = chain_blocks(parameters, state)
    if form == "pivot":
        return blocks
    m, d = moments(parameters, state), directions(state)
    cos, sin = np.cos(state.phi0), np.sin(state.phi0)
    heading, left = np.array([cos, sin]), np.array([-sin, cos])
    moment = parameters.ski_mass * parameters.com_offset
    if form == "full":
        motions, drift = {"x": np.array([1.0, 0.0]), "y": np.array([0.0, 1.0])}, np.zeros(2)
    elif form == "chaplygin":  # ydot = xdot tan(phi0)
        motions, drift = {"x": np.array([1.0, sin / cos])}, np.array([0.0, 1.0 / cos**2])
    else:  # (xdot, ydot) = speed * heading
        motions, drift = {"speed": heading}, left
    planar = {
        "A": m.first[:, None] * d.e_phi,
        "B": m.first[:, None] * d.e_psi,
        "C1": m.total[:, None] * d.d,
        "C2": m.above[:, None] * d.d,
        "D": m.first[:, None] * d.d_phi_phi,
        "E": -m.first[:, None] * d.d,
        "F1": m.total[:, None] * d.e_phi,
        "F2": m.above[:, None] * d.e_phi,
        "G": m.first[:, None] * d.d_phi_psi,
        "H1": m.total[:, None] * d.e_psi,
        "H2": m.above[:, None] * d.e_psi,
    }
    for row, motion in motions.items():
        for block, value in planar.items():
            blocks[block, row] = _existing(parameters, block, row, value[:, :2] @ motion)
        for column, other in motions.items():
            blocks[column.upper(), row] = np.asarray(m.mass * (motion @ other))
        blocks["PHI0", row] = blocks[row.upper(), "phi0"] = np.asarray(moment * (motion @ left))
        blocks[HEADING_PRODUCT, row] = np.asarray(-moment * (motion @ heading))
        blocks["K", row] = np.asarray(m.mass * (motion @ parameters.up[:2]))
        if form in DRIFTS:
            blocks[DRIFTS[form], row] = np.asarray(m.mass * (motion @ drift))
    for block, value in planar.items():
        blocks[block, "phi0"] = np.zeros_like(_existing(parameters, block, "phi0", value[:, 0]))
    blocks["PHI0", "phi0"] = np.asarray(parameters.ski_inertia + moment * parameters.com_offset)
    blocks[HEADING_PRODUCT, "phi0"] = np.asarray(0.0)
    blocks["K", "phi0"] = np.asarray(moment * (left @ parameters.up[:2]))
    if form in DRIFTS:
        blocks[DRIFTS[form], "phi0"] = np.asarray(moment * (left @ drift))
    for row, (v, sigma) in _row_vectors(d, m).items():
        pull = sigma[:, None] * v[:, :2]  # p_kappa, (n, 2)
        for column, motion in motions.items():
            blocks[column.upper(), row] = _existing(parameters, column, row, pull @ motion)
        blocks["PHI0", row] = blocks[HEADING_PRODUCT, row] = np.zeros_like(blocks["K", row])
        if form in DRIFTS:
            blocks[DRIFTS[form], row] = _existing(parameters, DRIFTS[form], row, pull @ drift)
    return blocks
