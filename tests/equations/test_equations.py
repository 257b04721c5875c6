"""Equations of motion extracted from Pinocchio: the closed forms, the mass-point witness and symbolic derivations agree."""

from __future__ import annotations

import math
import subprocess
import sys
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vlmb
from tests.reference.chain_cases import make_case
from tests.reference.equation_cases import Table, closed_parameters, closed_state, random_posture, random_rates, random_scene
from tests.reference.symbolic import lagrange_equations
from tests.reference.witness import Witness
from vlmb.equations import blocks as equation_blocks
from vlmb.equations import closed_form
from vlmb.equations.motion import EquationsOfMotion, equations_of_motion
from vlmb.model.coordinates import kinematics
from vlmb.model.memory import make_data
from vlmb.system.system import make_system

TOLERANCE = 1e-12
FLOOR = 1e-3  # a block that nearly vanishes at a posture is judged by this part of the mass matrix's largest entry
FORMS = {"pivot": ("full",), "free": ("full",), "ski": ("full", "chaplygin", "speed")}
PRODUCT_RATES = {
    "D": ("phi", "phi"), "E": ("psi", "psi"), "G": ("phi", "psi"), "F1": ("phi", "xi1"), "F2": ("phi", "xi2"),
    "H1": ("psi", "xi1"), "H2": ("psi", "xi2"),
}  # fmt: skip


def built(table: Table) -> vlmb.Mechanism:
    return vlmb.build(vlmb.Scene.from_dict(table))


def witness_form(form: str, base: str) -> str:
    return form if base == "ski" else "pivot"


def worst_block(eom: EquationsOfMotion, expected: closed_form.Blocks) -> tuple[float, Any]:
    """Largest error of any block, relative to its largest entry."""
    assert set(eom.blocks) == set(expected)
    floor = FLOOR * np.abs(eom.mass_matrix).max()
    worst: tuple[float, Any] = (0.0, None)
    for key, value in expected.items():
        assert eom.blocks[key].shape == np.shape(value), key
        error = np.abs(eom.blocks[key] - value).max(initial=0.0) / max(np.abs(value).max(initial=0.0), floor)
        worst = max(worst, (float(error), key), key=lambda pair: pair[0])
    return worst


def assert_close(actual: Any, expected: Any, tolerance: float = TOLERANCE) -> None:
    actual, expected = np.asarray(actual), np.asarray(expected)
    assert actual.shape == expected.shape
    assert np.abs(actual - expected).max(initial=0.0) <= tolerance * np.abs(expected).max(initial=1e-300)


def check_against_closed_form(table: Table, postures: int, seed: int) -> None:
    base = table["base"]["kind"]
    mechanism, parameters = built(table), closed_parameters(table)
    rng = np.random.default_rng(seed)
    for k in range(postures):
        form = FORMS[base][k % len(FORMS[base])]
        coordinates, rates = random_posture(mechanism, rng), random_rates(mechanism, rng)
        eom = equations_of_motion(mechanism, coordinates, rates, form)
        state, name = closed_state(table, coordinates, rates), witness_form(form, base)
        assert eom.names == closed_form.coordinate_names(parameters, name)
        error, block = worst_block(eom, closed_form.equation_blocks(parameters, state, name))
        assert error < TOLERANCE, (form, block)
        assert_close(eom.mass_matrix, closed_form.mass_matrix(parameters, state, name))
        assert_close(eom.bias, closed_form.bias(parameters, state, name))


# Closed forms


@pytest.mark.parametrize(("n", "postures"), [(1, 30), (2, 30), (3, 30), (5, 30), (10, 15), (20, 9)])
@pytest.mark.parametrize("tips", ["all", "last", "none"])
@pytest.mark.parametrize("base", ["pivot", "ski"])
def test_blocks_equal_the_closed_forms(base: str, tips: str, n: int, postures: int) -> None:
    check_against_closed_form(random_scene(n, base, tips=tips), postures, seed=1)


@pytest.mark.parametrize("fixed", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("odd", [False, True])
@pytest.mark.parametrize("base", ["pivot", "ski"])
def test_plain_rods_and_fixed_segments(base: str, odd: bool, fixed: float) -> None:
    for n in (1, 2, 3, 5):
        check_against_closed_form(random_scene(n, base, seed=2, odd=odd, fixed=fixed), 9, seed=n)


def test_a_ski_alone() -> None:
    check_against_closed_form(random_scene(0, "ski"), 9, seed=3)


@pytest.mark.slow
def test_a_hundred_links() -> None:
    check_against_closed_form(random_scene(100, "ski", fixed=0.8), 3, seed=4)  # fixed: pinocchio.Data grows as nv^3


@pytest.mark.slow
@pytest.mark.parametrize("tips", ["all", "none"])
@pytest.mark.parametrize("base", ["pivot", "ski"])
def test_postures_of_fifty_links(base: str, tips: str) -> None:
    check_against_closed_form(random_scene(50, base, tips=tips), 6 if base == "ski" else 2, seed=5)


@pytest.mark.parametrize("base", ["pivot", "ski"])
def test_every_sign_matters(base: str) -> None:
    """The comparison above fails when any block has the other sign."""
    table = random_scene(3, base)
    mechanism, parameters = built(table), closed_parameters(table)
    coordinates = random_posture(mechanism, np.random.default_rng(6))
    state = closed_state(table, coordinates)
    for form in FORMS[base]:
        eom = equations_of_motion(mechanism, coordinates, form=form)
        expected = closed_form.equation_blocks(parameters, state, witness_form(form, base))
        assert worst_block(eom, expected)[0] < TOLERANCE
        flipped = [key for key, value in expected.items() if np.abs(value).max() > 1e-9]
        assert len(flipped) > 35
        for key in flipped:
            error, block = worst_block(eom, expected | {key: -expected[key]})
            assert error > 1e6 * TOLERANCE and block == key


def test_far_from_the_origin_nothing_changes() -> None:
    mechanism = built(random_scene(5, "ski", odd=False))
    coordinates = random_posture(mechanism, np.random.default_rng(7))
    near = equations_of_motion(mechanism, coordinates)
    far = equations_of_motion(mechanism, coordinates | {"x": 1e6, "y": -3e5})
    assert_close(far.mass_matrix, near.mass_matrix, 1e-15)
    assert_close(far.blocks["D", "psi"], near.blocks["D", "psi"], 1e-15)


@pytest.mark.parametrize("unit", [1e-4, 1e4])
def test_small_and_large_mechanisms_keep_their_digits(unit: float) -> None:
    """Velocity products of lengths and angles differ by a length; none drowns in the other."""
    table = random_scene(2, "ski")
    for link in table["links"]:
        link["rod"]["length"] *= unit
        link["rod"] |= {key: link["rod"][key] * unit**k for key, k in (("com", 1), ("inertia", 2)) if key in link["rod"]}
        for side in ("lower", "upper"):
            link[side]["length"] *= unit
    mechanism = built(table)
    coordinates = random_posture(mechanism, np.random.default_rng(8))
    coordinates |= {name: value * unit for name, value in coordinates.items() if name.startswith("xi")}
    eom = equations_of_motion(mechanism, coordinates)
    expected = closed_form.equation_blocks(closed_parameters(table), closed_state(table, coordinates), "full")
    for row in ("phi", "psi", "xi1", "xi2"):
        for block in ("F1", "F2", "H1", "H2", "G", "D"):
            assert_close(eom.blocks[block, row], expected[block, row])


# Other witnesses: symbolic Lagrange equations, mass points


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("ski", [False, True])
@pytest.mark.parametrize("n", [1, 2])
def test_symbolic_lagrange_equations(n: int, ski: bool, seed: int) -> None:
    case = make_case(n, ski, seed=30 + seed)
    gravity, slope, mass, inertia, offset = case.data[:5].tolist()
    links = [
        {"rod": {"length": a, "mass": m, "com": com, "inertia": i}, "lower": {"length": 0.0}, "upper": {"length": 0.0},
         "tip_mass": tip}
        for a, m, tip, com, i in case.data[5:].reshape(-1, 5).tolist()
    ]  # fmt: skip
    base = {"kind": "ski", "mass": mass, "inertia": inertia, "com_offset": offset} if ski else {"kind": "pivot"}
    mechanism = built({"base": base, "links": links, "slope": slope, "gravity": gravity})
    coordinates = dict(zip(case.names, case.q.tolist(), strict=True))
    rates = {f"{name}_dot": value for name, value in zip(case.names, case.v.tolist(), strict=True)}
    eom = equations_of_motion(mechanism, coordinates, rates)
    matrix, bias = lagrange_equations(n, ski)(case.q, case.v, case.data)
    assert list(eom.names) == case.names
    assert_close(eom.mass_matrix, matrix)
    assert_close(eom.bias, bias)


def a_tree(base: str, **changes: Any) -> Table:
    """Five links in scene order that is not depth-first, two of them on the base, hanging on every kind of point."""
    table = random_scene(5, base, seed=9, fixed=0.4)
    parents = [("base", "tip"), ("base", "tip"), ("link1", "rod_end"), ("link2", "tip"), ("link1", "rod_start")]
    for i, (link, (parent, point)) in enumerate(zip(table["links"], parents, strict=True)):
        link |= {"name": f"link{i + 1}", "parent": parent, "parent_point": point}
    return table | changes


@pytest.mark.parametrize("base", ["pivot", "ski", "free"])
def test_trees_against_mass_points(base: str) -> None:
    table = a_tree(base)
    mechanism, witness = built(table), Witness(table)
    rng = np.random.default_rng(10)
    for _ in range(20):
        coordinates, rates = random_posture(mechanism, rng), random_rates(mechanism, rng)
        eom = equations_of_motion(mechanism, coordinates, rates)
        assert list(eom.names) == list(witness.names)
        matrix, bias = witness.equations(coordinates, rates)
        assert_close(eom.mass_matrix, matrix)
        assert_close(eom.bias, bias)


@pytest.mark.parametrize("base", ["pivot", "ski", "free"])
def test_in_a_plane_every_azimuth_is_that_of_the_plane(base: str) -> None:
    """The plane's equations are those of the free mechanism along phi_i = phi0 (or 0)."""
    spatial = Witness(a_tree(base, slope=0.0 if base != "ski" else 0.3))
    mechanism = built(a_tree(base, plane=True, slope=0.0 if base != "ski" else 0.3))
    rng = np.random.default_rng(11)
    names = list(mechanism.coordinate_names)
    assert not any(name in names for name in ("phi1", "phi5", *(() if base == "ski" else ("y", "phi0"))))
    basis = np.zeros((len(spatial.names), len(names)))
    for at, name in enumerate(spatial.names):
        source = "phi0" if name.startswith("phi") else name
        if source in names:
            basis[at, names.index(source)] = 1.0
    for _ in range(5):
        coordinates, rates = random_posture(mechanism, rng), random_rates(mechanism, rng)
        eom = equations_of_motion(mechanism, coordinates, rates)
        every = dict(zip(spatial.names, (basis @ [coordinates[name] for name in names]).tolist(), strict=True))
        moving = dict(zip(spatial.names, (basis @ [rates[f"{name}_dot"] for name in names]).tolist(), strict=True))
        matrix, bias = spatial.equations(every, moving)
        assert_close(eom.mass_matrix, basis.T @ matrix @ basis)
        assert_close(eom.bias, basis.T @ bias)
        assert all(block not in ("A", "D") and row != "phi" for block, row in eom.blocks)


def from_blocks(eom: EquationsOfMotion) -> tuple[np.ndarray, np.ndarray]:
    """Mass matrix and bias put together again from the blocks, by the names of rows and columns."""
    rates = {name.removesuffix("_dot"): value for name, value in eom.rates.items()}
    heading = eom.coordinates.get("phi0", 0.0)
    if "speed" in eom.names:
        rates["speed"] = rates["x"] * math.cos(heading) + rates["y"] * math.sin(heading)
    places = {name: at for at, name in enumerate(eom.names)}
    matrix, bias = np.zeros((len(places), len(places))), np.zeros(len(places))
    for (block, row), value in eom.blocks.items():
        rows = [places[name] for name in eom.rows[row]]
        for column, entries in zip(eom.columns[block], value.reshape(len(rows), -1).T, strict=True):
            if column.endswith("_ddot") or column == "speed_dot":
                matrix[rows, places[column.removesuffix("_ddot").removesuffix("_dot")]] += entries
            elif column == "g":
                bias[rows] += eom.mechanism.scene.gravity * entries
            else:
                factors = column.replace("^2", f"*{column.removesuffix('^2')}").split("*")
                bias[rows] += entries * math.prod(
                    2.0 if factor == "2" else rates[factor.removesuffix("_dot")] for factor in factors
                )
    return matrix, bias


@pytest.mark.parametrize("plane", [False, True])
@pytest.mark.parametrize("base", ["pivot", "ski", "free"])
def test_blocks_with_their_names_make_the_equations(base: str, plane: bool) -> None:
    """(4.1) has every velocity product there is, in trees, in a plane and in each form."""
    mechanism = built(a_tree(base, plane=plane, gravity=3.7))
    rng = np.random.default_rng(12)
    for form in FORMS[base]:
        coordinates = random_posture(mechanism, rng)
        rates = random_rates(mechanism, rng, coordinates)
        eom = equations_of_motion(mechanism, coordinates, rates, form)
        matrix, bias = from_blocks(eom)
        assert_close(matrix, eom.mass_matrix, 1e-14)
        assert_close(bias, eom.bias, 1e-13)


@pytest.mark.parametrize("base", ["pivot", "ski"])
def test_block_rows_are_by_link(base: str) -> None:
    eom = equations_of_motion(built(a_tree(base)), random_posture(built(a_tree(base)), np.random.default_rng(13)))
    assert eom.rows["phi"] == tuple(f"phi{i}" for i in range(1, 6))
    assert eom.rows["xi1"] + eom.rows["xi2"] == tuple(
        sorted((name for name in eom.names if name.startswith("xi")), key=lambda name: (name[-1], name))
    )
    assert eom.columns["F1"] == tuple(f"2*phi{name[2]}_dot*{name}_dot" for name in eom.rows["xi1"])
    assert eom.blocks["C2", "phi"].shape == (5, len(eom.rows["xi2"]))
    for block, (_, second) in PRODUCT_RATES.items():
        assert len(eom.columns[block]) == len(eom.rows[second])


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 12), st.integers(0, 2**31), st.sampled_from(["pivot", "ski", "free"]))
def test_kinetic_energy_is_that_of_the_state(n: int, seed: int, base: str) -> None:
    table = random_scene(n, base, seed, fixed=0.4)
    table["base"] |= {"mass": 1.5} if base == "free" else {}
    mechanism = built(table)
    rng = np.random.default_rng(seed)
    coordinates, rates = random_posture(mechanism, rng), random_rates(mechanism, rng)
    matrix = equations_of_motion(mechanism, coordinates, rates).mass_matrix
    state = mechanism.state(coordinates, rates)
    energy = pin.computeKineticEnergy(mechanism.model, make_data(mechanism.model), state.q, state.v)
    speeds = np.array(list(rates.values()))
    np.testing.assert_array_equal(matrix, matrix.T)
    assert np.linalg.eigvalsh(matrix)[0] > 0.0
    assert 0.5 * speeds @ matrix @ speeds == pytest.approx(energy, rel=1e-12)


# Postures where the paper's coordinates fail

VERTICAL = {"psi1": math.pi / 2, "psi2": math.pi / 2, "psi3": -math.pi / 2}
IN_LINE = {"phi1": 0.7, "phi2": 0.7, "psi1": 0.4, "psi2": 0.4}
ACROSS = {"phi0": math.pi / 2}


@pytest.mark.parametrize("tips", ["none", "all"])
@pytest.mark.parametrize("change", [VERTICAL, IN_LINE, ACROSS, VERTICAL | ACROSS])
def test_poles_and_lined_up_links_have_their_matrices(change: dict[str, float], tips: str) -> None:
    table = random_scene(3, "ski", tips=tips)
    mechanism, parameters = built(table), closed_parameters(table)
    rng = np.random.default_rng(14)
    coordinates, rates = random_posture(mechanism, rng) | change, random_rates(mechanism, rng)
    for form in FORMS["ski"]:
        eom = equations_of_motion(mechanism, coordinates, rates, form)
        assert np.isfinite(eom.mass_matrix).all() and np.isfinite(eom.bias).all()
        assert all(np.isfinite(block).all() for block in eom.blocks.values())
        if form != "chaplygin" or "phi0" not in change:
            state = closed_state(table, coordinates, rates)
            assert worst_block(eom, closed_form.equation_blocks(parameters, state, form))[0] < TOLERANCE
            assert_close(eom.bias, closed_form.bias(parameters, state, form))


def test_condition_number() -> None:
    mechanism = built(random_scene(2, "pivot", tips="none", odd=False))
    coordinates = random_posture(mechanism, np.random.default_rng(15))
    eom = equations_of_motion(mechanism, coordinates)
    assert eom.condition == pytest.approx(np.linalg.cond(eom.mass_matrix), rel=1e-9)
    assert equations_of_motion(mechanism, coordinates | IN_LINE).condition > 1e14
    tilted = [equations_of_motion(mechanism, coordinates | {"psi1": math.pi / 2 - angle}).condition for angle in (1e-3, 1e-4)]
    assert tilted[1] / tilted[0] == pytest.approx(100.0, rel=0.01)  # as 1 / cos^2 psi


SINGULAR = [
    ("full", "all", {"psi2": math.pi / 2}, "phi2 of 'link2': psi2 at 90 deg"),
    ("speed", "all", {"psi2": -math.pi / 2}, "phi2 of 'link2': psi2 at 90 deg"),
    ("full", "none", IN_LINE, "xi1_2 of 'link1', xi2_1 of 'link2': the hinge between 'link1' and 'link2' has no mass"),
    ("chaplygin", "all", ACROSS, "acceleration of x: the ski points across x, .* use form='speed'"),
]


@pytest.mark.parametrize(("form", "tips", "change", "message"), SINGULAR)
def test_solving_a_singular_matrix_names_the_coordinates(form: str, tips: str, change: dict[str, float], message: str) -> None:
    mechanism = built(random_scene(2, "ski", tips=tips))
    coordinates = random_posture(mechanism, np.random.default_rng(16)) | change
    with pytest.raises(vlmb.SingularError, match=message):
        equations_of_motion(mechanism, coordinates, form=form).solve()
    harmless = "full" if form == "chaplygin" else form
    away = coordinates | {name: value - 0.02 for name, value in change.items() if name != "phi2"}
    assert np.isfinite(equations_of_motion(mechanism, away, form=harmless).solve().accelerations).all()


def test_close_to_a_pole_and_straight_long_chains_still_solve() -> None:
    mechanism = built(random_scene(1, "pivot", odd=False))
    coordinates = random_posture(mechanism, np.random.default_rng(17)) | {"psi1": math.pi / 2 - 1e-5}
    eom = equations_of_motion(mechanism, coordinates)
    assert_close(eom.mass_matrix @ eom.solve([1e-9, 2.0, 3.0, 1.0]).accelerations + eom.bias, [1e-9, 2.0, 3.0, 1.0])
    chain = built(random_scene(30, "pivot"))
    straight = dict.fromkeys(chain.coordinate_names, 0.3)
    eom = equations_of_motion(chain, straight)
    assert_close(eom.mass_matrix @ eom.solve().accelerations, -eom.bias, 1e-10)


# Accelerations


def coordinate_accelerations(
    mechanism: vlmb.Mechanism, near: dict[str, float], state: vlmb.State, vdot: np.ndarray
) -> dict[str, float]:
    """Second derivatives of the coordinates from Pinocchio's vdot: link by link omega' = omega_p' + R w' + omega x R w."""
    layout, (q, v) = mechanism.layout, state
    motion, values = kinematics(layout, q, v), mechanism.coordinates(state, near)
    found: dict[str, float] = {}
    growth = {-1: np.zeros(3)}
    if layout.base == "ski":
        cos, sin, turn = q[2], q[3], v[2]
        forward, left = vdot[0] - turn * v[1], vdot[1] + turn * v[0]
        found |= {"x": cos * forward - sin * left, "y": sin * forward + cos * left, "phi0": vdot[2]}
        growth[-1] = np.array([0.0, 0.0, vdot[2]])
    for i in layout.order:
        link, rotation, omega = layout.links[i], motion.rotations[i], motion.omegas[i]
        rate = rotation @ v[link.v : link.v + 3]
        growth[i] = growth[link.parent] + rotation @ vdot[link.v : link.v + 3] + np.cross(omega, rate)
        phi, psi = values[f"phi{i + 1}"], values[f"psi{i + 1}"]
        phi_rate, psi_rate = values[f"phi{i + 1}_dot"], values[f"psi{i + 1}_dot"]
        u_phi = np.array([-math.sin(phi), math.cos(phi), 0.0])
        u_psi = np.array([-math.cos(phi) * math.sin(psi), -math.sin(phi) * math.sin(psi), math.cos(psi)])
        found[f"phi{i + 1}"] = u_psi @ growth[i] / math.cos(psi) + 2.0 * math.tan(psi) * phi_rate * psi_rate
        found[f"psi{i + 1}"] = -u_phi @ growth[i] - math.sin(psi) * math.cos(psi) * phi_rate**2
        for which, segment in ((1, link.lower), (2, link.upper)):
            if segment.joint:
                found[f"xi{i + 1}_{which}"] = vdot[segment.v]
    return found


FORCES = {"M_phi1": 3.0, "M_psi1": -8.0, "F1_1": 25.0}
CHAINS = [(1, "all"), (1, "last"), (2, "all"), (2, "last"), (3, "all"), (5, "all"), (8, "all"), (20, "all"), (50, "all")]
MASSLESS_HINGES = [(3, "none"), (5, "last"), (10, "last"), (10, "none"), (20, "none"), (50, "none")]
ROUNDING = 2e-15  # of the condition number: what an acceleration may lose on ill-conditioned chains


@pytest.mark.parametrize(("n", "tips"), [*CHAINS, *MASSLESS_HINGES])
@pytest.mark.parametrize("base", ["pivot", "ski"])
def test_accelerations_of_all_forms_and_of_the_simulator_agree(base: str, n: int, tips: str) -> None:
    table = random_scene(n, base, tips=tips)
    applied = FORCES | ({"M_phi0": 2.0, "F_x": 4.0, "F_y": -7.0} if base == "ski" else {})
    mechanism = built(table | {"forces": [{"on": name, "law": value} for name, value in applied.items()]})
    workspace = make_system(mechanism, gain=0.0).workspace()
    rng = np.random.default_rng(18)
    for _ in range(10 if n < 20 else 3 if n < 50 else 1):
        coordinates = random_posture(mechanism, rng)
        rates = random_rates(mechanism, rng, coordinates)
        full = equations_of_motion(mechanism, coordinates, rates)
        tolerance = max(1e-11, ROUNDING * full.condition)
        assert tolerance == 1e-11 or (n, tips) not in CHAINS[:7]
        solution = full.solve(applied)
        accelerations = dict(zip(full.names, solution.accelerations, strict=True))
        state = mechanism.state(coordinates, rates)
        workspace.branch = list(coordinates.values())
        evaluation = workspace.evaluate(0.0, workspace.pack(state))
        simulated = coordinate_accelerations(mechanism, coordinates, state, evaluation.vdot)
        assert_close([simulated[name] for name in full.names], solution.accelerations, tolerance)
        if base == "pivot":
            assert solution.knife_edge is None
            continue
        load = np.abs(full.bias).max()
        assert solution.knife_edge == pytest.approx(evaluation.knife_edge, rel=tolerance, abs=tolerance * load)
        chaplygin = equations_of_motion(mechanism, coordinates, rates, "chaplygin")
        assert_close(chaplygin.solve(applied).accelerations, [accelerations[name] for name in chaplygin.names], tolerance)
        heading = coordinates["phi0"]
        accelerations["speed"] = math.cos(heading) * accelerations["x"] + math.sin(heading) * accelerations["y"]
        speed = equations_of_motion(mechanism, coordinates, rates, "speed")
        assert_close(speed.solve(applied).accelerations, [accelerations[name] for name in speed.names], tolerance)


def test_trees_move_as_in_the_simulator() -> None:
    mechanism = built(a_tree("ski"))
    rng = np.random.default_rng(19)
    coordinates = random_posture(mechanism, rng)
    rates = random_rates(mechanism, rng, coordinates)
    eom = equations_of_motion(mechanism, coordinates, rates)
    state, workspace = mechanism.state(coordinates, rates), make_system(mechanism, gain=0.0).workspace()
    simulated = coordinate_accelerations(mechanism, coordinates, state, workspace.evaluate(0.0, workspace.pack(state)).vdot)
    assert_close(eom.solve().accelerations, [simulated[name] for name in eom.names], 1e-11)


def test_forces_by_array_by_coordinate_and_by_name() -> None:
    mechanism = built(random_scene(1, "ski"))
    rng = np.random.default_rng(20)
    coordinates, rates = random_posture(mechanism, rng), {"speed": 2.0, "phi0_dot": 0.4}
    eom = equations_of_motion(mechanism, coordinates, rates, "speed")
    by_name = eom.solve({"F_x": 3.0, "M_psi1": 2.0}).accelerations
    by_coordinate = eom.solve({"x": 3.0, "psi1": 2.0}).accelerations
    along = 3.0 * math.cos(coordinates["phi0"])
    by_array = eom.solve([along, 0.0, 0.0, 2.0, 0.0, 0.0]).accelerations
    np.testing.assert_array_equal(by_name, by_coordinate)
    assert_close(by_array, by_name, 1e-14)
    assert np.abs(by_name - eom.solve().accelerations).max() > 1e-3


def test_known_acceleration_of_a_prescribed_segment_gives_its_force() -> None:
    table = random_scene(2, "ski")
    law = "0.3 + 0.05*sin(6*t) + 0.02*t"
    table["links"][0]["lower"] = {"motion": "prescribed", "law": law}
    mechanism = built(table)
    rng = np.random.default_rng(21)
    coordinates = random_posture(mechanism, rng)
    rates = random_rates(mechanism, rng, coordinates)
    t = 0.37
    coordinates["xi1_1"], rates["xi1_1_dot"] = 0.3 + 0.05 * math.sin(6 * t) + 0.02 * t, 0.3 * math.cos(6 * t) + 0.02
    eom = equations_of_motion(mechanism, coordinates, rates)
    solution = eom.solve(known={"xi1_1": -1.8 * math.sin(6 * t)})
    workspace = make_system(mechanism, gain=0.0).workspace()
    evaluation = workspace.evaluate(t, workspace.pack(mechanism.state(coordinates, rates)))
    assert solution.accelerations[eom.names.index("xi1_1")] == -1.8 * math.sin(6 * t)
    assert solution.forces == {"F1_1": pytest.approx(evaluation.controls["F1_1"], rel=1e-11)}
    assert solution.knife_edge == pytest.approx(evaluation.knife_edge, rel=1e-11)
    with pytest.raises(vlmb.SceneError, match=r"xi1_1 of 'link1' is prescribed: .*known="):
        eom.solve()


def test_any_known_acceleration_gives_the_force_it_takes() -> None:
    mechanism = built(random_scene(2, "pivot"))
    rng = np.random.default_rng(22)
    eom = equations_of_motion(mechanism, random_posture(mechanism, rng), random_rates(mechanism, rng))
    held = eom.solve({"M_psi2": 1.0}, known={"psi2": 0.0, "xi2_1": 1.5})
    assert set(held.forces) == {"M_psi2", "F2_1"}
    again = eom.solve({"M_psi2": 1.0 + held.forces["M_psi2"], "F2_1": held.forces["F2_1"]})
    assert_close(again.accelerations, held.accelerations, 1e-11)


# Speed of the ski, forms, laziness


def test_reduced_forms_read_the_velocity_along_the_ski() -> None:
    mechanism = built(random_scene(2, "ski"))
    coordinates = random_posture(mechanism, np.random.default_rng(23))
    cos, sin = math.cos(coordinates["phi0"]), math.sin(coordinates["phi0"])
    sliding = {"x_dot": 2.0 * cos - 0.7 * sin, "y_dot": 2.0 * sin + 0.7 * cos, "phi0_dot": 0.5}
    clean = equations_of_motion(mechanism, coordinates, {"speed": 2.0, "phi0_dot": 0.5}, "speed")
    assert clean.rates["x_dot"] == pytest.approx(2.0 * cos)
    assert_close(equations_of_motion(mechanism, coordinates, sliding, "speed").bias, clean.bias, 1e-13)
    one = equations_of_motion(mechanism, coordinates, {"x_dot": 2.0 * cos, "phi0_dot": 0.5}, "chaplygin")
    two = equations_of_motion(mechanism, coordinates, {"speed": 2.0, "phi0_dot": 0.5}, "chaplygin")
    assert_close(one.bias, two.bias, 1e-13)


def test_blocks_are_not_computed_unless_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism = built(random_scene(2, "ski"))
    coordinates = random_posture(mechanism, np.random.default_rng(24))
    expected = equations_of_motion(mechanism, coordinates)

    def refuse(*_: Any) -> None:
        raise AssertionError("blocks were computed")

    monkeypatch.setattr("vlmb.equations.motion.coefficients", refuse)
    eom = equations_of_motion(mechanism, coordinates)
    np.testing.assert_array_equal(eom.mass_matrix, expected.mass_matrix)
    np.testing.assert_array_equal(eom.bias, expected.bias)
    with pytest.raises(AssertionError, match="blocks were computed"):
        _ = eom.blocks


def test_inverse_dynamics_is_called_a_fixed_number_of_times_a_link(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    rnea = pin.rnea
    monkeypatch.setattr(equation_blocks.pin, "rnea", lambda *args: calls.append(1) or rnea(*args))
    counts = []
    for n in (4, 8):
        mechanism = built(random_scene(n, "pivot"))
        calls.clear()
        assert equations_of_motion(mechanism, random_posture(mechanism, np.random.default_rng(25))).blocks
        counts.append(len(calls))
    assert counts == [7 * 4 + 1, 7 * 8 + 1]


def test_matrices_are_read_only_and_outlive_other_postures() -> None:
    mechanism = built(random_scene(2, "ski"))
    rng = np.random.default_rng(26)
    first = equations_of_motion(mechanism, random_posture(mechanism, rng))
    kept = np.array(first.mass_matrix)
    later = equations_of_motion(mechanism, random_posture(mechanism, rng))
    assert np.abs(later.mass_matrix - kept).max() > 1e-3
    np.testing.assert_array_equal(first.mass_matrix, kept)
    assert_close(first.blocks["A", "phi"], kept[np.ix_([3, 7], [3, 7])], 1e-15)
    with pytest.raises(ValueError, match="read-only"):
        first.mass_matrix[0, 0] = 1.0
    np.testing.assert_array_equal(mechanism.model.gravity.linear, mechanism.scene.surface_gravity)


# Errors


REFUSED = [
    ({"psi2": math.nan}, r"psi2 of 'trunk' = nan: must be finite"),
    ({"phi0": math.inf}, r"phi0 of the ski = inf: must be finite"),
    ({"xi1_1": "long"}, r"xi1_1 of 'legs' = 'long': must be a number"),
    ({"psi3": 1.0}, r"unknown coordinate 'psi3'; did you mean 'psi2'"),
    ({"xi2_2": 0.1}, r"unknown coordinate 'xi2_2'; left out .* 'trunk': fixed"),
    ({"psi2": None}, r"missing coordinates: psi2 of 'trunk'"),
]


@pytest.mark.parametrize(("change", "message"), REFUSED)
def test_errors_name_the_coordinate_and_the_link(change: dict[str, Any], message: str) -> None:
    table = random_scene(2, "ski")
    table["links"][0]["name"], table["links"][1]["name"] = "legs", "trunk"
    table["links"][1]["upper"] = {"length": 0.2, "motion": "fixed"}
    mechanism = built(table)
    coordinates: dict[str, Any] = random_posture(mechanism, np.random.default_rng(27))
    assert equations_of_motion(mechanism, coordinates).mass_matrix.shape == (10, 10)
    coordinates = {name: value for name, value in (coordinates | change).items() if value is not None}
    with pytest.raises(vlmb.SceneError, match=message):
        equations_of_motion(mechanism, coordinates)


def test_other_errors() -> None:
    mechanism = built(random_scene(1, "ski"))
    posture = random_posture(mechanism, np.random.default_rng(28))
    with pytest.raises(vlmb.SceneError, match="unknown rate 'phi1'; did you mean 'phi1_dot'"):
        equations_of_motion(mechanism, posture, {"phi1": 1.0})
    with pytest.raises(vlmb.SceneError, match="psi1_dot of 'link1' = nan"):
        equations_of_motion(mechanism, posture, {"psi1_dot": math.nan})
    with pytest.raises(vlmb.SceneError, match="either speed or x_dot"):
        equations_of_motion(mechanism, posture, {"speed": 1.0, "x_dot": 1.0})
    with pytest.raises(vlmb.SceneError, match="unknown form 'ful'; allowed: full, chaplygin, speed"):
        equations_of_motion(mechanism, posture, form="ful")
    eom = equations_of_motion(mechanism, posture)
    with pytest.raises(vlmb.SceneError, match="unknown force 'M_psi2'; did you mean 'M_psi1'"):
        eom.solve({"M_psi2": 1.0})
    with pytest.raises(vlmb.SceneError, match=r"shape \(2,\), must be \(7,\): x, y, phi0"):
        eom.solve([1.0, 2.0])
    with pytest.raises(vlmb.SceneError, match=r"the force M_psi1 = inf: must be finite"):
        eom.solve({"M_psi1": math.inf})
    with pytest.raises(vlmb.SceneError, match="generalized force of psi1 is not finite"):
        eom.solve([0.0, 0.0, 0.0, 0.0, math.nan, 0.0, 0.0])
    with pytest.raises(vlmb.SceneError, match="known accelerations: 'x' cannot be given"):
        eom.solve(known={"x": 0.0})
    with pytest.raises(vlmb.SceneError, match=r"known acceleration of psi1 = nan"):
        eom.solve(known={"psi1": math.nan})
    pivot = built(random_scene(1, "pivot"))
    with pytest.raises(vlmb.SceneError, match="unknown form 'speed' of a 'pivot' base; allowed: full"):
        equations_of_motion(pivot, random_posture(pivot, np.random.default_rng(29)), form="speed")
    plane = built(random_scene(1, "pivot", odd=False) | {"plane": True})
    with pytest.raises(vlmb.SceneError, match="unknown coordinate 'phi1'; with plane = true"):
        equations_of_motion(plane, {"phi1": 0.0, "psi1": 0.0, "xi1_1": 0.2, "xi1_2": 0.2})
    huge = equations_of_motion(pivot, random_posture(pivot, np.random.default_rng(30)) | {"xi1_1": 1e200})
    with pytest.raises(vlmb.SingularError, match="not finite at this posture"):
        huge.solve()


@pytest.mark.parametrize("value", ["a", None, [1.0], math.inf])
def test_forces_and_accelerations_are_finite_numbers(value: Any) -> None:
    mechanism = built(random_scene(1, "pivot"))
    eom = equations_of_motion(mechanism, random_posture(mechanism, np.random.default_rng(3)))
    with pytest.raises(vlmb.SceneError, match=r"the force M_psi1 = .*: must be"):
        eom.solve({"M_psi1": value})
    with pytest.raises(vlmb.SceneError, match=r"known acceleration of psi1 = .*: must be"):
        eom.solve(known={"psi1": value})
    with pytest.raises(vlmb.SceneError, match=r"generalized force.*(must be|is not finite)"):
        eom.solve([value] * len(eom.names))


def test_modules_that_few_need_are_there_when_asked_for() -> None:
    code = (
        "import sys, vlmb; assert 'vlmb.equations.closed_form' not in sys.modules; "
        "assert vlmb.closed_form.eq_4_2 and vlmb.hinge_moments.generalized_from_hinge_moments"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
