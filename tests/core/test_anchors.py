"""Accelerations of the core beside those of the generated Pinocchio model: links on anchors, and anywhere along rods."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

import vlmb
from tests.anchored import anchored
from tests.core.test_beside_pinocchio import from_pinocchio
from tests.small_scenes import random_state
from vlmb.core import tree as t
from vlmb.core.energy import energies
from vlmb.core.links import accelerate
from vlmb.core.quantities import add_row, measure
from vlmb.core.scratch import make_scratch
from vlmb.model.arrays import make_arrays
from vlmb.model.layout import segment_of
from vlmb.model.memory import make_data
from vlmb.model.quantities import QuantityTable

SIDEWAYS = 1  # velocity of a ski across its edge, in Pinocchio's order


def under_springs(mechanism: vlmb.Mechanism, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """v' (nv,) of the generated model under its springs and weight, the ski held on its edge."""
    tau = np.zeros(mechanism.model.nv)
    for c in mechanism.layout.coordinates:
        if c.kind == "xi":
            segment, at = mechanism.segment(c), segment_of(mechanism.layout, c)
            tau[at.v] = -segment.stiffness * (q[at.q] - segment.rest_length) - segment.damping * v[at.v]
    data = make_data(mechanism.model)
    matrix = np.array(pin.crba(mechanism.model, data, q, pin.Convention.LOCAL))
    matrix = np.triu(matrix) + np.triu(matrix, 1).T
    right = tau - pin.nle(mechanism.model, data, q, v)
    free = [at for at in range(len(right)) if not (mechanism.layout.base == "ski" and at == SIDEWAYS)]
    found = np.zeros(len(right))
    found[free] = np.linalg.solve(matrix[np.ix_(free, free)], right[free])
    return found


@pytest.mark.parametrize("base", ["pivot", "ski"])
@pytest.mark.parametrize("seed", range(5))
def test_both_engines_agree_on_anchors(base: str, seed: int) -> None:
    mechanism = vlmb.build(anchored(base, seed))
    arrays = make_arrays(mechanism.scene, mechanism.layout)
    scratch = make_scratch(arrays.tree)
    assert np.ptp(arrays.tree.real[:, t.ANCHOR]) > 0.1 and np.ptp(arrays.tree.real[:, t.ON_ROD]) > 0.1
    for number in range(4):
        q, v = random_state(mechanism, 10 * seed + number, sideways=False)
        y = arrays.pack(q, v)
        dy = np.zeros_like(y)
        assert accelerate(arrays.tree, y, arrays.given, np.zeros(arrays.velocities), dy, scratch) == 0
        right = from_pinocchio(mechanism, q, v, under_springs(mechanism, q, v))
        np.testing.assert_allclose(dy[arrays.positions :], right, rtol=0.0, atol=1e-11 * np.abs(right).max())


@pytest.mark.parametrize("base", ["pivot", "ski"])
def test_postures_are_the_same_from_both_states(base: str) -> None:
    mechanism = vlmb.build(anchored(base))
    arrays = make_arrays(mechanism.scene, mechanism.layout)
    state = random_state(mechanism, 5, sideways=False)
    ours, theirs = arrays.postures(arrays.pack(*state), arrays.given), mechanism.postures(state)
    for i in range(len(mechanism.layout.links)):
        for point in ("hinge", "tip"):
            np.testing.assert_allclose(ours.position(i, point), theirs.position(i, point), atol=1e-13)
            np.testing.assert_allclose(ours.velocity(i, point), theirs.velocity(i, point), atol=1e-13)


@pytest.mark.parametrize("base", ["pivot", "ski"])
def test_energies_are_pinocchios(base: str) -> None:
    mechanism = vlmb.build(anchored(base))
    arrays = make_arrays(mechanism.scene, mechanism.layout)
    q, v = random_state(mechanism, 6, sideways=False)
    found = np.zeros(3)
    energies(arrays.tree, arrays.pack(q, v), arrays.given, found)
    assert found[0] == pytest.approx(pin.computeKineticEnergy(mechanism.model, make_data(mechanism.model), q, v), rel=1e-12)
    assert found[1] == pytest.approx(pin.computePotentialEnergy(mechanism.model, make_data(mechanism.model), q), rel=1e-12)


@pytest.mark.parametrize("plane", [False, True])
@pytest.mark.parametrize("base", ["pivot", "ski"])
def test_quantities_are_those_of_the_postures(base: str, plane: bool) -> None:
    """Points and the centre of mass as equations, forces and events read them: value, rate, and the row of the rate."""
    mechanism = vlmb.build(anchored(base, plane=plane))
    arrays = make_arrays(mechanism.scene, mechanism.layout)
    state = random_state(mechanism, 8, sideways=False)
    y, seen, table = arrays.pack(*state), mechanism.postures(state), QuantityTable(mechanism.names, arrays)
    points = [f"{link.name}.{point}" for link in mechanism.layout.links for point in ("hinge", "tip")]
    names = [mechanism.names.find(f"{what}.{axis}") for what in [*points, "com"] for axis in "xyz"]
    places = [table.of(name) for name in names]
    quantities, out = table.made(), np.zeros((len(table.rows), 3))
    near = np.zeros((len(table.rows), 2))
    for name, k in zip(names, places, strict=True):
        assert measure(quantities, k, arrays.tree, y, arrays.given, near, out) == 0
        rate = dataclasses.replace(name, rate=True)
        wanted = [float(seen.read(entry, np.zeros(0), np.zeros(0))) for entry in (name, rate)]
        row = np.zeros(arrays.velocities)
        assert add_row(quantities, k, arrays.tree, y, arrays.given, near, 1.0, row) == 0
        np.testing.assert_allclose([*out[k, :2], row @ y[arrays.positions :]], [*wanted, wanted[1]], atol=1e-12)
