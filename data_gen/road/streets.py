"""The eight street networks, taken from highway-env's environments and varied by the seed."""

import math
import os
import string
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

from highway_env.envs import (
    exit_env,
    highway_env,
    intersection_env,
    merge_env,
    racetrack_env,
    roundabout_env,
    two_way_env,
    u_turn_env,
)
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.road.lane import LineType, StraightLane
from highway_env.road.road import RoadNetwork

Rng = np.random.Generator

EXTENSION = 120.0
LATERAL_ACCELERATION = 3.0
"""Comfortable in a bend, m/s^2: limits the speed on an arc to sqrt(3 radius)."""


@dataclass(frozen=True)
class Street:
    """What a layout is made of. ``make``: the lanes, anew for each scene; y points right there, as highway-env has it.

    ``starts``: first letters of the nodes at which the ego's first lane may begin; empty: of any. ``crossing``: ways cross, so
    that somebody has to yield and nobody changes lanes.
    """

    make: Callable[[Rng], RoadNetwork]
    starts: str = ""
    crossing: bool = False


def build_network(street: Street, pace: float, rng: Rng) -> RoadNetwork:
    """The lanes of a street, with speed limits for a desired speed ``pace`` in m/s."""
    network = street.make(rng)
    _extend(network)
    for lane in network.lanes_list():
        radius = getattr(lane, "radius", math.inf)
        lane.speed_limit = min(1.2 * pace, math.sqrt(LATERAL_ACCELERATION * radius))
    return network


def _extend(network: RoadNetwork) -> None:
    """Lengthen straight roads that end in nothing by EXTENSION metres: the world reaches farther than the environments."""
    lanes = network.lanes_list()
    starts = np.array([(*lane.position(0.0, 0.0), lane.heading_at(0.0)) for lane in lanes])
    stops = np.array([(*lane.position(lane.length, 0.0), lane.heading_at(lane.length)) for lane in lanes])
    for lane, start, stop in zip(lanes, starts, stops, strict=True):
        if type(lane) is not StraightLane or lane.length > 500:
            continue
        if not _goes_on(start, stops):
            lane.start = lane.start - EXTENSION * lane.direction
        if not _goes_on(stop, starts):
            lane.end = lane.end + EXTENSION * lane.direction
        lane.length = float(np.linalg.norm(lane.end - lane.start))


def _goes_on(end: np.ndarray, others: np.ndarray) -> bool:
    """Whether another lane, or one beside it, joins an end (x, y, heading) in the same direction. The graph does not say:
    at the intersection's outer nodes a lane's successor is the one that comes back."""
    near = np.hypot(*(others[:, :2] - end[:2]).T) < 5.5
    return bool((near & (np.cos(others[:, 2] - end[2]) > 0.7)).any())


def _network(environment: type[AbstractEnv], rng: Rng, make: str = "_make_road", **overrides: Any) -> RoadNetwork:
    """The network that an environment makes. It is not constructed: that would reset it twice, unseeded the first time."""
    env: Any = object.__new__(environment)
    env.config = {**environment.default_config(), **overrides}
    env._np_random = rng
    getattr(env, make)()
    return env.road.network


def _highway(rng: Rng) -> RoadNetwork:
    return _network(highway_env.HighwayEnv, rng, "_create_road", lanes_count=int(rng.integers(2, 5)))


def _merge(rng: Rng) -> RoadNetwork:
    return _network(merge_env.MergeGenericEnv, rng, lanes_count=int(rng.integers(2, 4)))


def _exit(rng: Rng) -> RoadNetwork:
    return _network(exit_env.ExitEnv, rng, "_create_road", lanes_count=int(rng.integers(2, 5)))


def _roundabout(rng: Rng) -> RoadNetwork:
    radius, lanes = float(rng.uniform(18, 28)), int(rng.integers(1, 3))
    network = _network(roundabout_env.RoundaboutGenericEnv, rng, roundabout_radius=radius, roundabout_lanes=lanes)
    for lane in network.lanes_list():
        lane.priority = int(hasattr(lane, "radius"))  # who is on the ring has the right of way
    return network


def _intersection(rng: Rng) -> RoadNetwork:
    return _network(intersection_env.IntersectionEnv, rng)


def _two_way(rng: Rng) -> RoadNetwork:
    """Without the overtaking lane, which is the oncoming lane driven the other way."""
    network = _network(two_way_env.TwoWayEnv, rng)
    del network.graph["a"]["b"][0]
    network.graph["a"]["b"][0].line_types = (LineType.STRIPED, LineType.CONTINUOUS)
    network.graph["b"]["a"][0].line_types = (LineType.NONE, LineType.CONTINUOUS)
    return network


def _racetrack(rng: Rng) -> RoadNetwork:
    """One of the three tracks. The oval's size is sampled here: left to itself it would come from an unseeded generator."""
    size: dict[str, Any] = {"length": int(rng.integers(80, 160)), "no_lanes": int(rng.integers(2, 4))}
    track = (racetrack_env.RacetrackEnv, racetrack_env.RacetrackEnvLarge, racetrack_env.RacetrackEnvOval)[
        rng.integers(3)
    ]
    return _network(track, rng, **size)


def _u_turn(rng: Rng) -> RoadNetwork:
    return _network(u_turn_env.UTurnEnv, rng)


STREETS = {
    "highway": Street(_highway, starts="0"),
    "merge": Street(_merge, starts="aj"),
    "exit": Street(_exit, starts="01"),
    "roundabout": Street(_roundabout, starts="snew", crossing=True),
    "intersection": Street(_intersection, starts="oi", crossing=True),
    "two_way": Street(_two_way, starts="ab"),
    "racetrack": Street(_racetrack, starts=string.ascii_lowercase),
    "u_turn": Street(_u_turn, starts="abc"),
}
LAYOUTS = tuple(STREETS)
