"""How fast a box moves, from the radar detections on it: a body moves along its axis, and a radar measures a part of that."""

import warnings
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.boxes import Boxes

MARGIN = 0.5
"""Metres around a box within which a detection is taken for one of it: the radar's blur, and the box's own error."""
STEEPEST = 0.5
"""Least cosine between axis and ray. Of a body that crosses the ray a radar measures hardly more than noise."""
STANDING = 0.3
"""m/s below which the direction of a measured velocity is noise, and the ray is that from the car."""
BACKWARDS = 0.5
"""m/s along its axis, tail first, above which a body has been taken for turned round."""


def with_doppler_speed(boxes: Boxes, detections: NDArray[np.float32]) -> Boxes:
    """The boxes with the velocity that radar ``detections`` (R, RADAR_CHANNELS) of the same ego frame say, where there are any,
    and turned round where they would move backwards: hardly anything on a road does.

    A detection with the radial velocity m along the unit ray u sees of a speed s along the axis h the part s (h u), so that
    s = m / (h u) (without side slip; Kellner et al. 2013, "Instantaneous lateral velocity estimation of a vehicle using Doppler
    radar", solve the same for several rays and a turning body). The median over a box's detections is robust against those
    of the ground below it and of neighbours. For the velocity it does not matter which end of the box is in front.
    """
    if not len(boxes) or not len(detections):
        return boxes
    xy, measured = detections[:, :2].astype(float), detections[:, 4:6].astype(float)
    size = np.hypot(*measured.T)
    along, length = (
        np.where((size > STANDING)[:, None], measured, xy).T,
        np.where(size > STANDING, size, np.hypot(*xy.T)),
    )
    ray = (along / np.maximum(length, 1e-9)).T  # (R, 2)
    axis = np.stack([np.cos(boxes.yaw), np.sin(boxes.yaw)], axis=1)  # (N, 2)
    away = xy - boxes.center[:, None, :2]  # (N, R, 2)
    lengthwise = np.abs((away * axis[:, None]).sum(axis=-1))
    across = np.abs(away[..., 1] * axis[:, None, 0] - away[..., 0] * axis[:, None, 1])
    is_on = (lengthwise <= boxes.wlh[:, None, 1] / 2 + MARGIN) & (across <= boxes.wlh[:, None, 0] / 2 + MARGIN)
    cosine = axis @ ray.T  # (N, R)
    is_on &= np.abs(cosine) >= STEEPEST
    speeds = np.where(is_on, (measured * ray).sum(axis=1) / np.where(is_on, cosine, 1.0), np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # boxes without detections
        speed = np.nanmedian(speeds, axis=1)
    velocity = np.where(np.isfinite(speed)[:, None], speed[:, None] * axis, boxes.velocity)
    opposite = np.arctan2(-axis[:, 1], -axis[:, 0])
    return replace(boxes, velocity=velocity, yaw=np.where(speed < -BACKWARDS, opposite, boxes.yaw))
