"""The trajectory of a scene with robots. Everything but the states is computed when asked for."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import TrajectoryError, VlmbError, nearest
from vlmb.model.frozen import read_only
from vlmb.model.layout import State
from vlmb.model.robot_mechanism import RobotMechanism
from vlmb.scene.by_phase import programmes_of
from vlmb.scene.names import DAMPERS, ENERGIES, SNOW, listed
from vlmb.simulation.columns import Column
from vlmb.simulation.doubts import Doubts, of_energy, of_rows, of_steps
from vlmb.simulation.end import End
from vlmb.simulation.loop import Loop
from vlmb.simulation.named import Named, Residual, largest
from vlmb.simulation.phased_run import PhasedRun
from vlmb.simulation.pressure import centre_of_pressure, contacts_named
from vlmb.simulation.robot_histories import held_rows, lowest_gaps, robot_histories, snow_of, told_rows
from vlmb.simulation.samples import samples_of
from vlmb.simulation.trajectory import Trajectory, versions
from vlmb.system.contacts import ContactPoint
from vlmb.system.robot_engine import RobotEngine
from vlmb.system.robot_programme import NO_LIMIT, effort_limits
from vlmb.system.robot_start import robot_start
from vlmb.system.robot_system import RobotSystem, make_robot_system
from vlmb.system.robot_workspace import RobotWorkspace
from vlmb.system.start import Start

Array = NDArray[np.float64]

FORCE = ("x", "y", "z")  # of a contact
WRENCH = ("x", "y", "z", "moment_x", "moment_y", "moment_z")  # of a weld: N, N m
SHOWN = 8  # controls in a summary


class RobotTrajectory(Trajectory):
    """Samples of a motion with robots: t (N,) [s]; Pinocchio's q (N, nq), v (N, nv); work (N, W) [J].

    trajectory["elbow_joint"], ["left_foot.z"], ["com.x_dot"], ["energy"]; `position("left_foot")`, `controls`, `reactions`,
    `residuals`, `shares` of the limits of the URDF. A weld's reaction is (N, 6): force and moment on its first frame about that
    frame's origin, surface frame.
    """

    mechanism: RobotMechanism  # type: ignore[assignment]

    @staticmethod
    def of_run(
        system: RobotSystem, engine: RobotEngine, loop: Loop | PhasedRun, start: Start, t0: float, status: str, message: str,
        stats: Any,
    ) -> RobotTrajectory:  # fmt: skip
        """Turn the samples of a run into a trajectory."""
        phases: tuple[Any, ...] = ((), ())
        if isinstance(loop, PhasedRun):
            t, states, inputs, branch = loop.samples
            phases = tuple(loop.stretches), tuple(loop.events)
        else:
            t, states, inputs, branch = samples_of(engine, loop.recorded)
        if np.isnan(inputs[-1:]).any():
            message = f"{message.rstrip('.')}; the forces of the control at this sample are not known."
        told = (*start.adjustments, *(f"left out: {entry}" for entry in system.mechanism.left_out))
        if engine.workspace.programme is not None:
            with contextlib.suppress(VlmbError):
                engine.workspace.evaluate(float(t[0]), np.array(states[0]))
            told = (*told, *engine.workspace.unreached())

        mechanism: Any = system.mechanism
        made = RobotTrajectory(
            mechanism, t, states, engine.name, inputs, system.inputs, branch, system.run, status, message, told, stats,
            versions(), float(t0), (), *phases,
        )  # fmt: skip
        made.__dict__["system"] = system
        if status != "failed":
            Doubts.ask_later(made)
        return made

    @cached_property
    def system(self) -> RobotSystem:  # type: ignore[override]
        """The equations of this run; compiled again after reading a pickle."""
        return make_robot_system(self.mechanism, self.run, self.input_names or None)

    @property
    def q(self) -> Array:
        """Pinocchio's configurations (N, nq)."""
        return read_only(self.states[:, : self.mechanism.model.nq])

    @property
    def v(self) -> Array:
        """Pinocchio's velocities (N, nv)."""
        model = self.mechanism.model
        return read_only(self.states[:, model.nq : model.nq + model.nv])

    @property
    def work(self) -> Array:
        """Work states (N, W) [J]."""
        return read_only(self.states[:, self.mechanism.model.nq + self.mechanism.model.nv :])

    @cached_property
    def _coordinates(self) -> tuple[Array, Array]:
        values, rates = self.mechanism.read(self.q, self.v)
        return read_only(values), read_only(rates)

    @property
    def end(self) -> End:
        """The last sample, from which another run goes on."""
        values, rates = self._coordinates
        return End(float(self.t[-1]), tuple(self.mechanism.names.index), tuple(values[-1].tolist()), tuple(rates[-1].tolist()))

    def _along(self, quantity: Any) -> Array:
        at = self.mechanism.names.index.get(quantity.name.removesuffix("_dot"))
        return self.mechanism.along(quantity, self.q, self.v) if at is None else self._coordinates[quantity.rate][:, at]

    def position(self, link: str, point: str = "") -> Array:
        """Positions (N, 3) [m] of a frame, or of a point of a link, in the surface frame."""
        name = f"{link}.{point}" if point else link
        if name not in self.mechanism.frames:
            raise TrajectoryError(f"no frame {name!r:.80}; {nearest(name, self.mechanism.frames)}")
        return read_only(np.column_stack([self[f"{name}.{axis}"] for axis in "xyz"]))

    def hinge_force(self, link: str) -> Array:
        """Raise TrajectoryError: forces in hinges are told of scenes of links alone."""
        raise TrajectoryError("forces in hinges are told of scenes of links alone; welds have reactions")

    hinge_torque = hinge_force

    @cached_property
    def controls(self) -> Mapping[str, Array]:
        """Forces by law, of a control callable and of the programme by name, (N,) [N, N m]."""
        names = tuple(dict.fromkeys([*(force.name for force in self.system.named), *(d.force for d in self.system.drives)]))
        return Named("control", names, lambda name: self._evaluations["controls"][name])

    @cached_property
    def reactions(self) -> Mapping[str, Array]:
        """Reactions (N,) of edges, ideal rows and the knife edge; (N, 6) of welds, as `weld:left_foot`.

        Of a ski also `normal` [N], `roll_moment`, `pitch_moment` [N m] about A, and its `friction` [N]. Forces at points, drag,
        springs to what it does not carry and welds to that are outer forces. Of a contact its force (N, 3) [N].
        """
        names = tuple(dict.fromkeys(row.text for row in held_rows(self.system)))
        names = (*names, *snow_of(self.system), *(point.name for point in self.system.points))
        return Named("reaction", names, lambda name: self._evaluations["reactions"][name])

    @cached_property
    def residuals(self) -> Mapping[str, Residual]:
        """Errors of all rows by name; of a weld the largest of its six."""
        names = tuple(dict.fromkeys(row.text for row in told_rows(self.system)))
        return Named("residual", names, lambda name: self._evaluations["residuals"][name])

    @property
    def conditions(self) -> Array:
        """How hard a programme is (N,): the largest singular value of G in the run over the smallest at a sample."""
        return self._evaluations["conditions"] if programmes_of(self.scene) else read_only(np.zeros(0))

    def centre_of_pressure(self, *names: str) -> Array:
        """Return where contacts press together (N, 3) [m], nan where none does: by name, or by a pattern as "left_*".

        Of one weld, `weld:left_foot`: where its force meets the surface frame's horizontal plane through the frame's origin
        without a moment in it. Raises TrajectoryError for names that are none.
        """
        if len(names) == 1 and names[0].startswith("weld:"):
            wrench, place = self.reactions[names[0]], self.position(names[0].removeprefix("weld:"))
            with np.errstate(invalid="ignore", divide="ignore"):
                off = np.column_stack([-wrench[:, 4], wrench[:, 3], np.zeros(len(place))]) / wrench[:, 2:3]
            return read_only(place + np.where(wrench[:, 2:3] == 0.0, np.nan, off))
        known = contacts_named(self.system.points, names)
        return read_only(centre_of_pressure(known, self.t, self._place_of, self.reactions, plane=False))

    def _place_of(self, point: ContactPoint) -> Array:
        return self.position(point.contact.point)

    @cached_property
    def lowest_gaps(self) -> Mapping[str, float]:
        """The lowest gap [m] of each contact, below 0 inside."""
        places = {point.name: self.position(point.contact.point) for point in self.system.points}
        return lowest_gaps(self.system, self.stretches, self.t, places)

    def power(self, name: str) -> Array:
        """Power (N,) [W] of a force: the rate of its work."""
        self.controls[name]  # explains a wrong name
        return self._evaluations["powers"][name]

    @property
    def work_by_force(self) -> dict[str, Array]:
        """Work (N,) [J] done by each force, and lost in dampers (`dissipation`)."""
        return {name: self.work[:, k] for k, name in enumerate(self.system.work_names)}

    @cached_property
    def _evaluations(self) -> dict[str, Any]:
        start = robot_start(self.system, self.t0).state if self.t[0] != self.t0 else State(self.q[0], self.v[0])
        taken = self.t, self.states, self.inputs
        return robot_histories(self.system, taken, self.stretches, start, self.status == "failed")

    @cached_property
    def _energies(self) -> dict[str, Array]:
        space = RobotWorkspace(self.system)
        kinetic, potential, spring = np.array([space.energies(q, v) for q, v in zip(self.q, self.v, strict=True)]).T
        total = kinetic + potential + spring
        works = self.work_by_force
        lost = works.get(DAMPERS, np.zeros(len(total)))
        work = sum((done for name, done in works.items() if name != DAMPERS), np.zeros(len(total)))
        balance = total - total[0] - (work - work[0]) + (lost - lost[0])
        return dict(zip(ENERGIES, map(read_only, (kinetic, potential, spring, total, work, lost, balance)), strict=True))

    def looked_through(self) -> tuple[str, ...]:
        """Look for contradictions in what was recorded, and return them in sentences."""
        found = [*of_energy(self._energies, self.run), *of_steps(self.scene, self.run, self.t)]
        held = {name: (row.position, row.velocity) for name, row in self.residuals.items() if name in self.reactions}
        rates = float(np.abs(self._coordinates[1]).max(initial=0.0))
        return (*found, *(of_rows(held, rates, self.run) if held else ()))

    @cached_property
    def shares(self) -> dict[str, float]:
        """The largest share of each limit that the URDF tells: `effort:T_elbow_joint`, `speed:elbow_joint`, `range:elbow_joint`.

        A share of a range is the distance from its middle over half of it: beyond 1 the joint is beyond its limit.
        """
        model, names, found = self.mechanism.model, self.mechanism.names, {}
        known = set(self.controls)
        every = self.system.own.forces
        for force, limit in zip(every, effort_limits(self.mechanism, every).tolist(), strict=True):
            if np.isfinite(limit) and force.name in known:
                found[f"effort:{force.name}"] = largest(self.controls[force.name]) / limit
        for force in names.forces.values():
            if not force.joint:
                continue
            joint = model.joints[force.joint]
            fast = float(model.upperVelocityLimit[joint.idx_v])
            low, high = float(model.lowerPositionLimit[joint.idx_q]), float(model.upperPositionLimit[joint.idx_q])
            if 0.0 < fast < NO_LIMIT:
                found[f"speed:{force.along}"] = largest(self.v[:, joint.idx_v]) / fast
            if -NO_LIMIT < low < high < NO_LIMIT and high - low < 1e3:
                found[f"range:{force.along}"] = largest(self.q[:, joint.idx_q] - 0.5 * (low + high)) / (0.5 * (high - low))
        return found

    def columns(self, points: bool = False, hinges: bool = False) -> Iterator[Column]:
        """Yield the columns of `to_pandas`; `points` adds all frames and the centre of mass. Hinges are those of links alone."""
        names, signals = self.mechanism.names, self.mechanism.signals
        yield Column("t", "s", self.t)
        for name in names.known:
            yield Column(name, names.find(name).unit, self[name])
        for name in ENERGIES:
            yield Column(name, "J", self[name])
        for name in signals:
            yield Column(name, signals.unit(name), self[name])
        units = {force.name: force.unit for force in self.system.own.forces} | {drive.force: "N" for drive in self.system.drives}
        for name, values in self.controls.items():
            yield Column(name, units[name], values)
        for name, values in self.reactions.items():
            if values.ndim == 1:
                unit = "N" if name.startswith("edge:") or name == "friction" else SNOW.get(name, "")
                yield Column(name, unit, values)
            else:
                for k, axis in enumerate(WRENCH if values.shape[1] > 3 else FORCE):
                    yield Column(f"{name}.{axis}", "N" if k < 3 else "N m", values[:, k])
        for name, residual in self.residuals.items():
            if residual.position is not None:
                yield Column(f"residual:{name}", "", residual.position)
            yield Column(f"residual_dot:{name}", "m/s" if name == "knife_edge" else "", residual.velocity)
        if points:
            places = [place for place in [*self.mechanism.frames, "com"] if place not in ("universe",)]
            for place in dict.fromkeys(places):
                for axis in "xyz":
                    yield Column(f"{place}.{axis}", "m", self[f"{place}.{axis}"])

    def save(self, path: str | Path) -> Path:
        """Write the trajectory with its scene; `load_trajectory` reads it. A wrapped pinocchio.Model has no scene to write."""
        if self.mechanism.given is not None:
            why = "a run of a wrapped pinocchio.Model has no scene that could be stored; save_csv writes its columns"
            raise TrajectoryError(f"{path}: {why}")
        return super().save(path)

    def summary(self) -> str:
        """Return what a user wants to know of the run in a few lines."""
        from vlmb.simulation.robot_summary import summarize_robots

        programme = self._evaluations["report"] if programmes_of(self.scene) else ""
        if programme:
            programme += f"; condition of G up to {np.fmax.reduce(self.conditions, initial=0.0):.4g}"
        return summarize_robots(self, programme)

    def __repr__(self) -> str:
        parts = [f"{len(self)} samples, {self.message.rstrip('.')}", *(f"DOUBT: {doubt}" for doubt in self.doubts)]
        parts += [self.mechanism.names.shown]
        for what, mapping in (("controls", self.controls), ("reactions", self.reactions)):
            parts += [f"{what} {listed(tuple(mapping))}"] if mapping else []
        return f"<Trajectory of {self.scene.name!r}: {'; '.join(parts)}>"
