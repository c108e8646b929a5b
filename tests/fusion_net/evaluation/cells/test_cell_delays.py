"""A late sensor: where its points lie, and what each compensation puts right, for a car and an object of known motion."""

from dataclasses import replace

import numpy as np
import pytest

from fusion_net.common.boxes import Boxes
from fusion_net.common.geometry import invert, transform
from fusion_net.data.samples import Sample, SampleReader
from fusion_net.evaluation.cells.delays import Delay, delayed
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.tiny_tree import ego_pose, write_tree

LATE = 0.1
REFERENCE = 1.0 + 0.5
"""Seconds of the second keyframe."""
VELOCITY = np.array([9.0, -4.0])
"""Of the object over ground, in the axes of the car at the reference time."""
CENTER = np.array([20.0, 3.0, 0.8])


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    return NuScenes(write_tree(tmp_path_factory.mktemp("tree") / "tree", scenes=2))


@pytest.fixture(scope="module")
def sample(tree) -> Sample:
    """A keyframe with one moving car, a LiDAR and a radar point on it and one of each on a post."""
    box = Boxes.labels(CENTER[None], np.array([[1.9, 4.6, 1.6]]), np.zeros(1), VELOCITY[None], np.zeros(1, np.int64))
    lidar = np.array([[*CENTER, 0.5, 0.01], [30.0, -12.0, 1.0, 0.5, 0.01]], np.float32)
    radar = np.array([[*CENTER, 10.0, *VELOCITY, 0.02], [30.0, -12.0, 0.5, 3.0, 0.0, 0.0, 0.02]], np.float32)
    return replace(SampleReader().read(tree, "scene-0000-1"), boxes=box, lidar_points=lidar, radar_points=radar)


def test_a_car_that_knows_of_the_delay_moves_what_stands_to_the_right_place(tree, sample):
    for sensor in ("lidar", "radar"):
        points = getattr(delayed(sample, tree, Delay(sensor, LATE, "ego")), f"{sensor}_points")
        sound = getattr(sample, f"{sensor}_points")
        np.testing.assert_allclose(points[1, :3], sound[1, :3], atol=1e-5)
        np.testing.assert_allclose(points[0, :2], sound[0, :2] - LATE * VELOCITY, atol=1e-5)
        np.testing.assert_allclose(points[:, -1], sound[:, -1] + LATE, atol=1e-6)


def test_the_radars_velocity_brings_back_what_moves(tree, sample):
    for sensor in ("lidar", "radar"):
        points = getattr(delayed(sample, tree, Delay(sensor, LATE, "velocity")), f"{sensor}_points")
        np.testing.assert_allclose(points[:, :2], getattr(sample, f"{sensor}_points")[:, :2], atol=0.15)


def test_a_car_that_does_not_know_puts_everything_where_the_sensor_saw_it_then(tree, sample):
    then_T_now = invert(ego_pose(REFERENCE - LATE)) @ ego_pose(REFERENCE)
    for sensor in ("lidar", "radar"):
        points = getattr(delayed(sample, tree, Delay(sensor, LATE, "none")), f"{sensor}_points")
        sound = getattr(sample, f"{sensor}_points")
        np.testing.assert_allclose(points[1, :3], transform(then_T_now, sound[1:2, :3])[0], atol=0.02)
        earlier = sound[0, :3] - [*(LATE * VELOCITY), 0]
        np.testing.assert_allclose(points[0, :3], transform(then_T_now, earlier[None])[0], atol=0.02)
        np.testing.assert_array_equal(points[:, -1], sound[:, -1])


def test_a_late_camera_is_displaced_by_the_cars_own_motion(tree, sample):
    found = delayed(sample, tree, Delay("camera", LATE, "none"))
    then_T_now = invert(ego_pose(REFERENCE - LATE)) @ ego_pose(REFERENCE)
    np.testing.assert_allclose(found.ego_T_cam, then_T_now @ sample.ego_T_cam, atol=0.02)
    assert found.lidar_points is sample.lidar_points
    with pytest.raises(ValueError, match="an image cannot be moved back"):
        Delay("camera", LATE, "ego")


def test_no_delay_changes_nothing(tree, sample):
    for compensation in ("none", "ego", "velocity"):
        for sensor in ("lidar", "radar"):
            found = getattr(delayed(sample, tree, Delay(sensor, 0.0, compensation)), f"{sensor}_points")
            np.testing.assert_allclose(found, getattr(sample, f"{sensor}_points"), atol=0.15)
