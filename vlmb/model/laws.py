"""Laws of time: their value, their derivatives, and where they are not smooth."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vlmb.core import opcodes as op
from vlmb.core.laws import law_jet, law_value, law_values
from vlmb.core.opcodes import Buffers, make_buffers
from vlmb.core.packed import Packed, pack, tape_parts
from vlmb.core.tape import prepare
from vlmb.core.time_scan import time_breaks, time_jump
from vlmb.errors import SceneError
from vlmb.model.forms import show
from vlmb.model.signals import NONE, Signals
from vlmb.model.tape import CompiledTape, Leaf, compile_tape
from vlmb.scene.expressions import Equation, Expression, failure, parse
from vlmb.scene.names import PHASE_START, kind_of

Array = NDArray[np.float64]

NEAR = 1e-12  # relative: a break this near to an end is there


@dataclass(frozen=True, eq=False)
class Law:
    """A law of time: value, first and second derivative; nan where undefined. Nothing in it changes.

    Derivatives leave out the impulses at kinks; at a switch the side counts that its function takes there.
    """

    text: str
    expression: Expression
    compiled: CompiledTape = field(repr=False)
    parameters: Array = field(repr=False)
    packed: Packed = field(repr=False)

    def value(self, t: float) -> float:
        """Return the value at a time."""
        return law_value(self.packed.integers, self.packed.reals.copy(), float(t))

    def jet(self, t: float) -> tuple[float, float, float]:
        """Return value, first and second derivative at a time."""
        return law_jet(self.packed.integers, self.packed.reals.copy(), float(t))

    def values(self, times: Array) -> Array:
        """Return the values (N,) at times (N,)."""
        out = np.empty(len(times))
        law_values(self.packed.integers, self.packed.reals.copy(), np.ascontiguousarray(times, float), out)
        return out


def time_law(text: str | float, parameters: Mapping[str, float], key: str, signals: Signals = NONE) -> Law:
    """Read a law of time in `t`, the parameters and measured data. Raises ExpressionError."""
    expression = parse_of_time(text, [*parameters, *signals], key)
    names = [name for name in parameters if name in expression.names]
    places = {name: at for at, name in enumerate(names)}
    values = parameter_values({name: parameters[name] for name in names})

    def leaf(name: str) -> Leaf:
        if name in places:
            return Leaf(op.PARAMETER, places[name])
        return Leaf(op.SIGNAL, signals[name]) if name in signals else Leaf(op.TIME)

    compiled = compile_tape([expression], leaf, signals.pieces)
    buffers = prepared(compiled, values, [expression])
    return Law(expression.text, expression, compiled, values, pack(tape_parts(compiled.tape, buffers, values)))


def parse_of_time(text: str | float, parameters: Collection[str], key: str) -> Expression:
    """Read an expression in `t`, parameters, data. Raises ExpressionError, in words of its own where it names the motion."""
    own = {"t", *parameters}
    for name in sorted(parse(text, key).names - own):
        if ("." in name and name != PHASE_START) or name == "speed" or kind_of(name) == "a coordinate":
            hint = "the law of a force may name the motion"
            raise failure(key, str(text), f"{name!r} is read of the motion; here stand only t and parameters, and data", hint)
    return parse(text, key, own)


def parameter_values(parameters: Mapping[str, float]) -> Array:
    """Return the values (P,) of parameters. Raises ExpressionError for one that is no finite number."""
    for name, value in parameters.items():
        parse(value, f"parameters.{name}", ())
    return np.array([float(value) for value in parameters.values()])


def prepared(compiled: CompiledTape, parameters: Array, roots: Sequence[Expression | Equation]) -> Buffers:
    """Make the buffers of a tape and play what depends on parameters alone.

    Raises ExpressionError where a part of a root has no finite value with these parameters.
    """
    tape, buffers = compiled.tape, make_buffers(compiled.tape)
    prepare(tape, buffers, parameters)
    leaves, end = int(tape.parts[op.LEAVES]), int(tape.parts[op.PARAMETERS_END])
    bad = {leaves + k for k in range(end) if not math.isfinite(buffers.slots[leaves + k, 0])}
    for root, expression in enumerate(roots if bad else ()):
        begin, _, last = tape.sweep_ends[root]
        for k in (-1, *tape.sweep[begin:last].tolist()):
            used = {int(tape.root[root])} if k < 0 else _needed(tape.code[k]) if k >= end else set()
            for slot in used & bad:
                key = expression.left.key if isinstance(expression, Equation) else expression.key
                given = ", ".join(f"{compiled.names[i]} = {buffers.slots[i, 0]:g}" for i in _parameters_of(compiled, slot))
                what = show(compiled.sources[slot - leaves])
                raise failure(key, expression.text, f"{what} is not a finite real number at {given}", "change a parameter or it")
    return buffers


def _needed(code: NDArray[np.int64]) -> set[int]:
    """Slots that an operation always takes: a choice takes one of two only."""
    if code[op.OPERATION] == op.SELECT:
        return {int(code[op.CONDITION])}
    return {int(slot) for slot in (code[1:2] if code[op.OPERATION] >= op.UNARY else code[1:3])}


def _parameters_of(compiled: CompiledTape, slot: int) -> list[int]:
    """Leaves that a slot rests on."""
    leaves, found, waiting = int(compiled.tape.parts[op.LEAVES]), set[int](), [slot]
    while waiting:
        at = waiting.pop()
        if at < leaves:
            found.add(at)
        elif compiled.tape.code[at - leaves, 0] != op.CONSTANT:
            row = compiled.tape.code[at - leaves]
            waiting += _needed(row) | (set(row[1:3].tolist()) if row[0] == op.SELECT else set())
    return sorted(found)


def law_breaks(law: Law, start: float, end: float) -> tuple[float, ...]:
    """Return the times in (start, end) where a law switches, or leaves its domain. Raises SceneError for too many."""
    return tape_breaks(law.compiled, law.parameters, start, end, law.text)


def tape_breaks(compiled: CompiledTape, parameters: Array, start: float, end: float, text: str) -> tuple[float, ...]:
    """Return the same for all roots of a tape; what depends on the state is not looked at."""
    if not len(compiled.tape.switch):
        return ()
    times = time_breaks(compiled.tape, parameters, start, end).tolist()
    if times and math.isnan(times[-1]):
        span = f"between t = {start:g} and {end:g} s"
        raise SceneError(f"the law {text!r:.200} switches too often {span}; make it smooth, or the run shorter")
    return tuple(times)


def breaks_within(find: Callable[[float, float], Iterable[float]], start: float, end: float) -> set[float]:
    """Return the times in [start, end] that are found between two times; those at an end, up to rounding, as that end."""
    near = NEAR * max(abs(start), abs(end))
    if not end - start > 4.0 * near:
        return set(find(start, end))
    found = find(start - 2.0 * near, end + 2.0 * near)
    return {start if t <= start + near else end if t >= end - near else t for t in found}


def law_jump(law: Law, t: float) -> tuple[float, float]:
    """Return the jumps of a law's value and first derivative across t; nan where a side is undefined."""
    return time_jump(law.compiled.tape, law.parameters, 0, t)
