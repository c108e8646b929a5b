"""A detector at its best F1: which detections are left, and how wrong their headings and velocities are."""

import numpy as np
import pytest

from fusion_net.common.boxes import Boxes
from fusion_net.evaluation.breakdown.curves import precision_at_recall
from fusion_net.evaluation.breakdown.operating_point import operating_point, pose_errors
from fusion_net.metrics.detection import RECALL, DetectionMetric
from fusion_net.metrics.sample_boxes import SampleBoxes

CLASSES = ["car", "barrier", "traffic_cone"]
METRIC = DetectionMetric(classes=CLASSES)


def table(rows):
    """Boxes (x, class, yaw in degrees, vx, score, sample)."""
    x, label, yaw, speed, score, sample = (np.array(column, float) for column in zip(*rows, strict=True))
    zero = np.zeros(len(x))
    boxes = Boxes(
        np.column_stack([x, zero, zero]), np.ones((len(x), 3)), np.radians(yaw), np.column_stack([speed, zero]),
        label.astype(int), score, np.zeros((len(x), 2)),
    )  # fmt: skip
    return SampleBoxes(boxes, sample.astype(int), np.full(len(x), "", np.str_), np.full(len(x), -1))


LABELS = table(
    [(10, 0, 0, 0, 1, 0), (20, 0, 90, 10, 1, 0), (30, 0, 0, 0, 1, 1), (10, 1, 0, 0, 1, 1), (5, 2, 0, 0, 1, 1)]
)
FOUND = table(
    [(10, 0, 170, 0, 0.9, 0), (20, 0, 95, 7, 0.8, 0), (30, 0, -20, 1, 0.7, 1), (40, 0, 0, 0, 0.1, 1), (10, 1, 175, 0, 0.9, 1),
     (5, 2, 120, 0, 0.9, 1)]
)  # fmt: skip


def point(found=FOUND):
    return operating_point(LABELS, found, metric=METRIC, num_samples=3)


def test_what_scores_below_the_best_f1_is_left_out():
    left = point()
    assert left.found.boxes.score.min() == 0.7
    assert left.is_found.all()
    assert left.labels.boxes.label[left.label].tolist() == left.found.boxes.label[left.taken_by].tolist()
    np.testing.assert_allclose(left.f1_by_sample(3), [1, 1, np.nan])


def test_a_class_without_a_hit_has_no_detections_left():
    far = table([(90, 0, 0, 0, 0.9, 0)])
    left = point(far)
    assert len(left.found) == 0
    assert not left.is_found.any()
    np.testing.assert_allclose(left.f1_by_sample(3)[:2], [0, 0])
    assert pose_errors(left, CLASSES)[0]["axis_deg"] is None


def test_the_axis_and_the_front_are_told_apart():
    car, barrier, cone, everything = pose_errors(point(), CLASSES)
    assert car["axis_deg"][1] == pytest.approx(10)  # of 10 (turned round), 5 and 20 degrees
    assert car["flips"] == pytest.approx(1 / 3)
    assert barrier["axis_deg"][1] == pytest.approx(5)
    assert barrier["flips"] is None  # it looks the same from behind
    assert cone["axis_deg"] is None  # it has no heading
    assert everything["pairs"] == 5
    assert everything["flips"] == pytest.approx(1 / 3)


def test_velocities_of_what_moves_and_of_what_stands_are_told_apart():
    car, barrier, *_ = pose_errors(point(), CLASSES)
    assert car["moving"] == 1
    assert car["speed_moving"][1] == pytest.approx(3)
    assert car["speed_standing"][1] == pytest.approx(0.5)  # of 0 and 1
    assert barrier["speed_standing"] is None


def test_a_curve_ends_where_recall_does():
    match = METRIC.match(LABELS, FOUND[FOUND.boxes.score > 0.75], 3)[0]  # two of three cars
    curve = precision_at_recall(match, 2)
    np.testing.assert_allclose(curve[RECALL <= 2 / 3], 1.0)
    assert np.isnan(curve[RECALL > 2 / 3]).all()
    assert np.isnan(precision_at_recall(METRIC.match(LABELS, FOUND[:0], 3)[0], 2)).all()
