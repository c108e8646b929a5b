"""Boxes of any detector as measurements of a tracker: with covariances, in the GLOBAL frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from beartype import beartype
from numpy.typing import NDArray

from fusion_net.common.boxes import Boxes
from fusion_net.common.geometry import yaw_of
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.metrics.sample_boxes import to_global
from fusion_net.models.late.covariance import LOG_VARIANCE
from fusion_net.models.late.estimates import Estimates


@beartype
@dataclass(frozen=True, kw_only=True)
class Measurements:
    """What a box says of the place and velocity of its object.

    The place's covariance is that of the box's ``log_variance``, with at least ``least_sigma`` metres in each direction.
    The velocity has by sensor the standard deviation ``velocity_sigma`` in m/s, of several sensors that of the best. Boxes
    with less than ``min_score`` are no measurements.
    """

    min_score: float
    least_sigma: float
    velocity_sigma: dict[str, float]

    def __post_init__(self) -> None:
        if not 0 <= self.min_score < 1:
            raise ValueError(f"measurements: min_score={self.min_score} must be from 0 to below 1")
        if not self.least_sigma > 0:
            raise ValueError(f"measurements: least_sigma={self.least_sigma} m must be above 0")
        for name in MODALITIES:
            if not self.velocity_sigma.get(name, 0.0) > 0:
                raise ValueError(f"measurements: velocity_sigma of {name} must be a number of m/s above 0")

    def __call__(self, boxes: Boxes, global_T_ego: NDArray[np.float64], sensors: Sequence[str]) -> Estimates:
        """Measurements in the GLOBAL frame of boxes in the ego frame that were found with these sensors."""
        boxes = boxes[boxes.score >= self.min_score]
        variance = np.maximum(np.exp(np.clip(boxes.log_variance, *LOG_VARIANCE)), self.least_sigma**2)
        sigma = min(self.velocity_sigma[name] for name in sensors)
        probability = np.where(np.isin(MODALITIES, sensors), boxes.score[:, None], np.nan)
        return Estimates(
            boxes=to_global(boxes, global_T_ego),
            cov=turned(variance[:, :, None] * np.eye(2), yaw_of(global_T_ego)),
            velocity_cov=np.tile(sigma**2 * np.eye(2), (len(boxes), 1, 1)),
            probability=probability,
        )


def turned(cov: NDArray[np.float64], yaw: float) -> NDArray[np.float64]:
    """Covariances (N, 2, 2) on the ground in axes that are turned by ``-yaw`` radians: from the ego frame to the global one at
    the car's heading."""
    c, s = np.cos(yaw), np.sin(yaw)
    R = np.array([[c, -s], [s, c]])
    return R @ cov @ R.T
