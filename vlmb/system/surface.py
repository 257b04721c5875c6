"""The surface of a contact as numbers: value, gradient and jets of its expression at a place; axes where it is plain."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vlmb.core.opcodes import PARAMETER, TIME, VALUE, Buffers, make_buffers
from vlmb.core.tape import jets, prepare, read_leaves
from vlmb.model.coordinates import cross
from vlmb.model.frozen import read_only
from vlmb.model.names import AXES
from vlmb.model.tape import CompiledTape, Leaf, compile_tape
from vlmb.scene.expressions import Expression

Array = NDArray[np.float64]

Vector = tuple[float, float, float]

ZERO: Vector = (0.0, 0.0, 0.0)
PLAIN = {"x": 0, "y": 1, "z": 2}  # surfaces whose rows across are coordinates of the point
UNIT = read_only(np.eye(3))


def axes_at(normal: Array, plane: bool) -> Array:
    """Return unit vectors (3, 3) as rows, two across a normal, then that itself; in a plane the first is the one in it."""
    first = cross(UNIT[1 if plane else int(np.argmin(np.abs(normal)))], normal)
    first /= np.linalg.norm(first)
    if first[int(np.argmax(np.abs(first)))] < 0.0:
        first = -first
    return np.array([first, cross(normal, first), normal])


def vector(values: Iterable[float]) -> Vector:
    """Return three numbers of an array as plain ones."""
    x, y, z = map(float, values)
    return x, y, z


ALIKE = [(axis, plane) for axis in range(3) for plane in (False, True) if axis != 1 or not plane]  # none in a plane is across it
OF_PLAIN = {(axis, plane): read_only(axes_at(UNIT[axis], plane)) for axis, plane in ALIKE}
ACROSS_PLAIN = {  # as rows have them
    (axis, plane): (vector(UNIT[2 - axis if plane else int(axis == 0)]), vector(UNIT[1 if plane or axis == 2 else 2]))
    for axis, plane in ALIKE
}


class Surface:
    """The surface of a contact by the point's place: value and gradient."""

    def __init__(self, expression: Expression, parameters: Mapping[str, float]) -> None:
        self.expression, self.places = expression, {name: at for at, name in enumerate(parameters)}
        self.parameters = np.array([float(value) for value in parameters.values()])

    @cached_property
    def compiled(self) -> CompiledTape:
        """Its tape, by the point's place, the parameters and the time."""

        def leaf(name: str) -> Leaf:
            if name in AXES:
                return Leaf(VALUE, AXES.index(name))
            return Leaf(PARAMETER, self.places[name]) if name in self.places else Leaf(TIME)

        return compile_tape([self.expression], leaf)

    @cached_property
    def buffers(self) -> Buffers:
        """What is written where it is evaluated."""
        made = make_buffers(self.compiled.tape)
        prepare(self.compiled.tape, made, self.parameters)
        return made

    def at(self, t: float, place: Sequence[float] | Array) -> tuple[float, Array]:
        """Return value and gradient (3,) at a time and a place [m]."""
        slope, out = np.zeros(3), np.zeros((1, 3))
        moving = float(self._rate(t, place, ZERO, out))
        for axis in range(3):
            way = [0.0, 0.0, 0.0]
            way[axis] = 1.0
            slope[axis] = self._rate(t, place, way, out) - moving
        return float(out[0, 0]), slope

    def jet(self, t: float, place: Array) -> Array:
        """Return value, rate and second derivative (3,) along a motion of the place (3, 3)."""
        out = np.zeros((1, 3))
        read_leaves(self.compiled.tape, t, self.parameters, np.ascontiguousarray(place), self.buffers.slots)
        jets(self.compiled.tape, self.buffers, out)
        return out[0]

    def moves(self, t: float, place: Sequence[float] | Array) -> float:
        """Return the rate of the surface's value at a place that rests."""
        return self._rate(t, place, ZERO, np.zeros((1, 3)))

    def _rate(self, t: float, place: Sequence[float] | Array, way: Sequence[float], out: Array) -> float:
        measured = np.zeros((3, 3))
        measured[:, 0], measured[:, 1] = place, way
        read_leaves(self.compiled.tape, t, self.parameters, measured, self.buffers.slots)
        jets(self.compiled.tape, self.buffers, out)
        return float(out[0, 1])
