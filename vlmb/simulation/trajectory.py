"""The trajectory: what a run returns, saves and loads. Everything but the states is computed when asked for."""

from __future__ import annotations

import functools
import platform
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import scipy
from numpy.typing import NDArray

from vlmb._version import __version__
from vlmb.errors import TrajectoryError, nearest
from vlmb.model.display import Displayed
from vlmb.model.frozen import Remade, read_only
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import POINTS, Quantity
from vlmb.model.reading import Postures
from vlmb.scene.by_phase import programmes_of
from vlmb.scene.names import DAMPERS, ENERGIES, SNOW, listed
from vlmb.scene.rows import rows_of
from vlmb.scene.scene import Scene
from vlmb.scene.tables import Run
from vlmb.scene.written import as_numbers
from vlmb.simulation.columns import Column, columns, to_pandas, to_xarray
from vlmb.simulation.doubts import Doubts, doubts_of
from vlmb.simulation.end import End, end_of
from vlmb.simulation.histories import energies_along, forces_along, work_by_force
from vlmb.simulation.leg_histories import feet_at_end, read_leg
from vlmb.simulation.motion import Motion
from vlmb.simulation.named import Named, Residual
from vlmb.simulation.phase_forces import forces_in_phases, lowest_gaps
from vlmb.simulation.phases import Event, Phase, Stretch, Turn, begun, phases_of
from vlmb.simulation.phases_data import phases_as_data
from vlmb.simulation.pressure import centre_of_pressure, contacts_named
from vlmb.simulation.samples import Samples
from vlmb.simulation.storage import checked_path, write_arrays, write_columns
from vlmb.simulation.summary import summarize
from vlmb.system.contacts import HELD, RESTING, ContactPoint, work_names_of
from vlmb.system.core_engine import CoreEngine
from vlmb.system.pinocchio_engine import PinocchioEngine
from vlmb.system.start import Start
from vlmb.system.system import System, make_system

Array = NDArray[np.float64]

STATUSES = ("finished", "stopped", "failed", "interrupted")
ARRAYS = {"t": "t", "states": "states", "inputs": "asked", "branch": "reference"}  # and their names in a file


@dataclass(frozen=True, eq=False)
class Trajectory(Remade, Displayed):
    """Samples of a motion: t (N,) [s], and how they were made; Pinocchio's q (N, nq), v (N, nv); work (N, W) [J].

    trajectory["phi1"], ["phi1_dot"], ["energy"], ["legs.tip.z"]; `position`, `controls`, `reactions`, `residuals`. All arrays
    are read-only. A pickle or a file carries the forces that a control gave, not the control.
    """

    mechanism: Mechanism
    t: Array
    states: Array  # (N, size) of the engine, work states last
    engine: str  # `core` or `pinocchio`
    inputs: Array  # (N, S) [N, N m] forces of a control callable as they acted; nan where not known
    input_names: tuple[str, ...]
    branch: Array  # (1, N) coordinates at the start, or (samples, N): near which angles are read
    run: Run
    status: str  # finished | stopped | failed | interrupted
    message: str
    adjustments: tuple[str, ...]  # of the start, in sentences
    stats: dict[str, Any]
    versions: dict[str, str]
    t0: float = 0.0  # [s] of the start
    doubts: tuple[str, ...] = Doubts()  # type: ignore[assignment]
    """Contradictions in what was recorded, in sentences; empty where there are none. Looked for when they are asked for."""
    stretches: tuple[Stretch, ...] = ()  # how contacts stood in each phase, and which samples it has
    events: tuple[Event, ...] = ()  # of contacts and of the scene, in order

    def __post_init__(self) -> None:
        for name in ARRAYS:
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @staticmethod
    def from_run(
        system: System, engine: CoreEngine | PinocchioEngine, samples: Samples, start: Start, t0: float, status: str,
        message: str, stats: Any, stretches: tuple[Stretch, ...] = (), events: tuple[Event, ...] = (),
        turns: tuple[Turn, ...] = (),
    ) -> Trajectory:  # fmt: skip
        """Turn the samples of a run, and the engine that is done with it, into a trajectory."""
        (t, states, inputs, branch), names = samples, system.forces.inputs or ()
        if names and np.isnan(inputs[-1:]).any():
            message = f"{message.rstrip('.')}; the forces of the control at this sample are not known."
        made = Trajectory(
            system.mechanism, t, states, engine.name, inputs, names, branch, system.run, status, message, start.adjustments,
            stats, versions(), float(t0), (), stretches, events,
        )  # fmt: skip
        made.__dict__.update(system=system, turns=turns)  # nothing is compiled again
        if status != "failed":
            Doubts.ask_later(made)
        return made

    def looked_through(self) -> tuple[str, ...]:
        """Look for contradictions in what was recorded, and return them in sentences."""
        return doubts_of(self.system, self._motion, self.inputs, self._energies, {turn.t for turn in self.turns})

    @cached_property
    def system(self) -> System:
        """The equations of this run; compiled again after reading a pickle."""
        return make_system(self.mechanism, self.run, inputs=self.input_names or None)

    @cached_property
    def _motion(self) -> Motion:
        began = begun(self.stretches, len(self.t))
        return Motion(self.system, self.engine, self.t, self.states, self.branch, began)

    @cached_property
    def turns(self) -> tuple[Turn, ...]:
        """Where the run began anew, in order: of a run that was just made, not of one from a file."""
        return ()

    @property
    def phases(self) -> tuple[Phase, ...]:
        """The intervals in which no contact changes, in order; one of the whole run without contacts."""
        if not self.stretches:
            return (Phase(self.t0, float(self.t[-1]), (), ()),)
        return phases_of(self.system.points, self.stretches)

    @property
    def q(self) -> Array:
        """Pinocchio's configurations (N, nq), links without roll from the heading where the core ran."""
        return self._motion.pinocchio[0]

    @property
    def v(self) -> Array:
        """Pinocchio's velocities (N, nv), links without spin where the core ran."""
        return self._motion.pinocchio[1]

    @property
    def work(self) -> Array:
        """Work states (N, W) [J]."""
        return self._motion.work

    @property
    def repairs(self) -> tuple[str, ...]:
        """The former name of `adjustments`."""
        return self.adjustments

    @property
    def scene(self) -> Scene:
        """The scene this run was made from."""
        return self.mechanism.scene

    @property
    def names(self) -> tuple[str, ...]:
        """Names `trajectory[...]` knows, apart from points, directions and lengths of links."""
        return ("t", *self.mechanism.names.known, *ENERGIES, *self.mechanism.signals)

    @property
    def end(self) -> End:
        """The last sample, from which another run goes on: `simulate(scene, start=trajectory.end, t0=trajectory.end.time)`."""
        values, rates = self._coordinates
        feet = feet_at_end(self.system.points, self.stretches) if self.scene.legs else []
        return end_of(self._postures, float(self.t[-1]), values[-1], rates[-1], feet)

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        parts = [f"{len(self)} samples, {self.message.rstrip('.')}", *(f"DOUBT: {doubt}" for doubt in self.doubts)]
        parts += [self.mechanism.names.shown]
        for what, mapping in (("controls", self.controls), ("reactions", self.reactions)):
            parts += [f"{what} {listed(tuple(mapping))}"] if mapping else []
        return f"<Trajectory of {self.scene.name!r}: {'; '.join(parts)}>"

    def _ipython_key_completions_(self) -> list[str]:
        return ["t", *self.mechanism.names, *ENERGIES, *self.mechanism.signals]

    def __getitem__(self, name: str) -> Array:
        if not isinstance(name, str):
            raise TrajectoryError(f"trajectory[{name!r:.80}]: a name is needed, such as trajectory['energy'] for all its samples")
        if name == "t":
            return self.t
        if name in ENERGIES:
            return self._energies[name]
        if name in self.mechanism.signals:
            return read_only(self.mechanism.signals.along(name, self.t))
        names = self.mechanism.names
        if name not in names:
            raise TrajectoryError(f"this trajectory has no {name!r:.80}; {names.hint(name)}")
        return read_only(self._along(names.find(name)))

    def _along(self, quantity: Quantity) -> Array:
        """Return a quantity of the mechanism at all samples."""
        if quantity.kind == "leg":
            forces = self.reactions[quantity.name.partition(".")[0]]
            return read_leg(quantity, self.system.points, self.stretches, self._postures, self.t, forces)
        return self._postures.read(quantity, *self._coordinates)

    def position(self, link: str, point: str = "tip") -> Array:
        """Positions (N, 3) [m] of a link's hinge, rod_start, rod_end or tip in the surface frame."""
        links = self.mechanism.names.links
        if link not in links or point not in POINTS:
            raise TrajectoryError(f"no point {point!r} of link {link!r}; links: {', '.join(links)}; points: {', '.join(POINTS)}")
        return read_only(self._postures.position(links[link], point))

    @cached_property
    def controls(self) -> Mapping[str, Array]:
        """Applied forces and the forces of prescribed segments by name, (N,) [N, N m]."""
        ideal = {row.text for row in self.system.info[: len(self.scene.constraints)]}
        ideal |= {DAMPERS, *work_names_of(self.system.points)}
        names = tuple(n for n in self.system.work_names if n not in ideal)
        return Named("control", names, lambda name: self._evaluations["controls"][name])

    @cached_property
    def reactions(self) -> Mapping[str, Array]:
        """Reactions (N,): multipliers of ideal constraints by name or equation, and the forces of the snow on the ski.

        `knife_edge` (positive to the ski's left), `normal` [N], `roll_moment`, `pitch_moment` [N m] at point A, as if every
        control acted from the ski; forces at points, drag and springs to fixed places are outer forces. `friction` [N] is along
        the ski, where there is any. A multiplier is the force along the gradient of
        left side - right side. Of a contact, a leg and a ski that lifts ("ski") it is the force (N, 3) [N] on the mechanism in
        the surface frame, of a stop that along its length.
        """
        snow = tuple(SNOW) if self.mechanism.layout.on_snow else ()
        snow += ("friction",) if self.scene.base.friction or self.scene.base.lift else ()
        ideal = tuple(row.name for row in rows_of(self.scene).ideal)
        ideal += tuple(point.name for point in self.system.points) if self.stretches else ()
        return Named("reaction", (*snow, *ideal), lambda name: self._evaluations["reactions"][name])

    def centre_of_pressure(self, *names: str) -> Array:
        """Return where contacts press together (N, 3) [m], nan where none does: by name, or by a pattern as "left_*"."""
        known = contacts_named([point for point in self.system.points if type(point) is ContactPoint], names)
        return read_only(centre_of_pressure(known, self.t, self._place_of, self.reactions, self.scene.plane))

    def _place_of(self, point: ContactPoint) -> Array:
        return np.column_stack([self[name] if name else np.zeros(len(self.t)) for name in point.names])

    def hinge_force(self, link: str) -> Array:
        """Force (N, 3) [N] of the parent on a link at its hinge, surface frame."""
        return self._at_hinge("hinges", link)

    def hinge_torque(self, link: str) -> Array:
        """Torque (N, 3) [N m] of the parent on a link at its hinge, surface frame, as if every control acted from the parent."""
        return self._at_hinge("hinge_torques", link)

    def _at_hinge(self, what: str, link: str) -> Array:
        names = [entry.name for entry in self.mechanism.layout.links]
        if link not in names:
            raise TrajectoryError(f"no link {link!r}; {nearest(link, names)}")
        found: Array = self._evaluations[what][:, names.index(link)]
        return found

    @property
    def conditions(self) -> Array:
        """How difficult a programme is (N,): the largest singular value of G in the run over the smallest at each sample.

        G is in the scales of the controls. For one row too it grows where the controls lose their effect on it. Empty without a
        programme.
        """
        return self._evaluations["conditions"] if programmes_of(self.scene) else read_only(np.zeros(0))

    @cached_property
    def residuals(self) -> Mapping[str, Residual]:
        """Constraint errors by name or equation; `knife_edge` is the sideways velocity of the ski [m/s]."""
        edge = ("knife_edge",) if self.mechanism.layout.on_snow else ()
        return Named("residual", (*edge, *self._equations), self._residual)

    @cached_property
    def _equations(self) -> dict[str, str]:
        """Equations of ideal rows and a programme by their keys in results."""
        rows = rows_of(self.scene)
        return {row.name: row.equation for row in (*rows.ideal, *rows.servo)}

    def _residual(self, name: str) -> Residual:
        if name == "knife_edge":
            heading = self["phi0"]
            sideways = -self["x_dot"] * np.sin(heading) + self["y_dot"] * np.cos(heading)
            for stretch in self.stretches if self.mechanism.layout.lifts else ():
                if stretch.footings[-1].state not in (HELD, RESTING):  # nothing holds it in the air, or while it skids
                    sideways[stretch.first : stretch.last] = np.nan
            return Residual(None, read_only(sideways))
        position, velocity = self._evaluations["residuals"][name]
        return Residual(position if self.system.is_holonomic(name) else None, velocity, self._equations[name])

    def power(self, name: str) -> Array:
        """Power (N,) [W] of an applied force or prescribed segment: the rate of its work."""
        self.controls[name]  # explains a wrong name
        return self._evaluations["powers"][name]

    @property
    def work_by_force(self) -> dict[str, Array]:
        """Work (N,) [J] done by each applied force and prescribed segment, and lost in dampers (`dissipation`)."""
        return work_by_force(self.system, self._motion)

    @property
    def _coordinates(self) -> tuple[Array, Array]:
        return self._motion.coordinates

    @property
    def _postures(self) -> Postures:
        return self._motion.postures

    @cached_property
    def _evaluations(self) -> dict[str, Any]:
        values, failed = self._coordinates[0], self.status == "failed"
        taken = self.t, self.q, self.v, self.work, values, self.inputs
        if not self.stretches:
            return forces_along(self.system, *taken, failed)
        return forces_in_phases(self.system, self.stretches, taken, self._postures, failed)

    @cached_property
    def lowest_gaps(self) -> Mapping[str, float]:
        """The lowest gap [m] of each contact at any sample, without the time in which its `when` has refused it."""
        return lowest_gaps(self.system, self.stretches, self.t, self._postures) if self.stretches else {}

    @cached_property
    def _energies(self) -> dict[str, Array]:
        return energies_along(self.system, self._motion, self.work_by_force, self.stretches)

    def save(self, path: str | Path) -> Path:
        """Write an npz file of the trajectory with its scene, options and versions.

        `load_trajectory` reads it, `vlmb run` replays it. Raises TrajectoryError for the ending of another format.
        """
        if checked_path(path).suffix in (".csv", ".nc", ".sto"):
            raise TrajectoryError(f"{path}: save writes npz files; save_csv and `vlmb convert run.npz {path}` write tables")
        note = {
            "scene": self.scene.to_dict(), "run": as_numbers(self.run), "status": self.status, "message": self.message,
            "repairs": self.adjustments, "stats": self.stats, "versions": self.versions, "asked_names": self.input_names,
            "engine": self.engine, "t0": self.t0, "doubts": self.doubts,
        }  # fmt: skip
        note |= phases_as_data(self.stretches, self.events)
        return write_arrays(checked_path(path), note, {stored: getattr(self, name) for name, stored in ARRAYS.items()})

    def columns(self, points: bool = False, hinges: bool = False) -> Iterator[Column]:
        """Yield the columns of `to_pandas`, the time first, each as (name, unit, values)."""
        return columns(self, points, hinges)

    def save_csv(self, path: str | Path) -> Path:
        """Write the columns of `to_pandas`, with their units in the header line: `psi1 [rad]`."""
        return write_columns(checked_path(path), {column.header: column.values for column in self.columns()})

    def to_pandas(self, points: bool = False, hinges: bool = False) -> Any:
        """Return a pandas.DataFrame over t of coordinates, rates, energies, controls, reactions and residuals.

        Units are in `attrs["units"]`. `points` adds the points of all links and the centre of mass, `hinges` the forces and
        torques in the hinges; residuals are `residual:NAME` and `residual_dot:NAME`. Raises TrajectoryError without pandas.
        """
        return to_pandas(self.columns(points, hinges))

    def to_xarray(self, points: bool = False, hinges: bool = False) -> Any:
        """Return the columns of `to_pandas` as an xarray.Dataset over t, each with its unit in `attrs["units"]`.

        Raises TrajectoryError without xarray.
        """
        about = {"scene": self.scene.name, "method": self.run.method, "status": self.status, "message": self.message}
        return to_xarray(self.columns(points, hinges), about | {"vlmb": self.versions.get("vlmb", "")})

    def summary(self) -> str:
        """Return the main facts of the run in a few lines: status, energy balance, residuals, largest forces, warnings."""
        if not programmes_of(self.scene):
            return summarize(self, "")
        condition = np.fmax.reduce(self.conditions, initial=0.0)
        return summarize(self, f"{self._evaluations['report']}; condition of G up to {condition:.4g}")


def versions() -> dict[str, str]:
    """Versions that a run depends on."""
    return dict(_versions())


@functools.cache
def _versions() -> dict[str, str]:
    return {
        "vlmb": __version__, "pinocchio": pin.__version__, "numpy": np.__version__, "scipy": scipy.__version__,
        "python": platform.python_version(),
    }  # fmt: skip
