"""Changes of a scene by key path: `links.legs.lower.stiffness`, `start.speed`, `forces.0.law`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import msgspec

from vlmb.errors import SceneError, nearest
from vlmb.scene.tables import SceneTables, Table
from vlmb.scene.written import Shape, as_written, keys_of


def changed_data(scene: SceneTables, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a scene's data, as written, with values put at key paths; None removes a key.

    Raises SceneError naming the path, the part that leads nowhere and the nearest valid one.
    """
    if not isinstance(changes, Mapping):
        raise SceneError(f"changed_at: {changes!r:.80}: must be a dict of key paths and values")
    names = [link.name for link in scene.links]
    data: dict[str, Any] = _lists(as_written(scene))
    for key, value in changes.items():
        if not isinstance(key, str):
            raise SceneError(f"changed_at: {key!r:.80} is no key path, such as 'links.legs.lower.stiffness'")
        parts = re.sub(r"\[(\w+)\]", r".\1", key).split(".")
        _put(data, Shape(table=SceneTables), parts, 0, value, names)
    return data


def _put(place: Any, shape: Shape, parts: list[str], at: int, value: Any, names: list[str]) -> None:
    """Put a value into `place`, which stands at parts[:at]."""
    key, done = ".".join(parts), ".".join(parts[:at])
    if isinstance(place, dict) and shape.values is not None:  # names with dots are one key
        name = ".".join(parts[at:])
        if done == "parameters" and name not in place:
            raise SceneError(f"{key}: no such parameter; {nearest(name, place)}")
        _set(place, name, value)
        return
    part: Any = parts[at]
    if isinstance(place, list):
        part, inner = _index(place, part, key, done, names if done == "links" else []), shape.items
    else:
        known = keys_of(shape.table) if isinstance(place, dict) and shape.table else {}
        if part not in known:
            raise SceneError(f"{key}: {done or 'a scene'} has no key {part!r}; {nearest(part, known)}")
        inner = known[part]
    if at + 1 == len(parts):
        _set(place, part, value)
        return
    if not (inner and (inner.items or inner.values or inner.table)):
        raise SceneError(f"{key}: {'.'.join(parts[: at + 1])} is no table and no list")
    if isinstance(place, dict) and place.get(part) is None:
        place[part] = _default(shape.table, part, key, ".".join(parts[: at + 1]))
    _put(place[part], inner, parts, at + 1, value, names)


def _index(place: list[Any], part: str, key: str, done: str, names: list[str]) -> int:
    """Return the position that a part of a path means: a number, of a link its name."""
    if part in names:
        return names.index(part)
    if not re.fullmatch(r"\d{1,6}", part):
        raise SceneError(f"{key}: {done} has no {part!r}; {nearest(part, names or map(str, range(len(place))))}")
    if int(part) >= len(place):
        raise SceneError(f"{key}: {done} has {len(place)} entries, counted from 0")
    return int(part)


def _default(table: type[Table] | None, part: str, key: str, done: str) -> Any:
    """Return what a key that is not given stands for, as data to put more into."""
    assert table is not None
    field = next(entry for entry in msgspec.structs.fields(table) if entry.name == part)
    if isinstance(field.default, Table):
        return _lists(as_written(field.default))
    if field.default_factory is dict or field.default == {}:
        return {}
    raise SceneError(f"{key}: this scene has no {done}; give it as a whole first")


def _set(place: Any, part: Any, value: Any) -> None:
    if value is None and isinstance(place, dict):
        place.pop(part, None)
    else:
        place[part] = value


def _lists(value: Any) -> Any:
    """Copy plain data with lists for tuples."""
    if isinstance(value, dict):
        return {name: _lists(entry) for name, entry in value.items()}
    return [_lists(entry) for entry in value] if isinstance(value, (list, tuple)) else value
