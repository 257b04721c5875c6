"""What an evaluation of a robot may cost beside Pinocchio's own calls."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import vlmb
from vlmb.system.robot_engine import RobotEngine
from vlmb.system.robot_start import robot_start
from vlmb.system.robot_system import make_robot_system

HUMANOID = Path(__file__).resolve().parents[2] / "models" / "robots" / "humanoid_on_snowboard.toml"
MOST = 5.0  # times crba, nonLinearEffects and the Cholesky


@pytest.mark.acceptance
def test_an_evaluation_of_a_humanoid_costs_at_most_five_times_the_bare_calls() -> None:
    system = make_robot_system(vlmb.build(vlmb.load_scene(HUMANOID)))  # type: ignore[arg-type]
    start = robot_start(system)
    engine = RobotEngine(system, start.state)
    model, y = system.mechanism.model, engine.pack(start.state)
    data = pin.Data(model)

    def bare() -> None:
        pin.crba(model, data, start.state.q)
        pin.nonLinearEffects(model, data, start.state.q, start.state.v)
        pin.cholesky.decompose(model, data)

    best = [np.inf, np.inf]
    for _ in range(20):  # in turn, so that a slow spell of the machine hits both
        for which, call in enumerate((bare, lambda: engine.workspace.rhs(0.0, y))):
            call()
            began = time.thread_time()
            for _ in range(100):
                call()
            best[which] = min(best[which], time.thread_time() - began)
    assert best[1] < MOST * best[0], f"{best[1] / best[0]:.2f} times the bare calls"
