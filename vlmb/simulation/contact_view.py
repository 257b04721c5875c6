"""What is read of contacts at the state that a run in phases has reached."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vlmb.scene.by_phase import acting
from vlmb.scene.contacts import condition_of
from vlmb.scene.expressions import evaluate
from vlmb.scene.tables import BASE
from vlmb.simulation.motion import Motion
from vlmb.system.cone import Grip
from vlmb.system.contacts import CLOSED, STANDING, ContactLook, ContactPoint, Footing
from vlmb.system.core_engine import CoreEngine
from vlmb.system.engines import make_engine
from vlmb.system.forces import Control, StateView
from vlmb.system.legs import LegPoint
from vlmb.system.pinocchio_engine import PinocchioEngine
from vlmb.system.probe import Answers, Probe
from vlmb.system.programme import total_mass
from vlmb.system.ski_contact import Heading, ski_frame
from vlmb.system.system import System

Array = NDArray[np.float64]
Engine = CoreEngine | PinocchioEngine


class PhaseSystems:
    """The systems of the phases of one run: each set of closed contacts is compiled once, unless laws go by `phase_t`."""

    def __init__(self, system: System, engine: str) -> None:
        self.system, self.scene = system, system.mechanism.scene
        self.timed = system.by_phase_time
        self.kept = engine == "core" and not self.timed
        self.swinging = any("phase_t" in str(leg.attack) for leg in self.scene.legs)  # gaps that go by when a leg let go
        shared = system.of_phases if self.kept else None
        self.made: dict[object, System] = {} if shared is None else shared.systems
        self.probes: dict[object, Probe] = {} if shared is None or self.scene.legs else shared.probes

    def of(self, footings: Sequence[Footing], began: float) -> System:
        """Return the system of a phase that began at a time [s]."""
        if not self.kept:
            return self.system.phase(footings, began=began)
        states = tuple(point.mode(at) for point, at in zip(self.system.points, footings, strict=True))
        if states not in self.made:
            self.made[states] = self.system.phase(footings)
        made = self.made[states]
        assert made.contacts is not None
        return made if made.contacts.footings == tuple(footings) else made.placed(footings)

    def probe(self, bare: bool, began: float, closed: Collection[str], footings: Sequence[Footing]) -> Probe:
        """Return what answers for contacts, under what acts while some are closed, and under the springs of legs that stand."""
        pushing = () if bare else tuple(k for k, at in enumerate(footings) if at.state == STANDING)
        acts = acting(self.scene, closed)
        bare = bare or (self.kept and not (pushing or any(acts) or self.system.forces.inputs))  # where nothing acts
        key = bare, None if bare else acts, began if self.timed else None, pushing
        moved = bool(pushing) or self.swinging
        if key not in self.probes or (moved and not self.kept):
            if self.timed:
                self.probes.clear()
            self.probes[key] = Probe(self.system, self.system.engine, bare, began, footings, closed)
        elif moved:
            self.probes[key].place(footings)
        return self.probes[key]


class ContactView:
    """Places, speeds, forces and answers of contacts at (t, y)."""

    def __init__(
        self, system: System, y: Array, start: float, branch: Sequence[float], control: Control | None
    ) -> None:
        self.system, self.points, self.control = system, system.points, control
        self.t, self.y, self.branch = start, np.array(y), list(branch)
        self.systems = PhaseSystems(system, system.engine)
        self.standing: tuple[Footing, ...] = tuple(Footing(since=start) for _ in self.points)  # while they are looked at
        self.weight = total_mass(system.mechanism) * (system.mechanism.scene.gravity or 1.0) or 1.0
        self.works, self.plane = len(system.work_names), system.mechanism.scene.plane
        self.conditions = [
            condition_of(p.contact.when, f"contacts[{p.index}].when") if p.contact.when else None for p in self.points
        ]
        self.known: dict[tuple[Probe, float, bytes, tuple[Footing, ...]], Answers] = {}  # the last ones; keys keep their probes
        self.read = self.t, self.y.tobytes(), self.branch, self.branch  # what coordinates were read of last, near which, and they
        self.began = start  # of the phase under way
        self.mover: Engine | None = None  # of the phase under way

    def _mover(self, footings: Sequence[Footing]) -> Engine:
        return make_engine(self.systems.of(footings, self.began), self.branch, self.control)

    def _without_forces(self, y: Array) -> Answers:
        """Answer for all contacts without forces and a programme: for impulses."""
        return self._answer(self.systems.probe(True, self.t, (), self.standing), y)

    def _under_forces(self, y: Array, closed: Collection[str]) -> Answers:
        """Answer for all contacts under what acts while some are closed, as a phase that begins now."""
        return self._answer(self.systems.probe(False, self.t, closed, self.standing), y)

    def _answer(self, probe: Probe, y: Array) -> Answers:
        key = probe, self.t, y.tobytes(), self.standing
        if key not in self.known:
            given: Sequence[float] = ()
            if probe.given:
                mover = self.mover or self._mover([Footing()] * len(self.points))
                given = mover.inputs_at(self.t, y)
            self.known = dict([*self.known.items()][-3:])
            self.known[key] = self._on_legs(probe.at(self.t, y, self._branch_at(y), self.works, given))
        return self.known[key]

    def _on_legs(self, found: Answers) -> Answers:
        """Write the gaps of legs that stand into answers."""
        for point, footing in zip(self.points, self.standing, strict=True):
            if isinstance(point, LegPoint) and point.closed(footing):
                found.jets[point.index, 3] = point.gap_jet(self.t, found.jets[point.index], footing)
        return found

    def _branch_at(self, y: Array) -> list[float]:
        """Return the coordinates of a state, near those of the last sample."""
        t, state, near, found = self.read
        if near is not self.branch or t != self.t or state != y.tobytes():
            motion = Motion(self.system, self.system.engine, np.array([self.t]), y[None], np.array([self.branch]), self.began)
            found = motion.coordinates[0][0].tolist()
            self.read = self.t, y.tobytes(), self.branch, found
        return found

    def _frame(self, k: int) -> Array:
        """Return the rows across the surface and its normal, (3, 3) or (2, 3) in the plane, where a contact is."""
        edge = self.points[k].edge
        if edge is not None:
            frame = ski_frame(self._heading())
            return frame if edge.friction else frame[[0, 2]]  # smooth along: no row there
        place = self._without_forces(self.y).jets[k, :3, 0]
        frame, _ = self.points[k].frame(self.t, place, self.plane, self.standing[k])
        return frame[[0, 2]] if self.plane else frame

    def _heading(self) -> Heading:
        """Return the heading of the ski."""
        phi0 = self._view(self.y)["phi0"]
        return math.cos(phi0), math.sin(phi0)

    def _gap(self, point: ContactPoint, jet: Array) -> float:
        """Return the distance [m] from a surface: its value over its slope."""
        return float(jet[3, 0]) / self._size(point, jet)

    def _size(self, point: ContactPoint, jet: Array) -> float:
        return point.steepness(self.t, jet[:3, 0], self.standing[point.index])[1]

    def _local(self, jet: Array, k: int, frame: Array, order: int = 1) -> Array:
        """Return velocity (order 1) or acceleration (2) of a contact over its surface, across it and away from it."""
        point = self.points[k]
        moving = np.array(point.contact.surface_velocity) if order == 1 else np.zeros(3)
        found = frame @ (jet[:3, order] - moving)
        if point.edge is not None and order == 2:  # its axes turn with it
            turning = self._view(self.y)["phi0_dot"]
            along, aside = frame[0, 1] * jet[0, 1] - frame[0, 0] * jet[1, 1], float(frame[0] @ jet[:3, 1])
            found[:-1] += turning * np.array([-along, aside])[: len(frame) - 1]
        found[-1] = jet[3, order] / self._size(point, jet)
        return found

    def _forces(self, look: ContactLook, footings: Sequence[Footing]) -> dict[int, Array]:
        """Return friction (2 or 1 rows across) and normal force [N] of closed contacts: (3,) friction x, friction y, normal."""
        found, at = {}, len(self.system.mechanism.scene.constraints)
        for point, footing in zip(self.points, footings, strict=True):
            if footing.state in CLOSED:
                force = look.ground
                if not footing.planted:
                    h = self._heading() if point.edge is not None else (1.0, 0.0)
                    rows = point.row_vectors(footing, point.slope(self.t, look.jets[point.index, :3, 0], footing), h)
                    force = look.multipliers[at : at + len(rows)] @ rows
                    at += len(rows)
                local = self._frame(point.index) @ force
                flat = np.zeros(2)
                flat[: len(local) - 1] = local[:-1]
                found[point.index] = np.array([*flat, local[-1]])
        return found

    def _view(self, y: Array) -> StateView:
        motion = Motion(self.system, self.system.engine, np.array([self.t]), y[None], np.array([self.branch]), self.began)
        return StateView(self.system.mechanism, self.t, motion.postures.sample(0), self.branch)

    def _allows(self, point: ContactPoint, y: Array) -> bool:
        """Whether a contact's `when` is true, or it has none."""
        condition = self.conditions[point.index]
        if condition is None:
            return True
        view = self._view(y)
        return evaluate(condition.expression, {name: view[name] for name in condition.expression.names}) > 0.0

    def _angle_to(self, point: ContactPoint) -> float | None:
        """Return the elevation [rad] of the link that a contact is a point of; of a free base that of its first link."""
        links, owner = self.system.mechanism.names.links, point.contact.point.partition(".")[0]
        link = links.get(next(iter(links), "") if owner == BASE else owner)
        if link is None:
            return None
        layout = self.system.mechanism.layout
        return float(self._view(self.y)[layout.coordinates[layout.place("psi", link)].name])

    def _problem(
        self, taking: Sequence[int], frames: Mapping[int, Array]
    ) -> tuple[Array, list[tuple[int, tuple[tuple[int, ...], ...]]]]:
        """Return what takes forces along x, y, z at all contacts to rows across and along the normals of some.

        And the row of each normal, with the rows of its grips.
        """
        turn, first = np.zeros((sum(len(frames[k]) for k in taking), 3 * len(self.points))), 0
        rows = list[tuple[int, tuple[tuple[int, ...], ...]]]()
        for k in taking:
            after = first + len(frames[k])
            turn[first:after, 3 * k : 3 * k + 3] = frames[k]
            across = tuple(range(first, after - 1))
            grips: list[tuple[int, ...]] = [across] if self.points[k].edge is None else [(at,) for at in across]
            rows.append((after - 1, tuple(grips)))
            first = after
        return turn, rows

    def _grips(
        self, k: int, rows: Sequence[tuple[int, ...]], sliding: Sequence[Array | None], leaving: Sequence[bool]
    ) -> tuple[Grip, ...]:
        """Return the grips of a contact: how it slides already, and which of them let go now."""
        point = self.points[k]
        holds = [(point.at_rest, point.coefficient)]
        if point.edge is not None:
            holds = [(point.edge.hold, point.edge.skid), (point.edge.friction, point.edge.friction)]
        return tuple(
            Grip(across, 0.0 if goes else hold, slip, None if way is None else tuple(way.tolist()))
            for across, (hold, slip), way, goes in zip(rows, holds, sliding, leaving, strict=False)
        )
