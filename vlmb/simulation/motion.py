"""The samples of a run as its engine has them: where every point is, Pinocchio's states, energies."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.core.calls import energies_along
from vlmb.core.tree import AT_P
from vlmb.model.arrays import pinocchio_states
from vlmb.model.frozen import read_only
from vlmb.model.reading import Postures, read_along
from vlmb.scene.names import PHASE_START
from vlmb.system.constrained import SIDEWAYS
from vlmb.system.core_plan import CorePlan
from vlmb.system.frames import LinkFrames
from vlmb.system.point_forces import energy_of_springs
from vlmb.system.springs import spring_energy
from vlmb.system.system import System

Array = NDArray[np.float64]


class Motion:
    """Samples t (N,), states (N, size) of an engine; nothing is computed before it is asked for."""

    def __init__(
        self, system: System, engine: str, t: Array, states: Array, branch: Array, began: float | Array = 0.0
    ) -> None:
        """Take samples; `began` (N,) are the times [s] at which their phases began, which given lengths may go by."""
        self.system, self.engine, self.t, self.states, self.branch, self.began = system, engine, t, states, branch, began

    def _plans(self) -> list[tuple[NDArray[np.bool_] | slice, CorePlan]]:
        """List the core's plans with the samples they are for: one of each phase where lengths go by its time, else one."""
        if not any(PHASE_START in at.law.expression.names for at in self.system.prescribed):
            return [(slice(None), self.system.core_plan)]
        when = np.broadcast_to(self.began, np.shape(self.t))
        return [(when == began, self.system.core_plan.begun(float(began))) for began in np.unique(when)]

    @cached_property
    def postures(self) -> Postures:
        """Where every point is, and how it moves."""
        if self.engine == "core":
            plans, plan = self._plans(), self.system.core_plan
            if len(plans) == 1:
                return plans[0][1].postures(self.t, self.states)
            given = np.empty((len(self.t), *plan.arrays.given.shape))
            for own, phase in plans:
                given[own] = phase.given_at(phase.memory(), self.t[own])
            return plan.arrays.postures(self.states[:, : plan.positions + plan.velocities], given)
        return self.system.mechanism.postures(self.pinocchio)

    @cached_property
    def coordinates(self) -> tuple[Array, Array]:
        """The coordinates and their rates (N, coordinates)."""
        values, rates = read_along(self.postures, self.t, self.branch)
        return read_only(values), read_only(rates)

    @cached_property
    def pinocchio(self) -> tuple[Array, Array]:
        """Pinocchio's q (N, nq) and v (N, nv)."""
        layout = self.system.mechanism.layout
        if self.engine == "core":
            q, v = pinocchio_states(self.postures)
            if layout.on_snow and self.system.knife_edge == "reduction":
                v[:, SIDEWAYS] = 0.0  # its knife edge is crossed out, not computed
        else:
            q, v = self.states[:, : layout.nq], self.states[:, layout.nq : layout.nq + layout.nv]
        return read_only(q), read_only(v)

    @property
    def work(self) -> Array:
        """Work states (N, W) [J]."""
        return read_only(self.states[:, self.states.shape[1] - len(self.system.work_names) :])

    def energies(self, system: System) -> Array:
        """Kinetic energy, gravity's and that of the springs (N, 3) [J]."""
        if self.engine == "core":
            found = np.empty((len(self.t), 3))
            for own, plan in self._plans():
                memory = plan.memory()
                memory.near[:] = plan.spring_angles(self.branch[0])
                t, states = np.array(self.t[own]), np.array(self.states[own], order="C")
                energies = np.empty((len(t), 3))
                energies_along(plan.plant, memory, t, states, energies)
                found[own] = energies
        else:
            found = _by_pinocchio(system, *self.pinocchio)
        if system.mechanism.scene.springs:
            found[:, 2] += energy_of_springs(system.mechanism, self.postures)
        return found


def _by_pinocchio(system: System, q: Array, v: Array) -> Array:
    frames = LinkFrames(system.mechanism)
    model, data = system.mechanism.model, frames.data
    spring = spring_energy(system.mechanism, q)
    for i in range(len(q) if system.direction_springs else 0):
        frames.update(q[i])
        spring[i] += sum(entry.energy(frames, q[i]) for entry in system.direction_springs)
    kinetic = [pin.computeKineticEnergy(model, data, *state) for state in zip(q, v, strict=True)]
    potential = [pin.computePotentialEnergy(model, data, place) for place in q]
    return np.column_stack([kinetic, potential, spring])


def state_size(system: System, engine: str) -> int:
    """Numbers in a state of an engine."""
    if engine == "core":
        return system.core_plan.positions + system.core_plan.velocities + len(system.work_names)
    return system.size


def unit_directions(system: System, engine: str, states: Array) -> bool:
    """Whether the quaternions or directions of states (N, size) have length 1."""
    if engine == "core":
        tree, positions = system.core_plan.plant.tree, states[:, : system.core_plan.positions]
        starts = [int(at) for at in tree.link[:, AT_P]]
        return all(bool((np.abs(np.linalg.norm(positions[:, at : at + 3], axis=1) - 1.0) < 1e-3).all()) for at in starts)
    model = system.mechanism.model
    return all(pin.isNormalized(model, q, 1e-6) for q in states[:, : model.nq])
