"""The start of a scene with robots: what is given is kept, welds and ideal rows move the rest, and that is told."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.core.frame_rows import rows_of_frames
from vlmb.errors import SceneError, SingularError
from vlmb.model.layout import State
from vlmb.model.names import DOT
from vlmb.scene.names import listed
from vlmb.system.degrees import in_degrees
from vlmb.system.robot_engine import scaled_condition, singular_motion
from vlmb.system.robot_system import RobotSystem
from vlmb.system.robot_workspace import SIDEWAYS, RobotWorkspace
from vlmb.system.start import Start

Array = NDArray[np.float64]

HELD = 1e-10  # [m, rad, 1/s] error of a row that counts as none
ALIKE = 1e-9  # relative size below which rows repeat each other
SINGULAR = 1e14  # condition of the scaled mass matrix at which a start is refused
MOST = 60  # steps of a search


def robot_start(system: RobotSystem, t0: float = 0.0) -> Start:
    """Complete and repair the scene's `[start]` at t0 [s].

    Unset: the posture of the robots' tables, links upright, rates 0. A programme starts with the error it has, which decays.
    Raises SceneError for unknown names, for welds and rows that no posture near meets, and for a singular mass matrix.
    """
    mechanism, scene = system.mechanism, system.mechanism.scene
    given = mechanism.names.canonical(scene.start, "start")
    for name in given:
        if name not in mechanism.names.known:
            raise SceneError(f"start.{name}: no such coordinate in this scene; {mechanism.names.hint(name)}")
    coordinates = {**mechanism.reference, **{name: float(given[name]) for name in mechanism.names.index if name in given}}
    rates = {f"{name}{DOT}": float(given.get(f"{name}{DOT}", 0.0)) for name in mechanism.names.index}
    for drive in system.drives:
        for name in (drive.name, drive.name + DOT):
            if name in given:
                raise SceneError(f"start.{name}: the law {drive.law.text!r} gives this length; remove it")
        coordinates[drive.name], rates[drive.name + DOT], _ = drive.law.jet(t0)
    if system.on_ski:
        _along_the_ski(given, coordinates["phi0"], rates)
    _refuse_outside(system, coordinates)
    state = mechanism.state(coordinates, rates)
    space = RobotWorkspace(system)
    q, v = _meet(system, space, t0, State(*state), _held(system, given), given)
    _refuse_singular(system, q)
    seen = mechanism.coordinates((q, v), coordinates)
    told = [
        f"start: {name} = {seen[name]:.9g} so that the equations hold" + (f" (given: {was:.9g})" if name in given else "")
        for name, was in {**coordinates, **rates}.items()
        if abs(seen[name] - was) > 1e-8
    ]
    if len(told) > 6:
        told = [*told[:5], f"start: and {len(told) - 5} more coordinates and rates, so that the equations hold"]
    out, jacobian = _rows(space, t0, q, v)
    rank = int(np.linalg.matrix_rank(_unit(jacobian[: system.eliminated]), tol=ALIKE)) if system.eliminated else 0
    if rank < system.eliminated:
        told.append(f"constraints: {system.eliminated} rows, {rank} of them independent at the start; the least reactions serve")
    servo = slice(system.eliminated, system.eliminated + system.servo)
    for row, error, speed in zip(system.info[servo], out[0, servo].tolist(), out[1, servo].tolist(), strict=True):
        if max(abs(error), abs(speed)) > 1e-9:
            told.append(f"start: {row.text!r} is off by {error:.3g}, its rate by {speed:.3g}; the error decays")
    told += [*_beyond_limits(system, q), *in_degrees(scene, mechanism.names)]
    names = tuple(mechanism.names.index)
    return Start(
        State(q, v), {name: seen[name] for name in names}, {name + DOT: seen[name + DOT] for name in names}, tuple(told), rank
    )


def _held(system: RobotSystem, given: dict[str, float]) -> set[str]:
    """Return the coordinates that stay as they are if the equations let them."""
    return {name for name in given if not name.endswith(DOT)} | {drive.name for drive in system.drives}


def _along_the_ski(given: dict[str, float], heading: float, rates: dict[str, float]) -> None:
    if "speed" in given and ("x_dot" in given or "y_dot" in given):
        raise SceneError("start.speed: give either speed or x_dot and y_dot, not both")
    c, s = math.cos(heading), math.sin(heading)
    speed = given.get("speed", c * rates["x_dot"] + s * rates["y_dot"])
    rates["x_dot"], rates["y_dot"] = speed * c, speed * s


def _refuse_outside(system: RobotSystem, coordinates: dict[str, float]) -> None:
    numbers = dict(system.mechanism.robots.links)
    for link in system.mechanism.scene.links:
        for which in (1, 2):
            name, (low, high) = f"xi{numbers[link.name]}_{which}", link.segment(which).bounds
            if name in coordinates and not low <= coordinates[name] <= high:
                raise SceneError(f"start.{name} = {coordinates[name]:g} m is outside its limits [{low:g}, {high:g}]")


def _rows(space: RobotWorkspace, t: float, q: Array, v: Array) -> tuple[Array, Array]:
    """Return z, z', drift (3, rows) and the rows (rows, nv) at a state."""
    rows_of_frames(*space.arguments, t, q, v, space.dy[: space.nq], space.out, space.matrix, space.laws)
    return space.out.copy(), space.matrix[: space.rows].copy()


def _unit(rows: Array) -> Array:
    sizes = np.linalg.norm(rows, axis=1)
    return rows[sizes > 0.0] / sizes[sizes > 0.0, None] if (sizes > 0.0).any() else np.zeros((1, rows.shape[1]))


def _columns(system: RobotSystem, coordinates: Iterable[str]) -> list[int]:
    """Return the velocities of the joints that coordinates belong to."""
    model, entries = system.mechanism.model, system.mechanism.names.entries
    index, found = system.mechanism.names.index, set[int]()
    for name in coordinates:
        if name in index:
            joint = model.joints[entries[index[name]].joint]
            found |= set(range(joint.idx_v, joint.idx_v + joint.nv))
    return sorted(found)


def _meet(
    system: RobotSystem, space: RobotWorkspace, t: float, state: State, given: set[str], values: dict[str, float]
) -> tuple[Array, Array]:
    """Return (q, v) with all ideal rows met: what is not given moves first, then all."""
    model, (q, v), count = system.mechanism.model, state, system.eliminated
    if not count:
        return q, v
    every, still = set(range(system.mechanism.table.velocities)), set(_columns(system, given))
    holonomic = np.array([row.holonomic for row in system.info[:count]], dtype=bool)
    nothing = np.zeros_like(v)
    for free in (sorted(every - still), sorted(every)):
        found, error = np.array(q), math.inf
        for _ in range(MOST):
            out, rows = _rows(space, t, found, nothing)
            error = float(np.abs(out[0, :count][holonomic]).max(initial=0.0))
            if not error > HELD or not free:
                break
            change = np.zeros(len(v))
            change[free] = -np.linalg.lstsq(rows[:count][holonomic][:, free], out[0, :count][holonomic], rcond=1e-9)[0]
            size = float(np.abs(change).max())
            found = pin.integrate(model, found, change * min(1.0, 0.3 / size) if size > 0.0 else change)
        if not error > HELD:
            q = found
            break
    else:
        raise _not_met(system, space, t, q, nothing, 0)
    kept = {name.removesuffix(DOT) for name in values if name.endswith(DOT)}
    kept |= {"x", "y", "phi0"} & given if "speed" in values else set()
    still = set(_columns(system, kept)) | ({0} if "speed" in values else set())
    for free in (sorted(every - still), sorted(every)):
        out, rows = _rows(space, t, q, v)
        if np.abs(out[1, :count]).max() <= HELD:
            break
        if free:
            v = np.array(v)
            v[free] -= np.linalg.lstsq(rows[:count][:, free], out[1, :count], rcond=1e-9)[0]
    if np.abs(_rows(space, t, q, v)[0][1, :count]).max() > 1e-7:
        raise _not_met(system, space, t, q, v, 1)
    if system.on_ski:
        v = np.array(v)
        v[SIDEWAYS] = 0.0
    return q, v


def _not_met(system: RobotSystem, space: RobotWorkspace, t: float, q: Array, v: Array, which: int) -> SceneError:
    error = np.abs(_rows(space, t, q, v)[0][which, : system.eliminated])
    names = dict.fromkeys(repr(system.info[k].text) for k in np.argsort(-error) if error[k] > 0.1 * error.max())
    what = "posture" if which == 0 else "rates"
    return SceneError(
        f"start: no {what} near it meet{'s' * (which == 0)} {', '.join(list(names)[:4])} (off by {error.max():.3g}): give a "
        "start nearer to it, or drop one that contradicts another"
    )


def _refuse_singular(system: RobotSystem, q: Array) -> None:
    model = system.mechanism.model
    mass = np.array(pin.crba(model, pin.Data(model), q))
    condition = scaled_condition(mass)
    if condition > SINGULAR:
        names = [name for at, name in enumerate(model.names) for _ in range(model.joints[at].nv if at else 0)]
        weak = listed(list(dict.fromkeys(singular_motion(mass, names))))
        raise SingularError(
            f"the mass matrix is singular at the start (condition {condition:.1e}): {weak} move without inertia; the URDF tells "
            "no mass or inertia for what they move: lock them (robots.locked), or start from another posture"
        )


def _beyond_limits(system: RobotSystem, q: Array) -> list[str]:
    """Say which joints start beyond the limits of the URDF."""
    model, found = system.mechanism.model, []
    for force in system.mechanism.names.forces.values():
        if force.joint:
            joint = model.joints[force.joint]
            low, high = float(model.lowerPositionLimit[joint.idx_q]), float(model.upperPositionLimit[joint.idx_q])
            if low < high and not low - 1e-9 <= q[joint.idx_q] <= high + 1e-9:
                found.append(force.along)
    return [f"start: beyond the limits of the URDF: {listed(found)}"] if found else []
