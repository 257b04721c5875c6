"""C3D files of motion capture: points and analogs by ezc3d, after a look at what the file claims to hold.

ezc3d believes what a file says of itself, and a damaged one may bring it down. So sizes are held against the file's own before it
is asked to read, and it reads in a process of its own.
"""

from __future__ import annotations

import importlib.util
import io
import math
import os
import struct
import subprocess
import sys
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vlmb.errors import SceneError, nearest

BLOCK, INTEL, MAGIC = 512, 84, 0x50
LONG = 65535  # frames that a header can count to
AXES = "xyz"
SECONDS, BYTES_A_SECOND = 20.0, 500_000.0  # that ezc3d may take
Columns = tuple[list[float], dict[str, list[float]], dict[str, str]]


def read_c3d(path: Path, wanted: Sequence[str], most: int) -> Columns:
    """Read points (`LKNE.z`) and analogs (`Fz1`) by name: times from 0 at the first frame, values, units.

    `most` samples. Raises SceneError for what is damaged, missing or mixed.
    """
    if not _installed():
        raise SceneError("c3d files need ezc3d, which is not installed: pip install vlmb[mocap]")
    data = path.read_bytes()
    _look_through(data, most)
    return _columns(_read_apart(path, len(data)), wanted)


def _installed() -> bool:
    try:
        return importlib.util.find_spec("ezc3d") is not None
    except ValueError:  # somebody has put something else in its place
        return False


def _look_through(data: bytes, most: int) -> None:
    """Refuse a file whose header or parameters claim more than there is."""
    if len(data) < 2 * BLOCK or data[1] != MAGIC:
        raise SceneError("is not a c3d file, or damaged: its header is none")
    at = (data[0] - 1) * BLOCK
    if data[0] < 2 or at + 4 > len(data):
        raise SceneError(f"is damaged: its parameters are said to begin at block {data[0]} of {len(data) // BLOCK}")
    blocks, processor = data[at + 2], data[at + 3]
    if processor != INTEL:
        raise SceneError(f"is written for processor {processor}; only {INTEL} (Intel) can be read: convert it")
    points, analogs, first, last = struct.unpack_from("<HHHH", data, 2)
    scale, begin = struct.unpack_from("<fH", data, 12)
    (rate,) = struct.unpack_from("<f", data, 20)
    if not (math.isfinite(scale) and math.isfinite(rate) and rate > 0.0):
        raise SceneError(f"is damaged: scale {scale:g}, {rate:g} frames a second")
    if last < first:
        raise SceneError(f"is damaged: frames {first} to {last}")
    size = (4 * points + analogs) * (4 if scale < 0.0 else 2)
    start = (begin - 1) * BLOCK
    if begin < 2 or start > len(data) or (last < LONG and start + (last - first + 1) * size > len(data)):
        claim = f"{last - first + 1} frames of {size} bytes from block {begin}"
        raise SceneError(f"is damaged, or was cut: it claims {claim}, and has {len(data)} bytes")
    if size and (len(data) - start) // size > most:
        raise SceneError(f"more than {most} frames: cut it")
    _walk(data[at : min(at + blocks * BLOCK, start)])


def _walk(section: bytes) -> None:
    """Follow the chain of groups and parameters, and the sizes of their values."""
    at = 4
    for _ in range(len(section)):
        if at + 2 > len(section):
            break
        length, group = struct.unpack_from("<bb", section, at)
        if length == 0 or group == 0:
            return
        offset_at = at + 2 + abs(length)
        if offset_at + 3 > len(section):
            break
        (offset,) = struct.unpack_from("<h", section, offset_at)
        if group > 0 and not _fits(section, offset_at + 2):
            break
        if offset == 0:
            return
        if offset < 0:
            break
        at = offset_at + offset
    raise SceneError("is damaged: its parameters run over their end")


def _fits(section: bytes, at: int) -> bool:
    """Whether the values of a parameter, whose type stands at a place, are there."""
    if at + 2 > len(section):
        return False
    (kind,) = struct.unpack_from("<b", section, at)
    dimensions = section[at + 2 : at + 2 + section[at + 1]]
    return kind in (-1, 1, 2, 4) and at + 2 + section[at + 1] + abs(kind) * math.prod(dimensions) <= len(section)


def _read_apart(path: Path, size: int) -> dict[str, Any]:
    """Have ezc3d read a file in a process of its own, for some time at most."""
    child, seconds = Path(__file__).with_name("c3d_child.py"), SECONDS + size / BYTES_A_SECOND
    environment = {**os.environ, "PYTHONSAFEPATH": "1"}  # no module of a folder that it happens to run in
    try:
        done = subprocess.run(
            [sys.executable, str(child), str(path)], capture_output=True, check=False, timeout=seconds, env=environment
        )
    except subprocess.TimeoutExpired:
        raise SceneError(f"is damaged: ezc3d has not read it in {seconds:.0f} s") from None
    if done.returncode:
        last = done.stderr.decode("utf-8", "replace").strip().rpartition("\n")[2]
        raise SceneError(f"is damaged, or not a c3d file (ezc3d: {last or f'ended by {done.returncode}'!s:.160})")
    try:
        with np.load(io.BytesIO(done.stdout), allow_pickle=False) as found:
            return {name: found[name] for name in found.files}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise SceneError(f"is damaged: what ezc3d read of it is none ({error!s:.120})") from None


def _columns(found: Mapping[str, Any], wanted: Sequence[str]) -> Columns:
    points, analogs = found["point_names"].tolist(), found["analog_names"].tolist()
    if len(points) > found["points"].shape[1] or len(analogs) > found["analogs"].shape[0]:
        raise SceneError("is damaged: it names more channels than it has")
    values: dict[str, list[float]] = {}
    rates: dict[str, float] = {}
    units: dict[str, str] = {}
    for name in wanted:
        point, _, axis = name.rpartition(".")
        if point in points and axis in AXES and axis:
            which = points.index(point)
            seen = np.where(found["residuals"][which] < 0.0, np.nan, found["points"][AXES.index(axis), which])
            values[name], rates[name], units[name] = seen.tolist(), float(found["rates"][0]), _unit(found["point_units"], 0)
        elif name in analogs:
            which = analogs.index(name)
            unit = _unit(found["analog_units"], which)
            values[name], rates[name], units[name] = found["analogs"][which].tolist(), float(found["rates"][1]), unit
        else:
            known = [*(f"{label}.{axis}" for label in points for axis in AXES), *analogs]
            raise SceneError(f"no point or analog {name!r:.60}; {nearest(name, known)}; of a point one axis is named: `LKNE.z`")
    if len(set(rates.values())) > 1:
        told = ", ".join(f"{name} {rate:g} Hz" for name, rate in rates.items())
        raise SceneError(f"columns at different rates ({told}) have different times: put them into [[data]] of their own")
    rate, count = next(iter(rates.values())), len(next(iter(values.values())))
    if not (math.isfinite(rate) and rate > 0.0):
        raise SceneError(f"is damaged: {rate:g} samples a second")
    return [k / rate for k in range(count)], values, {name: unit for name, unit in units.items() if unit}


def _unit(units: Any, which: int) -> str:
    return str(units[which]) if which < len(units) else ""
