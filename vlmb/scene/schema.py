"""A JSON schema of scene files, from the tables of keys: editors complete keys by it, show units and mark what is wrong."""

from __future__ import annotations

import inspect
import re
from typing import Any

import msgspec

from vlmb.scene.tables import SceneTables, Table

DIALECT = "https://json-schema.org/draft/2020-12/schema"
REMARK = re.compile(r"^    (\w+):.*?  # (.+)$", re.M)
EXPRESSION = {"type": "string", "description": "an expression of parameters"}


def scene_schema() -> dict[str, Any]:
    """Return the schema: every key with its kind, range, default and remark; a number may be an expression of parameters."""
    made = msgspec.json.schema(SceneTables)
    for table in Table.__subclasses__():
        found = made["$defs"].get(table.__name__, {"properties": {}})["properties"]
        names = {field.name: field.encode_name for field in msgspec.structs.fields(table)}
        for key, remark in _remarks(table).items():
            if names[key] in found:
                found[names[key]]["description"] = remark
    whole = _as_written(made["$defs"].pop("SceneTables"))
    return {
        "$schema": DIALECT, **whole, "title": "vlmb scene", "description": "A scene file of vlmb",
        "$defs": {name: _as_written(entry) for name, entry in made["$defs"].items()},
    }  # fmt: skip


def _remarks(table: type[Table]) -> dict[str, str]:
    """Read the remarks behind a table's keys: units, and what they mean."""
    return dict(REMARK.findall(inspect.getsource(table)))


def _as_written(entry: Any) -> Any:
    """Turn an entry into what may stand in a file: no null, patterns of any reader, expressions for numbers."""
    if isinstance(entry, (list, tuple)):
        return [_as_written(part) for part in entry]
    if not isinstance(entry, dict):
        return entry
    found = {key: _as_written(value) for key, value in entry.items()}
    if found.get("default", 0) is None:
        del found["default"]
    if "pattern" in found:
        found["pattern"] = found["pattern"].replace(r"\A", "^").replace(r"\Z", "$")
    return _with_expressions(found)


def _with_expressions(entry: dict[str, Any]) -> dict[str, Any]:
    """Let a number be an expression, and leave null out of what may stand at a key."""
    about: dict[str, Any] = {key: entry[key] for key in ("description", "default") if key in entry}
    if entry.get("type") == "number":
        return {"anyOf": [{key: value for key, value in entry.items() if key not in about}, EXPRESSION], **about}
    if "anyOf" not in entry:
        return entry
    choices: list[dict[str, Any]] = []
    for choice in entry["anyOf"]:
        parts = choice["anyOf"] if set(choice) == {"anyOf"} else [choice]
        choices += [part for part in parts if part.get("type") != "null" and part not in choices]
    if {"type": "string"} in choices:  # any text may stand here: an expression is one
        choices = [choice for choice in choices if choice != EXPRESSION]
    return {**(choices[0] if len(choices) == 1 else {"anyOf": choices}), **about}
