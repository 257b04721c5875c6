"""The compiled run: a method's requests answered by the compiled evaluation, and what is looked at after every step."""

from __future__ import annotations

import math

from vlmb.core import tree as of
from vlmb.core.contacts import COUNT, MU_AT_REST, held_by, held_by_ground, keep_ways, sliding_speed, three
from vlmb.core.driver import (
    ACCEPT,
    AT_START,
    EVALUATE,
    FAILED,
    FAILURE,
    FIRST_FAILURE,
    GO,
    H_MAX,
    INDICATE,
    LOOK,
    NEXT_SAMPLE,
    PHASE,
    RATE,
    TIME,
    VALUE,
    Driver,
)  # fmt: skip
from vlmb.core.evaluation import drive, evaluate
from vlmb.core.jit import inner, kernel
from vlmb.core.march import march_here
from vlmb.core.places import link_direction
from vlmb.core.plant import (
    BITES,
    BOUND,
    CENTRE,
    FORM,
    FROM_SIDE,
    GRIPS,
    GROWTH,
    HOLDS,
    LIFTS,
    LINE_UP,
    MOVES,
    NOTHING,
    QUANTITY,
    SIDE,
    SLIPS,
    SOURCES,
    STANDS,
    STOPS,
    SWITCH,
    WHICH,
    WORTH_OF_ROWS,
    YIELDS,
    Memory,
    Plant,
)  # fmt: skip
from vlmb.core.quantities import AZIMUTH, ELEVATION, KIND, LINK, add_accelerations, follow, measure_these
from vlmb.core.row_arrays import SIDE as DET_SIDE
from vlmb.core.row_arrays import (
    SIDE_BEFORE,
    UNBOUNDED,
    WORTH,
    WORTH_BEFORE,
    WORTH_BOUND,
    WORTH_RATE,
    WORTH_TIME,
    RowMemory,
    Rows,
    sizes_of,
    view,
)
from vlmb.core.rows import evaluate_switches
from vlmb.core.scalars import NAN
from vlmb.core.scratch import GROUND
from vlmb.core.sliding import ANSWER, FOUND, FRICTION, MU, NORMAL, PRESS, ROUNDED, SLIDES
from vlmb.core.springs import follow_springs, line_ups
from vlmb.core.tree import Array
from vlmb.core.triples import Vector

TURN = 0.5  # [rad] an azimuth turns no further within a step
ON_POLE = 1e-5  # [rad] nearer to the pole a link passes through it
NEAR_POLE = 3e-3  # [rad] so near its way to the pole is straight to within ON_POLE
LOOKED_AT = 0.1  # of the most that a row has been worth: the least that is not looked at more closely
BEGIN, END, LONGEST = range(3)  # columns of `bounds`


@kernel
def run(plant: Plant, memory: Memory, driver: Driver, bounds: Array, h_max: float, wanted: int) -> int:
    """Go on to the next thing that only the caller can answer, or answer one request and return.

    Parameters
    ----------
    bounds : (count, 3) from begin to end [s], in order, no step is longer than the third
    h_max : [s] holds everywhere
    wanted : GO to march; then see the codes of `driver`. EVALUATE, INDICATE as the march asks for them, LOOK for the indicators
        at (TIME, `point`) alone, ACCEPT for the branches of angles there: one answer, and its code is returned, or FAILED

    All that is compiled for runs is this kernel: so it serves Python's single questions as well.
    """
    answers, real = driver.counts, driver.real
    code = ACCEPT if wanted == GO and answers[PHASE] == AT_START else wanted
    while True:
        if code == EVALUATE:
            answers[FAILURE] = evaluate(plant, memory, real[TIME], driver.point, driver.slope)
        elif code in (INDICATE, LOOK, ACCEPT):
            if code != LOOK and accept(plant, memory, driver.point) != 0:
                answers[FIRST_FAILURE] = FROM_SIDE * SOURCES
                return FAILED
            if code == INDICATE:
                real[H_MAX] = longest_step(plant, bounds, h_max, real[TIME], driver.point)
                if plant.rows.table.shape[0] > 0:
                    real[H_MAX] = min(real[H_MAX], note_worth(plant.rows, memory.rows, real[TIME]))
            if code != ACCEPT:
                indicate(plant, memory, real[TIME], driver.point, driver.slope, driver.indicators)
            if code == INDICATE and plant.rows.contacts.shape[0] > 0:
                keep_ways(plant.rows, memory.rows)
        elif code != GO:
            return code
        if wanted != GO:
            return code
        code = march_here(driver)
        if memory.branches.shape[0] > 0:
            keep_branches(memory, answers[NEXT_SAMPLE])


@kernel(inline=True)
def keep_branches(memory: Memory, taken: int) -> None:
    """Keep the branches of angles at the samples taken since."""
    for k in range(memory.kept[0], taken):
        for j in range(memory.reference.shape[0]):
            memory.branches[k, j, 0], memory.branches[k, j, 1] = memory.reference[j, 0], memory.reference[j, 1]
    memory.kept[0] = max(memory.kept[0], taken)


@kernel(inline=True)
def accept(plant: Plant, memory: Memory, y: Array) -> int:
    """Move the branches of angles to a state of the motion: by them angles are read until the next one.

    Return 1 where det G of a programme with as many controls as rows has changed its sign since the last one, else 0. G is
    that of the last evaluation, at this state or a guess of it.
    """
    follow(plant.quantities, plant.tree, y, memory.reference)
    follow_springs(plant.springs, plant.tree, y, memory.near)
    return note_side(plant.rows, memory.rows) if plant.rows.table.shape[0] > 0 else 0


@kernel(copied=True)
def note_side(rows: Rows, memory: RowMemory) -> int:
    """Note the sign of det G at an accepted step; return 1 where it has changed since the last one, else 0."""
    state = view(sizes_of(rows), memory).state
    turned = 1 if state[DET_SIDE] * state[SIDE_BEFORE] < 0.0 else 0
    state[SIDE_BEFORE] = state[DET_SIDE]
    return turned


@kernel(copied=True)
def longest_step(plant: Plant, bounds: Array, h_max: float, t: float, y: Array) -> float:
    """Return the longest step [s] from (t, y): by the bounds in time, and so that no azimuth swings past its branch."""
    longest, k = h_max, first_after(bounds, t)
    while k < bounds.shape[0] and bounds[k, BEGIN] - t < longest:
        longest = min(longest, max(bounds[k, BEGIN] - t, 0.0) + bounds[k, LONGEST])
        k += 1
    for k in range(plant.quantities.kind.shape[0]):
        if plant.quantities.kind[k, KIND] == AZIMUTH or plant.quantities.kind[k, KIND] == ELEVATION:
            d, u, _ = link_direction(plant.tree, y, plant.quantities.kind[k, LINK])
            speed = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
            off_pole = max(math.hypot(d[0], d[1]), ON_POLE)
            if speed * longest > TURN * off_pole and not meets_pole(d, u):
                longest = TURN * off_pole / speed
    return longest


@kernel(copied=True)
def note_worth(rows: Rows, memory: RowMemory, t: float) -> float:
    """Note what the ideal rows are worth at an accepted step; return half the time [s] in which one would be worth nothing."""
    sizes = sizes_of(rows)
    space = view(sizes, memory)
    state = space.state
    for i in range(sizes.ideal):
        if i < sizes.held or rows.table[1 + i - sizes.held, UNBOUNDED] == 0:
            space.largest[i] = max(space.largest[i], space.square[i, i])
    since = t - state[WORTH_TIME]
    rate, bound, room = follow_worth(state[WORTH], state[WORTH_BEFORE], since, state[WORTH_BOUND])
    state[WORTH_RATE], state[WORTH_BOUND], state[WORTH_BEFORE], state[WORTH_TIME] = rate, bound, state[WORTH], t
    return room


@kernel(inline=True)
def follow_worth(worth: float, before: float, since: float, bound: float) -> tuple[float, float, float]:
    """Find the rate [1/s] of what rows are worth, the bound from now on, and half the time [s] in which one is worth nothing.

    `before`, `since` [s] ago; 0: not known. The bound grows again with what grows.
    """
    rate = (worth - before) / since if since > 0.0 and before > 0.0 else 0.0
    if rate > 0.0:
        bound = max(bound, min(LOOKED_AT, 0.5 * worth))
    return rate, bound, -0.5 * worth / rate if rate < 0.0 else math.inf


@kernel(copied=True)
def worth_of(rows: Rows, memory: RowMemory) -> tuple[float, float]:
    """Return what the ideal rows are worth beyond the least that is not looked at more closely, and its rate [1/s]."""
    state = view(sizes_of(rows), memory).state
    return state[WORTH] - state[WORTH_BOUND], state[WORTH_RATE]


@kernel(inline=True)
def meets_pole(d: Vector, u: Vector) -> bool:
    """Tell whether a direction near a pole is on its way through it.

    Its azimuth stays, and short steps there would only take up what is lost of it: an error of the direction over its distance.
    """
    off_pole, flat_speed = math.hypot(d[0], d[1]), math.hypot(u[0], u[1])
    inwards = d[0] * u[0] + d[1] * u[1] < 0.0
    return inwards and off_pole < NEAR_POLE and abs(d[0] * u[1] - d[1] * u[0]) < 2.0 * ON_POLE * flat_speed


@inner
def first_after(bounds: Array, t: float) -> int:
    """Return the first row of bounds that ends after t; they stand in order."""
    low, high = 0, bounds.shape[0]
    while low < high:
        middle = (low + high) // 2
        if bounds[middle, END] > t:
            high = middle
        else:
            low = middle + 1
    return low


@inner
def passing(line: Array, way: float) -> float:
    """Return the indicator of a line-up: the rate of the cosine; where only one of 0 and pi is watched, on the other's side none.

    `line`: sine, rate of the cosine, cosine. Two links that stay in line have a rate of nothing but rounding.
    """
    return -way if way * line[2] > 0.0 else line[1]


@kernel(copied=True)
def look_at_ski(plant: Plant, memory: Memory, form: int, y: Array, dy: Array, k: int, out: Array) -> None:
    """Write an indicator of friction under the ski, as the last evaluation has it; one that means nothing now is 1."""
    out[VALUE, k], out[RATE, k] = 1.0, NAN
    if plant.size[CENTRE] < 0:
        return
    found, mu, first = memory.sliding[FOUND], plant.sliding[MU], plant.tree.shape[of.POSITIONS]
    if form == STANDS and found[SLIDES] != 0.0:
        out[VALUE, k], out[RATE, k] = y[first], dy[first]
    elif form == SLIPS and found[SLIDES] == 0.0:
        out[VALUE, k] = ROUNDED * mu * found[PRESS] - abs(found[FRICTION])
    elif form == LIFTS:
        out[VALUE, k] = found[NORMAL]
    elif form == YIELDS:
        out[VALUE, k] = 1.0 - mu * abs(found[ANSWER])


@kernel(copied=True)
def look_at_contact(plant: Plant, memory: Memory, form: int, c: int, y: Array) -> float:
    """Return an indicator of a closed contact, as the last evaluation has it; the tape has been played for jets there."""
    if form == STOPS:
        return sliding_speed(
            plant.rows, memory.rows, c, plant.quantities, plant.tree, y, memory.given, memory.reference, memory.measured
        )
    if plant.rows.contacts[c, COUNT] == 0:
        ground = three(memory.scratch.rows[plant.tree.shape[of.LINKS]], GROUND)
        push, friction = held_by_ground(plant.rows, memory.rows, c, ground)
    else:
        sizes = sizes_of(plant.rows)
        push, friction = held_by(plant.rows, sizes, view(sizes, memory.rows), plant.tape, memory.buffers, c)
    return push if form == HOLDS else memory.rows.contacts[c, MU_AT_REST] * push - friction


@kernel(copied=True)
def indicate(plant: Plant, memory: Memory, t: float, y: Array, dy: Array, out: Array) -> None:
    """Write the indicators of events into the rows VALUE and RATE of `out` (any, e) at (t, y) with y' = dy.

    One that has no value there is nan and counts as not crossed; a rate that is not known is nan.
    """
    tree, quantities = plant.tree, plant.quantities
    drive(plant, memory, t)
    if plant.looked.shape[0] > 0:
        measure_these(quantities, plant.looked, tree, y, memory.given, memory.reference, memory.measured)
    if plant.tape.switch.shape[0] > 0:
        first, nv = tree.shape[of.POSITIONS], tree.shape[of.VELOCITIES]
        add_accelerations(
            quantities, plant.tape.used, tree, y, memory.given, memory.reference, dy[first : first + nv], memory.row,
            memory.measured,
        )  # fmt: skip
        evaluate_switches(plant.tape, memory.buffers, t, plant.parameters, memory.measured, memory.switches)
    if plant.springs.pair.shape[0] > 0:
        line_ups(plant.springs, tree, y, memory.lines)
    for k in range(plant.watch.shape[0]):
        form, which = plant.watch[k, FORM], plant.watch[k, WHICH]
        if form == QUANTITY:
            out[VALUE, k] = plant.bound[k, SIDE] * (memory.measured[which, 0] - plant.bound[k, BOUND])
            out[RATE, k] = plant.bound[k, SIDE] * memory.measured[which, 1]
        elif form == GROWTH:
            out[VALUE, k], out[RATE, k] = memory.measured[which, 1], NAN
        elif form in (STANDS, SLIPS, LIFTS, YIELDS):
            look_at_ski(plant, memory, form, y, dy, k, out)
        elif form in (HOLDS, GRIPS, STOPS):
            out[VALUE, k], out[RATE, k] = 1.0, NAN
            if plant.rows.contacts.shape[0] > 0:
                out[VALUE, k] = look_at_contact(plant, memory, form, which, y)
        elif form == BITES and plant.rows.table.shape[0] > 0:
            sizes = sizes_of(plant.rows)
            shares, at = view(sizes, memory.rows).shares, sizes.controls
            hold, normal = plant.bound[k, SIDE], int(plant.bound[k, BOUND])
            out[VALUE, k], out[RATE, k] = hold * shares[at + normal] - abs(shares[at + which]), NAN
        elif form == MOVES:
            first = tree.shape[of.POSITIONS]
            out[VALUE, k], out[RATE, k] = plant.bound[k, SIDE] * y[first + which], plant.bound[k, SIDE] * dy[first + which]
        elif form == SWITCH:
            out[VALUE, k], out[RATE, k] = memory.switches[which, 0], memory.switches[which, 1]
        elif form == LINE_UP:
            out[VALUE, k], out[RATE, k] = passing(memory.lines[which], plant.bound[k, BOUND]), 0.0
        elif form == WORTH_OF_ROWS and plant.rows.table.shape[0] > 0:
            out[VALUE, k], out[RATE, k] = worth_of(plant.rows, memory.rows)
        elif form in (NOTHING, WORTH_OF_ROWS):
            out[VALUE, k], out[RATE, k] = 1.0, 0.0

