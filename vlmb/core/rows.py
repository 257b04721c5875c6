"""Constraint rows: residual z, rate z', drift of z' and the row W over the velocities, from a tape and the quantities it names.

Rows of positions: z = g, z' = g', drift g''. Rows of velocities: z = 0, z' = g, drift g'. In both z'' = W v' + drift.
"""

from __future__ import annotations

from vlmb.core import opcodes as op
from vlmb.core.angles import FINE
from vlmb.core.jit import kernel
from vlmb.core.opcodes import Buffers, Tape
from vlmb.core.quantities import Quantities, add_row, measure_these
from vlmb.core.scalars import finite, wrapped
from vlmb.core.tape import gradient, play_jets, read_leaves, values
from vlmb.core.tree import Array, Integers, Tree

OF_POSITIONS, OF_VELOCITIES, OF_ANGLES = range(3)  # forms of a row; OF_ANGLES: of positions, z is wrapped to [-pi, pi)
QUANTITY_FAILS, ROW_FAILS, LEAF_FAILS = range(1, 4)  # codes; with each a place


@kernel
def evaluate_rows(
    tape: Tape, buffers: Buffers, quantities: Quantities, tree: Tree, form: Integers, t: float, y: Array, given: Array,
    reference: Array, parameters: Array, signals: Array, measured: Array, out: Array, matrix: Array,
) -> tuple[int, int]:  # fmt: skip
    """Write z, z' and drift into `out` (rows, 3) and W into `matrix` (rows, nv), after `prepare`; return a code and its place.

    QUANTITY_FAILS: code + 3 k of quantity k; ROW_FAILS: a row without a finite value; LEAF_FAILS: code + 3 k of a quantity
    without a row.
    """
    bad = measure_these(quantities, tape.used, tree, y, given, reference, measured)
    if bad != 0:
        return QUANTITY_FAILS, bad
    read_leaves(tape, t, parameters, measured, signals, buffers.slots)
    play_jets(tape, buffers, tape.parts[op.PARAMETERS_END], tape.parts[op.ROOTS_END])
    for r in range(tape.root.shape[0]):
        write_residual(tape, buffers, r, form[r], r, out)
        if not finite(out[r, 0] + out[r, 1] + out[r, 2]):
            return ROW_FAILS, r
        bad = write_row(tape, buffers, quantities, tree, r, y, given, reference, matrix[r])
        if bad != 0:
            return LEAF_FAILS, bad
    return FINE, 0


@kernel(inline=True)
def write_residual(tape: Tape, buffers: Buffers, root: int, form: int, r: int, out: Array) -> None:
    """Write z, z' and drift of a root into row r of `out`."""
    slots, slot = buffers.slots, tape.root[root]
    if form == OF_VELOCITIES:
        out[r, 0], out[r, 1], out[r, 2] = 0.0, slots[slot, 0], slots[slot, 1]
    else:
        out[r, 0] = wrapped(slots[slot, 0]) if form == OF_ANGLES else slots[slot, 0]
        out[r, 1], out[r, 2] = slots[slot, 1], slots[slot, 2]


@kernel(inline=True)
def write_row(
    tape: Tape, buffers: Buffers, quantities: Quantities, tree: Tree, root: int, y: Array, given: Array, reference: Array,
    line: Array,
) -> int:  # fmt: skip
    """Write W (nv,) of a root: the sum of its derivatives by leaves times their rows; return 0, or code + 3 k of quantity k."""
    gradient(tape, buffers, root, False)
    for j in range(line.shape[0]):
        line[j] = 0.0
    for j in range(tape.entering_ends[root, 0], tape.entering_ends[root, 1]):
        k = tape.entering[j]
        code = add_row(quantities, tape.leaf[k, 1], tree, y, given, reference, buffers.adjoint[k], line)
        if code != FINE:
            return code + 3 * tape.leaf[k, 1]
    return 0


@kernel
def evaluate_laws(
    tape: Tape, buffers: Buffers, quantities: Quantities, tree: Tree, t: float, y: Array, given: Array, reference: Array,
    parameters: Array, signals: Array, measured: Array, out: Array,
) -> tuple[int, int]:  # fmt: skip
    """Write the values of all roots into `out` (roots,), after `prepare`; return a code and its place as `evaluate_rows` does."""
    bad = measure_these(quantities, tape.used, tree, y, given, reference, measured)
    if bad != 0:
        return QUANTITY_FAILS, bad
    read_leaves(tape, t, parameters, measured, signals, buffers.slots)
    bad = values(tape, buffers, out)
    return (ROW_FAILS, bad - 1) if bad != 0 else (FINE, 0)


@kernel
def evaluate_switches(
    tape: Tape, buffers: Buffers, t: float, parameters: Array, signals: Array, measured: Array, out: Array
) -> None:
    """Write value and rate of every switch into `out` (switches, 2), after `measure_these` and `add_accelerations`."""
    read_leaves(tape, t, parameters, measured, signals, buffers.slots)
    play_jets(tape, buffers, tape.parts[op.PARAMETERS_END], tape.parts[op.ALL_END])
    for k in range(tape.switch.shape[0]):
        slot = tape.switch[k, op.SWITCH_SLOT]
        out[k, 0], out[k, 1] = buffers.slots[slot, 0], buffers.slots[slot, 1]
