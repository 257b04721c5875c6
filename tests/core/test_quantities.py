"""Quantities and springs as compiled: the same numbers as in plain Python, error codes, branches of angles."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from tests.core.motions import Motion, kinds, mechanisms, reference
from vlmb.core import angles, places, quantities, springs, tree


def plain(numbers: np.ndarray) -> np.ndarray:
    return numbers.astype(float)


@pytest.mark.parametrize("at", range(len(mechanisms())))
def test_rates_rows_and_drifts_compiled(at: int) -> None:
    motion, t, h = mechanisms()[at], mpmath.mpf("0.37"), mpmath.mpf("1e-5")
    shape, entries = motion.tree(exact=False), kinds(motion)
    table = quantities.make_quantities(shape, [kind for kind, _ in entries], [offset for _, offset in entries])
    near = plain(reference(motion, table, t))
    outs = []
    for s in (t - h, t, t + h):
        y, _, given = (plain(part) for part in motion.state(s))
        outs.append(np.zeros((len(entries), 3)))
        assert quantities.measure_these(table, np.arange(len(entries)), shape, y, given, near, outs[-1]) == 0
    y, a, given = (plain(part) for part in motion.state(t))
    rows = np.zeros((len(entries), len(a)))
    assert all(quantities.add_row(table, k, shape, y, given, near, 1.0, rows[k]) == 0 for k in range(len(entries)))
    slope = (outs[2][:, 1] - outs[0][:, 1]) / float(2 * h)
    np.testing.assert_allclose(outs[1][:, 2] + rows @ a, slope, rtol=1e-6, atol=1e-6)
    still = given.copy()
    still[:, [1, 2, 4, 5]] = 0.0
    quantities.measure_these(table, np.arange(len(entries)), shape, y, still, near, outs[0])
    np.testing.assert_allclose(outs[0][:, 1], rows @ y[motion.shape[1] :], rtol=1e-12, atol=1e-12)


def upright(tilt: float) -> tuple[tree.Tree, np.ndarray, np.ndarray]:
    motion = Motion(tree.SKI, [-1], [False], 1)
    y, _, given = (plain(part) for part in motion.state(mpmath.mpf(0)))
    at = motion.link[0, tree.AT_P]
    y[at : at + 3] = math.sin(tilt), 0.0, math.cos(tilt)
    return motion.tree(exact=False), y, given


def test_at_the_pole_an_azimuth_has_no_row_and_no_force_needs_none() -> None:
    shape, y, given = upright(1e-7)
    table = quantities.make_quantities(shape, [(quantities.AZIMUTH, 0, 0, 0), (quantities.ELEVATION, 0, 0, 0)], [0.0, 0.0])
    near, out, row = np.array([[0.0, 1.5], [0.0, 1.5]]), np.zeros((2, 3)), np.zeros(int(shape.shape[2]))
    assert quantities.measure_these(table, np.arange(2), shape, y, given, near, out) == angles.AT_POLE
    assert out[1, 0] == pytest.approx(0.5 * math.pi - 1e-7, abs=1e-12)  # what has a value is measured all the same
    assert quantities.add_row(table, 0, shape, y, given, near, 2.0, row) == angles.AT_POLE
    assert quantities.add_row(table, 0, shape, y, given, near, 0.0, row) == angles.FINE and not row.any()
    assert quantities.add_row(table, 1, shape, y, given, near, 1.0, row) == angles.FINE
    shape, y, given = upright(1e-5)
    assert quantities.measure_these(table, np.arange(2), shape, y, given, near, out) == angles.FINE


def test_angles_go_on_over_the_pole_and_around() -> None:
    shape, y, given = upright(0.0)
    at = int(shape.link[0, tree.AT_P])
    table = quantities.make_quantities(shape, [(quantities.AZIMUTH, 0, 0, 0), (quantities.ELEVATION, 0, 0, 0)], [0.0, 0.0])
    near, out = np.array([[0.3, 1.0], [0.3, 1.0]]), np.zeros((2, 3))
    for psi in np.arange(1.0, 9.0, 0.1):
        d = [math.cos(0.3) * math.cos(psi), math.sin(0.3) * math.cos(psi), math.sin(psi)]
        y[at : at + 3] = d
        assert quantities.measure_these(table, np.arange(2), shape, y, given, near, out) == angles.FINE
        np.testing.assert_allclose(out[:, 0], [0.3, psi], atol=1e-12)
        quantities.follow(table, shape, y, near)


@pytest.mark.parametrize(
    "pair, constant, fine",
    [((places.NORMAL, 0, springs.ON_BASE), (3.0, 2.0, 0.0), True), ((places.NORMAL, 0, springs.ON_BASE), (3.0, 2.0, 0.5), False),
     ((places.NORMAL, 0, springs.ON_BASE), (0.0, 2.0, 0.5), True), ((0, 1, springs.LINKS), (3.0, 0.0, 0.0), True),
     ((0, 1, springs.LINKS), (3.0, 0.0, 0.8), False), ((0, 1, springs.LINKS), (0.0, 1.0, 0.0), False),
     ((0, 1, springs.IN_PLANE), (3.0, 1.0, 0.8), True)],
)  # fmt: skip
def test_line_ups(pair: tuple[int, int, int], constant: tuple[float, float, float], fine: bool) -> None:
    motion = Motion(tree.PIVOT, [-1, 0], [False, False], 1)
    y = plain(motion.state(mpmath.mpf(0))[0])
    for i in range(2):
        at, v = int(motion.link[i, tree.AT_P]), int(motion.shape[1] + motion.link[i, tree.AT_V])
        y[at : at + 3], y[v : v + 3] = (0.0, 0.0, 1.0), (0.3 + i, 0.0, 0.0)
    table = springs.AngleSprings(np.array([pair]), np.array([constant]))
    code, lost = springs.add_springs(table, motion.tree(exact=False), y, np.zeros(1), np.zeros(int(motion.shape[2])))
    assert (code == 0) == fine
    assert lost >= 0.0


def test_energy_at_a_small_angle_is_that_of_a_straight_spring() -> None:
    shape, y, _ = upright(1e-8)
    table = springs.AngleSprings(np.array([(places.NORMAL, 0, springs.ON_BASE)]), np.array([(3.0, 0.0, 0.0)]))
    force = np.zeros(int(shape.shape[2]))
    assert springs.add_springs(table, shape, y, np.zeros(1), force) == (0, 0.0)
    assert force[int(shape.link[0, tree.AT_V])] == pytest.approx(-3e-8, rel=1e-6)
    assert springs.springs_energy(table, shape, y, np.zeros(1)) == pytest.approx(1.5e-16, rel=1e-6)
