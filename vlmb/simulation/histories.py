"""Histories: every force, and the account of energy, at every sample of a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.errors import VlmbError
from vlmb.system.bars import chain_energies
from vlmb.system.dynamics import Dynamics
from vlmb.system.springs import spring_energy

Array = NDArray[np.float64]

SNOW = ("normal", "roll_moment", "pitch_moment")
ENERGIES = ("kinetic", "potential", "spring", "energy", "work", "dissipated", "balance")


def forces_along(
    dynamics: Dynamics, t: Array, q: Array, v: Array, work: Array, values: Array, failed: bool
) -> dict[str, Any]:
    """Reactions, residuals, powers, controls, forces and torques in hinges, conditions of G, all (N, ...), in one pass.

    `values` (N, coordinates) keep the branches of angles. Where a run has failed there may be no forces.
    """
    mechanism, count = dynamics.mechanism, len(t)
    links = mechanism.layout.links
    texts = [row.text for row in dynamics.system.info]
    ideal = texts[: dynamics.system.ideal]
    found: dict[str, Any] = {"reactions": {name: np.zeros(count) for name in ("knife_edge", *SNOW, *ideal)}}
    found["residuals"] = {name: (np.zeros(count), np.zeros(count)) for name in texts}
    found["powers"] = {name: np.zeros(count) for name in dynamics.work_names}
    found["controls"] = {name: np.zeros(count) for name in dynamics.work_names}
    found["hinges"], found["hinge_torques"] = np.zeros((count, len(links), 3)), np.zeros((count, len(links), 3))
    found["conditions"], programme = np.ones(count), dynamics.system.programme
    data = mechanism.data
    for i in range(count):
        dynamics.reference = values[i].tolist()
        try:
            now = dynamics.evaluate(float(t[i]), np.concatenate([q[i], v[i], work[i]]))
        except VlmbError:
            if failed:
                continue  # where a run fails there may be no forces
            raise
        for name, value in now.controls.items():
            found["controls"][name][i] = value
        for name, value in now.powers.items():
            found["powers"][name][i] = value
        for name, value in now.reactions.items():
            found["reactions"][name][i] = value
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
            found["conditions"][i] = programme.rank(programme.effect)[1]
    return found


def energies_along(dynamics: Dynamics, q: Array, v: Array, work_by_force: Mapping[str, Array]) -> dict[str, Array]:
    """Energies (N,) [J] by name; `balance` is what the energy has changed beyond work done and losses."""
    mechanism, count = dynamics.mechanism, len(q)
    spring = spring_energy(mechanism, q)
    if dynamics.subchains is not None:
        kinetic, potential = chain_energies(mechanism, q, v)
    else:
        model, data = mechanism.model, mechanism.data
        kinetic = np.array([pin.computeKineticEnergy(model, data, *state) for state in zip(q, v, strict=True)])
        potential = np.array([pin.computePotentialEnergy(model, data, place) for place in q])
    for i in range(count if dynamics.direction_springs else 0):
        pin.crba(mechanism.model, mechanism.data, q[i], pin.Convention.WORLD)
        spring[i] += sum(entry.energy(dynamics.frames) for entry in dynamics.direction_springs)
    total = kinetic + potential + spring
    work, lost = np.zeros(count), np.zeros(count)
    for name, done in work_by_force.items():
        if name == "dissipation":
            lost = done
        else:
            work = work + done
    balance = total - total[0] - (work - work[0]) + (lost - lost[0])
    values = (kinetic, potential, spring, total, work, lost, balance)
    return dict(zip(ENERGIES, values, strict=True))
