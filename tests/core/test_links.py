"""The recursion of the links beside dense equations, 50 digits and itself."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st

from tests.core import dense, trees
from tests.core.edge import edge_force
from tests.core.trees import Case, Link
from vlmb.core import tree as t
from vlmb.core.energy import energies, places
from vlmb.core.jit import COMPILED
from vlmb.core.links import accelerate, respond
from vlmb.core.scratch import Scratch, axial_forces, make_lanes, make_scratch
from vlmb.core.tree import Tree

ROOT = Path(__file__).resolve().parents[2]
LONG = 100 if COMPILED else 20
KINDS = (t.PIVOT, t.FREE, t.SKI, t.SLIDING, t.LIFTED, trees.UPRIGHT_SKI, trees.UPRIGHT_SLIDING)
BRANCHED = trees.tidy(
    t.FREE,
    [
        Link(-1), Link(0, True, True, False), Link(0, False, False, True, rod_mass=False),
        Link(1, True, False, False, tip_mass=False), Link(1, False, True, True), Link(-1, False, True, False, rod_mass=False),
        Link(3, True, False, True),
    ],
)  # fmt: skip


def evaluate(case: Case) -> tuple[np.ndarray, Scratch]:
    """Rates of positions and velocities, and what the evaluation leaves."""
    scratch, dy = make_scratch(case.tree), np.full(len(case.y), np.nan)
    assert accelerate(*case, dy, scratch) == 0
    return dy, scratch


def response(case: Case, scratch: Scratch, force: np.ndarray) -> np.ndarray:
    """What each of four multiples of the forces adds, over its multiple."""
    lanes, shares = make_lanes(len(case.tree.link), len(force)), np.array([1.0, -2.0, 0.0, 1024.0])
    lanes.moved[:] = np.outer(force, shares)
    lanes.loads[:] = np.nan
    assert respond(case.tree, scratch, lanes) == 0
    np.testing.assert_array_equal(lanes.moved, np.outer(lanes.moved[:, 0], shares))
    return np.array(lanes.moved[:, 0])


def relative(found: np.ndarray, right: np.ndarray) -> float:
    return float(np.abs(found - right).max() / np.abs(right).max())


@st.composite
def any_case(draw: st.DrawFn, raw: bool = False) -> Case:
    """A tree of any shape with any segments on any base."""
    kind, flag = draw(st.sampled_from(KINDS)), st.booleans()
    links = []
    for i in range(draw(st.integers(1, 6))):
        links.append(Link(draw(st.integers(-1, i - 1)), *(draw(flag) for _ in range(5))))
    return trees.make(kind, trees.tidy(kind, links), draw(st.integers(0, 10**6)), draw(flag), raw)


@settings(max_examples=200, deadline=None)
@drawn(any_case(raw=True))
def test_accelerations_are_those_of_the_dense_equations(case: Case) -> None:
    dy, scratch = evaluate(case)
    right, axial = dense.rates(*case)
    assert relative(dy, right) < 1e-11
    np.testing.assert_allclose(axial_forces(scratch), axial, rtol=0.0, atol=1e-11 * np.abs(right).max())


@settings(max_examples=100, deadline=None)
@drawn(any_case(), st.integers(0, 10**6))
def test_responses_are_what_forces_add_and_symmetric(case: Case, seed: int) -> None:
    dy, scratch = evaluate(case)
    one, two = trees.in_plane(case.tree, np.random.default_rng(seed).normal(size=(2, len(case.force))))
    first, second = response(case, scratch, one), response(case, scratch, two)
    more, _ = evaluate(case._replace(force=case.force + one))
    added = (more - dy)[case.tree.shape[t.POSITIONS] :]
    np.testing.assert_allclose(first, added, rtol=0.0, atol=1e-12 * max(np.abs(dy).max(), np.abs(first).max()))
    right = dense.accelerations(*case._replace(force=case.force + one))[0] - dense.accelerations(*case)[0]
    np.testing.assert_allclose(first, right, rtol=0.0, atol=1e-11 * max(np.abs(dy).max(), np.abs(first).max()))
    across = [np.sum(np.abs(a * b)) for a, b in ((one, second), (two, first))]
    assert one @ second == pytest.approx(two @ first, abs=1e-12 * max(across))


@settings(max_examples=100, deadline=None)
@drawn(any_case())
def test_energy_changes_by_the_power_of_forces_dampers_and_laws(case: Case) -> None:
    tree, y, given, force = case
    dy, scratch = evaluate(case)
    p = tree.shape[t.POSITIONS]

    def energy(h: float) -> float:
        moved, out = given.copy(), np.zeros(3)
        for at in (t.LOWER, t.UPPER):
            moved[:, at] += h * given[:, at + 1] + h * h / 2.0 * given[:, at + 2]
            moved[:, at + 1] += h * given[:, at + 2]
        energies(tree, y + h * dy, moved, out)
        return float(out.sum())

    h = 2e-4
    change = (8.0 * (energy(h) - energy(-h)) - (energy(2.0 * h) - energy(-2.0 * h))) / (12.0 * h)
    powers = [force * y[p:], np.ravel(axial_forces(scratch) * given[:, [t.LOWER + 1, t.UPPER + 1]])]
    for link, real in zip(tree.link, tree.real, strict=True):
        free = p + link[t.AT_V] + 3
        for side in (0, 1):
            if link[t.LOWER_FREE + side]:
                powers.append(np.array([-real[t.C1 + 3 * side] * y[free] ** 2]))
                free += 1
    # the difference is of fourth order in h: generous where rates are large
    assert change == pytest.approx(sum(power.sum() for power in powers), abs=1e-7 * sum(np.abs(power).sum() for power in powers))


@settings(max_examples=50, deadline=None)
@drawn(any_case())
def test_energies_and_places_are_those_of_the_masses(case: Case) -> None:
    out, rows = np.zeros(3), np.zeros((len(case.tree.link), 12))
    energies(case.tree, case.y, case.given, out)
    places(case.tree, case.y, case.given, rows)
    right = np.array(dense.energies(case.tree, case.y, case.given))
    np.testing.assert_allclose(out, right, rtol=0.0, atol=1e-13 * np.abs(right).max())
    masses = dense.model_of(case.tree, case.y, case.given).masses[-2 * len(rows) :]
    tips = np.array([[*point.place, *point.velocity] for _, point in masses[1::2]])
    np.testing.assert_allclose(rows[:, 6:], tips, rtol=0.0, atol=1e-13 * np.abs(tips).max())


@settings(max_examples=50, deadline=None)
@drawn(any_case(), st.floats(0.1, 10.0), st.floats(-3.0, 3.0))
def test_lengths_of_directions_and_rates_along_them_do_not_matter(case: Case, norm: float, slip: float) -> None:
    dy, _ = evaluate(case)
    tree, y = case.tree, case.y.copy()
    right, p = dy.copy(), tree.shape[t.POSITIONS]
    for link in tree.link:
        d, u = slice(link[t.AT_P], link[t.AT_P] + 3), slice(p + link[t.AT_V], p + link[t.AT_V] + 3)
        right[d] *= norm
        right[u] += slip * y[u]
        y[u] += slip * y[d]
        y[d] *= norm
    found, _ = evaluate(case._replace(y=y))
    assert relative(found, right) < 1e-13


@settings(max_examples=30, deadline=None)
@drawn(st.integers(0, 10**6), st.booleans(), st.sampled_from([t.SKI, trees.UPRIGHT_SKI]))
def test_the_knife_edge_holds_a_ski_that_could_slide(seed: int, on_rod: bool, kind: int) -> None:
    ski = trees.make(kind, [Link(), Link(0, on_rod), Link()], seed)
    tree, y, given, force = ski
    p, more = tree.shape[t.POSITIONS], tree.link.copy()
    more[:, t.AT_V] += 1
    dy, scratch = evaluate(ski)
    free = Tree(tree.shape + np.array([t.SLIDING - t.SKI, 0, 1, 0, 0, 0]), tree.base, more, tree.real)
    sliding = Case(free, np.insert(y, p + 1, 0.0), given, np.insert(force, 1, edge_force(tree, scratch.rows)))
    right = np.insert(dy, p + 1, 0.0)
    assert relative(evaluate(sliding)[0], right) < 1e-13


def fault_of(case: Case) -> tuple[int, int]:
    return divmod(accelerate(*case, np.zeros_like(case.y), make_scratch(case.tree)), t.PLACES)


def test_faults_name_the_link() -> None:
    nothing_at_the_tip = trees.make(t.PIVOT, [Link(), Link(0, tip_mass=False)])
    assert fault_of(nothing_at_the_tip) == (t.FREE_TIP, 1)
    between_two = trees.make(t.PIVOT, [Link(), Link(0, rod_mass=False), Link(1)])
    assert fault_of(between_two) == (t.FREE_ROD, 1)
    no_mass = trees.make(t.PIVOT, [Link(), Link(0, False, False, False, rod_mass=False, tip_mass=False)])
    assert fault_of(no_mass) == (t.TURNING, 1)
    only_a_spring = trees.make(t.PIVOT, [Link(-1, False, True, False, rod_mass=False, tip_mass=False)])
    assert fault_of(only_a_spring)[0] in (t.FREE_TIP, t.TURNING)
    weightless = trees.make(t.FREE, [Link(-1, False, True, False)])
    weightless.tree.base[t.BASE_MASS] = 0.0
    assert fault_of(weightless) == (t.FREE_BASE, 1)


def test_a_free_segment_before_a_massless_tip_in_line_is_a_fault() -> None:
    case = trees.make(t.PIVOT, [Link(-1, tip_mass=False), Link(0)])
    case.y[5:8] = case.y[:3]
    assert fault_of(case) == (t.FREE_TIP, 0)


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_a_direction_must_be_one(value: float) -> None:
    case = trees.chain(3)
    case.y[case.tree.link[1, t.AT_P] : case.tree.link[1, t.AT_P] + 3] = value
    assert fault_of(case) == (t.NO_DIRECTION, 1)


def request(kind: int, links: list[Link], seed: int, beside_dense: bool) -> dict[str, Any]:
    """A case with what the compiled core makes of it."""
    case = trees.make(kind, links, seed)
    dy, scratch = evaluate(case)
    axial = np.ravel(axial_forces(scratch)).tolist()
    answer = response(case, scratch, case.force).tolist()
    text = [kind, [list(link) for link in links], seed]
    return {"case": text, "dense": beside_dense, "rates": dy.tolist(), "axial": axial, "response": answer}


def judged(requests: list[dict[str, Any]]) -> list[dict[str, float]]:
    """Errors beside 50 digits, found in a process whose kernels are plain Python."""
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-m", "tests.core.exactly"], input=json.dumps(requests), text=True,
        capture_output=True, env=os.environ | {"VLMB_JIT": "0", "PYTHONPATH": path},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return list(json.loads(done.stdout))


def chain(n: int) -> list[Link]:
    return [Link(i - 1) for i in range(n)]


def test_evaluations_are_right_to_the_last_digits() -> None:
    right_to_the_last_digits((1, 5), LONG)


def right_to_the_last_digits(beside_dense: tuple[int, ...], long: int) -> None:
    """Chains of 1, 8, 50, 200 and 1000 links have tests of acceptance."""
    requests = [request(kind, chain(n), n, True) for kind in KINDS for n in beside_dense]
    requests += [request(kind, BRANCHED, 3, True) for kind in KINDS]
    requests += [request(t.PIVOT, chain(50), 1, False), request(t.SKI, chain(long), 2, False)]
    requests += [request(trees.UPRIGHT_SKI, chain(long), 2, False)]
    errors = judged(requests)
    assert max(entry.get("dense", 0.0) for entry in errors) < 1e-45
    assert max(entry["rates"] for entry in errors) < 2e-15, errors
    assert max(entry["response"] for entry in errors) < 2e-14, errors
    assert max(entry.get("axial", 0.0) for entry in errors) < 2e-14, errors


def test_long_chains_are_right_to_the_last_digits() -> None:
    assert error_of_chains(250 if COMPILED else LONG) < 2e-15


def error_of_chains(n: int) -> float:
    """Largest error of the rates of chains of n links."""
    return max(entry["rates"] for entry in judged([request(kind, chain(n), 5, False) for kind in (t.PIVOT, t.FREE)]))
