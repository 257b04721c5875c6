"""One mass matrix for all phases: rows crossed out give the pivoted chain and the ski's (7.13), and nothing turns the heading."""

from __future__ import annotations

import numpy as np

import vlmb
from tests.small_scenes import FLYING, PIVOT, SKI, bent

HEADING = 0.3
POSTURE = {"phi0": HEADING, "phi1": 0.4, "psi1": 0.7, "phi2": 1.3, "psi2": 0.2}
LENGTHS = {"xi1_1": 0.35, "xi1_2": 0.15, "xi2_1": 0.28, "xi2_2": 0.22}


def equations(base: dict[str, object], form: str = "full") -> vlmb.EquationsOfMotion:
    """Equations of a bent chain of two links at one posture."""
    mechanism = vlmb.build(bent(base))
    posture = {name: (POSTURE | LENGTHS).get(name, 0.0) for name in mechanism.layout.names}
    return vlmb.equations_of_motion(mechanism, posture, form=form)


def test_a_phase_crosses_out_rows_of_one_matrix() -> None:
    flying, standing = equations(FLYING), equations(PIVOT)
    free, chain = flying.mass_matrix, standing.mass_matrix
    assert flying.names[3:] == standing.names
    np.testing.assert_allclose(free[3:, 3:], chain, rtol=1e-13, atol=1e-13)  # the foot at the root stands
    total = free[0, 0]
    np.testing.assert_allclose(free[:3, :3], total * np.eye(3), atol=1e-13)
    weight = np.concatenate([np.ravel(standing.blocks["K", row]) for row in ("phi", "psi", "xi1", "xi2")])
    np.testing.assert_allclose(np.sort(free[2, 3:]), np.sort(weight), atol=1e-13)  # (P z)_j is what gravity does


def test_a_ski_on_the_snow_is_7_13() -> None:
    ski = {**SKI, "com_offset": 0.0, "mass": FLYING["mass"]}
    free, on_snow = equations(FLYING).mass_matrix, equations(ski, "chaplygin").mass_matrix
    along = np.array([1.0, np.tan(HEADING), 0.0])
    np.testing.assert_allclose(on_snow[0, 0], free[0, 0] / np.cos(HEADING) ** 2, rtol=1e-14)
    np.testing.assert_allclose(on_snow[0, 2:], along @ free[:3, 3:], rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(on_snow[2:, 2:], free[3:, 3:], rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(on_snow[1], SKI["inertia"] * np.eye(len(on_snow))[1], atol=1e-14)  # phi0 is coupled to nothing


def test_a_landing_on_any_feet_of_the_base_turns_no_ski() -> None:
    """Impulses at A have no row of the heading, and its column of the inverse is its own."""
    ski = {**SKI, "com_offset": 0.0}
    whole = equations(ski).mass_matrix  # x, y, phi0, chain
    jacobian = np.zeros((2, len(whole)))
    jacobian[0, 0] = jacobian[1, 1] = 1.0
    change = np.linalg.solve(whole, jacobian.T @ np.array([3.0, -2.0]))
    assert abs(change[2]) < 1e-14 * np.abs(change).max() and np.abs(change[3:]).max() > 0.1
