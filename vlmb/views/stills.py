"""Stills of a scenery without a screen or a browser, and films; painted on numpy, written by pillow, MP4 by PyAV."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import VlmbError
from vlmb.simulation.files import replacing
from vlmb.views.appearance import FLOOR, FLOOR_LINES, SNOW, SNOW_LINES
from vlmb.views.canvas import SUN, Camera, Canvas
from vlmb.views.shapes import Lines, Mesh
from vlmb.views.style import not_there
from vlmb.views.visual_model import VIEW_FROM, Scenery

if TYPE_CHECKING:
    from PIL.Image import Image

Array = NDArray[np.float64]
SKY, HAZE, SHADE = "#a9cae6", "#eef4f9", "#bccbd8"
FINER = 2  # pictures are painted larger by this and then reduced
PALE = 0.4  # strength of the colours of earlier postures
MAX_GHOSTS = 1000
MAX_PIXELS = 4096 * 4096  # of a picture
MAX_PICTURES = 10_000  # of a film
MAX_GIF = 2_000_000_000  # pixels of all pictures of a GIF, which is made as a whole


def still(
    scenery: Scenery, time: float | None = None, size: tuple[int, int] = (960, 600), ghosts: int = 0,
    since: float | None = None, view_from: Sequence[float] | None = None,
) -> Image:  # fmt: skip
    """Paint the scenery at a time [s] (default: its end), with the track so far and, paler, postures since an earlier time.

    Raises VlmbError when pillow is not installed.
    """
    pillow = _pillow()
    if not 0 <= ghosts <= MAX_GHOSTS:
        raise VlmbError(f"ghosts = {ghosts}: earlier postures in a still are 0 to {MAX_GHOSTS}")
    _require_size(size)
    last = scenery.frame_at(float(scenery.t[-1]) if time is None else time)
    first = 0 if since is None else scenery.frame_at(since)
    frames = [*dict.fromkeys(np.linspace(first, last, ghosts + 1).astype(int).tolist()[:-1]), last] if ghosts else [last]
    follows = float(np.ptp(scenery.focus, axis=0).max()) > 0.0
    points = _everything(scenery, frames if follows else [*dict.fromkeys(np.linspace(0, last, 25).astype(int).tolist())])
    direction = np.array(_ahead(scenery, frames) if view_from is None else view_from, float)
    camera = Camera.around(points, direction, size[0] / size[1])
    return _reduce(pillow, _paint(scenery, frames, camera, size), size)


def animation(
    scenery: Scenery, path: str | Path, size: tuple[int, int] = (480, 320), fps: float = 20.0, speed: float = 1.0
) -> Path:
    """Write a film that plays at `speed` times real time: an animated GIF, or MP4 where the name ends so.

    Raises VlmbError when pillow, or PyAV for MP4, is not installed.
    """
    as_mp4 = Path(path).suffix.lower() == ".mp4"
    count = pictures_of(float(scenery.t[-1] - scenery.t[0]), fps, speed)
    if not as_mp4 and count * size[0] * size[1] > MAX_GIF:
        raise VlmbError(f"a GIF of {count} pictures of {size[0]} x {size[1]} is too large: write an MP4, or lower fps or size")
    pictures = movie(scenery, size, fps, speed)
    with replacing(path) as file:
        if as_mp4:
            _mp4(pictures, file, fps)
        else:
            first, *others = [picture.quantize(96) for picture in pictures]
            first.save(file, "GIF", save_all=True, append_images=others, duration=round(1000.0 / fps), loop=0)
    return Path(path)


def save_still(picture: Image, path: str | Path) -> Path:
    """Write a picture in the format that its name ends with. Raises VlmbError for an ending that is none of a picture."""
    ending = Path(path).suffix.lower()
    kind = _pillow().registered_extensions().get(ending)
    if kind is None:
        raise VlmbError(f"{path}: its name must end as a picture's does, such as .png")
    with replacing(path) as file:
        picture.save(file, kind)
    return Path(path)


def pictures_of(duration: float, fps: float, speed: float = 1.0) -> int:
    """Number of pictures of a film. Raises VlmbError for more than can be painted."""
    count = duration * fps / speed
    if not count <= MAX_PICTURES:
        raise VlmbError(
            f"a film of {duration:g} s at {fps:g} frames a second and {speed:g} times real time has {count:.3g} pictures: "
            f"at most {MAX_PICTURES}; lower fps, or raise speed"
        )
    return max(1, round(count))


def _mp4(pictures: Iterator[Image], path: Path, fps: float) -> None:
    """Encode pictures as H.264; it wants even sides."""
    try:
        import av
    except ImportError as error:
        raise VlmbError(f"{not_there('an MP4 needs PyAV', 'av', 'film', error)}; a GIF does without") from None
    with av.open(str(path), "w", format="mp4") as film:
        stream = film.add_stream("libx264", rate=Fraction(fps).limit_denominator(1000), options={"crf": "20"})
        for k, picture in enumerate(pictures):
            if k == 0:
                stream.width, stream.height = picture.width // 2 * 2, picture.height // 2 * 2
                stream.pix_fmt = "yuv420p"
            film.mux(stream.encode(av.VideoFrame.from_image(picture.crop((0, 0, stream.width, stream.height)))))
        film.mux(stream.encode())


def frames(scenery: Scenery, folder: str | Path, size: tuple[int, int] = (960, 600), fps: float = 30.0) -> list[Path]:
    """Write one PNG a frame into a folder: frame_00000.png, ..."""
    folder = Path(folder)
    pictures_of(float(scenery.t[-1] - scenery.t[0]), fps)
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for number, picture in enumerate(movie(scenery, size, fps)):
        written.append(save_still(picture, folder / f"frame_{number:05d}.png"))
    return written


def movie(scenery: Scenery, size: tuple[int, int], fps: float, speed: float = 1.0) -> Iterator[Image]:
    """Paint pictures at even times, through a camera that follows what moves."""
    _require_size(size)
    pillow, begin = _pillow(), float(scenery.t[0])
    for k in range(pictures_of(float(scenery.t[-1]) - begin, fps, speed)):
        frame = scenery.frame_at(begin + k * speed / fps)
        camera = Camera.towards(scenery.turn @ scenery.focus[frame], np.array(VIEW_FROM), 2.8 * scenery.radius)
        yield _reduce(pillow, _paint(scenery, [frame], camera, size), size)


def _paint(scenery: Scenery, frames: list[int], camera: Camera, size: tuple[int, int]) -> Canvas:
    """Paint postures at some frames, the last one in full colours."""
    canvas, turn, ground = Canvas(camera, FINER * size[0], FINER * size[1]), scenery.turn, scenery.ground
    plane, lines = (SNOW, SNOW_LINES) if ground.snow else (FLOOR, FLOOR_LINES)
    reach = 0.6 * ground.half
    canvas.ground(turn, ground.height, ground.spacing, (_rgb(plane), _rgb(lines), _rgb(HAZE), _rgb(SKY)), reach)
    final = scenery.poses(frames[-1])
    postures = [({path: pose for path, pose in scenery.poses(frame).items() if not np.allclose(pose, final[path])}, PALE)
                for frame in frames[:-1]] + [(final, 1.0)]  # fmt: skip
    sun = turn.T @ SUN
    for poses, strength in postures:
        for body in scenery.bodies:
            if body.path in poses and body.shadow and isinstance(body.shape, Mesh):
                corners = _moved(poses[body.path], body.shape.vertices)[body.shape.faces]
                fallen = corners - ((corners[..., 2] - ground.height) / sun[2])[..., None] * sun
                canvas.shadows(fallen @ turn.T, _mix(plane, SHADE, strength))
    for body in scenery.bodies:
        pieces: Sequence[Any] | NDArray[Any] = (
            body.shape.faces if isinstance(body.shape, Mesh) else body.shape.points if body.shape else []
        )
        per_frame = len(pieces) / max(len(scenery.t) - 1, 1)
        count = round(per_frame * frames[-1]) if body.grows else len(pieces)
        first = round(per_frame * scenery.frame_at(float(scenery.t[frames[-1]]) - body.keeps)) if body.grows else 0
        if isinstance(body.shape, Lines):
            canvas.lines(body.shape.points[first:count] @ turn.T, _rgb(body.colour), 1.5 * FINER)
        elif body.shape is not None and (body.grows or body.path == "programme"):
            corners = body.shape.vertices[body.shape.faces[first:count]] @ turn.T
            canvas.triangles(corners, np.broadcast_to(_rgb(body.colour), corners.shape), 1e-3)
    for poses, strength in postures:
        for body in scenery.bodies:
            if body.path in poses and isinstance(body.shape, Mesh) and not body.grows and body.path != "programme":
                vertices = _moved(turn @ poses[body.path][:3, :3], body.shape.vertices) + turn @ poses[body.path][:3, 3]
                corners, light = vertices[body.shape.faces], _light(body.shape, vertices)
                front = np.einsum("ij,ij->i", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]),
                                  camera.eye - corners[:, 0]) > 0.0  # fmt: skip
                colours = _shaded(body.colour, light, strength)
                canvas.triangles(corners[front], colours[front], 10.0 if body.in_front else 1e-4 * (strength == 1.0))
    return canvas


def _light(mesh: Mesh, vertices: Array) -> Array:
    """Brightness (m, 3) at the corners of a mesh's triangles, from the sun and the snow."""
    corners = vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if mesh.flat:
        normals = np.repeat(normals[:, None], 3, axis=1)
    else:
        summed = np.zeros_like(vertices)
        for k in range(3):
            np.add.at(summed, mesh.faces[:, k], normals)
        normals = summed[mesh.faces]
    normals = normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-300)
    facing = normals @ SUN
    return np.asarray(0.66 + 0.42 * np.clip(facing, -0.2, 1.0) - 0.06 * normals[..., 2])


def _shaded(colour: str, light: Array, strength: float) -> Array:
    lit = np.clip(light[..., None] * _rgb(colour), 0.0, 255.0)
    return np.asarray(strength * lit + (1.0 - strength) * _rgb(SNOW))


def _everything(scenery: Scenery, frames: list[int]) -> Array:
    """Points (n, 3) of all solid bodies at some frames, in the viewer's world."""
    turn, points = scenery.turn, [np.zeros((0, 3))]
    for frame in frames:
        poses = scenery.poses(frame)
        points += [
            _moved(poses[body.path], body.shape.vertices) @ turn.T
            for body in scenery.bodies
            if isinstance(body.shape, Mesh) and not body.grows and body.path != "programme"
        ]
    return np.concatenate(points)


def _ahead(scenery: Scenery, frames: list[int]) -> Sequence[float]:
    """Look back from beside the end of a way, so that the last posture is the nearest; else from where the browser looks."""
    first, last = scenery.focus[frames[0]], scenery.focus[frames[-1]]
    way = last - first
    if math.hypot(way[0], way[1]) < 2.0 * scenery.radius:
        return VIEW_FROM
    before = scenery.focus[frames[-1] - max(1, frames[-1] // 10)]
    end = scenery.turn @ (last - before)
    along = end[:2] / max(float(np.linalg.norm(end[:2])), 1e-9)
    side = 1.0 if along[0] * way[1] - along[1] * way[0] > 0.0 else -1.0  # from the inside of the turn
    left = side * np.array([-along[1], along[0]])
    return [*(along * 0.6 + left * 0.8), 0.3]


def _reduce(pillow: Any, canvas: Canvas, size: tuple[int, int]) -> Image:
    picture: Image = pillow.fromarray(canvas.pixels()).resize(size, pillow.Resampling.BOX)
    return picture


def _rgb(colour: str) -> Array:
    return np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)], float)


def _mix(first: str, second: str, share: float) -> Array:
    return np.asarray((1.0 - share) * _rgb(first) + share * _rgb(second))


def _moved(pose: Array, points: Array) -> Array:
    moved = points @ pose[:3, :3].T
    return np.asarray(moved + pose[:3, 3] if pose.shape[1] == 4 else moved)


def _require_size(size: tuple[int, int]) -> None:
    if not (min(size) >= 1 and size[0] * size[1] <= MAX_PIXELS):
        raise VlmbError(f"size {size[0]} x {size[1]}: a picture has 1 to {MAX_PIXELS} pixels")


def _pillow() -> Any:
    try:
        from PIL import Image
    except ImportError as error:
        raise not_there("stills need pillow", "PIL", "view", error) from None
    Image.init()  # knows all formats
    return Image
