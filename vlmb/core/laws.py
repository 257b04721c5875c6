"""Laws of time, played alone: value and two derivatives at one time, values at many."""

from __future__ import annotations

from vlmb.core import opcodes as op
from vlmb.core.jit import kernel
from vlmb.core.packed import PARAMETERS, buffers_of, part, tape_of
from vlmb.core.scalars import NAN, finite
from vlmb.core.tape import play_jets, play_values
from vlmb.core.time_scan import set_parameters, set_time
from vlmb.core.tree import Array, Integers


@kernel
def law_jet(integers: Integers, reals: Array, t: float) -> tuple[float, float, float]:
    """Return value, first and second derivative of the first root at a time; nan where one is not finite."""
    tape, buffers = tape_of(integers, reals), buffers_of(integers, reals)
    set_parameters(tape, buffers, part(reals, integers, PARAMETERS))
    set_time(tape, buffers, t)
    play_jets(tape, buffers, 0, tape.parts[op.TIME_END])
    slot = tape.root[0]
    value, first, second = buffers.slots[slot, 0], buffers.slots[slot, 1], buffers.slots[slot, 2]
    if not finite(value + first + second):
        return NAN, NAN, NAN
    return value, first, second


@kernel
def law_value(integers: Integers, reals: Array, t: float) -> float:
    """Return the value of the first root at a time; nan where it is not finite."""
    tape, buffers = tape_of(integers, reals), buffers_of(integers, reals)
    set_parameters(tape, buffers, part(reals, integers, PARAMETERS))
    set_time(tape, buffers, t)
    play_values(tape, buffers, 0, tape.parts[op.TIME_END])
    value = buffers.slots[tape.root[0], 0]
    return value if finite(value) else NAN


@kernel
def law_values(integers: Integers, reals: Array, times: Array, out: Array) -> None:
    """Write the values of the first root at times (N,) into `out` (N,); nan where it is not finite."""
    for k in range(times.shape[0]):
        out[k] = law_value(integers, reals, times[k])
