"""Triangle meshes of the things that are drawn, in metres; what is long lies along x. Pure data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SIDES = 20


class Mesh(NamedTuple):
    """Triangles, counter-clockwise seen from outside; `flat`: with sharp edges."""

    vertices: Array  # (n, 3) [m]
    faces: NDArray[np.int64]  # (m, 3)
    flat: bool = False


class Lines(NamedTuple):
    """Straight lines between pairs of points."""

    points: Array  # (n, 2, 3) [m]


def revolve(profile: Sequence[tuple[float, float]], wide: float = 1.0, deep: float = 1.0, sides: int = SIDES) -> Mesh:
    """Turn a profile of (x, radius) about the x axis; `wide` stretches it along y, `deep` along z."""
    x, radius = np.array(profile, float).T
    angles = np.linspace(0.0, math.tau, sides, endpoint=False)
    rings = np.empty((len(x), sides, 3))
    rings[..., 0] = x[:, None]
    rings[..., 1] = wide * radius[:, None] * np.cos(angles)
    rings[..., 2] = deep * radius[:, None] * np.sin(angles)
    ring, side = np.meshgrid(np.arange(len(x) - 1), np.arange(sides), indexing="ij")
    a, b = ring * sides + side, ring * sides + (side + 1) % sides
    lower = np.stack([a, b, a + sides], axis=-1).reshape(-1, 3)
    upper = np.stack([b, b + sides, a + sides], axis=-1).reshape(-1, 3)
    vertices, faces = rings.reshape(-1, 3), np.concatenate([lower, upper])
    corners = vertices[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return Mesh(vertices, faces[area > 1e-12 * max(1e-12, area.max())])


def limb(length: float, radius: float, wide: float = 1.0, deep: float = 1.0) -> Mesh:
    """Return a solid rod from x = 0 to `length` with rounded ends; a barrel when it is short."""
    cap = min(radius, 0.5 * length) if radius < 0.45 * length else 0.3 * length
    bow = np.linspace(0.0, 0.5 * math.pi, 7)
    start = [(cap * (1 - math.cos(angle)), radius * math.sin(angle)) for angle in bow]
    end = [(length - at, r) for at, r in reversed(start)]
    return revolve([*start, *(end if length > 2 * cap else end[1:])], wide, deep)


def ball(radius: float) -> Mesh:
    """Return a sphere about the origin."""
    angles = np.linspace(0.0, math.pi, 13)
    return revolve([(-radius * math.cos(angle), radius * math.sin(angle)) for angle in angles])


def tube(radius: float) -> Mesh:
    """Return a closed cylinder from x = 0 to 1; a scale along x makes it a segment."""
    return revolve([(0.0, 0.0), (0.0, radius), (1.0, radius), (1.0, 0.0)], sides=16)._replace(flat=True)


def bellows(radius: float, wide: float = 1.0, deep: float = 1.0, folds: int = 4) -> Mesh:
    """Return a folded sleeve from x = 0 to 1; a scale along x makes it a segment, and shows how far it is stretched."""
    profile = [(0.0, 0.0)]
    for fold in range(folds):
        profile += [(fold / folds, 0.78 * radius), ((fold + 0.5) / folds, radius)]
    return revolve([*profile, (1.0, 0.78 * radius), (1.0, 0.0)], wide, deep, 16)._replace(flat=True)


def ellipsoid(radius: float, wide: float, deep: float) -> Mesh:
    """Return a ball that is stretched along y and z."""
    return ball(radius)._replace(vertices=ball(radius).vertices * np.array([1.0, wide, deep]))


def torso(length: float, radius: float, wide: float, deep: float) -> Mesh:
    """Return a trunk from the waist at x = 0 to the shoulders at `length`."""
    along = (0.0, 0.0, 0.12, 0.35, 0.6, 0.78, 0.9, 0.97, 1.0, 1.03)
    across = (0.0, 0.76, 0.84, 0.84, 0.98, 1.0, 0.9, 0.68, 0.42, 0.0)
    return revolve([(x * length, r * radius) for x, r in zip(along, across, strict=True)], wide, deep)


def barrel(length: float, radius: float, wide: float, deep: float) -> Mesh:
    """Return a block of a trunk from x = 0 to `length`."""
    along, across = (0.0, 0.0, 0.1, 0.5, 0.9, 1.0, 1.0), (0.0, 0.8, 0.93, 1.0, 0.95, 0.86, 0.0)
    return revolve([(x * length, r * radius) for x, r in zip(along, across, strict=True)], wide, deep)


def boot(length: float, height: float, half: float) -> Mesh:
    """Return a boot that stands on z = 0: its heel at x = 0, its toes at x = `length`."""
    along, across = (0.0, 0.0, 0.3, 0.7, 0.95, 1.0, 1.0), (0.0, 0.7, 0.95, 1.0, 0.75, 0.3, 0.0)
    sole = revolve([(x * length, r * half) for x, r in zip(along, across, strict=True)])
    shaft = limb(1.6 * height, 0.9 * half)
    x, y, z = shaft.vertices.T
    turned = shaft._replace(vertices=np.column_stack([0.35 * length - z, y, x]))
    return join([moved(sole, (0.0, 0.0, 0.8 * half)), turned])


def between(start: Array, end: Array, radius: float) -> Mesh:
    """Return a limb between two points."""
    length = float(np.linalg.norm(end - start))
    x = (end - start) / length
    side = np.cross([0.0, 0.0, 1.0] if abs(x[2]) < 0.9 else [0.0, 1.0, 0.0], x)
    side /= np.linalg.norm(side)
    turned = np.column_stack([x, side, np.cross(x, side)])
    mesh = limb(length, radius)
    return mesh._replace(vertices=mesh.vertices @ turned.T + start)


def arrow(length: float) -> Mesh:
    """Return an arrow from the origin to x = `length`."""
    shaft, head = 0.02 * length, 0.06 * length
    profile = [(0.0, 0.0), (0.0, shaft), (0.78 * length, shaft), (0.78 * length, head), (length, 0.0)]
    return revolve(profile, sides=16)._replace(flat=True)


def disc(radius: float, height: float) -> Mesh:
    """Return a disc that lies on z = 0."""
    mesh = revolve([(0.0, 0.0), (0.0, radius), (height, radius), (height, 0.0)], sides=20)._replace(flat=True)
    return mesh._replace(vertices=mesh.vertices[:, [1, 2, 0]])


def cone(height: float, radius: float) -> Mesh:
    """Return a stand: its point in the origin, its foot at z = -height."""
    turned = revolve([(-height, 0.0), (-height, radius), (0.0, 0.0)], sides=16)
    x, y, z = turned.vertices.T
    return Mesh(np.column_stack([-z, y, x]), turned.faces, True)


def moved(mesh: Mesh, by: tuple[float, float, float]) -> Mesh:
    """Shift a mesh."""
    return mesh._replace(vertices=mesh.vertices + np.array(by))


def turned_over(mesh: Mesh) -> Mesh:
    """Turn a mesh upside down."""
    return mesh._replace(vertices=mesh.vertices * np.array([1.0, -1.0, -1.0]))


def ski(length: float) -> Mesh:
    """Return a ski that points along x, its sole on z = 0, its tip bent up, its waist under the origin."""
    width, thick = 0.055 * length, 0.014 * length
    along = np.linspace(-0.5, 0.5, 25)
    tip = np.clip((along - 0.36) / 0.14, 0.0, 1.0)
    tail = np.clip((-along - 0.46) / 0.04, 0.0, 1.0)
    half = 0.5 * width * (0.8 + 0.9 * along**2) * np.sqrt(np.clip(1.0 - tip**3, 0.02, 1.0)) * (1.0 - 0.25 * tail)
    sole = length * (0.075 * tip**2 + 0.012 * tail)
    top = sole + thick * (0.45 + 0.55 * np.clip(1.0 - 4.0 * along**2, 0.0, 1.0))
    sections = np.stack(
        [
            np.stack([length * along, side * half, height], axis=-1)
            for side, height in ((1, sole), (1, top), (-1, top), (-1, sole))
        ],
        axis=1,
    )
    faces = [(0, 1, 2), (0, 2, 3)]
    last = 4 * (len(along) - 1)
    faces += [(last, last + 2, last + 1), (last, last + 3, last + 2)]
    for k in range(0, last, 4):
        for a in range(4):
            b = (a + 1) % 4
            faces += [(k + a, k + 4 + a, k + b), (k + b, k + 4 + a, k + 4 + b)]
    return Mesh(sections.reshape(-1, 3), np.array(faces)[:, ::-1], True)


def ribbon(points: Array, width: float, height: float) -> Mesh:
    """Return a flat band along points (n, 2) at a height above the surface; two triangles a step, in order."""
    points = np.asarray(points, float)
    step = np.gradient(points, axis=0) if len(points) > 1 else np.zeros_like(points)
    size = np.linalg.norm(step, axis=1, keepdims=True)
    moving = np.flatnonzero(size[:, 0] > 1e-12)
    if len(moving):  # where the way stands still, keep the last direction
        last = np.maximum.accumulate(np.where(size[:, 0] > 1e-12, np.arange(len(points)), moving[0]))
        step, size = step[last], size[last]
    normal = np.column_stack([-step[:, 1], step[:, 0]]) / np.maximum(size, 1e-12)
    sides = np.stack([points - 0.5 * width * normal, points + 0.5 * width * normal], axis=1)
    vertices = np.concatenate([sides, np.full((len(points), 2, 1), height)], axis=2).reshape(-1, 3)
    k = 2 * np.arange(max(len(points) - 1, 0))[:, None]
    faces = np.concatenate([k + np.array([0, 2, 1]), k + np.array([1, 2, 3])], axis=1).reshape(-1, 3)
    return Mesh(vertices, faces, True)


def dashes(points: Array, width: float, height: float, length: float) -> Mesh:
    """Return a dashed band along points (n, 2), dashes and gaps of `length` [m]."""
    points = np.asarray(points, float)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    pieces: list[Mesh] = []
    for start in np.arange(0.0, along[-1], 2.0 * length):
        at = np.linspace(start, min(start + length, along[-1]), 5)
        line = np.column_stack([np.interp(at, along, points[:, axis]) for axis in (0, 1)])
        pieces.append(ribbon(line, width, height))
    return join(pieces)


def join(pieces: Sequence[Mesh]) -> Mesh:
    """Return several meshes as one."""
    if not pieces:
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), True)
    starts = np.cumsum([0, *(len(piece.vertices) for piece in pieces[:-1])])
    faces = np.concatenate([piece.faces + start for piece, start in zip(pieces, starts, strict=True)])
    return Mesh(np.concatenate([piece.vertices for piece in pieces]), faces, all(piece.flat for piece in pieces))


def square(half: float, centre: tuple[float, float], height: float) -> Mesh:
    """Return a level square, seen from above."""
    (x, y), z = centre, height
    corners = [(x - half, y - half, z), (x + half, y - half, z), (x + half, y + half, z), (x - half, y + half, z)]
    return Mesh(np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]), True)


def grid(half: float, centre: tuple[float, float], height: float, spacing: float, piece: float = 4.0) -> Lines:
    """Return the lines of a level grid at round coordinates, in pieces of some spacings (renderers drop lines behind the eye)."""
    lines = []
    for axis in (0, 1):
        low, high = centre[axis] - half, centre[axis] + half
        start, end = centre[1 - axis] - half, centre[1 - axis] + half
        stops = np.linspace(start, end, max(2, math.ceil((end - start) / (piece * spacing)) + 1))
        for k in range(math.ceil(low / spacing), math.floor(high / spacing) + 1):
            ends = np.full((len(stops) - 1, 2, 3), height)
            ends[:, :, axis] = k * spacing
            ends[:, 0, 1 - axis], ends[:, 1, 1 - axis] = stops[:-1], stops[1:]
            lines.append(ends)
    return Lines(np.concatenate(lines) if lines else np.zeros((0, 2, 3)))
