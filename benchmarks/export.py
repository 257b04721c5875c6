"""What it takes to export a minute of motion as one page: time, size, and what the page loses of the motion.

Usage: python benchmarks/export.py

A run of 60 s at 60 frames a second, made of a shipped scene's motion played forth and back. The loss is read back from the page:
its tracks at every frame beside the motion itself.
"""

from __future__ import annotations

import base64
import dataclasses
import re
import tempfile
import time
from pathlib import Path
from typing import Any

from common import table, write_report

# isort: split
import numpy as np
import umsgpack
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import vlmb
from vlmb.views.page import ROOT
from vlmb.views.view import export_html
from vlmb.views.visual_model import Scenery, of_trajectory

Array = NDArray[Any]

SECONDS, FPS = 60.0, 60.0
LIMITS = {"one_link": (5.0, 10.0), "skier_one_link": (5.0, 10.0), "skier_whole_body": (20.0, 20.0)}  # s, MB
REPEATS = 3
MODELS = Path(__file__).resolve().parents[1] / "models"


def longer(trajectory: vlmb.Trajectory, seconds: float) -> vlmb.Trajectory:
    """Play a motion forth and back until it lasts so long; the ski's way goes on, so that the track is as long as a real one."""
    samples, period = len(trajectory), float(trajectory.t[-1])
    order, t = [np.arange(samples)], [trajectory.t]
    for turn in range(1, int(np.ceil(seconds / period))):
        order.append(np.arange(1, samples) if turn % 2 == 0 else np.arange(samples - 2, -1, -1))
        t.append(trajectory.t[1:] + turn * period)
    times, picks = np.concatenate(t), np.concatenate(order)
    kept = times <= seconds + 1e-9
    changes = {name: getattr(trajectory, name)[picks][kept] for name in ("q", "v", "work", "asked")}
    if trajectory.mechanism.layout.base == "ski":
        changes["q"] = changes["q"].copy()
        changes["q"][:, 0] = np.cumsum(np.abs(np.diff(changes["q"][:, 0], prepend=changes["q"][:1, 0])))
    return dataclasses.replace(trajectory, t=times[kept], **changes)


def tracks_of(text: str) -> dict[tuple[str, str], tuple[Array, Array]]:
    """Read the tracks of a page back: (path, property) -> times, values."""
    handlers = {0x17: lambda ext: np.frombuffer(ext.data, "<f4"), 0x16: lambda ext: np.frombuffer(ext.data, "<u4")}
    found = {}
    for block in re.findall(r'<script type="application/octet-stream">([^<]*)</script>', text):
        command = umsgpack.unpackb(base64.b64decode(block), ext_handlers=handlers)
        for entry in command.get("animations", []):
            for track in entry["clip"]["tracks"]:
                times = track["times"].astype(float)
                found[entry["path"], track["name"]] = times, track["values"].reshape(len(times), -1).astype(float)
    return found


def loss(made: Scenery, text: str) -> float:
    """Largest error [m] of positions and stretches, and of the direction of a rod of 1 m, over all bodies and frames."""
    tracks, worst = tracks_of(text), 0.0

    def shown(path: str, name: str, standing: Array) -> Array:
        times, values = tracks.get((f"{ROOT}/{path}", name), (np.zeros(1), standing[:1]))
        return np.column_stack([np.interp(made.t - made.t[0], times, column) for column in values.T])

    for body in made.bodies:
        for name, values in ((".position", body.position), (".scale", body.scale)):
            if values.ndim == 2:
                worst = max(worst, float(np.abs(shown(body.path, name, values) - values).max()))
        if body.rotation.ndim == 3:
            standing = Rotation.from_matrix(body.rotation[:1]).as_quat()
            turned = Rotation.from_quat(shown(body.path, ".quaternion", standing)).as_matrix()
            worst = max(worst, float(np.linalg.norm(turned[..., 0] - body.rotation[..., 0], axis=1).max()))
    return worst


def measure(name: str) -> dict[str, Any]:
    """Export one scene's minute some times; seconds are of the wall, the fastest counts."""
    minute = longer(vlmb.simulate(MODELS / f"{name}.toml"), SECONDS)
    with tempfile.TemporaryDirectory() as folder:
        path, took = Path(folder) / "minute.html", []
        for _ in range(REPEATS):
            began = time.perf_counter()
            export_html(minute, path, fps=FPS)
            took.append(time.perf_counter() - began)
        text, size = path.read_text("utf-8"), path.stat().st_size
        one = export_html(minute.mechanism, path).stat().st_size
    made, tracks = of_trajectory(minute, FPS), tracks_of(text)
    return {
        "bodies": len(made.bodies), "frames": len(made.t), "tracks": len(tracks), "possible": 3 * len(made.bodies),
        "seconds": min(took), "megabytes": size / 1e6, "viewer": one / 1e6, "loss": loss(made, text),
    }  # fmt: skip


def main() -> None:
    """Measure, write the report, and say whether the limits hold."""
    found = {name: measure(name) for name in LIMITS}
    rows = [
        (f"`{name}`", entry["bodies"], f"{entry['tracks']} of {entry['possible']}", f"{entry['seconds']:.2g}",
         f"{SECONDS / entry['seconds']:.0f}", f"{LIMITS[name][0]:g}", f"{entry['megabytes']:.2g}", f"{entry['viewer']:.2g}",
         f"{LIMITS[name][1]:g}", f"{1e6 * entry['loss']:.1g}")
        for name, entry in found.items()
    ]  # fmt: skip
    header = ("scene", "bodies", "tracks", "time, s", "times real time", "acceptable, s", "size, MB", "of it viewer, MB",
              "acceptable, MB", "loss, um")  # fmt: skip
    held = all(entry["seconds"] < LIMITS[name][0] and entry["megabytes"] < LIMITS[name][1] for name, entry in found.items())
    text = [
        "# Export of a minute of motion",
        f"`export_html` of {SECONDS:g} s at {FPS:g} frames a second; wall time, the fastest of {REPEATS}. "
        "A track is the place, the turn or the stretch of one body over time; what stands still has none. The viewer is "
        "meshcat's script with the shapes. The loss is the largest error of a place, a stretch, or the end of a rod of 1 m "
        "at any frame: 32-bit numbers.",
        table(header, rows),
        f"The limits {'hold' if held else 'DO NOT hold'}.",
    ]
    for path in write_report("export", "\n\n".join(text), found, ("meshcat", "numpy", "scipy")):
        print(f"wrote {path}")


if __name__ == "__main__":
    main()
