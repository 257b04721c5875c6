"""What laws of time do over a run, found before it: where they switch, and how short steps must be not to miss anything.

An interval of time is split until what a slot can do in it is known well enough. What depends on the state is not looked at.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vlmb.core import opcodes as op
from vlmb.core.enclosures import enclose
from vlmb.core.intervals import largest
from vlmb.core.jit import inner, kernel
from vlmb.core.opcodes import Array, Buffers, Tape, make_buffers
from vlmb.core.tape import play_jets, play_values, read_time

PIECES = 256  # of the run, for the range of each slot
SMALLEST = 1e-9  # of the run: features narrower than this are not found
FINEST = 1e-13  # of the run: the same of what is smooth there
MOST = 200_000  # intervals looked at
FULL, TOO_MANY = -1, -2  # codes of `find_breaks`


class TimeScale(NamedTuple):
    """How fast laws vary: `steps` (count, 3) begin, end, longest step there [s]; known until the time `until`."""

    steps: Array
    until: float


def time_scale(tape: Tape, parameters: Array, begin: float, end: float, count: int = 4096) -> TimeScale:
    """Find how long steps may be so that none passes over something that a law does in time.

    Within a step h every slot that depends on time alone has h^2 max|f''| <= the range of f over the run: 1.4/w for sin(w t), 0.7
    of the width w of exp(-(t/w)^2), however narrow that is beside the run. Not found: features narrower than 1e-13 of the run,
    and any after `until`, where laws vary too fast for the number of intervals allowed.
    """
    slots = int(tape.parts[op.LEAVES]) + len(tape.code)
    ranges, boxes, out = np.empty((slots, 2)), np.empty((slots, 6)), np.empty((count, 3))
    if not end > begin or tape.parts[op.TIMED] == 0:
        return TimeScale(np.array([[begin, end, end - begin]]), end)
    measure_ranges(tape, parameters, begin, end, boxes, ranges)
    used, until = find_steps(tape, parameters, begin, end, boxes, ranges, out)
    return TimeScale(out[:used].copy(), until)


def time_breaks(tape: Tape, parameters: Array, begin: float, end: float, count: int = 100_000) -> Array:
    """Return the times in (begin, end) where a law of time switches or leaves its domain, in order.

    nan as the last: there are more than were looked for.

    Not found: two switches closer than 1e-9 of the run of an argument with a kink between them, or of any closer than 1e-13, and
    arguments that touch 0 and return, other than at a domain's end.
    """
    slots = int(tape.parts[op.LEAVES]) + len(tape.code)
    boxes, buffers, found = np.empty((slots, 6)), make_buffers(tape), np.empty(count)
    times: list[Array] = []
    set_parameters(tape, buffers, parameters)
    for slot, _, kind, depends in tape.switch:
        if depends == op.OF_TIME and end > begin:
            used = find_breaks(tape, parameters, buffers, slot, kind == op.EDGE, begin, end, boxes, found)
            times.append(found[:used].copy() if used >= 0 else np.array([math.nan]))
    every = np.sort(np.concatenate(times)) if times else np.empty(0)
    near = 1e-12 * max(abs(begin), abs(end))  # two switches may see one kink with different last digits
    inside = every[~(every <= begin + near) & ~(every >= end - near)]
    return inside[np.concatenate([[True], ~(np.diff(inside) <= near)])] if len(inside) else inside


def time_jump(tape: Tape, parameters: Array, root: int, t: float) -> tuple[float, float]:
    """Return the jumps of a root's value and first derivative across t; nan where a side is undefined.

    Each side is continued to t by its jet from 1e-7 max(1, |t|) away; another break nearer than that spoils it.
    """
    step, buffers = 1e-7 * max(1.0, abs(t)), make_buffers(tape)
    set_parameters(tape, buffers, parameters)
    sides = []
    for side in (-step, step):
        set_time(tape, buffers, t + side)
        play_jets(tape, buffers, 0, tape.parts[op.ROOTS_END])
        value, first, second = buffers.slots[tape.root[root]].tolist()
        sides.append((value - side * (first - 0.5 * side * second), first - side * second))
    return sides[1][0] - sides[0][0], sides[1][1] - sides[0][1]


@kernel
def set_time(tape: Tape, buffers: Buffers, t: float) -> None:
    """Fill the leaves of time."""
    read_time(tape, t, buffers.slots)


@kernel
def set_parameters(tape: Tape, buffers: Buffers, parameters: Array) -> None:
    """Fill the leaves of parameters."""
    for k in range(tape.parts[op.LEAVES]):
        if tape.leaf[k, 0] == op.PARAMETER:
            buffers.slots[k, 0], buffers.slots[k, 1], buffers.slots[k, 2] = parameters[tape.leaf[k, 1]], 0.0, 0.0


@inner
def value_at(tape: Tape, buffers: Buffers, slot: int, t: float) -> float:
    """Return the value of a slot at a time."""
    set_time(tape, buffers, t)
    play_values(tape, buffers, 0, tape.parts[op.TIME_END])
    play_values(tape, buffers, tape.parts[op.ROOTS_END], tape.parts[op.ALL_END])
    return buffers.slots[slot, 0]


@kernel
def measure_ranges(tape: Tape, parameters: Array, begin: float, end: float, boxes: Array, ranges: Array) -> None:
    """Write the range (slots, 2) of each slot over the run, from many pieces of it; parts that are infinite are left out."""
    ranges[:, 0] = math.inf
    ranges[:, 1] = -math.inf
    for piece in range(PIECES):
        enclose(tape, parameters, begin + (end - begin) * piece / PIECES, begin + (end - begin) * (piece + 1) / PIECES, boxes)
        for slot in range(boxes.shape[0]):
            if boxes[slot, 1] - boxes[slot, 0] < math.inf:
                ranges[slot, 0] = min(ranges[slot, 0], boxes[slot, 0])
                ranges[slot, 1] = max(ranges[slot, 1], boxes[slot, 1])


@inner
def is_resolved(tape: Tape, boxes: Array, ranges: Array, step: float) -> bool:
    """Tell whether h^2 max|f''| <= the range of f for every slot of time, given functions among them."""
    leaves = tape.parts[op.LEAVES]
    for slot in range(leaves + tape.parts[op.TIME_END]):
        if slot < leaves:
            if tape.leaf[slot, 0] != op.SIGNAL:
                continue
        elif slot < leaves + tape.parts[op.PARAMETERS_END]:
            continue
        bend = largest((boxes[slot, 4], boxes[slot, 5]))
        known = ranges[slot, 1] >= ranges[slot, 0]
        if known and bend > 0.0 and not step * step * bend <= ranges[slot, 1] - ranges[slot, 0]:
            return False
    return True


@kernel
def find_steps(
    tape: Tape, parameters: Array, begin: float, end: float, boxes: Array, ranges: Array, out: Array
) -> tuple[int, float]:
    """Split the run until every piece is resolved; write begin, end and length of pieces, equal neighbours joined.

    Return how many, and the time up to which they are known.
    """
    size, count, looked = end - begin, 0, 0
    at, depth = 0, 0  # the piece from begin + size at / 2^depth
    while True:
        step = size / 2.0**depth
        low = begin + step * at
        enclose(tape, parameters, low, low + step, boxes)
        looked += 1
        if step > FINEST * max(size, abs(low)) and not is_resolved(tape, boxes, ranges, step):
            at, depth = 2 * at, depth + 1
        else:
            if count > 0 and (out[count - 1, 2] == step or count == out.shape[0]):
                out[count - 1, 1] = low + step
                out[count - 1, 2] = min(out[count - 1, 2], step)
            else:
                out[count, 0], out[count, 1], out[count, 2] = low, low + step, step
                count += 1
            at += 1
            while at % 2 == 0 and depth > 0:
                at, depth = at // 2, depth - 1
            if depth == 0:
                return count, end
        if looked >= MOST:
            return count, (out[count - 1, 1] if count > 0 else begin)


@kernel
def find_breaks(
    tape: Tape, parameters: Array, buffers: Buffers, slot: int, touching: bool, begin: float, end: float, boxes: Array, out: Array
) -> int:
    """Write the times where a slot changes its sign (`touching`: or only touches 0) into `out`; return how many, or a code."""
    size, count = end - begin, 0
    at, depth = 0, 0
    for _ in range(MOST):
        step = size / 2.0**depth
        low = begin + step * at
        enclose(tape, parameters, low, low + step, boxes)
        below, above = boxes[slot, 0], boxes[slot, 1]
        may = below <= 0.0 <= above and not (below == 0.0 and above == 0.0)
        rising = boxes[slot, 2] > 0.0 or boxes[slot, 3] < 0.0
        smooth = boxes[slot, 3] - boxes[slot, 2] < math.inf and above - below < math.inf
        turning = smooth and step > FINEST * max(size, abs(low))  # a parabola may open a window within 1e-9 of the run
        if may and not (rising and smooth) and (step > SMALLEST * size or turning):
            at, depth = 2 * at, depth + 1
            continue
        if may:
            first, last = value_at(tape, buffers, slot, low), value_at(tape, buffers, slot, low + step)
            if first < 0.0 <= last or last < 0.0 <= first or first <= 0.0 < last or last <= 0.0 < first:
                if count == out.shape[0]:
                    return FULL
                out[count] = bisect(tape, buffers, slot, low, low + step, first, last)
                count += 1
            elif touching and not (rising and smooth):
                if count == out.shape[0]:
                    return FULL
                out[count] = touch(tape, buffers, slot, low, low + step)
                count += 1
        at += 1
        while at % 2 == 0 and depth > 0:
            at, depth = at // 2, depth - 1
        if depth == 0:
            return count
    return TOO_MANY


@inner
def bisect(tape: Tape, buffers: Buffers, slot: int, low: float, high: float, first: float, last: float) -> float:
    """Return the first number at which a slot is off the side of its first value; from 0 on, where it begins to move."""
    sign, middle = (1.0 if last > first else -1.0), 0.5 * (low + high)
    while low < middle < high:
        value = sign * value_at(tape, buffers, slot, middle)
        if value > 0.0 or (value == 0.0 and first != 0.0):
            high = middle
        else:
            low = middle
        middle = 0.5 * (low + high)
    return high


@inner
def touch(tape: Tape, buffers: Buffers, slot: int, low: float, high: float) -> float:
    """Return where a slot is nearest to 0, by thirds."""
    for _ in range(100):
        left, right = low + (high - low) / 3.0, high - (high - low) / 3.0
        if abs(value_at(tape, buffers, slot, left)) < abs(value_at(tape, buffers, slot, right)):
            high = right
        else:
            low = left
    return 0.5 * (low + high)
