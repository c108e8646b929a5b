"""Draw the ground of a layout: asphalt, shoulders or pavements, lane paint, crossings, wear.

Everything is painted in layers over one raster, widest first, so that where lanes join, the upper layer of any of them wins
and the union needs no geometry.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from data_gen.road.layout import Lane, Layout
from data_gen.world.brush import Brush
from data_gen.world.ground import GroundMap
from data_gen.world.marks import crossings, paint_arrows, paint_zebra
from data_gen.world.wear import paint_age, paint_repairs

Array = NDArray[np.float64]

URBAN = ("intersection", "roundabout", "two_way", "u_turn")
"""Layouts with kerbs and pavements; the others have a hard shoulder."""
SHOULDER = 0.5
"""Metres from the outermost lane's edge to the kerb's face, or the edge line's strip."""
VERGE = 2.5
"""Width of the pavement (from the kerb's face) or of the hard shoulder, in metres."""
KERB = 0.3
"""Width of a kerb stone's top in metres."""
DASH, GAP = 3.0, 6.0
"""Metres painted and not painted of a striped line."""


def paint_ground(layout: Layout, *, rng: np.random.Generator, resolution: float = 0.1) -> GroundMap:
    """The ground raster of a layout, from (0, 0) to its extent, ``resolution`` metres a pixel."""
    brush = Brush(layout.extent, resolution)
    lanes = extend(layout.lanes, reach=150.0)
    paths = [_thin(lane.centre) for lane in lanes]
    _paint_verges(brush, layout.name, lanes, rng)
    for lane, path in zip(lanes, paths, strict=True):
        brush.stroke("asphalt", [path], lane.width.mean())
    paint_age(brush, lanes, paths, rng)
    paint_repairs(brush, lanes, rng)
    _paint_lines(brush, lanes, rng)
    paint_arrows(brush, layout, layout.lanes, rng)
    for zebra in crossings(layout):
        paint_zebra(brush, zebra)
    return brush.ground()


def extend(lanes: Sequence[Lane], *, reach: float) -> list[Lane]:
    """The lanes, prolonged straight by ``reach`` metres where the road just stops: no lane lies ahead of that end."""
    points = np.concatenate([lane.centre for lane in lanes])
    longer = []
    for lane in lanes:
        ends = []
        for end, before in ((lane.centre[0], lane.centre[1]), (lane.centre[-1], lane.centre[-2])):
            ahead = (end - before) / np.linalg.norm(end - before)
            along, across = (points - end) @ ahead, (points - end) @ [-ahead[1], ahead[0]]
            open_end = not np.any((along > 0.3) & (along < 10.0) & (np.abs(across) < 6.0))
            ends.append((end + reach * ahead)[None] if open_end else np.zeros((0, 2)))
        centre = np.concatenate([ends[0], lane.centre, ends[1]])
        width = np.pad(lane.width, (len(ends[0]), len(ends[1])), mode="edge")
        longer.append(replace(lane, centre=centre, width=width))
    return longer


def _thin(line: Array, tolerance: float = 0.02) -> Array:
    """The polyline without the points that lie on it anyway: a straight lane is two points."""
    return cv2.approxPolyDP(line.astype(np.float32)[:, None], tolerance, False)[:, 0].astype(float)


def _paint_verges(brush: Brush, name: str, lanes: Sequence[Lane], rng: np.random.Generator) -> None:
    urban = name in URBAN
    size = np.array(brush.canvas.shape[::-1]) * brush.resolution
    tufts = rng.uniform(0, 1, (60, 1, 2)) * size + np.cumsum(rng.normal(0, 2.5, (60, 4, 2)), axis=1)
    for width in (2.0, 5.0):
        brush.stroke("dry_grass", list(tufts[int(width) % 2 :: 2]), width)
    layers = [("gravel", VERGE + 0.8), ("pavement", VERGE), ("kerb", KERB), ("shoulder", 0.0)]
    layers = layers if urban else [("gravel", VERGE + 0.8), ("shoulder", VERGE - SHOULDER)]
    for material, beyond in layers:
        for lane in lanes:
            brush.stroke(material, [_thin(lane.centre)], lane.width.mean() + 2 * (SHOULDER + beyond))


def _paint_lines(brush: Brush, lanes: Sequence[Lane], rng: np.random.Generator) -> None:
    """Lane lines; yellow between opposite directions. Stripes fade here and there. Where a line would run across another
    lane, as in a junction, it is left out."""
    centres = [_resampled(lane.centre, 1.0) for lane in lanes]
    tangents = [_unit(np.gradient(centre, axis=0)) for centre in centres]
    tree, heading = cKDTree(np.concatenate(centres)), np.concatenate(tangents)
    for lane, centre, tangent in zip(lanes, centres, tangents, strict=True):
        half = float(lane.width.mean()) / 2
        normal = tangent[:, ::-1] * [-1, 1]
        for side, kind in ((1, lane.left_line), (-1, lane.right_line)):
            if kind == "none":
                continue
            line = centre + side * half * normal
            distance, near = tree.query(line, k=4)
            # Oncoming traffic half a lane beyond the line makes it a centre line.
            oncoming = (np.einsum("nkj,nj->nk", heading[near], tangent) < -0.5) & (distance < half + 0.8)
            colour = "yellow_paint" if oncoming.any(axis=1).mean() > 0.3 else "white_paint"
            free = distance[:, 0] > 0.85 * half
            for start, stop in np.flatnonzero(np.diff(np.pad(free.astype(int), 1))).reshape(-1, 2):
                if stop - start > 1:
                    _paint_line(brush, line[start:stop], kind, colour, rng)


def _paint_line(brush: Brush, line: Array, kind: str, colour: str, rng: np.random.Generator) -> None:
    if kind == "continuous":
        brush.stroke(colour, [_thin(line)], 0.2)
        return
    dashes = _dashes(line)
    worn = rng.random(len(dashes)) < 0.15
    brush.stroke(colour, list(dashes[~worn]), 0.2)
    brush.stroke("worn_paint", list(dashes[worn]), 0.2)


def _unit(v: Array) -> Array:
    return v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-9)


def _resampled(line: Array, spacing: float) -> Array:
    """Points (M, 2) on a polyline (N, 2), ``spacing`` metres apart or a little less."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.linspace(0.0, arc[-1], max(2, int(np.ceil(arc[-1] / spacing)) + 1))
    return np.stack([np.interp(at, arc, line[:, 0]), np.interp(at, arc, line[:, 1])], axis=1)


def _dashes(line: Array, offset: float = 0.0) -> Array:
    """Stripes (D, 3, 2) along a polyline (N, 2): start, middle, end of each."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.arange(offset, arc[-1] - DASH, DASH + GAP)[:, None] + np.array([0.0, DASH / 2, DASH])
    return np.stack([np.interp(at, arc, line[:, 0]), np.interp(at, arc, line[:, 1])], axis=-1)
