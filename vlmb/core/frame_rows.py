"""Equations, laws and forces on a tree of bodies: rows that hold frames, rows of a tape, forces over the velocities."""

from __future__ import annotations

from vlmb.core import opcodes as op
from vlmb.core import packed
from vlmb.core.bodies import Bodies, move, position_rates
from vlmb.core.jit import kernel
from vlmb.core.packed import buffers_of, part, table, tape_of
from vlmb.core.readings import Readings, add_row, edge, measure, weld
from vlmb.core.rows import write_residual
from vlmb.core.scalars import finite
from vlmb.core.tape import gradient, play_jets, read_leaves
from vlmb.core.tree import Array, Integers


@kernel
def rows_of_frames(
    i: Integers, reals: Array, joint: Integers, real: Array, state: Array, jacobian: Array, frame: Integers, place: Array,
    kind: Integers, offset: Array, reference: Array, mass: Array, welds: Integers, edges: Integers, along: Integers,
    joints: int, sideways: int, t: float, q: Array, v: Array, q_rate: Array, out: Array, matrix: Array, values: Array,
) -> bool:  # fmt: skip
    """Write q'; z, z' and drift into `out` (3, rows); rows, then forces over v into `matrix`; the values of laws into `values`.

    Rows are those of welds (six each), of edges, v[sideways] = 0 of a ski (-1: there is none), of the tape; roots of the tape
    after those are laws. False: something is not finite.
    """
    bodies = Bodies(joint, real, state, jacobian)
    readings = Readings(frame, place, kind, offset, reference, mass)
    move(bodies, q, v)
    position_rates(bodies, joints, q, v, q_rate)
    for r in range(matrix.shape[0]):
        for k in range(matrix.shape[1]):
            matrix[r, k] = 0.0
    r = 0
    for k in range(welds.shape[0]):
        weld(bodies, readings, welds[k, 0], welds[k, 1], r, out, matrix)
        r += 6
    for k in range(edges.shape[0]):
        edge(bodies, readings, edges[k, 0], edges[k, 1], r, out, matrix)
        r += 1
    if sideways >= 0:
        out[0, r], out[1, r], out[2, r], matrix[r, sideways] = 0.0, v[sideways], 0.0, 1.0
        r += 1
    tape, buffers, form = tape_of(i, reals), buffers_of(i, reals), part(i, i, packed.FORM)
    measured, residual = table(reals, i, packed.MEASURED, 3), table(reals, i, packed.RESIDUAL, 3)
    for k in part(i, i, packed.USED):
        measured[k, 0], measured[k, 1], measured[k, 2] = measure(bodies, readings, k, q, v)
    read_leaves(tape, t, part(reals, i, packed.PARAMETERS), measured, buffers.slots)
    play_jets(tape, buffers, tape.parts[op.PARAMETERS_END], tape.parts[op.ROOTS_END])
    fine = True
    for root in range(form.shape[0]):
        write_residual(tape, buffers, root, form[root], root, residual)
        out[0, r], out[1, r], out[2, r] = residual[root, 0], residual[root, 1], residual[root, 2]
        gradient(tape, buffers, root, False)
        for j in range(tape.entering_ends[root, 0], tape.entering_ends[root, 1]):
            leaf = tape.entering[j]
            add_row(bodies, readings, tape.leaf[leaf, 1], buffers.adjoint[leaf], matrix[r])
        r += 1
    for k in range(r):
        fine = fine and finite(out[0, k] + out[1, k] + out[2, k])
    for s in range(along.shape[0]):
        add_row(bodies, readings, along[s], 1.0, matrix[r + s])
    for s in range(tape.root.shape[0] - form.shape[0]):
        values[s] = buffers.slots[tape.root[form.shape[0] + s], 0]
        fine = fine and finite(values[s])
    return fine


@kernel
def read_all(
    joint: Integers, real: Array, state: Array, jacobian: Array, frame: Integers, place: Array, kind: Integers, offset: Array,
    reference: Array, mass: Array, chosen: Integers, q: Array, v: Array, out: Array,
) -> None:  # fmt: skip
    """Write value, rate and drift of the chosen quantities into `out` (chosen, 3)."""
    bodies = Bodies(joint, real, state, jacobian)
    readings = Readings(frame, place, kind, offset, reference, mass)
    move(bodies, q, v)
    for k in range(chosen.shape[0]):
        out[k, 0], out[k, 1], out[k, 2] = measure(bodies, readings, chosen[k], q, v)


@kernel
def rows_of_quantities(
    joint: Integers, real: Array, state: Array, jacobian: Array, frame: Integers, place: Array, kind: Integers, offset: Array,
    reference: Array, mass: Array, chosen: Integers, q: Array, v: Array, out: Array,
) -> None:  # fmt: skip
    """Write the rows of the chosen quantities over the velocities into `out` (chosen, nv)."""
    bodies = Bodies(joint, real, state, jacobian)
    readings = Readings(frame, place, kind, offset, reference, mass)
    move(bodies, q, v)
    for k in range(chosen.shape[0]):
        for j in range(out.shape[1]):
            out[k, j] = 0.0
        add_row(bodies, readings, chosen[k], 1.0, out[k])
