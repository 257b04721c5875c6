"""The workspace in which one run computes with a system by Pinocchio: its buffers, its right-hand side, all forces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.model.layout import SegmentIndex, State
from vlmb.model.mechanism import Mechanism
from vlmb.scene.tables import Run, Segment
from vlmb.system.branch import next_branch
from vlmb.system.constrained import SIDEWAYS, ConstraintSolver
from vlmb.system.constraints import Constraint, ConstraintSet
from vlmb.system.contacts import PhaseContacts
from vlmb.system.dense import Dense
from vlmb.system.diagnostics import Diagnostics
from vlmb.system.forces import AppliedForces, Control, ForceWriter
from vlmb.system.frames import LinkFrames
from vlmb.system.friction import SkiFriction
from vlmb.system.point_forces import is_named, outer_forces
from vlmb.system.prescribed import Prescribed
from vlmb.system.programme import ProgrammePlan
from vlmb.system.slips import Slips
from vlmb.system.springs import DirectionSpring, SegmentSprings
from vlmb.system.types import Evaluation, Rhs

Array = NDArray[np.float64]


class Equations(Protocol):
    """What a workspace is made of: the parts of a system."""

    @property
    def mechanism(self) -> Mechanism: ...  # noqa: D102
    @property
    def run(self) -> Run: ...  # noqa: D102
    @property
    def segments(self) -> tuple[tuple[Segment, SegmentIndex], ...]: ...  # noqa: D102
    @property
    def direction_springs(self) -> tuple[DirectionSpring, ...]: ...  # noqa: D102
    @property
    def prescribed(self) -> tuple[Prescribed, ...]: ...  # noqa: D102
    @property
    def prescribed_dofs(self) -> list[int]: ...  # noqa: D102
    @property
    def planted_dofs(self) -> list[int]: ...  # noqa: D102
    @property
    def forces(self) -> AppliedForces: ...  # noqa: D102
    @property
    def constraints(self) -> ConstraintSet | None: ...  # noqa: D102
    @property
    def info(self) -> tuple[Constraint, ...]: ...  # noqa: D102
    @property
    def programme(self) -> ProgrammePlan | None: ...  # noqa: D102
    @property
    def contacts(self) -> PhaseContacts | None: ...  # noqa: D102
    @property
    def knife_edge(self) -> str: ...  # noqa: D102
    @property
    def size(self) -> int: ...  # noqa: D102
    @property
    def work_names(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def reads_angles(self) -> bool: ...  # noqa: D102
    @property
    def angled(self) -> frozenset[int]: ...  # noqa: D102


class Workspace:
    """The buffers of one run of a system: right-hand side of y = (q, v, work), and all forces. One thread at a time."""

    def __init__(self, system: Equations, control: Control | None = None, branch: Sequence[float] | None = None) -> None:
        mechanism = system.mechanism
        self.system, self.mechanism, self.layout = system, mechanism, mechanism.layout
        self.nq, self.nv, self.size = self.layout.nq, self.layout.nv, system.size
        self.work_names, self.knife_edge = system.work_names, system.knife_edge
        self.frames = LinkFrames(mechanism)
        self.applied = ForceWriter(mechanism, system.forces, self.frames, control)
        held = self.knife_edge in ("multiplier", "projection")
        self.slips = None if system.contacts is None else Slips(mechanism, system.contacts)
        self.solver = ConstraintSolver(
            mechanism, self.frames, system.constraints, system.programme, held, system.run.gain, system.prescribed_dofs,
            self.slips,
        )  # fmt: skip
        self.springs = SegmentSprings(system.segments, self.nq)
        self.diagnostics = Diagnostics(mechanism, self.frames, self.applied, self.solver)
        self._calls = [0]
        self._branch = np.zeros(len(self.layout.names)) if branch is None else np.array(branch, float)
        self._dense = Dense(
            mechanism, self.frames, self.springs, system.direction_springs, self.applied, self.solver, system.prescribed,
            self.knife_edge == "projection", self.work_names, self._branch, self._calls, self.diagnostics, system.contacts,
            system.planted_dofs,
        )  # fmt: skip
        self.rhs: Rhs = self._dense.with_friction(self._dense.rhs(), self.unpack)

    @property
    def evaluations(self) -> int:
        """Right-hand sides so far."""
        return self._calls[0]

    @property
    def branch(self) -> list[float]:
        """Coordinates of the last accepted state, near which `rhs` reads angles."""
        return list(map(float, self._branch))

    @branch.setter
    def branch(self, values: Sequence[float]) -> None:
        self._branch[:] = values

    def pack(self, state: State) -> Array:
        """Return y = (q, v, 0) for a state, with no sideways velocity where the knife edge is reduced."""
        y = np.concatenate([state.q, state.v, np.zeros(len(self.work_names))])
        if self.knife_edge == "reduction":
            y[self.nq + SIDEWAYS] = 0.0
        return y

    def unpack(self, t: float, y: Array) -> State:
        """Return the state of y as the dynamics see it: normalized, prescribed segments exact, velocity on the knife edge."""
        state = State(pin.normalize(self.mechanism.model, y[: self.nq]), np.array(y[self.nq : self.nq + self.nv]))
        for at in self.system.prescribed:
            state.q[at.q], state.v[at.v], _ = at.law.jet(t)
        if self.knife_edge == "reduction":
            state.v[SIDEWAYS] = 0.0
        elif self.knife_edge == "projection":
            self._dense.project(state.q, state.v)
        return state

    def accept(self, t: float, y: Array) -> tuple[list[float], float]:
        """Return the branch at a state, which `rhs` goes by from now on, and the time [s] for which forces may rely on it."""
        if not self.system.reads_angles:
            return self.branch, math.inf
        if self.solver.programme is not None:
            self.rhs(t, y)
            self.solver.programme.accept()
        found, time = next_branch(self.frames, *self.unpack(t, y), self.branch, self.system.angled)
        self.branch = found
        return found, time

    @property
    def friction(self) -> SkiFriction | None:
        """Friction under the ski; None without."""
        return self._dense.friction

    def inputs(self, t: float, state: State) -> Array:
        """Ask the control, once, for the forces (S,) that it gives at a state."""
        asked = self.applied.reader is not None and self.applied.inputs
        return np.array(self.applied.ask(t, *state, self._branch) if asked else self.applied.held)

    def evaluate(
        self, t: float, y: Array, branch: Sequence[float] | None = None, inputs: Sequence[float] | None = None
    ) -> Evaluation:
        """Return accelerations and forces of one instant, all from one inverse-dynamics pass over the motion.

        Angles are read near `branch`, None: the last accepted one; `inputs` (S,) are the forces from outside, where no control
        is asked for them.
        """
        if branch is not None:
            self.branch = branch
        if inputs is not None:
            self.applied.held = list(inputs)
        system, solver = self.system, self.solver
        rates = self.rhs(t, y)
        vdot = np.array(rates[self.nq : self.nq + self.nv])
        powers = dict(zip(self.work_names, rates[self.nq + self.nv :].tolist(), strict=True))
        q, v = self.unpack(t, y)
        self.frames.update(q)
        tau = np.zeros(self.nv)
        self._dense.forces(t, np.concatenate([q, v, y[self.nq + self.nv :]]), q, v, tau)
        controls: dict[str, float] = {}
        acting = self._dense.acting()
        for channel, value in acting:
            if is_named(channel):
                controls[channel.name] = controls.get(channel.name, 0.0) + value
        residuals, reactions = {}, {}
        ideal = np.zeros(self.nv)
        if self._dense.friction is not None:
            reactions["friction"] = self._dense.friction.force
        if system.constraints is not None:
            values = system.constraints.evaluate(self.frames, t, q, v, self._branch)
            texts, pairs = [row.text for row in system.info], zip(values.z.tolist(), values.rate.tolist(), strict=True)
            residuals = dict(zip(texts, pairs, strict=False))
            multipliers = solver.multipliers[solver.held :]
            reactions |= dict(zip(texts, self._as_written(multipliers).tolist(), strict=False))
            ideal = multipliers @ values.jacobian[: solver.ideal] + solver.friction()
        if solver.programme is not None:
            tau += solver.forces()
        missing = pin.rnea(self.mechanism.model, self.frames.data, q, v, vdot) - tau - ideal
        controls |= {at.force: float(missing[at.v]) for at in system.prescribed}
        if any(channel.kind == "point" or not is_named(channel) for channel, _ in acting):  # these come through no hinge
            outer = outer_forces(self.mechanism, self.mechanism.postures((q, v)), self.frames.data, acting)
            pin.rnea(self.mechanism.model, self.frames.data, q, v, vdot, outer)
        edge = float(missing[SIDEWAYS]) if self.layout.headed else None
        return Evaluation(vdot, tau, controls, edge, reactions, residuals, powers, self._ground(missing))

    def ground(self) -> Array:
        """Return the force (3,) [N] of the ground on a planted base at the last right-hand side; 0 on any other."""
        return self._ground(self._dense.lacking())

    def _ground(self, missing: Array) -> Array:
        found, held = np.zeros(3), self.system.planted_dofs
        found[[0, 2] if self.layout.plane and held else slice(len(held))] = missing[held]
        return found

    def _as_written(self, multipliers: Array) -> Array:
        """Return the multipliers of ideal rows as they are written: of azimuths the moments [N m] on their sum."""
        found = np.zeros(len(multipliers))
        for k, row in enumerate(self.system.info[: len(found)]):
            share, parts = multipliers[k], {k: 1.0}
            if row.regular:
                parts = row.regular.parts
                for name in row.regular.links:
                    share *= math.cos(self._branch[self.layout.index[name] + 1])
            for at, part in parts.items():
                found[at] += part * share
        return found
