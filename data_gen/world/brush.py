"""A brush that draws materials on the ground raster, in metres."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.world.ground import EVEN, GROUND_NAMES, MARKS, TONE_STRIDE, GroundMap

Array = NDArray[np.float64]

_BITS = 4  # cv2 draws at 1 / 16 pixel
_BLEED = 0.7
"""Pixels by which cv2's smooth polygons are too large on every side."""


class Brush:
    """Draws polylines and polygons given in metres on the rasters of a :class:`GroundMap` from (0, 0) to ``extent``."""

    def __init__(self, extent: tuple[float, float], resolution: float) -> None:
        rows, columns = (int(np.ceil(size / resolution)) for size in extent[::-1])
        self.resolution = resolution
        self.canvas, self.cover = np.zeros((2, rows, columns), np.uint8)
        self.tone = np.full((-(-rows // TONE_STRIDE), -(-columns // TONE_STRIDE)), EVEN, np.uint8)

    def stroke(self, material: str, lines: Sequence[Array], width: float) -> None:
        """Polylines (N, 2) of a width in metres, round at the ends."""
        thickness = max(1, round(width / self.resolution))
        pixels = [_pixels(line, self.resolution) for line in lines]
        cv2.polylines(self.canvas, pixels, False, GROUND_NAMES.index(material), thickness, cv2.LINE_8, _BITS)
        if material in MARKS:
            half = max(width / self.resolution / 2 - _BLEED, 0.0) * self.resolution
            for quad in _pixels(_quads(lines, half), self.resolution):
                cv2.fillConvexPoly(self.cover, quad, 255, cv2.LINE_AA, _BITS)

    def fill(self, material: str, corners: Array) -> None:
        """Convex polygons (P, K, 2), each on its own, so that overlaps stay filled."""
        for polygon in _pixels(corners, self.resolution):
            cv2.fillConvexPoly(self.canvas, polygon, GROUND_NAMES.index(material), cv2.LINE_8, _BITS)
            if material in MARKS:
                _cover(self.cover, polygon)

    def shade(self, gain: float, lines: Sequence[Array], width: float) -> None:
        """Set the albedo's factor along polylines (N, 2) of a width in metres."""
        cell = TONE_STRIDE * self.resolution
        pixels = [_pixels(line, cell) for line in lines]
        thickness = max(1, round(width / cell))
        cv2.polylines(self.tone, pixels, False, round(EVEN * gain), thickness, cv2.LINE_8, _BITS)

    def ground(self) -> GroundMap:
        """What has been drawn; the tones run into each other over about half a metre."""
        tone = cv2.blur(self.tone, (3, 3)).astype(np.uint8, copy=False)
        return GroundMap(self.canvas, (0.0, 0.0), self.resolution, self.cover, tone)


def _quads(lines: Sequence[Array], half: float) -> Array:
    """Rectangles (P, 4, 2) about the P pieces of polylines (N, 2), ``half`` as wide to each side."""
    if not len(lines):
        return np.zeros((0, 4, 2))
    start, end = (np.concatenate([line[part] for line in lines]) for part in (slice(-1), slice(1, None)))
    step = end - start
    left = half * step[:, ::-1] * [-1, 1] / np.maximum(np.hypot(*step.T), 1e-9)[:, None]
    return np.stack([start + left, start - left, end - left, end + left], axis=1)


def _cover(cover: NDArray[np.uint8], polygon: NDArray[np.int32]) -> None:
    """Raise the cells' cover to what a small convex polygon (K, 2), in 1 / 16 pixel, covers: counted on an eight times finer
    raster."""
    low = np.maximum((polygon.min(axis=0) >> _BITS) - 1, 0)
    high = np.minimum((polygon.max(axis=0) >> _BITS) + 3, cover.shape[::-1])
    if (high <= low).any():
        return
    fine = np.zeros((8 * (high - low)[::-1]), np.uint8)
    corners = 8 * (polygon - (low << _BITS)) + (7 << _BITS) // 2  # cv2 counts from the middle of the first pixel
    cv2.fillConvexPoly(fine, corners.astype(np.int32), 255, cv2.LINE_8, _BITS)
    part = cover[low[1] : high[1], low[0] : high[0]]
    np.maximum(part, cv2.resize(fine, part.shape[::-1], interpolation=cv2.INTER_AREA), out=part)


def _pixels(points: Array, cell: float) -> NDArray[np.int32]:
    return np.rint((points / cell - 0.5) * 2**_BITS).astype(np.int32)
