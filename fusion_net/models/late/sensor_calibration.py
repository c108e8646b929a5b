"""What was measured of one detector on scenes that it was not trained on, as buffers that checkpoints hold."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from fusion_net.common.boxes import Boxes
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.models.late.association import match_to_labels
from fusion_net.models.late.calibration import Scales
from fusion_net.models.late.covariance import ray_covariance, ray_variance
from fusion_net.models.late.estimates import Estimates
from fusion_net.models.late.scores import Platt

MATCH_DISTANCE = 4.0
"""Metres between the centres of a box and its label, the widest at which nuScenes' metric matches them."""


class SensorCalibration(nn.Module):
    """Turns the boxes of the detector of ``sensor`` into estimates. Before it is fitted the head's variances are believed, a
    velocity is off by 1 m/s each way, and scores are probabilities."""

    factor: Tensor  # (K, 2) on the variances of the place along and across the ray
    velocity_variance: Tensor  # (K, 2) of the velocity along and across the ray, (m/s)^2
    matches: Tensor  # (K,) boxes that matched a label when this was fitted
    platt: Tensor  # (2,) slope and shift on the log-odds of a score

    def __init__(self, sensor: str, *, num_classes: int) -> None:
        super().__init__()
        self.sensor = sensor
        self.register_buffer("factor", torch.ones(num_classes, 2))
        self.register_buffer("velocity_variance", torch.ones(num_classes, 2))
        self.register_buffer("matches", torch.zeros(num_classes, dtype=torch.int64))
        self.register_buffer("platt", torch.tensor([1.0, 0.0]))

    def set(self, *, place: Scales, velocity: Scales, platt: Platt) -> None:
        """Takes what was fitted; ``velocity`` to errors over a variance of 1."""
        self.factor.copy_(torch.from_numpy(place.factor))
        self.velocity_variance.copy_(torch.from_numpy(velocity.factor))
        self.matches.copy_(torch.from_numpy(place.matches))
        self.platt.copy_(torch.tensor([platt.slope, platt.shift]))

    def probability(self, score: NDArray[np.float64]) -> NDArray[np.float64]:
        """How likely boxes with these scores (N,) are of an object."""
        slope, shift = self.platt.tolist()
        return Platt(slope, shift)(score)

    def estimates(self, boxes: Boxes, labels: Boxes | None = None) -> Estimates:
        """Boxes of one sample in the ego frame with covariances. ``labels``: what they are looked up in (``truth``)."""
        place = boxes.center[:, :2]
        variance = ray_variance(boxes.log_variance, place) * self.factor.cpu().double().numpy()[boxes.label]
        probability = np.full((len(boxes), len(MODALITIES)), np.nan)
        probability[:, MODALITIES.index(self.sensor)] = self.probability(boxes.score)
        none = np.full(len(boxes), -1, np.int64)
        return Estimates(
            boxes=boxes,
            cov=ray_covariance(variance, place),
            velocity_cov=ray_covariance(self.velocity_variance.cpu().double().numpy()[boxes.label], place),
            probability=probability,
            truth=none if labels is None else match_to_labels(boxes, labels, distance=MATCH_DISTANCE),
        )
