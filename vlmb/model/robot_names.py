"""The vocabulary of a scene with robots: coordinates of joints, roots and links, frames, headings, the centre of mass; forces.

`leg_left_4_joint`, `root.x` ... `root.yaw`, `left_foot.x`, `left_foot.axis_z.x`, `left_foot.heading`, `com.z`, and of links that
hang on a robot what links have elsewhere; each has a rate, `_dot`. A robot's name may stand before its joints and frames; it must
where there are several robots. Forces are `T_<joint>`, `R_<frame>.x`, and those of links and of the ski.
"""

from __future__ import annotations

import fnmatch
import itertools
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

from vlmb.core import readings as core
from vlmb.errors import SceneError, nearest
from vlmb.model.names import AXES, DOT, SHOWN
from vlmb.model.robot_model import HINGES, Robots
from vlmb.scene.names import listed

PLACES_OF_ROOT = ("x", "y", "z", "roll", "pitch", "yaw")
LISTED = 4000  # names that a message looks through
Row = tuple[int, int, int, int]
Value = TypeVar("Value")


@dataclass(frozen=True)
class RobotQuantity:
    """Something that can be read of a motion, and how the core reads it; `rate`: its rate is meant."""

    name: str
    unit: str  # of the value, or of the rate where that is meant
    row: Row
    offset: float = 0.0
    rate: bool = False
    angle: bool = False

    @property
    def tex(self) -> str:
        """Name as text in TeX."""
        return rf"\mathrm{{{self.name.replace('_', chr(92) + '_')}}}"

    @property
    def symbol(self) -> str:
        """The same for labels of figures."""
        return f"${self.tex}$"


@dataclass(frozen=True)
class RobotForce:
    """A named generalized force and the quantity that it acts along."""

    name: str
    unit: str
    along: str
    joint: int = 0  # of a torque in a robot's joint

    @property
    def symbol(self) -> str:
        """Label for figures."""
        return self.name


@dataclass(frozen=True)
class Coordinate:
    """A coordinate: its name, unit, how it is read, and the joint of the model that it belongs to."""

    name: str
    unit: str
    row: Row
    joint: int
    place: int = 0  # which one of its joint
    whole: str = ""  # with the robot's name


@dataclass(frozen=True)
class RobotNames(Collection[str]):
    """The vocabulary of one mechanism with robots. Iterating gives every name that an equation may use, rates included."""

    robots: Robots
    virtual: Mapping[int, int]  # frame that tells a root's place relative to what it is attached to, by joint

    def __hash__(self) -> int:
        return id(self)

    @cached_property
    def coordinates(self) -> tuple[RobotQuantity, ...]:
        """All coordinates, as quantities."""
        return tuple(RobotQuantity(c.name, c.unit, c.row, angle=c.unit == "rad") for c in self.entries)

    @cached_property
    def entries(self) -> tuple[Coordinate, ...]:
        """All coordinates: of the ski, of the robots' joints, of links."""
        found = [*self._of_ski(), *self._of_robots(), *self._of_links()]
        if len(self.robots.names) == 1:
            prefix, taken = f"{self.robots.names[0]}.", {entry.name for entry in found} | set(self.link_numbers)
            short = [entry.name.removeprefix(prefix) for entry in found]
            found = [
                entry if name in taken and name != entry.name else _renamed(entry, name)
                for entry, name in zip(found, short, strict=True)
            ]
        return tuple(found)

    def _of_ski(self) -> Iterator[Coordinate]:
        if "ski" in self.robots.model.names:
            frame = self.robots.frames["ski"]
            for axis, name in enumerate("xy"):
                yield Coordinate(name, "m", (core.POINT, frame, axis, 0), 1, axis)
            yield Coordinate("phi0", "rad", (core.HEADING, frame, 1, 0), 1, 2)

    def _of_robots(self) -> Iterator[Coordinate]:
        model = self.robots.model
        for joint, name in enumerate(model.names):
            if name.partition(".")[0] not in self.robots.names or not joint:
                continue
            kind = HINGES.get(model.joints[joint].shortname().partition("<")[0])
            if kind is None:
                yield Coordinate(name, self.joint_unit(joint), (core.COORDINATE, joint, 0, 0), joint)
            elif kind == "ball":
                raise SceneError(f"{name}: a ball joint of a robot has no coordinates here; split it into three hinges")
            else:
                frame = self.virtual[joint]
                rows: dict[str, Row] = {axis: (core.POINT, frame, k, 0) for k, axis in enumerate(AXES)}
                rows |= {"roll": (core.ROLL, frame, 0, 0), "pitch": (core.ELEVATION, frame, 1, 0)}
                rows |= {"yaw": (core.HEADING, frame, 1, 0)}
                for place in PLACES_OF_ROOT if kind == "free" else ("x", "y", "yaw"):
                    unit = "m" if place in AXES else "rad"
                    yield Coordinate(f"{name}.{place}", unit, rows[place], joint, PLACES_OF_ROOT.index(place))

    def _of_links(self) -> Iterator[Coordinate]:
        for link, number in self.robots.links:
            yield from self.link_coordinates(link, number)

    def link_coordinates(self, link: str, number: int) -> Iterator[Coordinate]:
        """Coordinates of a link: azimuth, elevation, the segments that move."""
        frame, joint = self.robots.frames[f"{link}.hinge"], self._joint(link)
        yield Coordinate(f"phi{number}", "rad", (core.HEADING, frame, 0, 0), joint, 0)
        yield Coordinate(f"psi{number}", "rad", (core.ELEVATION, frame, 0, 0), joint, 1)
        for which, side in ((1, "lower"), (2, "upper")):
            at = self._joint(f"{link}.{side}")
            if at:
                yield Coordinate(f"xi{number}_{which}", "m", (core.COORDINATE, at, 0, 0), at)

    def _joint(self, name: str) -> int:
        """Return a joint of the model by name; 0 where there is none."""
        model = self.robots.model
        return int(model.getJointId(name)) if model.existJointName(name) else 0

    def joint_unit(self, joint: int) -> str:
        """Return the unit of a joint with one coordinate."""
        return "m" if "JointModelP" in self.robots.model.joints[joint].shortname() else "rad"

    @cached_property
    def index(self) -> dict[str, int]:
        """Position of each coordinate by name."""
        return {entry.name: at for at, entry in enumerate(self.entries)}

    @cached_property
    def link_numbers(self) -> dict[str, int]:
        """Number of each link by name."""
        return dict(self.robots.links)

    @property
    def links(self) -> dict[str, int]:
        """Links by name: their positions among the links."""
        return {link: at for at, (link, _) in enumerate(self.robots.links)}

    @property
    def shown(self) -> str:
        """The coordinates in a line, of many the first ones and how many there are."""
        names = tuple(self.index)
        return " ".join(names if len(names) <= SHOWN else (*names[:SHOWN], f"... ({len(names)})"))

    def __repr__(self) -> str:
        return f"<Names: {self.shown}; robots {listed(self.robots.names)}>"

    @cached_property
    def known(self) -> tuple[str, ...]:
        """Names of coordinates, their rates, and the speed: what a start may give."""
        speed = ("speed",) if "ski" in self.robots.model.names else ()
        return (*self.index, *(f"{name}{DOT}" for name in self.index), *speed)

    def find(self, name: str, where: str = "") -> RobotQuantity:
        """Return the quantity of a name; SceneError with `where` it stands, and with the nearest names."""
        found = self._find(name) if isinstance(name, str) else None
        if found is None:
            raise SceneError(f"{where}{': ' if where else ''}unknown name {name!r:.80}; {self.hint(name)}")
        return found

    def hint(self, name: object) -> str:
        """Say which names come nearest to a wrong one."""
        return nearest(str(name), itertools.islice(self, LISTED))

    def canonical(self, given: Mapping[str, Value], where: str) -> dict[str, Value]:
        """Return values by name with other names replaced by those of the coordinates and rates; unknown names stay."""
        result: dict[str, Value] = {}
        for name, value in given.items():
            quantity = self._find(name) if isinstance(name, str) else None
            plain = quantity.name if quantity else name
            if plain in result:
                raise SceneError(f"{where}.{name}: {plain} is given already, by its other name; remove one")
            result[plain] = value
        return result

    def meaning(self, quantity: RobotQuantity) -> str:
        """Return what a coordinate is of."""
        entry = self.entries[self.index[quantity.name]] if quantity.name in self.index else None
        return "" if entry is None or entry.joint == 0 else self.robots.model.names[entry.joint]

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and self._find(name) is not None

    def __iter__(self) -> Iterator[str]:
        yield from self.known
        places = [f"com.{axis}" for axis in AXES]
        for frame in self.robots.frames:
            owner = frame.partition(".")[0]
            if owner in self.link_numbers and "." in frame:
                places += [f"{frame}.{axis}" for axis in AXES]
            elif owner != "universe":
                places += [f"{frame}.{axis}" for axis in AXES] + [f"{frame}.heading"]
                places += [f"{frame}.axis_{of}.{axis}" for of in AXES for axis in AXES]
        for link in self.link_numbers:
            places += [f"{link}.length", *(f"{link}.direction.{axis}" for axis in AXES)]
        for place in places:
            yield from (place, f"{place}{DOT}")

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def _find(self, name: str) -> RobotQuantity | None:
        plain = name.removesuffix(DOT)
        rate = plain != name
        if name == "speed" and "ski" in self.robots.model.names:
            return RobotQuantity(name, "m/s", (core.SPEED, 0, 0, 0), rate=True)
        entry = self._entry(plain)
        if entry is not None:
            unit = f"{entry.unit}/s" if rate else entry.unit
            return RobotQuantity(entry.name + DOT * rate, unit, entry.row, rate=rate, angle=entry.unit == "rad")
        owner, _, axis = plain.rpartition(".")
        component = AXES.find(axis) if len(axis) == 1 else -1
        metre, one = ("m/s", "1/s") if rate else ("m", "")
        if owner == "com" and component >= 0:
            return RobotQuantity(name, metre, (core.CENTRE_OF_MASS, 0, component, 0), rate=rate)
        if owner in self.link_numbers and axis == "length":
            return self._length(name, owner, metre, rate)
        if axis == "heading" and owner in self.robots.frames:
            row: Row = (core.HEADING, self.robots.frames[owner], 1, 0)
            return RobotQuantity(name, "rad/s" if rate else "rad", row, rate=rate, angle=True)
        if component < 0:
            return None
        if owner in self.robots.frames and owner not in ("universe",):
            return RobotQuantity(name, metre, (core.POINT, self.robots.frames[owner], component, 0), rate=rate)
        frame, _, what = owner.rpartition(".")
        if what == "direction" and frame in self.link_numbers:
            return RobotQuantity(name, one, (core.AXIS, self.robots.frames[f"{frame}.hinge"], component, 0), rate=rate)
        if what.startswith("axis_") and what[5:] in AXES and what[5:] and frame in self.robots.frames:
            row = (core.AXIS, self.robots.frames[frame], component, AXES.index(what[5:]))
            return RobotQuantity(name, one, row, rate=rate)
        return None

    @cached_property
    def _entries_by_name(self) -> dict[str, Coordinate]:
        found = {entry.whole or entry.name: entry for entry in self.entries} | {entry.name: entry for entry in self.entries}
        for link, number in self.robots.links:
            meant = {f"phi{number}": "azimuth", f"psi{number}": "elevation", f"xi{number}_1": "lower", f"xi{number}_2": "upper"}
            found |= {f"{link}.{alias}": found[name] for name, alias in meant.items() if name in found}
        return found

    def _entry(self, name: str) -> Coordinate | None:
        return self._entries_by_name.get(name)

    def _length(self, name: str, link: str, unit: str, rate: bool) -> RobotQuantity:
        lower, upper = self._joint(f"{link}.lower"), self._joint(f"{link}.upper")
        end = self.robots.model.frames[self.robots.frames[f"{link}.{'rod_end' if upper else 'tip'}"]]
        along = float(end.placement.translation[0])
        return RobotQuantity(name, unit, (core.LENGTH, lower, 0, upper), along, rate)

    # Forces

    @cached_property
    def forces(self) -> Mapping[str, RobotForce]:
        """Every generalized force that belongs to a coordinate, by name."""
        found: dict[str, RobotForce] = {}
        for entry in self.entries:
            model_name = self.robots.model.names[entry.joint]
            if model_name.partition(".")[0] in self.robots.names:
                if entry.row[0] == core.COORDINATE:
                    name = f"T_{entry.name}"
                    found[name] = RobotForce(name, "N m" if entry.unit == "rad" else "N", entry.name, entry.joint)
            elif entry.name in self.robots.driven:
                continue  # this force is a result
            elif entry.name.startswith("xi"):
                name = f"F{entry.name.removeprefix('xi')}"
                found[name] = RobotForce(name, "N", entry.name)
            else:
                letter = "F" if entry.unit == "m" else "M"
                found[f"{letter}_{entry.name}"] = RobotForce(
                    f"{letter}_{entry.name}", "N" if letter == "F" else "N m", entry.name
                )
        return found

    def force(self, name: str, where: str) -> RobotForce:
        """Return a force by name. Raises SceneError with the nearest ones."""
        if name in self.forces:
            return self.forces[name]
        if name.startswith("T_"):
            entry = self._entry(name.removeprefix("T_"))
            if entry is not None and f"T_{entry.name}" in self.forces:
                return self.forces[f"T_{entry.name}"]
        if name.startswith("R_"):
            place, _, axis = name.removeprefix("R_").rpartition(".")
            if len(axis) == 1 and axis in AXES:
                return self.force_at(place, axis, where)
        if f"xi{name.removeprefix('F')}" in self.robots.driven:
            why = f"a law gives xi{name.removeprefix('F')}: its force is a result, read it in `controls`"
            raise SceneError(f"{where}: unknown force {name!r:.80}: {why}")
        raise SceneError(f"{where}: unknown force {name!r:.80}; {nearest(name, self.forces)}")

    def force_at(self, place: str, axis: str, where: str) -> RobotForce:
        """Return one component of a force at a frame, at a point of a link, or at the centre of mass. Raises SceneError."""
        name = f"{place}.{axis}"
        if self._find(name) is None or (place not in self.robots.frames and place != "com"):
            raise SceneError(f"{where}: unknown point {place!r:.80}; {nearest(place, [*self.robots.frames, 'com'])}")
        return RobotForce(f"R_{name}", "N", name)

    def point(self, place: str, where: str) -> int:
        """Return a frame by its name as a place. Raises SceneError for one that is none."""
        if place not in self.robots.frames:
            raise SceneError(f"{where}: unknown point {place!r:.80}; {nearest(place, self.robots.frames)}")
        return self.robots.frames[place]

    def chosen(self, patterns: Sequence[str], where: str) -> tuple[RobotForce, ...]:
        """Return the controls that patterns name: `talos.*`, less `-talos.head_*`, or forces by name. Raises SceneError."""
        found: dict[str, RobotForce] = {}
        for number, pattern in enumerate(patterns):
            key, minus = f"{where}[{number}]", pattern.startswith("-")
            matched = self._matching(pattern.removeprefix("-"))
            if not matched and (minus or "*" in pattern):
                known = [force.name for force in self.forces.values() if force.joint]
                raise SceneError(f"{key} = {pattern!r:.80}: matches no joint of a robot; {nearest(pattern.strip('-*'), known)}")
            if minus:
                found = {name: force for name, force in found.items() if name not in {entry.name for entry in matched}}
                continue
            for force in matched or [self.force(pattern, key)]:
                if force.name in found and "*" not in pattern:
                    raise SceneError(f"{key}: {force.name!r} is named twice")
                found[force.name] = force
        if not found:
            raise SceneError(f"{where}: no control is left of {', '.join(map(repr, patterns))[:200]}")
        return tuple(found.values())

    def _matching(self, pattern: str) -> list[RobotForce]:
        """Torques in robots' joints whose joint or whose own name a pattern names."""
        if pattern in self.forces:
            return [self.forces[pattern]]
        found = []
        for force in self.forces.values():
            if force.joint:
                whole = self.robots.model.names[force.joint]
                names = (whole, whole.partition(".")[2], force.name)
                if any(fnmatch.fnmatchcase(name, pattern) for name in names):
                    found.append(force)
        return found


def _renamed(entry: Coordinate, name: str) -> Coordinate:
    return Coordinate(name, entry.unit, entry.row, entry.joint, entry.place, entry.name)


def allowed_names(names: RobotNames, own: Iterable[str]) -> Collection[str]:
    """Every name that an equation or the law of a force may use: the time, parameters, measured data, the vocabulary."""
    return _Allowed(frozenset({"t", *own}), names)


class _Allowed(Collection[str]):
    def __init__(self, own: frozenset[str], names: RobotNames) -> None:
        self.own, self.names = own, names

    def __contains__(self, name: Any) -> bool:
        return name in self.own or name in self.names

    def __iter__(self) -> Iterator[str]:
        return itertools.chain(self.own, self.names)

    def __len__(self) -> int:
        return len(self.own) + len(self.names)
