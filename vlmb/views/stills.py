"""Stills of a scenery without a screen or a browser, and films; painted on numpy, written by pillow, MP4 by PyAV."""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import VlmbError
from vlmb.simulation.files import replacing
from vlmb.views.appearance import FLOOR, FLOOR_LINES, SNOW, SNOW_LINES
from vlmb.views.bodies import Body
from vlmb.views.canvas import SUN, Camera, Canvas
from vlmb.views.shapes import Lines, Mesh
from vlmb.views.style import not_there
from vlmb.views.visual_model import VIEW_FROM, Scenery

if TYPE_CHECKING:
    from PIL.Image import Image

Array = NDArray[np.float64]
SKY, HAZE, SHADE = "#a9cae6", "#eef4f9", "#bccbd8"
APART = 2.4  # radii from one earlier posture to the next
PAINTERS = min(4, os.cpu_count() or 1)
MOST_KEPT = 400
_kept: dict[int, tuple[Array, Array]] = {}  # vertices of a mesh and its normals
FINER = 2  # pictures are painted larger by this and then halved
PALE = 0.4  # strength of the colours of earlier postures
MAX_GHOSTS = 1000
MAX_PIXELS = 4096 * 4096  # of a picture
MAX_PICTURES = 10_000  # of a film
MAX_GIF = 2_000_000_000  # pixels of all pictures of a GIF, which is made as a whole


class Shot(NamedTuple):
    """Where the camera stands, as the surface sees it; None: beside the end of a way, or where the browser's stands."""

    azimuth: float | None = None  # [deg] of the direction to the camera from the fall line (x), counter-clockwise from above
    elevation: float | None = None  # [deg] above the surface
    zoom: float = 1.0
    follow: bool | None = None  # films: go along (default); stills: the last posture alone fills the picture
    side: bool = False  # from the right of the way

    def direction(self, scenery: Scenery, frames: list[int]) -> Array | None:
        """Direction (3,) to the camera in the viewer's world; None: to be chosen."""
        if self.azimuth is None and self.elevation is None and not self.side:
            return None
        turn, azimuth = scenery.turn, self.azimuth
        if azimuth is None and self.side:
            azimuth = math.degrees(_heading(scenery, frames[-1])) - 90.0
        elevation = self.elevation if self.elevation is not None else 8.0 if self.side else 20.0
        if azimuth is None:
            usual = turn.T @ np.array(VIEW_FROM)
            azimuth = math.degrees(math.atan2(usual[1], usual[0]))
        a, e = math.radians(azimuth), math.radians(min(elevation, 89.0))
        return np.asarray(turn @ np.array([math.cos(a) * math.cos(e), math.sin(a) * math.cos(e), math.sin(e)]))

    def checked(self) -> Shot:
        """Raise VlmbError for what no camera can do; else return it."""
        if not 0.0 < self.zoom < 100.0:
            raise VlmbError(f"zoom {self.zoom:g}: must be above 0 and below 100")
        if self.elevation is not None and not 0.0 < self.elevation <= 90.0:
            raise VlmbError(f"elevation {self.elevation:g} deg: must be above 0 (under the snow nothing is seen) and at most 90")
        if self.azimuth is not None and not abs(self.azimuth) <= 360.0:
            raise VlmbError(f"azimuth {self.azimuth:g} deg: must be between -360 and 360")
        return self


def still(
    scenery: Scenery, time: float | None = None, size: tuple[int, int] = (960, 600), ghosts: int = 0,
    since: float | None = None, view_from: Sequence[float] | None = None, shot: Shot | None = None,
) -> Image:  # fmt: skip
    """Paint the scenery at a time [s] (default: its end), with the track so far and, paler, postures since an earlier time.

    Without `since` the earlier postures stand so near that they fill the picture. Raises VlmbError when pillow is not installed.
    """
    pillow, shot = _pillow(), (shot or Shot()).checked()
    if not 0 <= ghosts <= MAX_GHOSTS:
        raise VlmbError(f"ghosts = {ghosts}: earlier postures in a still are 0 to {MAX_GHOSTS}")
    _require_size(size)
    last = scenery.frame_at(float(scenery.t[-1]) if time is None else time)
    first = _near(scenery, last, ghosts) if since is None else scenery.frame_at(since)
    frames = [*dict.fromkeys(np.linspace(first, last, ghosts + 1).astype(int).tolist()[:-1]), last] if ghosts else [last]
    moves = float(np.ptp(scenery.focus, axis=0).max()) > 0.0
    shown = frames if moves else [*dict.fromkeys(np.linspace(0, last, 25).astype(int).tolist())]
    points = _everything(scenery, [last] if shot.follow else shown)
    found = shot.direction(scenery, frames) if view_from is None else np.array(view_from, float)
    direction = np.array(_ahead(scenery, frames), float) if found is None else found
    camera = Camera.around(points, direction, size[0] / size[1])._replace(zoom=shot.zoom)
    return _reduce(pillow, _paint(scenery, frames, camera, size))


def _near(scenery: Scenery, last: int, ghosts: int) -> int:
    """Frame from which on `ghosts` earlier postures stand at most some sizes apart."""
    steps = np.linalg.norm(np.diff(scenery.focus[: last + 1], axis=0), axis=1)
    behind = np.concatenate([np.cumsum(steps[::-1])[::-1], [0.0]])
    return int(np.argmax(behind <= APART * scenery.radius * ghosts))


def _heading(scenery: Scenery, frame: int) -> float:
    """Angle [rad] of the ski, or of the way, from the fall line."""
    ahead = scenery.poses(frame).get("ski", np.eye(4))[:3, 0]
    if not any(body.path == "ski" for body in scenery.bodies):
        ahead = scenery.focus[-1] - scenery.focus[0]
        ahead = ahead if math.hypot(ahead[0], ahead[1]) > scenery.radius else np.array([1.0, 0.0, 0.0])
    return math.atan2(ahead[1], ahead[0])


def animation(
    scenery: Scenery, path: str | Path, size: tuple[int, int] = (480, 320), fps: float = 20.0, speed: float = 1.0,
    shot: Shot | None = None,
) -> Path:  # fmt: skip
    """Write a film that plays at `speed` times real time: an animated GIF, or MP4 where the name ends so.

    Raises VlmbError when pillow, or PyAV for MP4, is not installed.
    """
    as_mp4 = Path(path).suffix.lower() == ".mp4"
    count = pictures_of(float(scenery.t[-1] - scenery.t[0]), fps, speed)
    if not as_mp4 and count * size[0] * size[1] > MAX_GIF:
        raise VlmbError(f"a GIF of {count} pictures of {size[0]} x {size[1]} is too large: write an MP4, or lower fps or size")
    pictures = movie(scenery, size, fps, speed, shot)
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
        options = {"crf": "20", "preset": "veryfast"}
        stream = film.add_stream("libx264", rate=Fraction(fps).limit_denominator(1000), options=options)
        for k, picture in enumerate(pictures):
            if k == 0:
                stream.width, stream.height = picture.width // 2 * 2, picture.height // 2 * 2
                stream.pix_fmt = "yuv420p"
            film.mux(stream.encode(av.VideoFrame.from_image(picture.crop((0, 0, stream.width, stream.height)))))
        film.mux(stream.encode())


def frames(
    scenery: Scenery, folder: str | Path, size: tuple[int, int] = (960, 600), fps: float = 30.0, shot: Shot | None = None
) -> list[Path]:
    """Write one PNG a frame into a folder: frame_00000.png, ..."""
    folder = Path(folder)
    pictures_of(float(scenery.t[-1] - scenery.t[0]), fps)
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for number, picture in enumerate(movie(scenery, size, fps, shot=shot)):
        written.append(save_still(picture, folder / f"frame_{number:05d}.png"))
    return written


def movie(
    scenery: Scenery, size: tuple[int, int], fps: float, speed: float = 1.0, shot: Shot | None = None
) -> Iterator[Image]:
    """Paint pictures at even times, through a camera that follows what moves, or that stands still and sees it all."""
    _require_size(size)
    pillow, begin, shot = _pillow(), float(scenery.t[0]), (shot or Shot()).checked()
    every = [*dict.fromkeys(np.linspace(0, len(scenery.t) - 1, 40).astype(int).tolist())]
    found = shot.direction(scenery, every)
    direction = np.array(VIEW_FROM) if found is None else found
    narrow = max(1.0, 0.8 * size[1] / size[0])
    stands = Camera.around(_everything(scenery, every), direction, size[0] / size[1]) if shot.follow is False else None

    def painted(k: int) -> Image:
        frame = scenery.frame_at(begin + k * speed / fps)
        camera = stands or Camera.towards(scenery.turn @ scenery.focus[frame], direction, 2.8 * narrow * scenery.radius)
        camera = camera._replace(zoom=shot.zoom)
        return _reduce(pillow, _paint(scenery, [frame], camera, size))

    count = pictures_of(float(scenery.t[-1]) - begin, fps, speed)
    with ThreadPoolExecutor(PAINTERS) as pool:  # numpy lets go of the interpreter; a few pictures ahead, no more
        waiting = deque(pool.submit(painted, k) for k in range(min(count, 2 * PAINTERS)))
        for k in range(count):
            yield waiting.popleft().result()
            if k + 2 * PAINTERS < count:
                waiting.append(pool.submit(painted, k + 2 * PAINTERS))


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
        fallen = [_fallen(body, body.shape, poses[body.path], ground.height, sun) for body in scenery.bodies
                  if body.path in poses and body.shadow and isinstance(body.shape, Mesh) and not _flat(body)]  # fmt: skip
        if fallen:
            canvas.shadows(np.concatenate(fallen) @ turn.T, _mix(plane, SHADE, strength))
    for body in scenery.bodies:
        pieces: Sequence[Any] | NDArray[Any] = (
            body.shape.faces if isinstance(body.shape, Mesh) else body.shape.points if body.shape else []
        )
        per_frame = len(pieces) / max(len(scenery.t) - 1, 1)
        count = round(per_frame * frames[-1]) if body.grows else len(pieces)
        first = round(per_frame * scenery.frame_at(float(scenery.t[frames[-1]]) - body.keeps)) if body.grows else 0
        if isinstance(body.shape, Lines):
            canvas.lines(body.shape.points[first:count] @ turn.T, _rgb(body.colour), 1.5 * FINER)
        elif body.shape is not None and _flat(body):
            corners = body.shape.vertices[body.shape.faces[first:count]] @ turn.T
            canvas.triangles(corners, np.broadcast_to(_rgb(body.colour), corners.shape), 1e-3)
    solids = [
        _seen(body, body.shape, turn @ poses[body.path][:3], strength, camera)
        for poses, strength in postures
        for body in scenery.bodies
        if body.path in poses and isinstance(body.shape, Mesh) and not _flat(body)
    ]
    if solids:
        canvas.triangles(*(np.concatenate(part) for part in zip(*solids, strict=True)))
    return canvas


def _flat(body: Body) -> bool:
    """Whether a body lies on the snow: a way."""
    return body.grows or body.path == "programme"


def _fallen(body: Body, mesh: Mesh, pose: Array, height: float, sun: Array) -> Array:
    """Triangles of a body's shadow on z = height: of a closed solid only those that face the sun; those of robots may be open."""
    points = _moved(pose, mesh.vertices)
    points = points - ((points[:, 2:] - height) / sun[2]) * sun
    corners = points[mesh.faces]
    if body.path.startswith("robots/"):
        return corners
    (ax, ay), (bx, by) = (corners[:, 1, :2] - corners[:, 0, :2]).T, (corners[:, 2, :2] - corners[:, 0, :2]).T
    return corners[ax * by - ay * bx > 0.0]


def _seen(body: Body, mesh: Mesh, pose: Array, strength: float, camera: Camera) -> tuple[Array, Array, Array]:
    """Triangles of a body that face the camera, their colours and what favours them."""
    corners = _moved(pose, mesh.vertices)[mesh.faces]
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    front = np.einsum("ij,ij->i", _crossed(b - a, c - a), camera.eye - a) > 0.0
    normals = _normals(mesh)[front] @ np.linalg.inv(pose[:, :3])
    normals = normals / np.maximum(np.sqrt(np.einsum("ijk,ijk->ij", normals, normals))[..., None], 1e-300)
    light = 0.66 + 0.42 * np.clip(normals @ SUN, -0.2, 1.0) - 0.06 * normals[..., 2]  # from the sun and the snow
    lift = 10.0 if body.in_front else 1e-4 * (strength == 1.0)
    return corners[front], _shaded(body.colour, light, strength), np.full(int(front.sum()), lift)


def _normals(mesh: Mesh) -> Array:
    """Normals (m, 3, 3) at the corners of a mesh's triangles, in its own frame; kept, since films ask for them again."""
    key = id(mesh.vertices)
    if key not in _kept or _kept[key][0] is not mesh.vertices:
        corners = mesh.vertices[mesh.faces]
        normals = _crossed(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        if mesh.flat:
            found = np.repeat(normals[:, None], 3, axis=1)
        else:
            summed = np.zeros_like(mesh.vertices)
            for k in range(3):
                np.add.at(summed, mesh.faces[:, k], normals)
            found = summed[mesh.faces]
        if len(_kept) >= MOST_KEPT:
            _kept.clear()
        _kept[key] = mesh.vertices, found
    return _kept[key][1]


def _crossed(first: Array, second: Array) -> Array:
    """Cross products of rows; `np.cross` takes thrice as long."""
    (a, b, c), (d, e, f) = first.T, second.T
    return np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=1)


def _shaded(colour: str, light: Array, strength: float) -> Array:
    lit = np.clip(light[..., None] * _rgb(colour), 0.0, 255.0)
    return np.asarray(strength * lit + (1.0 - strength) * _rgb(SNOW), dtype=np.float32)


def _everything(scenery: Scenery, frames: list[int]) -> Array:
    """Points (n, 3) of all solid bodies at some frames, in the viewer's world."""
    turn, points = scenery.turn, [np.zeros((0, 3))]
    for frame in frames:
        poses = scenery.poses(frame)
        points += [
            _moved(poses[body.path], body.shape.vertices) @ turn.T
            for body in scenery.bodies
            if isinstance(body.shape, Mesh) and not body.grows and body.fits and body.path != "programme"
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


def _reduce(pillow: Any, canvas: Canvas) -> Image:
    picture: Image = pillow.fromarray(canvas.halved())
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
