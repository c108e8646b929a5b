"""How well one keyframe is detected: the metric, and what a person would count."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from fusion_net.common.boxes import Boxes
from fusion_net.evaluation.scoring import GroundTruth

NEAR = 2.0
"""Metres between centres within which a box has found an object: nuScenes' distance for its errors."""


@dataclass(frozen=True)
class Score:
    """``mAP`` over the classes that the keyframe has labels of (NaN without labels). The rest is of the boxes that are shown:
    objects, how many of them have a box within NEAR and how many of these are of the right class, boxes that found nothing,
    and the mean errors of place (m) and velocity (m/s), NaN where nothing is found."""

    mAP: float
    objects: int
    found: int
    right_class: int
    false: int
    place: float
    velocity: float


def score(mAP: float, labels: Boxes, found: Boxes, threshold: float) -> Score:
    """The score of a keyframe whose mAP is known (:func:`mean_over_classes`); ``labels`` and ``found`` are in its ego frame."""
    shown = found[found.score >= threshold]
    label, box = pairs(labels, shown)
    apart = np.linalg.norm(labels.center[label, :2] - shown.center[box, :2], axis=1)
    speed = np.linalg.norm(labels.velocity[label] - shown.velocity[box], axis=1)
    return Score(
        mAP=mAP,
        objects=len(labels),
        found=len(label),
        right_class=int((labels.label[label] == shown.label[box]).sum()),
        false=len(shown) - len(box),
        place=_mean(apart),
        velocity=_mean(speed),
    )


def mean_over_classes(truth: GroundTruth, found: Sequence[Boxes]) -> float:
    """mAP of predictions, one entry a keyframe of ``truth``, over the classes that have labels there; NaN if none has."""
    metrics = truth.metric.summarise(truth.matches(truth.table(found)))
    has_labels = metrics.num_gt > 0
    return float(metrics.class_ap[has_labels].mean()) if has_labels.any() else float("nan")


def pairs(labels: Boxes, found: Boxes) -> tuple[np.ndarray, np.ndarray]:
    """Rows of labels and of boxes that belong together: the assignment of least distance among those within NEAR, whatever
    their class."""
    distance = np.linalg.norm(labels.center[:, None, :2] - found.center[None, :, :2], axis=-1)
    label, box = linear_sum_assignment(np.where(distance < NEAR, distance, 1e3))
    near = distance[label, box] < NEAR
    return label[near], box[near]


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")
