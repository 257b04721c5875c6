"""What a programme does at an instant, found in its controls: M^-1, then least squares in what the last ones leave."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from vlmb.system.robot_workspace import RobotWorkspace

Array = np.ndarray


def null_space(g: Array) -> Array:
    _, sizes, ways = np.linalg.svd(g)
    return ways[int((sizes > 1e-9 * sizes.max(initial=0.0)).sum()) :].T


def nested(space: RobotWorkspace, q: Array, v: Array) -> tuple[Array, Array, Array]:
    """Return vdot, controls and multipliers at the last evaluation of a workspace, by its rows and forces alone."""
    held, servo = space.eliminated, space.system.servo
    mass = np.array(pin.crba(space.model, pin.Data(space.model), q))
    inverse = np.linalg.inv(np.triu(mass) + np.triu(mass, 1).T)
    jacobian, rows = space.matrix[:held], space.matrix[held : space.rows]
    wanted, scales = space.gains @ space.out.ravel(), space.scales
    tau = space.tau + space.values[: space.first_control] @ space.columns[: space.first_control]
    a = inverse @ (tau - pin.nonLinearEffects(space.model, pin.Data(space.model), q, v))
    moved = inverse @ (space.columns[space.first_control :] * scales[:, None]).T
    square = np.linalg.pinv(jacobian @ inverse @ jacobian.T, rcond=1e-11) if held else np.zeros((0, 0))
    first, by_control = square @ (wanted[:held] - jacobian @ a), -square @ jacobian @ moved
    a, moved = a + inverse @ jacobian.T @ first, moved + inverse @ jacobian.T @ by_control
    u, free = np.zeros(len(scales)), np.eye(len(scales))
    posed, weights = space.posed_v, np.sqrt(space.posed_weights)
    stages = [(rows[:servo], wanted[held : held + servo], 1.0), (rows[servo:], wanted[held + servo :], 1.0)]
    stages.append((np.eye(space.nv)[posed], space.back(q, v), weights[:, None]))
    for lines, asked, weight in stages:
        if len(lines):
            there, missing = weight * (lines @ moved), np.ravel(weight) * (asked - lines @ a)
            u = u + free @ np.linalg.lstsq(there @ free, missing - there @ u, rcond=1e-9)[0]
            free = free @ null_space(there @ free)
    return a + moved @ u, u * scales, first + by_control @ u
