"""Taking measured data into a scene: from files or arrays to samples in m, rad, N; afterwards the scene needs no file."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from vlmb.errors import SceneError, nearest
from vlmb.scene.explain import unknown_key
from vlmb.scene.recordings import MAX_SAMPLES, Recording, find_file, read_recording
from vlmb.scene.tables import ALLOWED_NAME, MAX_NAME, NAME, Column, Data, Table

DEG = math.pi / 180.0
UNITS: Mapping[str, tuple[str, float, float]] = {  # unit of a scene, then what to multiply and divide by: 9 mm are 9/1000 m
    "m": ("m", 1, 1), "cm": ("m", 1, 100), "mm": ("m", 1, 1000), "km": ("m", 1000, 1),
    "rad": ("rad", 1, 1), "deg": ("rad", DEG, 1),
    "N": ("N", 1, 1), "kN": ("N", 1000, 1), "N m": ("N m", 1, 1), "N mm": ("N m", 1, 1000),
    "m/s": ("m/s", 1, 1), "mm/s": ("m/s", 1, 1000), "km/h": ("m/s", 1, 3.6), "rad/s": ("rad/s", 1, 1), "deg/s": ("rad/s", DEG, 1),
    "m/s^2": ("m/s^2", 1, 1), "s": ("s", 1, 1), "ms": ("s", 1, 1000), "kg": ("kg", 1, 1), "1": ("", 1, 1), "": ("", 1, 1),
}  # fmt: skip
SPELLED = {"Nm": "N m", "Nmm": "N mm", "degrees": "deg", "degree": "deg", "radians": "rad", "meters": "m", "M": "m", "MM": "mm"}
MAX_NUMBERS = 4_000_000  # in all data of a scene
LARGEST = 1e50


class Samples(tuple[Any, ...]):
    """Numbers that were looked at already: finite, None where a sample is missing."""

    __slots__ = ()


def take_in(entries: Any, folder: Path) -> Any:
    """Return `data` of a scene with the samples of its files and arrays in it. Raises SceneError naming key and file.

    What was taken in before is returned as it is; what is no list is left to those who check the scene.
    """
    if not isinstance(entries, (list, tuple)):
        return entries
    found = [_entry(entry, f"data[{at}]", folder) for at, entry in enumerate(entries)]
    if sum(len(column["values"]) for entry in found for column in entry["columns"].values()) > MAX_NUMBERS:
        raise SceneError(f"data: more than {MAX_NUMBERS} samples in all; drop columns, or take every second sample")
    return found


def given_keys(table: Any, kind: type[Table], key: str) -> dict[str, Any]:
    """Return the keys of a table, or of a dict in its place, checked by name."""
    fields = msgspec.structs.fields(kind)
    if isinstance(table, kind):
        given = [(field, getattr(table, field.name)) for field in fields]
        return {field.encode_name: value for field, value in given if value is not field.default}
    if not isinstance(table, Mapping):
        raise SceneError(f"{key} = {table!r:.80}: must be a table")
    known = [field.encode_name for field in fields]
    for name in table:
        if name not in known:
            raise SceneError(unknown_key(key, str(name), known))
    return dict(table)


def _entry(entry: Any, key: str, folder: Path) -> dict[str, Any]:
    given = given_keys(entry, Data, key)
    if not isinstance(given.get("columns"), Mapping) or not given["columns"]:
        raise SceneError(f"{key}.columns: must be a table of names, such as {{knee = \"knee_length\"}}")
    columns = {str(name): _column(name, what, f"{key}.columns.{name}") for name, what in given["columns"].items()}
    arrays = [name for name, column in columns.items() if "values" in column]
    if len(arrays) < len(columns):
        if arrays:
            why = "has values where others come from a file; put it into [[data]] of its own"
            raise SceneError(f"{key}.columns.{arrays[0]}: {why}")
        if not isinstance(given.get("file"), str):
            raise SceneError(f"{key}: needs a `file`, or `time` and columns of numbers")
        return {**given, **_from_file(given, columns, key, folder)}
    if "time" not in given or isinstance(given["time"], (str, Mapping)):
        raise SceneError(f"{key}.time: columns of numbers need a list of times [s]")
    time = require_ascending(as_samples(given["time"], f"{key}.time"), f"{key}.time")
    for name, column in columns.items():
        column["values"] = _converted(as_samples(column["values"], f"{key}.columns.{name}"), column, f"{key}.columns.{name}")
        if len(column["values"]) != len(time):
            raise SceneError(f"{key}.columns.{name}: {len(column['values'])} values at {len(time)} times")
    return {**given, "time": time, "columns": columns}


def _column(name: Any, what: Any, key: str) -> dict[str, Any]:
    """Return a column as a dict of `from` or `values`, and the rest."""
    if not isinstance(name, str) or not re.fullmatch(NAME, name) or len(name) > MAX_NAME:
        raise SceneError(f"{key}: {name!r:.80} is no name: {ALLOWED_NAME}")
    if name.endswith(("_dot", "_ddot")):
        raise SceneError(f"{key}: names with _dot and _ddot are those of derivatives; choose another")
    if isinstance(what, str):
        return {"from": what}
    column = given_keys(what, Column, key) if isinstance(what, (Mapping, Column)) else {"values": what}
    if not isinstance(column.get("unit", ""), str) or not isinstance(column.get("from", ""), str):
        raise SceneError(f"{key}: `from` and `unit` must be texts")
    if "values" in column and column["values"] is None:
        column.pop("values")
    return column if "values" in column else {"from": name, **column}


def _from_file(given: dict[str, Any], columns: dict[str, dict[str, Any]], key: str, folder: Path) -> dict[str, Any]:
    """Return time and columns of a file, in the units of a scene."""
    path = find_file(folder, given["file"], f"{key}.file")
    time = given.get("time", "time")
    scale = {"from": time} if isinstance(time, str) else given_keys(time, Column, f"{key}.time")
    if not isinstance(scale.get("from", "time"), str) or not isinstance(scale.get("unit", "s"), str):
        raise SceneError(f"{key}.time = {time!r:.80}: must be the name of a column")
    source = scale.get("from", "time")
    try:
        read = read_recording(path, source, list(dict.fromkeys(column["from"] for column in columns.values())))
        factor = _unit(scale.get("unit") or read.units.get(source, "s"), f"{key}.time")
        if factor[0] != "s":
            raise SceneError(f"{key}.time: its unit is {factor[0]!r}, not that of a time: s or ms")
        where = f"{path.name}: column {source!r:.60}"
        times = require_ascending(as_samples([t * factor[1] / factor[2] for t in read.time], where), where)
        taken = {name: _taken(column, read, f"{key}.columns.{name}", path.name) for name, column in columns.items()}
    except SceneError as error:
        raise SceneError(str(error) if str(error).startswith(key) else f"{key}.file: {error}") from None
    return {"time": times, "columns": taken}


def _taken(column: dict[str, Any], read: Recording, key: str, file: str) -> dict[str, Any]:
    """Return a column with its values from a file, in the units of a scene."""
    source, made = column["from"], dict(column)
    unit = made.get("unit")
    if unit is None and read.degrees:
        why = f"{file} says inDegrees=yes: give its unit, 'deg' of an angle, 'm' of a length"
        raise SceneError(f"{key}: {why}")
    if unit is None:
        told = read.units.get(source, "")
        unit = told if SPELLED.get(told, told) in UNITS else ""
    angle = SPELLED.get(unit, unit)
    if (read.degrees is True and angle in ("rad", "rad/s")) or (read.degrees is False and angle in ("deg", "deg/s")):
        said = "yes" if read.degrees else "no"
        raise SceneError(f"{key}.unit = {unit!r}: {file} says inDegrees={said}; mend the one that is wrong")
    made["unit"] = unit
    made["values"] = _converted(as_samples(read.columns[source], f"{file}: column {source!r:.60}"), made, key)
    return made


def _unit(name: str, key: str) -> tuple[str, float, float]:
    spelled = SPELLED.get(name, name)
    if spelled not in UNITS:
        raise SceneError(f"{key}.unit = {name!r:.40}: unknown unit; {nearest(name, [unit for unit in UNITS if unit])}")
    return UNITS[spelled]


def _converted(values: Samples, column: dict[str, Any], key: str) -> Samples:
    """Return values in the unit of a scene, and note that unit."""
    unit, times, over = _unit(column.get("unit") or "", key)
    column["unit"] = unit
    return values if times == over else Samples(None if x is None else x * times / over for x in values)


def as_samples(values: Any, key: str) -> Samples:
    """Return numbers as samples. Raises SceneError for what is none, too many, infinite or too large."""
    if isinstance(values, Samples):
        return values
    if isinstance(values, (str, bytes, Mapping)) or not hasattr(values, "__len__"):
        raise SceneError(f"{key} = {values!r:.80}: must be a list of numbers")
    if len(values) > MAX_SAMPLES:
        raise SceneError(f"{key}: {len(values)} samples; at most {MAX_SAMPLES}")
    try:
        kinds = set(map(type, values)) if isinstance(values, (list, tuple)) else set()
        if kinds & {str, bool, bytes}:
            raise ValueError
        array = np.array(values, dtype=float)
        if array.ndim != 1:
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        raise SceneError(f"{key}: must be a list of numbers, nan where a sample is missing") from None
    if not (np.isnan(array) | (np.abs(array) <= LARGEST)).all():
        at = int(np.argmax(~(np.isnan(array) | (np.abs(array) <= LARGEST))))
        raise SceneError(f"{key}: sample {at + 1} is {array[at]}: too large, or not finite")
    return Samples(None if x != x else x for x in array.tolist())


def require_ascending(time: Samples, key: str) -> Samples:
    """Return times that ascend. Raises SceneError naming the first that does not, or is missing."""
    for at, t in enumerate(time):
        if t is None:
            raise SceneError(f"{key}: sample {at + 1} has no time")
        if at and not time[at - 1] < t:
            raise SceneError(f"{key}: times must ascend: sample {at + 1} is at {t:.9g} s, the one before at {time[at - 1]:.9g} s")
    return time
