"""A country road with bends, as a street network of highway-env, whose y points to the right."""

import math
from itertools import pairwise

import numpy as np
from highway_env.road.lane import LineType, SineLane, StraightLane
from highway_env.road.road import RoadNetwork

WIDTH = 4.0
STRAIGHT, WAVE = 120.0, 150.0
"""Metres of the straight at each end, and of one wave."""


def network(rng: np.random.Generator, *, amplitude: float) -> RoadNetwork:
    """One lane each way: straight, one or two waves that swing ``amplitude`` metres to either side, straight again.

    ``rng`` varies the scene. Nodes a to d lead there and e to h back, so that nobody turns round at the end of the road.
    """
    end = STRAIGHT + WAVE * int(rng.integers(1, 3))
    stops = [0.0, STRAIGHT, end, end + STRAIGHT]
    road = RoadNetwork()
    _add_lanes(road, "abcd", [(x, WIDTH / 2) for x in stops], amplitude, LineType.STRIPED)
    _add_lanes(road, "efgh", [(x, -WIDTH / 2) for x in reversed(stops)], -amplitude, LineType.NONE)
    return road


def _add_lanes(road: RoadNetwork, nodes: str, points: list[tuple], side: float, middle: LineType) -> None:
    """``side``: where the wave begins, metres to the right of the way; ``middle``: the line to the left."""
    for i, ((start, y), (stop, _)) in enumerate(pairwise(points)):
        paint = {"width": WIDTH, "line_types": (middle, LineType.CONTINUOUS)}
        if i == 1:
            lane = SineLane([start, y], [stop, y], side, 2 * math.pi / WAVE, math.pi / 2, **paint)
        else:
            y += abs(side)
            lane = StraightLane([start, y], [stop, y], **paint)
        road.add_lane(nodes[i], nodes[i + 1], lane)
