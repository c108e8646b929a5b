"""What the sensors of one keyframe measured of each actor: what decides whether and how it is labelled."""

import numpy as np
from numpy.typing import NDArray

from data_gen.scene.scene import Scene
from data_gen.sensors.common.data import SensorData
from data_gen.sensors.common.event import CaptureEvent
from fusion_net.common.boxes import points_in_box
from fusion_net.common.geometry import transform
from fusion_net.common.nuscenes_format import MODALITIES


class Visibility:
    """Counts by actor index of the keyframe at ``t`` seconds; the data of its sensors are added one by one.

    ``points``, by modality: what lies inside the labelled box, whatever caused it, as nuScenes counts. ``echoes``: what the
    actor itself sent back, wherever it lies. Both are of the car in order: before faults take data away, and placed from where
    the sensor truly was.
    """

    def __init__(self, scene: Scene, t: float) -> None:
        actors = len(scene.actors)
        self._scene = scene
        self._position, self._yaw = scene.poses(t)
        self.points = {modality: np.zeros(actors, np.int64) for modality in MODALITIES}
        self.echoes = {modality: np.zeros(actors, np.int64) for modality in MODALITIES}
        self.aimed, self.reached = np.zeros((2, actors), np.int64)

    def add(self, event: CaptureEvent, data: SensorData) -> None:
        """Counts the data of one sensor."""
        aimed, reached = data.ray_counts
        self.aimed += aimed
        self.reached += reached
        bodies, modality = data.point_bodies, event.mount.modality
        if len(bodies):
            self.echoes[modality] += np.bincount(bodies[bodies >= 0], minlength=len(self.aimed))
            global_T_sensor = self._scene.ego.pose(event.true_time) @ event.ego_T_sensor
            self.points[modality] += self._inside(transform(global_T_sensor, data.points_in_sensor_frame))

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

    def level(self, index: int) -> int:
        """nuScenes' level 1..4 (0-40, 40-60, 60-80, 80-100 %): the fraction of camera and LiDAR rays through the object that
        nothing stops before it."""
        fraction = self.reached[index] / max(self.aimed[index], 1)
        return 1 + int(fraction > 0.4) + int(fraction > 0.6) + int(fraction > 0.8)
