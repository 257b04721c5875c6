"""Rows and a programme as the compiled core has them: forms, gains, scales; and what the last solution of an engine means."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vlmb.core.contacts import AT, CARRIED, COUNT, HEAT, OF_SKI, PLACE, SLIDES
from vlmb.core.row_arrays import (
    ALONG,
    BEHIND,
    BORDER,
    COLUMN,
    CONTROLS,
    COUPLED,
    FIRST,
    FORM,
    FREE,
    HELD,
    IDEAL,
    OF_ROW,
    OF_WEIGHT,
    PROJECTED,
    ROOT,
    SECOND,
    SERVO,
    SLIDING,
    UNBOUNDED,
    VARYING,
    WORK,
    RowMemory,
    Rows,
    no_rows,
    parts,
    sizes_of,
)  # fmt: skip
from vlmb.model.mechanism import Mechanism
from vlmb.model.quantities import QuantityTable
from vlmb.scene.tables import Run
from vlmb.system.constraints import Constraint, ConstraintSet
from vlmb.system.contacts import PhaseContacts
from vlmb.system.gains import MovingGains
from vlmb.system.programme import ProgrammePlan, control_channels, control_scales
from vlmb.system.readings import form_of_row

Array = NDArray[np.float64]


def gain_table(info: Sequence[Constraint], plan: ProgrammePlan | None, ideal: int, gain: float) -> tuple[Array, Array]:
    """Return H and K (n, n), W vdot = H z + K z' - drift, of ideal rows (by Baumgarte), a programme and its secondary rows."""
    holonomic = np.array([row.holonomic for row in info], dtype=bool)
    h, k = np.diag(-(gain * gain) * holonomic), np.diag(np.where(holonomic, -2.0 * gain, -gain))
    if plan is not None:
        servo, second = slice(ideal, ideal + len(plan.texts)), slice(ideal + len(plan.texts), None)
        h[servo, servo], k[servo, servo] = plan.gains()
        h[second, second], k[second, second] = plan.secondary_gains()
    return h, k


def moving_places(info: Sequence[Constraint], plan: ProgrammePlan | None, ideal: int) -> list[tuple[int, int]]:
    """Return row and column in (H, K), over all rows, of the entries that the motion gives.

    Of a weight: (OF_WEIGHT, control); of the factor of a force that row i beyond the ideal ones names: (OF_WEIGHT - 1 - i, which
    ideal row, the knife edge not counted).
    """
    if plan is None:
        return []
    positions, found = [k for k, holonomic in enumerate(plan.holonomic.tolist()) if holonomic], []
    for entry in plan.moving.entries:
        if entry.kind == "weights":
            found.append((OF_WEIGHT, entry.column))
        elif entry.kind == "force":
            found.append((OF_WEIGHT - 1 - entry.row, entry.column))
        else:
            own = [k for k in positions if k >= entry.first]
            column = own[entry.column] if entry.kind == "h" else len(info) + entry.first + entry.column
            found.append((ideal + entry.row, ideal + column))
    return found


def make_rows(
    mechanism: Mechanism, run: Run, constraints: ConstraintSet | None, plan: ProgrammePlan | None, table: QuantityTable,
    first: int, works: Mapping[str, int], contacts: PhaseContacts | None = None,
) -> Rows:  # fmt: skip
    """Make the rows of a scene for the core; `first` is the root of the tape of the first one, what varies is behind.

    works : work states by name
    """
    held = mechanism.layout.edged and run.knife_edge != "reduction"
    info = constraints.info if constraints is not None else ()
    closed = _contacts(contacts, table, works, held)
    if not (held or info):
        return no_rows()._replace(contacts=closed, grip=grip_of(contacts))
    ideal, servo = len(mechanism.scene.constraints), len(plan.texts) if plan is not None else 0
    acting = control_channels(mechanism)
    varying = moving_places(info, plan, ideal)
    numbers = np.full((1 + len(info) + len(acting) + len(varying), 13), -1, np.int64)
    numbers[0, [HELD, IDEAL, SERVO, SECOND]] = held, ideal, servo, len(info) - ideal - servo
    numbers[0, [CONTROLS, FIRST, PROJECTED]] = len(acting), first, held and run.knife_edge == "projection"
    behind, moving = first + len(info), MovingGains() if plan is None else plan.moving
    numbers[0, [VARYING, BEHIND]] = len(varying), len(moving.laws)
    if moving.free is not None:
        numbers[0, [FREE, BORDER]] = behind, behind + 1 + len(varying)
    own = {} if contacts is None else contacts.work_of()
    for at, row in enumerate(info):
        numbers[1 + at, FORM] = form_of_row(row.holonomic, row.angle, row.of_forces)
        worker = info[row.worker].text if at < ideal and row.worker >= 0 else ""
        numbers[1 + at, WORK] = works[own.get(worker, worker)] if worker else -1
        numbers[1 + at, UNBOUNDED] = row.unbounded
    for at, force in enumerate(acting):
        numbers[1 + len(info) + at, [ALONG, WORK]] = table.along(force), works[force.name]
    for at, place in enumerate(varying):
        entry = 1 + len(info) + len(acting) + at
        numbers[entry, [ROOT, OF_ROW, COLUMN]] = behind + moving.first_entry + at, *place
        numbers[entry, COLUMN] += held and place[0] < OF_WEIGHT
    gains = np.zeros((len(info) + 1, max(2 * len(info), len(acting) + 1)))
    h, k = gain_table(info, plan, ideal, run.gain)
    gains[: len(info), : 2 * len(info)] = np.hstack([h, k])
    numbers[0, COUPLED] = any(np.count_nonzero(matrix - np.diag(np.diag(matrix))) for matrix in (h, k))
    gains[-1, : len(acting) + 1] = *control_scales(mechanism, acting), run.gain
    numbers[0, SLIDING] = int(closed[:, SLIDES].sum())
    return Rows(numbers, gains, closed, grip_of(contacts))


def grip_of(contacts: PhaseContacts | None) -> Array:
    """Return the numbers (closed, 9) of friction of closed contacts: see vlmb/core/contacts.py."""
    closed = [] if contacts is None else contacts.closed
    grip = np.zeros((len(closed), 9))
    for k, (point, footing, _, _) in enumerate(closed):
        if point.edge is not None:
            grip[k] = float(any(footing.towards)), 1e300, 0.0, 0.0, 0.0, *footing.towards, OF_SKI
            continue
        coefficient = point.coefficient if point.slides(footing) else 0.0
        way = point.normal(footing) if footing.planted else footing.towards
        grip[k] = coefficient, min(point.at_rest, 1e300), *point.contact.surface_velocity, *way, all(point.names)
    return grip


def _contacts(contacts: PhaseContacts | None, table: QuantityTable, works: Mapping[str, int], held: bool) -> NDArray[np.int64]:
    """Make the table of closed contacts for the core: see vlmb/core/contacts.py."""
    closed = [] if contacts is None else contacts.closed
    found = np.full((len(closed), 8), -1, np.int64)
    for k, (point, footing, at, count) in enumerate(closed):
        found[k, [AT, COUNT, SLIDES]] = held + at, count, point.slides(footing)
        found[k, PLACE : PLACE + 3] = [table.of(table.names.find(name)) if name else -1 for name in point.names]
        found[k, HEAT], found[k, CARRIED] = (works.get(f"{what} {point.name}", -1) for what in ("friction", "surface"))
    return found


def solved_programme(rows: Rows, memory: RowMemory) -> tuple[Array, Array]:
    """Return G (r, S) in the scales of the controls, and beta (r,), of a programme at the last solution, as copies."""
    sizes = sizes_of(rows)
    space = parts(sizes, memory)
    last = int(sizes.ideal + sizes.servo)
    return np.array(space.matrix[: sizes.servo, : sizes.controls]), np.array(space.wanted[sizes.ideal : last])
