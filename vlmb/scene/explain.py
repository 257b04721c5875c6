"""Messages of the validation in the words of a scene file: the key path, the value found, the nearest valid key."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from typing import Any, Literal, get_origin

import msgspec

from vlmb.scene.tables import (
    ALLOWED_NAME,
    MAX_NAME,
    NAME,
    Attach,
    Base,
    Data,
    Edge,
    Force,
    Link,
    Posture,
    Programme,
    Robot,
    Rod,
    Run,
    Segment,
    Smoothing,
    Spring,
    Weld,
)

BASE_HINT = 'base = {kind = "pivot"}; kinds are pivot, ski, free'
NEEDED = {  # how a key that every table of its kind needs is written
    "rod": "rod = {length = 0.5, mass = 2.0} in m and kg",
    "rod.length": "length [m]",
    "rod.mass": "mass [kg]",
    "base": BASE_HINT,
    "base.kind": BASE_HINT,
    "programme.constraints": 'constraints = ["psi1 = 1.4"]',
    "programme.controls": 'controls = ["M_psi1"]',
    "contacts.point": 'point = "legs.tip"',
    "legs.from": 'from = "base", or a point such as "trunk.hinge"',
    "events.name": 'name = "low"',
    "events.when": 'when = "legs.tip.z = 0.8"',
    "springs.between": 'between = ["legs.tip", [0.0, 0.0, 1.5]]',
    "data.name": 'name = "mocap"',
    "data.columns": 'columns = {knee = {from = "knee_length", unit = "mm"}}',
    "robots.urdf": 'urdf = "ur_description/urdf/ur5_robot.urdf"',
    "welds.frames": 'frames = ["talos.left_foot", "ski"]',
    "edges.frame": 'frame = "talos.left_foot"',
}
FOREIGN = {  # what other programs call a key
    "dt": "step", "timestep": "step", "time_step": "step", "tol": "rtol", "tolerance": "rtol", "solver": "method",
    "integrator": "method", "t_end": "duration", "tmax": "duration", "time": "duration", "g": "gravity", "k": "stiffness",
    "spring": "stiffness", "c": "damping", "damper": "damping", "l0": "rest", "rest_length": "rest", "m": "mass", "l": "length",
    "initial": "start", "angle": "slope", "type": "kind", "expression": "law", "value": "law",
}  # fmt: skip
LISTS = ("links", "forces", "springs", "data", "contacts", "legs", "events", "robots", "welds", "edges", "programmes")
WORDS = {"object": "table", "array": "list", "str": "text", "int": "number", "float": "number", "bool": "true or false"}


def explain(message: str, data: dict[str, Any], root: type, written: Mapping[str, Any]) -> str:
    """Turn a validation message into one that names the key path, the value found and the nearest valid key.

    `written` are numbers by key path that stand in the scene as expressions.
    """
    text, _, path = message.partition(" - at `key` in `$" if " - at `key` in `$" in message else " - at `$")
    path = path.rstrip("`").lstrip(".")
    if " - at `key` in `$" in message:  # the name of a parameter
        wrong = next((name for name in _lookup(data, path) if not re.fullmatch(NAME, name) or len(name) > MAX_NAME), "?")
        return f"{path}: {wrong!r:.80} is no name: {ALLOWED_NAME}"
    unknown = re.match(r"Object contains unknown field `(.*)`", text)
    if unknown:
        return unknown_key(path, unknown[1], _keys_of(path, root))
    missing = re.match(r"Object missing required field `(.*)`", text)
    if missing:
        where = f"{path}.{missing[1]}" if path else missing[1]
        hint = NEEDED.get(".".join(re.sub(r"\[\d+\]", "", where).split(".")[-2:])) or NEEDED.get(missing[1])
        return f"missing key {where!r}" + (f": {hint}" if hint else "")
    if path.endswith("[...]"):  # one of a table's values: find which
        path = path.removesuffix("[...]")
        parent, _, key = path.rpartition(".")
        kind = next(field.type for field in msgspec.structs.fields(_type_at(parent, root)) if field.name == key)
        path = next((f"{path}.{name}" for name, entry in _lookup(data, path).items() if not _fits({name: entry}, kind)), path)
    found = repr(_lookup(data, path))
    if path in written:
        found = f"{written[path].text!r} = {found}"
    found = found if len(found) <= 120 else found[:117] + "..."
    if "enum" in text:
        return f"{path} = {found}: allowed: {'pivot, ski, free' if path == 'base.kind' else _choices_of(path, root)}"
    if "regex" in text or "length <=" in text:
        return f"{path} = {found}: {ALLOWED_NAME}"
    text = re.sub(r"`([^`]*)`", _in_words, text)
    return f"{path or 'scene'} = {found}: {text[0].lower()}{text[1:]}{_advice(path, text)}"


def _advice(path: str, text: str) -> str:
    """Say how a value that is wrong in kind or range is meant to be."""
    if path == "slope":
        return ", in radians (degrees times pi/180)"
    if path == "gravity":
        return " [m/s^2]: it acts downwards; a slope tilts it"
    if path == "base":
        return f"; write {BASE_HINT}"
    if path == "programme" and text == "Expected table, got list":
        return '; write [programme] with constraints = ["psi1 = 1.4"] and controls = ["M_psi1"]'
    if text == "Expected list, got table" and path in LISTS:
        return f"; each begins with [[{path}]], with two brackets on each side"
    return ""


def unknown_key(path: str, key: str, valid: Iterable[str]) -> str:
    """Say that a table has no such key, and which is the nearest."""
    valid = list(valid)
    foreign = FOREIGN.get(key.lower())
    close = [foreign] if foreign in valid else difflib.get_close_matches(key, valid, n=1, cutoff=0.5)
    hint = f"did you mean {close[0]!r}? " if close else ""
    where = f"{path}.{key}" if path else key
    return f"unknown key {where!r:.200}; {hint}allowed here: {', '.join(valid)}"


def _in_words(match: re.Match[str]) -> str:
    return " or ".join(WORDS.get(word, word) for word in match[1].split(" | ") if word != "null")


def _fits(value: Any, kind: Any) -> bool:
    try:
        msgspec.convert(value, kind)
    except msgspec.ValidationError:
        return False
    return True


def _type_at(path: str, root: type) -> Any:
    """Return the table type or field annotation at a key path such as `links[0].rod`."""
    current: Any = root
    tables = {"base": Base, "links": Link, "rod": Rod, "lower": Segment, "upper": Segment,
              "forces": Force, "springs": Spring, "programme": Programme, "run": Run, "data": Data,
              "smooth": Smoothing, "robots": Robot, "attach": Attach, "welds": Weld, "edges": Edge,
              "posture": Posture}  # fmt: skip
    for part in filter(None, re.split(r"[.\[\]]+", re.sub(r"\[(\.\.\.|\d+)\]", "", path))):
        current = tables.get(part, part)
    return current


def _keys_of(path: str, root: type) -> list[str]:
    table = _type_at(path, root)
    return [field.encode_name for field in msgspec.structs.fields(table)] if isinstance(table, type) else []


def _choices_of(path: str, root: type) -> str:
    parent, _, key = path.rpartition(".")
    table = _type_at(parent, root)
    if not isinstance(table, type):
        return ""
    for field in msgspec.structs.fields(table):
        if field.name == key:
            kinds = [field.type, *getattr(field.type, "__args__", ())]  # a Literal, or a union with one
            choices = next((kind.__args__ for kind in kinds if get_origin(kind) is Literal), ())
            return ", ".join([*map(str, choices), *(["or a number"] if float in kinds else [])])
    return ""


def _lookup(data: Any, path: str) -> Any:
    try:
        for part in filter(None, re.split(r"[.\[\]]+", path)):
            data = data[int(part)] if isinstance(data, (list, tuple)) else data[part]
    except (KeyError, IndexError, ValueError, TypeError):
        return "?"
    return data
