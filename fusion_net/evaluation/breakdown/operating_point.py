"""A detector with a threshold: the detections above the score of their class's best F1, and which label each takes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.geometry import wrap_angle
from fusion_net.evaluation.decoys import best_f1_score
from fusion_net.metrics.detection import UNDEFINED, DetectionMetric
from fusion_net.metrics.sample_boxes import SampleBoxes

BARRIER = "barrier"
"""The class that looks the same from behind."""
MOVING = 0.5
"""m/s from which a label moves."""


@dataclass(frozen=True)
class OperatingPoint:
    """The detections that are left, and the M pairs at the distance at which errors are measured."""

    threshold: NDArray[np.float64]  # (K,) score by class
    labels: SampleBoxes  # (N,)
    found: SampleBoxes  # (P,)
    label: NDArray[np.int64]  # (M,) rows of labels
    taken_by: NDArray[np.int64]  # (M,) rows of found

    @property
    def is_found(self) -> NDArray[np.bool_]:
        """(N,) of the labels."""
        is_found = np.zeros(len(self.labels), np.bool_)
        is_found[self.label] = True
        return is_found

    def f1_by_sample(self, num_samples: int) -> NDArray[np.float64]:
        """(S,) 2 hits / (detections + labels); NaN where there are neither."""
        hits, found, labels = (
            np.bincount(each, minlength=num_samples)
            for each in (self.labels.sample[self.label], self.found.sample, self.labels.sample)
        )
        both = found + labels
        return np.where(both > 0, 2 * hits / np.maximum(both, 1), np.nan)


def operating_point(
    labels: SampleBoxes, found: SampleBoxes, *, metric: DetectionMetric, num_samples: int
) -> OperatingPoint:
    """Of labels and detections that count (:meth:`fusion_net.evaluation.scoring.GroundTruth.counted`)."""
    at_one = replace(metric, distances=[metric.tp_distance])
    threshold = np.array([best_f1_score(match) for match in at_one.match(labels, found, num_samples)])
    found = found[found.boxes.score >= threshold[found.boxes.label]]
    pairs: list[NDArray[np.int64]] = [np.zeros((2, 0), np.int64)]
    order = np.argsort(labels.sample, kind="stable")
    for k, match in enumerate(at_one.match(labels, found, num_samples)):
        mine = order[labels.boxes.label[order] == k]
        takes = match.taken[0] >= 0
        pairs.append(np.stack([mine[match.taken[0][takes]], np.flatnonzero(found.boxes.label == k)[match.row[takes]]]))
    label, taken_by = np.concatenate(pairs, axis=1)
    return OperatingPoint(threshold, labels, found, label, taken_by)


def pose_errors(point: OperatingPoint, classes: Sequence[str]) -> list[dict[str, Any]]:
    """Of each class and of all: ``axis_deg``, how far a box's axis is turned, front and back alike, and ``flips``, the fraction
    that faces backwards; ``speed``, the error of the velocity vector in m/s of what moves and of what stands. Quartiles
    [25, 50, 75 %], None where the class has no front, or no velocity, or no pair."""
    truth, found = point.labels[point.label].boxes, point.found[point.taken_by].boxes
    turn = np.abs(wrap_angle(truth.yaw - found.yaw))
    axis = np.degrees(np.minimum(turn, np.pi - turn))
    error = np.linalg.norm(truth.velocity - found.velocity, axis=1)
    pace = np.linalg.norm(truth.velocity, axis=1)
    of_class = np.array([*classes, ""])[truth.label] if len(truth) else np.zeros(0, np.str_)
    has_heading, has_front, has_speed = (
        np.array([what(name) for name in of_class.tolist()], np.bool_)
        for what in (
            lambda name: "mAOE" not in UNDEFINED.get(name, ()),
            lambda name: "mAOE" not in UNDEFINED.get(name, ()) and name != BARRIER,
            lambda name: "mAVE" not in UNDEFINED.get(name, ()),
        )
    )
    rows = []
    for name in (*classes, "all"):
        mine = np.ones(len(truth), np.bool_) if name == "all" else of_class == name
        front, moves = mine & has_front, pace > MOVING
        rows.append(
            {
                "class": name,
                "pairs": int(mine.sum()),
                "axis_deg": _quartiles(axis[mine & has_heading]),
                "flips": float((turn[front] > np.pi / 2).mean()) if front.any() else None,
                "moving": int((mine & moves & has_speed).sum()),
                "speed_moving": _quartiles(error[mine & moves & has_speed]),
                "speed_standing": _quartiles(error[mine & ~moves & np.isfinite(pace) & has_speed]),
            }
        )
    return rows


def _quartiles(values: NDArray[np.float64]) -> list[float] | None:
    values = values[np.isfinite(values)]
    return np.percentile(values, [25, 50, 75]).tolist() if len(values) else None
