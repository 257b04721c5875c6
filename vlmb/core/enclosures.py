"""Playing the part of a tape that depends on time alone over a whole interval of it: what values and derivatives can be there.

A slot holds intervals of the value, the first and the second derivative: (slots, 6).
"""

from __future__ import annotations

import math

from vlmb.core import intervals as span
from vlmb.core import opcodes as op
from vlmb.core.intervals import Interval
from vlmb.core.jit import inner, kernel
from vlmb.core.opcodes import Array, Tape
from vlmb.core.scalars import atan, exp, log
from vlmb.core.series import END, FIRST, ORDER, signal_box

Jet = tuple[Interval, Interval, Interval]


@inner
def read(boxes: Array, slot: int) -> Jet:
    """Read a slot."""
    return (boxes[slot, 0], boxes[slot, 1]), (boxes[slot, 2], boxes[slot, 3]), (boxes[slot, 4], boxes[slot, 5])


@inner
def write(boxes: Array, slot: int, jet: Jet) -> None:
    """Write a slot; an end that is no number means everything."""
    for j in range(3):
        low, high = jet[j]
        boxes[slot, 2 * j] = low if low == low else -math.inf
        boxes[slot, 2 * j + 1] = high if high == high else math.inf


@kernel
def enclose(tape: Tape, parameters: Array, low: float, high: float, boxes: Array) -> None:
    """Fill all slots that depend on time or parameters for low <= t <= high."""
    zero, nothing = (0.0, 0.0), span.whole_line()
    for k in range(tape.parts[op.LEAVES]):
        kind = tape.leaf[k, 0]
        if kind == op.TIME:
            write(boxes, k, ((low, high), (1.0, 1.0), zero))
        elif kind == op.PARAMETER:
            p = parameters[tape.leaf[k, 1]]
            write(boxes, k, ((p, p), zero, zero))
        elif kind == op.SIGNAL:
            at = tape.leaf[k, 1]
            signal_box(tape.series, tape.signal[at, FIRST], tape.signal[at, END], tape.signal[at, ORDER], low, high, boxes[k])
        else:
            write(boxes, k, (nothing, nothing, nothing))
    play_boxes(tape, boxes, 0, tape.parts[op.TIME_END])
    play_boxes(tape, boxes, tape.parts[op.ROOTS_END], tape.parts[op.ALL_END])


@inner
def play_boxes(tape: Tape, boxes: Array, begin: int, end: int) -> None:
    """Play operations begin <= k < end on intervals."""
    leaves = tape.parts[op.LEAVES]
    for k in range(begin, end):
        code, x = tape.code[k, op.OPERATION], read(boxes, tape.code[k, op.FIRST])
        if code >= op.UNARY:
            value, slope, bend = unary(code, x[0], tape.constant[k])
            second = span.plus(span.times(slope, x[2]), span.times(bend, span.squared(x[1])))
            write(boxes, leaves + k, (value, span.times(slope, x[1]), second))
        elif code == op.SELECT:
            condition = read(boxes, tape.code[k, op.CONDITION])[0]
            write(boxes, leaves + k, select(condition, x, read(boxes, tape.code[k, op.SECOND])))
        else:
            write(boxes, leaves + k, binary(code, x, read(boxes, tape.code[k, op.SECOND])))


@inner
def unary(code: int, x: Interval, c: float) -> tuple[Interval, Interval, Interval]:
    """Return f(x), f'(x), f''(x) of an operation of one slot with its constant c."""
    zero, one = (0.0, 0.0), (1.0, 1.0)
    if code == op.SHIFT:
        return (x[0] + c, x[1] + c), one, zero
    if code == op.SCALE:
        return span.scaled(c, x), (c, c), zero
    if code == op.PART:
        return span.scaled(1.0 / c, x), (1.0 / c, 1.0 / c), zero
    if code == op.OVER:
        part = span.reciprocal(x)
        square = span.squared(part)
        return span.scaled(c, part), span.scaled(-c, square), span.scaled(2.0 * c, span.times(square, part))
    if code == op.CONSTANT:
        return (c, c), zero, zero
    if code == op.SQUARE:
        return span.squared(x), span.scaled(2.0, x), (2.0, 2.0)
    if code in (op.WHOLE_POWER, op.POWER):
        return span.raised(x, c), span.scaled(c, span.raised(x, c - 1.0)), span.scaled(c * (c - 1.0), span.raised(x, c - 2.0))
    if code == op.ABS:
        return span.absolute(x), ((1.0 if x[0] >= 0.0 else -1.0), (-1.0 if x[1] <= 0.0 else 1.0)), zero
    if code == op.SIGN:
        return ((1.0 if x[0] > 0.0 else -1.0), (-1.0 if x[1] < 0.0 else 1.0)), zero, zero
    if code == op.STEP:
        return ((1.0 if x[0] >= 0.0 else 0.0), (0.0 if x[1] < 0.0 else 1.0)), zero, zero
    return function(code, x)


@inner
def function(code: int, x: Interval) -> tuple[Interval, Interval, Interval]:
    """Return f(x), f'(x), f''(x) of an elementary function."""
    if code == op.SIN:
        f = span.sine(x)
        return f, span.cosine(x), span.scaled(-1.0, f)
    if code == op.COS:
        f = span.cosine(x)
        return f, span.scaled(-1.0, span.sine(x)), span.scaled(-1.0, f)
    if code == op.EXP:
        f = exp(x[0]), exp(x[1])
        return f, f, f
    if code == op.TAN:
        f = span.tangent(x)
        slope = span.plus((1.0, 1.0), span.squared(f))
        return f, slope, span.scaled(2.0, span.times(f, slope))
    if code == op.LOG:
        x = max(x[0], 0.0), max(x[1], 0.0)
        slope = span.reciprocal(x)
        f = (log(x[0]) if x[0] > 0.0 else -math.inf), (log(x[1]) if x[1] > 0.0 else -math.inf)
        return f, slope, span.scaled(-1.0, span.squared(slope))
    if code == op.SQRT:
        f = span.rooted(x)
        slope = span.scaled(0.5, span.reciprocal(f))
        return f, slope, span.scaled(-0.25, span.raised(span.reciprocal(f), 3.0))
    rest = span.minus((1.0, 1.0), span.squared(x))
    if code == op.ATAN:
        slope = span.reciprocal(span.plus((1.0, 1.0), span.squared(x)))
        return (atan(x[0]), atan(x[1])), slope, span.scaled(-2.0, span.times(x, span.squared(slope)))
    part = span.reciprocal(span.rooted(rest))
    bend = span.times(x, span.raised(part, 3.0))
    if code == op.ASIN:
        return span.arcsine(x), part, bend
    return span.arccosine(x), span.scaled(-1.0, part), span.scaled(-1.0, bend)


@inner
def binary(code: int, x: Jet, z: Jet) -> Jet:
    """Return the jet of an operation of two slots."""
    if code == op.ADD:
        return span.plus(x[0], z[0]), span.plus(x[1], z[1]), span.plus(x[2], z[2])
    if code == op.SUBTRACT:
        return span.minus(x[0], z[0]), span.minus(x[1], z[1]), span.minus(x[2], z[2])
    if code == op.MULTIPLY:
        return multiplied(x, z)
    if code == op.DIVIDE:
        value, slope, bend = unary(op.OVER, z[0], 1.0)
        second = span.plus(span.times(slope, z[2]), span.times(bend, span.squared(z[1])))
        return multiplied(x, (value, span.times(slope, z[1]), second))
    if code == op.ATAN2:
        return turned(x, z)
    less = span.minus(x[0], z[0])
    if code == op.MIN:
        return (min(x[0][0], z[0][0]), min(x[0][1], z[0][1])), select(less, x, z)[1], select(less, x, z)[2]
    return (max(x[0][0], z[0][0]), max(x[0][1], z[0][1])), select(less, z, x)[1], select(less, z, x)[2]


@inner
def multiplied(x: Jet, z: Jet) -> Jet:
    """Return the jet of a product."""
    first = span.plus(span.times(x[0], z[1]), span.times(z[0], x[1]))
    both = span.scaled(2.0, span.times(x[1], z[1]))
    return span.times(x[0], z[0]), first, span.plus(both, span.plus(span.times(x[0], z[2]), span.times(z[0], x[2])))


@kernel
def turned(y: Jet, x: Jet) -> Jet:
    """Return the jet of atan2(y, x): (x y' - y x') / r^2, and (x y'' - y x'' - 2 (x x' + y y') times that) / r^2."""
    part = span.reciprocal(span.plus(span.squared(x[0]), span.squared(y[0])))
    first = span.times(part, span.minus(span.times(x[0], y[1]), span.times(y[0], x[1])))
    growth = span.scaled(2.0, span.plus(span.times(x[0], x[1]), span.times(y[0], y[1])))
    bend = span.minus(span.minus(span.times(x[0], y[2]), span.times(y[0], x[2])), span.times(growth, first))
    return span.turn(y[0], x[0]), first, span.times(part, bend)


@inner
def select(condition: Interval, x: Jet, z: Jet) -> Jet:
    """Return the jet that SELECT takes; the hull of both where it may take either."""
    if condition[1] < 0.0:
        return x
    if condition[0] >= 0.0:
        return z
    return span.hull(x[0], z[0]), span.hull(x[1], z[1]), span.hull(x[2], z[2])
