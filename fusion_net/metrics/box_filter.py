"""Which boxes nuScenes evaluates: those near the car, seen by LiDAR or radar, and not parked in a bicycle rack.

Gives what ``filter_eval_boxes`` of nuscenes-devkit 1.2.0 does.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion_net.metrics.detection import DetectionMetric
from fusion_net.metrics.sample_boxes import SampleBoxes
from fusion_net.nuscenes.annotations import BicycleRacks

PARKED = ("bicycle", "motorcycle")
"""Classes that are not evaluated inside a bicycle rack: nuScenes does not label every cycle in one."""


@dataclass(frozen=True)
class BoxFilter:
    """The filter of S samples, for labels and predictions alike."""

    ego_xy: NDArray[np.float64]  # (S, 2) the car, GLOBAL frame
    racks: Sequence[BicycleRacks]  # of each sample

    def __call__(self, boxes: SampleBoxes, metric: DetectionMetric) -> NDArray[np.bool_]:
        """(N,) the boxes that count by the classes and ranges of ``metric``."""
        distance = np.sqrt(((boxes.boxes.center[:, :2] - self.ego_xy[boxes.sample]) ** 2).sum(axis=1))
        is_counted = (distance < metric.label_range[boxes.boxes.label]) & (boxes.num_pts != 0)
        return is_counted & ~self._is_parked(boxes, metric.classes)

    def _is_parked(self, boxes: SampleBoxes, classes: Sequence[str]) -> NDArray[np.bool_]:
        cycles = np.flatnonzero(np.isin(boxes.boxes.label, [k for k, name in enumerate(classes) if name in PARKED]))
        is_parked = np.zeros(len(boxes), np.bool_)
        for sample, racks in enumerate(self.racks):
            if len(racks):
                rows = cycles[boxes.sample[cycles] == sample]
                is_parked[rows] = racks.contain(boxes.boxes.center[rows])
        return is_parked
