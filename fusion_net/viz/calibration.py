"""How LiDAR points are projected onto a camera's image: moved with what they lie on to the camera's time, and, to show what an
error of calibration does, turned about the sensor.

A turn of 0.5 degrees about the camera shifts a point by f tan(0.5 deg): 8.7 pixels at f = 1000, whatever its distance.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusion_net.common.boxes import Boxes, points_in_box
from fusion_net.common.geometry import from_yaw, invert, project, transform

Array = NDArray[np.float64]

MOVING_SPEED = 0.3
"""Speed in m/s from which an object's points are moved with it."""
MARGIN = 0.2
"""Metres around a labelled box within which points belong to it; its foot, where the road's points lie, gets none."""


def at_time(boxes: Boxes, time: float) -> Boxes:
    """Boxes as they lie ``time`` seconds after the reference; those of unknown velocity stay."""
    center = boxes.center.copy()
    center[:, :2] += time * np.nan_to_num(boxes.velocity)
    return Boxes(
        center, *(getattr(boxes, name) for name in ("wlh", "yaw", "velocity", "label", "score", "log_variance"))
    )


def follow(points: ArrayLike, age: ArrayLike, boxes: Boxes, time: float) -> tuple[Array, NDArray[np.bool_]]:
    """Points (P, 3) that were measured ``age`` (P,) seconds before the reference, as they lie ``time`` seconds after it: those
    in a moving box go along with it. Also which points (P,) those are."""
    points, age = np.array(points, float), np.asarray(age, float)
    moved = np.zeros(len(points), bool)
    speed = np.linalg.norm(np.nan_to_num(boxes.velocity), axis=1)
    for k in np.flatnonzero(speed > MOVING_SPEED):
        shift = np.zeros_like(points)
        shift[:, :2] = age[:, None] * boxes.velocity[k]
        inside = points_in_box(points + shift, boxes.center[k], boxes.wlh[k], float(boxes.yaw[k]), MARGIN)
        inside &= points[:, 2] > boxes.center[k, 2] - boxes.wlh[k, 2] / 2 + MARGIN
        inside &= ~moved
        points[inside, :2] += (age[inside, None] + time) * boxes.velocity[k]
        moved |= inside
    return points, moved


def turned(points: ArrayLike, center: ArrayLike, error_deg: float) -> Array:
    """Points (P, 3) as they would lie if the sensor at ``center`` (3,) were mounted ``error_deg`` off about the vertical."""
    about = from_yaw(0.0, center)
    return transform(about @ from_yaw(np.radians(error_deg)) @ invert(about), points)


def agreement(
    points: ArrayLike, depth: NDArray[np.float32], cam_K: Array, ego_T_cam: Array, *, tolerance: float = 0.02
) -> float:
    """Fraction of the ego points (P, 3) in the image whose depth differs from the exact ``depth`` (H, W) of their pixel by less
    than ``tolerance`` of it, or by less than 0.15 m; NaN where no point is in the image. 0 in ``depth`` is no depth."""
    pixels, z = project(cam_K, transform(invert(ego_T_cam), points))
    height, width = depth.shape
    inside = (z > 0.5) & (pixels >= 0).all(axis=1) & (pixels[:, 0] < width) & (pixels[:, 1] < height)
    column, row = np.floor(pixels[inside]).astype(int).T
    exact = depth[row, column]
    known = exact > 0
    if not known.any():
        return float("nan")
    near = np.abs(z[inside] - exact) < np.maximum(tolerance * exact, 0.15)
    return float(near[known].mean())
