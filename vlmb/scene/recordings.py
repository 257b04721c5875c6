"""Files of measured data: csv, OpenSim's sto and mot. They are foreign: sizes are looked at first, every damage is named.

A cell that is empty or nan is a sample that is missing.
"""

from __future__ import annotations

import csv
import io
import math
import re
import stat
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from vlmb.errors import SceneError, nearest
from vlmb.scene.c3d import read_c3d

MAX_BYTES, MAX_SAMPLES, MAX_COLUMNS, MAX_CELL = 64_000_000, 1_000_000, 10_000, 200
HEADER_LINES = 200  # of a sto or mot file, at most
FORMATS = (".csv", ".sto", ".mot", ".c3d")


@dataclass(frozen=True)
class Recording:
    """Columns of a file as they stand there: time, values with nan where a sample is missing, units that the file tells."""

    time: list[float]
    columns: Mapping[str, list[float]]
    units: Mapping[str, str]
    degrees: bool | None = None  # whether the file says that its angles are in degrees; None: it says nothing


def find_file(folder: Path, name: str, key: str) -> Path:
    """Return the path of a file beside or below a scene's. Raises SceneError for any other, and what is no file of data."""
    if not name or "\0" in name or Path(name).is_absolute() or ".." in Path(name).parts:
        raise SceneError(f"{key} = {name!r:.120}: must be a file beside the scene file, or below it, by a relative path")
    try:
        path, root = (folder / name).resolve(), folder.resolve()
        if not path.is_relative_to(root):
            raise SceneError(f"{key} = {name!r:.120}: leads out of the scene's folder; put the file beside the scene file")
        found = path.stat()
    except FileNotFoundError:
        raise SceneError(f"{key} = {name!r:.120}: no such file in {str(folder)!r}, where the scene is") from None
    except (OSError, RuntimeError, ValueError) as error:
        raise SceneError(f"{key} = {name!r:.120}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if not stat.S_ISREG(found.st_mode):
        raise SceneError(f"{key} = {name!r:.120}: is no file")
    if path.suffix.lower() not in FORMATS:
        raise SceneError(f"{key} = {name!r:.120}: files of measured data are {', '.join(FORMATS)}")
    if found.st_size > MAX_BYTES:
        raise SceneError(f"{key} = {name!r:.120}: {found.st_size} bytes; at most {MAX_BYTES}: cut it, or drop columns")
    return path


def read_recording(path: Path, time: str, wanted: Sequence[str]) -> Recording:
    """Read the time and some columns of a file. Raises SceneError naming what is wrong and where."""
    try:
        if path.suffix.lower() == ".c3d":
            return Recording(*read_c3d(path, wanted, MAX_SAMPLES))
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
        if len(content) > MAX_BYTES:
            raise SceneError(f"larger than {MAX_BYTES} bytes")
        text = content.decode("utf-8-sig")
        return _read_csv(text, time, wanted) if path.suffix.lower() == ".csv" else _read_sto(text, time, wanted)
    except UnicodeDecodeError as error:
        raise SceneError(f"{path.name}: is no text in UTF-8 (byte {error.start}): save it as UTF-8") from None
    except OSError as error:
        raise SceneError(f"{path.name}: cannot be read: {error.strerror}") from None
    except SceneError as error:
        raise SceneError(f"{path.name}: {error}") from None


def _read_csv(text: str, time: str, wanted: Sequence[str]) -> Recording:
    """Read a header line and rows of numbers; cells are parted by tabs, semicolons or commas, lines with # passed over."""
    lines = io.StringIO(text, newline="")
    first, number = "", 0
    for first in lines:
        number += 1
        if first.strip() and not first.startswith("#"):
            break
    else:
        raise SceneError("is empty: a line with the names of its columns, then a line for each sample")
    separator = next((mark for mark in "\t;" if mark in first), ",")
    rest = io.StringIO(first + lines.read(), newline="")
    return _read_table(_cells(rest, separator, number - 1), time, wanted)


def _cells(text: io.StringIO, separator: str, before: int) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows of a table with the number of the line that each ends on."""
    reader = csv.reader(text, delimiter=separator, strict=True)
    while True:
        try:
            row = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise SceneError(f"line {before + reader.line_num}: {error}") from None
        if row and not row[0].startswith("#"):
            yield before + reader.line_num, row


def _read_table(rows: Iterator[tuple[int, list[str]]], time: str, wanted: Sequence[str]) -> Recording:
    line, header = next(rows)
    header = [name.strip() for name in header]
    if len(header) > MAX_COLUMNS:
        raise SceneError(f"line {line}: {len(header)} columns; at most {MAX_COLUMNS}")
    if all(_is_number(name) for name in header):
        raise SceneError(f"line {line}: there are numbers where the names of the columns should stand; put a header line first")
    places = {name: _place(header, name) for name in (time, *wanted)}
    found: dict[str, list[float]] = {name: [] for name in places}
    for line, row in rows:
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(header):
            raise SceneError(f"line {line}: {len(row)} cells where the header has {len(header)}")
        if len(found[time]) >= MAX_SAMPLES:
            raise SceneError(f"more than {MAX_SAMPLES} samples: cut it, or take every second")
        for name, place in places.items():
            found[name].append(_number(row[place], lambda: f"line {line}, column {name!r:.60}"))  # noqa: B023
    units = {name: unit[1] for name, place in places.items() if (unit := re.search(r"\[([^\[\]]*)\]$", header[place]))}
    return Recording(found[time], {name: found[name] for name in wanted}, units)


def _place(header: Sequence[str], name: str) -> int:
    """Return which column has a name, as it stands there or before a unit: `knee [mm]`."""
    bare = [re.sub(r"\s*\[[^\[\]]*\]$", "", entry) for entry in header]
    for names in (header, bare):
        if names.count(name) > 1:
            raise SceneError(f"{names.count(name)} columns are called {name!r:.60}: rename them")
        if name in names:
            return names.index(name)
    raise SceneError(f"no column {name!r:.60}; {nearest(name, bare)}")


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _number(cell: str, where: Callable[[], str]) -> float:
    """Return the number in a cell, nan in an empty one."""
    cell = cell.strip()
    if not cell or cell.lower() == "nan":
        return math.nan
    try:
        if len(cell) > MAX_CELL or "_" in cell or not cell.isascii():
            raise ValueError
        value = float(cell)
    except ValueError:
        hint = "; the decimal mark is a point" if re.fullmatch(r"-?\d+,\d+", cell) else ""
        raise SceneError(f"{where()}: {cell!r:.60} is no number{hint}; a sample that is missing is an empty cell") from None
    if math.isinf(value):
        raise SceneError(f"{where()}: {cell!r:.60} is no finite number; a sample that is missing is an empty cell")
    return value


def _read_sto(text: str, time: str, wanted: Sequence[str]) -> Recording:
    """Read OpenSim's storage: a header of `key=value` lines up to `endheader`, labels, rows parted by tabs or spaces."""
    lines = text.splitlines()
    end = next((at for at, line in enumerate(lines[:HEADER_LINES]) if line.strip().lower() == "endheader"), None)
    if end is None:
        raise SceneError(f"no line `endheader` among the first {HEADER_LINES}: not a sto or mot file, or damaged")
    told = {}
    for line in lines[:end]:
        key, mark, value = line.partition("=")
        if not mark:
            key, _, value = line.strip().partition(" ")
        told[key.strip().lower()] = value.strip()
    kind = told.get("datatype", "double")
    if kind.lower() != "double":
        raise SceneError(f"DataType={kind:.40}: only columns of plain numbers (double) can be read")
    degrees = told.get("indegrees")
    if degrees is not None and degrees.lower() not in ("yes", "no"):
        raise SceneError(f"inDegrees={degrees:.40}: must be yes or no")
    rows = ((at + 1, lines[at].split()) for at in range(end + 1, len(lines)) if lines[at].strip())
    numbered = list(rows)
    if not numbered:
        raise SceneError("no line with the names of its columns after `endheader`")
    for key, found in (("nrows", len(numbered) - 1), ("datarows", len(numbered) - 1),
                       ("ncolumns", len(numbered[0][1])), ("datacolumns", len(numbered[0][1]))):  # fmt: skip
        if key in told and told[key] != str(found):
            raise SceneError(f"its header says {key} = {told[key]:.40}, and there are {found}: it is damaged, or was cut")
    read = _read_table(iter(numbered), time, wanted)
    return Recording(read.time, read.columns, {}, None if degrees is None else degrees.lower() == "yes")
