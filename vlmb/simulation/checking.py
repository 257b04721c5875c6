"""What comes before a run, and what is known then."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pinocchio as pin

from vlmb.model.building import build
from vlmb.model.mechanism import Mechanism
from vlmb.model.memory import fits
from vlmb.model.names import counted
from vlmb.scene.scene import Scene
from vlmb.simulation.breaks import breaks_of
from vlmb.simulation.loop import Loop
from vlmb.simulation.simulate import start_of
from vlmb.system.beginning import beginning
from vlmb.system.core_engine import CoreEngine
from vlmb.system.engines import make_engine
from vlmb.system.massless import SINGULAR
from vlmb.system.pace import longest_steps, require_data
from vlmb.system.point_forces import told
from vlmb.system.start import Start
from vlmb.system.system import System, make_system
from vlmb.system.workspace import Workspace

if TYPE_CHECKING:
    from vlmb.model.robot_mechanism import RobotMechanism

APART = 1e-6  # of the largest acceleration: what two engines may differ by, as differences of velocities tell


class Checked(NamedTuple):
    """What is known before a run: `mechanism, start = check(scene)`. Printing it shows the text of `vlmb check`."""

    mechanism: Mechanism | RobotMechanism
    start: Start

    @property
    def scene(self) -> Scene:
        """The scene that was checked."""
        return self.mechanism.scene

    @property
    def degrees_of_freedom(self) -> int:
        """Independent velocities at the start: coordinates less prescribed ones, the knife edge, welds and ideal constraints."""
        if not isinstance(self.mechanism, Mechanism):
            return self.mechanism.table.velocities - self.start.rank  # whose rows are all of these
        layout = self.mechanism.layout
        prescribed = sum(at.motion == "prescribed" and at.joint > 0 for e in layout.links for at in (e.lower, e.upper))
        return len(layout.names) - prescribed - layout.edged - self.start.rank

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings, forces at points and springs, measured data, what was adjusted at the start, how a programme is stable."""
        data = (column.report for column in self.mechanism.signals.columns)
        robots = not isinstance(self.mechanism, Mechanism)
        left = (f"left out: {entry}" for entry in self.mechanism.left_out if robots)
        return (*self.mechanism.warnings, *left, *self.acting, *data, *self.start.adjustments)

    @property
    def acting(self) -> tuple[str, ...]:
        """Forces at points, springs between points, friction and drag of a scene of links, a sentence each."""
        if not isinstance(self.mechanism, Mechanism):
            return ()
        return tuple(told(self.mechanism, self.mechanism.postures(self.start.state)))

    @property
    def report(self) -> str:
        """Coordinates and degrees of freedom in a line, then a line for each note."""
        coordinates, free = len(self.mechanism.coordinate_names), self.degrees_of_freedom
        counts = f"fine. {counted(coordinates, 'coordinate')}, {counted(free, 'degree')} of freedom"
        return "\n".join([counts, *(f"  {note}" for note in self.notes)])

    def __repr__(self) -> str:
        return f"{self.scene.name}: {self.report}"


def check(scene: Scene | Mechanism | RobotMechanism | str | Path | Mapping[str, Any]) -> Checked:
    """Do everything that precedes a run, and raise the errors that a run would raise.

    Takes a Scene, the path of a scene file or a dict with its keys. Returns the mechanism and its consistent start, with
    `degrees_of_freedom` and `notes`, which also tell whether a programme is stable and its controls suffice.
    """
    mechanism = build(scene)
    if not isinstance(mechanism, Mechanism):
        from vlmb.simulation.robot_run import check_robots

        return Checked(mechanism, check_robots(mechanism))
    scene = mechanism.scene
    require_data(scene, 0.0, scene.run.duration)
    system = make_system(mechanism)
    start = start_of(system)
    breaks_of(beginning(system, 0.0), 0.0, scene.run.duration)
    engine = make_engine(system, start.branch)
    y, times = engine.pack(start.state), np.array([0.0, scene.run.duration])
    engine.evaluate(0.0, y)
    Loop(engine, scene.run, y, times, (), 0.0, longest_steps(scene, 0.0, scene.run.duration))  # refuses a start as a run does
    if not fits(mechanism.model.nv):
        return Checked(mechanism, start)
    workspace = system.workspace(branch=start.branch)
    workspace.rhs(0.0, workspace.pack(start.state))
    if workspace.diagnostics.conditioning(start.state.q)[0] > SINGULAR:
        raise workspace.diagnostics.singular(start.state.q)
    notes = [_engines_agree(system, engine, workspace, start)] if isinstance(engine, CoreEngine) else []
    programme = workspace.solver.programme
    if programme is not None:
        notes.append(programme.controllable)
    return Checked(mechanism, start._replace(adjustments=(*start.adjustments, *notes)))


def _engines_agree(system: System, engine: CoreEngine, workspace: Workspace, start: Start) -> str:
    """Compare the accelerations of both engines at the start, as the core's velocities have them: u', a', and the base's."""
    layout, plan = system.mechanism.layout, system.core_plan
    y = engine.pack(start.state)
    core = engine.evaluate(0.0, y)[plan.positions : plan.positions + plan.velocities]
    vdot = np.array(workspace.rhs(0.0, workspace.pack(start.state))[layout.nq : layout.nq + layout.nv])
    step = 1e-6 * max(1.0, 1.0 / max(1.0, float(np.abs(vdot).max())))
    sides = []
    for sign in (1.0, -1.0):  # the velocities a little before and after, by Pinocchio's accelerations
        v = start.state.v + sign * step * vdot
        q = pin.integrate(system.mechanism.model, start.state.q, sign * step * (start.state.v + 0.5 * sign * step * vdot))
        sides.append(plan.arrays.pack(q, v)[plan.positions :])
    change = (sides[0] - sides[1]) / (2.0 * step)
    off = float(np.abs(core - change).max()) / max(1.0, float(np.abs(core).max()))
    if off > APART:
        return f"the two engines differ at the start by {off:.1e} of the largest acceleration: please report this scene"
    return f"both engines agree at the start (accelerations within {APART:g} of the largest)"
