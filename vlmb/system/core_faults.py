"""Codes of the compiled core as errors: what has no answer, and why."""

from __future__ import annotations

from collections.abc import Sequence

from vlmb.core import constraints as rows
from vlmb.core import tree as links
from vlmb.core.plant import (
    FROM_FORCE,
    FROM_LAW,
    FROM_LINKS,
    FROM_QUANTITY,
    FROM_ROWS,
    FROM_SIDE,
    FROM_SPRING,
    SOURCES,
    Memory,
)  # fmt: skip
from vlmb.core.quantities import AZIMUTH, BETWEEN, KIND, LINK
from vlmb.core.row_arrays import FIRST, IDEAL, SECOND, SERVO
from vlmb.errors import SimulationError, SingularError, VlmbError
from vlmb.model.mechanism import Mechanism
from vlmb.system.core_plan import CorePlan
from vlmb.system.core_rows import solved_programme
from vlmb.system.programme import out_of_reach, turned_side
from vlmb.system.readings import ends_meet, no_azimuth, no_direction


def fault(mechanism: Mechanism, plan: CorePlan, memory: Memory, code: int) -> VlmbError:
    """Make the error of an evaluation's code; rows that cannot be met are those of the last evaluation in `memory`."""
    source, what = divmod(code, SOURCES)
    layout, tables = mechanism.layout, plan.table
    if source == FROM_LAW:
        law = _law(plan, what)
        reach = mechanism.signals.reach(law)
        return SimulationError(f"the law {law!r} of the force on {plan.acting[what].name} has no finite value{reach}")
    if source == FROM_FORCE:
        return no_direction(plan.acting[what], layout)
    if source == FROM_SPRING:
        spring = plan.springs[what]
        return SingularError(
            f"{spring.name}: the two directions line up, where a spring with rest = {spring.rest:g} has no axis to turn "
            "about; start elsewhere or use rest = 0"
        )
    if source == FROM_QUANTITY:
        kind = plan.plant.quantities.kind[what // 3]
        if kind[KIND] == AZIMUTH:
            return no_azimuth(layout, plan.arrays.order[kind[LINK]])
        if kind[KIND] == BETWEEN:
            return ends_meet(tables.labels[what // 3])
        return SingularError(f"{tables.labels[what // 3]} has no value here: it stands at its pole")
    if source == FROM_ROWS:
        return _of_rows(mechanism, plan, memory, what)
    if source == FROM_SIDE:
        assert plan.programme is not None
        return turned_side(plan.programme)
    assert source == FROM_LINKS
    cause, row = divmod(what, links.PLACES)
    name = layout.links[plan.arrays.order[row]].name if row < len(layout.links) else "the base"
    return _without_inertia(mechanism, cause, name)


def _law(plan: CorePlan, k: int) -> str:
    return plan.laws[k][1] if k < len(plan.laws) else "control"


def _without_inertia(mechanism: Mechanism, cause: int, name: str) -> VlmbError:
    if cause == links.NO_DIRECTION:
        return SimulationError(f"the state of {name} is not finite: a position or velocity is too large to compute with")
    layout = mechanism.layout
    own = [c for c in layout.coordinates if c.link >= 0 and layout.links[c.link].name == name]
    lengths, angles = ([c.name for c in own if (c.kind == "xi") == along] for along in (True, False))
    moves = {
        links.FREE_TIP: f"{lengths[-1] if lengths else 'its length'} of {name}",
        links.FREE_ROD: f"{' and '.join(lengths)} of {name}, its rod between two free segments,",
        links.TURNING: f"{' and '.join(angles)} of {name}",
        links.FREE_BASE: " ".join(c.name for c in layout.coordinates if c.link < 0),
    }[cause]
    hints = " ".join(mechanism.warnings)
    return SingularError(f"the mass matrix is singular: {moves} can move without inertia. {hints}".rstrip())


def _of_rows(mechanism: Mechanism, plan: CorePlan, memory: Memory, what: int) -> VlmbError:
    kind, bits = divmod(what, rows.KIND)
    if kind == rows.NO_DIRECTION:
        first = next(k for k in range(rows.MOST + 1) if bits >> k & 1)
        return no_direction(mechanism.names.force(plan.controls[first], "controls"), mechanism.layout)
    if kind == rows.OUT_OF_REACH:
        assert plan.programme is not None
        return out_of_reach(plan.programme, *solved_programme(plan.plant.rows, memory.rows))
    if kind == rows.NO_GAIN:
        assert plan.programme is not None
        moving, table = plan.programme.moving, plan.plant.rows.table[0]
        root = int(table[FIRST] + table[[IDEAL, SERVO, SECOND]].sum()) + bits
        value = float(memory.buffers.slots[plan.plant.tape.root[root], 0])
        return moving.failure(bits, value, mechanism.signals.reach(moving.laws[bits].text))
    named = [repr(name) for name in _chosen(plan.row_names, bits)]
    if kind == rows.NO_VALUE:
        equation = " and ".join(named)
        return SimulationError(f"the equation {equation} has no finite value here{mechanism.signals.reach(equation)}")
    if kind == rows.EMPTY_ROWS:
        return SingularError(f"{', '.join(named)} asks for what is known otherwise here: drop it")
    assert kind == rows.CONTRADICTING
    if not named:
        return SingularError("the ideal constraints have no finite values here")
    return SingularError(f"the ideal constraints {', '.join(named)} contradict each other here: drop one of them")


def _chosen(names: Sequence[str], bits: int) -> list[str]:
    return [name for k, name in enumerate(names) if bits >> min(k, rows.MOST) & 1]
