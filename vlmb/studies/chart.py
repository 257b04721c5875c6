"""States of a mechanism as few independent numbers, its symmetries divided out: what steady motions are sought and linearized in.

A link is described by azimuth and elevation; near the pole by the horizontal components of its direction. The place is left out
where nothing depends on it, and the heading (of a pivot or a free base: the azimuth of one link) as well: azimuths and directions
are then counted from it. Whether they may be is tried on the equations themselves.

Numbers may be of any arithmetic: of jets the equations have their derivatives (vlmb/system/jets.py, replay.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.core import tree as columns
from vlmb.core.row_arrays import sizes_of
from vlmb.core.triples import Vector, dot, scaled
from vlmb.core.triples import plus as added
from vlmb.errors import SceneError, StudyError
from vlmb.model.names import DOT
from vlmb.model.quantities import QuantityTable
from vlmb.model.reading import read_along
from vlmb.studies.standing import in_phase
from vlmb.studies.symmetry import place_axes, symmetries, turned
from vlmb.system import events
from vlmb.system.beginning import start_in_phase
from vlmb.system.core_engine import CoreEngine
from vlmb.system.engines import make_engine
from vlmb.system.jets import Numbers, as_numbers, atan2, cos, derivatives, hypot, sin, sqrt
from vlmb.system.replay import Replay, lifted
from vlmb.system.start import Start
from vlmb.system.system import System

Array = NDArray[np.float64]

STEEP = 0.25  # cos(psi) below which the direction's components are the coordinates
UPRIGHT = 1e-3  # cos(psi) below which a link tells no azimuth that could be divided out
AT_SWITCH = 1e-9


class Entry(NamedTuple):
    """One number of a chart, and its rate."""

    name: str
    kind: str  # place | heading | azimuth | elevation | across (component of a direction) | length
    link: int = -1
    axis: int = 0  # of place and direction; of a length the segment
    scale: float = 1.0


class Chart:
    """The chart around a state of a system: x (n,) are positions first, then velocities. `like`: with the numbers of another."""

    def __init__(self, system: System, start: Start, t: float = 0.0, like: Chart | None = None) -> None:
        if system.engine != "core":
            raise StudyError('this needs the core: leave run.engine at "auto"')
        engine = make_engine(system, start.branch)
        assert isinstance(engine, CoreEngine)
        self.system, self.engine, self.t, self.start = system, engine, t, start
        self.replay = Replay(engine)
        self.layout, self.arrays = system.mechanism.layout, system.core_plan.arrays
        self.sideways = int(self.arrays.tree.shape[columns.BASE_KIND]) in (columns.SLIDING, columns.LIFTED)
        self.first = self.arrays.positions
        self.origin = engine.pack(start.state)
        self.values = np.array(start.branch)
        engine.settle(t, self.origin)
        self.positional = np.array([system.is_holonomic(name) for name in self._row_names()], bool)
        if like is None:
            self._refuse_switches()
        self.symmetric: tuple[bool, ...] = (
            symmetries(system, engine, self.origin, self.values, t) if like is None else like.symmetric
        )
        self.reference = self._reference_link() if self.symmetric[3] and not self.layout.headed else -1
        self.positions = self._position_entries()
        self.velocities = self._velocity_entries()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the numbers."""
        return (*(entry.name for entry in self.positions), *(entry.name for entry in self.velocities))

    @property
    def scales(self) -> Array:
        """Sizes of what is small for each number."""
        return np.array([entry.scale for entry in (*self.positions, *self.velocities)])

    def _row_names(self) -> tuple[str, ...]:
        """Names of the ideal rows; those behind are of a programme."""
        rows = self.system.core_plan.plant.rows
        return self.system.core_plan.row_names[: int(sizes_of(rows).ideal)] if len(rows.table) else ()

    # which numbers

    @property
    def turning(self) -> bool:
        """Whether the heading, or the azimuth of a link, is divided out."""
        return self.symmetric[3] and (self.layout.headed or self.reference >= 0)

    def _position_entries(self) -> list[Entry]:
        names = self.layout.names
        found = [Entry("xyz"[k], "place", axis=k) for k in place_axes(self.layout) if not self.symmetric[k]]
        if self.layout.headed and not self.turning:
            found.append(Entry("phi0", "heading"))
        for i, link in enumerate(self.layout.links):
            found += self._direction_entries(i, link.name)
            for number, segment in ((1, link.lower), (2, link.upper)):
                name = f"xi{i + 1}_{number}"
                if name in names and segment.motion == "free":
                    size = max(0.1, abs(float(self.values[names.index(name)])))
                    found.append(Entry(name, "length", i, number, size))
        return found

    def _direction_entries(self, i: int, name: str) -> list[Entry]:
        psi = float(self.values[self.layout.place("psi", i)])
        if self.layout.plane:
            return [Entry(f"psi{i + 1}", "elevation", i)]
        if abs(math.cos(psi)) < (UPRIGHT if i == self.reference else STEEP):
            return [Entry(f"{name}.direction.{'xy'[k]}", "across", i, k) for k in (0, 1)]
        azimuth = [] if i == self.reference else [Entry(f"phi{i + 1}", "azimuth", i)]
        return [*azimuth, Entry(f"psi{i + 1}", "elevation", i)]

    def _velocity_entries(self) -> list[Entry]:
        found: list[Entry] = []
        if self.layout.headed:
            found.append(Entry("speed", "speed", scale=max(1.0, abs(self._velocity(0)))))
            if self.sideways:
                found.append(Entry("sideways", "sideways"))
            found.append(Entry(f"phi0{DOT}", "heading"))
            found += [Entry(f"z{DOT}", "place", axis=2)] if self.layout.lifts else []
        else:
            found += [Entry(f"{'xyz'[k]}{DOT}", "place", axis=k) for k in place_axes(self.layout)]
        for entry in self._shape_of_all():
            found.append(entry._replace(name=f"{entry.name}{DOT}"))
        return found

    def _shape_of_all(self) -> list[Entry]:
        """Entries of links, the azimuth that is divided out included: it has a rate."""
        found = [entry for entry in self._position_entries() if entry.kind not in ("place", "heading")]
        for at, entry in enumerate(found):
            if entry.link == self.reference:
                return [*found[:at], Entry(f"phi{entry.link + 1}", "azimuth", entry.link), *found[at:]]
        return found

    def _velocity(self, k: int) -> float:
        return float(self.origin[self.first + k])

    # between numbers and states of the core

    def state(self, x: Numbers) -> Numbers:
        """Return the core's state (ny,) of numbers x (n,): what is divided out is as at the start of the chart, headings 0."""
        y = np.zeros(len(self.origin), x.dtype)
        count = len(self.positions)
        places = {(e.kind, e.link, e.axis): value for e, value in zip(self.positions, x[:count].tolist(), strict=True)}
        rates = {(e.kind, e.link, e.axis): value for e, value in zip(self.velocities, x[count:].tolist(), strict=True)}
        w = self.first
        if self.layout.headed:
            for k in place_axes(self.layout):
                y[self._at(k)] = places.get(("place", -1, k), 0.0)
            y[2] = places.get(("heading", -1, 0), 0.0)
            speeds = [rates["speed", -1, 0], *([rates["sideways", -1, 0]] if self.sideways else [])]
            y[w : w + len(speeds) + 1] = *speeds, rates["heading", -1, 0]
            if self.layout.lifts:
                y[w + 3] = rates["place", -1, 2]
        elif self.layout.base == "free":
            for k in place_axes(self.layout):
                y[k], y[w + k] = places.get(("place", -1, k), 0.0), rates["place", -1, k]
        for row, i in enumerate(self.arrays.order):
            at, at_rate = (int(self.arrays.tree.link[row, column]) for column in (columns.AT_P, columns.AT_V))
            d, u = self._direction(i, places, rates)
            y[at : at + 3], y[w + at_rate : w + at_rate + 3] = d, u
            for number in (1, 2):
                if ("length", i, number) in places:
                    length, rate = self.arrays.length_at(i, number)
                    y[length], y[rate] = places["length", i, number], rates["length", i, number]
        return y

    def _direction(
        self, i: int, places: Mapping[tuple[str, int, int], Any], rates: Mapping[tuple[str, int, int], Any]
    ) -> tuple[Vector, Vector]:
        """Return the direction of a link and its rate as the core has them, at heading 0 where that is divided out."""
        if ("across", i, 0) in places:
            a, b = places["across", i, 0], places["across", i, 1]
            side = math.copysign(1.0, math.sin(self.values[self.layout.place("psi", i)]))
            up = side * sqrt(max(1.0 - a * a - b * b, 1e-300))
            da, db = rates["across", i, 0], rates["across", i, 1]
            return (a, b, up), (da, db, -(a * da + b * db) / up)
        phi, psi = places.get(("azimuth", i, 0), 0.0), places["elevation", i, 0]
        if self.layout.plane and self.layout.headed and not self.arrays.upright:
            phi = places.get(("heading", -1, 0), 0.0)
        turning, climbing = rates.get(("azimuth", i, 0), 0.0), rates["elevation", i, 0]
        cp, sp, ce, se = cos(phi), sin(phi), cos(psi), sin(psi)
        aside = scaled(turning * ce, (-sp, cp, 0.0))
        return (cp * ce, sp * ce, se), added(aside, climbing, (-cp * se, -sp * se, ce))

    def placed(self, x: Numbers) -> Numbers:
        """Return the core's state of numbers x with the place and the heading, or azimuth, of the chart's start."""
        y = self.state(x)
        if self.turning:
            y = turned(self.arrays, y, self._turn_of(self.origin) - self._turn_of(y))
        for k in place_axes(self.layout):
            if self.symmetric[k]:
                y[self._at(k)] = self.origin[self._at(k)]
        return y

    def _at(self, axis: int) -> int:
        """Where a place stands in a state; the rate of z as well."""
        return 3 if axis == 2 and self.layout.headed else axis

    def numbers(self, y: Array) -> Array:
        """Return the numbers x (n,) of a core's state, counted from the heading, or the azimuth, that is divided out."""
        turn = self._turn_of(y) if self.turning else 0.0
        y = turned(self.arrays, y, -turn)
        seen = self.system.core_plan.postures(np.array([self.t]), y[None])
        near, begun = self.values.copy(), self._turn_of(self.origin) if self.turning else 0.0  # however far it has turned since
        for i in range(len(self.layout.links) if self.turning and not self.layout.plane else 0):
            near[self.layout.place("phi", i)] -= begun
        values, rates = (part[0] for part in read_along(seen, np.array([self.t]), near[None]))
        found = []
        numbers = [*((e, values, False) for e in self.positions), *((e, rates, True) for e in self.velocities)]
        for entry, source, speeds in numbers:
            if entry.kind == "speed":
                found.append(float(y[self.first]))
            elif entry.kind == "sideways":
                found.append(float(y[self.first + 1]))
            elif entry.kind == "across":
                found.append(float((seen.direction_rates if speeds else seen.directions)[0, entry.link, entry.axis]))
            else:
                kind = {"place": "xyz"[entry.axis], "heading": "phi0", "azimuth": "phi", "elevation": "psi", "length": "xi"}
                at = self.layout.place(kind[entry.kind], entry.link, entry.axis if entry.kind == "length" else 0)
                found.append(float(source[at]))
        return np.array(found)

    def reading(self, names: Sequence[str]) -> Callable[[Numbers], list[Any]]:
        """Return what reads quantities of the vocabulary at numbers x, with the place and the heading of the chart's start."""
        known, table = self.system.mechanism.names, QuantityTable(self.system.mechanism.names, self.arrays)
        asked = [known.find(name) for name in names]
        for quantity in asked:
            if quantity.kind == "leg":
                raise SceneError(f"{quantity.name}: equations and trajectories read this; take the point that the leg is from")
        places = [(table.of(quantity), int(quantity.rate)) for quantity in asked]
        quantities, reference, tree = lifted(table.made()), table.reference(self.values), lifted(self.arrays.tree)

        def read(x: Numbers) -> list[Any]:
            y, given = self.placed(x).astype(object), lifted(self.engine.memory.given)
            found = np.zeros((len(table.rows), 3), object)
            for at, _ in places:
                self.replay.measure(quantities, at, tree, y, given, reference, found)
            return [found[place] for place in places]

        return read

    def rates(self, x: Numbers) -> Numbers:
        """Return dx/dt (n,). Raises what an evaluation does."""
        y = self.state(x)
        dy = self.replay.evaluate(self.t, y).slope if x.dtype == object else self.engine.evaluate(self.t, y)
        return self._rates_at(x, y, dy)

    def equations(self, x: Numbers) -> tuple[Numbers, Numbers]:
        """Return dx/dt (n,), and what ideal rows of positions lack, then the rates of all ideal rows (r,)."""
        y = self.state(x)
        if x.dtype == object:
            dy, z, rate = self.replay.evaluate(self.t, y)
        elif len(self.positional):
            dy, rows = self.engine.evaluate(self.t, y), self.engine.rows(self.t, y)
            z, rate = rows.z, rows.rate
        else:
            dy, z, rate = self.engine.evaluate(self.t, y), np.zeros(0), np.zeros(0)
        return self._rates_at(x, y, dy), np.concatenate([z[self.positional], rate])

    def pushes(self) -> Array:
        """Return how dx/dt (n,) changes with the forces from outside (n, S)."""
        x = self.numbers(self.origin).astype(object)
        y, none = self.state(x), np.zeros(len(self.engine.memory.inputs))
        return derivatives(lambda forces: self._rates_at(x, y, self.replay.evaluate(self.t, y, forces).slope), none)

    def _rates_at(self, x: Numbers, y: Numbers, dy: Numbers) -> Numbers:
        count, w = len(self.positions), self.first
        speeds = {(e.kind, e.link, e.axis): v for e, v in zip(self.velocities, x[count:].tolist(), strict=True)}
        turning: Any = 0.0
        if self.turning:
            turning = speeds["heading", -1, 0] if self.layout.headed else speeds["azimuth", self.reference, 0]
        found: list[Any] = []
        for e in self.positions:
            if e.kind == "place":
                found.append(dy[self._at(e.axis)])
            elif e.kind == "azimuth":
                found.append(speeds["azimuth", e.link, 0] - turning)
            elif e.kind == "across":
                d, u = self._core_direction(e.link, y, y)
                found.append(u[e.axis] + turning * (d[1] if e.axis == 0 else -d[0]))
            else:
                found.append(speeds[e.kind, e.link, e.axis])
        for e in self.velocities:
            if e.kind in ("speed", "sideways"):
                found.append(dy[w + (e.kind == "sideways")])
            elif e.kind == "heading":
                found.append(dy[w + (2 if self.sideways else 1)])
            elif e.kind == "place":
                other = y[w + 1 - e.axis] if e.axis < 2 and self.turning else 0.0
                found.append(dy[w + self._at(e.axis)] + turning * (other if e.axis == 0 else -other))
            elif e.kind == "length":
                found.append(dy[self.arrays.length_at(e.link, e.axis)[1]])
            else:
                found.append(self._direction_acceleration(e, y, dy, turning))
        return as_numbers(found)

    def _core_direction(self, i: int, y: Numbers, dy: Numbers) -> tuple[Vector, Vector]:
        """Return the direction that stands in y, and the rate of it that stands in the velocities of `dy`."""
        row = self.arrays.rows[i]
        at, at_rate = (int(self.arrays.tree.link[row, column]) for column in (columns.AT_P, columns.AT_V))
        d, u = y[at : at + 3].tolist(), dy[self.first + at_rate : self.first + at_rate + 3].tolist()
        return (d[0], d[1], d[2]), (u[0], u[1], u[2])

    def _direction_acceleration(self, e: Entry, y: Numbers, dy: Numbers, turning: Any) -> Any:
        d, u = self._core_direction(e.link, y, y)
        bend = self._core_direction(e.link, y, dy)[1]
        if e.kind == "across":
            return bend[e.axis] + turning * (u[1] if e.axis == 0 else -u[0])
        if self.layout.plane:
            heading = 0.0 if self.arrays.upright or not self.layout.headed else y[2]
            ahead = cos(heading) * d[0] + sin(heading) * d[1]
            along = cos(heading) * bend[0] + sin(heading) * bend[1]
            return ahead * bend[2] - d[2] * along
        flat = hypot(d[0], d[1])
        side = math.copysign(1.0, math.cos(self.elevation(e.link)))
        across = scaled(side / flat, (-d[1], d[0], 0.0))
        upwards = scaled(side / flat, (-d[0] * d[2], -d[1] * d[2], flat * flat))
        steep = side * flat
        phi_rate, psi_rate = dot(across, u) / steep, dot(upwards, u)
        if e.kind == "azimuth":
            return (dot(across, bend) + 2.0 * phi_rate * psi_rate * d[2]) / steep
        return dot(upwards, bend) - phi_rate * phi_rate * steep * d[2]

    def elevation(self, i: int) -> float:
        """Return the elevation [rad] of a link at the start of the chart."""
        return float(self.values[self.layout.place("psi", i)])

    # symmetries

    def _reference_link(self) -> int:
        """The link that is nearest to the horizontal, whose azimuth is divided out; -1 where all stand upright, or in a plane."""
        if self.layout.plane or not self.layout.links:
            return -1
        flat = [abs(math.cos(self.elevation(i))) for i in range(len(self.layout.links))]
        best = int(np.argmax(flat))
        return best if flat[best] >= UPRIGHT else -1

    def _turn_of(self, y: Numbers) -> Any:
        """Return the heading, or the azimuth of the link that stands for it."""
        if self.layout.headed:
            return y[2]
        d = self._core_direction(self.reference, y, y)[0]
        return atan2(d[1], d[0]) + math.pi * (math.cos(self.elevation(self.reference)) < 0.0)

    def _refuse_switches(self) -> None:
        values = self.engine.indicators(self.t, self.origin)[0]
        for event, value in zip(self.engine.events, values.tolist(), strict=True):
            if event.kind == events.SWITCH and abs(value) < AT_SWITCH:
                raise StudyError(f"{event.name}: this state stands on a switch, where a motion has no linearization")


def chart_at(system: System, start: Start | None = None) -> Chart:
    """Make the chart around a start, the consistent one of the scene where none is given, in the phase in which it stands."""
    start = start or start_in_phase(system, 0.0)
    return Chart(in_phase(system, start), start)
