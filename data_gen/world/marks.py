"""Marks on the road besides its lines: zebra crossings with their stop lines, and arrows that say where a lane leads."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_gen.road.layout import Lane, Layout
from data_gen.world.brush import Brush

Array = NDArray[np.float64]

ZEBRA = 3.0
"""Length of the bars of a zebra crossing, along the road, in metres."""
# Arrows as convex pieces in metres, x ahead and y left of the arrow's middle: 5 m long, for streets up to 60 km/h
_SHAFT = [(-2.5, -0.08), (0.9, -0.08), (0.9, 0.08), (-2.5, 0.08)]
_HEAD = [(0.9, -0.38), (2.5, 0.0), (2.5, 0.0), (0.9, 0.38)]
_BEND = [(-0.6, -0.06), (0.3, 0.5), (0.3, 0.72), (-0.9, 0.06)]
_BARB = [(-0.15, 0.62), (0.85, 0.38), (0.85, 0.38), (0.75, 1.15)]
_TAIL = [(-2.5, -0.08), (-0.6, -0.08), (-0.6, 0.08), (-2.5, 0.08)]
_PIECES = {"straight": [_SHAFT, _HEAD], "left": [_TAIL, _BEND, _BARB]}
_PIECES["right"] = [[(x, -y) for x, y in piece] for piece in _PIECES["left"]]


@dataclass(frozen=True)
class Crossing:
    """A zebra crossing: its ``middle`` (2,), the direction of the road ``yaw`` and the road's ``width`` there in metres."""

    middle: Array
    yaw: float
    width: float


def crossings(layout: Layout) -> list[Crossing]:
    """The zebra crossings of a layout: where a straight lane of a crossing's arm ends before a bend or a fork, and about
    every 80 m of a two-way street."""
    if layout.name == "two_way":
        return _on_the_way(layout)
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
        crossing = _across(lane.centre[-1], chord / length, float(lane.width[-1]), points, back=3.0)
        if all(np.linalg.norm(crossing.middle - other.middle) > 4.0 for other in found):
            found.append(crossing)
    return found


def _across(at: Array, ahead: Array, width: float, points: Array, *, back: float = 0.0) -> Crossing:
    """The crossing of the road at a point of one of its lanes, ``back`` metres before it: the other lanes' ``points`` beside
    it give the road's middle and width."""
    left = np.array([-ahead[1], ahead[0]])
    beside = (np.abs((points - at) @ ahead) < 1.5) & (np.abs((points - at) @ left) < 12.0)
    across = (points[beside] - at) @ left
    middle = at + left * (across.max() + across.min()) / 2 - ahead * back
    return Crossing(middle, float(np.arctan2(ahead[1], ahead[0])), float(across.max() - across.min() + width))


def _on_the_way(layout: Layout) -> list[Crossing]:
    lane = layout.lanes[0]
    points = np.concatenate([other.centre for other in layout.lanes])
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(lane.centre, axis=0), axis=1))])
    start = 20.0 + (37.0 * layout.extent[0]) % 60.0  # no two streets alike
    rows = np.searchsorted(arc, np.arange(start, arc[-1] - 10.0, 80.0))
    yaw = lane.yaw
    return [
        _across(lane.centre[i], np.array([np.cos(yaw[i]), np.sin(yaw[i])]), float(lane.width[i]), points)
        for i in rows.tolist()
    ]


def paint_zebra(brush: Brush, zebra: Crossing, bar: float = 0.5) -> None:
    """Bars along the road over its width, and a stop line a metre before them on the right half."""
    ahead = np.array([np.cos(zebra.yaw), np.sin(zebra.yaw)])
    left = np.array([-ahead[1], ahead[0]])
    across = np.arange(-zebra.width / 2 + 0.4, zebra.width / 2 - bar, 2 * bar)
    frame = np.array([[-0.5, 0.0], [0.5, 0.0], [0.5, 1.0], [-0.5, 1.0]])
    bars = zebra.middle + frame[:, :1] * ZEBRA * ahead + (across[:, None, None] + frame[:, 1:] * bar) * left
    brush.fill("white_paint", bars)
    stop = zebra.middle + (frame[:, :1] * 0.4 - ZEBRA / 2 - 1.2) * ahead - frame[:, 1:] * (zebra.width / 2 - 0.2) * left
    brush.fill("white_paint", stop[None])


def paint_arrows(brush: Brush, layout: Layout, lanes: Sequence[Lane], rng: np.random.Generator) -> None:
    """Arrows before the ends of lanes that lead on to a choice of ways, and now and then along the lanes of a fast road that
    splits."""
    starts = np.array([lane.centre[0] for lane in lanes])
    first = np.array([lane.yaw[0] for lane in lanes])
    last = np.array([lane.yaw[-1] for lane in lanes])
    for lane in lanes:
        arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(lane.centre, axis=0), axis=1))])
        near = np.linalg.norm(starts - lane.centre[-1], axis=1) < 1.0
        turn = (np.where(np.abs(_wrap(first - lane.yaw[-1])) < 0.3, last, first)[near] - lane.yaw[-1]).tolist()
        ways = {"left" if _wrap(a) > 0.5 else "right" if _wrap(a) < -0.5 else "straight" for a in turn}
        if layout.name in ("intersection", "roundabout") and len(ways) > 1 and arc[-1] > 30.0:
            shown = ["straight", str(rng.choice(sorted(ways - {"straight"})))] if "straight" in ways else sorted(ways)
            for back in (11.0, 32.0):
                _arrow(brush, lane, arc, arc[-1] - back, shown)
        elif layout.name in ("exit", "merge") and arc[-1] > 60.0:
            for at in np.arange(rng.uniform(10.0, 60.0), arc[-1] - 10.0, 75.0):
                _arrow(brush, lane, arc, at, ["straight"])


def _wrap(angle: float) -> float:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _arrow(brush: Brush, lane: Lane, arc: Array, at: float, ways: list[str]) -> None:
    if at < 4.0:
        return
    middle = np.array([np.interp(at, arc, lane.centre[:, k]) for k in (0, 1)])
    yaw = float(np.interp(at, arc, np.unwrap(lane.yaw)))
    rotation = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    pieces = np.array([piece for way in ways for piece in _PIECES[way]])
    brush.fill("white_paint", pieces @ rotation + middle)
