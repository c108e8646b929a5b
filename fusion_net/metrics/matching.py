"""Greedy matching of predictions to labels by distance of centres, as nuScenes defines it.

https://www.nuscenes.org/object-detection: per class and distance threshold, predictions in order of falling score each take
the nearest label of their sample that none took before, if it is nearer than the threshold. Matching never crosses
samples, so its outcome holds for any resampling of them.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion_net.common.boxes import Boxes
from fusion_net.common.geometry import wrap_angle
from fusion_net.metrics.sample_boxes import SampleBoxes

TP_ERRORS = ("mATE", "mASE", "mAOE", "mAVE", "mAAE")
"""Means over classes of the errors of translation (m), scale (1 - IoU), orientation (rad), velocity (m/s), attribute."""


@dataclass(frozen=True)
class ClassMatches:
    """The P predictions of one class in order of falling score, and which of them hit a label."""

    score: NDArray[np.float64]  # (P,)
    sample: NDArray[np.int64]  # (P,)
    row: NDArray[np.int64]  # (P,) of the table of this class's predictions that was matched
    taken: NDArray[np.int64]  # (T, P) by distance threshold: the label taken, counted sample by sample; -1 for none
    is_pair: NDArray[np.bool_]  # (P,) hits at the threshold at which errors are measured
    errors: NDArray[np.float64]  # (5, P) TP_ERRORS of those pairs; NaN elsewhere and where nothing is to compare
    num_gt: NDArray[np.int64]  # (S,) labels of each sample

    @property
    def hit(self) -> NDArray[np.bool_]:
        """(T, P) which predictions take a label, by distance threshold."""
        return self.taken >= 0


def match_class(
    truth: SampleBoxes,
    found: SampleBoxes,
    *,
    num_samples: int,
    distances: NDArray,
    tp_distance: float,
    yaw_period: float,
) -> ClassMatches:
    """Matches the boxes of one class over all samples. ``distances`` (T,) metres; ``tp_distance`` is where errors are taken."""
    truth = truth[np.argsort(truth.sample, kind="stable")]
    order = np.argsort(found.boxes.score, kind="stable")[::-1]  # equal scores: the later box first
    found = found[order]
    num_gt = np.bincount(truth.sample, minlength=num_samples)
    start = np.concatenate([[0], np.cumsum(num_gt)])
    thresholds = np.append(distances, tp_distance).astype(float)
    taken = _greedy(
        np.ascontiguousarray(found.boxes.center[:, :2]), found.sample, np.ascontiguousarray(truth.boxes.center[:, :2]),
        start, thresholds,
    )  # fmt: skip
    pair = taken[-1]
    errors = np.full((len(TP_ERRORS), len(found)), np.nan)
    errors[:, pair >= 0] = _pair_errors(truth[pair[pair >= 0]], found[pair >= 0], yaw_period)
    return ClassMatches(found.boxes.score, found.sample, order, taken[:-1], pair >= 0, errors, num_gt)


@njit(cache=True)
def _greedy(found_xy, found_sample, truth_xy, start, thresholds):
    """(T, P) row of the label that each prediction takes, -1 for none. Labels of sample s are rows start[s]:start[s + 1]."""
    taken_by = np.full((len(thresholds), len(found_xy)), -1, np.int64)
    for t in range(len(thresholds)):
        is_taken = np.zeros(len(truth_xy), np.bool_)
        for p in range(len(found_xy)):
            nearest, row = np.inf, -1
            for g in range(start[found_sample[p]], start[found_sample[p] + 1]):
                if is_taken[g]:
                    continue
                dx, dy = found_xy[p, 0] - truth_xy[g, 0], found_xy[p, 1] - truth_xy[g, 1]
                distance = np.sqrt(dx * dx + dy * dy)
                if distance < nearest:
                    nearest, row = distance, g
            if nearest < thresholds[t]:
                is_taken[row] = True
                taken_by[t, p] = row
    return taken_by


def _pair_errors(truth: SampleBoxes, found: SampleBoxes, yaw_period: float) -> NDArray[np.float64]:
    """(5, M) errors of M pairs in the order of TP_ERRORS."""
    a, b = truth.boxes, found.boxes
    wrong_attribute = (truth.attribute != found.attribute).astype(float)
    return np.stack(
        [
            np.linalg.norm(a.center[:, :2] - b.center[:, :2], axis=1),
            1 - _aligned_iou(a, b),
            np.abs(wrap_angle(a.yaw - b.yaw, yaw_period)),
            np.linalg.norm(a.velocity - b.velocity, axis=1),
            np.where(truth.attribute == "", np.nan, wrong_attribute),
        ]
    )


def _aligned_iou(a: Boxes, b: Boxes) -> NDArray[np.float64]:
    """3-D IoU of pairs if they had the same centre and heading."""
    common = np.minimum(a.wlh, b.wlh).prod(axis=1)
    return common / (a.wlh.prod(axis=1) + b.wlh.prod(axis=1) - common)
