"""What an equation may name of a robot: value, rate, row and drift against differences, and against Pinocchio's own frames."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from tests.robots.scenes import arm, built, everything, random_state
from vlmb.core import bodies as core
from vlmb.core.bodies import move
from vlmb.core.frame_rows import read_all, rows_of_quantities
from vlmb.core.readings import BETWEEN, Readings
from vlmb.model.robot_mechanism import RobotMechanism

STEP = 1e-4


class Reader:
    """Reads all quantities of a mechanism at a state."""

    def __init__(self, mechanism: RobotMechanism, names: list[str]) -> None:
        table = mechanism.table
        found = [mechanism.names.find(name) for name in names]
        rows = [quantity.row for quantity in found] + [(BETWEEN, 3, 0, len(table.frame) - 1)]
        offsets = [quantity.offset for quantity in found] + [0.0]
        self.count, self.model = len(rows), mechanism.model
        self.bodies = table.bodies()
        self.readings = Readings(
            table.frame, table.place, np.array(rows, np.int64), np.array(offsets), np.zeros((len(rows), 2)),
            np.array([table.mass]),
        )  # fmt: skip
        self.angles = np.array([*(quantity.angle for quantity in found), False])
        self.chosen = np.arange(len(rows))

    def at(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        out = np.zeros((self.count, 3))
        read_all(*self.bodies, *self.readings, self.chosen, q, v, out)
        return out

    def rows(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        out = np.zeros((self.count, self.model.nv))
        rows_of_quantities(*self.bodies, *self.readings, self.chosen, q, v, out)
        return out


def values_of(mechanism: RobotMechanism) -> list[str]:
    """Every quantity of the vocabulary: coordinates, and of some frames all that they have."""
    frames = ("left_foot", "ski", "gripper_left_link", "tool0", "wrist_1_link", "leg.", "shank.", "com.")
    return [
        name for name in mechanism.names
        if not name.endswith("_dot") and name != "speed" and (name in mechanism.names.index or name.startswith(frames))
    ]  # fmt: skip


@pytest.mark.parametrize("scene", [arm(), everything()], ids=["arm", "rider with links"])
def test_rate_row_and_drift_of_every_quantity(scene: dict[str, Any]) -> None:
    mechanism, rng = built(scene), np.random.default_rng(3)
    reader, model = Reader(mechanism, values_of(mechanism)), mechanism.model
    assert reader.count > 25
    for _ in range(10):
        q, v = random_state(mechanism, rng)
        here, rows = reader.at(q, v), reader.rows(q, v)
        # Pinocchio's integrate follows constant v: v' = 0
        sides = [reader.at(pin.integrate(model, q, k * STEP * v), v) for k in (-2, -1, 1, 2)]
        values = np.array([side[:, 0] - here[:, 0] for side in sides])
        values[:, reader.angles] = np.remainder(values[:, reader.angles] + np.pi, 2 * np.pi) - np.pi
        rates = np.array([side[:, 1] for side in sides])
        weights = np.array([1.0, -8.0, 8.0, -1.0]) / (12.0 * STEP)
        size = 1.0 + np.abs(here).max(axis=1)
        assert np.abs(weights @ values - here[:, 1]).max() < 1e-7 * size.max()
        assert (np.abs(rows @ v - here[:, 1]) < 1e-12 * size * model.nv).all()
        assert (np.abs(weights @ rates - here[:, 2]) < 1e-7 * size * size).all()


def test_bodies_move_as_pinocchio_has_it() -> None:
    mechanism, rng = built(everything()), np.random.default_rng(4)
    model, data, bodies = mechanism.model, mechanism.model.createData(), mechanism.table.bodies()
    for _ in range(20):
        q, v = random_state(mechanism, rng)
        move(bodies, q, v)
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        for joint in range(1, model.njoints):
            place, state = data.oMi[joint], bodies.state[joint]
            assert np.abs(state[:9].reshape(3, 3) - place.rotation).max() < 1e-13
            assert np.abs(state[core.AT : core.LINEAR] - place.translation).max() < 1e-13
            assert np.abs(state[core.LINEAR : core.LINEAR_DRIFT] - place.act(data.v[joint]).vector).max() < 1e-12
            assert np.abs(state[core.LINEAR_DRIFT :] - place.act(data.a[joint]).vector).max() < 1e-12


def test_names_stand_for_one_thing() -> None:
    mechanism = built(everything())
    names = mechanism.names
    assert names.find("talos.leg_left_4_joint") == names.find("leg_left_4_joint")
    assert names.find("talos.left_foot.z").row == names.find("left_foot.z").row == names.find("left_sole_link.z").row
    assert names.find("leg.lower") == names.find("xi1_1")
    assert all(name in names for name in names)
    state = mechanism.state({"leg.azimuth": 0.3, "leg.elevation": 1.0, "root.pitch": 0.2}, {"psi1_dot": 0.5, "root.yaw_dot": 0.1})
    back = mechanism.coordinates(state)
    assert back["phi1"] == pytest.approx(0.3, abs=1e-13) and back["psi1"] == pytest.approx(1.0, abs=1e-13)
    assert back["psi1_dot"] == pytest.approx(0.5, abs=1e-12) and back["root.yaw_dot"] == pytest.approx(0.1, abs=1e-13)
