"""The vocabulary: every quantity and every force that a scene, an equation, a table or a figure may name, with unit and symbol.

Quantities are the coordinates and their aliases (`xi1_1` is `legs.lower`), `speed`, of each link its `length`, `direction` and
points (`legs.tip.z`), and the centre of mass (`com.z`); each has a rate, by the same name with `_dot`. Forces are the generalized
forces of the coordinates (`F1_1`, `M_psi1`, `F_x`, `M_phi0`), the hinge torques (`T_legs`) and forces at points (`R_legs.tip.x`).
Nothing else knows these names.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

from vlmb.errors import SceneError, nearest
from vlmb.model.layout import Coordinate, Layout, segment_of
from vlmb.scene.legs import FORCE, READABLE
from vlmb.scene.names import listed

AXES = "xyz"
POINTS = ("hinge", "rod_start", "rod_end", "tip")
DOT = "_dot"
AT_POINT = "R_"  # how forces at points begin
POINTS_OF = "a link's name with .hinge, .rod_start, .rod_end or .tip"
ALIASES = {"lower": ("xi", 1), "upper": ("xi", 2), "azimuth": ("phi", 0), "elevation": ("psi", 0)}  # kind and segment
PLACES = {"phi0": "heading", **dict.fromkeys(AXES, "place")}  # what a coordinate of the base is
LETTERS = {"phi": r"\varphi", "phi0": r"\varphi", "psi": r"\psi", "xi": r"\xi"}
ANGLES = ("phi0", "phi", "psi")
LISTED = 4000  # names that a message looks through
SHOWN = 12  # coordinates in a line
Value = TypeVar("Value")


@dataclass(frozen=True)
class Quantity:
    """Something that can be read of a motion. `rate`: its rate is meant; `speed` is one by itself.

    kind: x y z phi0 phi psi xi (coordinates), speed, direction, point, length (of a whole link), com; leg (`point`: what of it).
    """

    name: str
    kind: str
    link: int = -1  # -1: the base, or the whole mechanism
    segment: int = 0  # 1 lower, 2 upper, of xi
    point: str = ""
    axis: int = -1
    rate: bool = False

    @property
    def unit(self) -> str:
        """Unit, such as rad/s."""
        if self.kind == "leg" and self.point == FORCE:
            return "N"
        plain = "rad" if self.kind in ANGLES else "" if self.kind == "direction" else "m"
        if self.kind == "speed":
            return "m/s"
        return (f"{plain}/s" if plain else "1/s") if self.rate else plain

    @property
    def tex(self) -> str:
        r"""The paper's symbol in TeX: \varphi_{1}, \dot{\xi}_{11}; other names as text."""
        if self.kind not in (*LETTERS, *AXES):
            return rf"\mathrm{{{self.name.replace('_', chr(92) + '_')}}}"
        index = "0" if self.kind == "phi0" else str(self.link + 1) if self.link >= 0 else ""
        if self.kind == "xi":
            index += f"{'' if self.link < 9 else ','}{self.segment}"
        return tex_symbol(self.kind, index, "dot" if self.rate else "")

    @property
    def symbol(self) -> str:
        """The same for labels of figures."""
        return f"${self.tex}$"


PointEnd = tuple[int, str] | tuple[float, float, float]  # a point of a link, or a fixed place [m]
STORED, LOST = "spring", "damper"  # kinds of forces whose work is energy of a spring, or lost


@dataclass(frozen=True)
class GeneralizedForce:
    """A named generalized force: F1_1, F_x, M_phi0, M_phi1, M_psi1, a hinge torque T_legs, or a force at a point R_legs.tip.x.

    Springs and dampers between points, and drag, are such too, without a name in results.
    """

    name: str
    kind: str  # axis | surface | phi | psi | hinge | point | spring | damper
    link: int = -1
    v: int = -1  # axis, surface: index into velocities
    unit: str = "N"
    coordinate: str = ""  # the coordinate, or the component of a point's place, that it acts along; none for a hinge torque
    ends: tuple[PointEnd, ...] = ()  # of a spring between points

    @property
    def symbol(self) -> str:
        r"""Symbol for labels: $M_{\varphi_1}$, $F_{11}$, $T$ legs."""
        return force_symbol(self.name)


def tex_symbol(letter: str, index: str, dots: str = "") -> str:
    r"""Return the paper's symbol in TeX of a letter, an index and "", "dot" or "ddot": \dot{\varphi}_{1}."""
    shown = LETTERS.get(letter, letter)
    if dots:
        shown = rf"\{dots}{{{shown}}}"
    return f"{shown}_{{{index}}}" if index else shown


def force_symbol(name: str) -> str:
    r"""Return the symbol of a force: M_{\varphi_1}, F_{11}, T_{legs}; a prescribed segment's force is F along its xi."""
    letter, _, index = name.partition("_")
    if letter == "M" and index[:3] in LETTERS and index[3:].isdigit():
        return f"$M_{{{LETTERS[index[:3]]}_{{{index[3:]}}}}}$"
    if letter[:1] == "F" and letter[1:].isdigit() and index.isdigit():
        return f"$F_{{{letter[1:]}{',' if int(letter[1:]) > 9 else ''}{index}}}$"
    return f"${letter}$ {index}" if letter in ("T", "R") else name


@dataclass(frozen=True)
class Names(Collection[str]):
    """The vocabulary of one mechanism. Iterating gives every name that an equation may use, rates included."""

    layout: Layout
    legs: tuple[str, ...] = ()  # massless ones

    def __repr__(self) -> str:
        return f"<Names: {self.shown}; links {listed(tuple(self.links))}>"

    @cached_property
    def coordinates(self) -> tuple[Quantity, ...]:
        """The paper's coordinates: `x y phi0`, then `phi1 psi1 xi1_1 xi1_2`, ..."""
        return tuple(quantity_of(c) for c in self.layout.coordinates)

    @property
    def shown(self) -> str:
        """The coordinates in a line, of many the first ones and how many there are."""
        names = self.layout.names
        return " ".join(names if len(names) <= SHOWN else (*names[:SHOWN], f"... ({len(names)})"))

    @cached_property
    def links(self) -> dict[str, int]:
        """Position of each link by name."""
        return {link.name: i for i, link in enumerate(self.layout.links)}

    @cached_property
    def known(self) -> tuple[str, ...]:
        """Names of coordinates, their rates, and the speed: what a start may give."""
        speed = ("speed",) if self.layout.base == "ski" else ()
        return (*self.layout.names, *(f"{name}{DOT}" for name in self.layout.names), *speed)

    @cached_property
    def forces(self) -> Mapping[str, GeneralizedForce]:
        """Every generalized force a scene may use, by name; see `generalized_forces`."""
        return generalized_forces(self.layout)

    def find(self, name: str, where: str = "") -> Quantity:
        """Return the quantity of a name; SceneError with `where` it stands, and with the nearest names."""
        found = self._find(name) if isinstance(name, str) else None
        if found is None:
            raise SceneError(f"{where}{': ' if where else ''}unknown name {name!r:.80}; {self.hint(name)}")
        return found

    @cached_property
    def _of_coordinates(self) -> dict[str, Quantity]:
        """Coordinates and their rates by name."""
        found = (quantity_of(c, rate) for c in self.layout.coordinates for rate in (False, True))
        return {quantity.name: quantity for quantity in found}

    @cached_property
    def _own(self) -> tuple[tuple[Coordinate, ...], ...]:
        """Coordinates of each link."""
        found: list[list[Coordinate]] = [[] for _ in self.layout.links]
        for c in self.layout.coordinates:
            if c.link >= 0:
                found[c.link].append(c)
        return tuple(map(tuple, found))

    def meaning(self, quantity: Quantity) -> str:
        """Return the other name of a link's coordinate or rate, `legs.lower`; what a base's is, `heading`."""
        alias = next((name for name, what in ALIASES.items() if what == (quantity.kind, quantity.segment)), "")
        return f"{self.layout.links[quantity.link].name}.{alias}{DOT * quantity.rate}" if alias else PLACES.get(quantity.kind, "")

    def canonical(self, given: Mapping[str, Value], where: str) -> dict[str, Value]:
        """Return values by name with aliases replaced by the coordinates and rates they stand for; unknown names stay.

        Raises SceneError where one quantity is given twice.
        """
        result: dict[str, Value] = {}
        for name, value in given.items():
            quantity = self._find(name) if isinstance(name, str) and "." in name else None
            plain = quantity.name if quantity else name
            if plain in result:
                raise SceneError(f"{where}.{name}: {plain} is given already, by its other name; remove one")
            result[plain] = value
        return result

    def force(self, name: str, where: str) -> GeneralizedForce:
        """Return a force by name; SceneError with the nearest ones, or why this force cannot exist."""
        if name in self.forces:
            return self.forces[name]
        if name.startswith(AT_POINT):
            place, _, axis = name.removeprefix(AT_POINT).rpartition(".")
            if axis in AXES and axis:
                return self.force_at(place, axis, where)
            form = "a force at a point is R_, the point, and .x, .y or .z: R_legs.tip.x"
            raise SceneError(f"{where}: unknown force {name!r}; {form}")
        why = ""
        if self.layout.plane and name.startswith("M_phi"):
            why = "with plane = true the links have no azimuth of their own; "
        for c in self.layout.coordinates:
            if c.kind == "xi" and name == force_along(c):
                why = f"{c.name} is prescribed: its force is a result, read it in `controls`; "
        raise SceneError(f"{where}: unknown force {name!r}; {why}{nearest(name, self.forces)}")

    def force_at(self, place: str, axis: str, where: str) -> GeneralizedForce:
        """Return one component of a force at a point, `legs.tip`, or at the centre of mass, `com`. Raises SceneError."""
        name = f"{place}.{axis}"
        link = -1 if place == "com" else self.point(place, where)[0]
        return GeneralizedForce(f"{AT_POINT}{name}", "point", link, coordinate=name)

    def point(self, place: str, where: str) -> tuple[int, str]:
        """Return link and point of a place such as `legs.tip`. Raises SceneError for one that is none, or has no place."""
        owner, _, point = place.partition(".")
        i = self.links.get(owner)
        if i is None:
            raise SceneError(f"{where}: unknown point {place!r:.80}; {nearest(owner, self.links)}; points are {POINTS_OF}")
        if point not in POINTS:
            missing = f"has no point {point!r:.80}" if point else "is a link, and a point of it is needed"
            raise SceneError(f"{where}: {owner!r} {missing}; {nearest(point, POINTS)}" + f" (e.g. {owner}.tip)" * (not point))
        if point == "tip" and self.layout.links[i].upper.loose:
            why = "ends a free segment that carries no mass, so that its place has no equation"
            raise SceneError(f"{where}: {place} {why}; give the link a tip_mass, fix its upper segment, or take {owner}.rod_end")
        return i, point

    def hint(self, name: object) -> str:
        """Say which names come nearest to a wrong one, or why a coordinate is none of this scene."""
        text = str(name)
        link = self.links.get(text.partition(".")[0])
        if link is not None and "." in text:
            here = self.layout.links[link].name
            if self._absent(text, link):
                return f"this coordinate is none of this scene: {self._absent(text, link)}"
            close = [entry for entry in self._of_link(here) if entry.endswith(DOT) == text.endswith(DOT)]
            return nearest(text, close) + f" Of a link there are length, and x, y, z of direction, {', '.join(POINTS)}"
        return nearest(text, itertools.islice(self, LISTED))

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and self._find(name) is not None

    def __iter__(self) -> Iterator[str]:
        yield from self.known
        for axis in AXES:
            yield from (f"com.{axis}", f"com.{axis}{DOT}")
        for link in self.layout.links:
            yield from self._of_link(link.name)
        yield from (f"{leg}.{what}" for leg in self.legs for what in READABLE)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def _of_link(self, link: str) -> Iterator[str]:
        """Names of a link: aliases, length, direction and points, each with its rate."""
        own = (f"{link}.{alias}" for alias in ALIASES)
        places = (f"{link}.{what}.{axis}" for what in ("direction", *POINTS) for axis in AXES)
        for name in itertools.chain((name for name in own if self._find(name)), [f"{link}.length"], places):
            yield from (name, f"{name}{DOT}")

    def _absent(self, name: str, link: int) -> str:
        """Say why an alias names no coordinate here."""
        what = name.removesuffix(DOT).partition(".")[2]
        if what == "azimuth" and self.layout.plane:
            return "with plane = true a link has no azimuth"
        if what in ("lower", "upper"):
            side = self.layout.links[link].lower if what == "lower" else self.layout.links[link].upper
            return f"this segment is {side.length:g} m long and makes no coordinate" if not side.joint else ""
        return ""

    def _find(self, name: str) -> Quantity | None:
        own = self._of_coordinates.get(name)
        if own is not None:
            return own
        plain = name.removesuffix(DOT)
        rate = plain != name
        if name == "speed" and self.layout.base == "ski":
            return Quantity(name, "speed", rate=True)
        owner, _, rest = plain.partition(".")
        if owner == "com" and rest in AXES and rest:
            return Quantity(name, "com", axis=AXES.index(rest), rate=rate)
        if owner in self.legs and name.partition(".")[2] in READABLE:
            return Quantity(name, "leg", point=rest, rate=rate)
        i = self.links.get(owner)
        if i is None:
            return None
        if rest in ALIASES:
            kind, segment = ALIASES[rest]
            return next((quantity_of(c, rate) for c in self._own[i] if (c.kind, c.segment) == (kind, segment)), None)
        if rest == "length":
            return Quantity(name, "length", i, rate=rate)
        what, _, axis = rest.partition(".")
        if axis not in AXES or not axis or what not in ("direction", *POINTS):
            return None
        kind = "direction" if what == "direction" else "point"
        return Quantity(name, kind, i, point="" if kind == "direction" else what, axis=AXES.index(axis), rate=rate)


def quantity_of(coordinate: Coordinate, rate: bool = False) -> Quantity:
    """Return a coordinate, or its rate, as a quantity."""
    return Quantity(coordinate.name + DOT * rate, coordinate.kind, coordinate.link, coordinate.segment, rate=rate)


def force_along(coordinate: Coordinate) -> str:
    """Name of a coordinate's generalized force: F_x, M_phi0, M_psi1, F1_2."""
    if coordinate.kind == "xi":
        return f"F{coordinate.link + 1}_{coordinate.segment}"
    return ("F_" if coordinate.kind in AXES else "M_") + coordinate.name


def force_unit(name: str) -> str:
    """Unit of a generalized force or hinge torque: N along a length, N m about an angle."""
    return "N" if name[:1] in ("F", "R") else "N m"


def generalized_forces(layout: Layout) -> dict[str, GeneralizedForce]:
    """List every generalized force a scene may use, by name.

    `F{i}_{a}` along xi{i}_{a}; `F_x F_y F_z` at the base; `M_phi0` on the ski; `M_phi{i}`, `M_psi{i}` of the absolute
    angles; `T_{link}`: hinge torque, equal and opposite on the link and its parent, positive when it opens the angle between
    their directions (a base counts as its heading; in a plane: positive when it raises psi of the link).
    """
    found: dict[str, GeneralizedForce] = {}

    def add(name: str, kind: str, link: int, v: int, coordinate: str) -> None:
        found[name] = GeneralizedForce(name, kind, link, v, force_unit(name), coordinate)

    for at, c in enumerate(layout.coordinates):
        if c.kind == "xi":
            if segment_of(layout, c).motion == "free":
                add(force_along(c), "axis", c.link, segment_of(layout, c).v, c.name)
        elif c.link >= 0:
            add(force_along(c), c.kind, c.link, -1, c.name)
        else:
            add(force_along(c), "surface" if layout.base == "ski" and c.kind in ("x", "y") else "axis", -1, at, c.name)
    for i, link in enumerate(layout.links):
        if link.parent >= 0 or layout.base != "free":
            add(f"T_{link.name}", "hinge", i, link.v, "")
    return found


def plain(text: str) -> str:
    """Keep a name from being read as mathematics."""
    return text.replace("$", r"\$")


def counted(number: int, noun: str) -> str:
    """Return the number with its noun, in the plural unless it is 1."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def short(text: str, most: int = 44) -> str:
    """Cut a long equation for a legend, and keep it from being read as mathematics."""
    return plain(text if len(text) <= most else f"{text[: most - 3]}...")


def panel_label(group: Iterable[Quantity]) -> str:
    """Name a panel with its unit: the symbols themselves when they are few, else one with the index i."""
    shown = list(group)
    last = shown[-1]
    if len(shown) <= 3:
        return f"{', '.join(entry.symbol for entry in shown)} [{last.unit}]"
    letter = "xi" if last.kind == "xi" else "psi" if last.kind == "psi" else "phi"
    index = f"i{last.segment}" if last.kind == "xi" else "i"
    return f"${tex_symbol(letter, index, 'dot' if last.rate else '')}$ [{last.unit}]"


def tex_of(name: str) -> str:
    r"""TeX of a column of the blocks: `2*phi1_dot*xi1_2_dot` is 2\,\dot{\varphi}_{1}\,\dot{\xi}_{1,2}."""
    if "*" in name:
        return r"\,".join(tex_of(part) for part in name.split("*"))
    if name.endswith("^2"):
        return tex_of(name[:-2]) + "^{2}"
    stem, dots = re.fullmatch(r"(.*?)((?:_d+ot)?)", name).groups()  # type: ignore[union-attr]
    letter, index = re.fullmatch(r"(\d+|[a-z]+)([\d_]*)", stem).groups()  # type: ignore[union-attr]
    return tex_symbol({"speed": "w"}.get(letter, letter), index.replace("_", ","), dots[1:])
