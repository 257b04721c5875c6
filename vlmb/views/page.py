"""The page: a scenery as one self-contained HTML file that plays in any browser, on meshcat's viewer."""

from __future__ import annotations

import base64
import html
import importlib
import importlib.util
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vlmb.errors import VlmbError
from vlmb.views import shapes
from vlmb.views.appearance import DARK, FLOOR, FLOOR_LINES, LIGHT, SNOW, SNOW_LINES, Theme, by_night
from vlmb.views.bodies import Body
from vlmb.views.shapes import Lines, Mesh
from vlmb.views.visual_model import VIEW_FROM, Scenery

Array = NDArray[np.float64]
FLOATS, WHOLES = 0x17, 0x16  # meshcat's MessagePack extensions for arrays of 32-bit floats and unsigned integers
ROOT = "/vlmb"
STILL = 1e-7  # a track that varies less than this [m, 1] is a constant


def page(scenery: Scenery, speed: float = 1.0, start: float = 0.0, until: float | None = None) -> str:
    """Return the HTML text of a scenery; it refers to nothing outside itself.

    `until` [s]: a motion that is still being computed and lasts so long; the page asks its server for more.
    Raises VlmbError when meshcat is not installed.
    """
    script = _meshcat()
    blocks = "\n".join(f'<script type="application/octet-stream">{text}</script>' for text in packed(scenery))
    values = {
        "TITLE": html.escape(scenery.name),
        "INFO": json.dumps(facts(scenery, speed, start, until)).replace("<", "\\u003c"),
        "BLOCKS": blocks,
        "MESHCAT": script,
    }
    template = Path(__file__).with_name("page.html").read_text(encoding="utf-8")
    return re.sub("@([A-Z]+)@", lambda found: values[found[1]], template)


def packed(scenery: Scenery) -> list[str]:
    """Return the commands that draw a scenery as text."""
    packb = _msgpack().packb
    return [base64.b64encode(packb(command)).decode("ascii") for command in commands(scenery)]


def commands(scenery: Scenery) -> list[dict[str, Any]]:
    """Return meshcat's commands that draw a scenery: objects, their places, and one animation of everything that moves."""
    made = [_placed(ROOT, np.zeros(3), scenery.turn)]
    made += _ground(scenery)
    animations = []
    for body in scenery.bodies:
        path = f"{ROOT}/{body.path}"
        if body.shape is not None:
            made.append(_object(path, body.shape, body.colour, _solid(body)))
        made.append(_placed(path, _first(body.position, 1), _first(body.rotation, 2), _first(body.scale, 1)))
        tracks = _tracks(body, scenery.t)
        if tracks:
            animations.append({"path": path, "clip": {"fps": 1.0, "name": "motion", "tracks": tracks}})
    tracks = [_track("position", "vector3", scenery.focus, scenery.t)] if _moves(scenery.focus) else []
    made.append(_placed(f"{ROOT}/focus", scenery.focus[0]))
    if tracks:
        animations.append({"path": f"{ROOT}/focus", "clip": {"fps": 1.0, "name": "motion", "tracks": tracks}})
    if animations:
        options = {"play": True, "repetitions": 1}
        made.append({"type": "set_animation", "animations": animations, "options": options, "path": ""})
    return made


def facts(scenery: Scenery, speed: float = 1.0, start: float = 0.0, until: float | None = None) -> dict[str, Any]:
    """Return what the page's script has to know of a scenery."""
    view = np.array(VIEW_FROM) / np.linalg.norm(VIEW_FROM)
    up = scenery.turn @ np.array([0.0, 0.0, 1.0])
    duration = float(scenery.t[-1] - scenery.t[0])
    return {
        "duration": duration, "whole": duration if until is None else until, "begin": float(scenery.t[0]),
        "frames": len(scenery.t), "live": until is not None,
        "speed": speed, "start": start, "view": view.tolist(), "distance": 2.6 * scenery.radius, "normal": up.tolist(),
        "events": [[t - float(scenery.t[0]), words] for t, words in scenery.events],
        "ground": scenery.ground.height, "radius": scenery.radius, "reach": scenery.ground.half,
        "leads": "ski" if any(body.path == "ski" for body in scenery.bodies) else "ground",
        "grows": [[body.path, min(body.keeps, 1e9)] for body in scenery.bodies if body.grows],
        "shadows": [body.path for body in scenery.bodies if body.shadow and body.shape is not None],
        "themes": {name: _theme(scenery, theme) for name, theme in (("light", LIGHT), ("dark", DARK))},
    }  # fmt: skip


def _theme(scenery: Scenery, theme: Theme) -> dict[str, Any]:
    """Colours of the surroundings, by day or by night; a body keeps its own unless the night would hide it."""
    plane, lines = (theme.snow, theme.snow_lines) if scenery.ground.snow else (theme.floor, theme.floor_lines)
    colours = {"ground": plane, "ground/lines": lines}
    for body in scenery.bodies:
        if night := by_night(body.path, body.colour):
            colours[body.path] = night if theme is DARK else body.colour
    sky, haze = ([int(colour[k : k + 2], 16) for k in (1, 3, 5)] for colour in (theme.sky, theme.haze))
    return {"sky": sky, "haze": haze, "shadow": theme.shadow, "sun": theme.sun, "ambient": theme.ambient, "colours": colours}


def _tracks(body: Body, t: Array) -> list[dict[str, Any]]:
    """Tracks of what moves; what stands still needs none."""
    tracks = []
    if body.position.ndim == 2 and _moves(body.position):
        tracks.append(_track("position", "vector3", body.position, t))
    if body.rotation.ndim == 3 and _moves(body.rotation):
        tracks.append(_track("quaternion", "quaternion", _quaternions(body.rotation), t))
    if body.scale.ndim == 2 and _moves(body.scale):
        tracks.append(_track("scale", "vector3", body.scale, t))
    return tracks


def _track(name: str, kind: str, values: Array, t: Array) -> dict[str, Any]:
    """Pack a track; keys that lie on the line between their neighbours are left out where they form a standstill."""
    changes = np.abs(np.diff(values, axis=0)).max(axis=1) > 0.01 * STILL
    keep = np.concatenate([[True], changes]) | np.concatenate([changes, [True]])
    times = (t - t[0])[keep]
    return {"name": f".{name}", "type": kind, "times": _floats(times), "values": _floats(values[keep])}


def _moves(values: Array) -> bool:
    return bool((values.max(axis=0) - values.min(axis=0)).max() > STILL)


def _quaternions(rotations: Array) -> Array:
    """Quaternions (N, 4), x y z w, each on the side of the one before it."""
    found = Rotation.from_matrix(rotations).as_quat()
    flips = np.cumprod(np.where(np.sum(found[1:] * found[:-1], axis=1) < 0.0, -1.0, 1.0))
    found[1:] *= flips[:, None]
    return np.asarray(found)


def _first(values: Array, dimensions: int) -> Array:
    return np.asarray(values[0] if values.ndim > dimensions else values)


def _floats(values: Array) -> Any:
    return _msgpack().Ext(FLOATS, np.asarray(values, dtype="<f4").tobytes())


def _placed(path: str, position: Array, rotation: Array | None = None, scale: Array | None = None) -> dict[str, Any]:
    matrix = np.eye(4)
    matrix[:3, :3] = (np.eye(3) if rotation is None else rotation) * (1.0 if scale is None else scale)
    matrix[:3, 3] = position
    return {"type": "set_transform", "path": path, "matrix": matrix.T.ravel().tolist()}


def _object(path: str, shape: Mesh | Lines, colour: str, look: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return three.js's description of a shape."""
    points = shape.points if isinstance(shape, Lines) else shape.vertices
    data: dict[str, Any] = {"attributes": {"position": _attribute("Float32Array", 3, _floats(points))}}
    if isinstance(shape, Mesh):
        wholes = _msgpack().Ext(WHOLES, shape.faces.astype("<u4").tobytes())
        data["index"] = _attribute("Uint32Array", 1, wholes)
    kind, material = ("LineSegments", "LineBasicMaterial") if isinstance(shape, Lines) else ("Mesh", "MeshPhongMaterial")
    names = {part: f"{path}#{part}" for part in ("geometry", "material", "object")}
    drawn = {
        "metadata": {"version": 4.5, "type": "Object"},
        "geometries": [{"uuid": names["geometry"], "type": "BufferGeometry", "data": data}],
        "materials": [{"uuid": names["material"], "type": material, "color": int(colour[1:], 16), "side": 2, **(look or {})}],
        "object": {"uuid": names["object"], "type": kind, "geometry": names["geometry"], "material": names["material"]},
    }
    return {"type": "set_object", "path": path, "object": drawn}


def _attribute(kind: str, size: int, array: Any) -> dict[str, Any]:
    return {"itemSize": size, "type": kind, "array": array, "normalized": False}


def _solid(body: Body) -> dict[str, Any]:
    if not isinstance(body.shape, Mesh):
        return {}
    return {"flatShading": body.shape.flat, "shininess": 25, "depthTest": not body.in_front, "transparent": body.in_front}


def _ground(scenery: Scenery) -> list[dict[str, Any]]:
    ground = scenery.ground
    plane, lines = (SNOW, SNOW_LINES) if ground.snow else (FLOOR, FLOOR_LINES)
    square = shapes.square(ground.half, ground.centre, ground.height)
    grid = shapes.grid(ground.half, ground.centre, ground.height + 0.001, ground.spacing)
    look = {"type": "MeshBasicMaterial", "polygonOffset": True, "polygonOffsetFactor": 4.0, "polygonOffsetUnits": 4.0}
    return [_object(f"{ROOT}/ground", square, plane, look), _object(f"{ROOT}/ground/lines", grid, lines)]


def _meshcat() -> str:
    """Return meshcat's viewer. The package itself is not imported: it would start with a network stack."""
    found = importlib.util.find_spec("meshcat")
    for folder in (found.submodule_search_locations or []) if found else []:
        script = Path(folder) / "viewer" / "dist" / "main.min.js"
        if script.is_file():
            return script.read_text(encoding="utf-8")
    raise VlmbError("the 3D view needs meshcat, which is not installed: pip install vlmb[view]")


def _msgpack() -> Any:
    """Import the packer that meshcat brings along."""
    try:
        return importlib.import_module("umsgpack")
    except ImportError:
        raise VlmbError("the 3D view needs meshcat, which is not installed: pip install vlmb[view]") from None
