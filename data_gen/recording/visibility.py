"""What the sensors of one keyframe got of each actor: what decides whether and how it is labelled."""

import numpy as np
from numpy.typing import NDArray

from data_gen.recording.capture import Firing
from data_gen.scene.scene import Scene
from data_gen.sensors.camera.camera import CameraFrame
from data_gen.sensors.lidar.lidar import LidarSweep
from data_gen.sensors.radar.radar import RadarScan
from fusion_net.common.boxes import points_in_box
from fusion_net.common.geometry import transform


class Seen:
    """Counts by actor index of the keyframe at ``t`` seconds; readings are added one by one.

    ``lidar_points``, ``radar_points``: what lies inside the labelled box, whatever caused it, as nuScenes counts.
    ``lidar_echoes``, ``radar_echoes``: what the actor itself sent back, wherever it lies. Both are of the car in order: before
    faults take readings away, and placed from where the sensor truly was.
    """

    def __init__(self, scene: Scene, t: float) -> None:
        actors = len(scene.actors)
        self._scene = scene
        self._position, self._yaw = scene.poses(t)
        self.lidar_points, self.radar_points, self.lidar_echoes, self.radar_echoes = np.zeros((4, actors), np.int64)
        self.aimed, self.reached = np.zeros((2, actors), np.int64)

    def add(self, firing: Firing) -> None:
        """Counts a reading."""
        data = firing.data
        if not isinstance(data, RadarScan):
            self.aimed += data.aimed
            self.reached += data.reached
        if isinstance(data, CameraFrame):
            return
        echoes = np.bincount(data.body[data.body >= 0], minlength=len(self.aimed))
        points = transform(self._scene.ego.pose(firing.true_time) @ firing.ego_T_sensor, _points(data))
        if isinstance(data, LidarSweep):
            self.lidar_echoes += echoes
            self.lidar_points += self._inside(points)
        else:
            self.radar_echoes += echoes
            self.radar_points += self._inside(points)

    def _inside(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """How many of the global points (P, 3) lie in the box of each actor (A,)."""
        counts = np.zeros(len(self.aimed), np.int64)
        for index, actor in enumerate(self._scene.actors):
            if not actor.asset.category and not actor.asset.imitates:
                continue
            length, width, height = actor.asset.size
            center = self._position[index] + (0, 0, height / 2)
            near = np.flatnonzero(np.abs(points[:, 0] - center[0]) <= (length + width) / 2)
            counts[index] = points_in_box(
                points[near], center, np.array([width, length, height]), self._yaw[index]
            ).sum()
        return counts

    def visibility(self, index: int) -> int:
        """nuScenes' level 1..4 (0-40, 40-60, 60-80, 80-100 %): the share of camera and LiDAR rays through the object that
        nothing stops before it."""
        share = self.reached[index] / max(self.aimed[index], 1)
        return 1 + int(share > 0.4) + int(share > 0.6) + int(share > 0.8)


def _points(data: LidarSweep | RadarScan) -> NDArray[np.float32]:
    """Points (P, 3) in the sensor's frame as they are written: a radar's lie in its own plane."""
    return data.points if isinstance(data, LidarSweep) else np.stack([data.x, data.y, 0 * data.x], axis=1)
