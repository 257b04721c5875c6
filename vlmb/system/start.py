"""The start: what the user gave is kept, the rest follows, and what had to be repaired is reported."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, nearest
from vlmb.model.coordinates import make_state
from vlmb.model.layout import Layout, State, segment_of
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import counted
from vlmb.scene.names import listed
from vlmb.system.degrees import in_degrees
from vlmb.system.start_branches import choose_branch
from vlmb.system.start_rows import given_values, meet_positions, meet_rates, rank_of, row_sets
from vlmb.system.system import System

Array = NDArray[np.float64]


class Start(NamedTuple):
    """A consistent start: the state, all coordinates and rates by name, and what was adjusted."""

    state: State
    coordinates: dict[str, float]
    rates: dict[str, float]
    adjustments: tuple[str, ...]  # what was moved or filled in, in sentences
    rank: int  # of the ideal constraints, on what may move
    followed: frozenset[str] = frozenset()  # coordinates that follow a law of time

    @property
    def branch(self) -> list[float]:
        """The coordinates (N,) in their order: near them angles are read."""
        return list(self.coordinates.values())

    def __repr__(self) -> str:
        values = [f"{name} = {value:.6g}" for name, value in {**self.coordinates, **self.rates}.items() if value]
        return f"<Start: {listed(values) or 'all 0'}; {counted(len(self.adjustments), 'adjustment')}>"


def consistent_start(system: System, t0: float = 0.0) -> Start:
    """Complete and repair the scene's `[start]`, at the time t0 [s].

    Unset: phi 0, psi pi/2, xi the segment's length, rates 0, then moved as little as needed for the constraints and the
    programme to hold. Ideal constraints must hold: where they cannot, given values are repaired too. A programme may start
    with an error, which then decays. Raises SceneError for unknown names, values on a prescribed segment, lengths outside
    their limits, and constraints that no posture meets.
    """
    mechanism = system.mechanism
    layout, given = mechanism.layout, given_values(mechanism)
    followed = {at.name for at in system.prescribed}
    _refuse_unknown(mechanism, given, followed)
    coordinates: dict[str, float] = {}
    for coordinate in layout.coordinates:
        if coordinate.kind == "xi":
            default = segment_of(layout, coordinate).length
        else:
            default = math.pi / 2 if coordinate.kind == "psi" else 0.0
        coordinates[coordinate.name] = given.get(coordinate.name, default)
    rates = {f"{name}_dot": given.get(f"{name}_dot", 0.0) for name in layout.names}
    for at in system.prescribed:
        jet = at.law.jet(t0)
        if not all(map(math.isfinite, jet)):
            reach = mechanism.signals.reach(at.law.text)
            why = f"has no finite value, rate and acceleration at t = {t0:g} s{reach}"
            raise SceneError(f"{at.name}: the law {at.law.text!r} {why}")
        coordinates[at.name], rates[f"{at.name}_dot"], _ = jet
    _refuse_outside_limits(mechanism, coordinates)
    sets = row_sets(system, t0)
    adjustments = meet_positions(mechanism, followed, coordinates, sets)
    if layout.lifts and "speed" in given:
        heading = coordinates["phi0"]
        rates["x_dot"], rates["y_dot"] = given["speed"] * math.cos(heading), given["speed"] * math.sin(heading)
    adjustments += _along_the_ski(layout, given, coordinates["phi0"], rates) if layout.edged else []
    adjustments += meet_rates(mechanism, followed, coordinates, rates, sets)
    adjustments += choose_branch(system, followed, coordinates, rates, sets)
    adjustments += in_degrees(mechanism.scene, mechanism.names)
    count = len(mechanism.scene.constraints)
    rank = max((rank_of(system, entry, coordinates, rates) for entry in sets if entry.ideal), default=0)
    if rank < count:
        adjustments.append(f"constraints: {count} equations, {rank} of them independent at the start; the least reactions serve")
    return Start(make_state(layout, coordinates, rates), coordinates, rates, tuple(adjustments), rank, frozenset(followed))


def _along_the_ski(layout: Layout, given: dict[str, float], heading: float, rates: dict[str, float]) -> list[str]:
    """Make x_dot and y_dot obey the knife edge: one given determines the other, two are projected on the heading."""
    cosine, sine = math.cos(heading), math.sin(heading)
    both = "x_dot" in given and "y_dot" in given
    speed = given.get("speed", cosine * rates["x_dot"] + sine * rates["y_dot"])
    if "speed" not in given and not both:
        for name, share in (("x_dot", cosine), ("y_dot", sine)):
            if name in given and given[name] != 0.0:
                if abs(share) < 1e-12:
                    raise SceneError(f"start.{name} = {given[name]}: the ski's heading leaves no motion this way; give speed")
                speed = given[name] / share
    rates["x_dot"], rates["y_dot"] = speed * cosine, speed * sine
    sideways = cosine * given.get("y_dot", 0.0) - sine * given.get("x_dot", 0.0)
    if both and abs(sideways) > 1e-12 * max(1.0, abs(speed)):
        return [f"sideways velocity {sideways:.6g} m/s of the ski removed; it moves along itself at {speed:.6g} m/s"]
    return []


def _refuse_unknown(mechanism: Mechanism, given: dict[str, float], followed: set[str]) -> None:
    layout, valid = mechanism.layout, mechanism.names.known
    for name in given:
        if name not in valid:
            hint = " (with plane = true a link has no azimuth)" if layout.plane and name.startswith("phi") else ""
            raise SceneError(f"start.{name}: no such coordinate in this scene{hint}; {nearest(name, valid)}")
        if name.removesuffix("_dot") in followed:
            raise SceneError(f"start.{name}: this segment follows its law; remove the start value")
    if "speed" in given and ("x_dot" in given or "y_dot" in given):
        raise SceneError("start.speed: give either speed or x_dot and y_dot, not both")


def _refuse_outside_limits(mechanism: Mechanism, coordinates: dict[str, float]) -> None:
    for coordinate in mechanism.layout.coordinates:
        if coordinate.kind == "xi":
            low, high = mechanism.segment(coordinate).bounds
            if not low <= coordinates[coordinate.name] <= high:
                raise SceneError(
                    f"start.{coordinate.name} = {coordinates[coordinate.name]:g} m is outside its limits [{low:g}, {high:g}]; "
                    "change it, or the segment's `limits`"
                )
