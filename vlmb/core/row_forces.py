"""What rows and controls give to others: powers, and forces on lengths that laws drive, which have no velocity of their own."""

from __future__ import annotations

from vlmb.core import tree as of
from vlmb.core.angles import FINE
from vlmb.core.contacts import add_friction_apart
from vlmb.core.jit import inner, kernel
from vlmb.core.opcodes import Buffers, Tape
from vlmb.core.quantities import Quantities, measure
from vlmb.core.row_arrays import FIRST, STILL, WORK, RowMemory, Rows, Sizes, Space
from vlmb.core.scalars import NAN
from vlmb.core.tape import gradient
from vlmb.core.tree import Array, Integers, Tree

LENGTH, COLUMN = range(2)  # columns of `driven`: the link's row, the column of `given` where the length stands


@kernel(copied=True)
def write_apart(
    rows: Rows, sizes: Sizes, space: Space, memory: RowMemory, driven: Integers, tape: Tape, buffers: Buffers,
    quantities: Quantities, tree: Tree, y: Array, given: Array, reference: Array, measured: Array,
) -> None:  # fmt: skip
    """Write the derivatives of z' of the ideal rows by the rates of driven lengths; `measured` is overwritten.

    The derivative of a quantity is its rate where that length alone grows, by 1 m/s.
    """
    write_still(memory, tree, y)
    for r in range(sizes.held, sizes.ideal):
        root = rows.table[0, FIRST] + r - sizes.held
        gradient(tape, buffers, root, False)
        for k in range(driven.shape[0]):
            space.apart[r, k] = 0.0
            for j in range(tape.entering_ends[root, 0], tape.entering_ends[root, 1]):
                leaf = tape.entering[j]
                alone = rate_alone(quantities, tape.leaf[leaf, 1], driven, k, tree, memory, given, reference, measured)
                space.apart[r, k] += buffers.adjoint[leaf] * alone
    for k in range(driven.shape[0] if sizes.sliding > 0 else 0):
        only(driven, k, given, memory.given)
        add_friction_apart(
            rows, sizes, space, memory, k, quantities, tree, memory.state[STILL], memory.given, reference, measured
        )


@inner
def write_still(memory: RowMemory, tree: Tree, y: Array) -> None:
    """Write the state with velocities 0 into memory.state."""
    still, places = memory.state[STILL], tree.shape[of.POSITIONS]
    for j in range(still.shape[0]):
        still[j] = y[j] if j < places else 0.0


@inner
def rate_alone(
    quantities: Quantities, which: int, driven: Integers, k: int, tree: Tree, memory: RowMemory, given: Array,
    reference: Array, measured: Array,
) -> float:  # fmt: skip
    """Return the rate of a quantity where driven length k alone grows by 1 m/s, after `write_still`; nan where it has none."""
    only(driven, k, given, memory.given)
    code = measure(quantities, which, tree, memory.state[STILL], memory.given, reference, measured)
    return measured[which, 1] if code == FINE else NAN


@inner
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
