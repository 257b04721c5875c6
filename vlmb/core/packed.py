"""Equations with all that they read, in two arrays: one of integers, one of reals.

Handing an array from Python to a kernel takes as long as ten operations of a tape. Constants and buffers stand together, so that
a copy of the reals is all that another thread needs. The integers begin with a table: where each part begins and ends.
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np

from vlmb.core.jit import kernel
from vlmb.core.opcodes import Buffers, Tape
from vlmb.core.quantities import Quantities
from vlmb.core.series import WIDTH
from vlmb.core.tree import Array, Integers, Tree

Values = TypeVar("Values", Array, Integers)

# Parts, integers first. FORM: of each root, as in rows.py; LEVELS: coordinates by which a quantity keeps its branch;
# ALONG: quantities that forces act along, SCALE: their scales; GIVEN: lengths that do not move; SERIES: reals, as their bits,
# which are long and are not copied with the buffers.
(
    CODE, LEAF, ROOT, ENDS, SWEEP, SWEEP_ENDS, USED, ENTERING, ENTERING_ENDS, SWITCH, KIND, TREE_SHAPE, LINK,
    JOINT_SHAPE, JOINT, FORM, LEVELS, ALONG, SIGNAL, SERIES,
) = range(20)  # fmt: skip
(
    CONSTANT, OFFSET, SHARE, BASE, REAL, GIVEN, PARAMETERS, SCALE,
    SLOTS, SLOPES, ADJOINT, MEASURED, REFERENCE, STATE, BEND, SPIN, MOMENT, ROW, CARRIED, RESIDUAL,
) = range(20, 40)  # fmt: skip
PARTS = 40


class Packed(NamedTuple):
    """Both arrays."""

    integers: Integers
    reals: Array


def pack(parts: dict[int, Integers | Array]) -> Packed:
    """Put parts, by number, into two arrays; parts that are not there are empty."""
    integers = [np.asarray(parts.get(k, ()), np.int64).ravel() for k in range(CONSTANT)]
    reals = [np.asarray(parts.get(k, ()), np.float64).ravel() for k in range(CONSTANT, PARTS)]
    table = np.zeros((PARTS, 2), np.int64)
    for first, at, group in ((0, 2 * PARTS, list(map(len, integers))), (CONSTANT, 0, list(map(len, reals)))):
        ends = at + np.cumsum([0, *group])
        table[first : first + len(group)] = np.column_stack([ends[:-1], ends[1:]])
    return Packed(np.concatenate([table.ravel(), *integers]), np.concatenate(reals))


def tape_parts(tape: Tape, buffers: Buffers, parameters: Array) -> dict[int, Integers | Array]:
    """Name the parts of a tape, its buffers and its parameters."""
    return {
        CODE: tape.code, LEAF: tape.leaf, ROOT: tape.root, ENDS: tape.parts, SWEEP: tape.sweep, SWEEP_ENDS: tape.sweep_ends,
        USED: tape.used, ENTERING: tape.entering, ENTERING_ENDS: tape.entering_ends, SWITCH: tape.switch,
        SIGNAL: tape.signal, SERIES: np.ascontiguousarray(tape.series).view(np.int64),
        CONSTANT: tape.constant, PARAMETERS: parameters, SLOTS: buffers.slots, SLOPES: buffers.slopes, ADJOINT: buffers.adjoint,
    }  # fmt: skip


@kernel(copied=True)
def part(values: Values, integers: Integers, k: int) -> Values:
    """Return part k of the integers or the reals."""
    return values[integers[2 * k] : integers[2 * k + 1]]


@kernel(copied=True)
def table(values: Values, integers: Integers, k: int, columns: int) -> Values:
    """Return part k as a table."""
    return part(values, integers, k).reshape(((integers[2 * k + 1] - integers[2 * k]) // columns, columns))


@kernel(copied=True)
def tape_of(i: Integers, reals: Array) -> Tape:
    """Return the tape."""
    return Tape(
        table(i, i, CODE, 4), part(reals, i, CONSTANT), table(i, i, LEAF, 2), part(i, i, ROOT), part(i, i, ENDS),
        part(i, i, SWEEP), table(i, i, SWEEP_ENDS, 3), part(i, i, USED), part(i, i, ENTERING), table(i, i, ENTERING_ENDS, 2),
        table(i, i, SWITCH, 4), table(i, i, SIGNAL, 3), table(i, i, SERIES, WIDTH).view(np.float64),
    )  # fmt: skip


@kernel(copied=True)
def buffers_of(i: Integers, reals: Array) -> Buffers:
    """Return what playing the tape writes."""
    return Buffers(table(reals, i, SLOTS, 3), table(reals, i, SLOPES, 2), part(reals, i, ADJOINT))


@kernel(copied=True)
def quantities_of(i: Integers, reals: Array) -> Quantities:
    """Return the table of quantities."""
    return Quantities(table(i, i, KIND, 4), part(reals, i, OFFSET), table(reals, i, SHARE, 4))


@kernel(copied=True)
def tree_of(i: Integers, reals: Array) -> Tree:
    """Return the mechanism."""
    return Tree(part(i, i, TREE_SHAPE), part(reals, i, BASE), table(i, i, LINK, 8), table(reals, i, REAL, 16))
