import cv2
import numpy as np
import pytest

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.common.drawing import BEVPanel, boxes_on_image, depth_colors, dots, points_on_image
from fusion_net.viz.lidar_check import write_check
from tests.fixtures.tiny_tree import write_tree

CAM_K = np.array([[50.0, 0, 40], [0, 50, 30], [0, 0, 1]])
EGO_T_CAM = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1], [0, 0, 0, 1]])
GREEN = (0, 255, 0)


def test_ahead_is_up_and_left_is_left():
    panel = BEVPanel(BEVGrid(-10.0, 30.0, -5.0, 20.0, 0.5), scale=2.0)
    assert panel.canvas().shape == (80, 50, 3)
    np.testing.assert_allclose(panel.pixels([[30, 20], [0, 0], [-10, -5]]), [[0, 0], [40, 60], [50, 80]])
    image = panel.canvas()
    panel.points(image, [[20.1, 10.1], [99, 0], [np.nan, 0]], GREEN)
    assert image[19, 19].tolist() == list(GREEN)
    assert (image == GREEN).all(axis=-1).sum() == 1


def test_a_box_is_drawn_around_its_footprint():
    panel = BEVPanel(BEVGrid(-10.0, 30.0, -5.0, 20.0, 0.5), scale=10.0)
    image = np.zeros((400, 250, 3), np.uint8)
    box = Boxes.labels(
        np.array([[10.0, 5, 1]]), np.array([[2.0, 6, 2]]), np.zeros(1), np.full((1, 2), np.nan), np.zeros(1, int)
    )
    panel.boxes(image, box, GREEN)
    rows, columns = np.nonzero(image[..., 1] > 128)
    assert (rows.min(), rows.max()) == pytest.approx(((30 - 13) * 10, (30 - 7) * 10), abs=1)
    assert (columns.min(), columns.max()) == pytest.approx(((20 - 6) * 10, (20 - 4) * 10), abs=1)
    assert image[185, 149:151, 1].any()  # the line to the front, ahead of the centre
    assert not image[215, 145:155].any()


def test_a_second_of_velocity_is_drawn_of_what_moves_alone():
    panel = BEVPanel(BEVGrid(-10.0, 30.0, -5.0, 20.0, 0.5), scale=10.0)
    for speed, ahead in ((8.0, True), (0.4, False)):
        image = np.zeros((400, 250, 3), np.uint8)
        wlh, velocity = np.array([[2.0, 4, 2]]), np.array([[speed, 0.0]])
        panel.boxes(image, Boxes.labels(np.array([[10.0, 5, 1]]), wlh, np.zeros(1), velocity, np.zeros(1, int)), GREEN)
        assert image[120:178, 148:152].any() == ahead  # from the front, 12 m ahead, to the arrow's tip at 18 m


def test_near_points_are_red_and_far_ones_blue():
    (near_red, _, near_blue), (far_red, _, far_blue) = depth_colors([2.0, 55.0]).astype(int)
    assert near_red > near_blue
    assert far_red < far_blue


def test_points_land_on_their_pixel_the_nearer_on_top_and_none_from_behind():
    image = np.zeros((60, 80, 3), np.uint8)
    points_on_image(image, [[10, -2, 1], [50, -10, 1], [-10, 2, 1]], cam_K=CAM_K, ego_T_cam=EGO_T_CAM)
    assert np.argwhere(image.any(axis=-1)).tolist() == [[30, 50]]
    near = np.zeros((60, 80, 3), np.uint8)
    points_on_image(near, [[10, -2, 1]], cam_K=CAM_K, ego_T_cam=EGO_T_CAM)
    np.testing.assert_array_equal(image, near)


def test_a_box_that_passes_the_camera_is_cut_at_it():
    image = np.zeros((60, 80, 3), np.uint8)
    wlh, yaw, unknown = np.array([[2.0, 20, 2]]), np.zeros(1), np.full((1, 2), np.nan)
    beside = Boxes.labels(np.array([[2.0, 3, 1]]), wlh, yaw, unknown, np.zeros(1, int))
    boxes_on_image(image, beside, cam_K=CAM_K, ego_T_cam=EGO_T_CAM, color=GREEN)
    assert image[:, :40].any()
    assert not image[:, 41:].any()
    behind = Boxes.labels(np.array([[-20.0, 0, 1]]), wlh, yaw, unknown, np.zeros(1, int))
    before = image.copy()
    boxes_on_image(image, behind, cam_K=CAM_K, ego_T_cam=EGO_T_CAM, color=GREEN)
    np.testing.assert_array_equal(image, before)


def test_dots_at_the_edge_are_cut():
    image = np.zeros((5, 7, 3), np.uint8)
    dots(image, np.array([[0.0, 0.0], [6.9, 4.9]]), GREEN, radius=2)
    assert (image[..., 1] > 0).sum() == 8


def test_the_sheet_is_written_and_mistakes_are_named(tmp_path, capsys):
    root = str(write_tree(tmp_path / "tree", scenes=2, keyframes=1))
    out = write_check(root, sample=1, out=str(tmp_path / "sub" / "check.png"))
    assert cv2.imread(str(out)).std() > 10
    assert "sample 1 of all, scene scene-0001" in capsys.readouterr().out
    for options, message in (
        ({"sample": 2}, "samples 0 to 1"),
        ({"sample": -1}, "samples 0 to 1"),
        ({"out": str(tmp_path / "picture")}, "end it with .png"),
        ({"split": "test"}, "no split 'test'"),
        ({"error_deg": 90.0}, "within 45 degrees"),
        ({"error_deg": float("nan")}, "within 45 degrees"),
    ):
        with pytest.raises(ValueError, match=message):
            write_check(root, **{"out": str(tmp_path / "never.png")} | options)
    assert not (tmp_path / "never.png").exists()


def test_an_error_adds_a_picture_to_every_camera(tmp_path):
    root = str(write_tree(tmp_path / "tree", scenes=1, keyframes=1))
    plain = write_check(root, out=str(tmp_path / "plain.png"))
    off = write_check(root, out=str(tmp_path / "off.png"), error_deg=0.5)
    assert cv2.imread(str(off)).shape[0] == cv2.imread(str(plain)).shape[0] * 3 // 2
