"""The closed forms agree with equations derived afresh, and every sign in them matters."""

from __future__ import annotations

import ast
import math
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vlmb.equations.closed_form as closed_form
from tests.reference import chain_cases
from tests.reference.chain_cases import Array, Case, make_case, mismatch, products, reference, reference_form
from tests.reference.symbolic import energies, exact_equations, lagrange_equations, squared_speed, uniform_rod
from vlmb.equations.closed_form import (
    Blocks,
    assemble_bias,
    assemble_mass_matrix,
    bias,
    chain_parameters,
    chain_state,
    coordinate_names,
    equation_blocks,
    kinetic_energy,
    mass_matrix,
    potential_energy,
)

TOLERANCE = 1e-12
FORMS = ("pivot", "full", "chaplygin", "speed")
CHAIN_ROWS = ("phi", "psi", "xi1", "xi2")
LINK_BLOCKS = ("A", "B", "C1", "C2", "D", "E", "F1", "F2", "G", "H1", "H2")
MODULES = [sys.modules[f"vlmb.equations.closed_form.{name}"] for name in ("parameters", "blocks", "assembly", "pivot", "skier")]


def indices(case: Case, kind: str) -> list[int]:
    """Positions in q of the coordinates of one kind, link by link."""
    names = [f"{kind}{i}" if "xi" not in kind else f"xi{i}_{kind[-1]}" for i in range(1, case.n + 1)]
    return [case.names.index(name) for name in (names if kind in CHAIN_ROWS else [kind])]


# Blocks


@pytest.mark.parametrize("tips", ["all", "last", "none"])
@pytest.mark.parametrize("ski", [False, True])
@pytest.mark.parametrize("n", [1, 2, 3])
def test_blocks_are_the_coefficients_of_lagranges_equations(n: int, ski: bool, tips: str) -> None:
    case = make_case(n, ski, seed=1, tips=tips)
    blocks = equation_blocks(case.parameters(), case.state(), "full" if ski else "pivot")
    matrix, coefficients = reference(case)[0], products(case)
    gravity = reference(case, np.zeros(len(case.q)), gravity=1.0)[1]
    scale = float(np.abs(matrix).max())
    factors = {"A": "phi", "B": "psi", "C1": "xi1", "C2": "xi2"}
    pairs = {"D": "phi phi", "E": "psi psi", "G": "phi psi"}
    pairs |= {f"{letter}{a}": f"{rate} xi{a}" for letter, rate in (("F", "phi"), ("H", "psi")) for a in (1, 2)}
    seen = set()

    def compare(block: str, row: str, expected: Array) -> None:
        size = float(np.abs(expected).max())
        size = size if size > TOLERANCE * scale else scale  # a block that vanishes
        assert mismatch(blocks[block, row], expected, size) < TOLERANCE, (block, row)
        seen.add((block, row))

    for row in CHAIN_ROWS + (("x", "y", "phi0") if ski else ()):
        i = indices(case, row)
        shape = (-1,) if row in CHAIN_ROWS else ()
        for block, kind in factors.items():
            compare(block, row, matrix[np.ix_(i, indices(case, kind))].reshape(*shape, n))
        for block, rates in pairs.items():
            j, k = (indices(case, kind) for kind in rates.split())
            compare(block, row, coefficients[i][:, j, k].reshape(*shape, n))
            coefficients[np.ix_(i, j, k)] -= coefficients[i][:, j, k][:, :, None] * np.eye(n)
            if j != k:
                coefficients[np.ix_(i, k, j)] -= coefficients[i][:, k, j][:, :, None] * np.eye(n)
        compare("K", row, gravity[i].reshape(shape))
        if ski:
            for column in ("x", "y", "phi0"):
                compare(column.upper(), row, matrix[i, indices(case, column)].reshape(shape))
            heading = case.names.index("phi0")
            compare("phi0dot_phi0dot", row, coefficients[i, heading, heading].reshape(shape))
            coefficients[i, heading, heading] = 0.0
    assert seen == set(blocks)
    assert np.abs(coefficients).max() < TOLERANCE * scale  # (4.1) has every velocity product there is


@pytest.mark.parametrize("form", ["full", "chaplygin", "speed"])
def test_contract_keys_and_shapes(form: str) -> None:
    present = [[True, False], [True, True], [False, True]]
    case = make_case(3, True, seed=2)
    blocks = equation_blocks(case.parameters(present), case.state(), form)
    ski_rows = {"full": ["x", "y", "phi0"], "chaplygin": ["x", "phi0"], "speed": ["speed", "phi0"]}[form]
    heights = {"phi": (3,), "psi": (3,), "xi1": (2,), "xi2": (2,)} | dict.fromkeys(ski_rows, ())
    widths: dict[str, tuple[int, ...]] = dict.fromkeys("ABDEG", (3,))
    widths |= {f"{letter}{a}": (2,) for letter in "CFH" for a in (1, 2)}
    widths |= dict.fromkeys(["K", "phi0dot_phi0dot", *(row.upper() for row in ski_rows)], ())
    widths |= {"chaplygin": {"xdot_phi0dot": ()}, "speed": {"speed_phi0dot": ()}, "full": {}}[form]
    expected = {(block, row): heights[row] + width for block, width in widths.items() for row in heights}
    assert {key: np.shape(value) for key, value in blocks.items()} == expected


def test_unknown_form_is_refused() -> None:
    case = make_case(1, True, seed=0)
    with pytest.raises(ValueError, match="pivot, full, chaplygin, speed"):
        equation_blocks(case.parameters(), case.state(), "ful")


# Assembled rows


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("n", [0, 1, 2, 3])
@pytest.mark.parametrize("form", FORMS)
def test_rows_match_the_derivation(form: str, n: int, seed: int) -> None:
    if form == "pivot" and n == 0:
        n = 3
    case = make_case(n, form != "pivot", seed=10 + seed)
    expected_matrix, expected_bias = reference_form(case, form)
    assert mismatch(mass_matrix(case.parameters(), case.state(), form), expected_matrix) < TOLERANCE
    assert mismatch(bias(case.parameters(), case.state(), form), expected_bias) < TOLERANCE


@pytest.mark.parametrize("tips", ["all", "last", "none"])
@pytest.mark.parametrize("form", FORMS)
def test_eight_links_match_the_particles(form: str, tips: str) -> None:
    case = make_case(8, form != "pivot", seed=3, tips=tips)
    expected_matrix, expected_bias = reference_form(case, form)
    assert mismatch(mass_matrix(case.parameters(), case.state(), form), expected_matrix) < TOLERANCE
    assert mismatch(bias(case.parameters(), case.state(), form), expected_bias) < TOLERANCE


def test_symbolic_and_particle_derivations_agree() -> None:
    case = make_case(3, True, seed=4)
    symbolic = lagrange_equations(3, True)(case.q, case.v, case.data)
    exact = exact_equations(3, True, case.q, case.v, case.data)
    assert mismatch(symbolic[0], exact[0]) < 1e-14
    assert mismatch(symbolic[1], exact[1]) < 1e-13


@pytest.mark.parametrize("present", [[[True, False], [False, True], [False, False]], [[False, False]] * 3])
@pytest.mark.parametrize("form", FORMS)
def test_absent_lengths_lose_their_row_and_column(form: str, present: list[list[bool]]) -> None:
    case = make_case(3, form != "pivot", seed=5)
    state = case.state()
    state.xi_dot[~np.array(present)] = 0.0
    every, some = case.parameters(), case.parameters(present)
    names = coordinate_names(every, form)
    keep = [names.index(name) for name in coordinate_names(some, form)]
    assert len(keep) == len(names) - 6 + np.sum(present)
    np.testing.assert_array_equal(mass_matrix(some, state, form), mass_matrix(every, state, form)[np.ix_(keep, keep)])
    np.testing.assert_allclose(bias(some, state, form), bias(every, state, form)[keep], rtol=1e-13)


def test_names_come_in_the_project_order() -> None:
    bare = chain_parameters([1.0, 1.0], 1.0)
    links = ("phi1", "psi1", "xi1_1", "xi1_2", "phi2", "psi2", "xi2_1")
    assert coordinate_names(bare) == links
    loaded = chain_parameters([1.0, 1.0], 1.0, [0.0, 2.0])
    assert coordinate_names(loaded, "full") == ("x", "y", "phi0", *links, "xi2_2")
    assert coordinate_names(loaded, "chaplygin") == ("x", "phi0", *links, "xi2_2")
    assert coordinate_names(loaded, "speed") == ("speed", "phi0", *links, "xi2_2")
    fixed = chain_parameters([1.0, 1.0], 1.0, [0.0, 2.0], present=[[False, True], [False, False]])
    assert coordinate_names(fixed) == ("phi1", "psi1", "xi1_2", "phi2", "psi2")


def test_state_from_names() -> None:
    coordinates = {"phi1": 0.1, "psi1": 0.2, "xi1_2": 0.3, "phi0": 0.5, "x": 1.0}
    state = chain_state(1, coordinates, {"speed": 2.0, "xi1_2_dot": 0.7}, lengths=[[0.25, 9.0]])
    np.testing.assert_array_equal(state.xi, [[0.25, 0.3]])
    np.testing.assert_array_equal(state.xi_dot, [[0.0, 0.7]])
    assert (state.x_dot, state.y_dot) == pytest.approx((2 * math.cos(0.5), 2 * math.sin(0.5)))
    assert state.speed == pytest.approx(2.0)
    with pytest.raises(KeyError, match="psi1"):
        chain_state(1, {"phi1": 0.0})


def test_rods_are_thin_and_uniform_by_default() -> None:
    parameters = chain_parameters([0.7, 1.3], [2.0, 5.0])
    com, inertia = uniform_rod()
    for i, (length, mass) in enumerate([(0.7, 2.0), (1.3, 5.0)]):
        assert parameters.rod_com[i] == pytest.approx(com(length, mass), rel=1e-15)
        assert parameters.rod_inertia[i] == pytest.approx(inertia(length, mass), rel=1e-15)


# Energies and accelerations


@pytest.mark.parametrize("ski", [False, True])
@pytest.mark.parametrize("n", [1, 2, 3])
def test_energies(n: int, ski: bool) -> None:
    case = make_case(n, ski, seed=6)
    kinetic, potential = energies(n, ski)(case.q, case.v, case.data)
    assert kinetic_energy(case.parameters(), case.state()) == pytest.approx(kinetic, rel=TOLERANCE)
    assert potential_energy(case.parameters(), case.state()) == pytest.approx(potential, rel=TOLERANCE)


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_kinetic_energy_is_the_mass_matrix_and_positive(n: int, seed: int) -> None:
    case = make_case(n, True, seed=seed)
    matrix = mass_matrix(case.parameters(), case.state(), "full")
    assert mismatch(matrix, matrix.T) < 1e-14
    energy = kinetic_energy(case.parameters(), case.state())
    assert energy == pytest.approx(0.5 * case.v @ matrix @ case.v, rel=1e-11)
    assert energy > 0


@pytest.mark.parametrize("n", [1, 2, 3, 8])
def test_multiplier_chaplygin_and_speed_forms_move_alike(n: int) -> None:
    case = make_case(n, True, seed=7)
    tan, cos, sin = math.tan(case.q[2]), math.cos(case.q[2]), math.sin(case.q[2])
    case.v[1] = case.v[0] * tan  # on the knife edge
    force = np.random.default_rng(n).uniform(-5, 5, len(case.q))
    p, s = case.parameters(), case.state()
    row = np.zeros(len(case.q))
    row[:2] = tan, -1.0
    kkt = np.block([[mass_matrix(p, s, "full"), -row[:, None]], [row[None, :], np.zeros((1, 1))]])
    right = np.append(force - bias(p, s, "full"), -s.x_dot * s.phi0_dot / cos**2)
    full = np.linalg.solve(kkt, right)[:-1]
    along_x = np.concatenate([[force[0] + tan * force[1]], force[2:]])
    chaplygin = np.linalg.solve(mass_matrix(p, s, "chaplygin"), along_x - bias(p, s, "chaplygin"))
    along_ski = np.concatenate([[cos * force[0] + sin * force[1]], force[2:]])
    speed = np.linalg.solve(mass_matrix(p, s, "speed"), along_ski - bias(p, s, "speed"))
    assert mismatch(chaplygin, np.delete(full, 1)) < 1e-11
    assert mismatch(speed[1:], full[2:]) < 1e-11
    assert speed[0] == pytest.approx(cos * full[0] + sin * full[1], rel=1e-9, abs=1e-9)


def test_speed_form_is_regular_across_the_fall_line() -> None:
    case = make_case(2, True, seed=8)
    case.q[2] = math.pi / 2
    expected_matrix, expected_bias = reference_form(case, "speed")
    assert mismatch(mass_matrix(case.parameters(), case.state(), "speed"), expected_matrix) < TOLERANCE
    assert mismatch(bias(case.parameters(), case.state(), "speed"), expected_bias) < TOLERANCE


# Numbered formulas

PIVOTED = make_case(1, False, seed=20, tips="none", uniform=True)
PAIR = make_case(2, False, seed=21, tips="none", uniform=True)
SKIER = make_case(1, True, seed=22, uniform=True)
LONG_SKIER = make_case(3, True, seed=23, tips="last", uniform=True)
DISTANCES = (0.0, 0.37, 0.9)


def row_of(case: Case, name: str, form: str) -> float:
    """Left side of one row at the case's accelerations, from the derivation."""
    matrix, h = reference_form(case, form)
    names = coordinate_names(case.parameters(), form)
    return float(matrix[names.index(name)] @ case.a[len(case.a) - len(names) :] + h[names.index(name)])


def fixed_chain(n: int) -> tuple[Case, Array]:
    """Case of (4.2) with the azimuth block of its mass matrix."""
    case = make_case(n, False, seed=24, tips="none", uniform=True)
    i = indices(case, "phi")
    return case, reference(case)[0][np.ix_(i, i)]


def numbered_checks() -> dict[str, tuple[Callable[[Any], Any], Any]]:
    """Map each numbered formula to (evaluation of it in a module, value derived afresh)."""
    checks: dict[str, tuple[Callable[[Any], Any], Any]] = {}

    def state_formula(name: str, case: Case, expected: Any, *more: Any) -> None:
        checks[name] = (lambda m: getattr(m, f"eq_{name}")(case.parameters(), case.state(), *more), expected)

    speeds = [squared_speed(1, 1)(PIVOTED.q, PIVOTED.v, PIVOTED.data, s) for s in DISTANCES]
    state_formula("2_3", PIVOTED, speeds, DISTANCES)
    kinetic, potential = energies(1, False)(PIVOTED.q, PIVOTED.v, PIVOTED.data)
    state_formula("2_5", PIVOTED, kinetic)
    state_formula("2_6", PIVOTED, potential)
    for name, row in {"2_7": "phi1", "2_8": "psi1", "2_9": "xi1_1"}.items():
        state_formula(name, PIVOTED, row_of(PIVOTED, row, "pivot"), PIVOTED.a[:3])
    state_formula("3_1", PAIR, squared_speed(2, 1, end=True)(PAIR.q, PAIR.v, PAIR.data, 0.0))
    speeds = [squared_speed(2, 2)(PAIR.q, PAIR.v, PAIR.data, s) for s in DISTANCES]
    state_formula("3_2", PAIR, speeds, DISTANCES)
    state_formula("3_3", PAIR, row_of(PAIR, "xi2_1", "pivot"), PAIR.a[:7])
    case, block = fixed_chain(3)
    state_formula("4_2", case, block)
    state_formula("7_2", SKIER, energies(1, True)(SKIER.q, SKIER.v, SKIER.data)[0])
    rows = {"7_7": "x", "7_8": "phi0", "7_9": "phi1", "7_10": "psi1", "7_11": "xi1_1", "7_12": "xi1_2"}
    for name, row in rows.items():
        state_formula(name, SKIER, row_of(SKIER, row, "chaplygin"), SKIER.a[1:])
    matrix = reference_form(LONG_SKIER, "chaplygin")[0]
    names = coordinate_names(LONG_SKIER.parameters(), "chaplygin")
    turning = [names.index(name) for name in ("x", "phi0", "phi1", "phi2", "phi3")]
    matrix = matrix[np.ix_(turning, turning)]
    state_formula("7_13", LONG_SKIER, matrix)
    state_formula("7_14", LONG_SKIER, [matrix[0, 0], matrix[1, 1]])
    state_formula("7_15", LONG_SKIER, matrix[0, 2:])
    state_formula("7_16", LONG_SKIER, matrix[2:, 2:])
    return checks


NUMBERED = ["2_3", "2_5", "2_6", "2_7", "2_8", "2_9", "3_1", "3_2", "3_3", "4_2"]
NUMBERED += ["7_2", *(f"7_{k}" for k in range(7, 17))]


@pytest.fixture(scope="module")
def checks() -> dict[str, tuple[Callable[[Any], Any], Any]]:
    return numbered_checks()


def test_every_numbered_formula_is_checked(checks: dict[str, Any]) -> None:
    assert sorted(checks) == sorted(NUMBERED)
    assert sorted(name[3:] for name in closed_form.__all__ if name.startswith("eq_")) == sorted(NUMBERED)


@pytest.mark.parametrize("name", NUMBERED)
def test_numbered_formula(name: str, checks: dict[str, tuple[Callable[[Any], Any], Any]]) -> None:
    evaluate, expected = checks[name]
    assert mismatch(evaluate(closed_form), expected) < TOLERANCE


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("name", ["7_7", "7_9", "7_10", "7_11", "7_12"])
def test_skier_rows_at_other_states(name: str, seed: int) -> None:
    case = make_case(1, True, seed=30 + seed, uniform=True)
    rows = {"7_7": "x", "7_9": "phi1", "7_10": "psi1", "7_11": "xi1_1", "7_12": "xi1_2"}
    value = getattr(closed_form, f"eq_{name}")(case.parameters(), case.state(), case.a[1:])
    assert value == pytest.approx(row_of(case, rows[name], "chaplygin"), rel=1e-11)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_fixed_chain_matrix(n: int) -> None:
    case, expected = fixed_chain(n)
    assert mismatch(closed_form.eq_4_2(case.parameters(), case.state()), expected) < TOLERANCE


# Negative controls: a wrong sign anywhere must be seen


def block_faults() -> Iterator[tuple[str, str, str]]:
    """Every non-zero part of every block of the speed form, which has all of them."""
    case = make_case(2, True, seed=9)
    for (block, row), value in equation_blocks(case.parameters(), case.state(), "speed").items():
        for part, mask in parts(value).items():
            if np.any(np.abs(value[mask]) > 1e-9):
                yield block, row, part


def parts(value: Array) -> dict[str, Any]:
    """Masks of a block: above, on and below the diagonal, or the whole of a row or column."""
    if np.ndim(value) < 2:
        return {"all": np.ones_like(value, dtype=bool)}
    square = np.ones_like(value, dtype=bool)
    return {"above": np.triu(square, 1), "diagonal": np.eye(*value.shape, dtype=bool), "below": np.tril(square, -1)}


FAULTS = list(block_faults())


def test_faults_cover_the_table() -> None:
    angle_blocks = {(b, r) for b, r, part in FAULTS if part in ("above", "below")}
    assert angle_blocks == {(b, r) for b in LINK_BLOCKS for r in CHAIN_ROWS}
    diagonal = {f"{b} {r}" for b, r, part in FAULTS if part == "diagonal"}
    expected = "A phi,F1 phi,F2 phi,G phi,B psi,D psi,H1 psi,H2 psi"
    expected += "".join(f",{b} {r}" for r in ("xi1", "xi2") for b in ("C1", "C2", "D", "E"))
    assert diagonal == set(expected.split(","))


@pytest.fixture(scope="module")
def speed_reference() -> tuple[Array, Array]:
    return reference_form(make_case(2, True, seed=9), "speed")


@pytest.mark.parametrize(("block", "row", "part"), FAULTS)
def test_flipped_block_is_caught(block: str, row: str, part: str, speed_reference: tuple[Array, Array]) -> None:
    case = make_case(2, True, seed=9)
    p, s = case.parameters(), case.state()
    blocks: Blocks = {key: np.array(value) for key, value in equation_blocks(p, s, "speed").items()}

    def error() -> float:
        matrix, h = assemble_mass_matrix(blocks, p, "speed"), assemble_bias(blocks, p, s, "speed")
        return max(mismatch(matrix, speed_reference[0]), mismatch(h, speed_reference[1]))

    assert error() < TOLERANCE
    value = blocks[block, row]
    value[parts(value)[part]] *= -1
    assert error() > 1e-6


class SignFault(ast.NodeTransformer):
    """Turn the k-th sum into a difference, difference into a sum, or drop the k-th minus sign."""

    def __init__(self, target: int) -> None:
        self.target, self.count = target, -1

    def _here(self) -> bool:
        self.count += 1
        return self.count == self.target

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.op, ast.Add | ast.Sub) and self._here():
            return ast.BinOp(node.left, ast.Sub() if isinstance(node.op, ast.Add) else ast.Add(), node.right)
        return node

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.op, ast.USub) and not isinstance(node.operand, ast.Constant) and self._here():
            return node.operand
        return node


def source(module: ModuleType) -> ast.Module:
    assert module.__file__ is not None
    return ast.parse(Path(module.__file__).read_text(encoding="utf-8"))


def sign_faults() -> Iterator[Any]:
    for module in MODULES:
        counter = SignFault(-1)
        counter.visit(source(module))
        for k in range(counter.count + 1):
            yield pytest.param(module, k, id=f"{module.__name__.rsplit('.', 1)[1]}-{k}")


@pytest.fixture(scope="module")
def everything(checks: dict[str, tuple[Callable[[Any], Any], Any]]) -> Callable[[], float]:
    """Return a function that compares all of the package with the derivation and returns the worst mismatch."""
    cases = {form: make_case(3, form != "pivot", seed=11) for form in FORMS}
    expected = {form: reference_form(case, form) for form, case in cases.items()}
    full = cases["full"]
    expected_energies = energies(3, True)(full.q, full.v, full.data)
    bare = ("phi1", "psi1", "xi1_1", "xi1_2", "phi2", "psi2", "xi2_1")

    def compare() -> float:
        errors = [mismatch(evaluate(closed_form), value) for evaluate, value in checks.values()]
        for form, case in cases.items():
            p, s = case.parameters(), case.state()
            errors.append(mismatch(closed_form.mass_matrix(p, s, form), expected[form][0]))
            errors.append(mismatch(closed_form.bias(p, s, form), expected[form][1]))
        p, s = full.parameters(), full.state()
        energy = [closed_form.kinetic_energy(p, s), closed_form.potential_energy(p, s)]
        errors += [abs(a / b - 1) for a, b in zip(energy, expected_energies, strict=True)]
        named = closed_form.coordinate_names(closed_form.chain_parameters([1.0, 1.0], 1.0))
        return max(errors) if named == bare else math.inf

    return compare


@pytest.mark.parametrize(("module", "k"), list(sign_faults()))
def test_flipped_sign_in_the_source_is_caught(
    module: ModuleType, k: int, everything: Callable[[], float], monkeypatch: pytest.MonkeyPatch
) -> None:
    tree = ast.fix_missing_locations(SignFault(k).visit(source(module)))
    faulty = ModuleType(module.__name__)
    faulty.__package__ = module.__package__
    monkeypatch.setitem(sys.modules, module.__name__, faulty)
    try:
        exec(compile(tree, "<faulty>", "exec"), faulty.__dict__)
        for name, original in vars(module).items():
            if getattr(original, "__module__", None) != module.__name__:
                continue
            for user in [closed_form, chain_cases, *MODULES]:
                if getattr(user, name, None) is original and user is not module:
                    monkeypatch.setattr(user, name, getattr(faulty, name))
        error = everything()
    except (IndexError, KeyError, TypeError, ValueError, AssertionError):
        error = math.inf  # seen at once: shapes, names or labels no longer fit
    assert error > 1e-6


def test_without_a_fault_everything_agrees(everything: Callable[[], float]) -> None:
    assert everything() < TOLERANCE


# Independence


def test_closed_form_imports_numpy_alone() -> None:
    folder = Path(closed_form.__file__).parent
    imported = set()
    for path in folder.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                assert node.level < 2, path
                imported |= {(node.module or "").split(".")[0]} if node.level == 0 else set()
    assert imported == {"numpy", "__future__", "collections", "dataclasses", "typing"}
