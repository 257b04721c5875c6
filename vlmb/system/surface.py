"""The surface of a contact as numbers: value, gradient and jets of its expression at a place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vlmb.core.opcodes import PARAMETER, TIME, VALUE, Buffers, make_buffers
from vlmb.core.tape import jets, prepare, read_leaves
from vlmb.model.names import AXES
from vlmb.model.tape import CompiledTape, Leaf, compile_tape
from vlmb.scene.expressions import Expression

Array = NDArray[np.float64]

STILL = (0.0, 0.0, 0.0)


class Surface:
    """The surface of a contact by the point's place: value and gradient."""

    def __init__(self, expression: Expression, parameters: Mapping[str, float]) -> None:
        names = {name: at for at, name in enumerate(parameters)}

        def leaf(name: str) -> Leaf:
            if name in AXES:
                return Leaf(VALUE, AXES.index(name))
            return Leaf(PARAMETER, names[name]) if name in names else Leaf(TIME)

        self.expression = expression
        self.compiled: CompiledTape = compile_tape([expression], leaf)
        self.parameters = np.array([float(value) for value in parameters.values()])
        self.buffers: Buffers = make_buffers(self.compiled.tape)
        prepare(self.compiled.tape, self.buffers, self.parameters)

    def at(self, t: float, place: Sequence[float] | Array) -> tuple[float, Array]:
        """Return value and gradient (3,) at a time and a place [m]."""
        slope, out = np.zeros(3), np.zeros((1, 3))
        moving = float(self._rate(t, place, STILL, out))
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
        return self._rate(t, place, STILL, np.zeros((1, 3)))

    def _rate(self, t: float, place: Sequence[float] | Array, way: Sequence[float], out: Array) -> float:
        measured = np.zeros((3, 3))
        measured[:, 0], measured[:, 1] = place, way
        read_leaves(self.compiled.tape, t, self.parameters, measured, self.buffers.slots)
        jets(self.compiled.tape, self.buffers, out)
        return float(out[0, 1])
