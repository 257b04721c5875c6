"""Derivatives by numbers that carry them, against differences in arithmetic of 50 digits."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest

import vlmb
from vlmb.studies.chart import Chart, chart_at
from vlmb.system import jets
from vlmb.system.jets import Jet, derivatives
from vlmb.system.replay import plain
from vlmb.system.system import make_system

MODELS = Path(__file__).resolve().parents[2] / "models"
TINY = 1e-20  # step of the differences

# Rows, a programme with more controls than rows, friction, prescribed lengths, springs between directions, anchors, closed feet.
SHIPPED = ["carved_turn", "compass_gait", "crane", "flight", "prescribed", "single_support", "skate_on_slope",
           "skier_paper_balanced", "skier_skids", "skier_slalom", "skier_two_links", "tree"]  # fmt: skip


@pytest.fixture(autouse=True)
def fifty_digits() -> Any:
    with mpmath.workdps(50):
        yield


def along(function: Any, x: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Derivatives along a direction by central differences with 50 digits."""
    h = mpmath.mpf(TINY)
    ahead, behind = (
        function(np.array([mpmath.mpf(value) + side * h * step for value, step in zip(x.tolist(), way.tolist(), strict=True)]))
        for side in (1, -1)
    )
    return np.array([float((a - b) / (2 * h)) for a, b in zip(ahead, behind, strict=True)])


def agree(function: Any, x: np.ndarray, seed: int = 0) -> float:
    """Largest error of the derivatives along a direction, over the largest derivative."""
    way = np.random.default_rng(seed).standard_normal(len(x))
    matrix = derivatives(function, x)
    return float(np.abs(matrix @ way - along(function, x, way)).max() / np.abs(matrix).max())


FUNCTIONS = [
    lambda x: x[0] * x[1] - 3.0 * x[1] / x[0] + 2.0 - x[0] / x[1], lambda x: 2.0 / x[0] - (1.0 - x[1]) ** 3 + x[0] ** 1.5,
    lambda x: jets.sin(x[0]) * jets.cos(x[1]) + jets.tan(x[0]), lambda x: jets.asin(x[0] / 2) + jets.acos(x[0] / 3),
    lambda x: jets.atan(x[1]) + jets.exp(-x[0]) + jets.log(x[0]), lambda x: jets.sqrt(x[0] * x[0] + 1.0) - abs(x[1]),
    lambda x: jets.atan2(x[1], x[0]) + jets.atan2(2.0, x[1]) - jets.atan2(x[0], 0.5),
    lambda x: jets.hypot(x[0], x[1]) + abs(x[0]),
    lambda x: jets.sinh(x[0]) + jets.cosh(x[1]) * jets.tanh(x[0]), lambda x: max(x[0], x[1]) * min(x[0], 3.0) + jets.floor(x[0]),
]  # fmt: skip


@pytest.mark.parametrize("number", range(len(FUNCTIONS)))
def test_functions(number: int) -> None:
    assert agree(lambda x: np.array([FUNCTIONS[number](x)]), np.array([0.7, -1.3])) < 4e-16


def test_a_zero_that_moves_is_none() -> None:
    here, still = Jet(0.0, np.array([1.0])), Jet(0.0, np.array([0.0]))
    assert here != 0.0 and still == 0.0 and not here < 0.0 and here <= 0.0
    assert jets.sqrt(still).slopes == 0.0 and jets.sqrt(here).slopes == math.inf
    with np.errstate(invalid="ignore"):
        assert math.isnan((still / 0.0).value) and (1.0 / still).value == math.inf
    assert math.isnan(jets.log(Jet(-1.0, np.array([1.0]))).value) and jets.reciprocal(0.0) == 0.0


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_least_squares_of_any_rank(rank: int) -> None:
    """Of a matrix of three rows whose rank does not change with the numbers."""
    rng = np.random.default_rng(rank)
    left, right, wanted = rng.standard_normal((2, 3, rank)), rng.standard_normal((2, rank, 4)), rng.standard_normal((2, 3))

    def solved(x: Any) -> Any:
        def number(a: float, b: float) -> Any:
            return a + b * x[0]

        first = np.array([[number(*left[:, i, k]) for k in range(rank)] for i in range(3)], object)
        matrix = first @ np.array([[number(*right[:, k, j]) for j in range(4)] for k in range(rank)], object)
        beside = np.array([[number(wanted[0, i], wanted[1, i])] for i in range(3)], object)
        if isinstance(x[0], Jet):
            answer = np.zeros((4, 1), object)
            jets.least_squares(matrix, 3, 4, beside, 1, 1e-9, answer)
            return answer[:, 0]
        a, b = mpmath.matrix(matrix.tolist()), mpmath.matrix(beside.tolist())
        u, s, v = mpmath.svd_r(a)
        scaled = [sum(u[i, k] * b[i] for i in range(3)) / s[k] for k in range(rank)]
        return [sum(v[k, j] * scaled[k] for k in range(rank)) for j in range(4)]

    assert agree(solved, np.array([0.3])) < 1e-10  # singular values are up to 7e3 apart


@pytest.mark.parametrize("name", SHIPPED)
def test_equations_of_shipped_models(name: str) -> None:
    """Rates of a chart and what rows lack beside the start, and the values themselves against the compiled core."""
    chart = charted(name)
    x = chart.numbers(chart.origin) + 3e-3 * np.random.default_rng(1).standard_normal(len(chart.names))
    assert agree(lambda at: np.concatenate(chart.equations(at)), x) < 1e-14
    replayed = np.array([float(value) for value in np.concatenate(chart.equations(x.astype(object)))])
    compiled = np.concatenate(chart.equations(x))
    assert np.abs(replayed - compiled).max() < 1e-13 * max(1.0, float(np.abs(compiled).max()))


def charted(name: str) -> Chart:
    return chart_at(make_system(vlmb.build(vlmb.load_scene(MODELS / f"{name}.toml"))))


def test_what_is_held_and_what_pushes() -> None:
    chart = charted("skier_two_links")
    x = chart.numbers(chart.origin) + 3e-3 * np.random.default_rng(2).standard_normal(len(chart.names))
    read = chart.reading(["legs.tip.z", "com.x_dot", "psi1", "phi1_dot", "speed", "legs.length"])
    assert agree(lambda at: np.array(read(at), object), x) < 1e-15


def test_kernels_are_copied_with_what_they_call() -> None:
    from vlmb.core import evaluation, quantities

    copy = plain(quantities.measure)
    assert copy is plain(quantities.measure) and copy.__globals__["sqrt"] is jets.sqrt
    assert plain(evaluation.evaluate).__globals__["measure"] is copy
