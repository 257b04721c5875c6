"""Meshes from files, as small as they may be: STL is read here, other formats by coal, which comes with Pinocchio."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.views.shapes import Mesh

Array = NDArray[np.float64]

MAX_BYTES = 60_000_000
FORMATS = (".stl", ".dae", ".obj")


def load_mesh(path: Path, scale: tuple[float, ...], most: int) -> Mesh | None:
    """Read a mesh [m], with so many faces at most; None where it cannot be read."""
    if path.suffix.lower() not in FORMATS or path.stat().st_size > MAX_BYTES:
        return None
    try:
        mesh = _read_stl(path) if path.suffix.lower() == ".stl" else None
        mesh = _by_coal(path) if mesh is None else mesh
    except (OSError, ValueError, RuntimeError, MemoryError):
        return None
    if mesh is None or not len(mesh.faces) or not np.isfinite(mesh.vertices).all():
        return None
    factors = np.array(scale if len(scale) == 3 else (scale[0],) * 3)
    faces = mesh.faces[:, ::-1] if factors.prod() < 0.0 else mesh.faces
    found = simplified(Mesh(mesh.vertices * factors, faces), most)
    return Mesh(found.vertices, found.faces, True)  # walls that fell together have no common normals


def _read_stl(path: Path) -> Mesh | None:
    """Read a binary STL; None for one of text."""
    content = path.read_bytes()
    count = int(np.frombuffer(content, "<u4", 1, 80)[0]) if len(content) >= 84 else 0
    if len(content) < 84 + 50 * count or not count:
        return None
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    corners = np.frombuffer(content, kind, count, 84)["corners"].reshape(-1, 3).astype(float)
    vertices, index = np.unique(corners, axis=0, return_inverse=True)
    return Mesh(vertices, index.reshape(-1, 3))


def _by_coal(path: Path) -> Mesh:
    coal: Any = importlib.import_module("coal")
    model = coal.MeshLoader().load(str(path), np.ones(3))
    corners = (model.tri_indices(k) for k in range(model.num_tris))
    faces = np.array([(corner[0], corner[1], corner[2]) for corner in corners], dtype=np.int64).reshape(-1, 3)
    return Mesh(np.array(model.vertices(), dtype=float), faces)


def simplified(mesh: Mesh, most: int) -> Mesh:
    """Join vertices that are close, by the mesh's own size, until it has at most so many faces."""
    low = mesh.vertices.min(axis=0)
    size = float(np.linalg.norm(mesh.vertices.max(axis=0) - low)) or 1.0
    cell = size / 400.0
    found = mesh
    while True:
        cells = np.floor((mesh.vertices - low) / cell).astype(np.int64)
        _, first, index = np.unique(cells, axis=0, return_index=True, return_inverse=True)
        index = index.reshape(-1)
        sums = np.zeros((len(first), 3))
        np.add.at(sums, index, mesh.vertices)
        faces = index[mesh.faces]
        faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
        faces = faces[np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1]]
        found = Mesh(sums / np.bincount(index)[:, None], faces)
        if len(faces) <= most:
            return found
        cell *= 1.25


def box(x: float, y: float, z: float) -> Mesh:
    """Return a box about the origin."""
    corners = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-0.5, 0.5)]) * (x, y, z)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [(a, b, c) for a, b, c, _ in quads] + [(a, c, d) for a, _, c, d in quads]
    return Mesh(corners, np.array(faces, dtype=np.int64), True)
