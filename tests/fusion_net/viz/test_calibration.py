import numpy as np
import pytest

from fusion_net.common.boxes import Boxes
from fusion_net.common.geometry import from_rpy, invert, project, rigid, transform
from fusion_net.viz.calibration import agreement, at_time, follow, turned

OPTICAL = rigid([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], np.zeros(3))
CAM_K = np.array([[1000.0, 0, 800], [0, 1000, 450], [0, 0, 1]])
EGO_T_CAM = from_rpy(0.0, 0.0, 0.3, (1.7, 0.1, 1.5)) @ OPTICAL


def moving_box(velocity, yaw=0.4):
    return Boxes.labels(
        np.array([[10.0, 4, 1]]), np.array([[2.0, 4, 2]]), np.array([yaw]), np.array([velocity]), np.array([0])
    )


@pytest.mark.parametrize("depth", [8.0, 40.0])
def test_half_a_degree_is_8_7_pixels_at_a_focal_length_of_1000(depth):
    """The lesson's example, and that the distance does not matter where LiDAR and camera sit together."""
    point = transform(EGO_T_CAM, [[0.0, 0.2, depth]])
    off = turned(point, EGO_T_CAM[:3, 3], 0.5)
    (before,), (after,) = (project(CAM_K, transform(invert(EGO_T_CAM), p))[0] for p in (point, off))
    assert before[0] - after[0] == pytest.approx(8.7, abs=0.05)  # to the left: the point turned counter-clockwise
    assert after[1] == pytest.approx(before[1], abs=0.1)


def test_a_turn_is_about_the_sensor_and_keeps_heights_and_distances():
    place, points = np.array([0.9, 0.2, 1.8]), np.random.default_rng(1).uniform(-20, 20, (50, 3))
    off = turned(points, place, 3.0)
    np.testing.assert_allclose(np.linalg.norm(off - place, axis=1), np.linalg.norm(points - place, axis=1))
    np.testing.assert_allclose(off[:, 2], points[:, 2])
    np.testing.assert_allclose(turned(place[None], place, 3.0), place[None], atol=1e-12)


def test_points_of_a_moving_box_are_taken_to_the_cameras_time():
    """A face seen 70 ms before the reference by the LiDAR and 20 ms before it by the camera, at 20 m/s: 1 m."""
    boxes = moving_box([20.0, 0.0])
    on_it, beside = np.array([10.0 - 0.07 * 20, 4.0, 1.2]), np.array([10.0, 7.0, 1.2])
    points, moved = follow([on_it, beside], [0.07, 0.07], boxes, -0.02)
    np.testing.assert_allclose(points[0], [10.0 - 0.02 * 20, 4.0, 1.2])
    np.testing.assert_allclose(points[1], beside)
    assert moved.tolist() == [True, False]
    assert at_time(boxes, -0.02).center[0] == pytest.approx([9.6, 4.0, 1.0])


def test_the_road_under_a_car_and_boxes_of_unknown_velocity_stay():
    road = np.array([[10.0, 4.0, 0.02]])
    assert not follow(road, [0.0], moving_box([20.0, 0.0]), -0.1)[1].any()
    unknown = moving_box([np.nan, np.nan])
    assert not follow([[10.0, 4.0, 1.0]], [0.0], unknown, -0.1)[1].any()
    np.testing.assert_allclose(at_time(unknown, -0.1).center, unknown.center)


def test_agreement_is_the_share_of_points_on_the_exact_depth():
    depth = np.full((900, 1600), 20.0, np.float32)
    depth[:, :800] = 0.0  # sky
    wall = transform(EGO_T_CAM, [[1.0, 0.5, 20.1], [2.0, -0.5, 24.0], [-1.0, 0.0, 5.0], [1.0, 0.0, -5.0]])
    view = {"cam_K": CAM_K, "ego_T_cam": EGO_T_CAM}
    assert agreement(wall, depth, **view) == pytest.approx(
        0.5
    )  # the third is before the sky, the fourth behind the camera
    assert np.isnan(agreement(wall[3:], depth, **view))
