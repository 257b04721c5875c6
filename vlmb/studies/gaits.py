"""Gaits: motions with events that come back, sought by shooting from event to event."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, SimulationError, StudyError, finite
from vlmb.model.mechanism import Mechanism, build
from vlmb.model.names import DOT, counted
from vlmb.scene.names import ENERGIES, listed
from vlmb.scene.scene import Scene, as_scene
from vlmb.simulation.simulate import simulate
from vlmb.simulation.trajectory import Trajectory
from vlmb.simulation.until import read_until
from vlmb.studies.beside import unlike
from vlmb.studies.derivatives import jacobian
from vlmb.studies.feet import Feet
from vlmb.studies.runs import tightened
from vlmb.studies.shooting import HELD, multipliers_of, shoot, stability_of
from vlmb.system.contacts import HELD as HELD_FAST
from vlmb.system.start import consistent_start
from vlmb.system.system import make_system

Array = NDArray[np.float64]
Values = dict[str, float]

SPEED = "speed"
SMALLEST, LARGEST = 0.1, 1.0  # of the size of what is free
NEARER, KNOWN = (1.0, 0.1, 0.01), 1e-7  # of those sizes, where derivatives are sought; their relative error that is enough
FAMILY = 1e-6  # singular values over the largest along which gaits go on
ALONG, SHARE = 1e-4, 1e-2  # of a period: where rates are read; of a motion along itself, what the section may leave of it


@dataclass(frozen=True, eq=False)
class Gait:
    """A motion that an event brings back to its start: all coordinates and rates there, its period [s], and the trajectory of it.

    `multipliers` (m,), the largest first: what deviations of what was free are multiplied by in a period; `uncertainty` of each.
    The section's own, 0 along the motion, is left out. `residual`: what a period lacks to come back. `family`: in how many
    directions gaits go on; it is one of them where that is not 0.
    """

    start: Values
    period: float
    multipliers: NDArray[np.complex128]
    uncertainty: Array
    residual: float
    trajectory: Trajectory
    free: tuple[str, ...]
    unknowns: int
    equations: int
    family: int

    @property
    def stability(self) -> str:
        """"asymptotically stable", "neutral" or "unstable", to first order, as far as multipliers are known."""
        return stability_of(self.multipliers, max(1e-6, float(self.uncertainty[:1].max(initial=0.0))))

    def __repr__(self) -> str:
        largest = float(np.abs(self.multipliers).max(initial=0.0))
        known = f" +- {float(self.uncertainty[0]):.1g}" if len(self.uncertainty) else ""
        counts = f"{counted(self.unknowns, 'unknown')}, {counted(self.equations, 'equation')}"
        one = f"; one of a family of {counted(self.family, 'dimension')}" if self.family else ""
        return f"<Gait of {self.period:.6g} s: {self.stability}, largest multiplier {largest:.6g}{known}; {counts}{one}>"


def find_gait(
    scene: Scene | str | Path | Mapping[str, Any], *, until: str, free: Sequence[str],
    mirror: Mapping[str, str] | None = None, advance: Mapping[str, float] | None = None,
    hold: Mapping[str, float] | None = None,
) -> Gait:  # fmt: skip
    """Find a gait near the start of a scene: a motion that an event takes back to where it began.

    Contacts that are closed at the start are start conditions: feet stay where they are, and what is not free follows from them
    and the ideal constraints. Which gait is found depends on the guess; gaits that come back after more than one such period are
    not sought.

    Parameters
    ----------
    until : the event that ends a period: "touch left", or an expression that falls through 0, as in `simulate`
    free : coordinates and rates at the start that are sought, and that the period brings back
    mirror : {link: link}: after a period these have changed places, with their contacts; in space left and right as well
    advance : {coordinate: by how much it has gone on after a period [m, rad]}
    hold : {quantity: its value at the start}, such as {"energy": 816.0}: conservative gaits come in families

    Raises SceneError for names that are none, StudyError where no gait is found, or its derivatives are not known.
    """
    scene = as_scene(scene)
    step = _Step(scene, until, free, mirror or {}, advance or {}, hold or {})
    u, residual = shoot(step, step.guess)
    if not residual <= HELD * max(1.0, float(np.abs(u).max())):
        raise StudyError(
            f"no gait near this start: a period that ends with {until!r} lacks {residual:.3g} to come back; begin nearer to one, "
            "or free other coordinates"
        )
    matrix, error = step.derivatives(u)
    values, uncertainty = multipliers_of(matrix, error)
    trajectory = step.run(u, samples=True)
    period = float(trajectory.t[-1])
    if step.along_is_lost(u, matrix, period):
        values, uncertainty = values[:-1], uncertainty[:-1]
    lacking = step.linear(u)
    lacking[: len(u)] = (matrix - np.eye(len(u))) * step.scales
    sizes = np.linalg.svd(lacking, compute_uv=False)
    family = int((sizes <= max(FAMILY, 10.0 * error) * max(1.0, float(sizes[0]))).sum())
    equations = len(u) + len(step.hold)
    return Gait(step.start(u), period, values, uncertainty, residual, trajectory, step.free, len(u), equations, family)


class _Step:
    """From a start to the event; what is sought is u, the values of what is free."""

    def __init__(
        self, scene: Scene, until: str, free: Sequence[str], mirror: Mapping[str, str], advance: Mapping[str, float],
        hold: Mapping[str, float],
    ) -> None:  # fmt: skip
        self.scene, self.until = tightened(scene, scene.run.duration), until
        mechanism = build(self.scene)
        if not isinstance(mechanism, Mechanism):
            raise StudyError("find_gait is there for scenes of links alone, not for robots")
        self.mechanism = mechanism
        event, named, expression = read_until(mechanism, until)
        fell = f" s: {expression.text} fell through 0." if expression is not None else ""
        self.ends = fell or (f" s: {event}." if event else f" s: {named}: ")  # how a run says that it came
        first = consistent_start(make_system(mechanism))
        self.prescribed = set(first.followed)
        self.values: Values = {**first.coordinates, **first.rates}
        begun = self._begun()
        self.ski = mechanism.layout.edged or (mechanism.layout.lifts and begun.stretches[0].footings[-1].state == HELD_FAST)
        if self.ski:  # its edge takes it along itself
            self.values[SPEED] = _speed(self.values)
            del self.values[f"x{DOT}"], self.values[f"y{DOT}"]
        self.free = self._free(free)
        self.mirror = _mirrored(mechanism, mirror)
        self.advance = self._named("advance", advance, self.free)
        self.hold = {name: finite(f"hold: {name}", value) for name, value in hold.items()}
        for name in self.hold:
            if name not in ENERGIES:
                mechanism.names.find(name, "hold")
        self.guess = np.array([self.values[name] for name in self.free])
        self.scales = np.clip(np.abs(self.guess), SMALLEST, LARGEST)
        self.feet = Feet(self.mechanism, self.values, self.free, self.prescribed, begun)

    def _free(self, free: Sequence[str]) -> tuple[str, ...]:
        if isinstance(free, str) or not free:
            raise SceneError(f"find_gait: free = {free!r:.80}: must be a list of coordinates and rates")
        names, found = self.mechanism.names, []
        for name in free:
            plain = names.find(name, "free").name
            if plain not in self.values:
                valid = ", ".join(known for known in self.values if known.removesuffix(DOT) not in self.prescribed)
                raise SceneError(f"find_gait: free: {name!r:.80} is none of the start's coordinates and rates: {valid}")
            if plain.removesuffix(DOT) in self.prescribed:
                raise SceneError(f"find_gait: free: {name} follows its law")
            found.append(plain)
        if len(set(found)) < len(found):
            raise SceneError("find_gait: free: names one of them twice")
        return tuple(found)

    def _named(self, what: str, given: Mapping[str, float], allowed: Sequence[str]) -> Values:
        found = {}
        for name, value in given.items():
            plain = self.mechanism.names.find(name, what).name
            if plain not in allowed:
                raise SceneError(f"find_gait: {what}: {name} is not free, and nothing is asked of it; free: {', '.join(allowed)}")
            found[plain] = finite(f"{what}: {name}", value)
        return found

    def _begun(self) -> Trajectory:
        """The first instants of the guess, by which feet are known."""
        return simulate(self.mechanism, 1e-9 + 1e-6 * self.scene.run.duration, t_eval=[0.0])

    def start(self, u: Array) -> Values:
        """Return all coordinates and rates at the start. Raises StudyError where feet and rows leave none."""
        found = self.feet.follow({**self.values, **dict(zip(self.free, u.tolist(), strict=True))})
        return {name: value for name, value in found.items() if name.removesuffix(DOT) not in self.prescribed}

    def run(self, u: Array, samples: bool = False) -> Trajectory:
        """Run to the event. Raises SimulationError where it does not come."""
        times = None if samples else [0.0, self.scene.run.duration]
        found = simulate(self.mechanism, start=self.start(u), t_eval=times, until=self.until)
        if found.status != "stopped" or self.ends not in found.message:
            none = f"nothing of it within run.duration = {self.scene.run.duration:g} s"
            why = none if found.status == "finished" else found.message
            raise SimulationError(f"a period that is to end with {self.until!r} does not: {why}")
        return found

    def back(self, trajectory: Trajectory) -> Array:
        """Return what a period brings back, in the places and the order of u."""
        end = trajectory.end
        values = {**end.coordinates, **end.rates}
        if self.ski:
            values[SPEED] = _speed(values)
        found = []
        for name in self.free:
            other, sign = self.mirror(name)
            found.append(sign * values[other] - self.advance.get(name, 0.0))
        return np.array(found)

    def lacking(self, u: Array) -> Array:
        """Return what a period lacks to come back, and what is held and is not so."""
        trajectory = self.run(u)
        apart = self.back(trajectory) - u
        for at, name in enumerate(self.free):
            if name.startswith(("phi", "psi")) and not name.endswith(DOT) and name not in self.advance:
                apart[at] = math.remainder(apart[at], math.tau)
        held = [(float(trajectory[name][0]) - value) / max(1.0, abs(value)) for name, value in self.hold.items()]
        return np.array([*apart, *held])

    def linear(self, u: Array) -> Array:
        """Return the derivatives of that by steps in units of `scales`."""
        matrix, _ = jacobian(lambda z: self.lacking(u + self.scales * z), np.zeros(len(u)), np.ones(len(u)), quick=True)
        return matrix

    def moved(self, u: Array, step: Array) -> Array:
        """Return u a step on."""
        return u + self.scales * step

    def derivatives(self, u: Array) -> tuple[Array, float]:
        """Return the derivatives (m, m) of what comes back, and their relative error: so far do steps of many sizes agree."""
        why, middle, others = "", self.run(u).turns, list[str]()

        def beside(at: Array) -> Array:
            found = self.run(at)
            others.append(unlike(middle, found.turns))
            return self.back(found)

        for nearer in NEARER:
            try:
                matrix, error = jacobian(beside, u, nearer * self.scales)
            except StudyError as failed:
                why = next((other for other in reversed(others) if other), str(failed))
                continue
            if error < KNOWN or nearer == NEARER[-1]:
                return matrix, error
        raise StudyError(
            f"the gait is there, but how deviations from it grow is not known ({why}): events may change their "
            "order beside it, or graze"
        )

    def along_is_lost(self, u: Array, matrix: Array, period: float) -> bool:
        """Whether a start that is moved along the motion comes back to the same: what is free crosses the section."""
        h = ALONG * period
        seen = simulate(self.mechanism, 4.0 * h, start=self.start(u), t_eval=[0.0, h, 2.0 * h])
        if len(seen.t) < 3:
            return False
        values = np.array([seen[name][:3] for name in self.free])
        rates = (-3.0 * values[:, 0] + 4.0 * values[:, 1] - values[:, 2]) / (2.0 * h)
        size = float(np.linalg.norm(rates / self.scales))
        return size > 0.0 and float(np.linalg.norm((matrix @ rates) / self.scales)) < SHARE * size


def _speed(values: Values) -> float:
    """Return the speed [m/s] of a ski along itself."""
    at = values["phi0"]
    return math.cos(at) * values[f"x{DOT}"] + math.sin(at) * values[f"y{DOT}"]


def _mirrored(mechanism: Mechanism, mirror: Mapping[str, str]) -> Callable[[str], tuple[str, float]]:
    """Return what gives the name that takes a name's place after a period, and its sign."""
    links, layout = mechanism.names.links, mechanism.layout
    pairs: dict[int, int] = {}
    for one, other in mirror.items():
        for name in (one, other):
            if name not in links:
                raise SceneError(f"find_gait: mirror: no link {name!r:.80}; links: {listed(list(links))}")
        for a, b in ((links[one], links[other]), (links[other], links[one])):
            if pairs.setdefault(a, b) != b:
                raise SceneError(f"find_gait: mirror: a link has one partner; {layout.links[a].name!r} has two")
    sideways = () if layout.plane or not mirror else ("y", "phi")
    partners = {}
    for coordinate in layout.coordinates:
        other = layout.names[layout.place(coordinate.kind, pairs.get(coordinate.link, coordinate.link), coordinate.segment)]
        partners[coordinate.name] = other, -1.0 if coordinate.name.startswith(sideways) and sideways else 1.0

    def found(name: str) -> tuple[str, float]:
        if name == SPEED:
            return name, 1.0
        other, sign = partners[name.removesuffix(DOT)]
        return (f"{other}{DOT}" if name.endswith(DOT) else other), sign

    return found
