"""Constraint rows: residual z, rate z', drift of z' and the row W over the velocities, from a tape and the quantities it names.

Rows of positions: z = g, z' = g', drift g''. Rows of velocities: z = 0, z' = g, drift g'. In both z'' = W v' + drift.
Rows of forces have no W: z' = g is what stands in them beside forces.
"""

from __future__ import annotations

from vlmb.core import opcodes as op
from vlmb.core.angles import FINE
from vlmb.core.jit import kernel
from vlmb.core.opcodes import Buffers, Tape
from vlmb.core.quantities import Quantities, add_row
from vlmb.core.scalars import wrapped
from vlmb.core.tape import gradient, play_jets, read_leaves
from vlmb.core.tree import Array, Tree

OF_POSITIONS, OF_VELOCITIES, OF_ANGLES, OF_FORCES = range(4)  # forms of a row; OF_ANGLES: of positions, z is wrapped to [-pi, pi)


@kernel(inline=True)
def write_residual(tape: Tape, buffers: Buffers, root: int, form: int, r: int, out: Array) -> None:
    """Write z, z' and drift of a root into row r of `out`."""
    slots, slot = buffers.slots, tape.root[root]
    if form == OF_VELOCITIES:
        out[r, 0], out[r, 1], out[r, 2] = 0.0, slots[slot, 0], slots[slot, 1]
    elif form == OF_FORCES:
        out[r, 0], out[r, 1], out[r, 2] = 0.0, slots[slot, 0], 0.0
    else:
        out[r, 0] = wrapped(slots[slot, 0]) if form == OF_ANGLES else slots[slot, 0]
        out[r, 1], out[r, 2] = slots[slot, 1], slots[slot, 2]


@kernel(inline=True)
def write_row(
    tape: Tape, buffers: Buffers, quantities: Quantities, tree: Tree, r: int, y: Array, given: Array, reference: Array, row: Array
) -> int:
    """Write W (nv,) of row r: the sum of its derivatives by leaves times their rows; return 0, or code + 3 k of quantity k."""
    gradient(tape, buffers, r, False)
    for j in range(row.shape[0]):
        row[j] = 0.0
    for j in range(tape.entering_ends[r, 0], tape.entering_ends[r, 1]):
        k = tape.entering[j]
        code = add_row(quantities, tape.leaf[k, 1], tree, y, given, reference, buffers.adjoint[k], row)
        if code != FINE:
            return code + 3 * tape.leaf[k, 1]
    return 0


@kernel
def evaluate_switches(
    tape: Tape, buffers: Buffers, t: float, parameters: Array, measured: Array, out: Array
) -> None:
    """Write value and rate of every switch into `out` (switches, 2), after `measure_these` and `add_accelerations`."""
    read_leaves(tape, t, parameters, measured, buffers.slots)
    play_jets(tape, buffers, tape.parts[op.PARAMETERS_END], tape.parts[op.ALL_END])
    for k in range(tape.switch.shape[0]):
        slot = tape.switch[k, op.SWITCH_SLOT]
        out[k, 0], out[k, 1] = buffers.slots[slot, 0], buffers.slots[slot, 1]
