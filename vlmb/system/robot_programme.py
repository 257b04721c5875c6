"""The programme of a scene with robots: its gains, the scales of its controls, the efforts that a URDF allows."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, nearest
from vlmb.model.robot_mechanism import RobotMechanism
from vlmb.model.robot_names import RobotForce
from vlmb.scene.by_phase import keyed
from vlmb.scene.tables import DEFAULT_STEP, FIXED_STEP, Posture, Programme, Run
from vlmb.system.constraints import Constraint
from vlmb.system.gains import MovingGains, fixed_number, moving_gains
from vlmb.system.programme import ProgrammePlan, check_border, secondary_gains_of, united_decay, united_gains

Array = NDArray[np.float64]

NO_LIMIT = 1e29  # what a URDF says of a joint that has none


def effort_limits(mechanism: RobotMechanism, forces: Sequence[RobotForce]) -> Array:
    """Return the efforts [N, N m] that the URDF allows each force; infinite where it tells none."""
    model, found = mechanism.model, []
    for force in forces:
        limit = float(model.upperEffortLimit[model.joints[force.joint].idx_v]) if force.joint else math.inf
        found.append(limit if 0.0 < limit < NO_LIMIT else math.inf)
    return np.array(found)


def _scales(mechanism: RobotMechanism, programme: Programme, controls: Sequence[RobotForce]) -> Array:
    """1/sqrt(R_s): a given weight, the URDF's effort limit, or m g (forces), m g times a metre (moments)."""
    names = [force.name for force in controls]
    for name in programme.weights:
        if name not in names:
            raise SceneError(f"programme.weights.{name}: not one of the controls; {nearest(name, names)}")
    given = dict[str, float]()
    for name, text in programme.weights.items():
        value = fixed_number(text, f"programme.weights.{name}", mechanism.scene.parameters)
        if value is not None and not value > 0.0:
            raise SceneError(f"programme.weights.{name} = {text!r:.80}: a weight is above 0")
        if value is not None:
            given[name] = value
    weight = mechanism.table.mass * (mechanism.scene.gravity or 9.81)
    limits = effort_limits(mechanism, controls)
    default = [limit if math.isfinite(limit) else weight for limit in limits.tolist()]
    return np.array([
        given[name] ** -0.5 if name in given else scale for name, scale in zip(names, default, strict=True)
    ])  # fmt: skip


def posture_of(programme: Programme) -> Posture:
    """Return the posture of a programme, the first one of several that act at once."""
    return next((part.posture for _, part in keyed(programme) if part.posture is not None), Posture())


def read_moving_gains(
    mechanism: RobotMechanism, programme: Programme, controls: Sequence[RobotForce], names: Collection[str]
) -> MovingGains:
    """Read what of a programme the motion gives. Raises ExpressionError."""
    return moving_gains(programme, [force.name for force in controls], names, mechanism.scene.parameters)


def make_robot_plan(
    mechanism: RobotMechanism, programme: Programme, controls: Sequence[RobotForce], rows: Sequence[Constraint],
    second: Sequence[Constraint], run: Run, moving: MovingGains,
) -> ProgrammePlan:  # fmt: skip
    """Choose gains and check them. Raises SceneError for too few controls and for gains under which errors would grow."""
    if len(rows) > len(controls):
        raise SceneError(f"programme: {len(rows)} rows need at least as many controls; there are {len(controls)}")
    known = mechanism.names.forces
    for name in posture_of(programme).weights:
        if f"T_{name}" not in known:
            joints = [force.along for force in known.values() if force.joint]
            raise SceneError(f"programme.posture.weights.{name}: no joint of a robot; {nearest(name, joints)}")
    check_border(programme, len(rows), len(controls))
    if programme.u0 is not None and programme.posture is not None:
        raise SceneError("programme.u0: `posture` takes what the rows leave free, and u0 does too; drop one of them")
    step = (run.step or DEFAULT_STEP) if run.method in FIXED_STEP else None
    own = max(1.0, math.sqrt(max(mechanism.scene.gravity, 1e-3)))
    holonomic = np.array([row.holonomic for row in rows], dtype=bool)
    h, k = united_gains(keyed(programme), holonomic, own, step, mechanism.scene.parameters)
    decay = united_decay(programme, holonomic, h, k, moving, run.method, step)
    second_holonomic = np.array([row.holonomic for row in second], dtype=bool)
    second_h = second_k = np.zeros((0, 0))
    if second:
        given = [(key, secondary_gains_of(part)) for key, part in keyed(programme) if part.secondary]
        second_h, second_k = united_gains(given, second_holonomic, own, step, {})
    return ProgrammePlan(
        tuple(row.text for row in rows), tuple(force.name for force in controls), _scales(mechanism, programme, controls),
        holonomic, h, k, decay, moving, second_holonomic, second_h, second_k,
    )  # fmt: skip


