"""What a mechanism is and what acts on it, as arrays that are constant for a run, and what evaluations write."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vlmb.core import tree as of
from vlmb.core.opcodes import Buffers, Tape, make_buffers
from vlmb.core.quantities import Quantities
from vlmb.core.row_arrays import RowMemory, Rows, make_row_memory
from vlmb.core.scratch import Scratch, make_scratch
from vlmb.core.springs import AngleSprings
from vlmb.core.tape import prepare
from vlmb.core.tree import Array, Integers, Tree

# Columns of `force`: the quantity it acts along, the root of the tape that gives it (or -1 - its place among inputs), its work.
ALONG, ROOT, WORK = range(3)
IN_SPRING, IN_LOSS = -1, -2  # instead of a work state: it is the energy of a spring, or lost
# Columns of `driven`: the link's row, the column of `given` where the length stands, the root that gives it, its work.
ROW, COLUMN, DRIVE, DRIVE_WORK = range(4)
# Entries of `size`
# number of work states, which one holds what dampers lose (-1: none does), where the height of the centre of mass is among
# quantities if there is friction under the ski (-1: none)
# whether laws drive lengths, and a force or a control acts on a point, which such a length may carry along
WORKS, LOSS, CENTRE, REACHES = range(4)

# Columns of `watch`: what is watched and which one.
FORM, WHICH = range(2)
# a quantity against a bound; a switch of the tape; a spring's two directions; what the ideal rows are worth; none
# GROWTH: the rate of a quantity
# STANDS: the speed of a ski that slides; SLIPS: what friction could still hold; LIFTS: the normal force; YIELDS: 1 - mu |c|
# of a closed contact: its normal force, what friction could still hold, how fast it slides
# BITES: what the ideal row WHICH of a ski could still hold, SIDE times the force of row BOUND; MOVES: a velocity of the state
QUANTITY, SWITCH, LINE_UP, WORTH_OF_ROWS, NOTHING, GROWTH, STANDS, SLIPS, LIFTS, YIELDS, HOLDS, GRIPS, STOPS = range(13)
BITES, MOVES = 13, 14
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
    looked: Integers  # (any,) the quantities that they read, and those of the tape where it has switches
    bound: Array  # (e, 2)
    size: Integers  # (4,)
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
    sliding: Array  # (3, any) see sliding.py; empty without friction


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
        sliding=np.full((3, max(nv, 6) if len(plant.sliding) else 0), np.nan),
    )  # fmt: skip
    prepare(plant.tape, memory.buffers, plant.parameters)
    return memory
