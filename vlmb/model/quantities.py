"""The vocabulary as the core reads it: each name a row of numbers, an equation's leaves among them."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from vlmb.core import places
from vlmb.core import quantities as core
from vlmb.core.opcodes import RATE, VALUE
from vlmb.core.quantities import Quantities, make_quantities
from vlmb.errors import SceneError
from vlmb.model.arrays import Arrays
from vlmb.model.names import ANGLES, STORED, GeneralizedForce, Names, PointEnd, Quantity
from vlmb.model.signals import NONE as NO_SIGNALS
from vlmb.model.signals import Signals
from vlmb.model.tape import Leaf, leaf_of
from vlmb.scene.expressions import Tree
from vlmb.scene.legs import leg_tree

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

Row = tuple[int, int, int, int, float]  # kind, link, component, segments along, offset [m]
NONE, LOWER, BOTH = 0, places.LOWER, places.BOTH
SEGMENTS = {1: places.LOWER, 2: places.UPPER}
SQUARE = "^2/2"  # ends the name of a spring that acts along half the square of its length


def allowed_names(names: Names, parameters: Iterable[str], data: Iterable[str] = ()) -> Collection[str]:
    """Every name that an equation or the law of a force may use: the time, parameters, measured data, the vocabulary."""
    return _Allowed({"t": None, **dict.fromkeys(parameters), **dict.fromkeys(data)}, names)


class _Allowed(Collection[str]):
    def __init__(self, own: Mapping[str, None], names: Names) -> None:
        self.own, self.names = own, names

    def __contains__(self, name: object) -> bool:
        return name in self.own or name in self.names

    def __iter__(self) -> Iterator[str]:
        return itertools.chain(self.own, self.names)

    def __len__(self) -> int:
        return len(self.own) + len(self.names)


class QuantityTable:
    """Collects the quantities that a mechanism's forces, laws, rows and events read, each once, in the order of asking."""

    def __init__(self, names: Names, arrays: Arrays, parameters: tuple[str, ...] = (), signals: Signals = NO_SIGNALS) -> None:
        self.names, self.arrays, self.signals = names, arrays, signals
        self.parameters = {name: at for at, name in enumerate(parameters)}
        self.rows: dict[Row, int] = {}
        self.labels: list[str] = []  # what each quantity is called in messages
        self.fixed: dict[int, PointEnd] = {}  # places that do not move, by where their x stands
        self.lengths: dict[str, int] = {}  # quantities that laws of springs name, beside the vocabulary

    def place(self, row: Row, label: str) -> int:
        """Return where a quantity stands."""
        if row not in self.rows:
            self.rows[row] = len(self.rows)
            self.labels.append(label)
        return self.rows[row]

    def of(self, quantity: Quantity) -> int:
        """Return where a quantity of the vocabulary, or the one whose rate it is, stands."""
        return self.place(self._row(quantity), quantity.name)

    def along(self, force: GeneralizedForce) -> int:
        """Return where the quantity stands that a generalized force acts along; that of a spring has its name in laws."""
        if force.ends:
            kind = core.HALF_SQUARE if force.kind == STORED and force.coordinate == SQUARE else core.BETWEEN
            first, second = (self._end(end, force.name) for end in force.ends)
            at = self.place((kind, first, second, 0, 0.0), force.name)
            self.lengths[force.name] = at
            return at
        if force.coordinate:
            return self.of(self.names.find(force.coordinate))
        return self.place(self._opening(force.link), force.name)

    def resolve(self, name: str) -> Leaf | Tree:
        """Return what a name of an equation is to the tape; what is read of a leg is an expression."""
        known = leaf_of(name, self.parameters, self.signals, self.lengths)
        if known is not None:
            return known
        quantity = self.names.find(name)
        if quantity.kind == "leg":
            return leg_tree(self.arrays.scene, name)
        return Leaf(RATE if quantity.rate else VALUE, self.of(quantity), quantity.kind in ANGLES)

    def made(self) -> Quantities:
        """Return the table for the core."""
        rows = np.array(list(self.rows), float).reshape(-1, 5)
        return make_quantities(self.arrays.tree, rows[:, :4].astype(np.int64), rows[:, 4])

    def levels(self) -> Integers:
        """Return where azimuth and elevation, by which angles keep their branch, are among the coordinates (count, 2); or -1."""
        found, layout = np.full((len(self.rows), 2), -1, np.int64), self.arrays.layout
        for k, (kind, row, _, _, _) in enumerate(self.rows):
            if kind in (core.AZIMUTH, core.ELEVATION):
                at = layout.place("psi", self.arrays.order[row])
                found[k] = at - 1, at
        return found

    def angles(self) -> list[tuple[int, int]]:
        """List the rows that are azimuths or elevations in space, with the place of the link's elevation among coordinates."""
        layout, order = self.arrays.layout, self.arrays.order
        kinds = (core.AZIMUTH, core.ELEVATION)
        return [(k, layout.place("psi", order[row])) for k, (kind, row, *_) in enumerate(self.rows) if kind in kinds]

    def reference(self, coordinates: Array) -> Array:
        """Return the branches (count, 2) of azimuth and elevation that coordinates (N,) are on."""
        found, layout = np.zeros((len(self.rows), 2)), self.arrays.layout
        for k, (kind, row, component, _, _) in enumerate(self.rows):
            if kind in (core.AZIMUTH, core.ELEVATION, core.PLANE_ELEVATION):
                at = layout.place("psi", self.arrays.order[row])
                found[k] = (0.0 if layout.plane else coordinates[at - 1]), coordinates[at]
            elif kind == core.PLANE_ANGLE:
                first, second = (layout.place("psi", self.arrays.order[i]) for i in (row, component))
                found[k, 1] = coordinates[second] - coordinates[first]
        return found

    def _row(self, q: Quantity) -> Row:
        link = self.arrays.rows[q.link] if q.link >= 0 else 0
        plane = self.arrays.layout.plane
        if q.kind in ("x", "y", "z"):
            return core.BASE_PLACE, 0, "xyz".index(q.kind), 0, 0.0
        if q.kind == "phi0":
            return core.YAW, 0, 0, 0, 0.0
        if q.kind == "speed":
            return core.SPEED, 0, 0, 0, 0.0
        if q.kind == "phi":
            return core.AZIMUTH, link, 0, 0, 0.0
        if q.kind == "psi":
            return core.PLANE_ELEVATION if plane else core.ELEVATION, link, 0, 0, 0.0
        if q.kind == "xi":
            return core.DISTANCE, link, 0, SEGMENTS[q.segment], 0.0
        rod = float(self.arrays.tree.real[link, 0]) if q.link >= 0 else 0.0
        if q.kind == "length":
            return core.DISTANCE, link, 0, BOTH, rod
        if q.kind == "direction":
            return core.DIRECTION, link, q.axis, 0, 0.0
        if q.kind == "com":
            return core.CENTRE_OF_MASS, 0, q.axis, 0, 0.0
        if q.kind == "point":
            return self._point(q.link, q.point, q.axis)
        raise SceneError(f"{q.name}: no quantity that an equation can read")  # pragma: no cover

    def _point(self, i: int, point: str, axis: int) -> Row:
        link = self.arrays.rows[i]
        rod = float(self.arrays.tree.real[link, 0])
        ends = {"hinge": (NONE, 0.0), "rod_start": (LOWER, 0.0), "rod_end": (LOWER, rod), "tip": (BOTH, rod)}
        along, offset = ends[point]
        return core.POINT, link, axis, along, offset

    def _end(self, end: PointEnd, label: str) -> int:
        """Return where an end of a spring stands: the first component of a point, or of three constants in a row."""
        if len(end) == 2:
            return self.place(self._point(end[0], end[1], 0), f"{self.arrays.layout.links[end[0]].name}.{end[1]}.x")
        known = [at for at in self.fixed if self.fixed[at] == end]
        if known:
            return known[0]
        first = len(self.rows)
        for axis, value in enumerate(end):
            self.place((core.CONSTANT, len(self.fixed), axis, 0, value), label)
        self.fixed[first] = end
        return first

    def _opening(self, i: int) -> Row:
        """Return the angle that a hinge torque opens: to the parent's direction; in a plane the elevation over the parent's."""
        index = self.arrays.layout.links[i]
        row = self.arrays.rows[i]
        parent = self.arrays.rows[index.parent] if index.parent >= 0 else places.HEADING
        if self.arrays.layout.plane:
            return (core.PLANE_ANGLE, parent, row, 0, 0.0) if index.parent >= 0 else (core.PLANE_ELEVATION, row, 0, 0, 0.0)
        return core.ANGLE, parent, row, 0, 0.0
