"""Applied forces: generalized forces of the paper's coordinates, hinge torques, laws of time, a control callable.

A generalized force Q of the paper's coordinates enters as tau = L^T Q: Q_phi and Q_psi of link i make the torque
N_i = (Q_phi / cos psi) u_psi - Q_psi u_phi, which has no part along d_i, and tau = J_i^T N_i with the angular Jacobian of
the link. A torque along d_i would spin a thin rod up, so none is ever applied. vlmb/core/joints.py writes what each is over v.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from vlmb.core.joints import forces_of_joints
from vlmb.errors import SceneError, SimulationError, nearest
from vlmb.model.arrays import pinocchio_states
from vlmb.model.frozen import read_only
from vlmb.model.laws import tape_breaks
from vlmb.model.layout import State
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import DOT, GeneralizedForce
from vlmb.model.reading import Postures, read_along
from vlmb.scene.expressions import Expression
from vlmb.system import interrupts
from vlmb.system.frames import LinkFrames
from vlmb.system.point_forces import is_named, scene_forces
from vlmb.system.readings import Readings, make_readings, no_direction

Array = NDArray[np.float64]
Control = Callable[[float, "StateView"], Mapping[str, float]]


class StateView:
    """What a control callable sees by name: coordinates, rates, `speed`, `t`, parameters, data, points such as `legs.tip.z`.

    Iterating gives every name, `name in view` tells of one. `values` and Pinocchio's `q`, `v` are read-only copies.
    """

    def __init__(
        self, mechanism: Mechanism, t: float, postures: Postures, branch: Sequence[float] | Array, state: State | None = None
    ) -> None:
        self.mechanism, self.t, self.postures, self._state = mechanism, t, postures, state
        values, rates = read_along(postures.as_samples(), np.array([t]), np.array([branch], float))
        self.coordinates, self.rates = read_only(values[0]), read_only(rates[0])
        named: dict[str, float] = {"t": t, **mechanism.scene.parameters}
        for name, value, rate in zip(mechanism.layout.names, self.coordinates.tolist(), self.rates.tolist(), strict=True):
            named[name], named[f"{name}{DOT}"] = value, rate
        self.values: Mapping[str, float] = MappingProxyType(named)

    def __getitem__(self, name: str) -> float:
        if not isinstance(name, str):
            raise SceneError(f"control: view[{name!r:.80}]: a name is needed, such as view['psi1']")
        if name in self.values:
            return self.values[name]
        if name in self.mechanism.signals:
            return float(self.mechanism.signals.along(name, np.array([self.t]))[0])
        if name not in self.mechanism.names:
            raise SceneError(f"control: unknown name {name!r:.80}; {self._hint(name)}")
        return float(self.postures.read(self.mechanism.names.find(name), self.coordinates, self.rates))

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and (name in self.values or name in self.mechanism.names or name in self.mechanism.signals)

    def __iter__(self) -> Iterator[str]:
        yield from self._own
        yield from self.mechanism.names

    def keys(self) -> list[str]:
        """Every name that `view[...]` knows."""
        return list(self)

    def __repr__(self) -> str:
        return f"<StateView at t = {self.t:.6g} s: {self.mechanism.names.shown}; `list(view)` has every name>"

    def _ipython_key_completions_(self) -> list[str]:
        return self.keys()

    @property
    def _own(self) -> tuple[str, ...]:
        """Names that are no quantities of the mechanism."""
        return ("t", *self.mechanism.scene.parameters, *self.mechanism.signals)

    def _hint(self, name: str) -> str:
        """Say which names come nearest: a parameter's, or what the mechanism says."""
        close = difflib.get_close_matches(name, self._own, n=1, cutoff=0.7)
        return nearest(name, close) if close else self.mechanism.names.hint(name)

    @cached_property
    def state(self) -> State:
        """Pinocchio's (q, v)."""
        q, v = pinocchio_states(self.postures) if self._state is None else self._state
        return State(read_only(np.array(q)), read_only(np.array(v)))

    @property
    def q(self) -> Array:
        """Pinocchio's configuration (nq,)."""
        return self.state.q

    @property
    def v(self) -> Array:
        """Pinocchio's velocity (nv,)."""
        return self.state.v

    def position(self, link: str, point: str = "tip") -> Array:
        """Position (3,) [m] of a point in the surface frame."""
        return self.mechanism.position_of(self.postures, link, point)


class ControlReader:
    """Asks a control for the inputs: forces by the names of its first call, in their order; 0 for one that it leaves out."""

    def __init__(self, control: Control, inputs: Sequence[str]) -> None:
        self.control, self.inputs = control, tuple(inputs)
        self.failure: BaseException | None = None  # what the control raised

    def ask(self, view: StateView) -> list[float]:
        """Return the forces (S,). What the control raises goes through; SceneError, SimulationError for a wrong answer.

        An interrupt that waits is answered here: a control may be slow.
        """
        interrupts.answer()
        try:
            answer = answer_of(self.control, view)
        except BaseException as error:
            self.failure = error
            raise
        for name in answer:
            if name not in self.inputs:
                first = ", ".join(self.inputs) or "none"
                raise SceneError(f"control: {name!r} was not among the forces of the first call ({first}): name it there, with 0")
        values = [answer.get(name, 0.0) for name in self.inputs]
        if not all(map(math.isfinite, values)):
            raise SimulationError(f"control returned a non-finite force: {answer}; its law must stay finite")
        return values


@dataclass(frozen=True)
class AppliedForces:
    """Which generalized forces act: those of laws, then the inputs, forces whose values come from outside, as of a control."""

    channels: tuple[GeneralizedForce, ...]
    laws: tuple[Expression, ...]
    inputs: tuple[str, ...] | None  # None: nothing comes from outside
    readings: Readings | None  # of the laws; None: nothing acts

    @property
    def needed(self) -> bool:
        """Whether there is any; a control may give none at first and be refused later."""
        return bool(self.channels) or self.inputs is not None

    @property
    def named(self) -> tuple[GeneralizedForce, ...]:
        """Those that are results, by their names; springs between points and drag are in the account of energy alone."""
        return tuple(filter(is_named, self.channels))

    @property
    def written(self) -> tuple[Expression, ...]:
        """The laws that the scene has as text."""
        return tuple(law for law, force in zip(self.laws, self.channels, strict=False) if is_named(force))

    def breaks(self, start: float, end: float) -> tuple[float, ...]:
        """Return the times in (start, end) where a law switches in time. Raises SceneError for too many."""
        if self.readings is None:
            return ()
        texts = ", ".join(law.text for law in self.written)
        return tape_breaks(self.readings.compiled, self.readings.parameters, start, end, texts)


def applied_forces(mechanism: Mechanism, inputs: Sequence[str] | None) -> AppliedForces:
    """Collect a scene's forces and the named inputs. Raises SceneError for a force that cannot exist."""
    acting = scene_forces(mechanism)
    found, laws = [entry.force for entry in acting], [entry.law for entry in acting]
    found += [mechanism.names.force(name, "control") for name in inputs or ()]
    readings = make_readings(mechanism, laws, found) if found else None
    return AppliedForces(tuple(found), tuple(laws), None if inputs is None else tuple(inputs), readings)


class ForceWriter:
    """Writes applied forces into tau; `values` and `columns` are those of the last instant. Work is counted per name.

    Inputs come from the control, or are those that `held` has; unknown ones are nan.
    """

    def __init__(self, mechanism: Mechanism, forces: AppliedForces, frames: LinkFrames, control: Control | None) -> None:
        self.mechanism, self.forces, self.frames = mechanism, forces, frames
        self.channels, self.laws, self.inputs = forces.channels, forces.laws, forces.inputs or ()
        self.held = [math.nan] * len(self.inputs)
        self.reader = None if control is None else ControlReader(control, self.inputs)
        self.values, self.layers = np.zeros(len(self.channels)), np.zeros(mechanism.layout.nv, np.int64)
        self.table = np.zeros((1, len(self.channels), mechanism.layout.nv))
        self.columns = self.table[0]
        if forces.readings is not None:
            self.integers, self.buffers = forces.readings.integers, forces.readings.buffers()

    def add(self, t: float, q: Array, v: Array, tau: Array, branch: Array) -> None:
        """Add the tau of every applied force; the frames must be up to date.

        Angles are read on the branch nearest to `branch`. Raises SingularError for a force without a direction, and for a law
        that reads an azimuth at the pole.
        """
        if self.inputs:
            self.values[len(self.laws) :] = self.held if self.reader is None else self.ask(t, q, v, branch)
        elif self.reader is not None:
            self.ask(t, q, v, branch)
        if not self.channels:
            return
        turning = self.frames.turning
        if not forces_of_joints(self.integers, self.buffers, t, q, v, turning, branch, self.layers, self.values, self.table):
            self.require_directions()
        tau += self.values.dot(self.columns)

    def require_directions(self) -> None:
        """Raise SingularError for a force that has no direction, or a law that reads an azimuth at the pole."""
        assert self.forces.readings is not None
        failed = np.flatnonzero(~np.isfinite(self.values[: len(self.laws)]))
        obstacle = self.forces.readings.obstacle(self.buffers, failed.tolist())
        if obstacle is not None:
            raise obstacle
        for channel, column in zip(self.channels, self.columns, strict=True):
            if not np.isfinite(column).all():
                raise no_direction(channel, self.frames.layout)

    def ask(self, t: float, q: Array, v: Array, branch: Sequence[float] | Array) -> list[float]:
        """Ask the control; its forces in the order of `inputs`."""
        assert self.reader is not None
        return self.reader.ask(StateView(self.mechanism, t, self.mechanism.postures((q, v)), branch, State(q, v)))


def known_rows(rows: Sequence[Array], count: int, width: int) -> Array:
    """Return the first rows of a record as (count, width), nan where it has not so many."""
    found = np.full((count, width), np.nan)
    for i, row in enumerate(rows[:count]):
        found[i] = row
    return found


def answer_of(control: Control | None, view: StateView) -> dict[str, float]:
    """Call a control and check what it returns: None, or numbers by name."""
    answer = None if control is None else control(view.t, view)
    if answer is None:
        return {}
    if not isinstance(answer, Mapping):
        raise SceneError(f"control returned {answer!r}: it must return a dict of force names and numbers, or None")
    try:
        return {str(name): float(value) for name, value in answer.items()}
    except (TypeError, ValueError):
        raise SceneError(f"control returned {dict(answer)!r}: every force must be a number") from None
