"""Mistakes of each kind, made by hand: each is told from the others, and putting it right gives what it cost."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion_net.common.boxes import Boxes
from fusion_net.evaluation.breakdown.confusion import confusion
from fusion_net.evaluation.breakdown.error_budget import BUDGET, error_budget
from fusion_net.evaluation.breakdown.mistakes import BACKGROUND, CLASS, DECOY, DUPLICATE, HIT, PLACE, judge
from fusion_net.evaluation.decoys import Bodies
from fusion_net.metrics.detection import DetectionMetric
from fusion_net.metrics.sample_boxes import SampleBoxes

CAR, PERSON = 0, 1
METRIC = DetectionMetric(classes=["car", "pedestrian"])
AT_TWO = DetectionMetric(classes=["car", "pedestrian"], distances=[2.0])


def table(rows):
    """Boxes (x, y, class[, score[, sample]])."""
    rows = [(*row, *(1.0, 0)[len(row) - 3 :]) for row in rows]
    x, y, label, score, sample = (np.array(column) for column in zip(*rows, strict=True)) if rows else [np.zeros(0)] * 5
    n, none = len(rows), np.zeros((len(rows), 2))
    center, wlh = np.column_stack([x, y, np.zeros(n)]).reshape(-1, 3), np.ones((n, 3))
    boxes = Boxes(center, wlh, np.zeros(n), none, label.astype(int), score.astype(float), none)
    return SampleBoxes(boxes, sample.astype(int), np.full(n, "", np.str_), np.full(n, -1))


def bodies(*places):
    """Decoys of persons at (x, y) of the first sample."""
    n = len(places)
    center = np.array(places, float).reshape(-1, 2)
    return Bodies(np.full(n, PERSON), np.ones(n, bool), np.ones(n, bool), center, np.zeros(n, int))


NONE = bodies()
LABELS = table([(10, 0, CAR), (20, 0, CAR), (30, 0, PERSON), (40, 0, PERSON)])


def kinds(found, decoys=NONE, metric=AT_TWO):
    return [each.kind.tolist() for each in judge(LABELS, table(found), decoys, metric=metric, num_samples=1)]


def budget(found, decoys=NONE, labels=LABELS):
    made = error_budget(labels, table(found), decoys, metric=METRIC, copies=np.ones((3, 1), int), scenes=2)
    gains = {entry["kind"]: entry["gain"] for entry in made["budget"]}
    assert all(entry["gain_ci95"] == pytest.approx([entry["gain"]] * 2) for entry in made["budget"])
    assert list(gains) == list(BUDGET)
    return made["mAP"], gains


RIGHT = [(10, 0, CAR, 0.9), (20, 0, CAR, 0.8), (30, 0, PERSON, 0.9), (40, 0, PERSON, 0.8)]


def test_nothing_is_wrong_with_what_is_right():
    mAP, gains = budget(RIGHT)
    assert mAP == pytest.approx(1.0)
    assert gains == pytest.approx(dict.fromkeys(BUDGET, 0.0))


@pytest.mark.parametrize(
    ("extra", "kind"),
    [
        ((10.5, 0, CAR, 0.5), DUPLICATE),
        ((30.5, 0, CAR, 0.95), CLASS),
        ((60, 0, PERSON, 0.95), DECOY),
        ((70, 0, PERSON, 0.95), BACKGROUND),
        ((23, 0, CAR, 0.95), BACKGROUND),  # the car near it has been found: it means none
    ],
)
def test_a_mistake_beside_right_detections_has_its_kind(extra, kind):
    (found,) = kinds([*RIGHT, extra], bodies((60.5, 0)))
    assert found == [HIT] * 4 + [kind]


def test_a_detection_three_metres_from_a_label_that_nothing_takes_means_it():
    (found,) = kinds([RIGHT[0], (23, 0, CAR, 0.8), *RIGHT[2:]])
    assert found == [HIT, PLACE, HIT, HIT]


def test_what_is_a_mistake_at_half_a_metre_is_a_hit_at_two():
    found = kinds([(11, 0, CAR, 0.9)], metric=METRIC)
    assert [each[0] for each in found] == [PLACE, PLACE, HIT, HIT]  # 1 m is not within 1 m


def test_a_wrong_class_put_right_is_a_hit_of_the_right_one():
    mAP, gains = budget([*RIGHT[:3], (40, 0, CAR, 0.95)])
    assert gains["class"] == pytest.approx(1 - mAP)
    assert gains["background"] == gains["place"] == 0
    assert gains["miss"] == 0  # it is not missed, it is mistaken


def test_of_two_that_mean_one_label_the_better_is_kept():
    _, gains = budget([*RIGHT[:3], (40, 0, CAR, 0.95), (40.2, 0, CAR, 0.94)])
    mAP, _ = budget([*RIGHT[:3], (40, 0, CAR, 0.95), (40.2, 0, CAR, 0.94)])
    assert mAP + gains["class"] == pytest.approx(1.0)


def test_a_wrong_place_put_right_is_a_hit():
    mAP, gains = budget([*RIGHT[:3], (43, 0, PERSON, 0.8)])  # a hit within 4 m already
    assert gains["place"] == pytest.approx(1 - mAP)
    assert gains["place"] > 0.2


@pytest.mark.parametrize(
    ("extra", "kind"),
    [
        ((10.3, 0, CAR, 0.85), "duplicate"),
        ((60, 0, PERSON, 0.95), "decoy"),
        ((70, 0, PERSON, 0.95), "background"),
    ],
)
def test_without_false_alarms_of_the_only_kind_all_is_right(extra, kind):
    mAP, gains = budget([*RIGHT, extra], bodies((60.2, 0)))
    assert mAP < 0.95
    assert mAP + gains.pop(kind) == pytest.approx(1.0)
    assert set(gains.values()) == {0.0}


def test_a_label_that_nothing_means_is_missed():
    mAP, gains = budget(RIGHT[:3])
    assert gains["miss"] == pytest.approx(1 - mAP)


def test_of_no_detections_nothing_can_be_mended():
    mAP, gains = budget([])
    assert mAP == 0
    assert set(gains.values()) == {0.0}


def test_samples_do_not_see_each_other():
    labels = table([(10, 0, CAR, 1.0, 0), (50, 0, CAR, 1.0, 1)])
    (judged,) = judge(
        labels, table([(50, 0, CAR, 0.9, 0), (50, 0, CAR, 0.8, 1)]), bodies(), metric=AT_TWO, num_samples=2
    )
    assert judged.kind.tolist() == [BACKGROUND, HIT]
    assert judged.meets.tolist() == [-1, 1]


box = st.tuples(
    st.integers(0, 12), st.integers(0, 4), st.integers(0, 1), st.sampled_from([0.1, 0.3, 0.5, 0.9]), st.integers(0, 1)
)


@settings(max_examples=40)
@given(st.lists(box, max_size=8), st.lists(box, max_size=12))
def test_no_kind_costs_less_than_nothing_and_mAP_is_the_metrics_own(labels, found):
    labels, found = table(labels), table(found)
    made = error_budget(labels, found, bodies((3, 1)), metric=METRIC, copies=np.ones((2, 2), int), scenes=2)
    assert made["mAP"] == pytest.approx(METRIC(labels, found, 2).mAP)
    for entry in made["budget"]:
        if entry["kind"] != "miss" or all((labels.boxes.label == k).any() for k in (CAR, PERSON)):
            assert entry["gain"] > -1e-9
    for each in judge(labels, found, bodies((3, 1)), metric=METRIC, num_samples=2):
        hits = each.meets[each.kind == HIT]
        assert len(set(hits.tolist())) == len(hits)
        assert (labels.boxes.label[hits] == found.boxes.label[each.kind == HIT]).all()


def test_confusion_counts_every_label_once_and_every_false_alarm():
    labels = table([(10, 0, CAR), (20, 0, CAR), (30, 0, PERSON), (40, 0, PERSON), (50, 0, CAR)])
    found = [*RIGHT[:3], (40, 0, CAR, 0.95), (10.5, 0, CAR, 0.9), (60, 0, PERSON, 0.95), (70, 5, CAR, 0.95)]
    made = confusion(labels, table(found), bodies((60.5, 0), (80, 0)), metric=METRIC, num_samples=1)
    assert made["labels"] == [
        {"count": 3, "found": [2, 0], "missed": 1},
        {"count": 2, "found": [1, 1], "missed": 0},
    ]
    assert made["decoys"] == {"pedestrian": {"count": 2, "found": [0, 1], "missed": 1}}
    assert made["background"] == [2, 0]
