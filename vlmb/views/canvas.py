"""The canvas: a picture with depth, on numpy alone. Triangles, lines, a ground without end, shadows."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Whole = NDArray[np.int64]
FIELD = 40.0  # [deg] angle of view, upwards
NEAR = 0.02  # [m]
SUN = np.array([-3.0, -4.0, 9.0]) / math.sqrt(106.0)
ROWS = 60_000  # rows of triangles looked at in one go
EVEN = np.uint32(0x00FF00FF)  # red and blue of a packed colour


def packed(channels: Any) -> Any:
    """Return red, green, blue (0 to 255), each a number or an array, as whole numbers of 32 bits."""
    red, green, blue = (np.asarray(channel).astype(np.uint32) for channel in channels)
    return red | (green << np.uint32(8)) | (blue << np.uint32(16))


def unpacked(colours: Any) -> NDArray[np.uint8]:
    """Return packed colours (h, w) as (h, w, 3)."""
    parts = np.ascontiguousarray(colours.astype("<u4", copy=False)).view(np.uint8).reshape(*colours.shape, 4)
    return np.ascontiguousarray(parts[..., :3])


class Camera(NamedTuple):
    """A camera in a world with z up: where it is, and its axes right, up, back as rows."""

    eye: Array
    axes: Array
    zoom: float = 1.0  # of its lens

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
    """Colours (h w), packed in whole numbers, and nearness 1/depth (h w) as seen by a camera; painted in any order."""

    def __init__(self, camera: Camera, width: int, height: int) -> None:
        self.camera, self.width, self.height = camera, width, height
        self.scale = 0.5 * height * camera.zoom / math.tan(math.radians(FIELD) / 2)
        self.colours = np.zeros(height * width, dtype=np.uint32)
        self.nearness = np.zeros(height * width, dtype=np.float32)

    def pixels(self) -> NDArray[np.uint8]:
        """Return the picture (h, w, 3)."""
        return unpacked(self.colours.reshape(self.height, self.width))

    def halved(self) -> NDArray[np.uint8]:
        """Return the picture at half its size, each pixel the mean of four."""
        fine = self.colours.reshape(self.height, self.width)
        four = [fine[row::2, column::2] for row in (0, 1) for column in (0, 1)]
        even = sum((part & EVEN for part in four[1:]), four[0] & EVEN)  # sums of four bytes fit into two
        odd = sum(((part >> 8) & EVEN for part in four[1:]), (four[0] >> 8) & EVEN)
        return unpacked(((even >> 2) & EVEN) | (((odd >> 2) & EVEN) << 8))

    def ground(
        self, turn: Array, height: float, spacing: float, colours: tuple[Array, Array, Array, Array], reach: float
    ) -> None:
        """Paint the plane z = height of a turned frame, with a grid, into the haze: colours of plane, lines, haze, sky."""
        eye, axes = (self.camera.eye @ turn).astype(np.float32), (self.camera.axes @ turn).astype(np.float32)
        x = ((np.arange(0, self.width, 2) + 1 - self.width / 2) / self.scale).astype(np.float32)
        y = ((self.height / 2 - np.arange(0, self.height, 2) - 1) / self.scale).astype(np.float32)[:, None]
        ahead, left, slope = (x * axes[0, k] + y * axes[1, k] - axes[2, k] for k in range(3))  # rays in the plane's frame
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            depth = (np.float32(height) - eye[2]) / slope
        hit = (depth > NEAR) & (depth < 1e4 * reach)
        depth, steep = np.where(hit, depth, 0.0), np.where(hit, slope, 1.0)
        lines = np.zeros(hit.shape, dtype=np.float32)
        for k, ray in enumerate((ahead, left)):
            share = (eye[k] + depth * ray) / spacing
            lean = ray / steep
            pixel = np.abs(axes[0, k] - lean * axes[0, 2]) + np.abs(axes[1, k] - lean * axes[1, 2])  # that a pixel covers
            pixel = pixel * (depth * np.float32(2.0 / self.scale / spacing)) + np.float32(1e-9)
            cover = np.clip((0.006 + 0.5 * pixel - np.abs(share - np.rint(share))) / pixel, 0.0, 1.0)
            np.maximum(lines, cover * np.clip(2.0 - 4.0 * pixel, 0.0, 1.0), out=lines)
        far = 1.0 - np.exp(-((depth / np.float32(4.0 * reach)) ** 2))
        rise = np.clip(slope / np.sqrt(x * x + y * y + 1.0) / 0.4, 0.0, 1.0)
        channels = []
        for plane, line, haze, sky in zip(*colours, strict=True):
            on = plane + lines * np.float32(line - plane)
            channels.append(np.where(hit, on + far * (haze - on), haze + rise * np.float32(sky - haze)))
        self._spread(packed(channels), self.colours)
        self._spread(np.where(hit, 1.0 / np.where(hit, depth, 1.0), 0.0), self.nearness)

    def _spread(self, coarse: Any, fine: Any) -> None:
        """Put an image of half the resolution into a fine one."""
        whole = fine.reshape(self.height, self.width)
        for row in (0, 1):
            for column in (0, 1):
                part = whole[row::2, column::2]
                part[:] = coarse[: part.shape[0], : part.shape[1]]

    def shadows(self, triangles: Array, colour: Array) -> None:
        """Colour what triangles (n, 3, 3) on the ground cover; to be called before anything stands on it."""
        shade = packed(colour)
        for pixels, *_ in self._fragments(triangles, covered=True):
            self.colours[pixels] = shade

    def triangles(self, triangles: Array, colours: Array, lift: float | Array = 0.0) -> None:
        """Paint triangles (n, 3, 3) with colours at their corners (n, 3, 3), the nearest in front; `lift` (n) favours them."""
        favour = np.broadcast_to(1.0 + np.asarray(lift), len(triangles))
        for pixels, which, weights, nearness in self._fragments(triangles):
            nearness = (nearness * favour[which]).astype(np.float32)
            np.maximum.at(self.nearness, pixels, nearness)
            front = nearness == self.nearness[pixels]
            pixels, which, weights = pixels[front], which[front], weights[:, front]
            corners = colours[which]
            mixed = sum(weights[k][:, None] * corners[:, k] for k in range(3))
            self.colours[pixels] = packed(np.clip(mixed + 0.5, 0.0, 255.0).T)  # rounded

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

    def _fragments(self, triangles: Array, covered: bool = False) -> Iterator[tuple[Whole, Whole, Array, Array]]:
        """Pixels that triangles cover, some rows at a time: pixel, triangle, weights of the corners, nearness.

        `covered`: pixels alone. Corners are columns: numpy is slow along an axis of three.
        """
        seen = self.camera.see(triangles)
        depth = seen[..., 2]
        ahead = np.flatnonzero((depth[:, 0] > NEAR) & (depth[:, 1] > NEAR) & (depth[:, 2] > NEAR))
        near = 1.0 / depth[ahead].T
        x = seen[ahead, :, 0].T * near * self.scale + (self.width / 2 - 0.5)
        y = seen[ahead, :, 1].T * near * -self.scale + (self.height / 2 - 0.5)
        area = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])
        low = np.clip(np.ceil(np.minimum(np.minimum(y[0], y[1]), y[2])), 0, self.height).astype(int)
        high = np.clip(np.floor(np.maximum(np.maximum(y[0], y[1]), y[2])), -1, self.height - 1).astype(int)
        left, right = np.minimum(np.minimum(x[0], x[1]), x[2]), np.maximum(np.maximum(x[0], x[1]), x[2])
        shown = (np.abs(area) > 1e-9) & (right >= 0.0) & (left <= self.width - 1.0)
        rows = np.where(shown, np.maximum(high - low + 1, 0), 0)
        # edge k is opposite corner k; its weight (slope_x x + slope_y y + rest) is 1 there and 0 on the edge
        starts, ends = [1, 2, 0], [2, 0, 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            slope_x, slope_y = -(y[ends] - y[starts]) / area, (x[ends] - x[starts]) / area
            rest = -(slope_x * x[starts] + slope_y * y[starts])
        stops = np.concatenate([[0], np.cumsum(rows)])
        first = 0
        while first < len(rows):
            last = max(first + 1, int(np.searchsorted(stops, stops[first] + ROWS, side="right")) - 1)
            which = np.repeat(np.arange(first, last), rows[first:last])
            line = low[which] + np.arange(len(which)) - np.repeat(stops[first:last] - stops[first], rows[first:last])
            yield from self._spans(which, line, slope_x, slope_y, rest, near, ahead, covered)
            first = last

    def _spans(
        self, which: Whole, y: Whole, slope_x: Array, slope_y: Array, rest: Array, near: Array, ahead: Whole, covered: bool
    ) -> Iterator[tuple[Whole, Whole, Array, Array]]:
        """Pixels of triangles on rows: between where the weights of all corners are positive."""
        lean, base = slope_x[:, which], slope_y[:, which] * y + rest[:, which]
        left, right = np.zeros(len(which)), np.full(len(which), self.width - 1.0)
        for k in range(3):
            with np.errstate(divide="ignore", invalid="ignore"):
                zero = -base[k] / lean[k]
            never = np.where((lean[k] == 0.0) & (base[k] < 0.0), np.inf, -np.inf)
            np.maximum(left, np.where(lean[k] > 0.0, zero, never), out=left)
            np.minimum(right, np.where(lean[k] < 0.0, zero, np.inf), out=right)
        left, right = np.ceil(np.minimum(left, self.width)).astype(int), np.floor(np.maximum(right, -1.0)).astype(int)
        count = np.maximum(right - left + 1, 0)
        if not count.sum():
            return
        row = np.repeat(np.arange(len(which)), count)
        x = np.repeat(left - np.cumsum(count) + count, count) + np.arange(len(row))
        if covered:
            yield y[row] * self.width + x, row, slope_x, near
            return
        owner = which[row]
        weights = [(lean[k][row] * x + base[k][row]) * near[k][owner] for k in range(3)]
        nearness = weights[0] + weights[1] + weights[2]
        yield y[row] * self.width + x, ahead[owner], np.array(weights) / nearness, nearness
