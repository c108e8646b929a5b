"""Drivers and the road they share: highway-env's IDM and MOBIL traffic, quick enough to be stepped for every scene."""

import math

import numpy as np
from highway_env.road.regulation import RegulatedRoad
from highway_env.road.road import LaneIndex, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.objects import RoadObject

from data_gen.road.ego import EGO_SIZE
from data_gen.road.footprints import overlaps
from data_gen.road.halts import BRAKE, NEVER


class SimulatedRoad(RegulatedRoad):
    """A road on which everybody keeps its lane coordinates, so that neighbours are looked up instead of projected."""

    def __init__(self, network: RoadNetwork, rng: np.random.Generator, *, crossing: bool) -> None:
        super().__init__(network=network, np_random=rng, neighbour_vehicles_connected_lanes=True)
        self.crossing = crossing
        self.clock = 0.0  # seconds of the recording
        self._joined: dict[LaneIndex, dict[LaneIndex, float]] = {}

    def joined(self, index: LaneIndex) -> dict[LaneIndex, float]:
        """The lane itself, its successors and its predecessors, each with the offset of its origin along ``index``."""
        if index not in self._joined:
            start, end, lane_id = index
            graph, found = self.network.graph, {}
            for origin, ends in graph.items():
                if start in ends:
                    lane_id_before = min(lane_id, len(ends[start]) - 1)
                    found[origin, start, lane_id_before] = -ends[start][lane_id_before].length
            for after, lanes in graph.get(end, {}).items():
                found[end, after, min(lane_id, len(lanes) - 1)] = self.network.get_lane(index).length
            self._joined[index] = {**found, index: 0.0}
        return self._joined[index]

    def neighbour_vehicles(self, vehicle, lane_index=None):
        """The nearest vehicle ahead of and behind ``vehicle`` on a lane and the lanes joined to it."""
        index = lane_index or vehicle.lane_index
        joined = self.joined(index)
        own = vehicle.coordinates(index)[0]
        ahead = behind = None
        nearest_ahead, nearest_behind = math.inf, -math.inf
        for other in self.vehicles:
            offset = joined.get(other.lane_index)
            if offset is None or other is vehicle:
                continue
            gap = other.s + offset - own
            if 0 <= gap < nearest_ahead:
                ahead, nearest_ahead = other, gap
            elif nearest_behind < gap < 0:
                behind, nearest_behind = other, gap
        return ahead, behind

    def step(self, dt: float) -> None:
        """Move everybody; whether they touch is for the recorder to see."""
        self.steps += 1
        self.clock += dt
        if self.crossing and self.steps % round(1 / dt / self.REGULATION_FREQUENCY) == 0:
            self.enforce_road_rules()
        for vehicle in self.vehicles:
            vehicle.step(dt)

    @staticmethod
    def is_conflict_possible(v1: "Driver", v2: "Driver", horizon: int = 3, step: float = 0.25) -> bool:
        """Whether two drivers would meet at constant speed within ``horizon`` seconds."""
        if math.dist(v1.position, v2.position) > 60:
            return False
        (positions_1, headings_1), (positions_2, headings_2) = v1.forecast(horizon, step), v2.forecast(horizon, step)
        near = np.square(positions_1 - positions_2).sum(axis=1) < 36
        meet = overlaps(positions_1, headings_1, (7.5, 1.8), positions_2, headings_2, (7.5, 1.8))
        return bool((near & meet).any())


class Driver(IDMVehicle):
    """An IDM driver who knows its place along its lane.

    All parameters are set here: another environment that writes on ``IDMVehicle`` in the same process (the intersection
    does) changes nothing. ``s`` and ``across`` are the lane coordinates in metres, ``slip`` the slip angle in radians.
    """

    ACC_MAX = 6.0
    COMFORT_ACC_MAX = 3.0
    COMFORT_ACC_MIN = -5.0
    DISTANCE_WANTED = 9.0
    TIME_WANTED = 1.2
    DELTA = 4.0
    POLITENESS = 0.0
    LANE_CHANGE_MIN_ACC_GAIN = 0.2
    LANE_CHANGE_MAX_BRAKING_IMPOSED = 2.0
    LANE_CHANGE_DELAY = 1.0
    KP_HEADING = 3.0
    KP_LATERAL = 1.0
    TAU_PURSUIT = 1 / KP_HEADING  # looks ahead just so far that a steady bend leaves no error
    APPROACH = 0.25  # steepest angle towards the lane's centre, radians: highway-env's 45 degrees swerve
    SLIP_RATE = 0.7  # rad/s
    MAX_STEERING_ANGLE = 0.63  # a slip of 0.35 rad, a circle of 7.3 m: a car cannot turn tighter
    LATERAL_MAX = 5.0  # m/s^2 across: highway-env's drivers turn with 11 and more
    LENGTH, WIDTH = EGO_SIZE  # of everybody: bodies are put on the recorded tracks later

    road: SimulatedRoad
    position: np.ndarray

    def __init__(
        self, road: SimulatedRoad, index: LaneIndex, s: float, speed: float, *, target_speed: float, route, change: bool
    ):
        # The base classes would search every lane for the one we know.
        lane = road.network.get_lane(index)
        self.s, self.across, self.slip = s, 0.0, 0.0
        super().__init__(None, lane.position(s, 0.0), lane.heading_at(s), speed, index, target_speed, route, change)
        self.road, self.lane, self.lane_index = road, lane, index
        self.halt = NEVER
        self._forecast: tuple[int, tuple] = (-1, ())

    def act(self, action: dict | str | None = None) -> None:
        """highway-env's decision: MOBIL across, IDM along; while changing lanes, behind the slower leader of both."""
        target = self.road.network.get_lane(self.target_lane_index)
        if self.coordinates(self.target_lane_index)[0] > target.length - target.VEHICLE_LENGTH / 2:
            self.follow_road()
        if self.enable_lane_change:
            self.change_lane_policy()
        leaders = [self.road.neighbour_vehicles(self, i)[0] for i in {self.lane_index, self.target_lane_index}]
        acceleration = min(self.acceleration(self, leader) for leader in leaders)
        if self.halt.brakes(self.road.clock, self.speed):
            acceleration = min(acceleration, -BRAKE)
        self.action["steering"] = self.steering_control(self.target_lane_index)
        self.action["acceleration"] = max(-self.ACC_MAX, min(self.ACC_MAX, acceleration))

    def coordinates(self, index: LaneIndex) -> tuple[float, float]:
        """Coordinates along and across a lane; those of its own are known."""
        if index == self.lane_index:
            return self.s, self.across
        return self.road.network.get_lane(index).local_coordinates(self.position)

    def lane_distance_to(self, other: RoadObject, lane=None) -> float:
        """Signed distance along the lane, across the joints of lanes."""
        offset = self.road.joined(self.lane_index).get(other.lane_index) if other else None
        return super().lane_distance_to(other, lane) if offset is None or lane else other.s + offset - self.s

    def acceleration(self, ego_vehicle, front_vehicle=None, rear_vehicle=None) -> float:
        """The Intelligent Driver Model's acceleration in m/s^2 of any driver behind any other, as highway-env has it."""
        if not isinstance(ego_vehicle, Driver):
            return 0.0
        speed, limit = ego_vehicle.speed, ego_vehicle.lane.speed_limit
        desired = max(min(ego_vehicle.target_speed, limit), 0.01)
        acceleration = self.COMFORT_ACC_MAX * (1 - (speed / desired) ** self.DELTA)
        if front_vehicle:
            turn = front_vehicle.heading - ego_vehicle.heading
            closing = speed - front_vehicle.speed * math.cos(turn)
            comfort = 2 * math.sqrt(-self.COMFORT_ACC_MAX * self.COMFORT_ACC_MIN)
            gap = self.DISTANCE_WANTED + speed * self.TIME_WANTED + speed * closing / comfort
            distance = ego_vehicle.lane_distance_to(front_vehicle)
            acceleration -= self.COMFORT_ACC_MAX * (gap / (distance if abs(distance) > 0.01 else 0.01)) ** 2
        return max(acceleration, -2 * self.ACC_MAX)

    def steering_control(self, target_lane_index: LaneIndex) -> float:
        """highway-env's cascade: lateral offset to lateral speed to heading to heading rate to steering angle."""
        lane = self.road.network.get_lane(target_lane_index)
        along, across = self.coordinates(target_lane_index)
        speed = max(self.speed, 0.01)
        approach = math.asin(max(-1.0, min(1.0, -self.KP_LATERAL * across / speed)))
        heading = lane.heading_at(along + speed * self.TAU_PURSUIT) + max(-self.APPROACH, min(self.APPROACH, approach))
        error = (heading - self.heading + math.pi) % (2 * math.pi) - math.pi
        fastest = self.LATERAL_MAX / max(speed, 3.0)
        rate = max(-fastest, min(fastest, self.KP_HEADING * error))
        slip = math.asin(max(-1.0, min(1.0, self.LENGTH / 2 / speed * rate)))
        limit = self.MAX_STEERING_ANGLE
        return max(-limit, min(limit, math.atan(2 * math.tan(slip))))

    def step(self, dt: float) -> None:
        """The kinematic bicycle of highway-env by the midpoint rule, so that recorded velocities fit the positions to
        second order. Nobody drives backwards."""
        self.timer += dt
        slip = self.next_slip(dt)
        acceleration = max(self.action["acceleration"], -self.speed / dt)
        speed = self.speed + acceleration * dt / 2
        turn = speed * math.sin(slip) / (self.LENGTH / 2) * dt
        course = self.heading + turn / 2 + slip
        self.position = self.position + speed * dt * np.array([math.cos(course), math.sin(course)])
        self.heading += turn
        self.speed += acceleration * dt
        self.slip = slip
        self.on_state_update()

    def next_slip(self, dt: float) -> float:
        """Slip angle of the coming step: what the steering asks for, as quickly as the wheel turns."""
        wanted = math.atan(math.tan(self.action["steering"]) / 2)
        return max(self.slip - self.SLIP_RATE * dt, min(self.slip + self.SLIP_RATE * dt, wanted))

    def on_state_update(self) -> None:
        """Follow the lane; look again, on this road and the next, once outside of it."""
        self.s, self.across = self.lane.local_coordinates(self.position)
        if 0 <= self.s <= self.lane.length and abs(self.across) <= self.lane.width / 2:
            return
        start, end, _ = self.lane_index
        graph = self.road.network.graph
        ways = {(start, end), self.target_lane_index[:2], *((end, after) for after in graph.get(end, {}))}
        if self.route:
            ways = {way for way in ways if way[0] != end or way in [hop[:2] for hop in self.route]} or ways
        indices = [(*way, i) for way in sorted(ways) for i in range(len(graph[way[0]][way[1]]))]
        lanes = [self.road.network.get_lane(index) for index in indices]
        best = int(np.argmin([lane.distance_with_heading(self.position, self.heading) for lane in lanes]))
        self.lane_index, self.lane = indices[best], lanes[best]
        self.s, self.across = self.lane.local_coordinates(self.position)

    def forecast(self, horizon: float, step: float) -> tuple[np.ndarray, np.ndarray]:
        """Positions (K, 2) and headings (K,) along the route at constant speed, worked out once a step."""
        if self._forecast[0] != self.road.steps:
            hops = [hop[:2] for hop in self.route or [] if hop[:2] != self.lane_index[:2]]
            lane, s, states = self.lane, self.s, []
            for _ in np.arange(step, horizon, step):
                s += self.speed * step
                while s > lane.length and hops:
                    s -= lane.length
                    lanes = self.road.network.graph[hops[0][0]][hops[0][1]]
                    lane, hops = lanes[min(self.lane_index[2], len(lanes) - 1)], hops[1:]
                states.append((*lane.position(s, 0.0), lane.heading_at(s)))
            path = np.array(states)
            self._forecast = self.road.steps, (path[:, :2], path[:, 2])
        return self._forecast[1]
