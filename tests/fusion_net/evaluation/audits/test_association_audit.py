"""Two sensors' boxes taken for one object, or not: counted right, and a gate that is too wide or too narrow is noticed."""

import numpy as np
import pytest

from fusion_net.common.boxes import Boxes
from fusion_net.evaluation.audits.association import (
    associate_by_distance,
    audit_association,
    count_pairs,
    identities,
)

THRESHOLDS = {name: np.zeros(2) for name in ("camera", "lidar", "radar")}


def boxes(xy, label=0, score=None):
    n = len(xy)
    center = np.column_stack([np.asarray(xy, float).reshape(-1, 2), np.zeros(n)])
    made = Boxes.labels(center, np.ones((n, 3)), np.zeros(n), np.zeros((n, 2)), np.full(n, label))
    return (
        made
        if score is None
        else Boxes(center, made.wlh, made.yaw, made.velocity, made.label, np.array(score), made.log_variance)
    )


def test_the_lessons_car_at_30_2_and_at_304_18_is_one_car():
    a, b = boxes([(30.0, 2.0)]), boxes([(30.4, 1.8), (45.0, 2.0)])
    assert associate_by_distance(a, b, 1.0).tolist() == [[0, 0]]
    assert len(associate_by_distance(a, b, 0.4)) == 0
    assert len(associate_by_distance(a, boxes([(30.0, 2.0)], label=1), 5.0)) == 0
    assert len(associate_by_distance(a, Boxes.empty(), 5.0)) == 0


def test_a_label_belongs_to_the_best_scored_detection_near_it():
    found = boxes([(10.0, 0.0), (10.5, 0.0), (30.0, 0.0)], score=[0.3, 0.9, 0.5])
    assert identities(found, boxes([(10.0, 0.0), (12.0, 0.0)])).tolist() == [1, 0, -1]
    assert identities(found, Boxes.empty()).tolist() == [-1, -1, -1]


def test_pairs_are_right_wrong_or_missing():
    pairs = np.array([[0, 0], [1, 1], [2, 3], [3, 4]])
    of_a, of_b = np.array([0, 1, -1, -1, 5]), np.array([0, 2, 1, 3, -1, 5])
    # right: label 0; wrong: labels 1 with 2, and a ghost with label 3; two ghosts are nobody's object; split: 1 and 5
    assert count_pairs(pairs, of_a, of_b).tolist() == [1, 2, 2, 3]


@pytest.fixture(scope="module")
def street():
    """Eighty samples of two people 3 m apart, one of whom each sensor misses every other time."""
    rng = np.random.default_rng(0)
    labels, found = [], {"camera": [], "lidar": []}
    for _ in range(80):
        at = rng.uniform((10, -10), (40, 10))
        people = at + np.array([[0.0, 0.0], [0.0, 3.0]])
        labels.append(boxes(people))
        for name, noise in (("camera", 0.5), ("lidar", 0.1)):
            seen = people[rng.random(2) < 0.5]
            found[name].append(boxes(seen + rng.normal(0, noise, seen.shape)))
    return found, labels


def test_a_gate_between_noise_and_distance_is_right(street):
    audit = audit_association(*street, thresholds=THRESHOLDS, gate=1.5)
    assert audit.ok, audit.verdict
    (pair,) = audit.numbers["pairs"]
    place = audit.numbers["gates"].index(1.5)
    assert pair["right"][place] > 0.9 * pair["shared"]
    assert pair["split"][place] == pair["shared"] - pair["right"][place]


def test_a_gate_that_is_too_wide_merges_two_people(street):
    audit = audit_association(*street, thresholds=THRESHOLDS, gate=8.0)
    assert not audit.ok
    assert "wrong merges" in audit.verdict
    wrong = audit.numbers["pairs"][0]["wrong"]
    assert wrong[-1] > 10 * max(1, wrong[0])


def test_a_gate_that_is_too_narrow_splits_one(street):
    audit = audit_association(*street, thresholds=THRESHOLDS, gate=0.25)
    assert not audit.ok
    split = audit.numbers["pairs"][0]["split"]
    assert split == sorted(split, reverse=True)


def test_sensors_without_common_objects_are_not_judged():
    nothing = {name: [Boxes.empty()] * 3 for name in ("camera", "lidar", "radar")}
    assert audit_association(nothing, [Boxes.empty()] * 3, thresholds=THRESHOLDS, gate=2.0).ok is None
