"""Histories: every force, and the account of energy, at every sample of a run."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.errors import VlmbError
from vlmb.model.frozen import read_only
from vlmb.scene.names import DAMPERS, ENERGIES, SNOW
from vlmb.scene.rows import rows_of
from vlmb.simulation.leg_histories import energy_of_legs
from vlmb.simulation.motion import Motion
from vlmb.simulation.phases import Stretch
from vlmb.system.constrained import SIDEWAYS
from vlmb.system.core_engine import CoreEngine
from vlmb.system.engines import make_engine
from vlmb.system.frames import LinkFrames
from vlmb.system.system import System

Array = NDArray[np.float64]

LOOKS = 50  # samples at which equations are looked at for doubts: their errors grow, they do not flash up


def forces_along(
    system: System, t: Array, q: Array, v: Array, work: Array, values: Array, inputs: Array, failed: bool
) -> dict[str, Any]:
    """Reactions, residuals, powers, controls, forces and torques in hinges, conditions of G, all (N, ...), in one pass.

    `values` (N, coordinates) keep the branches of angles, `inputs` (N, S) are forces from outside. What is not known is nan:
    where a run has failed there may be no forces, and where an input is not known there is none. `report` tells of a programme.
    """
    mechanism, count, workspace = system.mechanism, len(t), system.workspace()
    links = mechanism.layout.links
    texts = [row.text for row in system.info]
    ideal = texts[: len(mechanism.scene.constraints)]

    def unknown(*shape: int) -> Array:
        return np.full((count, *shape), np.nan)

    snowy = (*SNOW, "friction") if workspace.friction is not None else tuple(SNOW)
    found: dict[str, Any] = {"reactions": {name: unknown() for name in (*snowy, *ideal)}}
    found["residuals"] = {name: (unknown(), unknown()) for name in texts}
    found["powers"] = {name: unknown() for name in system.work_names}
    found["controls"] = {name: unknown() for name in system.work_names}
    found["hinges"], found["hinge_torques"] = unknown(len(links), 3), unknown(len(links), 3)
    if system.planted_dofs:
        found["ground"] = unknown(3)
    strengths, programme = unknown(2), workspace.solver.programme
    data = workspace.frames.data
    for i in range(count):
        if np.isnan(inputs[i]).any():
            continue
        try:
            now = workspace.evaluate(float(t[i]), np.concatenate([q[i], v[i], work[i]]), values[i].tolist(), inputs[i].tolist())
        except VlmbError:
            if failed:
                continue
            raise
        for name, value in now.controls.items():
            found["controls"][name][i] = value
        for name, value in now.powers.items():
            found["powers"][name][i] = value
        for name, value in now.reactions.items():
            found["reactions"][name][i] = value
        if system.planted_dofs:
            found["ground"][i] = now.ground
        for name, (position, velocity) in now.residuals.items():
            found["residuals"][name][0][i], found["residuals"][name][1][i] = position, velocity
        if now.knife_edge is not None:
            found["reactions"]["knife_edge"][i] = now.knife_edge
            snow = data.f[1]
            found["reactions"]["normal"][i] = snow.linear[2]
            found["reactions"]["roll_moment"][i], found["reactions"]["pitch_moment"][i] = snow.angular[0], snow.angular[1]
        pin.forwardKinematics(mechanism.model, data, q[i])
        for k, link in enumerate(links):
            turn, force = data.oMi[link.joint].rotation, data.f[link.joint]
            found["hinges"][i, k], found["hinge_torques"][i, k] = turn @ force.linear, turn @ force.angular
        if programme is not None:
            strengths[i] = programme.strengths(programme.control_matrix)
    with np.errstate(divide="ignore", invalid="ignore"):  # infinite where a row is lost
        found["conditions"] = np.fmax.reduce(strengths[:, 0], initial=0.0) / strengths[:, 1]
    frozen = {what: _frozen(value) for what, value in found.items()}
    return frozen | {"report": "" if programme is None else programme.report}


def slopes_along(system: System, motion: Motion, inputs: Array) -> tuple[Array, Array]:
    """Velocities and work states (N, m) as they were integrated, and their rates by the recorded inputs (N, S).

    Rates are nan where there are none: at a singular posture, or where an input is not known.
    """
    engine, many = make_engine(system, motion.branch[0], None, motion.engine), len(motion.branch) > 1
    found = np.full_like(motion.states, np.nan)
    for i, (t, y) in enumerate(zip(motion.t.tolist(), motion.states, strict=True)):
        if isinstance(engine, CoreEngine):
            engine.memory.inputs[:] = inputs[i]
            if many:
                engine.take_branch(motion.branch[i])
        else:
            engine.workspace.applied.held = inputs[i].tolist()
            engine.workspace.branch = motion.branch[i if many else 0].tolist()
        with contextlib.suppress(VlmbError):
            found[i] = engine.evaluate(t, y)
    first = system.core_plan.positions if motion.engine == "core" else system.mechanism.layout.nq
    return motion.states[:, first:], found[:, first:]


def held_along(system: System, motion: Motion) -> dict[str, tuple[Array | None, Array]]:
    """Position and velocity errors (LOOKS at most,) of what ideal rows hold, by name; (N,) of a knife edge by a multiplier."""
    found: dict[str, tuple[Array | None, Array]] = {}
    if system.knife_edge == "multiplier":
        found["knife_edge"] = None, motion.pinocchio[1][:, SIDEWAYS]
    if system.constraints is None:
        return found
    ideal = rows_of(system.mechanism.scene).ideal
    if not ideal:
        return found
    (q, v), values, frames = motion.pinocchio, motion.coordinates[0], LinkFrames(system.mechanism)
    at = np.linspace(0.0, len(motion.t) - 1.0, min(len(motion.t), LOOKS)).round().astype(int)
    errors = system.constraints.errors(frames, motion.t[at], q[at], v[at], values[at], len(ideal))
    for k, row in enumerate(ideal):
        found[row.name] = errors[0, :, k] if system.info[k].holonomic else None, errors[1, :, k]
    return found


def _frozen(value: Any) -> Any:
    """The same arrays, read-only."""
    if isinstance(value, dict):
        return {name: _frozen(entry) for name, entry in value.items()}
    return tuple(map(read_only, value)) if isinstance(value, tuple) else read_only(value)


def work_by_force(system: System, motion: Motion) -> dict[str, Array]:
    """Work (N,) [J] done by each applied force and prescribed segment, and lost in dampers (`dissipation`)."""
    return {name: motion.work[:, k] for k, name in enumerate(system.work_names)}


def energies_along(
    system: System, motion: Motion, work_by_force: Mapping[str, Array], stretches: Sequence[Stretch] = ()
) -> dict[str, Array]:
    """Energies (N,) [J] by name; `balance` is what the energy has changed beyond work done and losses."""
    found = np.zeros((len(ENERGIES), len(motion.t)))
    kinetic, potential, spring, total, work, lost, balance = found
    found[:3] = motion.energies(system).T
    if system.mechanism.scene.legs and stretches:
        spring += energy_of_legs(system.points, stretches, motion.postures)
    total[:] = kinetic + potential + spring
    balance[:] = total - total[0]
    for name, done in work_by_force.items():
        if name == DAMPERS:
            lost[:] = done
        else:
            work += done
    if work_by_force:
        balance[:] = balance - (work - work[0]) + (lost - lost[0])
    return dict(zip(ENERGIES, read_only(found), strict=True))
