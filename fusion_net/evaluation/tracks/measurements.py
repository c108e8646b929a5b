"""Boxes of any detector as measurements of a tracker: with covariances, in the GLOBAL frame."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

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

    def __call__(
        self, found: Boxes | Estimates, global_T_ego: NDArray[np.float64], sensors: Sequence[str]
    ) -> Estimates:
        """Measurements in the GLOBAL frame of what was found with these sensors, in the ego frame. Estimates come with
        covariances of their own, which are calibrated and kept."""
        found = found if isinstance(found, Estimates) else self._estimates(found, sensors)
        found = found[found.boxes.score >= self.min_score]
        yaw = yaw_of(global_T_ego)
        return replace(
            found,
            boxes=to_global(found.boxes, global_T_ego),
            cov=turned(found.cov, yaw),
            velocity_cov=turned(found.velocity_cov, yaw),
        )

    def _estimates(self, boxes: Boxes, sensors: Sequence[str]) -> Estimates:
        """Boxes with the covariances that the settings give them."""
        variance = np.maximum(np.exp(np.clip(boxes.log_variance, *LOG_VARIANCE)), self.least_sigma**2)
        sigma = min(self.velocity_sigma[name] for name in sensors)
        return Estimates(
            boxes=boxes,
            cov=variance[:, :, None] * np.eye(2),
            velocity_cov=np.tile(sigma**2 * np.eye(2), (len(boxes), 1, 1)),
            probability=np.where(np.isin(MODALITIES, sensors), boxes.score[:, None], np.nan),
            truth=np.full(len(boxes), -1),
        )


def turned(cov: NDArray[np.float64], yaw: float) -> NDArray[np.float64]:
    """Covariances (N, 2, 2) on the ground in axes that are turned by ``-yaw`` radians: from the ego frame to the global one at
    the car's heading."""
    c, s = np.cos(yaw), np.sin(yaw)
    R = np.array([[c, -s], [s, c]])
    return R @ cov @ R.T
