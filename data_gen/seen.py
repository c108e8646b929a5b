"""What the sensors of one keyframe got of each actor: what decides whether and how it is labelled."""

import numpy as np

from data_gen.capture import Data
from data_gen.sensors.camera import CameraFrame
from data_gen.sensors.lidar import LidarSweep
from data_gen.sensors.radar import RadarScan


class Seen:
    """Counts by actor index; readings are added one by one."""

    def __init__(self, actors: int) -> None:
        self.lidar_points, self.radar_points, self.aimed, self.reached = np.zeros((4, actors), np.int64)

    def add(self, data: Data) -> None:
        if not isinstance(data, CameraFrame):
            points = self.lidar_points if isinstance(data, LidarSweep) else self.radar_points
            points += np.bincount(data.body[data.body >= 0], minlength=len(points))
        if not isinstance(data, RadarScan):
            self.aimed += data.aimed
            self.reached += data.reached

    def visibility(self, index: int) -> int:
        """nuScenes' level 1..4 (0-40, 40-60, 60-80, 80-100 %): the share of camera and LiDAR rays through the object that
        nothing stops before it."""
        share = self.reached[index] / max(self.aimed[index], 1)
        return 1 + int(share > 0.4) + int(share > 0.6) + int(share > 0.8)
