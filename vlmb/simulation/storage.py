"""Files of a run: arrays and a note in one npz, columns as csv. Reading a file never runs anything in it."""

from __future__ import annotations

import contextlib
import csv
import json
import math
import os
import zipfile
from collections.abc import Container, Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import TrajectoryError, VlmbError
from vlmb.simulation.files import replacing

Array = NDArray[np.float64]

MAX_NOTE = 64_000_000  # bytes
HUGE = 1e100  # no value of a run is so large
FORMAT = 2  # 1: q, v and work where 2 has the states of an engine


def checked_path(path: Any) -> Path:
    """Return the path of a file. Raises TrajectoryError for what is none: open() would take a number for an open file."""
    if isinstance(path, (str, os.PathLike)):
        return Path(path)
    raise TrajectoryError(f"{path!r:.80}: must be the path of a file, such as 'run.npz'")


def write_arrays(path: Path, note: Mapping[str, Any], arrays: Mapping[str, Array]) -> Path:
    """Write named arrays and a note of plain data, whole or not at all. Raises OutputError."""
    text = json.dumps({"format": FORMAT, **note})
    with replacing(path) as beside, beside.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, note=np.array(text), **arrays)
    return path


class Stored:
    """A file that `write_arrays` wrote: its note, and its arrays, each looked at before it is read."""

    def __init__(self, path: Path, file: zipfile.ZipFile, formats: Container[int]) -> None:
        self.path, self.file = path, file
        note = json.loads(str(self._read("note", MAX_NOTE, "U")))
        if not isinstance(note, dict):
            raise TrajectoryError(f"{path}: not a trajectory of vlmb: its note is no table")
        if note["format"] not in formats:
            raise TrajectoryError(f"{path}: format {note['format']!r:.80}; this version reads format {formats}")
        self.note: dict[str, Any] = note

    def shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of an array as its header says. Raises TrajectoryError for one that has no real numbers."""
        with self._opened(name) as entry:
            shape, _, kind = _header(entry)
        if kind.kind not in "fiu":
            raise TrajectoryError(f"{self.path}: {name} is damaged: {kind} where real numbers belong")
        return shape

    def read(self, name: str, shape: tuple[int, ...]) -> Array:
        """Return an array of this shape. Raises TrajectoryError for another one, and for values that no run has."""
        found = self.shape(name)
        if found == shape:
            values = np.asarray(self._read(name, math.inf, "fiu"), dtype=float)
            if (np.isfinite(values) & (np.abs(values) < HUGE) | (np.isnan(values) & (name == "asked"))).all():  # not known: nan
                return values
        raise TrajectoryError(f"{self.path}: {name} is damaged: shape {found} where its scene needs {shape}, finite")

    def _opened(self, name: str) -> IO[bytes]:
        """Open an entry. Raises TrajectoryError for a way of packing that this package never takes."""
        about = self.file.getinfo(f"{name}.npy")
        if about.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise TrajectoryError(f"{self.path}: {name} is damaged: it is packed in another way")
        return self.file.open(about)

    def _read(self, name: str, most: float, kinds: str) -> Any:
        """Read an entry of these kinds, of so many bytes at most."""
        with self._opened(name) as entry:
            shape, _, kind = _header(entry)
            if kind.kind not in kinds or math.prod(shape) * kind.itemsize > most:
                raise TrajectoryError(f"{self.path}: not a trajectory of vlmb, or damaged ({name}: {kind}, shape {shape})")
        with self._opened(name) as entry:
            return np.lib.format.read_array(entry, allow_pickle=False)


def _header(entry: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Read shape, order and kind of an array. Raises ValueError for what is no npy file."""
    version = np.lib.format.read_magic(entry)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, order, kind = read(entry)
    if min(shape, default=0) < 0:
        raise ValueError(f"shape {shape}")
    return shape, order, kind


@contextlib.contextmanager
def reading(path: str | Path, formats: Container[int]) -> Iterator[Stored]:
    """Open a file that `write_arrays` wrote.

    Raises TrajectoryError, also for what fails inside: a file that is missing, damaged or foreign.
    """
    path = checked_path(path)
    try:
        if not path.is_file():
            path.open("rb").close()  # tells a missing file
            raise TrajectoryError(f"{path}: not a file")
        if not zipfile.is_zipfile(path):
            raise TrajectoryError(f"{path}: not a trajectory of vlmb: `vlmb run` writes these as .npz files")
        with zipfile.ZipFile(path) as file:
            yield Stored(path, file, formats)
    except FileNotFoundError:
        raise TrajectoryError(f"{path}: no such file") from None
    except VlmbError:
        raise
    except Exception as error:  # a damaged zip fails in many ways: an unknown method, a password, lengths that do not fit
        said = "".join(letter if letter.isprintable() else "?" for letter in str(error)[:200])
        raise TrajectoryError(f"{path}: not a trajectory of vlmb, or damaged ({type(error).__name__}: {said})") from None


def write_columns(path: Path, columns: Mapping[str, Array]) -> Path:
    """Write named columns (N,) with a header, whole or not at all. Raises OutputError."""
    with replacing(path) as beside, beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))
    return path
