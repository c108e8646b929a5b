"""What the sensors of one keyframe measured of each actor: what decides whether and how it is labelled."""

import numpy as np

from data_gen.jobs.jit import jit
from data_gen.scene.scene import Scene
from data_gen.sensors.common.data import SensorData
from data_gen.sensors.common.event import CaptureEvent
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
        labelled = [bool(actor.asset.category or actor.asset.imitates) for actor in scene.actors]
        size = np.array([actor.asset.size for actor in scene.actors], float).reshape(-1, 3)
        self._size = np.where(np.array(labelled, bool)[:, None], size, -1.0)  # what has no label has no box
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
            points = transform(global_T_sensor, data.points_in_sensor_frame)
            _count_inside(
                points, self._position, np.cos(self._yaw), np.sin(self._yaw), self._size, self.points[modality]
            )

    def level(self, index: int) -> int:
        """nuScenes' level 1..4 (0-40, 40-60, 60-80, 80-100 %): the fraction of camera and LiDAR rays through the object that
        nothing stops before it."""
        fraction = self.reached[index] / max(self.aimed[index], 1)
        return 1 + int(fraction > 0.4) + int(fraction > 0.6) + int(fraction > 0.8)


@jit
def _count_inside(points, position, cos, sin, size, counts):
    """Add to ``counts`` (A,) how many of the global points (P, 3) lie in the box of each actor: ``position`` (A + 1, 3) of its
    foot, the turn of its yaw, ``size`` (A, 3) as length, width, height."""
    for a in range(len(counts)):
        length, width, height = size[a] / 2
        for p in range(len(points)):
            x, y = points[p, 0] - position[a, 0], points[p, 1] - position[a, 1]
            if (
                abs(cos[a] * x + sin[a] * y) <= length
                and abs(cos[a] * y - sin[a] * x) <= width
                and abs(points[p, 2] - (position[a, 2] + height)) <= height
            ):
                counts[a] += 1
