"""The canvas: a picture with depth, on numpy alone. Triangles, lines, a ground without end, shadows."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Whole = NDArray[np.int64]
FIELD = 40.0  # [deg] angle of view, upwards
NEAR = 0.02  # [m]
SUN = np.array([-3.0, -4.0, 9.0]) / math.sqrt(106.0)
ROWS = 60_000  # rows of triangles looked at in one go


class Camera(NamedTuple):
    """A camera in a world with z up: where it is, and its axes right, up, back as rows."""

    eye: Array
    axes: Array

    @staticmethod
    def towards(target: Array, direction: Array, distance: float) -> Camera:
        """Look at a target from a direction."""
        back = np.asarray(direction, float) / np.linalg.norm(direction)
        right = np.cross([0.0, 0.0, 1.0], back)
        right = right / np.linalg.norm(right)
        return Camera(target + distance * back, np.array([right, np.cross(back, right), back]))

    @staticmethod
    def around(points: Array, direction: Array, aspect: float, margin: float = 1.12) -> Camera:
        """Look from a direction at all points (n, 3), as near as they let it."""
        axes = Camera.towards(np.zeros(3), direction, 1.0).axes
        right, up, back = (points @ axes.T).T
        slopes = math.tan(math.radians(FIELD) / 2) / margin * np.array([aspect, 1.0])
        sides = [((back + at / slope).max(), (back - at / slope).max()) for at, slope in zip((right, up), slopes, strict=True)]
        middle = [0.5 * slope * (high - low) for (high, low), slope in zip(sides, slopes, strict=True)]
        distance = max(0.5 * (high + low) for high, low in sides)
        return Camera(np.array([*middle, distance]) @ axes, axes)

    def see(self, points: Array) -> Array:
        """Points (..., 3) to the right, up and in front of the camera."""
        seen = (points - self.eye) @ self.axes.T
        seen[..., 2] *= -1.0
        return np.asarray(seen)


class Canvas:
    """Colours (h, w, 3) and nearness 1/depth (h, w) as seen by a camera; painted in any order."""

    def __init__(self, camera: Camera, width: int, height: int) -> None:
        self.camera, self.width, self.height = camera, width, height
        self.scale = 0.5 * height / math.tan(math.radians(FIELD) / 2)
        self.colours = np.zeros((height * width, 3), dtype=np.float32)
        self.nearness = np.zeros(height * width, dtype=np.float32)

    def pixels(self) -> NDArray[np.uint8]:
        """Return the picture (h, w, 3)."""
        return np.clip(self.colours, 0.0, 255.0).astype(np.uint8).reshape(self.height, self.width, 3)

    def ground(
        self, turn: Array, height: float, spacing: float, colours: tuple[Array, Array, Array, Array], reach: float
    ) -> None:
        """Paint the plane z = height of a turned frame, with a grid, into the haze: colours of plane, lines, haze, sky."""
        rows, columns = np.mgrid[0 : self.height : 2, 0 : self.width : 2]
        rays = np.stack([(columns + 1 - self.width / 2) / self.scale, (self.height / 2 - rows - 1) / self.scale,
                         -np.ones(rows.shape)], axis=-1) @ self.camera.axes  # fmt: skip
        normal = turn[:, 2]
        slope = rays @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (height - self.camera.eye @ normal) / slope
        hit = (depth > NEAR) & (depth < 1e4 * reach)
        at = (self.camera.eye + np.where(hit, depth, 0.0)[..., None] * rays) @ turn
        lines = np.zeros(hit.shape)
        for axis in (0, 1):
            share = at[..., axis] / spacing
            pixel = np.abs(np.gradient(share, axis=0)) + np.abs(np.gradient(share, axis=1)) + 1e-12
            distance = np.abs(share - np.round(share))
            cover = np.clip((0.006 + 0.5 * pixel - distance) / pixel, 0.0, 1.0) * np.clip(2.0 - 4.0 * pixel, 0.0, 1.0)
            lines = np.maximum(lines, cover)
        plane, line, haze, sky = colours
        colour = plane + lines[..., None] * (line - plane)
        far = 1.0 - np.exp(-((np.where(hit, depth, 0.0) / (4.0 * reach)) ** 2))
        colour = colour + far[..., None] * (haze - colour)
        rise = np.clip(slope / np.linalg.norm(rays, axis=-1) / 0.4, 0.0, 1.0)[..., None]
        colour = np.where(hit[..., None], colour, haze + rise * (sky - haze))
        nearness = np.where(hit, 1.0 / np.where(hit, depth, 1.0), 0.0)
        fine = np.repeat(np.repeat(colour, 2, axis=0), 2, axis=1)[: self.height, : self.width]
        self.colours[:] = fine.reshape(-1, 3)
        self.nearness[:] = np.repeat(np.repeat(nearness, 2, axis=0), 2, axis=1)[: self.height, : self.width].ravel()

    def shadows(self, triangles: Array, colour: Array) -> None:
        """Colour what triangles (n, 3, 3) on the ground cover; to be called before anything stands on it."""
        for pixels, *_ in self._fragments(triangles):
            self.colours[pixels] = colour

    def triangles(self, triangles: Array, colours: Array, lift: float = 0.0) -> None:
        """Paint triangles (n, 3, 3) with colours at their corners (n, 3, 3), the nearest in front; `lift` favours them."""
        for pixels, which, weights, nearness in self._fragments(triangles):
            nearness = nearness * (1.0 + lift)
            front = nearness > self.nearness[pixels]
            pixels, which, weights, nearness = pixels[front], which[front], weights[front], nearness[front]
            order = np.argsort(nearness, kind="stable")  # of several on one pixel the last one stays
            pixels = pixels[order]
            self.colours[pixels] = np.einsum("ij,ijk->ik", weights[order], colours[which[order]])
            self.nearness[pixels] = nearness[order]

    def lines(self, lines: Array, colour: Array, width: float) -> None:
        """Paint lines (n, 2, 3), some pixels wide, as bands that face the camera."""
        seen = self.camera.see(lines)
        lines, seen = lines[(seen[..., 2] > NEAR).all(axis=1)], seen[(seen[..., 2] > NEAR).all(axis=1)]
        if not len(lines):
            return
        flat = seen[..., :2] / seen[..., 2:]
        along = flat[:, 1] - flat[:, 0]
        along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
        across = along[:, 1:] * self.camera.axes[0] - along[:, :1] * self.camera.axes[1]
        half = 0.5 * width / self.scale * seen[..., 2]
        a, b = (lines[:, k] + half[:, k, None] * across for k in (0, 1))
        c, d = (lines[:, k] - half[:, k, None] * across for k in (0, 1))
        bands = np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])
        self.triangles(bands, np.broadcast_to(colour, (*bands.shape[:2], 3)), 1e-3)

    def _fragments(self, triangles: Array) -> Iterator[tuple[Whole, Whole, Array, Array]]:
        """Pixels that triangles cover, some rows at a time: pixel, triangle, weights of the corners, nearness."""
        seen = self.camera.see(triangles)
        ahead = np.flatnonzero((seen[..., 2] > NEAR).all(axis=1))
        near = 1.0 / seen[ahead][..., 2]
        flat = seen[ahead][..., :2] * near[..., None] * self.scale * [1.0, -1.0] + [self.width / 2 - 0.5, self.height / 2 - 0.5]
        a, b, c = flat[:, 0], flat[:, 1], flat[:, 2]
        area = _cross(b - a, c - a)
        low = np.clip(np.ceil(flat[..., 1].min(axis=1)), 0, self.height).astype(int)
        high = np.clip(np.floor(flat[..., 1].max(axis=1)), -1, self.height - 1).astype(int)
        rows = np.where(np.abs(area) > 1e-9, np.maximum(high - low + 1, 0), 0)
        # edge k is opposite corner k; its weight (slope_x x + slope_y y + rest) is 1 there and 0 on the edge
        starts, ends = np.stack([b, c, a], axis=1), np.stack([c, a, b], axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            slope_x = -(ends - starts)[..., 1] / area[:, None]
            slope_y = (ends - starts)[..., 0] / area[:, None]
            rest = -(slope_x * starts[..., 0] + slope_y * starts[..., 1])
        stops = np.concatenate([[0], np.cumsum(rows)])
        first = 0
        while first < len(rows):
            last = max(first + 1, int(np.searchsorted(stops, stops[first] + ROWS, side="right")) - 1)
            which = np.repeat(np.arange(first, last), rows[first:last])
            y = low[which] + np.arange(len(which)) - np.repeat(stops[first:last] - stops[first], rows[first:last])
            yield from self._spans(which, y, slope_x, slope_y, rest, near, ahead)
            first = last

    def _spans(
        self, which: Whole, y: Whole, slope_x: Array, slope_y: Array, rest: Array, near: Array, ahead: Whole
    ) -> Iterator[tuple[Whole, Whole, Array, Array]]:
        """Pixels of triangles on rows: between where the weights of all corners are positive."""
        lean, base = slope_x[which], slope_y[which] * y[:, None] + rest[which]
        with np.errstate(divide="ignore", invalid="ignore"):
            zero = -base / lean
        left = np.where(lean > 0.0, zero, np.where((lean == 0.0) & (base < 0.0), np.inf, -np.inf)).max(axis=1, initial=0.0)
        right = np.where(lean < 0.0, zero, np.inf).min(axis=1, initial=self.width - 1.0)
        left, right = np.ceil(np.minimum(left, self.width)).astype(int), np.floor(np.maximum(right, -1.0)).astype(int)
        count = np.maximum(right - left + 1, 0)
        if not count.sum():
            return
        row = np.repeat(np.arange(len(which)), count)
        x = np.repeat(left - np.cumsum(count) + count, count) + np.arange(len(row))
        weights = (lean[row] * x[:, None] + base[row]) * near[which[row]]
        nearness = weights.sum(axis=1)
        yield y[row] * self.width + x, ahead[which[row]], weights / nearness[:, None], nearness


def _cross(first: Array, second: Array) -> Array:
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
