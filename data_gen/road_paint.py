"""Draw the ground of a layout: asphalt, shoulders or pavements, lane paint, crossings, wear.

Everything is painted in layers over one raster, widest first, so that where lanes join, the upper layer of any of them wins
and the union needs no geometry.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from data_gen.ground import GROUND_NAMES, GroundMap
from data_gen.layout import Lane, Layout

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
_BITS = 4  # cv2 draws at 1 / 16 pixel


@dataclass(frozen=True)
class Crossing:
    """A zebra crossing: its ``middle`` (2,), the direction of the road ``yaw`` and the road's ``width`` there in metres."""

    middle: Array
    yaw: float
    width: float


class _Brush:
    """Draws polylines given in metres."""

    def __init__(self, extent: tuple[float, float], resolution: float) -> None:
        self.canvas = np.zeros((int(np.ceil(extent[1] / resolution)), int(np.ceil(extent[0] / resolution))), np.uint8)
        self.resolution = resolution

    def _pixels(self, points: Array) -> NDArray[np.int32]:
        return np.rint((points / self.resolution - 0.5) * 2**_BITS).astype(np.int32)

    def stroke(self, material: str, lines: Sequence[Array], width: float) -> None:
        """Polylines (N, 2) of a width in metres, round at the ends."""
        thickness = max(1, round(width / self.resolution))
        pixels = [self._pixels(line) for line in lines]
        cv2.polylines(self.canvas, pixels, False, GROUND_NAMES.index(material), thickness, cv2.LINE_8, _BITS)

    def fill(self, material: str, corners: Array) -> None:
        """Convex polygons (P, K, 2), each on its own, so that overlaps stay filled."""
        for polygon in self._pixels(corners):
            cv2.fillConvexPoly(self.canvas, polygon, GROUND_NAMES.index(material), cv2.LINE_8, _BITS)


def paint_ground(layout: Layout, *, rng: np.random.Generator, resolution: float = 0.1) -> GroundMap:
    """The ground raster of a layout, from (0, 0) to its extent, ``resolution`` metres a pixel."""
    brush = _Brush(layout.extent, resolution)
    lanes = extend(layout.lanes, reach=150.0)
    _paint_verges(brush, layout.name, lanes, rng)
    for lane in lanes:
        brush.stroke("asphalt", [_thin(lane.centre)], lane.width.mean())
    _paint_wear(brush, lanes, rng)
    zebras = crossings(layout)
    _paint_lines(brush, lanes, rng)
    for zebra in zebras:
        _paint_zebra(brush, zebra)
    return GroundMap(brush.canvas, (0.0, 0.0), resolution)


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


def crossings(layout: Layout) -> list[Crossing]:
    """The zebra crossings of a layout: where a straight lane of a crossing's arm ends before a bend or a fork."""
    if layout.name not in ("intersection", "roundabout"):
        return []
    starts = np.array([lane.centre[0] for lane in layout.lanes])
    stops = np.array([lane.centre[-1] for lane in layout.lanes])
    points = np.concatenate([lane.centre for lane in layout.lanes])
    found: list[Crossing] = []
    for lane in layout.lanes:
        chord = lane.centre[-1] - lane.centre[0]
        length = np.linalg.norm(chord)
        follows = np.flatnonzero(np.linalg.norm(starts - lane.centre[-1], axis=1) < 1.0)
        straight = np.linalg.norm(np.diff(lane.centre, axis=0), axis=1).sum() < length + 0.05
        inner = np.any(np.linalg.norm(stops - lane.centre[0], axis=1) < 1.0)
        if length < 20 or not straight or inner or not len(follows):
            continue
        ahead = chord / length
        left = np.array([-ahead[1], ahead[0]])
        # The arm's other lanes lie beside this end; together they give the road's middle and width.
        beside = (np.abs((points - lane.centre[-1]) @ ahead) < 1.5) & (np.abs((points - lane.centre[-1]) @ left) < 12.0)
        across = (points[beside] - lane.centre[-1]) @ left
        width = across.max() - across.min() + lane.width[-1]
        middle = lane.centre[-1] + left * (across.max() + across.min()) / 2 - ahead * 3.0
        if all(np.linalg.norm(middle - other.middle) > 4.0 for other in found):
            found.append(Crossing(middle, float(np.arctan2(ahead[1], ahead[0])), float(width)))
    return found


def _thin(line: Array, tolerance: float = 0.02) -> Array:
    """The polyline without the points that lie on it anyway: a straight lane is two points."""
    return cv2.approxPolyDP(line.astype(np.float32)[:, None], tolerance, False)[:, 0].astype(float)


def _paint_verges(brush: _Brush, name: str, lanes: Sequence[Lane], rng: np.random.Generator) -> None:
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


def _paint_wear(brush: _Brush, lanes: Sequence[Lane], rng: np.random.Generator) -> None:
    """Repairs (dark rectangles along the lane) and sealed cracks (wandering lines), about one each 25 m of lane."""
    points = np.concatenate([lane.centre[1:-1] for lane in lanes])
    step = np.concatenate([np.diff(lane.centre, axis=0)[1:] for lane in lanes])
    chosen = rng.random(len(points)) < 0.06
    at, ahead = points[chosen], step[chosen] / np.linalg.norm(step[chosen], axis=1, keepdims=True)
    if not len(at):
        return
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    at = at + left * rng.uniform(-1.2, 1.2, (len(at), 1))
    half_l, half_w = rng.uniform(0.5, 4.0, (2, len(at), 1)) * [[[1.0]], [[0.25]]]
    corners = np.stack(
        [at + a * half_l * ahead + b * half_w * left for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))], axis=1
    )
    brush.fill("patch", corners[::2])
    walk = np.cumsum(rng.normal([1.0, 0.0], [0.9, 0.25], (len(at), 6, 2)), axis=1)
    cracks = at[:, None] + walk[..., :1] * ahead[:, None] + walk[..., 1:] * left[:, None]
    brush.stroke("tar", list(cracks[1::2]), brush.resolution)


def _paint_lines(brush: _Brush, lanes: Sequence[Lane], rng: np.random.Generator) -> None:
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


def _paint_line(brush: _Brush, line: Array, kind: str, colour: str, rng: np.random.Generator) -> None:
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


def _paint_zebra(brush: _Brush, zebra: Crossing, length: float = 3.0, bar: float = 0.5) -> None:
    """Bars along the road over its width, and a stop line a metre before them on the right half."""
    ahead = np.array([np.cos(zebra.yaw), np.sin(zebra.yaw)])
    left = np.array([-ahead[1], ahead[0]])
    across = np.arange(-zebra.width / 2 + 0.4, zebra.width / 2 - bar, 2 * bar)
    frame = np.array([[-0.5, 0.0], [0.5, 0.0], [0.5, 1.0], [-0.5, 1.0]])
    bars = zebra.middle + frame[:, :1] * length * ahead + (across[:, None, None] + frame[:, 1:] * bar) * left
    brush.fill("white_paint", bars)
    stop = (
        zebra.middle + (frame[:, :1] * 0.4 - length / 2 - 1.2) * ahead - frame[:, 1:] * (zebra.width / 2 - 0.2) * left
    )
    brush.fill("white_paint", stop[None])
