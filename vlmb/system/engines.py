"""Which engine evaluates a run: the compiled core, or Pinocchio."""

from __future__ import annotations

from collections.abc import Sequence

from vlmb.system.core_engine import CoreEngine
from vlmb.system.forces import Control
from vlmb.system.pinocchio_engine import PinocchioEngine
from vlmb.system.system import System


def make_engine(
    system: System, branch: Sequence[float], control: Control | None = None, engine: str | None = None
) -> CoreEngine | PinocchioEngine:
    """Make the engine of one run: the system's own, or the one that is named. `branch` (N,): coordinates near the start."""
    if not isinstance(system, System):  # with robots: it brings along what moves it
        return system.mover(system, branch, control)
    if (engine or system.engine) == "core":
        made = CoreEngine(system.mechanism, system.core_plan, control, system.forces.inputs or ())
        made.take_branch(branch)
        return made
    return PinocchioEngine(system, control, branch)


def inputs_of(system: System) -> tuple[str, ...]:
    """Name the forces from outside."""
    return tuple(system.forces.inputs or ()) if isinstance(system, System) else system.inputs
