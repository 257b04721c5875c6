"""Completing a scene: plain data to checked tables. The one way a scene comes about, from a file, a dict or Python classes."""

from __future__ import annotations

import contextlib
import functools
import keyword
import math
import numbers
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from vlmb.errors import SceneError, nearest
from vlmb.scene.by_phase import check_phases
from vlmb.scene.contacts import check_contact
from vlmb.scene.explain import explain
from vlmb.scene.expressions import CONSTANTS, FUNCTIONS
from vlmb.scene.legs import check_leg
from vlmb.scene.lift import check_lift
from vlmb.scene.names import check_names, has_controls
from vlmb.scene.places import check_place
from vlmb.scene.recorded import Samples, take_in
from vlmb.scene.robots import Beside, check_robots, frame_owner
from vlmb.scene.rows import rows_of
from vlmb.scene.tables import BASE, BOUNCE, SURFACE, Force, Link, SceneTables, Segment, Spring, Table
from vlmb.scene.written import Written, key_of, put, resolve

UNUSABLE = frozenset({"t", "speed", *FUNCTIONS, *CONSTANTS})  # as names of parameters
MAX_LINKS = 2000
MAX_DEPTH = 20
TINIEST, LARGEST = 1e-50, 1e50  # sizes of numbers that products of several do not take out of range


def complete(data: Mapping[str, Any]) -> SceneTables:
    """Check the keys of a scene and fill in what follows: numbers of expressions, names and parents of links, measured data.

    Raises SceneError with the key path, what was found and what is allowed.
    """
    if data.get("data"):
        data = {**data, "data": take_in(data["data"], Path())}
    tables, texts = _converted(_plain(dict(data), None))
    contacts = tuple(msgspec.structs.replace(contact, name=contact.name or contact.point) for contact in tables.contacts)
    legs = tuple(msgspec.structs.replace(leg, name=leg.name or f"leg{k + 1}") for k, leg in enumerate(tables.legs))
    tables = msgspec.structs.replace(tables, links=_named(tables.links), contacts=contacts, legs=legs)
    robots = [robot.name for robot in tables.robots]
    data_names, events = [entry.name for entry in tables.data], [event.name for event in tables.events]
    legged = [leg.name for leg in legs]
    check_names(tables.links, rows_of(tables), data_names, tables.contacts, robots, events, legged)
    _check_tree(tables.links, robots)
    _check(tables, texts)
    return tables


def _converted(data: dict[str, Any]) -> tuple[SceneTables, dict[str, Written]]:
    """Convert plain data to the tables; return what is written as an expression, by key path, as well."""
    with contextlib.suppress(msgspec.ValidationError):
        return msgspec.convert(data, SceneTables), {}  # a text where a number belongs does not pass
    plain, written = resolve(data, SceneTables)
    texts = {key_of(path): number for path, number in written.items()}
    for key, number in texts.items():
        _in_range(number, f"{key} = {number.text!r}")
    try:
        tables = msgspec.convert(plain, SceneTables)
    except msgspec.ValidationError as error:
        raise SceneError(explain(str(error), plain, SceneTables, texts)) from None
    for path, number in written.items():
        tables = put(tables, path, number)
    return tables, texts


Where = tuple["Where", str] | None  # where a value stands: what it stands in, and how it is written there


def _plain(value: Any, path: Where, depth: int = 0) -> Any:
    """Copy data with plain numbers (NumPy's too) and tables as dicts; refuse what is not data, not finite, too large or deep."""
    kind = type(value)
    if value is None or kind is bool:
        return value
    if kind is str:
        if has_controls(value):
            raise SceneError(f"{_key(path)} = {value!r:.80}: has control characters, which a text of a scene may not have")
        return value
    if kind is int:
        if abs(value) > 2**63:
            raise SceneError(f"{_key(path)}: this whole number is too large")
        return value
    if kind is Samples or kind is Beside:
        return value
    if kind is float:
        if value == 0.0 or TINIEST <= abs(value) <= LARGEST:
            return value
        key = _key(path)
        if math.isnan(value) or (math.isinf(value) and not re.search(r"limits\[\d\]$", key)):
            raise SceneError(f"{key} = {value}: must be a finite number")
        return _in_range(value, key)
    if isinstance(value, (dict, list, tuple, Table)) and depth > MAX_DEPTH:
        raise SceneError(f"{_key(path)[:80]}...: nested more than {MAX_DEPTH} deep")
    if isinstance(value, Table):
        value = _given(value)
    if isinstance(value, dict):
        for name in value:
            if not isinstance(name, str):
                raise SceneError(f"{_key(path) or 'scene'}: {name!r:.80} is no key: keys are text")
        return {name: _plain(entry, (path, name), depth + 1) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry, (path, f"[{index}]"), depth + 1) for index, entry in enumerate(value)]
    if isinstance(value, Written):
        return value.text
    if isinstance(value, str):
        return str(value)
    if isinstance(value, numbers.Real):
        return _plain(int(value) if isinstance(value, numbers.Integral) else float(value), path, depth)
    raise SceneError(f"{_key(path)} = {value!r:.80}: a scene has numbers, texts, lists and tables, no {kind.__name__}")


def _key(path: Where) -> str:
    """Return a path as text: `links[0].lower.length`."""
    parts: list[str] = []
    while path is not None:
        path, part = path
        parts.append(part if part.startswith("[") or path is None else f".{part}")
    return "".join(reversed(parts))


def _in_range(number: float, key: str) -> float:
    if math.isfinite(number) and number != 0.0 and not TINIEST <= abs(number) <= LARGEST:
        raise SceneError(f"{key} = {number:g}: between {TINIEST:g} and {LARGEST:g} in size, or 0")
    return number


def _given(table: Table) -> dict[str, Any]:
    """Return the keys of a table that are not at their defaults; Python checks none of them when one is made."""
    found = {}
    for name, (key, default) in _defaults(type(table)).items():
        value = getattr(table, name)
        if value is not default and not (isinstance(value, str) and value == default):
            found[key] = value
    return found


@functools.cache
def _defaults(table: type[Table]) -> dict[str, tuple[str, Any]]:
    """Return the key of every field in a scene file, and its default, by its name in Python."""
    return {field.name: (field.encode_name, field.default) for field in msgspec.structs.fields(table)}


def _named(links: tuple[Link, ...]) -> tuple[Link, ...]:
    """Give every link its name and parent, spelled out."""
    if len(links) > MAX_LINKS:
        raise SceneError(f"links: {len(links)} links; at most {MAX_LINKS}")
    named: list[Link] = []
    for index, link in enumerate(links):
        name = link.name or f"link{index + 1}"
        parent = link.parent or (named[-1].name if named else BASE)
        named.append(msgspec.structs.replace(link, name=name, parent=parent))
    return tuple(named)


def _check_tree(links: tuple[Link, ...], robots: Sequence[str]) -> None:
    """Refuse parents that are not there, and rings of them. A robot's frames are known when it is built."""
    places = {link.name: index for index, link in enumerate(links)}
    on_robots = {link.parent for link in links if frame_owner(link.parent) in robots}
    for index, link in enumerate(links):
        if link.parent != BASE and link.parent not in places and link.parent not in on_robots:
            where = f"links[{index}].parent = {link.parent!r}"
            raise SceneError(f"{where}: no such link; {nearest(link.parent, [BASE, *places])}")
    rooted = {BASE, *on_robots}
    for index, link in enumerate(links):
        way: dict[str, None] = {}
        while link.name not in rooted:
            if link.name in way:
                ring = ", ".join(list(way)[:10])
                raise SceneError(f"links[{index}].parent: the parents form a ring through {ring}; links form a tree")
            way[link.name] = None
            if link.parent == BASE or link.parent in on_robots:
                break
            link = links[places[link.parent]]
        rooted.update(way)


def _check(scene: SceneTables, written: Mapping[str, Written]) -> None:
    """Refuse what the types alone cannot: combinations. `written` are the expressions, by key path."""

    def refuse(key: str, why: str) -> None:
        texts = [f"{name} = {number.text!r} = {number:g}" for name, number in written.items() if name.startswith(key)]
        raise SceneError(f"{key}: {why}{' (' + ', '.join(texts[:4]) + ')' if texts else ''}")

    for name in scene.parameters:
        if name in UNUSABLE or keyword.iskeyword(name):
            refuse(f"parameters.{name}", "this name has a meaning of its own in expressions; choose another")
    base = scene.base
    if base.kind == "ski":
        if not base.mass > 0.0 or not base.inertia > 0.0:
            refuse("base", "a ski needs mass > 0 [kg] and inertia > 0 [kg m^2]")
        check_lift(scene, refuse)
    elif base.lift or base.hold is not None or base.skid is not None:
        refuse("base", f"lift, hold and skid belong to kind = 'ski'; a {base.kind!r} base has [[contacts]]")
    elif base.drag or base.drag_at != "com":
        refuse("base", f"drag and drag_at belong to kind = 'ski'; a {base.kind!r} base takes a force at a point ([[forces]] at)")
    elif base.friction or base.friction_on != "normal" or base.width or base.length:
        refuse("base", f"friction, width and length belong to kind = 'ski'; remove them from {base.kind!r}")
    elif base.inertia or base.com_offset or (base.mass and base.kind == "pivot"):
        refuse("base", f"inertia and com_offset belong to kind = 'ski', mass to 'ski' and 'free'; remove them from {base.kind!r}")
    check_robots(scene, refuse)
    if not scene.links and not scene.robots and (base.kind == "pivot" or (base.kind == "free" and not base.mass)):
        refuse("links", f"a {base.kind!r} base needs at least one link{' or a mass' if base.kind == 'free' else ''}")
    by_name = {link.name: link for link in scene.links}
    for index, link in enumerate(scene.links):
        key = f"links[{index}]"
        check_place(scene, index, by_name.get(link.parent), refuse)
        if link.rod.length == 0.0 and link.rod.com is None and link.rod.mass > 0.0 and link.rod.inertia is None:
            refuse(f"{key}.rod", "a rod of length 0 with mass is a point: use tip_mass, or give com and inertia")
        for which, segment in (("lower", link.lower), ("upper", link.upper)):
            _check_segment(segment, f"{key}.{which}", refuse)
    for index, force in enumerate(scene.forces):
        _check_force(force, f"forces[{index}]", refuse)
    for index, spring in enumerate(scene.springs):
        _check_spring(spring, f"springs[{index}]", refuse)
    for index, contact in enumerate(scene.contacts):
        check_contact(scene, contact, f"contacts[{index}]", refuse)
    for index, leg in enumerate(scene.legs):
        check_leg(scene, leg, f"legs[{index}]", refuse)
    check_phases(scene, refuse)


def _check_force(force: Force, key: str, refuse: Any) -> None:
    kinds = {"on": force.on is not None, "at": force.at is not None, "between": force.between is not None}
    if sum(kinds.values()) != 1:
        what = "`on` and `law` (a force by name), `at` and `force` (a force at a point)"
        refuse(key, f"give one of {what} and `between` (a spring between two directions)")
    if not kinds["at"] and (force.force is not None or force.frame != SURFACE):
        refuse(key, "`force` and `frame` belong to `at`: at = 'legs.tip', force = ['10', '0', '0']")
    if force.on is not None and force.law is None:
        refuse(key, f"the force on {force.on} needs a law, a number or an expression of t: law = '20*sin(3*t)'")
    if force.on is not None and ( force.stiffness or force.damping or force.rest):
        refuse(key, "a force has the keys `on` and `law` only")
    if force.at is not None and (force.force is None or force.law is not None):
        refuse(key, "a force at a point has `force`, a list of three laws [N], and no `law`")
    if force.at is not None and (force.stiffness or force.damping or force.rest):
        refuse(key, "a force at a point has the keys `at`, `force` and `frame` only; springs between points are [[springs]]")
    if force.between is not None and force.law is not None:
        refuse(key, "a spring between directions has no `law`; it has stiffness, damping and rest")
    if force.between is not None and not (force.stiffness or force.damping):
        refuse(key, "a spring between directions needs stiffness or damping > 0")


def _check_spring(spring: Spring, key: str, refuse: Any) -> None:
    if not (spring.stiffness or spring.damping):
        refuse(key, "a spring between points needs stiffness [N/m] or damping [N s/m] > 0")
    if spring.between[0] == spring.between[1]:
        refuse(f"{key}.between", f"{spring.between[0]!r} is both ends; a spring needs two places")
    if not any(isinstance(place, str) for place in spring.between):
        refuse(f"{key}.between", "both ends are fixed; name a point of a link, such as 'legs.tip'")


def _check_segment(segment: Segment, key: str, refuse: Any) -> None:
    low, high = segment.bounds
    if not low < high:
        refuse(f"{key}.limits", f"must be [low, high] with low < high, not {list(segment.limits or ())}")
    if segment.at_limit == BOUNCE and (segment.motion != "free" or segment.limits is None):
        refuse(f"{key}.at_limit", "a stop needs motion = 'free' and limits = [low, high] [m]")
    if segment.restitution and segment.at_limit != BOUNCE:
        refuse(f"{key}.restitution", f"belongs to at_limit = '{BOUNCE}'; without it the run ends at a limit")
    if segment.motion == "prescribed":
        if segment.law is None:
            refuse(key, "motion = 'prescribed' needs a law, e.g. law = \"0.2 + 0.05*sin(6*t)\"")
        if segment.length is not None or segment.stiffness or segment.damping or segment.rest is not None:
            refuse(key, "a prescribed segment has motion, law and limits only: the law gives its length, the force is the result")
        return
    if segment.law is not None:
        refuse(f"{key}.law", f"a law needs motion = 'prescribed', not {segment.motion!r}")
    length = segment.length
    if length is None:
        refuse(f"{key}.length", f"a {segment.motion} segment needs a length [m]")
    if segment.motion == "fixed" and (segment.stiffness or segment.damping or segment.rest is not None or segment.limits):
        refuse(key, "a fixed segment has motion and length only; a spring needs motion = 'free'")
    if length is not None and not low <= length <= high:
        refuse(f"{key}.length", f"{length} is outside limits [{low}, {high}]")
