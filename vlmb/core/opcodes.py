"""What a tape of equations is made of: operations, leaves, switches, and the arrays that hold them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# Operations of two slots; SELECT takes the first where its third is negative, else the second.
ADD, SUBTRACT, MULTIPLY, DIVIDE, ATAN2, MIN, MAX, SELECT = range(8)
# Operations of one slot x, some with a constant c: x + c, c x, x / c, c / x, c, ...
UNARY = 8
(
    SHIFT, SCALE, PART, OVER, CONSTANT, SQUARE, WHOLE_POWER, POWER,
    SIN, COS, TAN, ASIN, ACOS, ATAN, EXP, LOG, SQRT, ABS, SIGN, STEP,
) = range(UNARY, UNARY + 20)  # fmt: skip
OPERATION, FIRST, SECOND, CONDITION = range(4)  # columns of `code`

# Leaves: the time, a parameter, value or rate of a quantity, a given function of time.
TIME, PARAMETER, VALUE, RATE, SIGNAL = range(5)

# What a slot depends on, each on those before it too.
OF_PARAMETERS, OF_TIME, OF_STATE = range(3)

# Entries of `parts`: how many leaves, then where the operations of parameters, of time, and all that the roots need end; how many
# leaves are of time; how many quantities the roots that evaluations need read.
LEAVES, PARAMETERS_END, TIME_END, ROOTS_END, ALL_END, TIMED, READ = range(7)

# Switches: the slope jumps; the value jumps; it jumps where the other operand is negative (atan2); a domain ends, or a pole.
KINK, JUMP, CUT, EDGE = range(4)
SWITCH_SLOT, SWITCH_OPERATION, SWITCH_KIND, SWITCH_OF = range(4)  # columns of `switch`


class Tape(NamedTuple):
    """Expressions as operations in order; slot k is leaf k, slot (leaves + k) the result of operation k.

    Operations stand in the order: of parameters, of time, of the state, then those that switches alone need, and roots that
    are looked at after a step alone.
    """

    code: Integers  # (operations, 4) operation and slots
    constant: Array  # (operations,)
    leaf: Integers  # (leaves, 2) kind, and which one
    root: Integers  # (roots,) slots
    parts: Integers  # (7,)
    sweep: Integers  # operations of the roots, one root after the other, each last first
    sweep_ends: Integers  # (roots, 3) in `sweep`: begin, end of those of the state, end
    used: Integers  # quantities that leaves read; those that evaluations need first
    entering: Integers  # leaves that the row of a root is made of, its rates or else its values; one root after the other
    entering_ends: Integers  # (roots, 2) in `entering`: begin and end
    switch: Integers  # (switches, 4) slot whose sign decides, operation, kind, what it depends on
    signal: Integers  # (signals, 3) given functions of time: see series.py
    series: Array  # (pieces, 7) of all of them


class Buffers(NamedTuple):
    """What playing a tape writes."""

    slots: Array  # (slots, 3) value, first and second derivative along the motion
    slopes: Array  # (operations, 2) partial derivatives by the two operands
    adjoint: Array  # (slots,) derivative of a root by each slot


def make_buffers(tape: Tape, dtype: Any = np.float64) -> Buffers:
    """Make the buffers of a tape."""
    operations = len(tape.code)
    slots = int(tape.parts[LEAVES]) + operations
    return Buffers(np.zeros((slots, 3), dtype), np.zeros((operations, 2), dtype), np.zeros(slots, dtype))
