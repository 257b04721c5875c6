"""C3D files of motion capture: points and analogs by ezc3d, after a look at what the file claims to hold.

ezc3d believes what a file says of itself. So sizes are held against the file's own before it is asked to read.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vlmb.errors import SceneError, nearest

BLOCK, INTEL, MAGIC = 512, 84, 0x50
LONG = 65535  # frames that a header can count to
AXES = "xyz"
Columns = tuple[list[float], dict[str, list[float]], dict[str, str]]


def read_c3d(path: Path, wanted: Sequence[str], most: int) -> Columns:
    """Read points (`LKNE.z`) and analogs (`Fz1`) by name: times from 0 at the first frame, values, units.

    `most` samples. Raises SceneError for what is damaged, missing or mixed.
    """
    try:
        import ezc3d
    except ImportError:
        raise SceneError("c3d files need ezc3d, which is not installed: pip install vlmb[mocap]") from None
    _look_through(path.read_bytes(), most)
    try:
        content: Any = ezc3d.c3d(str(path))
        return _columns(content, wanted)
    except SceneError:
        raise
    except Exception as error:  # ezc3d fails in many ways on a damaged file
        raise SceneError(f"is damaged, or not a c3d file ({type(error).__name__}: {error!s:.120})") from None


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


def _columns(content: Any, wanted: Sequence[str]) -> Columns:
    parameters, data = content["parameters"], content["data"]
    points, analogs = _labels(parameters, "POINT"), _labels(parameters, "ANALOG")
    values: dict[str, list[float]] = {}
    rates: dict[str, float] = {}
    units: dict[str, str] = {}
    for name in wanted:
        point, _, axis = name.rpartition(".")
        if point in points and axis in AXES and axis:
            which = points.index(point)
            found = data["points"][AXES.index(axis), which]
            lost = data["meta_points"]["residuals"][0, which] < 0.0
            values[name] = [math.nan if gone else float(x) for x, gone in zip(found, lost, strict=True)]
            rates[name], units[name] = float(content["header"]["points"]["frame_rate"]), _unit(parameters, "POINT", 0)
        elif name in analogs:
            which = analogs.index(name)
            values[name] = [float(x) for x in data["analogs"][0, which]]
            rates[name], units[name] = float(content["header"]["analogs"]["frame_rate"]), _unit(parameters, "ANALOG", which)
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


def _labels(parameters: Any, group: str) -> list[str]:
    """Names of all channels of a group; a group of many has them in several parameters."""
    found: list[str] = []
    for key in ("LABELS", *(f"LABELS{k}" for k in range(2, 100))):
        if group not in parameters or key not in parameters[group]:
            break
        found += [str(label).strip() for label in parameters[group][key]["value"]]
    return found


def _unit(parameters: Any, group: str, which: int) -> str:
    units = parameters[group]["UNITS"]["value"] if "UNITS" in parameters[group] else []
    return str(units[which]).strip() if which < len(units) else ""
