"""Forces, reactions and errors of rows along a run with robots: at all samples, each phase by its own system."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import VlmbError
from vlmb.model.frozen import read_only
from vlmb.model.layout import State
from vlmb.scene.names import SNOW
from vlmb.simulation.named import Residual
from vlmb.simulation.phases import Stretch, begun
from vlmb.system.constraints import Constraint
from vlmb.system.contacts import AWAY, CLOSED, OPEN, Footing
from vlmb.system.robot_engine import RobotEngine
from vlmb.system.robot_system import RobotSystem
from vlmb.system.slips import force_of

Array = NDArray[np.float64]


def held_rows(system: RobotSystem) -> list[Constraint]:
    """List the rows that reactions hold, without those of lengths that follow laws: their reactions are controls."""
    first = system.first_drive
    return [row for k, row in enumerate(system.info[: system.eliminated]) if not first <= k < first + len(system.drives)]


def told_rows(system: RobotSystem) -> list[Constraint]:
    """List the rows that results tell: held ones, and those of programmes."""
    return [*held_rows(system), *system.own.rows]


def snow_of(system: RobotSystem) -> tuple[str, ...]:
    """Name what the snow does to a ski beside its knife edge."""
    found = tuple(name for name in SNOW if name != "knife_edge")
    rubbed = ("friction",) if system.mechanism.scene.base.friction else ()
    return (*found, *rubbed) if system.on_ski else ()


ALONG_X = (1.0, 0.0)  # a heading, which contacts other than a ski's do not go by


class Histories:
    """What is found at the samples of a run; nan where nothing is known."""

    def __init__(self, system: RobotSystem, count: int) -> None:
        self.system, self.count = system, count
        self.rows = {row.text: row for row in told_rows(system)}
        self.held = {row.text for row in held_rows(system)}
        self.values = np.full((count, len(system.own.forces)), np.nan)
        sizes = [sum(row.text == name for row in system.info) for name in self.rows]
        several = [size if name in self.held else 1 for name, size in zip(self.rows, sizes, strict=True)]
        self.multipliers = {name: np.full((count, size), np.nan) for name, size in zip(self.rows, several, strict=True)}
        self.errors = {name: np.full((count, 2), np.nan) for name in self.rows}
        self.drives = np.full((count, len(system.drives)), np.nan)
        self.powers = np.full((count, len(system.work_names)), np.nan)
        self.strengths, self.snow = np.full((count, 2), np.nan), np.full((count, 4), np.nan)
        self.contacts = {point.name: np.zeros((count, 3)) for point in system.points}
        self.report = "" if system.plan is None else system.plan.decay

    def follow(
        self, footings: Sequence[Footing], phase_began: float, first: int, taken: Sequence[Array], began: State, failed: bool
    ) -> None:
        """Evaluate samples (t, states, inputs) of one phase, that begin with sample `first`."""
        system = self.system.phase(footings, began=phase_began) if footings else self.system
        engine = RobotEngine(system, began)
        space, first_row = engine.workspace, system.first_drive
        places = {name: [k for k, row in enumerate(system.info) if row.text == name] for name in self.rows}
        places = {name: at for name, at in places.items() if at}
        acting = places_of(system, self.system)
        self.values[first : first + len(taken[0])] = 0.0  # of what does not act in this phase
        for i, (t, y, inputs) in enumerate(zip(taken[0].tolist(), *taken[1:], strict=True), first):
            if np.isnan(inputs).any():
                self.values[i] = np.nan
                continue
            try:
                space.take_inputs(inputs)
                engine.accept(t, y)
                now = space.evaluate(t, np.array(y), inputs)
            except VlmbError:
                if failed:
                    self.values[i] = np.nan
                    continue
                raise
            self.values[i, acting], self.powers[i], self.snow[i] = now.values, now.powers, now.snow
            self.drives[i] = now.multipliers[first_row : first_row + len(system.drives)]
            for name, at in places.items():
                self.errors[name][i] = np.abs(now.residuals[:2, at]).max(axis=1) if len(at) > 1 else now.residuals[:2, at[0]]
                if name in self.held:
                    self.multipliers[name][i] = now.multipliers[at]
            if space.programme is not None:
                self.strengths[i] = space.programme.strengths(space.programme.control_matrix)
                self.report = space.programme.report
            if space.contacts is not None:
                self._contacts(i, t, space, footings)

    def _contacts(self, i: int, t: float, space: Any, footings: Sequence[Footing]) -> None:
        at = space.contacts.first + len(self.system.mechanism.scene.constraints)
        places = space.contacts.places_at(space.q, space.v)
        for point, footing in zip(self.system.points, footings, strict=True):
            if footing.state in CLOSED:
                count = len(point.row_texts(footing))
                (place, speed), own = places[point.index, :, :2].T, space.multipliers[at : at + count]
                self.contacts[point.name][i] = force_of(point, footing, t, place, speed, own, ALONG_X)
                at += count

    def told(self) -> dict[str, Any]:
        """Return controls, reactions, residuals, powers and conditions by name."""
        system, controls = self.system, dict[str, Array]()
        for k, force in enumerate(system.own.forces):
            controls[force.name] = controls.get(force.name, 0.0) + self.values[:, k]
        controls |= {drive.force: self.drives[:, k] for k, drive in enumerate(system.drives)}
        reactions = {name: values if values.shape[1] > 1 else values[:, 0] for name, values in self.multipliers.items()}
        reactions = {name: values for name, values in reactions.items() if name in self.held}
        reactions |= {name: self.snow[:, k] for k, name in enumerate(snow_of(system))} | self.contacts
        residuals = {
            name: Residual(read_only(error[:, 0]) if self.rows[name].holonomic else None, read_only(error[:, 1]), name)
            for name, error in self.errors.items()
        }
        with np.errstate(divide="ignore", invalid="ignore"):
            conditions = np.fmax.reduce(self.strengths[:, 0], initial=0.0) / self.strengths[:, 1]
        return {
            "controls": {name: read_only(found) for name, found in controls.items()},
            "reactions": {name: read_only(np.ascontiguousarray(found)) for name, found in reactions.items()},
            "residuals": residuals, "conditions": read_only(conditions), "report": self.report,
            "powers": {name: read_only(self.powers[:, k]) for k, name in enumerate(system.work_names)},
        }  # fmt: skip


def places_of(phase: RobotSystem, whole: RobotSystem) -> list[int]:
    """Return where the forces of a phase stand among those of the whole run."""
    found = list[int]()
    for force in phase.forces:
        found.append(next(at for at, other in enumerate(whole.own.forces) if other == force and at not in found))
    return found


def robot_histories(
    system: RobotSystem, taken: Sequence[Array], stretches: Sequence[Stretch], began: State, failed: bool
) -> dict[str, Any]:
    """Return what `Histories.told` does; taken: t, states and inputs at all samples; began: where the run did."""
    found = Histories(system, len(taken[0]))
    if not stretches:
        found.follow([Footing(OPEN)] * len(system.points), 0.0, 0, taken, began, failed)
    phases = begun(stretches, len(taken[0]))
    for stretch in stretches:
        if stretch.last > stretch.first:
            at, own = stretch.first, slice(stretch.first, stretch.last)
            found.follow(stretch.footings, float(phases[at]), at, [values[own] for values in taken], began, failed)
    return found.told()


def lowest_gaps(system: RobotSystem, stretches: Sequence[Stretch], t: Array, places: Mapping[str, Array]) -> dict[str, float]:
    """Return the lowest gap [m] of each contact, without the time in which its `when` has refused it; places (N, 3) by name."""
    found = {}
    for point in system.points:
        own = [s for s in stretches if s.footings[point.index].state != AWAY]
        gaps = [point.gap(float(t[i]), places[point.name][i]) for s in own for i in range(s.first, s.last)]
        found[point.name] = float(min(gaps, default=np.inf))
    return found
