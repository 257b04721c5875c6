"""What the engine takes for granted of Pinocchio holds on a standard robot: a floating quadruped from a URDF file."""

from __future__ import annotations

from importlib.metadata import distribution
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import pytest

URDF = "cmeel.prefix/share/example-robot-data/robots/anymal_b_simple_description/robots/anymal.urdf"
WORLD, LOCAL = pin.Convention.WORLD, pin.Convention.LOCAL


class Posture(NamedTuple):
    model: Any
    data: Any
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


@pytest.fixture(scope="module")
def model() -> Any:
    return pin.buildModelFromUrdf(str(Path(str(distribution("example-robot-data").locate_file(URDF)))), pin.JointModelFreeFlyer())


@pytest.fixture(params=range(5))
def posture(request: pytest.FixtureRequest, model: Any) -> Posture:
    generator = np.random.default_rng(request.param)
    q = pin.integrate(model, pin.neutral(model), generator.normal(size=model.nv))
    return Posture(model, model.createData(), q, generator.normal(size=model.nv), generator.normal(size=model.nv))


@pytest.mark.parametrize("convention", [WORLD, LOCAL])
def test_crba_is_the_whole_symmetric_mass_matrix(posture: Posture, convention: Any) -> None:
    model, data, q, _, _ = posture
    mass = np.array(pin.crba(model, data, q, convention))
    still = np.zeros(model.nv)
    gravity = pin.rnea(model, data, q, still, still).copy()
    columns = np.array([pin.rnea(model, data, q, still, unit) - gravity for unit in np.eye(model.nv)]).T
    np.testing.assert_array_equal(mass, mass.T)
    np.testing.assert_allclose(mass, columns, atol=1e-11 * mass.max())


def test_crba_in_world_convention_fills_placements_and_jacobians(posture: Posture) -> None:
    model, data, q, _, _ = posture
    pin.crba(model, data, q, WORLD)
    other = model.createData()
    pin.computeJointJacobians(model, other, q)
    np.testing.assert_allclose(data.J, other.J, atol=1e-13)
    for joint in range(model.njoints):
        np.testing.assert_allclose(data.oMi[joint].homogeneous, other.oMi[joint].homogeneous, atol=1e-13)


def test_matrices_held_by_data_are_views(posture: Posture) -> None:
    model, data, q, _, _ = posture
    jacobian = data.J
    pin.crba(model, data, q, WORLD)
    np.testing.assert_array_equal(jacobian, data.J)


@pytest.mark.parametrize("convention", [WORLD, LOCAL])
def test_aba_inverts_the_equations_of_motion(posture: Posture, convention: Any) -> None:
    model, data, q, v, a = posture
    mass = np.array(pin.crba(model, data, q, WORLD))
    bias = np.array(pin.nonLinearEffects(model, data, q, v))
    tau = mass @ a + bias
    np.testing.assert_allclose(tau, pin.rnea(model, data, q, v, a), atol=1e-11 * abs(tau).max())
    np.testing.assert_allclose(pin.aba(model, data, q, v, tau, convention), a, atol=1e-9)


def test_tangent_map_is_the_rate_of_the_embedding(posture: Posture) -> None:
    model, _, q, v, _ = posture
    h = 1e-5
    rate = (pin.integrate(model, q, h * v) - pin.integrate(model, q, -h * v)) / (2.0 * h)
    np.testing.assert_allclose(pin.tangentMap(model, q) @ v, rate, atol=1e-8)
    np.testing.assert_allclose(pin.tangentMapProduct(model, q, v[:, None]).ravel(), rate, atol=1e-8)


def test_joint_forces_act_from_the_parent_in_the_joint_frame(posture: Posture) -> None:
    model, data, q, _, _ = posture
    still = np.zeros(model.nv)
    pin.rnea(model, data, q, still, still)
    pin.forwardKinematics(model, data, q)  # rnea leaves data.oMi as it was, forwardKinematics data.f
    weight = -pin.computeTotalMass(model) * model.gravity.linear
    np.testing.assert_allclose(data.oMi[1].rotation @ data.f[1].linear, weight, atol=1e-9)
