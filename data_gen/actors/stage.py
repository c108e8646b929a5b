"""Where there is room beside and on the road, and how well the ego's sensors would see it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from data_gen.assets.shapes.mesh import Asset
from data_gen.rig.coverage import FRONT, Sector
from data_gen.road.ego import EGO_SIZE, REAR_AXLE
from data_gen.road.footprints import Occupancy
from data_gen.road.layout import Lane, Layout
from data_gen.road.track import Track
from data_gen.scene.scene import Actor

Array = NDArray[np.float64]

REACH = (5.0, 45.0)
"""Nearest and farthest range in metres of what a scene has to show in the view of the rig."""
_TICK = 0.2


@dataclass(frozen=True)
class Spot:
    """A point on the road's outer edge: row ``i`` of ``lane``, ``side`` +1 left or -1 right of it."""

    lane: Lane
    side: int
    i: int
    edge: Array  # (2,) metres
    outward: Array  # (2,) unit, away from the road
    yaw: float  # of the lane's travel

    @staticmethod
    def on(lane: Lane, side: int, i: int) -> "Spot":
        """The spot at row ``i`` of a lane's side."""
        tangent = lane.centre[min(i + 1, len(lane.centre) - 1)] - lane.centre[max(i - 1, 0)]
        yaw = float(np.arctan2(tangent[1], tangent[0]))
        outward = side * np.array([-np.sin(yaw), np.cos(yaw)])
        return Spot(lane, side, i, lane.centre[i] + lane.width[i] / 2 * outward, outward, yaw)

    def beside(self, out: float, along: float = 0.0) -> Array:
        """The point (2,) ``out`` metres off the road and ``along`` metres on, straight."""
        return self.edge + out * self.outward + along * np.array([np.cos(self.yaw), np.sin(self.yaw)])

    def walk(self, out: float, speed: float, duration: float) -> Track:
        """Motion along the road's edge at a constant speed in m/s, negative against the lane's travel."""
        yaw = self.lane.yaw
        outward = self.side * np.stack([-np.sin(yaw), np.cos(yaw)], axis=1)
        path = self.lane.centre + outward * (self.lane.width / 2 + out)[:, None]
        s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
        times = np.linspace(0.0, duration, max(2, int(np.ceil(duration / 0.2)) + 1))
        at = s[self.i] + speed * times
        beyond = at - np.clip(at, 0.0, s[-1])
        tangent = np.gradient(path, axis=0) / np.linalg.norm(np.gradient(path, axis=0), axis=1, keepdims=True)
        ahead = np.stack([np.interp(at, s, tangent[:, k]) for k in (0, 1)], axis=1)
        position = np.stack([np.interp(at, s, path[:, k]) for k in (0, 1)], axis=1) + beyond[:, None] * ahead
        velocity = np.gradient(position, times, axis=0)
        heading = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
        flat = np.zeros((len(times), 1))
        return Track(times, np.hstack([position, flat]), heading, np.hstack([velocity, flat]))


class Stage:
    """The actors placed so far and the ground that they take during the episode. ``rng`` samples everything; ``view`` is
    what the rig looks at."""

    def __init__(self, layout: Layout, rng: np.random.Generator, view: Sector = FRONT) -> None:
        self.layout, self.rng, self.view = layout, rng, view
        self.actors: list[Actor] = []
        self.duration = float(layout.ego.times[-1])
        self.times = np.linspace(0.0, self.duration, max(2, int(np.ceil(self.duration / _TICK)) + 1))
        position, self._ego_yaw, velocity = layout.ego.at(self.times)
        self._ego, ahead = position[:, :2], np.stack([np.cos(self._ego_yaw), np.sin(self._ego_yaw)], axis=1)
        self.occupancy, self.corridor = Occupancy(len(self.times)), Occupancy(1)
        self.occupancy.add(self._ego + REAR_AXLE * ahead, self._ego_yaw, EGO_SIZE)
        for point, yaw in zip(self._ego + REAR_AXLE * ahead, self._ego_yaw, strict=True):
            self.corridor.add(point, yaw, (EGO_SIZE[0] + 1.0, 2.8))
        for lead in np.arange(2.0, 6.0 + 2.0 * np.linalg.norm(velocity[-1]), 3.0):
            self.corridor.add(self._ego[-1] + (REAR_AXLE + lead) * ahead[-1], self._ego_yaw[-1], (4.0, 2.8))
        lanes = layout.lanes
        self._tree = cKDTree(np.concatenate([lane.centre for lane in lanes]))
        self._half = np.concatenate([lane.width for lane in lanes]) / 2
        self._edges = self._outer_edges()

    def _outer_edges(self) -> list[tuple[Lane, int, int]]:
        """Lane, side and row of the points on the road's outer edges, where the ground beside is no road and in sight."""
        lanes = self.layout.lanes
        yaw = np.concatenate([lane.yaw for lane in lanes])
        left = np.stack([-np.sin(yaw), np.cos(yaw)], axis=1)
        centre, out = np.concatenate([lane.centre for lane in lanes]), self._half[:, None] + 2.0
        rows = [(lane, i) for lane in lanes for i in range(len(lane.centre))]
        found = []
        for side in (1, -1):
            beside = centre + side * out * left
            near = np.flatnonzero(self.visibility(beside) > 0.4)
            good = near[self.clearance(beside[near]) > 1.6] if len(near) else near
            found += [(rows[i][0], side, rows[i][1]) for i in good]
        return found

    def clearance(self, points: ArrayLike) -> Array:
        """Distance (N,) in metres from the nearest lane's edge, negative on a lane."""
        distance, nearest = self._tree.query(np.asarray(points, float))
        return distance - self._half[nearest] - 0.1  # the tree's points lie up to 1.5 m apart

    def visibility(self, points: ArrayLike) -> Array:
        """Fraction (...) of the time that points (..., 2) at rest, or (..., T, 2) at ``times``, are in the view."""
        points = np.asarray(points, float)
        delta = points - self._ego if points.ndim == 3 else points[..., None, :] - self._ego
        bearing = np.arctan2(delta[..., 1], delta[..., 0]) - self._ego_yaw - self.view.center
        distance = np.hypot(delta[..., 0], delta[..., 1])
        inside = np.abs((bearing + np.pi) % (2 * np.pi) - np.pi) < self.view.half
        return (inside & (distance > REACH[0]) & (distance < REACH[1])).mean(axis=-1)

    def path(self, track: Track) -> tuple[Array, Array]:
        """Position (T, 2) and yaw (T,) of a track at ``times``."""
        position, yaw, _ = track.at(self.times)
        return position[:, :2], yaw

    def is_free(self, size: Sequence[float], path: tuple[Array, Array], margin: float = 0.25) -> bool:
        """Whether a body of ``size`` (length, width, ...) would touch nothing during the episode; at rest, nor stand in
        the ego's way."""
        center, yaw = path
        if not np.ptp(center, axis=0).any() and not self.corridor.free(center[0], yaw[0], size[:2]):
            return False
        return self.occupancy.free(center, yaw, size[:2], margin)

    def place(self, asset: Asset, track: Track, attribute: str = "", margin: float = 0.25) -> bool:
        """Add an actor if there is room for it."""
        path = self.path(track)
        if not self.is_free(asset.size, path, margin):
            return False
        self.occupancy.add(*path, asset.size[:2])
        self.actors.append(Actor(len(self.actors), asset, track, attribute))
        return True

    def shown(self, category: str) -> float:
        """Mean number of actors whose category begins so, within the view at a time."""
        chosen = [i for i, actor in enumerate(self.actors) if actor.asset.category.startswith(category)]
        return float(self.visibility(self.occupancy.center[1:][chosen]).sum())  # the ego is the occupancy's first

    def spot(self, out: float) -> "Spot | None":
        """A random place ``out`` metres outside the road's edge and mostly in sight; None where there is none."""
        for i in self.rng.integers(len(self._edges), size=8) if self._edges else ():
            spot = Spot.on(*self._edges[i])
            if self.clearance(spot.beside(out)[None])[0] > out - 0.3:
                return spot
        return None
