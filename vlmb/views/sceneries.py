"""The scenery of whatever is shown: of links alone, or with robots."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import VlmbError
from vlmb.model.mechanism import Mechanism
from vlmb.simulation.trajectory import Trajectory
from vlmb.studies.modes import Mode
from vlmb.views import visual_model
from vlmb.views.visual_model import Scenery

if TYPE_CHECKING:
    from vlmb.model.robot_mechanism import RobotMechanism

Array = NDArray[np.float64]


def of_state(mechanism: Mechanism | RobotMechanism, state: tuple[Any, Any], arrows: bool = False) -> Scenery:
    """Return the scenery of one posture."""
    if isinstance(mechanism, Mechanism):
        return visual_model.of_state(mechanism, state, arrows)
    from vlmb.views.robot_scenery import of_robot_state

    return of_robot_state(mechanism, state)


def of_trajectory(trajectory: Trajectory, fps: float = 60.0, arrows: bool = False, programme: Any = None) -> Scenery:
    """Return the scenery of a motion at `fps` frames a second; see `visual_model`."""
    if isinstance(trajectory.mechanism, Mechanism):
        return visual_model.of_trajectory(trajectory, fps, arrows, programme)
    from vlmb.simulation.robot_trajectory import RobotTrajectory
    from vlmb.views.robot_scenery import of_robot_run

    if not isinstance(trajectory, RobotTrajectory):
        raise VlmbError(f"{type(trajectory).__name__}: nothing that could be drawn")
    return of_robot_run(trajectory, fps)


def of_mode(mode: Mode) -> Scenery:
    """Return the scenery of the motion of a mode."""
    return replace(of_samples(mode.mechanism, mode.t, mode.q, mode.v), name=f"{mode.mechanism.scene.name}, {mode.told}")


def ends_of_mode(mode: Mode) -> Scenery:
    """Return the scenery of both ends of a mode at 0 and 1 s, and of its middle at 2 s."""
    q, t = np.array([*mode.ends, mode.middle]), np.arange(3.0)
    return visual_model.of_samples(mode.mechanism, t, q, np.zeros((3, mode.v.shape[1])), fps=1.0)


def of_samples(mechanism: Mechanism | RobotMechanism, t: Array, q: Array, v: Array) -> Scenery:
    """Return the scenery of samples (q, v) at t (N,) [s]."""
    if isinstance(mechanism, Mechanism):
        return visual_model.of_samples(mechanism, t, q, v)
    from vlmb.views.robot_scenery import of_robot_samples

    return of_robot_samples(mechanism, t, q)
