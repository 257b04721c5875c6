"""One evaluation of a mechanism with all that acts on it: forces, springs, rows, given lengths, friction, work states."""

from __future__ import annotations

from vlmb.core import opcodes as op
from vlmb.core import tree as of
from vlmb.core.constraints import add_forces, constrain, project
from vlmb.core.contacts import add_friction_powers
from vlmb.core.jit import kernel
from vlmb.core.links import accelerate, accelerate_here
from vlmb.core.plant import (
    ALONG,
    CENTRE,
    COLUMN,
    DRIVE,
    DRIVE_WORK,
    FROM_FORCE,
    FROM_LAW,
    FROM_LINKS,
    FROM_QUANTITY,
    FROM_ROWS,
    FROM_SPRING,
    IN_LOSS,
    IN_SPRING,
    LOSS,
    REACHES,
    ROOT,
    ROW,
    SOURCES,
    WORK,
    WORKS,
    Memory,
    Plant,
)
from vlmb.core.quantities import add_row, measure, measure_these
from vlmb.core.row_arrays import ALONG as OF_CONTROL
from vlmb.core.row_arrays import PROJECTED, PROJECTION, sizes_of, view
from vlmb.core.row_arrays import WORK as WORK_OF_ROW
from vlmb.core.row_forces import add_row_powers, push_on, rate_alone, write_apart, write_still
from vlmb.core.scalars import finite
from vlmb.core.scratch import AXIAL
from vlmb.core.sliding import (
    ANSWERS,
    CARVES,
    FOUND,
    FRICTION,
    MASS,
    MU,
    PUSH,
    SAVED,
    SLIDES,
    TRIED,
    choose,
    lift_of,
    weight_carried,
)
from vlmb.core.springs import add_springs
from vlmb.core.tape import play_jets, play_values, read_state, read_time
from vlmb.core.tree import Array, Tree


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
    slides, push = plant.size[CENTRE] >= 0, 0.0
    for answer in range(ANSWERS if slides else 1):
        if slides:
            lay_friction(memory, answer, push)
        code = accelerate_here(plant.tree, y, memory.given, memory.force, dy, memory.scratch)
        if code != 0:
            return FROM_LINKS * SOURCES + code
        if held:
            code = meet_rows(plant, memory, y, dy)
            if code != 0:
                return FROM_ROWS * SOURCES + code
        if slides:
            push = next_friction(plant, memory, answer, y, dy)
    if plant.size[REACHES] != 0:
        push_driven(plant, memory, y)
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
    if tape.parts[op.READ] > 0:
        used = tape.used[: tape.parts[op.READ]]
        code = measure_these(plant.quantities, used, plant.tree, y, memory.given, memory.reference, memory.measured)
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
        project(memory.rows, plant.tree, y, memory.scratch)
    return code


@kernel(copied=True)
def meet_rows(plant: Plant, memory: Memory, y: Array, dy: Array) -> int:
    """Add what rows and controls bring to the accelerations, and to the forces that driven lengths take; return a code."""
    code = constrain(
        plant.rows, memory.rows, plant.tape, memory.buffers, plant.quantities, plant.tree, y, memory.given, memory.reference,
        memory.scratch, memory.measured, dy,
    )  # fmt: skip
    if code == 0 and plant.driven.shape[0] > 0:
        push_on_driven(plant, memory, y, dy)
    return code


@kernel(copied=True)
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


@kernel(inline=True)
def lay_friction(memory: Memory, answer: int, push: float) -> None:
    """Write the generalized forces with a force along the ski; those of the first answer are kept."""
    for j in range(memory.force.shape[0]):
        if answer == 0:
            memory.sliding[SAVED, j] = memory.force[j]
        memory.force[j] = memory.sliding[SAVED, j]
    memory.force[0] += push


@kernel(copied=True)
def next_friction(plant: Plant, memory: Memory, answer: int, y: Array, dy: Array) -> float:
    """Return the force along the ski for the next answer: after none one that is tried, then the friction that follows from both.

    The last answer has it; there a ski that stands gets no acceleration.
    """
    found, tried, first = memory.sliding[FOUND], memory.sliding[TRIED], plant.tree.shape[of.POSITIONS]
    if answer == ANSWERS - 1:
        if found[SLIDES] == 0.0:
            dy[first] = 0.0
        return 0.0
    n, e, a = normal_force(plant, memory, y, dy), edge_force(plant, memory), dy[first]
    push = plant.sliding[PUSH]
    if answer == 0:
        tried[0], tried[1], tried[2] = n, e, a
        return push
    n0, e0, a0 = tried[0], tried[1], tried[2]
    choose(found, plant.sliding[MU], y[first], (n0, e0, a0), ((n - n0) / push, (e - e0) / push, (a - a0) / push))
    return found[FRICTION]


@kernel(copied=True)
def edge_force(plant: Plant, memory: Memory) -> float:
    """Return the force [N] of the knife edge as a multiplier, of the answer before, if friction goes by it too; else 0."""
    if plant.sliding[CARVES] == 0.0:
        return 0.0
    sizes = sizes_of(plant.rows)
    return view(sizes, memory.rows).shares[sizes.controls]


@kernel(copied=True)
def normal_force(plant: Plant, memory: Memory, y: Array, dy: Array) -> float:
    """Return the force [N] of the snow on the ski along the normal, of the answer before: what outer forces leave."""
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


@kernel(copied=True)
def push_driven(plant: Plant, memory: Memory, y: Array) -> None:
    """Take what forces and controls at points do to driven lengths off the forces that these take; `measured` is overwritten."""
    write_still(memory.rows, plant.tree, y)
    for k in range(plant.driven.shape[0]):
        total = 0.0
        for j in range(plant.force.shape[0]):
            if memory.values[j] != 0.0:
                total += memory.values[j] * carried(plant, memory, k, plant.force[j, ALONG])
        for j in range(controls_of(plant)):
            total += control(plant, memory, j) * carried(plant, memory, k, along_control(plant, j))
        memory.scratch.rows[plant.driven[k, ROW], AXIAL + plant.driven[k, COLUMN] // 3] -= total


@kernel(copied=True)
def carried(plant: Plant, memory: Memory, k: int, along: int) -> float:
    """Return the rate of a quantity where driven length k alone grows by 1 m/s; after `write_still`."""
    return rate_alone(
        plant.quantities, along, plant.driven, k, plant.tree, memory.rows, memory.given, memory.reference, memory.measured
    )


@kernel(copied=True)
def controls_of(plant: Plant) -> int:
    """Return the number of controls of a programme."""
    return sizes_of(plant.rows).controls if plant.rows.table.shape[0] > 0 else 0


@kernel(copied=True)
def along_control(plant: Plant, j: int) -> int:
    """Return the quantity that a control acts along."""
    sizes = sizes_of(plant.rows)
    return plant.rows.table[1 + sizes.ideal - sizes.held + sizes.beyond + j, OF_CONTROL]


@kernel(copied=True)
def work_of_control(plant: Plant, j: int) -> int:
    """Return the work state of a control."""
    sizes = sizes_of(plant.rows)
    return plant.rows.table[1 + sizes.ideal - sizes.held + sizes.beyond + j, WORK_OF_ROW]


@kernel(copied=True)
def control(plant: Plant, memory: Memory, j: int) -> float:
    """Return a control of the last solution [N, N m]."""
    return view(sizes_of(plant.rows), memory.rows).shares[j] * plant.rows.gains[plant.rows.gains.shape[0] - 1, j]


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
        if sizes.sliding > 0:
            add_friction_powers(plant.rows, sizes, space, memory.rows, work, dy)
    for j in range(controls_of(plant) if plant.size[REACHES] != 0 else 0):
        state = work_of_control(plant, j)
        for k in range(plant.driven.shape[0]):
            rate = memory.given[plant.driven[k, ROW], plant.driven[k, COLUMN] + 1]
            dy[work + state] += control(plant, memory, j) * carried(plant, memory, k, along_control(plant, j)) * rate
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
