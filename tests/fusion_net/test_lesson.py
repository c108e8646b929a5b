"""The lesson's worked numbers. Its y axis points right where ours points left: the numbers are fed, not the words."""

import numpy as np
import pytest
import torch

from fusion_net.common import geometry
from fusion_net.common.bev_grid import BEVGrid
from fusion_net.models.blocks.depth_bins import DepthBins
from fusion_net.models.encoders.lift_splat import LiftSplat
from fusion_net.models.encoders.painting import paint_points
from fusion_net.nuscenes.ego_path import EgoPath
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.tiny_tree import START, write_tree

CAM_K = np.array([[1000.0, 0, 960], [0, 1000, 540], [0, 0, 1]])
LESSON_AXES = [[0, 1, 0], [0, 0, -1], [1, 0, 0]]
"""From x forward, y right, z up to the camera's x right, y down, z forward."""
CAM_T_LIDAR = geometry.rigid(LESSON_AXES, [-0.2, 0, 0])
POINT = [[8.0, 1.0, 0.5]]


def pixels(cam_T_lidar, points):
    return geometry.project(CAM_K, geometry.transform(cam_T_lidar, points))[0]


def test_painted_point_lands_on_its_pixel():
    """(8, 1, 0.5) in the LiDAR frame, camera 0.2 m aside, f = 1000 px, centre (960, 540): pixel (1060, 477)."""
    in_camera = geometry.transform(CAM_T_LIDAR, POINT)
    np.testing.assert_allclose(in_camera, [[0.8, -0.5, 8.0]])
    pixel, depth = geometry.project(CAM_K, in_camera)
    assert np.floor(pixel[0]).tolist() == [1060, 477]
    assert depth == [8.0]


@pytest.mark.parametrize(("axis", "moved"), [("yaw", [8.73, 0.0]), ("pitch", [0.0, 8.73])])
def test_a_mount_half_a_degree_off_moves_the_painted_pixel_by_nine(axis, moved):
    """A point 8 m ahead in the middle of the picture: 1000 px x tan(0.5 degrees) = 8.7 px, about either axis."""
    turn = {"roll": 0.0, "pitch": 0.0, "yaw": 0.0} | {axis: np.radians(0.5)}
    ahead = geometry.transform(geometry.invert(CAM_T_LIDAR), [[0.0, 0.0, 8.0]])
    shift = pixels(CAM_T_LIDAR @ geometry.from_rpy(**turn), ahead) - pixels(CAM_T_LIDAR, ahead)
    # The LiDAR is 0.2 m beside the camera, so turning it also carries the point 1.7 mm along the optical axis.
    np.testing.assert_allclose(shift, [moved], atol=0.01)


def painted(points, scores, cam_T_lidar=CAM_T_LIDAR):
    """What the lesson's ``paint_points`` returns for one image's scores (H, W, C), and the flag of the unseen."""
    camera = (torch.tensor(matrix)[None, None] for matrix in (CAM_K, cam_T_lidar))
    return paint_points(torch.tensor(points), scores[None, None], *camera)


def test_a_painted_point_keeps_its_columns_and_gets_the_scores_of_its_pixel():
    scores = torch.zeros(1080, 1920, 3)
    scores[477, 1060] = torch.tensor([0.91, 0.02, 0.01])  # car, pedestrian, road
    found = painted([[8.0, 1.0, 0.5, 0.3]], scores)
    torch.testing.assert_close(found, torch.tensor([[8.0, 1.0, 0.5, 0.3, 0.91, 0.02, 0.01, 0.0]]))


def test_half_a_degree_paints_the_edge_of_a_car_with_the_road_beside_it():
    """Points of a car 8 m ahead, 5 and 12 px within its left edge in the picture: the error of 8.7 px takes the first."""
    scores = torch.zeros(1080, 1920, 2)
    scores[..., 1] = 1.0  # road
    scores[400:600, 800:1100] = torch.tensor([1.0, 0.0])  # car
    points = [[8.0, 0.2 + 8 * (column + 0.5 - 960) / 1000, 0.0] for column in (804, 811)]
    turned = CAM_T_LIDAR @ geometry.from_yaw(np.radians(-0.5))
    assert painted(points, scores)[:, 3].tolist() == [1.0, 1.0]
    assert painted(points, scores, turned)[:, 3].tolist() == [0.0, 1.0]


def test_half_a_degree_moves_a_farther_point_by_as_many_pixels():
    turned = geometry.rigid(LESSON_AXES, np.zeros(3)) @ geometry.from_yaw(np.radians(0.5))
    for distance in (8.0, 30.0, 80.0):
        assert pixels(turned, [[distance, 0.0, 0.0]])[0, 0] - 960 == pytest.approx(8.73, abs=0.01)


def test_a_camera_cannot_tell_a_near_pedestrian_from_a_far_sign():
    heights = []
    for height, distance in ((1.5, 30.0), (3.0, 60.0)):
        (_, foot), (_, top) = geometry.project(CAM_K, [[0, 0, distance], [0, -height, distance]])[0]
        heights.append(foot - top)
    assert heights == pytest.approx([50.0, 50.0])


class Straight(NuScenes):
    """A tree whose car drives straight on at 20 m/s."""

    def global_T_ego(self, record):
        travelled = 20 * (record["timestamp"] - START) * 1e-6
        return geometry.from_yaw(0.6, (travelled * np.cos(0.6), travelled * np.sin(0.6), 0.0))


def test_in_50_ms_at_20_metres_a_second_a_still_point_comes_one_metre_nearer(tmp_path):
    path = EgoPath(Straight(write_tree(tmp_path, scenes=1, keyframes=2, sweeps=0)), "scene-0000")
    then, now = START + 1_220_000, START + 1_270_000  # between two poses
    standing = path.at(then) @ [10.0, 2.0, 0.5, 1.0]
    moved = geometry.invert(path.at(now)) @ standing
    np.testing.assert_allclose(moved, [9.0, 2.0, 0.5, 1.0], atol=1e-6)


GRID = BEVGrid(-50.0, 50.0, -50.0, 50.0, 0.5)
CELL = (94, 124)


def test_point_drops_into_cell_94_124():
    """The lesson rounds values that are exact; we floor: any point within the cell, not within half a cell of its edge."""
    row, column, inside = GRID.rows_columns(torch.tensor([[12.0, -3.0], [12.49, -2.51]]))
    assert row.tolist() == [94, 94]
    assert column.tolist() == [124, 124]
    assert inside.all()


def test_half_the_cell_or_twice_the_range_is_four_times_the_map():
    assert GRID.shape == (200, 200)
    assert GRID.refined(2).shape == BEVGrid(-100.0, 100.0, -100.0, 100.0, 0.5).shape == (400, 400)


def test_depths_from_4_to_45_metres_in_bins_of_one_metre():
    bins = DepthBins(4.0, 45.0, 41, "linear")
    torch.testing.assert_close(bins.centers(), torch.arange(4, 45) + 0.5)
    assert bins.index(torch.tensor([10.0, 11.0, 12.99])).tolist() == [6, 7, 8]


def view(x, y):
    """``ego_T_cam`` (4, 4) of a camera at (x, y) that looks ahead."""
    return torch.tensor(geometry.rigid([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [x, y, 1.5])).float()


def test_lift_spreads_a_feature_and_splat_adds_what_meets():
    """c = [4, 10], alpha = [.2, .5, .3] at 8, 9, 10 m; the 9 m block meets [1, .5] of another pixel in one cell: [3, 5.5]."""
    lift = LiftSplat(grid=GRID, bins=DepthBins(7.5, 10.5, 3, "linear"), stride=1)
    cam_K = torch.tensor([[1.0, 0, 0.5], [0, 1, 0.5], [0, 0, 1]]).expand(1, 2, 3, 3)
    first, second = view(12.25 - 9.0, -2.75), view(12.25 - 8.0, -2.75)
    features = torch.tensor([[4.0, 10.0], [1.0, 0.5]]).view(1, 2, 1, 1, 1, 2)
    weights = torch.tensor([[0.2, 0.5, 0.3], [1.0, 0.0, 0.0]]).view(1, 2, 1, 1, 3)

    alone = lift(features[:, :1], weights[:, :1], cam_K[:, :1], first[None, None])[0]
    row, column = CELL
    blocks = alone[:, row, [column - 2, column, column + 2]].T  # a metre is two cells
    torch.testing.assert_close(blocks, torch.tensor([[0.8, 2.0], [2.0, 5.0], [1.2, 3.0]]))
    torch.testing.assert_close(alone.sum((1, 2)), features[0, 0, 0, 0, 0])  # nothing lost, nothing added

    both = lift(features, weights, cam_K, torch.stack([first, second])[None])[0]
    torch.testing.assert_close(both[:, row, column], torch.tensor([3.0, 5.5]))
