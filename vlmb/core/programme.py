"""Controls of a programme: G u = beta, by (5.6) the least u in the scales of the controls, and what the rows leave free."""

from __future__ import annotations

from vlmb.core.dense import (
    eliminate,
    largest_entry,
    least_squares,
    pivots_hold,
    reflect,
    reflect_back,
    solve_lower,
    solve_upper,
)
from vlmb.core.jit import inner, kernel
from vlmb.core.opcodes import Buffers, Tape
from vlmb.core.row_arrays import (
    BORDER,
    COLUMN,
    FREE,
    OF_ROW,
    OF_WEIGHT,
    REPEATING,
    ROOT,
    SIDE,
    VARYING,
    RowMemory,
    Rows,
    Sizes,
    Space,
    view,
)
from vlmb.core.scalars import sqrt
from vlmb.core.tree import Array

RANK = 1e-9  # relative size below which a direction of G counts as uncontrolled
SMALLEST = 1e-5  # of G in the scales of the controls [1/s^2]: RANK times this is rounding
UNMET = 1e-6  # of the largest beta, or [1/s^2]: error of a row that the controls do not meet


@kernel(copied=True)
def solve_programme(rows: Rows, sizes: Sizes, space: Space, memory: RowMemory, tape: Tape, buffers: Buffers) -> bool:
    """Write the controls over their scales into the shares; return whether the rows of the programme are met.

    Weights that the motion gives change the scales of this instant.
    """
    varying = rows.table[0, VARYING]
    for k in range(sizes.controls if varying > 0 else 0):
        ratio = ratio_of(rows, sizes, tape, buffers, k)
        for i in range(sizes.beyond):
            space.matrix[i, k] *= ratio
    met = share_out(sizes, memory)
    if met and rows.table[0, FREE] >= 0:
        add_free(rows, sizes, memory, tape, buffers)
    for k in range(sizes.controls if varying > 0 else 0):
        space.shares[k] *= ratio_of(rows, sizes, tape, buffers, k)
    return met


@kernel(inline=True)
def ratio_of(rows: Rows, sizes: Sizes, tape: Tape, buffers: Buffers, k: int) -> float:
    """Return the scale of a control at this instant over its constant one: 1/sqrt(R) over that, if the motion gives R."""
    count = sizes.ideal - sizes.held + sizes.beyond
    for j in range(rows.table[0, VARYING]):
        entry = rows.table[1 + count + sizes.controls + j]
        if entry[OF_ROW] == OF_WEIGHT and entry[COLUMN] == k:
            return 1.0 / (sqrt(buffers.slots[tape.root[entry[ROOT]], 0]) * rows.gains[count, k])
    return 1.0


@kernel(copied=True)
def share_out(sizes: Sizes, memory: RowMemory) -> bool:
    """Write the least controls that meet all rows; return whether those of the programme are met.

    Secondary rows take what the others leave; with as many controls as all rows together this is one system. Here and below the
    memory is handed over and not its parts: each of them would cost nanoseconds.
    """
    r, servo = sizes.beyond, sizes.servo
    if servo < r <= sizes.controls and least(sizes, memory, r):
        return True
    regular = least(sizes, memory, servo)
    view(sizes, memory).state[REPEATING] = 0.0 if regular else 1.0
    met = True if regular else least_deficient(sizes, memory)
    if met and r > servo:
        add_secondary(sizes, memory)
    return met


@kernel(inline=True)
def copy(a: Array, rows: int, columns: int, out: Array) -> None:
    """Copy the first rows and columns of a table."""
    for i in range(rows):
        for j in range(columns):
            out[i, j] = a[i, j]


@kernel
def least(sizes: Sizes, memory: RowMemory, rows: int) -> bool:
    """Solve G u = beta for the least u; False where pivots show rows that repeat each other. Notes the sign of det G."""
    space, controls = view(sizes, memory), sizes.controls
    a, pivots, state, u, beta = space.first, space.second[0], space.state, space.shares, space.wanted[sizes.ideal :]
    copy(space.matrix, rows, controls, a)
    bound = RANK * max(largest_entry(a, rows, controls), SMALLEST)
    for k in range(controls):
        u[k] = beta[k] if k < rows else 0.0
    state[SIDE] = 0.0
    if rows == controls:
        side = eliminate(a, rows, u)
        for k in range(rows):
            pivots[k] = a[k, k]
        if not pivots_hold(pivots, rows, bound):
            return False
        state[SIDE] = side
        solve_upper(a, rows, u)
        return True
    reflect(a, rows, rows, controls, pivots)
    if not pivots_hold(pivots, rows, bound):
        return False
    solve_lower(a, rows, pivots, u)
    reflect_back(a, rows, controls, u)
    return True


@inner
def least_deficient(sizes: Sizes, memory: RowMemory) -> bool:
    """The same for rows that repeat each other; False where they ask for what the controls cannot give, with their errors."""
    space, rows, controls = view(sizes, memory), sizes.servo, sizes.controls
    a, b, x, largest, worst = space.first, space.second, space.third, 1.0, 0.0
    u, beta, errors = space.shares, space.wanted[sizes.ideal :], space.errors[sizes.ideal :]
    for i in range(rows):
        largest = max(largest, abs(beta[i]))
        b[i, 0] = beta[i]
        for j in range(controls):
            entry = space.matrix[i, j]
            a[i, j] = 0.0 if abs(entry) < RANK * SMALLEST else entry
    least_squares(a, rows, controls, b, 1, RANK, x)
    for i in range(rows):
        errors[i] = -beta[i]
        for j in range(controls):
            entry = space.matrix[i, j]
            errors[i] += 0.0 if abs(entry) < RANK * SMALLEST else entry * x[j, 0]
        worst = max(worst, abs(errors[i]))
    for j in range(controls):
        u[j] = x[j, 0]
    return worst <= UNMET * largest


@inner
def add_secondary(sizes: Sizes, memory: RowMemory) -> None:
    """Add Z x with the least squares of what the secondary rows lack, G_2 (u + Z x) - beta_2; Z spans the kernel of G."""
    space, servo, rows, controls = view(sizes, memory), sizes.servo, sizes.beyond, sizes.controls
    u, beta = space.shares, space.wanted[sizes.ideal :]
    a, inside, null, count = space.first, space.second, controls - servo, rows - servo
    lacking, x = space.third[:count], space.third[count:]
    copy(space.matrix, rows, controls, a)
    reflect(a, rows, servo, controls, inside[0])
    for i in range(count):
        lacking[i, 0] = beta[servo + i]
        for j in range(controls):
            lacking[i, 0] -= space.matrix[servo + i, j] * u[j]
        for j in range(null):
            inside[i, j] = a[servo + i, servo + j]
    least_squares(inside, count, null, lacking, 1, RANK, x)
    added = inside[0]
    for j in range(controls):
        added[j] = x[j - servo, 0] if j >= servo else 0.0
    reflect_back(a, servo, controls, added)
    for j in range(controls):
        u[j] += added[j]


@inner
def add_free(rows: Rows, sizes: Sizes, memory: RowMemory, tape: Tape, buffers: Buffers) -> None:
    """Add u0 u_tau of (5.6): u_tau is the generalized cross product of the rows of G, and of those of the border below them."""
    space = view(sizes, memory)
    a, pivots, cross, s, servo = space.first, space.second[0], space.third[0], sizes.controls, sizes.servo
    count, border = rows.gains.shape[0] - 1, rows.table[0, BORDER]
    copy(space.matrix, servo, s, a)
    size = buffers.slots[tape.root[rows.table[0, FREE]], 0]
    for k in range(s):
        scale = rows.gains[count, k] * ratio_of(rows, sizes, tape, buffers, k)
        size /= scale
        for i in range(s - 1 - servo):
            a[servo + i, k] = buffers.slots[tape.root[border + i * s + k], 0] * scale
    reflect(a, s - 1, s - 1, s, pivots)
    for k in range(s - 1):
        size *= pivots[k]
        cross[k] = 0.0
    cross[s - 1] = size
    reflect_back(a, s - 1, s, cross)
    for k in range(s):
        space.shares[k] += cross[k]
