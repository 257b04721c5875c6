"""The right-hand side of a mechanism's motion: which route it takes, its state, and every force at one instant."""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.errors import SceneError, nearest
from vlmb.model.coordinates import State, read_angles
from vlmb.model.long_chains import LONG_CHAIN, is_long
from vlmb.model.mechanism import Mechanism
from vlmb.scene.tables import Run
from vlmb.system.constrained import SIDEWAYS, ConstrainedSystem
from vlmb.system.constraints import RowInfo
from vlmb.system.dense import Dense
from vlmb.system.diagnostics import HUGE, Faults
from vlmb.system.forces import Actuation, Control, View
from vlmb.system.frames import LinkFrames
from vlmb.system.prescribed import prescribed_segments
from vlmb.system.recursive import along_heading, recursive
from vlmb.system.springs import SegmentSprings, direction_springs, free_segments
from vlmb.system.subchains import SubChains
from vlmb.system.types import Rhs

Array = NDArray[np.float64]

KNIFE_EDGES = ("reduction", "multiplier", "projection")
ROUTES = ("recursive", "dense", "subchains")
TURN = 0.5  # [rad] an azimuth turns no further between two references
ON_POLE = 1e-5  # [rad] nearer to the pole a link passes through it
TINY = 1e-300


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
    """Right-hand side of y = (q, v, work). Holds buffers: one thread at a time.

    `recursive` serves spring-dampers and the reduced knife edge, `subchains` the same on long chains, `dense` everything.
    """

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
        self.direction_springs = direction_springs(mechanism)
        self.prescribed = prescribed_segments(mechanism)
        self.known = [at.v for at in self.prescribed] + ([SIDEWAYS] if self.knife_edge == "reduction" else [])
        self.frames = LinkFrames(mechanism)
        view = None if control is None or start is None else View(mechanism, 0.0, start.q, start.v, None)
        self.actuation = Actuation(mechanism, self.frames, control, view)
        held = self.knife_edge in ("multiplier", "projection")
        self.system = ConstrainedSystem(mechanism, self.frames, run or mechanism.scene.run, held, gain, self.known)
        self.angled = self._angled()
        programme = self.system.programme
        names = [*(programme.names if programme else ()), *self.system.working_names]
        names += [channel.name for channel in self.actuation.channels] + [at.force for at in self.prescribed]
        dampers = [spring.damping for spring in self.direction_springs]
        dampers += [segment.damping for segment, _ in free_segments(mechanism)]
        self.work_names = (*dict.fromkeys(names), *(("dissipation",) if any(dampers) else ()))
        self.size = self.nq + self.nv + len(self.work_names)
        self.springs = SegmentSprings(mechanism)
        self.route = self._route(route, control)
        self.subchains = SubChains(mechanism) if self.route == "subchains" else None
        self.faults = Faults(mechanism, self.actuation, self.system, self.subchains)
        self._calls = [0]
        self._dense = Dense(
            mechanism, self.frames, self.springs, self.direction_springs, self.actuation, self.system, self.prescribed,
            self.knife_edge == "projection", self.work_names, self._calls, self.faults,
        )  # fmt: skip
        self.reference = [0.0] * len(layout.names)
        sliding = self.knife_edge == "reduction"
        self.rhs: Rhs
        if self.subchains is not None:
            self.rhs = self._long(self.subchains, sliding)
        elif self.route == "recursive":
            self.rhs = recursive(mechanism, self.springs, sliding, self.size, self._calls, self.faults)
        else:
            self.rhs = self._dense.rhs()

    def _route(self, route: str | None, control: Control | None) -> str:
        """Choose the fastest sound route, or refuse the one asked for where it does not serve."""
        simple = self.knife_edge in ("none", "reduction")
        light = simple and not (
            self.actuation.needed or self.direction_springs or self.prescribed or self.system.rows is not None
        )
        if route is None:
            if control is None and simple and is_long(self.mechanism.scene):
                return "subchains"
            return "recursive" if light and len(self.layout.links) <= LONG_CHAIN else "dense"
        if route == "recursive" and not light:
            raise SceneError("the recursive route serves spring-dampers and the reduced knife edge only; use 'dense'")
        if route == "subchains" and (control is not None or not simple):
            raise SceneError("the route 'subchains' serves springs, dampers and the reduced knife edge only; use 'dense'")
        return route

    @property
    def evaluations(self) -> int:
        """Right-hand sides so far."""
        return self._calls[0]

    @property
    def reference(self) -> list[float]:
        """Coordinates of the last accepted sample, by which angles keep their branch."""
        return self._dense.reference

    @reference.setter
    def reference(self, values: list[float]) -> None:
        self._dense.reference = values

    def forget(self) -> None:
        """Count right-hand sides from zero again."""
        self._calls[0] = 0

    def _long(self, chains: SubChains, sliding: bool) -> Rhs:
        """Sub-chains: every link a piece of its own, all at once in closed form."""
        model, nq, end, calls, damped = self.mechanism.model, self.nq, self.nq + self.nv, self._calls, bool(self.work_names)
        normalize, product, dy = pin.normalize, pin.tangentMapProduct, np.zeros(self.size)
        qdot, vdot = dy[:nq], dy[nq:end]

        def rhs(t: float, y: Array) -> Array:
            calls[0] += 1
            raw, v = y[:nq], y[nq:end]
            q = normalize(model, raw)
            vdot[...] = chains.accelerations(q, v)
            if not vdot.dot(vdot) < HUGE * HUGE:
                raise self.faults.not_finite(q, v, chains.springs(q, v))
            qdot[...] = product(model, raw, v)
            if damped:
                dy[-1] = chains.dissipation()
            return dy

        return along_heading(rhs, nq) if sliding else rhs

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
            self._dense.project(state.q, state.v)
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
        tau = np.zeros(self.nv)
        self._dense.forces(t, np.concatenate([q, v, y[self.nq + self.nv :]]), q, v, tau)
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

    @cached_property
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
