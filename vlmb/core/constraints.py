"""The constraint layer on any mechanism that can `accelerate` and `respond`: ideal rows, and a programme with its controls.

    vdot = a + M^-1 (B u + J^T lambda),    J vdot = wanted,    W vdot = wanted,    wanted = H z + K z' - drift

with a the accelerations under all other forces. Ideal rows are eliminated by J M^-1 J^T; what they leave of W M^-1 B is G of
(5.6), which programme.py solves. Order of the rows: the knife edge where a multiplier holds it, ideal, programme, secondary.
"""

from __future__ import annotations

from vlmb.core import tree as of
from vlmb.core.angles import FINE
from vlmb.core.contacts import write_pushes
from vlmb.core.dense import cholesky, least_singular, least_squares, solve_cholesky, solve_square
from vlmb.core.jit import inner, kernel
from vlmb.core.lanes import LANES
from vlmb.core.links import respond
from vlmb.core.opcodes import Buffers, Tape
from vlmb.core.places import heading_met
from vlmb.core.programme import UNMET, copy, solve_programme
from vlmb.core.quantities import Quantities, add_row_here
from vlmb.core.responses import pushed_by, write_ground, write_moved
from vlmb.core.row_arrays import (
    ALONG,
    BEHIND,
    COLUMN,
    COUPLED,
    FIRST,
    FORM,
    OF_ROW,
    OF_WEIGHT,
    PROJECTION,
    ROOT,
    VARYING,
    WORTH,
    RowMemory,
    Rows,
    Sizes,
    Space,
    sizes_of,
    view,
)
from vlmb.core.rows import OF_FORCES, write_residual
from vlmb.core.scalars import finite, sqrt
from vlmb.core.scratch import Scratch
from vlmb.core.tape import gradient
from vlmb.core.tree import Array, Tree

EMPTY = 1e-18  # of J M^-1 J^T over |J|^2 [1/kg]: a row that moves nothing
REPEATED = 1e-12  # of a Cholesky pivot over the diagonal: a row that others repeat
CUT = 1e-10  # of the singular values of rows that repeat each other
ASKED = 1e-6  # [1/s^2] that a row which moves nothing may ask for
SIDEWAYS = 1  # place of the sideways velocity of a base that may slide
TINIEST = 1e-300
NEARLY = 0.1  # of the largest error: rows with one above it are named

# Codes: what is wrong, and with which rows or controls, as bits.
NO_VALUE, NO_DIRECTION, EMPTY_ROWS, CONTRADICTING, OUT_OF_REACH, NO_GAIN = range(1, 7)
KIND = 1 << 36  # a code is kind * KIND + bits; what is beyond the bits is left out
MOST = 35


@kernel(copied=True)
def constrain(
    rows: Rows, memory: RowMemory, tape: Tape, buffers: Buffers, quantities: Quantities, tree: Tree, y: Array, given: Array,
    reference: Array, scratch: Scratch, measured: Array, dy: Array,
) -> int:  # fmt: skip
    """Add to the accelerations in `dy`, where `accelerate` was last, what rows and controls bring; return a code.

    The tape has been played for jets.
    """
    sizes = sizes_of(rows)
    space = view(sizes, memory)
    code = write_lines(rows, sizes, space, tape, buffers, quantities, tree, y, given, reference, scratch, memory.lines)
    if code != 0:
        return code
    if rows.table[0, BEHIND] > 0:
        code = check_behind(rows, sizes, tape, buffers)
        if code != 0:
            return code
    if sizes.sliding > 0:
        write_pushes(rows, sizes, space, memory, tape, buffers, quantities, tree, y, given, reference, measured)
    write_wanted(rows, sizes, space, tape, buffers, tree, y)
    write_moved(sizes, space, memory.lanes, tree, dy, scratch)
    if sizes.ideal > 0:
        code = eliminate_ideal(sizes, space)
        if code != 0:
            return code
    if sizes.beyond > 0:
        write_matrix(sizes, space)
        if rows.table[0, VARYING] > 0:
            add_forces_named(rows, sizes, space, tape, buffers)
        if not solve_programme(rows, sizes, space, memory, tape, buffers):
            return OUT_OF_REACH * KIND + named(space.errors[sizes.ideal :], sizes.servo)
    write_multipliers(sizes, space)
    first = tree.shape[of.POSITIONS]
    for k in range(sizes.controls + sizes.ideal):
        for j in range(tree.shape[of.VELOCITIES]):
            dy[first + j] += space.shares[k] * space.answers[k, j]
    if tree.shape[of.BASE_KIND] == of.PLANTED:
        write_ground(sizes, space, tree, scratch)
    return 0


@inner
def bit(k: int) -> int:
    """Return the bit of a row or a control."""
    return 1 << min(k, MOST)


@inner
def named(errors: Array, count: int) -> int:
    """Return the bits of the rows with the largest errors."""
    worst, bits = 0.0, 0
    for k in range(count):
        worst = max(worst, abs(errors[k]))
    for k in range(count):
        if abs(errors[k]) > NEARLY * worst:
            bits |= bit(k)
    return bits


@kernel(copied=True)
def write_lines(
    rows: Rows, sizes: Sizes, space: Space, tape: Tape, buffers: Buffers, quantities: Quantities, tree: Tree, y: Array,
    given: Array, reference: Array, scratch: Scratch, lines: Array,
) -> int:  # fmt: skip
    """Write residuals and rows, and below them what the controls push on, all into `lines`; return a code.

    A row is the sum of its derivatives by leaves times their rows; a control has one quantity, and its scale.
    """
    first, held, count, last = rows.table[0, FIRST], sizes.held, sizes.ideal - sizes.held + sizes.beyond, rows.gains.shape[0] - 1
    failing, astray, h = 0, 0, heading_met(tree, scratch.rows)
    if held:
        for j in range(lines.shape[1]):
            lines[0, j] = 1.0 if j == SIDEWAYS else 0.0
    for k in range(count + sizes.controls):
        line, root = lines[held + k], first + k
        begin, end, sound = 0, 1, True
        if k < count:
            write_residual(tape, buffers, root, rows.table[1 + k, FORM], k, space.residual)
            end = 0
            if rows.table[1 + k, FORM] != OF_FORCES:
                gradient(tape, buffers, root, False)
                begin, end = tape.entering_ends[root, 0], tape.entering_ends[root, 1]
        for j in range(line.shape[0]):
            line[j] = 0.0
        for j in range(begin, end):
            which, share = rows.table[1 + k, ALONG], rows.gains[last, max(k - count, 0)]
            if k < count:
                leaf = tape.entering[j]
                which, share = tape.leaf[leaf, 1], buffers.adjoint[leaf]
            sound = add_row_here(quantities, which, tree, y, h, given, reference, share, line) == FINE and sound
        total = 0.0
        for j in range(line.shape[0]):
            total += line[j]
        if k < count:
            total += space.residual[k, 0] + space.residual[k, 1] + space.residual[k, 2]
        if not (sound and finite(total)):
            if k < count:
                failing |= bit(held + k)
            else:
                astray |= bit(k - count)
    if failing != 0:
        return NO_VALUE * KIND + failing
    return NO_DIRECTION * KIND + astray if astray != 0 else 0


@inner
def check_behind(rows: Rows, sizes: Sizes, tape: Tape, buffers: Buffers) -> int:
    """Return 0 if u0, gains, weights and border have finite values, weights above 0; else a code with the first that has not."""
    count, head = sizes.ideal - sizes.held + sizes.beyond, rows.table[0]
    for k in range(head[BEHIND]):
        if not finite(buffers.slots[tape.root[head[FIRST] + count + k], 0]):
            return NO_GAIN * KIND + k
    for k in range(head[VARYING]):
        entry = rows.table[1 + count + sizes.controls + k]
        if entry[OF_ROW] == OF_WEIGHT and buffers.slots[tape.root[entry[ROOT]], 0] <= 0.0:
            return NO_GAIN * KIND + entry[ROOT] - head[FIRST] - count
    return 0


@kernel(copied=True)
def write_wanted(rows: Rows, sizes: Sizes, space: Space, tape: Tape, buffers: Buffers, tree: Tree, y: Array) -> None:
    """Write what the rows want of their accelerations: H z + K z' - drift."""
    count, held, wanted = sizes.ideal + sizes.beyond - sizes.held, sizes.held, space.wanted
    if held:
        wanted[0] = -rows.gains[count, sizes.controls] * y[tree.shape[of.POSITIONS] + SIDEWAYS]
    coupled = rows.table[0, COUPLED] != 0
    for k in range(count):
        wanted[held + k] = -space.residual[k, 2]
        for j in range(0 if coupled else k, count if coupled else k + 1):
            wanted[held + k] += rows.gains[k, j] * space.residual[j, 0] + rows.gains[k, count + j] * space.residual[j, 1]
    for k in range(rows.table[0, VARYING]):
        entry = rows.table[1 + count + sizes.controls + k]
        if entry[OF_ROW] >= 0:
            gain = buffers.slots[tape.root[entry[ROOT]], 0]
            wanted[held + entry[OF_ROW]] += gain * space.residual[entry[COLUMN] % count, entry[COLUMN] // count]


@kernel(copied=True)
def eliminate_ideal(sizes: Sizes, space: Space) -> int:
    """Solve J M^-1 J^T X = (J M^-1 B, lacking); return a code."""
    e, s, square, solved = sizes.ideal, sizes.controls, space.square, space.solved
    for i in range(e):
        for j in range(e):
            square[i, j] = space.moved[i, s + j]
        for k in range(s):
            solved[i, k] = space.moved[i, k]
        solved[i, s] = space.wanted[i]
    bits, asked = clear_empty(sizes, space)
    if asked > ASKED:
        return EMPTY_ROWS * KIND + bits
    copy(square, e, e, space.first)
    space.state[WORTH] = 1.0
    if sizes.sliding > 0:
        copy(solved, e, s + 1, space.second)
        if solve_square(space.first, e, solved, s + 1, REPEATED):
            return 0
        copy(space.second, e, s + 1, solved)
        return solve_repeating(sizes, space)
    if cholesky(space.first, e, REPEATED):
        for i in range(e):
            space.state[WORTH] = min(space.state[WORTH], space.first[i, i] / sqrt(max(square[i, i], space.largest[i])))
        solve_cholesky(space.first, e, solved, s + 1)
        return 0
    return solve_repeating(sizes, space)


@kernel(copied=True)
def clear_empty(sizes: Sizes, space: Space) -> tuple[int, float]:
    """Take rows that move nothing out of the system; return their bits, and the most that they ask for."""
    e, s, bits, asked = sizes.ideal, sizes.controls, 0, 0.0
    for i in range(e):
        size = 0.0
        for j in range(space.lines.shape[1]):
            size += space.lines[i, j] * space.lines[i, j]
        if abs(space.square[i, i]) <= EMPTY * size:  # friction may make it negative
            bits |= bit(i)
            asked = max(asked, abs(space.solved[i, s]))
            for j in range(e):
                space.square[i, j] = space.square[j, i] = 0.0
            for k in range(s + 1):
                space.solved[i, k] = 0.0
            space.square[i, i] = 1.0
    return bits, asked


@inner
def solve_repeating(sizes: Sizes, space: Space) -> int:
    """The same for rows that repeat each other: the least multipliers that meet them; return a code."""
    e, s, a, b, x = sizes.ideal, sizes.controls, space.first, space.second, space.third
    largest, worst, total = 1.0, 0.0, 0.0
    for i in range(e):
        for j in range(e):
            a[i, j] = space.square[i, j] / (scale_of(space, i) * scale_of(space, j))
        for k in range(s + 1):
            b[i, k] = space.solved[i, k] / scale_of(space, i)
            largest = max(largest, abs(space.solved[i, k]))
    least_squares(a, e, e, b, s + 1, CUT, x)
    for i in range(e):
        for j in range(e):
            a[i, j] = space.square[i, j] / sqrt(max(space.square[i, i], space.largest[i], TINIEST))
            a[i, j] /= sqrt(max(space.square[j, j], space.largest[j], TINIEST))
    space.state[WORTH] = sqrt(least_singular(a, e, e, CUT))
    for j in range(e):
        for k in range(s + 1):
            x[j, k] /= scale_of(space, j)
    for i in range(e):
        space.errors[i] = 0.0
        for k in range(s + 1):
            error = -space.solved[i, k]
            for j in range(e):
                error += space.square[i, j] * x[j, k]
            space.errors[i] = max(space.errors[i], abs(error))
            total += error
        worst = max(worst, space.errors[i])
    if not finite(total):
        return CONTRADICTING * KIND
    if worst > UNMET * largest:
        return CONTRADICTING * KIND + named(space.errors, e)
    copy(x, e, s + 1, space.solved)
    return 0


@inner
def scale_of(space: Space, i: int) -> float:
    """Return the root of a diagonal entry of J M^-1 J^T."""
    return sqrt(max(space.square[i, i], TINIEST))


@kernel(copied=True)
def write_matrix(sizes: Sizes, space: Space) -> None:
    """Write G of (5.6), and beta in the place of what its rows lack: both with the multipliers that the controls bring along."""
    e, s = sizes.ideal, sizes.controls
    for i in range(sizes.beyond):
        moved = space.moved[e + i]
        for k in range(s):
            space.matrix[i, k] = moved[k]
            for j in range(e):
                space.matrix[i, k] -= moved[s + j] * space.solved[j, k]
        for j in range(e):
            space.wanted[e + i] -= moved[s + j] * space.solved[j, s]


@inner
def add_forces_named(rows: Rows, sizes: Sizes, space: Space, tape: Tape, buffers: Buffers) -> None:
    """Add the forces of contacts that rows name: multipliers under the controls, each times what the motion gives."""
    s, first = sizes.controls, 1 + sizes.ideal - sizes.held + sizes.beyond + sizes.controls
    for k in range(first, first + rows.table[0, VARYING]):
        entry = rows.table[k]
        if entry[OF_ROW] < OF_WEIGHT:
            i, j, share = OF_WEIGHT - 1 - entry[OF_ROW], entry[COLUMN], buffers.slots[tape.root[entry[ROOT]], 0]
            for control in range(s):
                space.matrix[i, control] -= share * space.solved[j, control]
            space.wanted[sizes.ideal + i] -= share * space.solved[j, s]


@kernel(copied=True)
def write_multipliers(sizes: Sizes, space: Space) -> None:
    """Write the multipliers of the ideal rows under the controls."""
    s = sizes.controls
    for j in range(sizes.ideal):
        space.shares[s + j] = space.solved[j, s]
        for k in range(s):
            space.shares[s + j] -= space.solved[j, k] * space.shares[k]


@kernel(copied=True)
def add_forces(rows: Rows, memory: RowMemory, force: Array) -> None:
    """Add B u + J^T lambda of the last solution to generalized forces (nv,)."""
    sizes = sizes_of(rows)
    space = view(sizes, memory)
    for k in range(sizes.controls + sizes.ideal):
        pushed = pushed_by(sizes, space, k)
        for j in range(pushed.shape[0]):
            force[j] += space.shares[k] * pushed[j]


@kernel
def project(memory: RowMemory, tree: Tree, y: Array, scratch: Scratch) -> None:
    """Write into memory.state the state y with v - M^-1 e v_left / (M^-1)_left, where `accelerate` was last."""
    first = tree.shape[of.POSITIONS]
    moved = memory.lanes.moved
    for j in range(moved.shape[0]):
        for lane in range(LANES):
            moved[j, lane] = 1.0 if j == SIDEWAYS else 0.0
    respond(tree, scratch, memory.lanes)
    share = y[first + SIDEWAYS] / moved[SIDEWAYS, 0]
    for j in range(y.shape[0]):
        memory.state[PROJECTION, j] = y[j]
    for j in range(moved.shape[0]):
        memory.state[PROJECTION, first + j] -= share * moved[j, 0]
    memory.state[PROJECTION, first + SIDEWAYS] = 0.0
