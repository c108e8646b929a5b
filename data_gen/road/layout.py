"""A stretch of road and the traffic on it, recorded from highway-env as tracks in our frame.

highway-env's y points to the right and its ``velocity`` leaves out the slip angle: both are put right in :func:`_track`,
and nowhere else.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from highway_env.road.lane import AbstractLane, StraightLane
from numpy.typing import NDArray

from data_gen.road.driver import Driver, SimulatedRoad
from data_gen.road.ego import REAR_AXLE
from data_gen.road.footprints import overlaps
from data_gen.road.halts import BRAKE, NEVER, Halt, choose_halt
from data_gen.road.streets import LAYOUTS, STREETS, Street, build_network
from data_gen.road.track import Track
from data_gen.road.traffic_settings import Traffic
from fusion_net.common.checks import check_names
from fusion_net.common.random import stream, uniform

__all__ = ["LAYOUTS", "Lane", "Layout", "record_layout"]

Array = NDArray[np.float64]
LineKind = Literal["none", "striped", "continuous"]

STEP = 0.1
"""Seconds between records, at which everybody moves; tracks are Hermite splines in between."""
DECISION = 2
"""Steps from one decision of a driver to the next."""
MARGIN = 100.0
"""The world reaches this far beyond the ego's path, in metres."""
SIGHT = 95.0
"""Vehicles that never come nearer to the ego than this many metres are left out."""
WARM_UP = (0.5, 1.5)
"""Least and greatest time in seconds that everybody drives before the recording begins."""
CREEP = (-1.5, 4.0)
"""Range of the desired speed in m/s, at least 0, in a queue that the ego stands in."""
ATTEMPTS = 60
_LINES: tuple[LineKind, ...] = ("none", "striped", "continuous", "continuous")  # by highway-env's LineType


@dataclass(frozen=True)
class Lane:
    """A lane as a polyline, in the direction of travel. ``left_line`` and ``right_line`` are the paint on its borders."""

    centre: Array  # (N, 2) metres, at most 2 m apart
    width: Array  # (N,) metres
    left_line: LineKind
    right_line: LineKind
    speed_limit: float  # m/s
    forbidden: bool  # closed to through traffic: ramps

    @property
    def yaw(self) -> Array:
        """Heading (N,) in radians."""
        tangent = np.gradient(self.centre, axis=0)
        return np.arctan2(tangent[:, 1], tangent[:, 0])


@dataclass(frozen=True)
class Layout:
    """Lanes and tracks of one episode, times 0 .. duration. The ego's track is that of the ego frame (rear axle); the
    others' are of the vehicles' centres. ``extent`` is the world's upper right corner; the lower left is (0, 0)."""

    name: str
    lanes: list[Lane]
    ego: Track
    vehicles: list[Track]
    extent: tuple[float, float]


def record_layout(name: str, *, seed: int, duration: float, traffic: Traffic, street: Street | None = None) -> Layout:
    """An episode of ``duration`` seconds on a layout of :data:`LAYOUTS`, or on a ``street`` of one's own under any name.

    The same seed gives the same episode, whatever was made before. One in which two vehicles touch is replaced by another.
    """
    if street is None:
        check_names("layout", [name], LAYOUTS)
        street = STREETS[name]
    if not duration > 0:
        raise ValueError(f"layout '{name}': duration={duration} s is not above 0")
    # once: a collision does not make it rarer
    halt = choose_halt(stream(seed, "halt", name), duration, traffic.waiting_probability)
    for attempt in range(ATTEMPTS):
        rng = stream(seed, "layout", name, attempt)
        pace = uniform(rng, traffic.speed[name])
        road = SimulatedRoad(build_network(street, pace, rng), rng, crossing=street.crossing)
        _fill(road, name, street.starts, pace, traffic, halt)
        states = _simulate(road, warm_up=rng.uniform(*WARM_UP), duration=duration)
        if states is not None:
            return _layout(name, road, states)
    raise ValueError(
        f"layout '{name}', seed {seed}: {ATTEMPTS} attempts in a row end in a collision;"
        f" lower scenario.traffic.density={traffic.density}"
    )


def _fill(road: SimulatedRoad, name: str, starts: str, pace: float, traffic: Traffic, halt: Halt) -> None:
    """Put the ego (first) and others around it on the lanes, with gaps for their speeds, some of them in a queue. Where
    the ego halts and no ways cross, all who go its way creep."""
    rng = road.np_random
    lanes = road.network.lanes_dict()
    indices, change = list(lanes), not road.crossing
    weight = np.minimum([lane.length for lane in lanes.values()], 250.0)
    index, s = _start(road, name, starts, rng, halt)
    target = pace * uniform(rng, traffic.ego_speed_factor)
    speed = min(target * rng.uniform(0.7, 1.0), lanes[index].speed_limit, halt.approach_speed(WARM_UP[0]))
    s -= speed**2 / (2 * BRAKE) if road.crossing and halt is not NEVER else 0.0
    ego = Driver(road, index, s, speed, target_speed=target, route=_route(road, index, rng), change=change)
    ego.halt = halt
    road.vehicles.append(ego)
    reach = 70.0 + 1.5 * speed
    queue = rng.uniform(0.0, 3.0) * (rng.uniform() < 0.5) if rng.uniform() < traffic.queue_probability else None
    tries = round(traffic.density * rng.uniform(30, 80))
    for i, part in zip(rng.choice(len(indices), tries, p=weight / weight.sum()), rng.uniform(size=tries), strict=True):
        index, lane = indices[i], lanes[indices[i]]
        s = part * lane.length if lane.length < 500 else _along(lane, ego) + (2 * part - 0.6) * reach
        place = lane.position(s, 0.0) - ego.position
        ahead = place @ ego.direction
        if not -45 < ahead < reach or abs(place @ [-ego.direction[1], ego.direction[0]]) > 70:
            continue
        target = pace * uniform(rng, traffic.speed_factor)
        if queue is not None and ahead > 12 + speed**2 / 6:
            target = max(queue, 0.01)
        if halt is not NEVER and not road.crossing and np.cos(lane.heading_at(s) - ego.heading) > 0.5:
            target = max(rng.uniform(*CREEP), 0.01)
        speed = min(target * rng.uniform(0.8, 1.0), lane.speed_limit)
        route = _route(road, index, rng)
        driver = Driver(road, index, s, speed, target_speed=target, route=route, change=change)
        if all(_room(driver, other) for other in road.vehicles):
            road.vehicles.append(driver)


def _start(road: SimulatedRoad, name: str, starts: str, rng: np.random.Generator, halt: Halt) -> tuple:
    """Where the ego begins: not where a lane is about to end for good; who halts at an intersection, before its line."""
    lanes = road.network.lanes_dict()
    leads_on = {start for start in road.network.graph if not start.startswith("o")}  # o: the intersection's far ends
    before_line = halt is not NEVER and name == "intersection"
    starts = "o" if before_line else starts
    choices = [
        index
        for index, lane in lanes.items()
        if index[0].startswith(tuple(starts) or "") and lane.length > 8 and (index[1] in leads_on or lane.length > 600)
    ]
    if not choices:
        raise ValueError(
            f"layout '{name}': the ego can begin nowhere: no lane from a node in '{starts}' is longer than 8 m and leads"
            " on, or is longer than 600 m"
        )
    lengths = np.minimum([lanes[index].length for index in choices], 120.0)
    index = choices[rng.choice(len(choices), p=lengths / lengths.sum())]
    length = lanes[index].length
    low, high = (0.3 * length, 0.5 * length) if length > 600 else (max(0.2 * length, length - 90), length)
    return index, rng.uniform(length - 30, length - 4) if before_line else rng.uniform(low, high)


def _along(lane: AbstractLane, driver: Driver) -> float:
    return lane.local_coordinates(driver.position)[0]


def _route(road: SimulatedRoad, index: tuple, rng: np.random.Generator) -> list | None:
    """A random way through the next crossings; None where highway-env's nearest next lane is the way."""
    if not road.crossing:
        return None
    route, graph = [index], road.network.graph
    while route[-1][1] in graph and len(route) < 6:
        at = route[-1][1]
        route.append((at, str(rng.choice(sorted(graph[at]))), None))
    return route


def _room(driver: Driver, other: Driver) -> bool:
    """Whether a driver may begin where it is: the one behind keeps the gap that its speed asks for."""
    delta = other.position - driver.position
    if delta @ delta > 80.0**2:
        return True
    along, across = delta @ driver.direction, delta[1] * driver.direction[0] - delta[0] * driver.direction[1]
    if abs(across) > 2.6 and abs(driver.heading - other.heading) < 0.3:
        return True
    if abs(across) > 3.4 or abs(along) > 60:
        return True
    behind, front = (driver, other) if along > 0 else (other, driver)
    closing = max(behind.speed - front.speed, 0.0)
    return abs(along) > 8.5 + 0.6 * behind.speed + closing**2 / 4


def _simulate(road: SimulatedRoad, *, warm_up: float, duration: float) -> Array | None:
    """States (T, N, 5) as x, y, heading, speed, slip at every STEP; None if two vehicles touch."""
    count = int(np.ceil(duration / STEP - 1e-9))
    road.clock = -STEP * round(warm_up / STEP)
    for k in range(round(warm_up / STEP)):
        if k % DECISION == 0:
            road.act()
        road.step(STEP)
    states = np.empty((count + 1, len(road.vehicles), 5))
    for k, row in enumerate(states):
        before = [vehicle.slip for vehicle in road.vehicles]
        if k % DECISION == 0:
            road.act()
        for state, vehicle, old in zip(row, road.vehicles, before, strict=True):
            slip = (old + vehicle.next_slip(STEP)) / 2  # a record lies between two steps
            state[:] = *vehicle.position, vehicle.heading, vehicle.speed, slip
        road.step(STEP)
    a, b = np.triu_indices(states.shape[1], 1)
    touch = overlaps(states[:, a, :2], states[:, a, 2], (5.2, 2.1), states[:, b, :2], states[:, b, 2], (5.2, 2.1))
    return None if touch.any() else states


def _track(states: Array, offset: float = 0.0) -> Track:
    """States (T, 5) of highway-env as a track of the point ``offset`` metres ahead of the vehicle's centre, y to the left.
    Velocity: speed (cos(heading + slip), sin(heading + slip)), and the turn about the centre for the offset."""
    x, y, heading, speed, slip = states.T
    yaw: Array = -np.unwrap(heading)
    course = yaw - slip
    ahead = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    turn = -speed * np.sin(slip) / (Driver.LENGTH / 2)
    velocity = speed[:, None] * np.stack([np.cos(course), np.sin(course)], axis=1)
    velocity += (offset * turn)[:, None] * np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    position = np.stack([x, -y], axis=1) + offset * ahead
    flat = np.zeros((len(states), 1))
    return Track(
        STEP * np.arange(len(states), dtype=float), np.hstack([position, flat]), yaw, np.hstack([velocity, flat])
    )


def _layout(name: str, road: SimulatedRoad, states: Array) -> Layout:
    ego = _track(states[:, 0], -REAR_AXLE)
    low = ego.position[:, :2].min(axis=0) - MARGIN
    extent = ego.position[:, :2].max(axis=0) + MARGIN - low
    shift = np.append(-low, 0.0)
    distance = np.linalg.norm(states[:, 1:, :2] - states[:, :1, :2], axis=-1).min(axis=0)
    vehicles = [_track(states[:, 1 + i]).shifted(shift) for i in np.flatnonzero(distance < SIGHT)]
    lanes = [piece for lane in road.network.lanes_list() for piece in _polylines(lane, low, extent)]
    return Layout(name, lanes, ego.shifted(shift), vehicles, (float(extent[0]), float(extent[1])))


def _polylines(lane: AbstractLane, low: Array, extent: Array, spacing: float = 1.5) -> list[Lane]:
    """The parts of a lane that lie inside the world, a little beyond its edge."""
    start, stop = 0.0, lane.length
    if lane.length > 500:  # a long straight: only what is near
        middle = lane.local_coordinates((low + extent / 2) * [1, -1])[0]
        start, stop = np.clip(middle + np.array([-1, 1]) * np.hypot(*extent), 0, lane.length)
    s = np.linspace(start, stop, max(2, int(np.ceil((stop - start) / spacing)) + 1))
    straight = isinstance(lane, StraightLane)  # these take a column of coordinates at once
    centre = lane.position(s[:, None], 0.0) if straight else np.array([lane.position(at, 0.0) for at in s])
    centre = centre * [1, -1] - low
    inside = ((centre > -4) & (centre < extent + 4)).all(axis=1)
    runs = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int))).reshape(-1, 2)
    left, right = (_LINES[kind] for kind in lane.line_types)
    limit = float(lane.speed_limit / 1.2)
    return [
        Lane(centre[a:b], np.full(b - a, float(lane.width_at(0.0))), left, right, limit, bool(lane.forbidden))
        for a, b in runs
        if b - a > 1
    ]
