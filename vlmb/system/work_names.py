"""The work states of a run: what the account of energy tells apart."""

from __future__ import annotations

from collections.abc import Iterable

from vlmb.model.mechanism import Mechanism
from vlmb.model.names import LOST, GeneralizedForce
from vlmb.system.contacts import ContactPoint, work_names_of
from vlmb.system.forces import AppliedForces
from vlmb.system.point_forces import is_named, scene_forces
from vlmb.system.prescribed import Prescribed
from vlmb.system.programme import control_names


def names_of_work(
    mechanism: Mechanism, working: Iterable[str], forces: AppliedForces, prescribed: Iterable[Prescribed],
    points: tuple[ContactPoint, ...], dampers: Iterable[float],
) -> tuple[str, ...]:  # fmt: skip
    """Return the names of controls and forces of any phase, of rows that work, what contacts take, and "dissipation"."""
    names = [*control_names(mechanism), *working]
    acting: list[GeneralizedForce] = [*(entry.force for entry in scene_forces(mechanism, every=True)), *forces.channels]
    names += [force.name for force in acting if is_named(force)] + [at.force for at in prescribed]
    names += work_names_of(points)
    base = mechanism.scene.base
    lost = any((*dampers, *(force.kind == LOST for force in forces.channels), base.friction and not base.lift))
    return (*dict.fromkeys(names), *(("dissipation",) if lost else ()))
