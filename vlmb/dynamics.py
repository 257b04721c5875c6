"""The right-hand side: accelerations under forces, with known accelerations eliminated exactly.

    M(q) vdot + h(q, v) = tau + J^T lambda + B u

lambda: reactions of ideal rows J vdot = gamma; u: controls of a programme. A known acceleration (a prescribed segment's, and
the ski's sideways one, which the knife edge keeps at zero) has its row and column replaced by the identity; the force that
keeps it is (M vdot + h - tau) of that row.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.linalg import blas, lapack

from vlmb.constrained import SIDEWAYS, ConstrainedSystem
from vlmb.constraints import RowInfo
from vlmb.coordinates import Layout, State, read_angles, segment_of
from vlmb.cuts import is_cut
from vlmb.errors import SceneError, SimulationError, SingularError, VlmbError, nearest
from vlmb.forces import Actuation, Control, View
from vlmb.frames import LinkFrames
from vlmb.laws import Law, time_law
from vlmb.mechanism import Mechanism
from vlmb.scene import Run
from vlmb.springs import apply_springs, direction_springs, free_segments, spring_matrix
from vlmb.subchains import SubChains

Array = NDArray[np.float64]
Rhs = Callable[[float, Array], Array]

KNIFE_EDGES = ("reduction", "multiplier", "projection")
ROUTES = ("recursive", "dense", "subchains")
TURN = 0.5  # [rad] an azimuth turns no further between two references
ON_POLE = 1e-5  # [rad] nearer to the pole a link passes through it
TINY = 1e-300
SOUND = 1e12  # condition of the scaled mass matrix below which it is not what fails
HUGE = 1e200  # a squared acceleration beyond this is no number to go on with
RECURSIVE_LINKS = 24  # longer chains take another route: aba loses digits on them (benchmarks/results/rhs_cost.md)
RECURSIVE_ON_SKI = 12  # shorter ones on a ski too: it asks aba twice


class Prescribed(NamedTuple):
    """A segment whose length follows a law; `force` is the name of the force that results."""

    name: str
    force: str
    q: int
    v: int
    law: Law


class Evaluation(NamedTuple):
    """One instant: accelerations and every force by name."""

    vdot: Array
    tau: Array  # (nv,) springs, dampers, applied forces and controls
    controls: dict[str, float]  # applied forces, controls of the programme, forces of prescribed segments
    knife_edge: float | None  # [N], positive to the ski's left
    reactions: dict[str, float]  # multipliers of the ideal rows, by equation
    residuals: dict[str, tuple[float, float]]  # z and z' of every row, by equation
    powers: dict[str, float]  # rates of the work states [W]


class Dynamics:
    """Right-hand side of y = (q, v, work). Holds buffers: one thread at a time."""

    def __init__(
        self,
        mechanism: Mechanism,
        knife_edge: str = "reduction",
        gain: float = 0.0,
        control: Control | None = None,
        start: State | None = None,
        route: str | None = None,
        run: Run | None = None,
    ) -> None:
        for key, value, allowed in (("knife_edge", knife_edge, KNIFE_EDGES), ("route", route or "dense", ROUTES)):
            if value not in allowed:
                raise SceneError(f"{key} = {value!r}: no such {key}; {nearest(value, allowed)}")
        layout = mechanism.layout
        self.mechanism, self.layout = mechanism, layout
        self.nq, self.nv = layout.nq, layout.nv
        self.knife_edge = knife_edge if layout.base == "ski" else "none"
        self.gain = gain  # [1/s] Baumgarte: z'' + 2 gain z' + gain^2 z = 0; velocity rows z'' + gain z' = 0
        damped = any(segment.damping > 0.0 for segment, _ in free_segments(mechanism))
        self.direction_springs = direction_springs(mechanism)
        self.damped = damped or any(spring.damping for spring in self.direction_springs)
        self.prescribed = prescribed_segments(mechanism)
        self.known = [at.v for at in self.prescribed] + ([SIDEWAYS] if self.knife_edge == "reduction" else [])
        self.frames = LinkFrames(mechanism)
        view = None if control is None or start is None else View(mechanism, 0.0, start.q, start.v, None)
        self.actuation = Actuation(mechanism, self.frames, control, view)
        held = self.knife_edge in ("multiplier", "projection")
        self.system = ConstrainedSystem(mechanism, self.frames, run or mechanism.scene.run, held, gain, self.known)
        self.reference: list[float] = [0.0] * len(layout.names)  # coordinates of the last accepted sample
        rows = self.system.rows
        self.angled = self._angled()
        self.lost = 0.0  # power in the direction dampers [W]
        self.evaluations = 0
        programme = self.system.programme
        names = [*(programme.names if programme else ()), *self.system.working_names]
        names += [channel.name for channel in self.actuation.channels] + [at.force for at in self.prescribed]
        self.work_names = (*dict.fromkeys(names), *(("dissipation",) if self.damped else ()))
        self.size = self.nq + self.nv + len(self.work_names)
        springs_alone = not (
            self.actuation.needed or self.direction_springs or self.prescribed or self.damped or rows is not None
        )
        if route is None:
            fewest = {"none": 0, "reduction": RECURSIVE_ON_SKI}.get(self.knife_edge, RECURSIVE_LINKS + 1)
            light = springs_alone and fewest <= len(layout.links) <= RECURSIVE_LINKS
            long = control is None and self.knife_edge in ("none", "reduction") and is_cut(mechanism.scene)
            route = "subchains" if long else "recursive" if light else "dense"
        if route == "recursive" and not (springs_alone and self.knife_edge in ("none", "reduction")):
            raise SceneError("the recursive route serves undamped springs and the reduced knife edge only; use 'dense'")
        if route == "subchains" and (control is not None or self.knife_edge not in ("none", "reduction")):
            raise SceneError("the route 'subchains' serves springs, dampers and the reduced knife edge only; use 'dense'")
        self.route = route
        self.subchains = SubChains(mechanism) if route == "subchains" else None
        made = {"recursive": self._recursive, "dense": self._dense, "subchains": self._cut}
        self.rhs: Rhs = made[route]()

    @cached_property
    def springs(self) -> Array:
        """Matrix (nv, size) of the segment springs: tau = springs y + preload."""
        springs = np.zeros((self.nv, self.size), order="F")
        springs[:, : self.nq + self.nv] = spring_matrix(self.mechanism)[0]
        return springs

    @cached_property
    def preload(self) -> Array:
        """Forces (nv,) of the segment springs at length 0."""
        return spring_matrix(self.mechanism)[1]

    def pack(self, state: State) -> Array:
        """Return y = (q, v, 0) for a state, with no sideways velocity where the knife edge is reduced."""
        y = np.concatenate([state.q, state.v, np.zeros(len(self.work_names))])
        if self.knife_edge == "reduction":
            y[self.nq + SIDEWAYS] = 0.0
        return y

    def unpack(self, t: float, y: Array) -> State:
        """Return the state of y as the dynamics see it: normalized, prescribed segments exact, velocity on the knife edge."""
        state = State(pin.normalize(self.mechanism.model, y[: self.nq]), np.array(y[self.nq : self.nq + self.nv]))
        for at in self.prescribed:
            state.q[at.q], state.v[at.v], _ = at.law.jet(t)
        if self.knife_edge == "reduction":
            state.v[SIDEWAYS] = 0.0
        elif self.knife_edge == "projection":
            self._project(state.q, state.v)
        return state

    def accept(self, t: float, y: Array) -> float:
        """Take a state as the reference of the branches of angles; return the time [s] for which forces may rely on it.

        Near the pole an azimuth swings round within the time that the link needs for its distance from there.
        """
        if not self.reads_angles:
            return math.inf
        if self.system.programme is not None:
            self.rhs(t, y)
            self.system.programme.accept()
        (q, v), reference, time = self.unpack(t, y), self.reference, math.inf
        if self.layout.base == "ski":
            reference[2] += math.remainder(math.atan2(q[3], q[2]) - reference[2], math.tau)
        if self.layout.plane:
            return time
        pin.crba(self.mechanism.model, self.mechanism.data, q, pin.Convention.WORLD)
        for i, omega in enumerate(self.frames.all_omegas(v)[: len(self.layout.links)]):
            at = self.layout.index[f"psi{i + 1}"]
            direction = self.frames.direction(i)
            reference[at - 1 : at + 1] = read_angles(direction, (reference[at - 1], reference[at]))
            if i in self.angled:
                off_pole = max(math.hypot(direction[0], direction[1]), ON_POLE)
                time = min(time, TURN * off_pole / max(math.hypot(*omega), TINY))
        return time

    def evaluate(self, t: float, y: Array) -> Evaluation:
        """Return accelerations and forces of one instant, all from one inverse-dynamics pass over the motion."""
        rates = self.rhs(t, y)
        vdot = np.array(rates[self.nq : self.nq + self.nv])
        powers = dict(zip(self.work_names, rates[self.nq + self.nv :].tolist(), strict=True))
        q, v = self.unpack(t, y)
        model, data = self.mechanism.model, self.mechanism.data
        pin.crba(model, data, q, pin.Convention.WORLD)
        tau = self.springs.dot(np.concatenate([q, v, y[self.nq + self.nv :]])) + self.preload
        self._add_forces(t, q, v, tau)
        controls: dict[str, float] = {}
        for channel, value in zip(self.actuation.channels, self.actuation.values.tolist(), strict=True):
            controls[channel.name] = controls.get(channel.name, 0.0) + value
        system, residuals, reactions = self.system, {}, {}
        ideal = np.zeros(self.nv)
        if system.rows is not None:
            values = system.rows.evaluate(t, q, v, self.reference)
            texts, pairs = [row.text for row in system.info], zip(values.z.tolist(), values.rate.tolist(), strict=True)
            residuals = dict(zip(texts, pairs, strict=False))
            multipliers = system.multipliers[system.held :]
            shares = [self._per_angle(row) for row in system.info[: system.ideal]]
            reactions = dict(zip(texts, (multipliers * shares).tolist(), strict=False))
            ideal = multipliers @ values.jacobian[: system.ideal]
        if system.programme is not None:
            tau += system.forces()
            for name, value in zip(system.programme.names, system.controls.tolist(), strict=True):
                controls[name] = controls.get(name, 0.0) + value
        missing = pin.rnea(model, data, q, v, vdot) - tau - ideal
        controls |= {at.force: float(missing[at.v]) for at in self.prescribed}
        edge = float(missing[SIDEWAYS]) if self.layout.base == "ski" else None
        return Evaluation(vdot, tau, controls, edge, reactions, residuals, powers)

    def _per_angle(self, row: RowInfo) -> float:
        """What turns the multiplier of an azimuth row's regular form into the moment [N m] on the angle of its equation."""
        share = 1.0
        for name in row.azimuths or ():
            if name != "phi0":
                share *= math.cos(self.reference[self.layout.index[name] + 1])
        return share

    def is_holonomic(self, text: str) -> bool:
        """Whether a row, by its equation, is one of positions."""
        return any(row.holonomic for row in self.system.info if row.text == text)

    def _add_forces(self, t: float, q: Array, v: Array, tau: Array) -> None:
        if self.direction_springs:
            self.lost = apply_springs(self.direction_springs, self.frames, v, tau)
        if self.actuation.needed:
            self.actuation.add(t, q, v, tau, self.reference)

    def _project(self, q: Array, v: Array) -> None:
        """Subtract M^-1 e_y v_y / (M^-1)_yy: the velocity nearest in kinetic energy that obeys the knife edge."""
        mass = np.asfortranarray(pin.crba(self.mechanism.model, self.mechanism.data, q, pin.Convention.WORLD))
        unit = np.zeros(self.nv)
        unit[SIDEWAYS] = 1.0
        for k in self.known:
            mass[k], mass[:, k] = 0.0, 0.0
            mass[k, k] = 1.0
        _, answer, info = lapack.dposv(mass, unit, overwrite_a=1)
        if info:
            raise self.singular(q)
        v -= answer * (v[SIDEWAYS] / answer[SIDEWAYS])
        v[SIDEWAYS] = 0.0

    def _recursive(self) -> Rhs:
        """ABA in LOCAL convention; the knife edge by a second call, since vdot is affine in the sideways force."""
        model, data, nq, end = self.mechanism.model, self.mechanism.data, self.nq, self.nq + self.nv
        aba, normalize, product, local = pin.aba, pin.normalize, pin.tangentMapProduct, pin.Convention.LOCAL
        springs, preload, gemv, dy = self.springs, self.preload, blas.dgemv, np.zeros(self.size)
        qdot, vdot = dy[:nq], dy[nq:end]
        sliding = self.knife_edge == "reduction"

        def rhs(t: float, y: Array) -> Array:
            self.evaluations += 1
            raw, v = y[:nq], y[nq:end]
            q = normalize(model, raw)
            tau = gemv(1.0, springs, y, 1.0, preload)
            vdot[:] = aba(model, data, q, v, tau, local)
            if sliding:
                tau[SIDEWAYS] += 1.0
                unit = aba(model, data, q, v, tau, local)
                unit -= vdot
                unit *= vdot[SIDEWAYS] / unit[SIDEWAYS]
                np.subtract(vdot, unit, vdot)
                vdot[SIDEWAYS] = 0.0
            if not vdot.dot(vdot) < HUGE:
                raise self.not_finite(q, v, tau)
            qdot[:] = product(model, raw, v)
            if sliding:
                norm = math.hypot(y.item(2), y.item(3))
                dy[0] /= norm
                dy[1] /= norm
            return dy

        return rhs

    def _cut(self) -> Rhs:
        """Sub-chains: every piece a model of its own, joined by the forces in the cut hinges."""
        model, nq, end, chains = self.mechanism.model, self.nq, self.nq + self.nv, self.subchains
        normalize, product, dy = pin.normalize, pin.tangentMapProduct, np.zeros(self.size)
        qdot, vdot, sliding = dy[:nq], dy[nq:end], self.knife_edge == "reduction"
        assert chains is not None

        def rhs(t: float, y: Array) -> Array:
            self.evaluations += 1
            raw, v = y[:nq], y[nq:end]
            q = normalize(model, raw)
            vdot[:] = chains.accelerations(q, v)
            if not vdot.dot(vdot) < HUGE:
                raise self.not_finite(q, v, chains.springs(q, v))
            qdot[:] = product(model, raw, v)
            if sliding:
                norm = math.hypot(y.item(2), y.item(3))
                dy[0] /= norm
                dy[1] /= norm
            if self.damped:
                dy[-1] = chains.dissipation(v)
            return dy

        return rhs

    def _dense(self) -> Rhs:
        """CRBA, nonlinear effects and a LAPACK Cholesky in place.

        The tangent map is linear in a quaternion, so the raw one brings its norm along; the ski's x and y lose it again.
        """
        model, data, nq, end = self.mechanism.model, self.mechanism.data, self.nq, self.nq + self.nv
        crba, nle, normalize, world = pin.crba, pin.nonLinearEffects, pin.normalize, pin.Convention.WORLD
        product, dposv, mass = pin.tangentMapProduct, lapack.dposv, data.M
        subtract, divide, hypot = np.subtract, np.divide, math.hypot
        springs, preload, gemv, dy = self.springs, self.preload, blas.dgemv, np.zeros(self.size)
        qdot, vdot, place, accelerations = dy[:nq], dy[nq:end], dy[:2], np.zeros(self.nv)
        known, prescribed = self.known, self.prescribed
        flat, (crossed, identity) = mass.ravel(order="K"), self._cross(known)
        forced = bool(self.direction_springs or self.actuation.needed)
        on_ski, projecting = self.layout.base == "ski", self.knife_edge == "projection"
        constrained, system = self.system.needed, self.system
        rows, working, powers = np.zeros((len(prescribed), self.nv)), bool(self.work_names), self._powers()

        def rhs(t: float, y: Array) -> Array:
            self.evaluations += 1
            raw, v = y[:nq], y[nq:end]
            q = normalize(model, raw)
            if prescribed or projecting:
                v = v.copy()
                for at in prescribed:
                    q[at.q], v[at.v], accelerations[at.v] = at.law.jet(t)
                if projecting:
                    self._project(q, v)
                    y = np.concatenate([raw, v, y[end:]])
            tau = gemv(1.0, springs, y, 1.0, preload)
            crba(model, data, q, world)
            if forced:
                self._add_forces(t, q, v, tau)
            b = nle(model, data, q, v)
            subtract(tau, b, b)
            missing = b
            if prescribed:
                missing = -b
                for row, at in enumerate(prescribed):
                    rows[row] = mass[at.v]
                b -= mass.dot(accelerations)
            for k in known:
                b[k] = accelerations[k]
            if known:
                flat[crossed] = identity
            if constrained:
                answer = system.solve(t, q, v, b, accelerations if prescribed else None, self.reference)
                if answer is None:
                    raise self.singular(q)
                if prescribed:
                    missing -= system.on_known()
            else:
                answer, info = dposv(mass, b, 0, 1, 1)[1:]  # both overwritten
                if info:
                    raise self.singular(q)
            if not answer.dot(answer) < HUGE:
                raise self.not_finite(q, v, tau)
            qdot[:] = product(model, raw, v)
            vdot[:] = answer
            if on_ski:
                divide(place, hypot(raw.item(2), raw.item(3)), place)
            if working:
                powers(v, vdot, rows, missing, dy)
            return dy

        return rhs

    def _cross(self, known: list[int]) -> tuple[NDArray[np.intp], Array]:
        """Flat indices of the rows and columns of known velocities in a column-major M, and the identity's entries there."""
        identity, crossed = np.eye(self.nv), np.zeros((self.nv, self.nv), dtype=bool)
        crossed[known], crossed[:, known] = True, True
        indices = np.flatnonzero(crossed.ravel(order="F"))
        return indices, identity.ravel(order="F")[indices]

    def _powers(self) -> Callable[[Array, Array, Array, Array, Array], None]:
        """Write the rates of the work states: power of each applied force, of each prescribed segment, of the dampers."""
        names, start, actuation = self.work_names, self.nq + self.nv, self.actuation
        dampers = -np.diag(self.springs[:, self.nq : start]).copy()
        slots = [start + names.index(channel.name) for channel in actuation.channels]
        system = self.system
        controlled = system.acting + len(system.working)  # their work states come first
        driven = [(start + names.index(at.force), at.v) for at in self.prescribed]

        def powers(v: Array, vdot: Array, rows: Array, missing: Array, dy: Array) -> None:
            dy[start:] = 0.0
            if controlled:
                dy[start : start + controlled] = system.powers(v)
            if slots:
                for slot, value, rate in zip(slots, actuation.values, actuation.columns.dot(v), strict=True):
                    dy[slot] += value * rate
            for row, (slot, at) in enumerate(driven):
                dy[slot] = (rows[row].dot(vdot) + missing[at]) * v[at]
            if self.damped:
                dy[-1] = dampers.dot(v * v) + self.lost

        return powers

    @property
    def reads_angles(self) -> bool:
        """Whether forces need the branch of an angle, and so the last accepted sample."""
        angular = any(channel.kind in ("phi", "psi") for channel in self.actuation.channels)
        return self.system.rows is not None or self.actuation.control is not None or (angular and not self.layout.plane)

    def _angled(self) -> set[int]:
        """Links whose azimuth or elevation a force or an equation goes by; one that equates two azimuths has a regular form."""
        if self.actuation.control is not None:
            return set(range(len(self.layout.links)))
        rows = [row for row in self.system.rows.info if not row.azimuths] if self.system.rows else []
        read = {name.removesuffix("_dot") for row in rows for name in row.names}
        acting = {*self.actuation.channels, *(self.system.programme.channels if self.system.programme else ())}
        found = {channel.link for channel in acting if channel.kind in ("phi", "psi")}
        return found | {c.link for c in self.layout.coordinates if c.kind in ("phi", "psi") and c.name in read}

    def conditioning(self, q: Array) -> tuple[float, list[str]]:
        """Condition number of the mass matrix scaled to a unit diagonal, and the velocities of its weakest motion.

        Of sub-chains, that of the worst piece.
        """
        if self.subchains is not None:
            return self.subchains.conditioning(pin.normalize(self.mechanism.model, q))
        mass = np.array(pin.crba(self.mechanism.model, self.mechanism.data, pin.normalize(self.mechanism.model, q)))
        if not np.isfinite(mass).all():
            return math.inf, ["every coordinate"]
        scale = np.sqrt(np.maximum(np.diag(mass), 1e-300))
        values, vectors = np.linalg.eigh(mass / np.outer(scale, scale))
        motion, names = np.abs(vectors[:, 0]), velocity_names(self.layout)
        weakest = [names[k] for k in np.argsort(-motion)[:4] if motion[k] > 0.1 * motion.max()]
        condition = float(values[-1] / values[0]) if values[0] > 0.0 else math.inf
        return condition, list(dict.fromkeys(weakest))

    def singular(self, q: Array) -> VlmbError:
        """Name the motion without inertia at a configuration."""
        condition, weakest = self.conditioning(q)
        if condition < SOUND:
            return SimulationError("a position or velocity is too large to compute with: the motion has no finite continuation")
        return SingularError(
            f"the mass matrix is singular (condition {condition:.1e}): {', '.join(weakest)} can move without inertia. "
            f"{' '.join(self.mechanism.warnings)}".rstrip()
        )

    def not_finite(self, q: Array, v: Array, tau: Array) -> VlmbError:
        """Say which quantity is not finite."""
        self.system.require_finite()
        names, acting = velocity_names(self.layout), self.actuation
        for law, channel, value in zip(acting.laws, acting.channels, acting.values.tolist(), strict=False):
            if not math.isfinite(value):
                return SimulationError(f"the law {law.text!r} of the force on {channel.name} has no finite value")
        for what, values in (("force", tau), ("velocity", v)):
            bad = [names[k] for k in np.flatnonzero(~np.isfinite(values))]
            if bad:
                return SimulationError(f"the {what} of {', '.join(bad)} is not finite")
        if not np.isfinite(q).all():
            return SimulationError("the configuration is not finite")
        if self.conditioning(q)[0] < SOUND:
            worst = int(np.argmax(np.abs(tau)))
            where = f"the largest force, {tau[worst]:.3g}, is on {names[worst]}"
            return SimulationError(f"accelerations are no longer finite: {where}")
        return self.singular(q)


def prescribed_segments(mechanism: Mechanism) -> tuple[Prescribed, ...]:
    """Collect the prescribed segments and their laws."""
    found = []
    for coordinate in mechanism.layout.coordinates:
        if coordinate.kind == "xi":
            at = segment_of(mechanism.layout, coordinate)
            if at.motion == "prescribed":
                side = "lower" if coordinate.segment == 1 else "upper"
                text = mechanism.scene.links[coordinate.link].segment(coordinate.segment).law
                law = time_law(0.0 if text is None else text, mechanism.scene.parameters, f"links[{coordinate.link}].{side}.law")
                force = f"F{coordinate.link + 1}_{coordinate.segment}"
                found.append(Prescribed(coordinate.name, force, at.q, at.v, law))
    return tuple(found)


def velocity_names(layout: Layout) -> list[str]:
    """Name every velocity of v for messages."""
    names = [""] * layout.nv
    base = ("forward", "sideways", "yaw") if layout.base == "ski" else ("x", "y", "z")
    for k in range(layout.base_size):
        names[k] = f"base {base[k]}"
    for i, link in enumerate(layout.links):
        for k in range(1 if layout.plane else 3):
            names[link.v + k] = f"hinge of {link.name}"
        for which, segment in ((1, link.lower), (2, link.upper)):
            if segment.joint:
                names[segment.v] = f"xi{i + 1}_{which} of {link.name}"
    return names
