"""What rows and controls give to others: powers, and forces on lengths that laws drive, which have no velocity of their own."""

from __future__ import annotations

from vlmb.core import tree as of
from vlmb.core.angles import FINE
from vlmb.core.contacts import add_friction_apart
from vlmb.core.jit import kernel
from vlmb.core.opcodes import Buffers, Tape
from vlmb.core.quantities import BETWEEN, CENTRE_OF_MASS, HALF_SQUARE, KIND, POINT, Quantities, measure
from vlmb.core.row_arrays import FIRST, STILL, WORK, RowMemory, Rows, Sizes, Space
from vlmb.core.scalars import NAN
from vlmb.core.scratch import AXIAL, Scratch
from vlmb.core.tape import gradient
from vlmb.core.tree import Array, Integers, Tree

LENGTH, COLUMN = range(2)  # columns of `driven`: the link's row, the column of `given` where the length stands


@kernel
def write_apart(
    rows: Rows, sizes: Sizes, space: Space, memory: RowMemory, driven: Integers, tape: Tape, buffers: Buffers,
    quantities: Quantities, tree: Tree, y: Array, given: Array, reference: Array, measured: Array,
) -> None:  # fmt: skip
    """Write the derivatives of z' of the ideal rows by the rates of driven lengths; `measured` is overwritten.

    The derivative of a quantity is its rate where that length alone grows, by 1 m/s.
    """
    still, growing, places = memory.state[STILL], memory.given, tree.shape[of.POSITIONS]
    for j in range(still.shape[0]):
        still[j] = y[j] if j < places else 0.0
    for r in range(sizes.held, sizes.ideal):
        root = rows.table[0, FIRST] + r - sizes.held
        gradient(tape, buffers, root, False)
        for k in range(driven.shape[0]):
            only(driven, k, given, growing)
            space.apart[r, k] = 0.0
            for j in range(tape.entering_ends[root, 0], tape.entering_ends[root, 1]):
                leaf = tape.entering[j]
                which = tape.leaf[leaf, 1]
                code = measure(quantities, which, tree, still, growing, reference, measured)
                space.apart[r, k] += buffers.adjoint[leaf] * (measured[which, 1] if code == FINE else NAN)
    for k in range(driven.shape[0] if sizes.sliding > 0 else 0):
        only(driven, k, given, growing)
        add_friction_apart(rows, sizes, space, memory, k, quantities, tree, still, growing, reference, measured)


@kernel
def push_driven_along(
    quantities: Quantities, along: int, value: float, driven: Integers, tree: Tree, y: Array, given: Array, reference: Array,
    measured: Array, scratch: Scratch,
) -> None:  # fmt: skip
    """Take from the forces on driven lengths what a force along a quantity gives them: its point moves with the lengths.

    The quantity's rate grows by its derivative where a length's rate grows by 1 m/s.
    """
    if quantities.kind[along, KIND] not in (POINT, CENTRE_OF_MASS, BETWEEN, HALF_SQUARE):
        return
    measure(quantities, along, tree, y, given, reference, measured)
    rate = measured[along, 1]
    for k in range(driven.shape[0]):
        row, column = driven[k, LENGTH], driven[k, COLUMN]
        kept = given[row, column + 1]
        given[row, column + 1] = kept + 1.0
        measure(quantities, along, tree, y, given, reference, measured)
        given[row, column + 1] = kept
        scratch.rows[row, AXIAL + column // 3] -= value * (measured[along, 1] - rate)
    measured[along, 1] = rate


@kernel
def only(driven: Integers, k: int, given: Array, growing: Array) -> None:
    """Let one driven length grow by 1 m/s and all others rest."""
    for i in range(given.shape[0]):
        for j in range(given.shape[1]):
            growing[i, j] = given[i, j] if j % 3 == 0 else 0.0
    growing[driven[k, LENGTH], driven[k, COLUMN] + 1] = 1.0


@kernel(inline=True)
def push_on(sizes: Sizes, space: Space, k: int) -> float:
    """Return the force [N] of the ideal rows on driven length k."""
    force = 0.0
    for r in range(sizes.held, sizes.ideal):
        force += space.shares[sizes.controls + r] * space.pushes_apart[r, k]
    return force


@kernel(inline=True)
def speed_of(line: Array, tree: Tree, y: Array) -> float:
    """Return a row times the velocities."""
    total, first = 0.0, tree.shape[of.POSITIONS]
    for j in range(line.shape[0]):
        total += line[j] * y[first + j]
    return total


@kernel(inline=True)
def row_power(sizes: Sizes, space: Space, r: int, driven: Integers, tree: Tree, y: Array, given: Array) -> float:
    """Return the power [W] of an ideal row."""
    speed = speed_of(space.lines[r], tree, y)
    for k in range(driven.shape[0]):
        speed += space.apart[r, k] * given[driven[k, LENGTH], driven[k, COLUMN] + 1]
    return space.shares[sizes.controls + r] * speed


@kernel(inline=True)
def add_row_powers(
    rows: Rows, sizes: Sizes, space: Space, driven: Integers, tree: Tree, y: Array, given: Array, work: int, dy: Array
) -> None:
    """Add the powers of controls and of ideal rows that work to the rates of their work states, from `work` on in `dy`."""
    for r in range(sizes.held, sizes.ideal):
        state = rows.table[1 + r - sizes.held, WORK]
        if state >= 0:
            dy[work + state] += row_power(sizes, space, r, driven, tree, y, given)
    after = 1 + sizes.ideal - sizes.held + sizes.beyond
    for k in range(sizes.controls):
        dy[work + rows.table[after + k, WORK]] += space.shares[k] * speed_of(space.columns[k], tree, y)
