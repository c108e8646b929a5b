"""Points of the past end where their objects are now: known motion, checked to the centimetre."""

import numpy as np
import pytest

from fusion_net.common.geometry import invert, transform
from fusion_net.data.propagation import propagate_lidar, propagate_radar
from fusion_net.data.samples import SampleReader
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.tiny_tree import LANDMARKS, MOUNTS, MOVER_START, MOVER_VELOCITY, ego_pose, write_tree

TOKEN, T_KEY = "scene-0000-1", 1.5
CAR = np.array([(0.0, 0.0, 0.2), (0.12, 0.1, 0.5), (-0.1, 0.05, 0.0)])
"""Points on the mover, about the one that the radars see."""


def lidar(*rows):
    """LiDAR points from (x, y, dt)."""
    return np.array([(x, y, 1.0, 0.5, dt) for x, y, dt in rows], np.float32)


def radar(*rows):
    """Radar points from (x, y, vx, vy, dt)."""
    return np.array([(x, y, 0.5, 10.0, vx, vy, dt) for x, y, vx, vy, dt in rows], np.float32)


def test_at_20_metres_a_second_a_car_is_one_metre_further_after_50_ms():
    moved = propagate_lidar(lidar((30.0, 4.0, 0.05)), radar((31.0, 4.0, 20.0, 0.0, 0.0)))
    np.testing.assert_allclose(moved[0, :2], (31.0, 4.0), atol=1e-5)
    moved = propagate_radar(radar((30.0, 4.0, 20.0, 0.0, 0.05)))
    np.testing.assert_allclose(moved[0, :2], (31.0, 4.0), atol=1e-5)


def test_each_lidar_point_moves_by_its_own_age():
    """A rolling sweep: the car's far end was hit 50 ms before its near one."""
    ages = np.array([0.0, 0.02, 0.05, 0.09])
    points = lidar(*[(40.0 + 15.0 * -age, 2.0 - 6.0 * -age, age) for age in ages])
    moved = propagate_lidar(points, radar((40.0, 2.0, 15.0, -6.0, 0.0)))
    np.testing.assert_allclose(moved[:, :2], np.broadcast_to((40.0, 2.0), (4, 2)), atol=1e-5)
    np.testing.assert_array_equal(moved[:, 2:], points[:, 2:])


def test_points_are_matched_where_the_car_was_at_their_time():
    """A tree where the car is now was not there half a second ago, and stays."""
    points = lidar((20.0, 0.0, 0.5), (30.0, 0.0, 0.5))
    moved = propagate_lidar(points, radar((30.0, 0.0, 20.0, 0.0, 0.0)))
    np.testing.assert_allclose(moved[:, 0], (30.0, 30.0), atol=1e-5)


def test_a_post_that_the_car_passed_stays_where_the_radar_sees_it_at_rest():
    post, passing = (20.0, 1.5, 0.0, 0.0, 0.0), (30.0, 0.0, 20.0, 0.0, 0.0)
    moved = propagate_lidar(lidar((20.1, 1.4, 0.5), (20.0, 0.0, 0.5)), radar(post, passing))
    np.testing.assert_allclose(moved[:, 0], (20.1, 30.0), atol=1e-5)


@pytest.mark.parametrize(
    ("point", "detection"),
    [
        ((30.0, 0.0, 0.1), (30.0, 3.1, 20.0, 0.0, 0.0)),  # beside it, out of reach
        ((30.0, 0.0, 0.1), (30.0, 0.0, 0.6, 0.7, 0.0)),  # slower than 1 m/s
    ],
)
def test_what_is_far_from_the_radar_point_or_nearly_at_rest_stays(point, detection):
    points = lidar(point)
    np.testing.assert_array_equal(propagate_lidar(points, radar(detection)), points)


def test_empty_clouds_stay_empty():
    nothing = np.zeros((0, 5), np.float32), np.zeros((0, 7), np.float32)
    assert propagate_lidar(nothing[0], radar((1, 1, 9, 0, 0))).shape == (0, 5)
    assert len(propagate_lidar(lidar((1, 1, 0)), nothing[1])) == 1
    assert propagate_radar(nothing[1]).shape == (0, 7)


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """The tiny tree with a car about the mover: its LiDAR sees three points of it, each at its own time."""
    tree = NuScenes(write_tree(tmp_path_factory.mktemp("tree"), scenes=1, sweeps=4))
    for record in tree.keyframe_and_sweeps(TOKEN, "LIDAR_TOP", 4):
        t = (record["timestamp"] - tree.reference(TOKEN)["timestamp"]) * 1e-6 + T_KEY
        offsets = np.array([-0.04, -0.02, 0.0])
        at = MOVER_START + MOVER_VELOCITY * (t + offsets)[:, None] + CAR
        points = transform(invert(ego_pose(t) @ MOUNTS["LIDAR_TOP"]), np.vstack([LANDMARKS, at]))
        path = tree.path(record)
        path.write_bytes(np.column_stack([points, np.zeros((len(points), 2))]).astype("<f4").tobytes())
        times = np.concatenate([np.zeros(len(LANDMARKS)), offsets]).astype("<f4")
        np.save(path.with_name(path.name.removesuffix(".pcd.bin") + ".time.npy"), times)
    return tree


def scans(tree, **options):
    points = SampleReader(lidar_sweeps=4, radar_sweeps=2, **options).read(tree, TOKEN).lidar_points
    return points.reshape(5, len(LANDMARKS) + len(CAR), 5)


def test_a_car_of_five_sweeps_is_one_car_and_what_stands_still_stays(tree):
    """Without it the oldest sweep lies 0.2 s x 20 m/s = 4 m behind."""
    now = transform(invert(ego_pose(T_KEY)), MOVER_START + MOVER_VELOCITY * T_KEY + CAR)
    moved, left = scans(tree, propagate_lidar=True), scans(tree)
    np.testing.assert_allclose(moved[:, -3:, :2], np.broadcast_to(now[:, :2], (5, 3, 2)), atol=0.03)
    np.testing.assert_allclose(np.linalg.norm(left[4, -1, :2] - now[-1, :2]), 4.0, atol=0.05)
    np.testing.assert_array_equal(moved[:, :-3], left[:, :-3])


def test_no_lidar_point_moves_without_a_radar(tree):
    np.testing.assert_array_equal(
        scans(tree, propagate_lidar=True, modalities=["lidar"]), scans(tree, modalities=["lidar"])
    )


def test_the_switches_for_radar_and_lidar_are_independent(tree):
    still = scans(tree, propagate_lidar=True, propagate_radar=False)
    np.testing.assert_array_equal(still, scans(tree, propagate_lidar=True))


def test_ego_motion_and_propagation_together_keep_the_landmarks_in_place(tree):
    expected = transform(invert(ego_pose(T_KEY)), LANDMARKS)
    points = scans(tree, propagate_lidar=True)[:, : len(LANDMARKS), :3]
    np.testing.assert_allclose(points, np.broadcast_to(expected, points.shape), atol=2e-4)
