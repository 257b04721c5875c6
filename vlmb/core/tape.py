"""Playing a tape: values, derivatives along the motion (jets), and the gradient of a root over the leaves.

An operation f(x, z) of slots with x', x'', z', z'':
    f'  = f_x x' + f_z z'
    f'' = f_x x'' + f_z z'' + f_xx x'^2 + 2 f_xz x' z' + f_zz z'^2
The gradient runs backwards over the operations of one root, so that its cost does not grow with the number of leaves.

At a switch the side counts that its operation takes there: abs is x from 0 on, min and max take the first of two equals,
step is 1 from 0 on, sign(0) is 0; no derivative has an impulse. Outside a domain there is nan.
"""

from __future__ import annotations

from vlmb.core import opcodes as op
from vlmb.core.jit import inner, kernel
from vlmb.core.opcodes import Array, Buffers, Tape
from vlmb.core.operations import binary_slopes, binary_value, unary_jet, unary_value
from vlmb.core.scalars import NAN, finite
from vlmb.core.series import END, FIRST, ORDER, signal_jet


@inner
def selects_first(condition: float) -> bool:
    """Tell which operand op.SELECT takes."""
    return condition < 0.0


@kernel(inline=True)
def read_leaves(tape: Tape, t: float, parameters: Array, measured: Array, slots: Array) -> None:
    """Fill the leaves of `slots`: parameters (any,); measured (quantities, 3) value, rate and second derivative."""
    for k in range(tape.parts[op.LEAVES]):
        if tape.leaf[k, 0] == op.PARAMETER:
            slots[k, 0], slots[k, 1], slots[k, 2] = parameters[tape.leaf[k, 1]], 0.0, 0.0
    read_time(tape, t, slots)
    read_state(tape, measured, slots)


@kernel(inline=True)
def read_time(tape: Tape, t: float, slots: Array) -> None:
    """Fill the leaves of time: t itself and given functions of it; nan outside what is given."""
    for k in range(tape.parts[op.LEAVES] if tape.parts[op.TIMED] > 0 else 0):
        kind, at = tape.leaf[k, 0], tape.leaf[k, 1]
        if kind == op.TIME:
            slots[k, 0], slots[k, 1], slots[k, 2] = t, 1.0, 0.0
        elif kind == op.SIGNAL:
            first, end, order = tape.signal[at, FIRST], tape.signal[at, END], tape.signal[at, ORDER]
            slots[k, 0], slots[k, 1], slots[k, 2] = signal_jet(tape.series, first, end, order, t)


@kernel(inline=True)
def read_state(tape: Tape, measured: Array, slots: Array) -> None:
    """Fill the leaves of the state. A op.RATE leaf knows one derivative: its second is left 0."""
    for k in range(tape.parts[op.LEAVES]):
        kind, at = tape.leaf[k, 0], tape.leaf[k, 1]
        if kind == op.VALUE:
            slots[k, 0], slots[k, 1], slots[k, 2] = measured[at, 0], measured[at, 1], measured[at, 2]
        elif kind == op.RATE:
            slots[k, 0], slots[k, 1], slots[k, 2] = measured[at, 1], measured[at, 2], 0.0


@inner
def play_values(tape: Tape, buffers: Buffers, begin: int, end: int) -> None:
    """Play the operations begin <= k < end for their values alone; the leaves are filled."""
    slots, leaves = buffers.slots, tape.parts[op.LEAVES]
    for k in range(begin, end):
        code, a, b = tape.code[k, op.OPERATION], tape.code[k, op.FIRST], tape.code[k, op.SECOND]
        if code >= op.UNARY:
            slots[leaves + k, 0] = unary_value(code, slots[a, 0], tape.constant[k])
        elif code == op.SELECT:
            condition = slots[tape.code[k, op.CONDITION], 0]
            chosen = a if selects_first(condition) else b
            slots[leaves + k, 0] = slots[chosen, 0] if condition == condition else NAN
        else:
            slots[leaves + k, 0] = binary_value(code, slots[a, 0], slots[b, 0])


@kernel
def play_jets(tape: Tape, buffers: Buffers, begin: int, end: int) -> None:
    """Play the operations begin <= k < end for values, both derivatives along the motion, and the slopes of each."""
    slots, slopes, leaves = buffers.slots, buffers.slopes, tape.parts[op.LEAVES]
    for k in range(begin, end):
        code, a, b, o = tape.code[k, op.OPERATION], tape.code[k, op.FIRST], tape.code[k, op.SECOND], leaves + k
        x, x1, x2 = slots[a, 0], slots[a, 1], slots[a, 2]
        if code >= op.UNARY:
            f, slope, bend = unary_jet(code, x, tape.constant[k])
            slopes[k, 0] = slope
            slots[o, 0], slots[o, 1], slots[o, 2] = f, slope * x1, slope * x2 + bend * x1 * x1
        elif code == op.SELECT:
            select_jet(slots, slopes, k, o, a, b, slots[tape.code[k, op.CONDITION], 0])
        else:
            z, z1, z2 = slots[b, 0], slots[b, 1], slots[b, 2]
            f = binary_value(code, x, z)
            fx, fz, fxx, fxz, fzz = binary_slopes(code, x, z, f)
            slopes[k, 0], slopes[k, 1] = fx, fz
            slots[o, 0], slots[o, 1] = f, fx * x1 + fz * z1
            slots[o, 2] = fx * x2 + fz * z2 + fxx * x1 * x1 + 2.0 * fxz * x1 * z1 + fzz * z1 * z1


@inner
def select_jet(slots: Array, slopes: Array, k: int, o: int, a: int, b: int, condition: float) -> None:
    """Copy the jet of the chosen operand; the other one may be nan."""
    first = selects_first(condition)
    chosen = a if first else b
    slopes[k, 0], slopes[k, 1] = (1.0, 0.0) if first else (0.0, 1.0)
    for j in range(3):
        slots[o, j] = slots[chosen, j] if condition == condition else NAN


@kernel(inline=True)
def gradient(tape: Tape, buffers: Buffers, root: int, complete: bool) -> None:
    """Write the derivatives of a root by the leaves into adjoint[:leaves], after `play_jets`.

    By leaves of the state alone; `complete`: by time and parameters too.
    """
    adjoint, slopes, leaves = buffers.adjoint, buffers.slopes, tape.parts[op.LEAVES]
    first, last = tape.sweep_ends[root, 0], tape.sweep_ends[root, 2] if complete else tape.sweep_ends[root, 1]
    if complete:
        for slot in range(adjoint.shape[0]):
            adjoint[slot] = 0.0
    else:  # what is added elsewhere nobody reads
        for j in range(first, last):
            adjoint[leaves + tape.sweep[j]] = 0.0
        for j in range(tape.entering_ends[root, 0], tape.entering_ends[root, 1]):
            adjoint[tape.entering[j]] = 0.0
    adjoint[tape.root[root]] = 1.0
    for j in range(first, last):
        k = tape.sweep[j]
        weight = adjoint[leaves + k]
        if weight == 0.0:  # where op.SELECT passed by, slopes may be nan
            continue
        adjoint[tape.code[k, op.FIRST]] += weight * slopes[k, 0]
        if tape.code[k, op.OPERATION] < op.UNARY:
            adjoint[tape.code[k, op.SECOND]] += weight * slopes[k, 1]


@kernel
def prepare(tape: Tape, buffers: Buffers, parameters: Array) -> None:
    """Play what depends on parameters alone: once for a run, before anything else."""
    for k in range(tape.parts[op.LEAVES]):
        if tape.leaf[k, 0] == op.PARAMETER:
            buffers.slots[k, 0], buffers.slots[k, 1], buffers.slots[k, 2] = parameters[tape.leaf[k, 1]], 0.0, 0.0
    play_jets(tape, buffers, 0, tape.parts[op.PARAMETERS_END])


@kernel
def values(tape: Tape, buffers: Buffers, out: Array) -> int:
    """Play for the values of all roots, `out` (roots,), after `prepare` and `read_leaves`; return 1 + the first not finite."""
    play_values(tape, buffers, tape.parts[op.PARAMETERS_END], tape.parts[op.ROOTS_END])
    bad = 0
    for r in range(tape.root.shape[0] - 1, -1, -1):
        out[r] = buffers.slots[tape.root[r], 0]
        if not finite(out[r]):
            bad = r + 1
    return bad


@kernel
def jets(tape: Tape, buffers: Buffers, out: Array) -> int:
    """Play for value and two derivatives of all roots, `out` (roots, 3); return 1 + the first root that is not finite."""
    play_jets(tape, buffers, tape.parts[op.PARAMETERS_END], tape.parts[op.ROOTS_END])
    bad = 0
    for r in range(tape.root.shape[0] - 1, -1, -1):
        slot = tape.root[r]
        out[r, 0], out[r, 1], out[r, 2] = buffers.slots[slot, 0], buffers.slots[slot, 1], buffers.slots[slot, 2]
        if not finite(out[r, 0] + out[r, 1] + out[r, 2]):
            bad = r + 1
    return bad


@kernel
def failing_operation(tape: Tape, buffers: Buffers, root: int, order: int) -> int:
    """Return the operation where a root's value (order 0) or a derivative up to `order` first fails; -1 - leaf for a leaf.

    That is the one which is not finite while all that it uses is.
    """
    slots, leaves = buffers.slots, tape.parts[op.LEAVES]
    slot = tape.root[root]
    while slot >= leaves:
        k = slot - leaves
        deeper = -1
        for column in (op.CONDITION, op.SECOND, op.FIRST):
            if uses(tape, slots, k, column) and not finite_jet(slots, tape.code[k, column], order):
                deeper = tape.code[k, column]
        if deeper < 0:
            return k
        slot = deeper
    return -1 - slot


@inner
def uses(tape: Tape, slots: Array, k: int, column: int) -> bool:
    """Tell whether an operation takes the operand of a column now."""
    code = tape.code[k, op.OPERATION]
    if code == op.SELECT:
        if column == op.CONDITION:
            return True
        return selects_first(slots[tape.code[k, op.CONDITION], 0]) == (column == op.FIRST)
    if code == op.CONSTANT:
        return False
    return column == op.FIRST or (column == op.SECOND and code < op.UNARY)


@inner
def finite_jet(slots: Array, slot: int, order: int) -> bool:
    """Tell whether a slot's value and derivatives up to `order` are finite."""
    total = 0.0
    for j in range(order + 1):
        total += slots[slot, j] - slots[slot, j]
    return total == 0.0
