"""A sensor whose data are older than those of the others, and what the car does about it.

Recorded data cannot be had of any time that one likes. What a sensor would have measured ``seconds`` before is therefore made
from the keyframe: the points of labelled objects are moved back along their velocity, and where the car does not know of the
delay, all points lie where the car was not yet. What was hidden then and is seen now, or the reverse, is neglected. An image
cannot be taken apart like that: of a late camera only the motion of the car itself is shown.
"""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from beartype import beartype
from numpy.typing import NDArray

from fusion_net.common.boxes import Boxes, points_in_box
from fusion_net.common.geometry import invert
from fusion_net.common.settings import Number
from fusion_net.data.propagation import LIDAR_DT, MOVING_SPEED, RADAR_DT, REACH, VELOCITY, propagate_lidar
from fusion_net.data.samples import Sample
from fusion_net.nuscenes.ego_path import ego_path
from fusion_net.nuscenes.nuscenes import NuScenes

Points = NDArray[np.float32]

Sensor = Literal["camera", "lidar", "radar"]
Compensation = Literal["none", "ego", "velocity"]
COMPENSATIONS: tuple[Compensation, ...] = get_args(Compensation)
MARGIN = {"lidar": 0.5, "radar": REACH}
"""Metres around a moving object within which a point is its own: LiDAR points are up to 23 ms old, radar's are blurred."""


@beartype
@dataclass(frozen=True)
class Delay:
    """``sensor`` is ``seconds`` late. ``compensation``: "none", the car does not know; "ego", it knows and moves the data by
    its own motion; "velocity", also by the velocity that the radars measure (of LiDAR points near radar points, and of radar
    points). Of a camera there is "none" only."""

    sensor: Sensor
    seconds: Number
    compensation: Compensation

    def __post_init__(self) -> None:
        if self.sensor == "camera" and self.compensation != "none":
            raise ValueError(
                "delay: of a late camera only compensation none can be shown: an image cannot be moved back"
            )


def delayed(sample: Sample, nusc: NuScenes, delay: Delay) -> Sample:
    """The sample as it would be with ``delay``. Labels stay those of the reference time."""
    then = _ego_then_T_ego(nusc, sample.token, delay.seconds) if delay.compensation == "none" else np.eye(4)
    if delay.sensor == "camera":
        return replace(sample, ego_T_cam=then @ sample.ego_T_cam)
    age = 0.0 if delay.compensation == "none" else delay.seconds
    if delay.sensor == "lidar":
        points = _moved_back(sample.lidar_points, sample.boxes, delay, then)
        points[:, LIDAR_DT] += age
        follows = delay.compensation == "velocity"
        return replace(sample, lidar_points=propagate_lidar(points, sample.radar_points) if follows else points)
    points = _moved_back(sample.radar_points, sample.boxes, delay, then)
    points[:, RADAR_DT] += age
    points[:, VELOCITY] = points[:, VELOCITY] @ then[:2, :2].T.astype(np.float32)
    if delay.compensation == "velocity":
        points[:, :2] += points[:, VELOCITY] * np.float32(delay.seconds)
    return replace(sample, radar_points=points)


def _moved_back(points: Points, boxes: Boxes, delay: Delay, then: NDArray[np.float64]) -> Points:
    """A copy of the points (P, ...) with those of moving objects where they were, all in the frame that ``then`` leads to."""
    moved = points.copy()
    for k in np.flatnonzero(np.linalg.norm(np.nan_to_num(boxes.velocity), axis=1) > MOVING_SPEED):
        own = points_in_box(points, boxes.center[k], boxes.wlh[k], float(boxes.yaw[k]), MARGIN[delay.sensor])
        moved[own, :2] = points[own, :2] - (boxes.velocity[k] * delay.seconds).astype(np.float32)
    moved[:, :3] = moved[:, :3] @ then[:3, :3].T.astype(np.float32) + then[:3, 3].astype(np.float32)
    return moved


def _ego_then_T_ego(nusc: NuScenes, token: str, seconds: float) -> NDArray[np.float64]:
    """From the ego frame at the reference time to that of ``seconds`` before, (4, 4)."""
    path, stamp = ego_path(nusc, nusc.scene(token)["token"]), nusc.reference(token)["timestamp"]
    return invert(path.at(stamp - 1e6 * seconds)) @ path.at(stamp)
