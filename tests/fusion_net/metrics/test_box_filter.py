"""nuScenes' filter: distance, points, and what is parked in a bicycle rack."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.common.geometry import from_rpy, from_yaw, to_quaternion, transform
from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.evaluation.scoring import GroundTruth
from fusion_net.metrics.box_filter import BoxFilter
from fusion_net.metrics.detection import DetectionMetric
from fusion_net.metrics.sample_boxes import SampleBoxes
from fusion_net.nuscenes.annotations import BicycleRacks
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.tiny_tree import ego_pose, write_tree

METRIC = DetectionMetric()
NO_RACKS = BicycleRacks(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 4)))
POSE = from_rpy(0.05, -0.1, 0.7, (10.0, -4.0, 0.5))
WLH = np.array([2.0, 6.0, 1.2])
RACK = BicycleRacks(POSE[None, :3, 3], WLH[None], to_quaternion(POSE)[None])


def boxes(center, names, *, sample=None, num_pts=5):
    n = len(center)
    label = np.array([CLASSES.index(name) for name in names], np.int64)
    made = Boxes.labels(np.asarray(center, float), np.ones((n, 3)), np.zeros(n), np.zeros((n, 2)), label)
    sample = np.zeros(n, np.int64) if sample is None else np.asarray(sample)
    return SampleBoxes(made, sample, np.full(n, ""), np.full(n, num_pts))


def test_what_is_near_and_was_seen_is_kept():
    keeps = BoxFilter(np.array([[100.0, 50.0]]), [NO_RACKS])
    found = boxes([(149.9, 50, 0), (150, 50, 0), (129.9, 50, 0), (130, 50, 0)], ["car", "car", "barrier", "barrier"])
    np.testing.assert_array_equal(keeps(found, METRIC), [True, False, True, False])
    assert not keeps(boxes([(100, 50, 0)], ["car"], num_pts=0), METRIC).any()
    assert keeps(boxes([(100, 50, 0)], ["car"], num_pts=-1), METRIC).all()  # a prediction


@given(st.tuples(*[st.floats(-1.4, 1.4)] * 3).filter(lambda place: all(abs(abs(x) - 1) > 1e-6 for x in place)))
def test_a_point_is_in_a_rack_that_leans_where_it_is_within_half_of_each_side(place):
    """``place`` along the length, across and up, in halves of the rack's sides."""
    point = transform(POSE, [np.array(place) * WLH[[1, 0, 2]] / 2])
    assert RACK.contain(point)[0] == (np.abs(place).max() < 1)


def test_a_racks_surface_belongs_to_it():
    straight = BicycleRacks(np.zeros((1, 3)), np.array([[2.0, 4.0, 1.0]]), np.array([[1.0, 0, 0, 0]]))
    np.testing.assert_array_equal(straight.contain(np.array([(2.0, 1.0, 0.5), (2.0, 1.0, 0.51)])), [True, False])


def test_cycles_in_a_rack_are_left_out_and_nothing_else():
    inside, above, beside = transform(POSE, [(2.8, 0.9, 0.5), (0, 0, 0.7), (0, 1.1, 0)])
    keeps = BoxFilter(np.zeros((2, 2)), [RACK, NO_RACKS])
    names = ["bicycle", "motorcycle", "pedestrian", "bicycle", "motorcycle", "bicycle"]
    found = boxes([inside, inside, inside, above, beside, inside], names, sample=[0, 0, 0, 0, 0, 1])
    np.testing.assert_array_equal(keeps(found, METRIC), [False, False, True, True, True, True])
    few = DetectionMetric(classes=["pedestrian", "bicycle"])
    kept = keeps(found.relabel(CLASSES, few.classes), few)  # labels index the metric's classes, not nuScenes' ten
    np.testing.assert_array_equal(kept, [False, True, True, True])


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    """Two cycles stand in a rack across the road, one beside it; so does a person."""
    rack = ego_pose(1.0) @ from_yaw(1.2, (15.0, 0.0, 0.5))
    places = {"in": (2.0, 0.0, 0.0), "end": (-2.4, 0.4, 0.3), "beside": (0.0, 2.4, 0.0), "person": (0.0, 0.0, 0.4)}
    at = {name: transform(rack, [place])[0] for name, place in places.items()}
    yaw = np.arctan2(rack[1, 0], rack[0, 0])
    bodies = [
        {"category": "static_object.bicycle_rack", "center": lambda t: rack[:3, 3], "size": [1.5, 5.5, 1.5],
         "yaw": lambda t: yaw, "points": 0},
        {"category": "vehicle.bicycle", "center": lambda t: at["in"]},
        {"category": "vehicle.motorcycle", "center": lambda t: at["end"]},
        {"category": "vehicle.bicycle", "center": lambda t: at["beside"]},
        {"category": "human.pedestrian.adult", "center": lambda t: at["person"]},
    ]  # fmt: skip
    tree = NuScenes(write_tree(tmp_path_factory.mktemp("tree"), scenes=1, keyframes=1, boxes=bodies))
    grid = BEVGrid(0.0, 32.0, -12.8, 16.0, 0.8)
    return GroundTruth([(tree, tree.split("all")[0])], classes=["bicycle", "pedestrian", "motorcycle"], grid=grid)


def test_labels_of_a_tree_lose_their_parked_cycles_in_both_scores(truth):
    named = [
        [truth.classes[k] for k in truth.labels.boxes.label],
        [CLASSES[k] for k in truth.official_labels.boxes.label],
    ]
    assert named == [["bicycle", "pedestrian"]] * 2


def test_a_detection_in_a_rack_is_no_false_alarm(truth):
    person = truth.labels.boxes.label == truth.classes.index("pedestrian")
    found = boxes(truth.labels.boxes.center[person].repeat(2, axis=0), ["bicycle", "motorcycle"], num_pts=-1)
    found = found.relabel(CLASSES, truth.classes)
    for matches in (truth.matches(found), truth.official_matches(found)):
        assert [len(match.score) for match in matches] == [0] * len(matches)
