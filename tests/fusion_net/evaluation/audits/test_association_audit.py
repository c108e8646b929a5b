"""Two sensors' boxes taken for one object, or not: counted right, and a gate that is too wide or too narrow is noticed."""

from dataclasses import replace

import numpy as np
import pytest

from fusion_net.common.boxes import Boxes
from fusion_net.evaluation.audits.alignment import Motion
from fusion_net.evaluation.audits.association import (
    audit_association,
    by_distance,
    pair_by_distance,
    sort_pairs,
)
from fusion_net.evaluation.bootstrap import resample_scenes
from fusion_net.models.late.estimates import Estimates
from fusion_net.models.late.sensor_calibration import SensorCalibration

SAMPLES = 80
COPIES = resample_scenes(np.arange(SAMPLES).astype(str), resamples=40, rng=np.random.default_rng(0))


def boxes(xy, label=0):
    n = len(xy)
    center = np.column_stack([np.asarray(xy, float).reshape(-1, 2), np.zeros(n)])
    return Boxes.labels(center, np.ones((n, 3)), np.zeros(n), np.zeros((n, 2)), np.full(n, label))


def estimates(xy, label=0, labels=None):
    return SensorCalibration("lidar", num_classes=2).estimates(boxes(xy, label), labels)


def test_the_lessons_car_at_30_2_and_at_304_18_is_one_car():
    a, b = estimates([(30.0, 2.0)]), estimates([(30.4, 1.8), (45.0, 2.0)])
    assert pair_by_distance(a, b, 1.0).tolist() == [[0, 0]]
    assert len(pair_by_distance(a, b, 0.4)) == 0
    assert len(pair_by_distance(a, estimates([(30.0, 2.0)], label=1), 5.0)) == 0
    assert len(pair_by_distance(a, Estimates.empty(), 5.0)) == 0


def test_pairs_are_right_wrong_or_missing():
    pairs = np.array([[0, 0], [1, 1], [2, 3], [3, 4]])
    of_a, of_b = np.array([0, 1, -1, -1, 5]), np.array([0, 2, 1, 3, -1, 5])
    # right: label 0; wrong: labels 1 with 2, and a ghost with label 3; two ghosts are nobody's object; split: 1 and 5
    found = {kind: rows.tolist() for kind, rows in sort_pairs(pairs, of_a, of_b).items()}
    assert found == {"right": [[0, 0]], "wrong": [[1, 1], [2, 3]], "split": [[1, 2], [4, 5]]}


@pytest.fixture(scope="module")
def street():
    """Eighty samples of two people 3 m apart, one of whom each sensor misses every other time."""
    rng = np.random.default_rng(0)
    found = {"camera": [], "lidar": []}
    for _ in range(SAMPLES):
        at = rng.uniform((10, -10), (40, 10))
        people = at + np.array([[0.0, 0.0], [0.0, 3.0]])
        for name, noise in (("camera", 0.5), ("lidar", 0.1)):
            seen = people[rng.random(2) < 0.5]
            xy = seen + rng.normal(0, noise, seen.shape)
            found[name].append(estimates(xy, labels=boxes(people)))
    return found


def test_without_a_gate_the_best_one_is_judged(street):
    audit = audit_association(street, by_distance(), COPIES)
    assert audit.ok, audit.verdict
    (pair,) = audit.numbers["pairs"]
    assert pair["best"] in (1.0, 1.5, 2.0)
    place = audit.numbers["gates"].index(pair["best"])
    assert pair["right"][place] > 0.9 * pair["shared"]
    assert pair["split"][place] == pair["shared"] - pair["right"][place]
    assert pair["loss_ci95"][place] == [0, 0]


@pytest.mark.parametrize(
    ("gate", "kind", "words"), [(8.0, "wrong", "too wide for C+L"), (0.25, "split", "too narrow for C+L")]
)
def test_a_gate_that_is_far_off_is_wrong_and_the_best_one_is_named(street, gate, kind, words):
    audit = audit_association(street, by_distance(gate), COPIES)
    assert not audit.ok
    (pair,) = audit.numbers["pairs"]
    assert f"(best: {pair['best']:g} m, " in audit.verdict
    assert audit.verdict.endswith(words)
    place = audit.numbers["gates"].index(gate)
    assert pair[kind][place] > 10 * max(1, pair[kind][audit.numbers["gates"].index(pair["best"])])


def test_a_view_that_is_moved_is_wrong_and_the_motion_is_named(street):
    """Each person is taken for the neighbour at the best gate as well: no gate mends a wrong calibration."""
    motion = Motion(0.0, np.array([0.0, 2.0]))

    def moved(found):
        center = np.column_stack([motion(found.boxes.center[:, :2]), found.boxes.center[:, 2]])
        return replace(found, boxes=replace(found.boxes, center=center))

    audit = audit_association(street | {"camera": [moved(each) for each in street["camera"]]}, by_distance(), COPIES)
    assert not audit.ok
    (pair,) = audit.numbers["pairs"]
    assert pair["offset"]["shift"] == pytest.approx([0.0, -2.0], abs=0.25)
    assert "more if camera were turned" in audit.verdict
    assert audit_association(street, by_distance(), COPIES).numbers["pairs"][0]["offset"]["gain"] < 0.02


def test_sensors_without_common_objects_are_not_judged():
    nothing = {name: [Estimates.empty()] * SAMPLES for name in ("camera", "lidar", "radar")}
    assert audit_association(nothing, by_distance(2.0), COPIES).ok is None
