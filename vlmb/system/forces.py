"""Applied forces: generalized forces of the paper's coordinates, hinge torques, laws of time, a control callable.

A generalized force Q of the paper's coordinates enters as tau = L^T Q: Q_phi and Q_psi of link i make the torque
N_i = (Q_phi / cos psi) u_psi - Q_psi u_phi, which has no part along d_i, and tau = J_i^T N_i with the angular Jacobian of
the link. A torque along d_i would spin a thin rod up, so none is ever applied.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, SimulationError, SingularError
from vlmb.model.arrays import pinocchio_states
from vlmb.model.coordinates import POLE, read_angles
from vlmb.model.frozen import read_only
from vlmb.model.layout import State
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import DOT, GeneralizedForce
from vlmb.model.reading import Postures, read_along
from vlmb.scene.laws import Law, time_law
from vlmb.system.frames import LinkFrames, Vector, between

Array = NDArray[np.float64]
Control = Callable[[float, "StateView"], Mapping[str, float]]


def column(channel: GeneralizedForce, frames: LinkFrames, branch: Sequence[float], out: Array) -> Array:
    """Write into `out` (nv,) the tau of a unit force in a channel; `branch` holds the last accepted coordinates.

    Raises SingularError at the pole of M_phi, and for a hinge torque between lined-up links.
    """
    out[:] = 0.0
    layout, i = frames.layout, channel.link
    if channel.kind == "axis":
        out[channel.v] = 1.0
    elif channel.kind == "surface":
        cosine, sine, _ = frames.heading()
        out[:2] = (cosine, -sine) if channel.v == 0 else (sine, cosine)
    elif layout.plane:
        if channel.kind == "hinge":
            out[channel.v] = 1.0
        else:
            hx, hy, _ = frames.heading()
            frames.torque(i, (hy, -hx, 0.0), out)
    elif channel.kind == "hinge":
        parent = layout.links[i].parent
        first = frames.heading() if parent < 0 else frames.direction(parent)
        axis, sine, _ = between(first, frames.direction(i))
        if sine < POLE:
            raise SingularError(
                f"T_{layout.links[i].name}: the link and its parent line up, where this hinge torque has no axis; "
                "bend the hinge at the start, or use M_psi or a spring between directions"
            )
        frames.torque(i, axis, out)
        frames.torque(parent, (-axis[0], -axis[1], -axis[2]), out)
    else:
        at = layout.index[f"psi{i + 1}"]
        phi, psi = read_angles(frames.direction(i), (branch[at - 1], branch[at]))
        frames.torque(i, moment(channel, phi, psi), out)
    return out


def moment(channel: GeneralizedForce, phi: float, psi: float) -> Vector:
    """Torque N_i of a unit M_phi or M_psi: u_psi / cos psi, or -u_phi. Raises SingularError at the pole of M_phi."""
    sin_phi, cos_phi = math.sin(phi), math.cos(phi)
    if channel.kind == "psi":
        return sin_phi, -cos_phi, 0.0
    cos_psi, sin_psi = math.cos(psi), math.sin(psi)
    if abs(cos_psi) < POLE:
        raise SingularError(
            f"{channel.name}: link {channel.link + 1} stands at the pole (|cos psi| < {POLE:g}), where the torque "
            "M_phi / cos(psi) is unbounded; use a hinge torque T_<link> or an equation for the link's direction"
        )
    return -cos_phi * sin_psi / cos_psi, -sin_phi * sin_psi / cos_psi, 1.0


class StateView:
    """What a control callable sees by name: coordinates, rates, `speed`, `t`, parameters, points such as `legs.tip.z`.

    `values` and Pinocchio's `q`, `v` are read-only copies.
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
        if name in self.values:
            return self.values[name]
        quantity = self.mechanism.names.find(name, "control")
        return float(self.postures.read(quantity, self.coordinates, self.rates))

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
        """Return the forces (S,). What the control raises goes through; SceneError, SimulationError for a wrong answer."""
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
    laws: tuple[Law, ...]
    inputs: tuple[str, ...] | None  # None: nothing comes from outside

    @property
    def needed(self) -> bool:
        """Whether there is any; a control may give none at first and be refused later."""
        return bool(self.channels) or self.inputs is not None


def applied_forces(mechanism: Mechanism, inputs: Sequence[str] | None) -> AppliedForces:
    """Collect a scene's forces and the named inputs. Raises SceneError for a force that cannot exist."""
    scene = mechanism.scene
    found: list[GeneralizedForce] = []
    laws: list[Law] = []
    for index, force in enumerate(scene.forces):
        if force.on is not None and force.law is not None:
            found.append(mechanism.names.force(force.on, f"forces[{index}].on"))
            laws.append(time_law(force.law, scene.parameters, f"forces[{index}].law"))
    found += [mechanism.names.force(name, "control") for name in inputs or ()]
    return AppliedForces(tuple(found), tuple(laws), None if inputs is None else tuple(inputs))


class ForceWriter:
    """Writes applied forces into tau; `values` and `columns` are those of the last instant. Work is counted per name.

    Inputs come from the control, or are those that `held` has; unknown ones are nan.
    """

    def __init__(self, mechanism: Mechanism, forces: AppliedForces, frames: LinkFrames, control: Control | None) -> None:
        self.mechanism, self.forces, self.frames = mechanism, forces, frames
        self.channels, self.laws, self.inputs = forces.channels, forces.laws, forces.inputs or ()
        self.held = [math.nan] * len(self.inputs)
        self.reader = None if control is None else ControlReader(control, self.inputs)
        self.values = np.zeros(len(self.channels))
        self.columns = np.zeros((len(self.channels), mechanism.layout.nv))
        self.constant = all(channel.kind == "axis" for channel in self.channels)
        if self.constant:
            self._write_columns(())

    def add(self, t: float, q: Array, v: Array, tau: Array, branch: Sequence[float]) -> None:
        """Add the tau of every applied force; the frames must be up to date.

        Angles are read on the branch nearest to `branch`.
        """
        for at, law in enumerate(self.laws):
            self.values[at] = law.value(t)
        if self.forces.inputs is not None:
            self.values[len(self.laws) :] = self.held if self.reader is None else self.ask(t, q, v, branch)
        if not self.constant:
            self._write_columns(branch)
        tau += self.values.dot(self.columns)

    def _write_columns(self, branch: Sequence[float]) -> None:
        for at, channel in enumerate(self.channels):
            column(channel, self.frames, branch, self.columns[at])

    def ask(self, t: float, q: Array, v: Array, branch: Sequence[float]) -> list[float]:
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
