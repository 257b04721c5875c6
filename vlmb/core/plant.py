"""One evaluation of a mechanism with all that acts on it: forces by law and by input, springs, given lengths, work states."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vlmb.core import opcodes as op
from vlmb.core import tree as of
from vlmb.core.constraints import add_forces, constrain, project
from vlmb.core.jit import kernel
from vlmb.core.links import accelerate
from vlmb.core.opcodes import Buffers, Tape, make_buffers
from vlmb.core.quantities import Quantities, add_row, measure, measure_these
from vlmb.core.row_arrays import ALONG as OF_CONTROL
from vlmb.core.row_arrays import PROJECTED, PROJECTION, RowMemory, Rows, make_row_memory, sizes_of, view
from vlmb.core.row_forces import add_row_powers, push_on, write_apart
from vlmb.core.scalars import finite
from vlmb.core.scratch import AXIAL, Scratch, make_scratch
from vlmb.core.sliding import CARVES, FOUND, FRICTION, MASS, MU, PUSH, SAVED, SLIDES, choose, lift_of, weight_carried
from vlmb.core.springs import AngleSprings, add_springs
from vlmb.core.tape import play_jets, play_values, prepare, read_state, read_time
from vlmb.core.tree import Array, Integers, Tree

# Columns of `force`: the quantity it acts along, the root of the tape that gives it (or -1 - its place among inputs), its work.
ALONG, ROOT, WORK = range(3)
IN_SPRING, IN_LOSS = -1, -2  # instead of a work state: it is the energy of a spring, or lost
# Columns of `driven`: the link's row, the column of `given` where the length stands, the root that gives it, its work.
ROW, COLUMN, DRIVE, DRIVE_WORK = range(4)
# Entries of `size`
# number of work states, which one holds what dampers lose (-1: none does), where the height of the centre of mass is among
# quantities if there is friction under the ski (-1: none)
WORKS, LOSS, CENTRE = range(3)

# Columns of `watch`: what is watched and which one.
FORM, WHICH = range(2)
# a quantity against a bound; a switch of the tape; a spring's two directions; what the ideal rows are worth; none
# GROWTH: the rate of a quantity
# STANDS: the speed of a ski that slides; SLIPS: what friction could still hold; LIFTS: the normal force; YIELDS: 1 - mu |c|
QUANTITY, SWITCH, LINE_UP, WORTH_OF_ROWS, NOTHING, GROWTH, STANDS, SLIPS, LIFTS, YIELDS = range(10)
SIDE, BOUND = range(2)  # columns of `bound`: the indicator is side * (quantity - bound); of a line-up the way that is watched

# What may be wrong: a code is source * SOURCES + what the source says.
SOURCES = 1 << 40
FROM_LINKS, FROM_QUANTITY, FROM_LAW, FROM_SPRING, FROM_FORCE, FROM_ROWS, FROM_SIDE = range(1, 8)


class Plant(NamedTuple):
    """What a mechanism is and what acts on it: constant for a run."""

    tree: Tree
    quantities: Quantities
    tape: Tape
    parameters: Array  # (P,)
    force: Integers  # (k, 3)
    driven: Integers  # (m, 4)
    springs: AngleSprings
    watch: Integers  # (e, 2) indicators of events
    bound: Array  # (e, 2)
    size: Integers  # (3,)
    rows: Rows
    sliding: Array  # (4,) see sliding.py; empty without friction


class Memory(NamedTuple):
    """What evaluations write: one for each thread."""

    scratch: Scratch
    buffers: Buffers
    measured: Array  # (quantities, 3)
    reference: Array  # (quantities, 2) coordinates by which angles keep their branch [rad]
    near: Array  # (springs,) signed angles by which springs in a plane keep their turn [rad]
    force: Array  # (velocities,) all generalized forces
    values: Array  # (k,) of the forces [N, N m]
    given: Array  # (n, 6) lengths that are not free, with two derivatives
    inputs: Array  # (inputs,) forces from outside [N, N m]
    lost: Array  # (1,) power lost in dampers between directions [W]
    row: Array  # (velocities,)
    switches: Array  # (switches, 2)
    lines: Array  # (springs, 3)
    branches: Array  # (N, quantities, 2) `reference` at samples; N = 0: not kept
    kept: Integers  # (1,) how many of them are
    rows: RowMemory
    sliding: Array  # (2, any) see sliding.py; empty without friction


def make_memory(plant: Plant, given: Array, inputs: int = 0) -> Memory:
    """Make the buffers of a plant; given (n, 6) are the lengths that no law drives."""
    count, nv = len(plant.quantities.kind), int(plant.tree.shape[of.VELOCITIES])
    size = int(plant.tree.shape[of.POSITIONS]) + nv + int(plant.size[WORKS])
    memory = Memory(
        scratch=make_scratch(plant.tree), buffers=make_buffers(plant.tape), measured=np.zeros((count, 3)),
        reference=np.zeros((count, 2)), near=np.zeros(len(plant.springs.pair)), force=np.zeros(nv),
        values=np.zeros(len(plant.force)), given=np.array(given),
        inputs=np.zeros(inputs), lost=np.zeros(1), row=np.zeros(nv),
        switches=np.zeros((len(plant.tape.switch), 2)), lines=np.zeros((len(plant.springs.pair), 3)),
        branches=np.zeros((0, count, 2)), kept=np.zeros(1, np.int64),
        rows=make_row_memory(plant.rows, nv, size, len(given), len(plant.driven)),
        sliding=np.full((2, max(nv, 6) if len(plant.sliding) else 0), np.nan),
    )  # fmt: skip
    prepare(plant.tape, memory.buffers, plant.parameters)
    return memory


@kernel(copied=True)
def evaluate(plant: Plant, memory: Memory, t: float, y: Array, dy: Array) -> int:
    """Write y' at (t, y) for y = (positions, velocities, work); return 0, or source * SOURCES + what it says.

    A part of the kernel that calls it: every array costs a nanosecond or two to hand over, and a plant has fifty.
    """
    held = plant.rows.table.shape[0] > 0
    if held and plant.rows.table[0, PROJECTED] != 0:
        code = onto_edge(plant, memory, t, y, dy)
        if code != 0:
            return FROM_LINKS * SOURCES + code
        y = memory.rows.state[PROJECTION]
    code = act(plant, memory, t, y)
    if code != 0:
        return code
    if plant.size[CENTRE] >= 0:
        code = slide(plant, memory, y, dy)
        if code != 0:
            return code
    else:
        code = accelerate(plant.tree, y, memory.given, memory.force, dy, memory.scratch)
        if code != 0:
            return FROM_LINKS * SOURCES + code
        if held:
            code = meet_rows(plant, memory, y, dy)
            if code != 0:
                return FROM_ROWS * SOURCES + code
    if plant.size[WORKS] > 0:
        return count_work(plant, memory, y, dy)
    return 0


@kernel(inline=True)
def act(plant: Plant, memory: Memory, t: float, y: Array) -> int:
    """Write given lengths and all generalized forces but those of springs along segments; return a code as `evaluate`."""
    force = memory.force
    for j in range(force.shape[0]):
        force[j] = 0.0
    if plant.tape.root.shape[0] > 0:
        code = play_laws(plant, memory, t, y)
        if code != 0:
            return code
    for k in range(plant.force.shape[0]):
        root = plant.force[k, ROOT]
        value = memory.buffers.slots[plant.tape.root[root], 0] if root >= 0 else memory.inputs[-1 - root]
        if not finite(value):
            return FROM_LAW * SOURCES + k
        memory.values[k] = value
        along = plant.force[k, ALONG]
        code = add_row(plant.quantities, along, plant.tree, y, memory.given, memory.reference, value, force)
        if code != 0:
            return FROM_FORCE * SOURCES + k
    if plant.springs.pair.shape[0] > 0:
        code, memory.lost[0] = add_springs(plant.springs, plant.tree, y, memory.near, force)
        if code != 0:
            return FROM_SPRING * SOURCES + code - 1
    return 0


@kernel(inline=True)
def play_laws(plant: Plant, memory: Memory, t: float, y: Array) -> int:
    """Play the laws: first those of time, which give the driven lengths, then those that see the state."""
    tape, buffers = plant.tape, memory.buffers
    drive(plant, memory, t)
    if tape.used.shape[0] > 0:
        code = measure_these(plant.quantities, tape.used, plant.tree, y, memory.given, memory.reference, memory.measured)
        if code != 0:
            return FROM_QUANTITY * SOURCES + code
        read_state(tape, memory.measured, buffers.slots)
    if plant.rows.table.shape[0] > 0:
        play_jets(tape, buffers, tape.parts[op.TIME_END], tape.parts[op.ROOTS_END])
    else:
        play_values(tape, buffers, tape.parts[op.TIME_END], tape.parts[op.ROOTS_END])
    return 0


@kernel(inline=True)
def drive(plant: Plant, memory: Memory, t: float) -> None:
    """Play the laws of time with two derivatives; write the driven lengths, their rates and accelerations."""
    tape, buffers = plant.tape, memory.buffers
    if tape.parts[op.TIMED] == 0 and plant.driven.shape[0] == 0:
        return
    read_time(tape, t, buffers.slots)
    play_jets(tape, buffers, tape.parts[op.PARAMETERS_END], tape.parts[op.TIME_END])
    for k in range(plant.driven.shape[0]):
        slot = tape.root[plant.driven[k, DRIVE]]
        for order in range(3):
            memory.given[plant.driven[k, ROW], plant.driven[k, COLUMN] + order] = buffers.slots[slot, order]


@kernel
def onto_edge(plant: Plant, memory: Memory, t: float, y: Array, dy: Array) -> int:
    """Write the state with the velocities on the knife edge that are nearest in kinetic energy; `dy` is overwritten."""
    drive(plant, memory, t)
    for j in range(memory.force.shape[0]):
        memory.force[j] = 0.0
    code = accelerate(plant.tree, y, memory.given, memory.force, dy, memory.scratch)
    if code == 0:
        project(plant.rows, memory.rows, plant.tree, y, memory.scratch)
    return code


@kernel(copied=True)
def meet_rows(plant: Plant, memory: Memory, y: Array, dy: Array) -> int:
    """Add what rows and controls bring to the accelerations, and to the forces that driven lengths take; return a code."""
    code = constrain(
        plant.rows, memory.rows, plant.tape, memory.buffers, plant.quantities, plant.tree, y, memory.given, memory.reference,
        memory.scratch, dy,
    )  # fmt: skip
    if code == 0 and plant.driven.shape[0] > 0:
        push_on_driven(plant, memory, y, dy)
    return code


@kernel
def push_on_driven(plant: Plant, memory: Memory, y: Array, dy: Array) -> None:
    """Add what rows and controls bring to the forces that driven lengths take."""
    rows, tape, tree, given, scratch = plant.rows, plant.tape, plant.tree, memory.given, memory.scratch
    near = memory.reference
    add_forces(rows, memory.rows, memory.force)
    accelerate(tree, y, given, memory.force, dy, scratch)
    sizes = sizes_of(rows)
    space = view(sizes, memory.rows)
    write_apart(
        rows, sizes, space, memory.rows, plant.driven, tape, memory.buffers, plant.quantities, tree, y, given, near,
        memory.measured,
    )  # fmt: skip
    for k in range(plant.driven.shape[0]):
        scratch.rows[plant.driven[k, ROW], AXIAL + plant.driven[k, COLUMN] // 3] -= push_on(sizes, space, k)


@kernel
def slide(plant: Plant, memory: Memory, y: Array, dy: Array) -> int:
    """Write the accelerations under all forces and the friction under the ski; return a code as `evaluate`.

    Three answers: without friction, with a force along the ski, with the friction that follows from both.
    """
    found, push, first = memory.sliding[FOUND], plant.sliding[PUSH], plant.tree.shape[of.POSITIONS]
    for j in range(memory.force.shape[0]):
        memory.sliding[SAVED, j] = memory.force[j]
    code = answer_to(plant, memory, 0.0, y, dy)
    if code != 0:
        return code
    n0, e0, a0 = normal_force(plant, memory, y, dy), edge_force(plant, memory), dy[first]
    code = answer_to(plant, memory, push, y, dy)
    if code != 0:
        return code
    n1, e1, a1 = normal_force(plant, memory, y, dy), edge_force(plant, memory), dy[first]
    choose(found, plant.sliding[MU], y[first], (n0, e0, a0), ((n1 - n0) / push, (e1 - e0) / push, (a1 - a0) / push))
    code = answer_to(plant, memory, found[FRICTION], y, dy)
    if found[SLIDES] == 0.0:
        dy[first] = 0.0
    return code


@kernel
def answer_to(plant: Plant, memory: Memory, friction: float, y: Array, dy: Array) -> int:
    """Write the accelerations with a force along the ski; return a code as `evaluate`."""
    for j in range(memory.force.shape[0]):
        memory.force[j] = memory.sliding[SAVED, j]
    memory.force[0] += friction
    code = accelerate(plant.tree, y, memory.given, memory.force, dy, memory.scratch)
    if code != 0:
        return FROM_LINKS * SOURCES + code
    if plant.rows.table.shape[0] > 0:
        code = meet_rows(plant, memory, y, dy)
        if code != 0:
            return FROM_ROWS * SOURCES + code
    return 0


@kernel
def edge_force(plant: Plant, memory: Memory) -> float:
    """Return the force [N] of the knife edge as a multiplier, where `answer_to` was last, if friction goes by it too; else 0."""
    if plant.sliding[CARVES] == 0.0:
        return 0.0
    sizes = sizes_of(plant.rows)
    return view(sizes, memory.rows).shares[sizes.controls]


@kernel
def normal_force(plant: Plant, memory: Memory, y: Array, dy: Array) -> float:
    """Return the force [N] of the snow on the ski along the normal, where `answer_to` was last: what outer forces leave."""
    tree, quantities, first = plant.tree, plant.quantities, plant.tree.shape[of.POSITIONS]
    change = dy[first : first + tree.shape[of.VELOCITIES]]
    total = weight_carried(
        quantities, plant.size[CENTRE], plant.sliding[MASS], tree, y, memory.given, memory.reference, change, memory.row,
        memory.measured,
    )  # fmt: skip
    for k in range(plant.force.shape[0]):
        if memory.values[k] != 0.0:
            total -= memory.values[k] * lift_of(quantities, plant.force[k, ALONG], tree, y, memory.given)
    if plant.rows.table.shape[0] > 0:
        sizes, last = sizes_of(plant.rows), plant.rows.gains.shape[0] - 1
        space, after = view(sizes, memory.rows), 1 + sizes.ideal - sizes.held + sizes.beyond
        for k in range(sizes.controls):
            lift = lift_of(quantities, plant.rows.table[after + k, OF_CONTROL], tree, y, memory.given)
            total -= space.shares[k] * plant.rows.gains[last, k] * lift
    return total


@kernel(inline=True)
def count_work(plant: Plant, memory: Memory, y: Array, dy: Array) -> int:
    """Write the rates of the work states: power of each force and of each driven length, and what dampers lose [W]."""
    work = plant.tree.shape[of.POSITIONS] + plant.tree.shape[of.VELOCITIES]
    for j in range(plant.size[WORKS]):
        dy[work + j] = 0.0
    lost = 0.0
    if plant.size[CENTRE] >= 0:
        lost -= memory.sliding[FOUND, FRICTION] * y[plant.tree.shape[of.POSITIONS]]
    for k in range(plant.force.shape[0]):
        if memory.values[k] != 0.0 and plant.force[k, WORK] != IN_SPRING:
            along = plant.force[k, ALONG]
            code = measure(plant.quantities, along, plant.tree, y, memory.given, memory.reference, memory.measured)
            if code != 0:
                return FROM_FORCE * SOURCES + k
            power = memory.values[k] * memory.measured[along, 1]
            if plant.force[k, WORK] == IN_LOSS:
                lost -= power
            else:
                dy[work + plant.force[k, WORK]] += power
    for k in range(plant.driven.shape[0]):
        row, column = plant.driven[k, ROW], plant.driven[k, COLUMN]
        dy[work + plant.driven[k, DRIVE_WORK]] += memory.scratch.rows[row, AXIAL + column // 3] * memory.given[row, column + 1]
    if plant.rows.table.shape[0] > 0:
        sizes = sizes_of(plant.rows)
        space = view(sizes, memory.rows)
        add_row_powers(plant.rows, sizes, space, plant.driven, plant.tree, y, memory.given, work, dy)
    if plant.size[LOSS] >= 0:
        dy[work + plant.size[LOSS]] = segment_losses(plant.tree, y) + memory.lost[0] + lost
    return 0


@kernel(inline=True)
def segment_losses(tree: Tree, y: Array) -> float:
    """Return the power lost in the dampers of free segments, the sum of c a'^2 [W]."""
    lost = 0.0
    for i in range(tree.shape[of.LINKS]):
        at = tree.shape[of.POSITIONS] + tree.link[i, of.AT_V] + 3
        if tree.link[i, of.LOWER_FREE] != 0:
            lost += tree.real[i, of.C1] * y[at] * y[at]
            at += 1
        if tree.link[i, of.UPPER_FREE] != 0:
            lost += tree.real[i, of.C2] * y[at] * y[at]
    return lost
