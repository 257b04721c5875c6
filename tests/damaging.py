"""Damaged files and scenes, by seed: each is refused by a named error, or read as it is written, soon and in little memory."""

from __future__ import annotations

import io
import json
import random
import struct
import sys
import time
import unicodedata
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.small_scenes import FIXED, PIVOT, SKI, bent, link, write_toml
from vlmb.scene.scene import tomllib

resource = pytest.importorskip("resource")  # what a process takes
ROOT = Path(__file__).resolve().parents[1]
SECONDS, MEGABYTES = 2.0, 200.0  # that one may take
MODELS = (
    "one_link", "two_links", "prescribed", "chaplygin_sleigh", "skate_on_slope", "tree", "plane_two_links", "single_support",
)  # fmt: skip
ODD_NUMBERS = (
    0, -1, 1e308, -1e308, 1e-320, float("nan"), float("inf"), -float("inf"), 10**400, -(10**30), 2**63, 1e300, 3.5, True, False,
)  # fmt: skip
ODD_TEXTS = (
    "", "x" * 100_000, "\x1b[31mred\x1b[0m", "a\x00b", "\N{SKIER}", "\u202eabc", "t" * 300, "1e999", "nan", "1/0",
    "__import__('os')", "((((" * 200, "-" * 50_000 + "1", "sin(" * 150 + "t" + ")" * 150, "+".join(["t"] * 3000),
    "psi1", "legs.tip.z", "psi1 = psi1",
    "9**9**9**9", "(t+psi1)**64", "x; y", "\n\n", "[1]", "é" * 200,
)  # fmt: skip
Judged = tuple[str, float, float]  # what became of it; seconds; megabytes above the peak before


def judged(read: Callable[[], Any]) -> Judged:
    """Read something damaged: `read`, or `refused: ...` by an error of vlmb. Any other error goes through."""
    before, began = peak(), time.perf_counter()
    try:
        read()
        said = "read"
    except vlmb.VlmbError as error:
        said = f"refused: {error}"
    found = said, time.perf_counter() - began, peak() - before
    assert len(said) < 5000 and said != "refused: " and printable(said), f"{said!r:.300}"
    return found


def peak() -> float:
    """Largest memory of this process so far [MB]."""
    unit = 1024.0**2 if sys.platform == "darwin" else 1024.0
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit)


def printable(text: str) -> bool:
    """Whether a text does nothing to a terminal but stand there."""
    return all(unicodedata.category(letter) not in ("Cc", "Cs") or letter in "\n\t\r" for letter in text)


# Stored runs ---------------------------------------------------------------------------------------------------------


def stored_runs(folder: Path) -> list[Path]:
    """Write runs to damage: by the core and by Pinocchio, with a control, with rows."""
    legs = bent(SKI, 1)
    control = vlmb.simulate(bent(PIVOT, 1), duration=0.1, control=lambda t, view: {"M_psi1": 0.1})
    held = vlmb.Scene.from_dict(
        {"base": PIVOT, "links": [link("leg", lower=FIXED, upper=FIXED)], "constraints": ["phi1 = 0.2"], "start": {"phi1": 0.2}}
    )
    runs = [vlmb.simulate(legs, duration=0.1), control, vlmb.simulate(held, duration=0.1, engine="pinocchio")]
    return [run.save(folder / f"run{k}.npz") for k, run in enumerate(runs)]


def damaged_run(path: Path, seed: int) -> bytes:
    """Damage a stored run."""
    draw = random.Random(seed)
    content = path.read_bytes()
    way = draw.choice((*[in_bytes] * 3, *[in_an_entry] * 6, *[in_the_note] * 5, in_the_zip))
    return way(content, draw)


def in_bytes(content: bytes, draw: random.Random) -> bytes:
    """Flip, cut, repeat or put in some bytes."""
    damaged = bytearray(content)
    for _ in range(draw.choice((1, 3, 30))):
        at = draw.randrange(len(damaged))
        way = draw.randrange(4)
        if way == 0:
            damaged[at] ^= 1 << draw.randrange(8)
        elif way == 1:
            damaged[at] = draw.randrange(256)
        elif way == 2:
            damaged[at:at] = bytes(draw.randrange(256) for _ in range(draw.randrange(1, 9)))
        else:
            del damaged[at : at + draw.randrange(1, 40)]
    return bytes(damaged[: draw.randrange(len(damaged))] if draw.random() < 0.2 else damaged)


def entries_of(content: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        return {name: file.read(name) for name in file.namelist()}


def zipped(entries: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as file:
        for name, content in entries.items():
            file.writestr(name, content)
    return out.getvalue()


def as_npy(array: Any) -> bytes:
    out = io.BytesIO()
    np.save(out, array, allow_pickle=True)
    return out.getvalue()


def header_only(shape: tuple[int, ...], kind: str = "<f8") -> bytes:
    """An npy file that promises more than it has."""
    text = repr({"descr": kind, "fortran_order": False, "shape": shape}).encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + b"\x00" * 80


def in_an_entry(content: bytes, draw: random.Random) -> bytes:
    """Replace an array by one that is none of a run."""
    entries = entries_of(content)
    name = draw.choice([name for name in entries if name != "note.npy"])
    array = np.load(io.BytesIO(entries[name]))
    odd = np.array(array, float)
    flat = odd.reshape(-1)
    if flat.size:
        flat[draw.randrange(flat.size)] = draw.choice((np.nan, np.inf, -1e300, 1e300, -1.0, 1e9))
    ways: list[Callable[[], bytes]] = [
        lambda: header_only((10**9, 10**3)), lambda: header_only((2**62,)), lambda: header_only((10**7, 3)),
        lambda: header_only((-1,)), lambda: header_only((), "|O"), lambda: header_only((4,), "V100000000"),
        lambda: as_npy(np.array([{"a": 1}, None], object)), lambda: as_npy(array.astype(complex) + 1j),
        lambda: as_npy(array.astype(str)), lambda: as_npy(array * 1e300), lambda: as_npy(-array), lambda: as_npy(odd),
        lambda: as_npy(odd), lambda: as_npy(array[::-1]), lambda: as_npy(array[..., None]), lambda: as_npy(array[:-1]),
        lambda: as_npy(np.zeros(0)), lambda: as_npy(np.array(3.0)), lambda: as_npy(array.astype(">f4")),
        lambda: as_npy(array.astype("datetime64[s]")), lambda: as_npy(np.zeros((3, 3, 3))), lambda: b"", lambda: b"\x93NUMPY",
        lambda: as_npy(np.zeros(20_000_000)), lambda: as_npy(np.zeros((2_000_000, 20))),
    ]  # fmt: skip
    entries[name] = draw.choice(ways)()
    if draw.random() < 0.1:
        del entries[name]
    return zipped(entries)


def in_the_note(content: bytes, draw: random.Random) -> bytes:
    """Replace a value of the note, or all of it."""
    entries = entries_of(content)
    note = json.loads(str(np.load(io.BytesIO(entries["note.npy"]))))
    if draw.random() < 0.25:
        texts = ("[" * 100_000, '{"format": 2}', "null", "", "{" * 50, '{"format": 1e999}', '"' + "x" * 5_000_000 + '"')
        text = draw.choice(texts)
        entries["note.npy"] = as_npy(np.array(text))
        return zipped(entries)
    change_one(note, draw)
    entries["note.npy"] = as_npy(np.array(json.dumps(note)))
    return zipped(entries)


def in_the_zip(content: bytes, draw: random.Random) -> bytes:
    """Rename entries, repeat them, or store them in another way."""
    entries = entries_of(content)
    way = draw.randrange(4)
    if way == 0:
        return zipped({name.removesuffix(".npy"): entry for name, entry in entries.items()})
    if way == 1:
        return zipped(entries | {f"../{k}.npy": b"x" * 100 for k in range(50)})
    if way == 2:
        return zipped(entries, zipfile.ZIP_LZMA)
    return zipped(entries | {"t.npy": as_npy(np.zeros(30_000_000))})


# Scenes --------------------------------------------------------------------------------------------------------------


def damaged_scene(seed: int, folder: Path) -> Path:
    """Write a damaged scene file."""
    draw = random.Random(seed)
    content = (ROOT / "models" / f"{draw.choice(MODELS)}.toml").read_bytes()
    path = folder / f"scene{seed}.toml"
    way = draw.randrange(10)
    if way < 2:
        path.write_bytes(in_bytes(content, draw))
    elif way < 3:
        path.write_bytes(in_text(content.decode(), draw))
    else:
        data = tomllib.loads(content.decode())
        for _ in range(draw.choice((1, 1, 1, 2, 4))):
            change_one(data, draw)
        try:
            write_toml(path, data)
        except (TypeError, ValueError, RecursionError, OverflowError):
            path.write_bytes(content[: draw.randrange(len(content))])
    return path


def in_text(content: str, draw: random.Random) -> bytes:
    """Put something in, or instead of all."""
    at = draw.randrange(len(content))
    whole = (
        "a = " + "[" * 5000 + "]" * 5000, "a = " + "{a=" * 3000 + "1" + "}" * 3000, "\x00" * 1000,
        "[[links]]\n" * 20_000, "x = 1\n" * 3, "".join(f"k{n} = {n}\n" for n in range(50_000)), "a." * 20_000 + "b = 1",
        "=" * 100, "name = '''" + "z" * 3_000_000 + "'''",
    )  # fmt: skip
    inside = (
        "\x00", "\x1b[2J", "\ufeff", "\u2028", "[[links]]\n", "]", '"', "'''", "\\", "= = =", "9" * 400, "1e400",
        "0x" + "f" * 300,
    )  # fmt: skip
    if draw.random() < 0.4:
        return draw.choice(whole).encode()
    return (content[:at] + draw.choice(inside) + content[at:]).encode()


def change_one(data: Any, draw: random.Random) -> None:
    """Change one value, key or list somewhere in plain data."""
    places = list(places_of(data))
    holder, key = draw.choice(places)
    value, way = holder[key], draw.randrange(8)
    odd = draw.choice((*ODD_NUMBERS, *ODD_TEXTS, [], {}, [[[]]], {"a": {"b": {}}}, ["a", 1], None, deep(200), [1.0] * 10_000))
    if isinstance(value, list) and value and way == 1:
        holder[key] = value * draw.choice((2, 3, 40))
    elif isinstance(value, (int, float)) and not isinstance(value, bool) and way < 4:
        holder[key] = draw.choice((value * 1e300, -value, value * 1e9, str(value), f"{value}*k", value * 57.29, 0))
    elif isinstance(value, str) and way < 3:
        holder[key] = value[: draw.randrange(len(value) + 1)] + draw.choice((*ODD_TEXTS, "=", "**", ")", ".", "_dot"))
    elif isinstance(holder, dict) and way == 7:
        holder[draw.choice((key + "x", key.upper(), "a b", "\x07", "", "é"))] = value
        del holder[key]
    else:
        holder[key] = odd


def places_of(data: Any) -> Any:
    """Every place in plain data that has a value: its holder and key."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        yield data, key
        yield from places_of(value)


def deep(levels: int) -> Any:
    """A list in a list in a list."""
    found: Any = 1
    for _ in range(levels):
        found = [found]
    return found


def look_at_run(path: Path) -> None:
    """Read a run and all that is printed and tabled of it."""
    run = vlmb.load_trajectory(path)
    assert printable(run.summary()) and printable(repr(run)), "control characters"
    assert len(run["energy"]) == len(run)
    run.save_csv(path.with_suffix(".csv"))


def look_at_scene(path: Path) -> None:
    """Check a scene and run its first hundredth of a second, or as far as half a second of computing goes."""
    checked = vlmb.check(path)
    assert printable(checked.report) and printable(repr(checked.scene)), "control characters"
    duration, began = min(checked.scene.run.duration, 0.01), time.perf_counter()

    def progress(t: float) -> None:
        if time.perf_counter() - began > 0.5:
            raise KeyboardInterrupt

    made = vlmb.simulate(checked.mechanism, duration, t_eval=np.linspace(0.0, duration, 5), progress=progress)
    assert printable(made.summary()), "control characters"
