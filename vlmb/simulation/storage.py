"""Files of a run: arrays and a note in one npz, columns as csv. Reading a file never runs anything in it."""

from __future__ import annotations

import csv
import json
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import TrajectoryError
from vlmb.simulation.files import replacing

Array = NDArray[np.float64]

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


def read_arrays(path: str | Path, names: Mapping[int, tuple[str, ...]]) -> tuple[dict[str, Any], dict[str, Array]]:
    """Read the arrays of each format that `write_arrays` wrote, by format.

    Raises TrajectoryError for a file that is missing, damaged or foreign.
    """
    path = checked_path(path)
    try:
        if not zipfile.is_zipfile(path):
            Path(path).open("rb").close()  # tells a missing file
            raise TrajectoryError(f"{path}: not a trajectory of vlmb: `vlmb run` writes these as .npz files")
        with Path(path).open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            note = json.loads(str(file["note"]))
            if not isinstance(note, dict):
                raise TrajectoryError(f"{path}: not a trajectory of vlmb: its note is no table")
            if note["format"] not in names:
                known = " and ".join(map(str, names))
                raise TrajectoryError(f"{path}: format {note['format']}; this version reads format {known}")
            arrays = {name: np.asarray(file[name], dtype=float) for name in names[note["format"]]}
    except FileNotFoundError:
        raise TrajectoryError(f"{path}: no such file") from None
    except TrajectoryError:
        raise
    except Exception as error:  # a damaged zip fails in many ways: an unknown method, a password, lengths that do not fit
        raise TrajectoryError(f"{path}: not a trajectory of vlmb, or damaged ({type(error).__name__}: {error})") from None
    return note, arrays


def write_columns(path: Path, columns: Mapping[str, Array]) -> Path:
    """Write named columns (N,) with a header, whole or not at all. Raises OutputError."""
    with replacing(path) as beside, beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))
    return path
