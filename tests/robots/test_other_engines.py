"""Mass matrix and bias of robots against MuJoCo and Drake, where they are installed."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

from tests.robots.scenes import TALOS, UR5, built
from vlmb.model.robot_files import read_robot

ROBOTS = [
    UR5, TALOS, "panda_description/urdf/panda.urdf", "kinova_description/robots/kinova.urdf", "z1_description/urdf/z1.urdf",
    "double_pendulum_description/urdf/double_pendulum.urdf",
]  # fmt: skip
STATES = 100


def prepared(urdf: str) -> str:
    """The URDF as vlmb hands it to Pinocchio, damping and friction taken out."""
    tree = ElementTree.fromstring(read_robot(urdf, "urdf").xml)
    for joint in tree.iter("joint"):
        for dynamics in joint.findall("dynamics"):
            joint.remove(dynamics)
    return ElementTree.tostring(tree, encoding="unicode")


def list_links(text: str) -> list[str]:
    return [link.get("name", "") for link in ElementTree.fromstring(text).iter("link")]


def children(text: str) -> set[str]:
    return {child.get("link", "") for child in ElementTree.fromstring(text).iter("child")}


def ours(urdf: str) -> Any:
    return built({"base": {"kind": "pivot"}, "robots": [{"name": "robot", "urdf": urdf}]}).model


def terms(model: Any, data: Any, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    mass = np.array(pin.crba(model, data, q))
    return np.triu(mass) + np.triu(mass, 1).T, np.array(pin.nonLinearEffects(model, data, q, v))


@pytest.mark.parametrize("urdf", ROBOTS)
def test_against_mujoco(urdf: str) -> None:
    mujoco = pytest.importorskip("mujoco")
    tree = ElementTree.fromstring(prepared(urdf))
    extension = ElementTree.SubElement(tree, "mujoco")
    ElementTree.SubElement(extension, "compiler", {"fusestatic": "false", "discardvisual": "true", "autolimits": "true"})
    there = mujoco.MjModel.from_xml_string(ElementTree.tostring(tree, encoding="unicode"))
    state, model = mujoco.MjData(there), ours(urdf)
    data = model.createData()
    order = [there.joint(name.partition(".")[2]).dofadr[0] for name in list(model.names)[1:]]
    assert sorted(order) == list(range(model.nv))
    there.dof_armature[:] = 0.0
    rng = np.random.default_rng(1)
    for _ in range(STATES):
        q, v = rng.uniform(-2.0, 2.0, model.nv), rng.uniform(-2.0, 2.0, model.nv)
        state.qpos[order], state.qvel[order] = q, v
        mujoco.mj_forward(there, state)
        whole = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(there, whole, state.qM) if hasattr(state, "qM") else mujoco.mj_fullM(there, state, whole)
        mass, bias = terms(model, data, q, v)
        assert np.abs(whole[np.ix_(order, order)] - mass).max() < 1e-12 * np.abs(mass).max()
        assert np.abs(state.qfrc_bias[order] - bias).max() < 1e-12 * np.abs(bias).max()


@pytest.mark.parametrize("urdf", ROBOTS)
def test_against_drake(urdf: str) -> None:
    plants = pytest.importorskip("pydrake.multibody.plant")
    from pydrake.multibody.parsing import Parser

    plant = plants.MultibodyPlant(0.0)
    (instance,) = Parser(plant).AddModelsFromString(prepared(urdf), "urdf")
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -9.81])
    root = next(name for name in list_links(prepared(urdf)) if name not in children(prepared(urdf)))
    if root != "world":
        plant.WeldFrames(plant.world_frame(), plant.GetBodyByName(root, instance).body_frame())
    plant.Finalize()
    context, model = plant.CreateDefaultContext(), ours(urdf)
    data = model.createData()
    order = [plant.GetJointByName(name.partition(".")[2]).velocity_start() for name in list(model.names)[1:]]
    rng = np.random.default_rng(2)
    for _ in range(STATES):
        q, v = rng.uniform(-2.0, 2.0, model.nv), rng.uniform(-2.0, 2.0, model.nv)
        there, rates = np.zeros(model.nv), np.zeros(model.nv)
        there[order], rates[order] = q, v
        plant.SetPositions(context, there)
        plant.SetVelocities(context, rates)
        mass, bias = terms(model, data, q, v)
        found = plant.CalcMassMatrix(context)[np.ix_(order, order)]
        pull = (plant.CalcBiasTerm(context) - plant.CalcGravityGeneralizedForces(context))[order]
        assert np.abs(found - mass).max() < 1e-12 * np.abs(mass).max()
        assert np.abs(pull - bias).max() < 1e-12 * np.abs(bias).max()
