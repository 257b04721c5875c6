"""The dense route: mass matrix and bias by Pinocchio, one Cholesky; it serves every force, row and form of the knife edge.

    M(q) vdot + h(q, v) = tau + J^T lambda + B u

A known acceleration (a prescribed segment's, and the ski's sideways one, which the knife edge keeps at zero) has its row and
column replaced by the identity; the force that keeps it is (M vdot + h - tau) of that row. So is that of
a free base which a contact holds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin
import scipy
from numpy.typing import NDArray

from vlmb.core.sliding import SLIDES
from vlmb.model.layout import State
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import LOST, STORED, GeneralizedForce
from vlmb.system.constrained import SIDEWAYS, ConstraintSolver
from vlmb.system.contacts import PhaseContacts
from vlmb.system.diagnostics import HUGE, Diagnostics
from vlmb.system.forces import ForceWriter
from vlmb.system.frames import LinkFrames
from vlmb.system.friction import SkiFriction
from vlmb.system.prescribed import Prescribed
from vlmb.system.programme import control_channels
from vlmb.system.springs import DirectionSpring, SegmentSprings, apply_springs
from vlmb.system.types import Rhs

Array = NDArray[np.float64]


class Dense:
    """Right-hand side of y = (q, v, work), and the forces at its last evaluation. Holds buffers: one thread at a time."""

    def __init__(
        self,
        mechanism: Mechanism,
        frames: LinkFrames,
        springs: SegmentSprings,
        direction_springs: Sequence[DirectionSpring],
        applied: ForceWriter,
        solver: ConstraintSolver,
        prescribed: Sequence[Prescribed],
        projecting: bool,
        work_names: Sequence[str],
        branch: Array,
        calls: list[int],
        diagnostics: Diagnostics,
        contacts: PhaseContacts | None = None,
        planted: Sequence[int] = (),
    ) -> None:
        self.mechanism, self.frames, self.springs, self.direction_springs = mechanism, frames, springs, direction_springs
        self.applied, self.solver, self.prescribed, self.projecting = applied, solver, prescribed, projecting
        self.work_names, self.branch, self.calls, self.diagnostics = work_names, branch, calls, diagnostics
        self.damped, self.contacts = "dissipation" in work_names, contacts
        self.friction = (
            SkiFriction(mechanism, frames.data) if mechanism.scene.base.friction and not mechanism.scene.base.lift else None
        )
        self.forced = bool(direction_springs or applied.forces.needed or self.friction)
        self._lost = 0.0  # power in the direction dampers [W]
        nv, self._planted = mechanism.layout.nv, list(planted)
        # of a planted base, at the last evaluation: its rows of M, h - tau of all, accelerations
        self._kept, self._missing, self._moved = np.zeros((len(planted), nv)), np.zeros(nv), np.zeros(nv)

    def forces(self, t: float, y: Array, q: Array, v: Array, tau: Array) -> None:
        """Write springs, dampers, applied forces and a control into tau (nv,); needs crba in WORLD convention before."""
        if self.forced:
            tau.fill(0.0)
        self.springs.write(y, tau)
        if self.direction_springs:
            self._lost = apply_springs(self.direction_springs, self.frames, q, v, tau)
        if self.applied.forces.needed:
            self.applied.add(t, q, v, tau, self.branch)
        if self.friction is not None:
            tau[0] += self.friction.force

    def acting(self) -> list[tuple[GeneralizedForce, float]]:
        """Return all forces by law, by input and by the programme, with their values at the last evaluation."""
        found = list(zip(self.applied.channels, self.applied.values.tolist(), strict=True))
        if self.solver.programme is not None:
            found += zip(control_channels(self.mechanism), self.solver.controls.tolist(), strict=True)
        return found

    def with_friction(self, rhs: Rhs, unpack: Callable[[float, Array], State]) -> Rhs:
        """Return the right-hand side with the friction under the ski, from three answers of the one without it."""
        friction, nq, nv = self.friction, self.mechanism.layout.nq, self.mechanism.layout.nv
        if friction is None:
            return rhs

        def sliding(t: float, y: Array) -> Array:
            state = unpack(t, y)

            def answer(force: float) -> tuple[float, float, float]:
                friction.force = force
                vdot = np.array(rhs(t, y)[nq : nq + nv])
                edge = float(self.solver.multipliers[0]) if friction.carves else 0.0
                return friction.normal(state, vdot, self.acting()), edge, float(vdot[0])

            friction.solve(float(state.v[0]), answer)
            dy = rhs(t, y)
            if friction.found[SLIDES] == 0.0:
                dy[nq] = 0.0
            if self.damped:
                dy[-1] -= friction.force * float(state.v[0])
            return dy

        return sliding

    def project(self, q: Array, v: Array) -> None:
        """Subtract M^-1 e_y v_y / (M^-1)_yy: the velocity nearest in kinetic energy that obeys the knife edge."""
        mass = np.asfortranarray(self.frames.update(q))
        unit = np.zeros(len(v))
        unit[SIDEWAYS] = 1.0
        for at in self.prescribed:
            mass[at.v], mass[:, at.v] = 0.0, 0.0
            mass[at.v, at.v] = 1.0
        _, answer, info = scipy.linalg.lapack.dposv(mass, unit, overwrite_a=1)
        if info:
            raise self.diagnostics.singular(q)
        v -= answer * (v[SIDEWAYS] / answer[SIDEWAYS])
        v[SIDEWAYS] = 0.0

    def rhs(self) -> Rhs:
        """Make the right-hand side.

        The tangent map is linear in a quaternion, so the raw one brings its norm along; the ski's x and y lose it again.
        """
        layout, model, data = self.mechanism.layout, self.mechanism.model, self.frames.data
        nq, nv, end, size = layout.nq, layout.nv, layout.nq + layout.nv, layout.nq + layout.nv + len(self.work_names)
        crba, nle, normalize, world = pin.crba, pin.nonLinearEffects, pin.normalize, pin.Convention.WORLD
        product, dposv, mass = pin.tangentMapProduct, scipy.linalg.lapack.dposv, data.M
        subtract, hypot, calls = np.subtract, math.hypot, self.calls
        dy, tau, accelerations = np.zeros(size), np.zeros(nv), np.zeros(nv)
        qdot, vdot, planar = dy[:nq], dy[nq:end], nq == nv  # planar: no quaternions, and rates are velocities
        prescribed, known, projecting = self.prescribed, self.solver.prescribed_dofs, self.projecting
        flat, (crossed, identity) = mass.ravel(order="K"), cross_of(known, nv)
        on_ski, last = layout.headed, nv - 1
        constrained, solver, forces, diagnostics = self.solver.needed, self.solver, self.forces, self.diagnostics
        rows, working, powers, branch = np.zeros((len(prescribed), nv)), bool(self.work_names), self._powers(), self.branch
        planted, kept, first = self._planted, self._kept, len(self._planted)  # a base's velocities come first
        self._moved = vdot

        def rhs(t: float, y: Array) -> Array:
            calls[0] += 1
            raw, v = y[:nq], y[nq:end]
            q = normalize(model, raw)
            if prescribed or projecting:
                v = v.copy()
                for at in prescribed:
                    q[at.q], v[at.v], accelerations[at.v] = at.law.jet(t)
                if projecting:
                    self.project(q, v)
                    y = np.concatenate([raw, v, y[end:]])
            crba(model, data, q, world)
            forces(t, y, q, v, tau)
            b = nle(model, data, q, v)
            subtract(tau, b, b)
            missing = b
            if prescribed or planted:
                missing = self._missing = -b
            if planted:
                kept[:] = mass[planted]
            if prescribed:
                for row, at in enumerate(prescribed):
                    rows[row] = mass[at.v]
                b -= mass.dot(accelerations)
            for k in known:
                b[k] = accelerations[k]
            if known:
                flat[crossed] = identity
            if constrained:
                answer = solver.solve(t, q, v, b, accelerations if prescribed else None, branch)
                if answer is None:
                    raise diagnostics.singular(q)
                if prescribed or planted:
                    missing -= solver.on_prescribed()
            else:
                if planted:  # alone, what is not crossed out comes out as on a pivot to the last digit
                    answer, info = b, 0
                    if first < nv:
                        b[first:], info = dposv(mass[first:, first:], b[first:], 0)[1:]
                else:
                    answer, info = dposv(mass, b, 0, 1, 1)[1:]  # both overwritten
                if info:
                    raise diagnostics.singular(q)
            vdot[...] = answer
            if not -HUGE < answer.item(0) + answer.item(last) < HUGE:  # nan and infinity spread to both
                raise diagnostics.not_finite(q, v, tau)
            qdot[...] = v if planar else product(model, raw, v)
            if on_ski:
                norm = hypot(raw.item(2), raw.item(3))
                dy[0] /= norm
                dy[1] /= norm
            if working:
                powers(y, v, vdot, rows, missing, dy)
            return dy

        return rhs

    def lacking(self) -> Array:
        """Return (M vdot + h - tau) of a planted base at the last evaluation, 0 elsewhere: what holds it."""
        found = np.zeros(len(self._moved))
        found[self._planted] = self._kept @ self._moved + self._missing[self._planted]
        return found

    def _powers(self) -> Callable[[Array, Array, Array, Array, Array, Array], None]:
        """Write the rates of the work states: power of each applied force, of each prescribed segment, of the dampers."""
        names, start, applied = self.work_names, self.mechanism.layout.nq + self.mechanism.layout.nv, self.applied
        account = {STORED: -1, LOST: -2}
        slots = [account[c.kind] if c.kind in account else start + names.index(c.name) for c in applied.channels]
        solver, springs = self.solver, self.springs
        own = {} if self.contacts is None else self.contacts.work_of()
        worked = [solver.info[row.worker].text for row in solver.info[: solver.ideal] if row.worker >= 0]
        acting = [channel.name for channel in control_channels(self.mechanism)] + [own.get(text, text) for text in worked]
        controlled = [start + names.index(name) for name in acting]
        rubbing = {name: start + at for at, name in enumerate(names)} if solver.slips is not None else {}
        driven = [(start + names.index(at.force), at.v) for at in self.prescribed]

        def powers(y: Array, v: Array, vdot: Array, rows: Array, missing: Array, dy: Array) -> None:
            dy[start:] = 0.0
            if controlled:
                for slot, power in zip(controlled, solver.powers(v).tolist(), strict=True):
                    dy[slot] += power
            for name, power in solver.friction_powers().items() if rubbing else ():
                if name in rubbing:
                    dy[rubbing[name]] += power
            lost = 0.0
            if slots:
                for slot, value, rate in zip(slots, applied.values.tolist(), applied.columns.dot(v).tolist(), strict=True):
                    if slot >= 0:
                        dy[slot] += value * rate
                    elif slot == account[LOST]:
                        lost -= value * rate
            for row, (slot, at) in enumerate(driven):
                dy[slot] = (rows[row].dot(vdot) + missing[at]) * v[at]
            if self.damped:
                dy[-1] = springs.dissipation(y) + self._lost + lost

        return powers


def cross_of(known: Sequence[int], nv: int) -> tuple[NDArray[np.intp], Array]:
    """Flat indices of the rows and columns of known velocities in a column-major M, and the identity's entries there."""
    identity, crossed = np.eye(nv), np.zeros((nv, nv), dtype=bool)
    crossed[known], crossed[:, known] = True, True
    indices = np.flatnonzero(crossed.ravel(order="F"))
    return indices, identity.ravel(order="F")[indices]
