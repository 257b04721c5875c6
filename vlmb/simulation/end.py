"""Where a run ends, and another begins: all coordinates and rates by name."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import DOT
from vlmb.model.reading import Postures
from vlmb.scene.names import listed
from vlmb.scene.scene import Scene
from vlmb.system.start import Start
from vlmb.system.start_search import HELD

Array = NDArray[np.float64]

AT_POLE = 1e-12  # cos(psi) below which the rate of an azimuth is not read


@dataclass(frozen=True)
class End:
    """The last instant of a run: `simulate(scene, start=trajectory.end, t0=trajectory.end.time)` goes on from it.

    It holds all that goes on: angles with their full turns, feet of legs that stand. Work and losses are counted from zero again.
    """

    time: float  # [s]
    names: tuple[str, ...]
    values: tuple[float, ...]  # [m, rad] of the coordinates
    speeds: tuple[float, ...]  # [m/s, rad/s] of their rates
    feet: tuple[tuple[str, float, float], ...] = ()  # legs that stand, and where [m]

    @property
    def coordinates(self) -> dict[str, float]:
        """Coordinates [m, rad] by name."""
        return dict(zip(self.names, self.values, strict=True))

    @property
    def rates(self) -> dict[str, float]:
        """Rates [m/s, rad/s] by name, `psi1_dot`."""
        return {name + DOT: speed for name, speed in zip(self.names, self.speeds, strict=True)}

    def __repr__(self) -> str:
        shown = listed([f"{name} = {value:.6g}" for name, value in self.coordinates.items()])
        return f"<End at t = {self.time:.6g} s: {shown}; and rates>"


def end_of(
    seen: Postures, time: float, values: Array, rates: Array, feet: Sequence[tuple[str, float, float]] = ()
) -> End:
    """Make the end of a run of its last postures, coordinates (N,) and rates (N,), and the feet of legs that stand."""
    layout, values, rates = seen.layout, values.copy(), rates.copy()
    for i in range(0 if layout.plane else len(layout.links)):
        at = layout.place("psi", i)
        if abs(math.cos(values[at])) <= AT_POLE:
            values[at - 1], rates[at] = _azimuth_at_pole(seen.direction_rates[-1, i], values[at - 1], values[at], rates[at])
    return End(time, layout.names, tuple(values.tolist()), tuple(rates.tolist()), tuple(feet))


def _azimuth_at_pole(direction_rate: Array, phi: float, psi: float, rate: float) -> tuple[float, float]:
    """Return the azimuth nearest to phi whose plane a link at the pole moves in, d' = psi' u_psi, and psi'."""
    x, y = (-direction_rate[:2] * math.copysign(1.0, math.sin(psi))).tolist()
    if math.hypot(x, y) < AT_POLE:
        return phi, rate
    turn = math.remainder(math.atan2(y, x) - phi, math.pi)
    return phi + turn, x * math.cos(phi + turn) + y * math.sin(phi + turn)


def begun_at(mechanism: Mechanism, start: End | Mapping[str, float]) -> Mechanism:
    """Return a mechanism whose scene has another start: the end of a run as a whole, a dict laid over its own.

    Prescribed lengths have no start: they follow their laws. Raises SceneError for an end with other coordinates, and what
    a scene's start may not be.
    """
    names, scene = mechanism.names, mechanism.scene
    data = scene.to_dict()
    if isinstance(start, End):
        _refuse_other_coordinates(mechanism, start)
        lengths = [c for c in mechanism.layout.coordinates if c.kind == "xi"]
        followed = {c.name for c in lengths if mechanism.segment(c).motion == "prescribed"}
        told = {**start.coordinates, **start.rates}
        given = {name: value for name, value in told.items() if name.removesuffix(DOT) not in followed}
        kept: dict[str, Any] = {}
        if scene.legs:
            data["legs"] = _standing(scene, start)
    elif isinstance(start, Mapping):
        given = names.canonical(start, "start")
        over = {*given, *(("x_dot", "y_dot") if "speed" in given else ())}
        over |= {"speed"} if over & {"x_dot", "y_dot"} and "speed" not in given else set()
        kept = {name: value for name, value in names.canonical(data.get("start", {}), "start").items() if name not in over}
    else:
        hint = "; a trajectory has its `end`" if hasattr(start, "end") else ""
        raise SceneError(f"start = {start!r:.80}: must be the end of a run, or a dict of coordinates and rates by name{hint}")
    changed = Scene.from_dict({**data, "start": {**kept, **given}}, "arguments")
    return dataclasses.replace(mechanism, scene=changed)


def _standing(scene: Scene, end: End) -> list[dict[str, Any]]:
    """Return the legs of a scene as they stand, or swing, where a run has ended."""
    feet, found = {name: [x, y] for name, x, y in end.feet}, []
    for leg, data in zip(scene.legs, scene.to_dict()["legs"], strict=True):
        own = {key: value for key, value in data.items() if key != "foot"}
        found.append({**own, "foot": feet[leg.name]} if leg.name in feet else own)
    return found


def jumps(end: End, start: Start) -> list[str]:
    """Say which prescribed lengths and their rates do not go on where a run ended."""
    found = []
    for name, value in {**end.coordinates, **end.rates}.items():
        begins = {**start.coordinates, **start.rates}[name]
        if name.startswith("xi") and name.removesuffix(DOT) in start.followed and abs(begins - value) > HELD:
            found.append(f"start: {name} = {begins:.9g} by its law (the end of the run before: {value:.9g})")
    return found


def _refuse_other_coordinates(mechanism: Mechanism, end: End) -> None:
    here, there = mechanism.layout.names, end.names
    parts: list[str] = []
    for what, names in (
        ("it lacks", [name for name in here if name not in there]),
        ("this scene has no", [name for name in there if name not in here]),
    ):
        parts += [f"{what} {listed(names)}"] if names else []
    if parts:
        raise SceneError(
            f"start: the end of a run with other coordinates: {'; '.join(parts)}; give a dict of those that both have, "
            "{name: end.coordinates[name]}, and let the scene's [start] say the others"
        )
