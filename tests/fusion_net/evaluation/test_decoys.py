"""The decoy audit on hand-made trees: a detector that sees through decoys, one that cannot, and boxes that must not count."""

import json
from dataclasses import replace

import numpy as np
import pytest

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.common.geometry import invert, transform
from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.evaluation.decoys import Bodies, auc, audit_decoys, best_f1_score, best_scores, read_bodies
from fusion_net.evaluation.drop_table import SUBSETS
from fusion_net.evaluation.scoring import GroundTruth
from fusion_net.metrics.matching import ClassMatches
from fusion_net.metrics.sample_boxes import SampleBoxes
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.reports import decoys as report
from tests.fixtures.tiny_tree import ego_pose, write_tree

GRID = BEVGrid(0.0, 48.0, -20.0, 24.0, 0.8)
SIZES = {"truck": [2.5, 8.0, 3.0], "person": [0.6, 0.7, 1.7]}


def ahead(x, y):
    """A place that stands in the world, at (x, y) in the ego frame of the first keyframe."""
    center = transform(ego_pose(1.0), np.array([[x, y, 1.0]]))[0]
    return lambda t: center


def body(category, x, y, imitates="", speed=0.0, points=5):
    size = SIZES["truck" if "vehicle" in category + imitates else "person"]
    return {"category": category, "center": ahead(x, y), "size": size, "points": points,
            "imitates": imitates, "velocity": [speed, 0.0]}  # fmt: skip


BODIES = [
    body("vehicle.truck", 16.0, 4.0),
    body("movable_object.debris", 22.0, 4.0, imitates="vehicle.truck"),
    body("vehicle.truck", 30.0, -4.0, speed=3.0),  # moves
    body("movable_object.debris", 34.0, 8.0, imitates="vehicle.truck", points=0),  # nothing met it
    body("movable_object.debris", -20.0, 0.0, imitates="vehicle.truck"),  # off the grid
    body("human.pedestrian.adult", 14.0, -3.0),
    body("movable_object.debris", 14.0, -6.0, imitates="human.pedestrian.child"),
    body("vehicle.car", 20.0, -9.0),  # nothing imitates it
]


def tree_of(root, bodies):
    write_tree(root, scenes=2, keyframes=1, boxes=bodies)
    path = root / "v1.0-tiny" / "sample_annotation.json"
    rows = json.loads(path.read_text())
    for row in rows:
        made = bodies[int(row["instance_token"].rsplit("-", 1)[1])]
        row |= {"imitates": made["imitates"], "velocity": made["velocity"]}
    path.write_text(json.dumps(rows))
    return NuScenes(root)


@pytest.fixture
def samples(tmp_path):
    tree = tree_of(tmp_path / "tree", BODIES)
    return [(tree, token) for token in tree.split("all")]


def truth_of(samples):
    return GroundTruth(samples, classes=list(CLASSES), grid=GRID)


def detections(places, label, score):
    n = len(places)
    center = np.column_stack([np.array(places, float), np.full(n, 1.0)])
    return Boxes(center, np.tile(SIZES["truck"], (n, 1)), np.zeros(n), np.zeros((n, 2)), np.full(n, label),
                 np.array(score, float), np.zeros((n, 2)))  # fmt: skip


def found_everywhere(truth, boxes):
    return truth.table([boxes] * len(truth.tokens))


def test_only_bodies_that_stand_where_all_can_be_seen_are_compared(samples):
    truth = truth_of(samples)
    bodies = read_bodies(truth, samples)
    truck, car = CLASSES.index("truck"), CLASSES.index("car")
    assert len(bodies[bodies.label == truck].label) == 5 * 2
    assert bodies[bodies.label == truck].is_compared.sum() == 2 * 2
    assert bodies[bodies.label == car].is_compared.all()
    on_grid = transform(invert(truth.global_T_ego[0]), np.append(bodies[bodies.label == truck].center[0], 1.0)[None])[0]
    np.testing.assert_allclose(on_grid[:2], [16.0, 4.0], atol=0.2)


def test_a_detector_that_sees_through_decoys_gets_1_and_one_that_cannot_gets_a_half(samples):
    truth, truck = truth_of(samples), CLASSES.index("truck")
    seeing = found_everywhere(truth, detections([(16.5, 4.5), (30.0, -4.0), (22.0, 4.0)], truck, [0.9, 0.8, 0.1]))
    fooled = found_everywhere(truth, detections([(16.5, 4.5), (30.0, -4.0), (22.0, 4.0)], truck, [0.9, 0.8, 0.9]))
    audit = audit_decoys(truth, samples, [seeing] + [fooled] * (len(SUBSETS) - 1))
    assert [kind["imitates"] for kind in audit] == ["truck", "pedestrian"]
    trucks = audit[0]
    assert (trucks["real"], trucks["decoys"]) == (2, 2)
    assert trucks["rows"][0] == {
        "sensors": ["camera", "lidar", "radar"],
        "AUC": 1.0,
        "real_found": 1.0,
        "decoys_found": 0.0,
    }
    assert [row["AUC"] for row in trucks["rows"][1:]] == [0.5] * 6
    assert trucks["rows"][1]["decoys_found"] == 1.0
    people = audit[1]["rows"][0]
    assert (people["AUC"], people["real_found"], people["decoys_found"]) == (0.5, 0.0, 0.0)


def test_a_detection_counts_for_the_nearest_body_of_its_sample_alone():
    bodies = Bodies(
        np.zeros(3, np.int64), np.array([False, True, True]), np.ones(3, bool),
        np.array([[10.0, 0.0], [13.0, 0.0], [10.0, 0.0]]), np.array([0, 0, 1]),
    )  # fmt: skip
    boxes = detections([(11.0, 0.0), (10.0, 0.5), (13.0, 5.0)], 0, [0.9, 0.4, 1.0])
    found = SampleBoxes(boxes, np.zeros(3, np.int64), np.full(3, ""), np.full(3, -1))
    np.testing.assert_array_equal(best_scores(bodies, found, 4.0), [0.9, 0.0, 0.0])
    np.testing.assert_array_equal(best_scores(bodies, found[:0], 4.0), [0.0, 0.0, 0.0])


def test_auc_is_the_share_of_pairs_in_order():
    assert auc(np.array([0.9, 0.2]), np.array([0.1, 0.5, 0.2])) == pytest.approx((3 + 1.5) / 6)
    assert auc(np.zeros(4), np.zeros(2)) == 0.5
    assert auc(np.zeros(0), np.zeros(2)) is None


def test_the_threshold_is_where_f1_is_best():
    is_pair = np.array([True, True, False, False, True])
    match = ClassMatches(
        np.array([0.9, 0.7, 0.5, 0.3, 0.1]),
        np.zeros(5, np.int64),
        np.arange(5),
        np.array([[0, 1, -1, -1, 2]]),
        is_pair,
        np.zeros((5, 5)),
        np.array([3]),
    )
    assert best_f1_score(match) == 0.7
    assert best_f1_score(replace(match, is_pair=np.zeros(5, bool))) == np.inf


def test_data_without_decoys_is_skipped(tmp_path):
    write_tree(tmp_path / "real", boxes=[body("vehicle.truck", 16.0, 4.0)])  # as real trees: no key "imitates"
    tree = NuScenes(tmp_path / "real")
    samples = [(tree, token) for token in tree.split("all")]
    truth = truth_of(samples)
    assert audit_decoys(truth, samples, [found_everywhere(truth, Boxes.empty())] * len(SUBSETS)) == []
    (tmp_path / "decoys.md").write_text("of an earlier evaluation")
    report.write(tmp_path, [])
    assert not (tmp_path / "decoys.md").exists()


def test_the_report_shows_every_figure(samples, tmp_path):
    truth = truth_of(samples)
    table = found_everywhere(truth, detections([(16.5, 4.5)], CLASSES.index("truck"), [0.9]))
    audit = audit_decoys(truth, samples, [table] * len(SUBSETS))
    report.write(tmp_path, audit)
    text, lines = report.as_text(audit), (tmp_path / "decoys.csv").read_text().splitlines()
    assert "1.000/0.000" in text
    assert len(lines) == 1 + 2 * len(SUBSETS)
    assert lines[1] == "truck,C+L+R,1.0,1.0,0.0,2,2"
    assert (tmp_path / "decoys.md").read_text().count("|---") >= 4
    json.dumps(audit, allow_nan=False)
