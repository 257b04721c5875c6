"""The mechanism: the joints and bodies generated from a scene, with index maps and what was left out; a Pinocchio model of them.

    hinge (ball) -- lower segment (prismatic x) -- [ rod ] -- upper segment (prismatic x) -- tip

A fixed segment makes no joint; a free upper segment on which nothing hangs makes none either. A prescribed one always does: its
length and rate are seen in points and rows, whether it carries a mass or not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from vlmb.errors import SceneError
from vlmb.model import coordinates as chart
from vlmb.model.display import Displayed
from vlmb.model.frozen import Remade
from vlmb.model.laws import parse_of_time
from vlmb.model.layout import BASE_COORDINATES, LIFTED, Coordinate, Layout, LinkIndex, SegmentIndex, State
from vlmb.model.names import POINTS, Names, counted
from vlmb.model.parts import JOINTS, ORIGIN, Body, Joint, Part, Place, Point, make_model
from vlmb.model.reading import Postures, postures
from vlmb.model.signals import Signals, signals_of
from vlmb.scene.by_phase import numbers_of
from vlmb.scene.expressions import evaluate
from vlmb.scene.places import on_rod
from vlmb.scene.scene import Scene, as_scene
from vlmb.scene.tables import BASE, Segment

# A thin rod has no axial inertia, and a ball joint then a singular matrix. Without axial torque any positive value
# gives the thin rod's motion; this multiple of the inertia about the hinge keeps the matrix well conditioned.
AXIAL_RATIO = 1.0
NO_INERTIA = 1.0  # [kg m^2] in its place for a link that has none about its hinge


@dataclass(frozen=True)
class Mechanism(Remade, Displayed):
    """What `build` makes of a scene. It is never changed: whoever computes brings the scratch space (`make_data`)."""

    scene: Scene
    parts: tuple[Part, ...]  # of the model, in the order in which it takes them
    layout: Layout
    left_out: tuple[str, ...]
    warnings: tuple[str, ...]
    massless: tuple[str, ...] = ()  # what moves without inertia, so that ideal rows must hold it

    def __repr__(self) -> str:
        parts = [f"{self.scene.base.kind} base", self.names.shown]
        parts += [f"{counted(len(self.warnings), 'warning')}"] if self.warnings else []
        return f"<Mechanism of {self.scene.name!r}: {'; '.join(parts)}>"

    def __hash__(self) -> int:
        return hash(self.scene)

    @cached_property
    def model(self) -> Any:
        """The pinocchio.Model; made when first needed: the core runs without it."""
        return make_model(self.scene.name, self.scene.surface_gravity, self.parts)

    @property
    def frames(self) -> Mapping[str, int]:
        """Frame ids of the model by the name of a point, `legs.tip`, and of the ski."""
        return {frame.name: at for at, frame in enumerate(self.model.frames) if frame.type == pin.FrameType.OP_FRAME}

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """The paper's coordinates in this scene: `x y phi0`, then `phi1 psi1 xi1_1 xi1_2`, ..."""
        return self.layout.names

    @cached_property
    def names(self) -> Names:
        """Every name that equations, forces, tables and figures of this mechanism may use."""
        return Names(self.layout, tuple(leg.name for leg in self.scene.legs))

    @property
    def signals(self) -> Signals:
        """The measured data of the scene."""
        return signals_of(self.scene)

    def postures(self, state: tuple[Any, Any]) -> Postures:
        """Return where every point is, and how it moves, at one state (q, v) or many (samples first)."""
        return postures(self.scene, self.layout, state[0], state[1])

    def segment(self, coordinate: Coordinate) -> Segment:
        """Return what the scene says of the segment whose length a coordinate is."""
        return self.scene.links[coordinate.link].segment(coordinate.segment)

    def state(self, coordinates: Mapping[str, float], rates: Mapping[str, float] | None = None) -> State:
        """Turn all coordinates, and rates (`phi1_dot`; missing ones 0), into Pinocchio's (q, v).

        Raises SceneError naming a missing, unknown or non-finite coordinate.
        """
        coordinates = self.names.canonical(coordinates, "coordinates")
        return chart.make_state(self.layout, coordinates, self.names.canonical(rates or {}, "rates"))

    def coordinates(self, state: tuple[Any, Any], near: Mapping[str, float] | None = None) -> dict[str, float]:
        """Read coordinates and rates of a state (q, v), angles on the branch nearest to `near`."""
        reference = None
        if near is not None:
            near = self.names.canonical(near, "near")
            reference = np.array([near.get(name, 0.0) for name in self.layout.names])
        values, rates = chart.read_coordinates(self.layout, np.asarray(state[0]), np.asarray(state[1]), reference)
        named = dict(zip(self.layout.names, values.tolist(), strict=True))
        return named | {f"{name}_dot": rate for name, rate in zip(self.layout.names, rates.tolist(), strict=True)}

    def position(self, state: tuple[Any, Any], link: str, point: str = "tip") -> np.ndarray:
        """Position (3,) [m] of a link's hinge, rod_start, rod_end or tip in the surface frame."""
        return self.position_of(self.postures(state), link, point)

    def position_of(self, postures: Postures, link: str, point: str = "tip") -> np.ndarray:
        """Position (..., 3) [m] of a point of a link in given postures."""
        if link not in self.names.links or point not in POINTS:
            known = ", ".join(f"{name}.{which}" for name in self.names.links for which in POINTS)
            raise SceneError(f"unknown point {f'{link}.{point}'!r}; points: {known}")
        return np.array(postures.position(self.names.links[link], point))


def build(scene: Scene | str | Path | Mapping[str, Any]) -> Mechanism:
    """Generate the mechanism of a scene: of a Scene, the path of a scene file or a dict with its keys.

    Raises SceneError where the scene has a motion without mass, and no ideal rows that might hold it, and for one with robots.
    """
    scene = as_scene(scene)
    if scene.robots:
        raise SceneError("robots: this is there for scenes of links alone; of robots there are simulate, check and build")
    builder = _Builder(scene)
    layout = builder.layout()
    lists = (builder.left_out, builder.warnings, builder.massless)
    return Mechanism(scene, tuple(builder.parts), layout, *(tuple(sentences) for sentences in lists))


class _Builder:
    """Adds joints depth-first: whatever the scene's order, a subtree is finished before the next begins."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.parts: list[Part] = []
        self.joints, self.nq, self.nv = 0, 0, 0  # so far
        self.left_out: list[str] = []
        self.warnings: list[str] = []
        self.massless: list[str] = []
        self.links: dict[int, LinkIndex] = {}
        self.order: list[int] = []
        self.names = [link.name for link in scene.links]
        self.places = {name: i for i, name in enumerate(self.names)}
        self.children: dict[tuple[str, str], list[int]] = {}  # on the "tip" or on the "rod" of a link, or on the base
        self.on_rod: dict[int, float] = {}  # [m] from the start of the parent's rod
        for i, link in enumerate(scene.links):
            place = None if link.parent == BASE else on_rod(scene.links[self.places[link.parent]], link.parent_point)
            self.children.setdefault((link.parent, "tip" if place is None else "rod"), []).append(i)
            if place is not None:
                self.on_rod[i] = place
        for hanging in self.children.values():
            hanging.sort(key=lambda i: self.on_rod.get(i, 0.0))
        self.carried = [self._carried(i) for i in range(len(scene.links))]
        base = self._add_base()
        for first in self.children.get((BASE, "tip"), []):
            self._add_link(first, base, scene.links[first].anchor or ORIGIN)
        self._look_for_straight_legs()

    def layout(self) -> Layout:
        links = tuple(self.links[i] for i in range(len(self.links)))
        plane = self.scene.plane
        base = LIFTED if self.scene.base.lift else BASE_COORDINATES[self.scene.base.kind]
        if self.scene.base.kind == "free" and plane:
            base = ("x", "z")
        coordinates = [Coordinate(name, name, -1) for name in base]
        for i, link in enumerate(links):
            if not plane:
                coordinates.append(Coordinate(f"phi{i + 1}", "phi", i))
            coordinates.append(Coordinate(f"psi{i + 1}", "psi", i))
            for which, segment in ((1, link.lower), (2, link.upper)):
                if segment.joint:
                    coordinates.append(Coordinate(f"xi{i + 1}_{which}", "xi", i, which))
        for coordinate in coordinates:
            for name in (coordinate.name, f"{coordinate.name}_dot"):
                if name in self.scene.parameters:
                    raise SceneError(f"parameters.{name}: a coordinate of this scene has this name; choose another")
        return Layout(
            self.scene.base.kind, plane, self.nq, self.nv, links, tuple(self.order), tuple(coordinates), self.scene.base.lift,
        )

    def _carried(self, i: int) -> float:
        """Mass [kg] at and beyond the tip of link i (paper.md 9: M_i^+, for a tree)."""
        link = self.scene.links[i]
        return link.tip_mass + sum(self._mass_of(child) for child in self.children.get((link.name, "tip"), []))

    def _mass_of(self, i: int) -> float:
        stack, total = [i], 0.0
        while stack:
            link = self.scene.links[stack.pop()]
            total += link.rod.mass + link.tip_mass
            for place in ("tip", "rod"):
                stack += self.children.get((link.name, place), [])
        return total

    def _add_base(self) -> int:
        base = self.scene.base
        if base.kind == "ski":
            ski = self._joint(0, "planar", ORIGIN, "ski")[0]
            ski = self._joint(ski, "z", ORIGIN, "ski_z")[0] if base.lift else ski
            inertia = (0.0, base.inertia, base.inertia)  # only the vertical axis is ever used
            self.parts.append(Body(ski, base.mass, (base.com_offset, 0.0, 0.0), inertia, ORIGIN))
            self.parts.append(Point("ski", ski, ORIGIN))
            return ski
        if base.kind == "free":
            if self.scene.plane:
                flying = self._joint(self._joint(0, "x", ORIGIN, "base_x")[0], "z", ORIGIN, "base_z")[0]
            else:
                flying = self._joint(0, "translation", ORIGIN, "base")[0]
            if base.mass:
                self.parts.append(Body(flying, base.mass, ORIGIN, ORIGIN, ORIGIN))
            return flying
        return 0

    def _joint(self, parent: int, kind: str, at: Place, name: str) -> tuple[int, int, int]:
        """Add a joint; return its number and where it begins in q and v."""
        self.parts.append(Joint(parent, kind, at, name))
        self.joints += 1
        made = self.joints, self.nq, self.nv
        self.nq, self.nv = self.nq + JOINTS[kind][1], self.nv + JOINTS[kind][2]
        return made

    def _add_link(self, first: int, parent_joint: int, at: Place) -> None:
        stack = [(first, parent_joint, at)]
        while stack:  # no recursion: chains may be long
            i, joint, offset = stack.pop()
            hanging = self._add_one(i, joint, offset)
            stack += reversed(hanging)

    def _add_one(self, i: int, parent_joint: int, at: Place) -> list[tuple[int, int, Place]]:
        link = self.scene.links[i]
        hinge, at_q, at_v = self._joint(parent_joint, "hinge" if self.scene.plane else "ball", at, link.name)
        self.parts.append(Point(f"{link.name}.hinge", hinge, ORIGIN))
        lower, rod_joint, rod_at = self._add_segment(i, 1, hinge, 0.0)
        self.parts.append(Point(f"{link.name}.rod_start", rod_joint, _along(rod_at)))
        transverse = link.rod.transverse_inertia
        self._refuse_massless(i, rod_at if rod_joint == hinge else lower.length)
        axial = 0.0 if self.scene.plane else AXIAL_RATIO * (self._hinge_inertia(i, lower.length) or NO_INERTIA)
        # a moving rod's inertia and all it carries have the axis of the link in common: any body may hold the axial part
        inertia = (0.0, transverse, transverse)
        self.parts.append(Body(rod_joint, link.rod.mass, _along(link.rod.centre), inertia, _along(rod_at)))
        if axial:
            self.parts.append(Body(hinge, 0.0, ORIGIN, (axial, 0.0, 0.0), ORIGIN))
        end_at = rod_at + link.rod.length
        self.parts.append(Point(f"{link.name}.rod_end", rod_joint, _along(end_at)))
        upper, tip_joint, tip_at = self._add_segment(i, 2, rod_joint, end_at)
        self.parts.append(Point(f"{link.name}.tip", tip_joint, _along(tip_at)))
        if link.tip_mass:
            self.parts.append(Body(tip_joint, link.tip_mass, ORIGIN, ORIGIN, _along(tip_at)))
        parent = self.places.get(link.parent, -1)
        point = "tip" if parent < 0 else "rod" if isinstance(link.parent_point, float) else link.parent_point
        self.links[i] = LinkIndex(
            link.name, parent, point, link.rod.length, hinge, at_q, at_v, lower, upper, self.on_rod.get(i, 0.0),
            link.anchor or (0.0, link.aside, 0.0),
        )  # fmt: skip
        self.order.append(i)
        hanging = [(child, tip_joint, self._place_of(child, tip_at)) for child in self.children.get((link.name, "tip"), [])]
        on_it = self.children.get((link.name, "rod"), [])
        return hanging + [(child, rod_joint, self._place_of(child, rod_at + self.on_rod[child])) for child in on_it]

    def _place_of(self, child: int, along: float) -> Place:
        """Return where a link hangs in its parent's frame: so far along it, and aside."""
        return along, self.scene.links[child].aside, 0.0

    def _add_segment(self, i: int, which: int, joint: int, at: float) -> tuple[SegmentIndex, int, float]:
        """Add a segment at distance `at` along a joint's x axis; return it and where what follows it sits."""
        link, segment = self.scene.links[i], self.scene.links[i].segment(which)
        length = start_length(self.scene, segment, f"links[{i}].{'lower' if which == 1 else 'upper'}.law")
        loose = segment.motion == "free" and which == 2 and not self.carried[i]
        if loose:
            self.left_out.append(
                f"xi{i + 1}_2, the upper segment of {link.name!r}: nothing hangs on it; drawn with its length {length:g} m"
            )
        elif segment.motion == "fixed":
            side = "lower" if which == 1 else "upper"
            self.left_out.append(f"xi{i + 1}_{which}, the {side} segment of {link.name!r}: fixed at {length:g} m")
        else:
            name = f"{link.name}.{'lower' if which == 1 else 'upper'}"
            new, at_q, at_v = self._joint(joint, "x", _along(at), name)
            return SegmentIndex(segment.motion, length, new, at_q, at_v), new, 0.0
        return SegmentIndex("fixed", length, loose=loose), joint, at + length

    def _hinge_inertia(self, i: int, lower: float) -> float:
        """Inertia [kg m^2] of a link and all it carries at its tip, about its hinge, at the start lengths (J_i of paper.md 9)."""
        link = self.scene.links[i]
        upper = start_length(self.scene, link.upper, f"links[{i}].upper.law")
        reach = lower + link.rod.length + upper
        inertia = link.rod.transverse_inertia + link.rod.mass * (lower + link.rod.centre) ** 2 + self.carried[i] * reach**2
        for child in self.children.get((link.name, "rod"), []):
            inertia += self._mass_of(child) * (lower + self.on_rod[child]) ** 2
        return inertia

    def _refuse_massless(self, i: int, lower: float) -> None:
        link = self.scene.links[i]
        if not self._mass_of(i) > 0.0:
            self._require_rows(f"links[{i}] ({link.name!r}) and all that hangs on it have no mass: give rod.mass or tip_mass")
        elif not self._hinge_inertia(i, lower) > 0.0:
            self._require_rows(
                f"links[{i}] ({link.name!r}): all its mass sits in its hinge, so nothing resists turning; "
                "give the rod a length or an inertia, or move tip_mass away from the hinge"
            )

    def _require_rows(self, sentence: str) -> None:
        """Note what ideal rows must hold; without any raise SceneError."""
        if not self.scene.constraints:
            raise SceneError(sentence)
        self.massless.append(sentence)

    def _look_for_straight_legs(self) -> None:
        """Name massless hinges between two free segments (a motion without inertia when the two links line up)."""
        first = self.children.get((BASE, "tip"), [])
        flying = self.scene.base.kind == "free" and not self.scene.base.mass
        if flying and len(first) == 1 and self.links[first[0]].lower.motion == "free":
            self._require_rows(
                f"base: the first hinge flies without mass, and the lower segment of {self.names[first[0]]!r} is free, so "
                "the hinge slides along it without inertia: give base.mass [kg], or fix that segment"
            )
        if flying and len(first) > 1 and all(self.links[child].lower.motion == "free" for child in first):
            names = " and ".join(repr(self.names[child]) for child in first)
            self.warnings.append(
                f"the flying hinge of {names} has no mass and free segments on all sides: the mass matrix is singular whenever "
                "they line up; give base.mass [kg], or fix one of the segments"
            )
        for i, link in enumerate(self.scene.links):
            loaded = (link.name, "rod") in self.children
            if not link.rod.mass and not loaded and self.links[i].lower.motion == self.links[i].upper.motion == "free":
                self._require_rows(
                    f"links[{i}] ({link.name!r}): its rod has no mass and both its segments are free, so one slides against the "
                    "other without inertia: give rod.mass, or fix one of the segments"
                )
            hanging = self.children.get((link.name, "tip"), [])
            slides = all(self.links[child].lower.motion == "free" for child in hanging)
            if hanging and not link.tip_mass and self.links[i].upper.motion == "free" and slides:
                others = " and ".join(repr(self.names[child]) for child in hanging)
                self.warnings.append(
                    f"the hinge between {link.name!r} and {others} has no mass and free segments on both sides: the mass "
                    f"matrix is singular whenever they line up; give {link.name!r} a tip_mass or fix one of the segments"
                )


def start_length(scene: Scene, segment: Segment, key: str) -> float:
    """Length [m] of a segment at the start: given, or the law's value at t = 0."""
    if segment.motion != "prescribed":
        return float(segment.length or 0.0)
    signals = signals_of(scene)
    numbers = numbers_of(scene)
    law = parse_of_time(0.0 if segment.law is None else segment.law, [*numbers, *signals], key)
    return evaluate(law, {"t": 0.0, **numbers, **signals.at(law.names, 0.0)})


def _along(distance: float) -> Place:
    return distance, 0.0, 0.0
