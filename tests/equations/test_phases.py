"""One mass matrix for all phases: rows crossed out give the pivoted chain and the ski's (7.13), and nothing turns the heading."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import vlmb
from tests.reference.planar_walker import ORDER, walker
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


WALKER = Path(__file__).resolve().parents[2] / "models" / "figure_walker.toml"
STANDS = dict(zip(ORDER, (0.1, 0.9, 1.5, 0.11, -1.7, 0.46, -1.3, 0.42, -1.2, -1.9), strict=True))
MOVES = {f"{name}_dot": value for name, value in zip(ORDER, (1.1, -0.2, 0.3, 0.1, -1.4, 0.2, 2.1, -0.5, -0.8, 0.6), strict=True)}


@pytest.mark.parametrize("closed", [(), ("left",), ("right",), ("right", "left")])
def test_the_matrices_of_each_phase_of_the_walker_are_those_by_hand(closed: tuple[str, ...]) -> None:
    mechanism = vlmb.build(WALKER)
    eom = vlmb.equations_of_motion(mechanism, STANDS, MOVES, closed=closed)
    c, rates = np.array([STANDS[name] for name in ORDER]), np.array([MOVES[f"{name}_dot"] for name in ORDER])
    by_hand = walker(mechanism.scene, c, rates)
    assert eom.names == ORDER
    np.testing.assert_allclose(eom.mass_matrix, by_hand.mass, atol=1e-12 * np.abs(by_hand.mass).max())
    np.testing.assert_allclose(eom.bias, by_hand.bias, atol=1e-12 * np.abs(by_hand.bias).max())
    total = by_hand.mass[0, 0]  # the structure of (7.13): the whole mass along x and z, not coupled to each other
    np.testing.assert_allclose(eom.mass_matrix[:2, :2], total * np.eye(2), atol=1e-12 * total)
    phase = eom.phase
    assert phase.names == tuple(f"{foot}.{axis}" for foot in closed for axis in "zx")
    if not closed:
        return
    rows = np.vstack([by_hand.feet[name].jacobian for name in closed])
    np.testing.assert_allclose(phase.jacobian, rows, atol=1e-12)
    np.testing.assert_allclose(phase.drift, np.concatenate([by_hand.feet[name].drift for name in closed]), atol=1e-12)
    assert phase.supported == ORDER[2:]
    onto = np.vstack([-rows[1::-1, 2:], np.eye(8)])  # the first foot stands: hip and all move about it
    carried = np.concatenate([-by_hand.feet[closed[0]].drift[::-1], np.zeros(8)])
    reduced = onto.T @ by_hand.mass @ onto
    np.testing.assert_allclose(eom.supported_mass_matrix, reduced, atol=1e-12 * np.abs(reduced).max())
    bias = onto.T @ (by_hand.bias + by_hand.mass @ carried)
    np.testing.assert_allclose(eom.supported_bias, bias, atol=1e-12 * np.abs(by_hand.bias).max())


def test_a_walker_on_one_foot_is_the_pivoted_chain() -> None:
    """Two links in a plane from a foot that stands: (4.2) of the chain that is pinned there, by other formulas."""
    leg = {"rod": {"length": 0.5, "mass": 2.0}, "lower": {"length": 0.2}, "upper": {"length": 0.1}, "tip_mass": 1.5}
    links = [{"name": "leg", **leg}, {"name": "body", **leg}]
    flying = vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "free", "mass": 3.0}, "links": links, "contacts": [{"name": "foot", "point": "base"}],
    })
    pinned = vlmb.Scene.from_dict({"plane": True, "base": {"kind": "pivot"}, "links": links})
    posture = {"psi1": 1.9, "psi2": 1.2, "xi1_1": 0.25, "xi1_2": 0.12, "xi2_1": 0.22, "xi2_2": 0.15}
    rates = {"psi1_dot": -1.0, "xi1_1_dot": 0.4, "psi2_dot": 2.0}
    stands = vlmb.equations_of_motion(vlmb.build(flying), {**posture, "x": 0.0, "z": 0.0}, rates, closed=["foot"])
    chain = vlmb.equations_of_motion(vlmb.build(pinned), posture, rates)
    assert stands.phase.supported == chain.names
    np.testing.assert_allclose(stands.supported_mass_matrix, chain.mass_matrix, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(stands.supported_bias, chain.bias, rtol=1e-12, atol=1e-12)


def test_phases_of_what_is_not_there_are_named() -> None:
    mechanism = vlmb.build(WALKER)
    with pytest.raises(vlmb.SceneError, match="no contact 'lft'; did you mean 'left'"):
        vlmb.equations_of_motion(mechanism, STANDS, closed=["lft"]).phase  # noqa: B018
