"""The lesson's worked numbers. Its y axis points right where ours points left: the numbers are fed, not the words."""

import numpy as np
import pytest
import torch

from fusion_net.common import geometry
from fusion_net.common.bev_grid import BEVGrid
from fusion_net.models.lift_splat import SplatIndex, splat


def test_painted_point_lands_on_its_pixel():
    """(8, 1, 0.5) in the LiDAR frame, camera 0.2 m aside, f = 1000 px, centre (960, 540): pixel (1060, 477)."""
    cam_T_lidar = geometry.rigid([[0, 1, 0], [0, 0, -1], [1, 0, 0]], [-0.2, 0, 0])
    cam_K = np.array([[1000.0, 0, 960], [0, 1000, 540], [0, 0, 1]])
    in_camera = geometry.transform(cam_T_lidar, [[8.0, 1.0, 0.5]])
    np.testing.assert_allclose(in_camera, [[0.8, -0.5, 8.0]])
    pixel, depth = geometry.project(cam_K, in_camera)
    assert np.floor(pixel[0]).tolist() == [1060, 477]
    assert depth == [8.0]


def test_half_a_degree_moves_the_painted_pixel_by_nine():
    shift = 1000 * np.tan(np.deg2rad(0.5))
    assert shift == pytest.approx(8.7, abs=0.05)


def test_a_camera_cannot_tell_a_near_pedestrian_from_a_far_sign():
    cam_K = np.array([[1000.0, 0, 960], [0, 1000, 540], [0, 0, 1]])
    heights = []
    for height, distance in ((1.5, 30.0), (3.0, 60.0)):
        (_, foot), (_, top) = geometry.project(cam_K, [[0, 0, distance], [0, -height, distance]])[0]
        heights.append(foot - top)
    assert heights == pytest.approx([50.0, 50.0])


def test_point_drops_into_cell_94_124():
    """The lesson rounds values that are exact; we floor: any point within the cell, not within half a cell of its edge."""
    grid = BEVGrid(-50.0, 50.0, -50.0, 50.0, 0.5)
    row, column, inside = grid.rows_columns(torch.tensor([[12.0, -3.0], [12.49, -2.51]]))
    assert row.tolist() == [94, 94]
    assert column.tolist() == [124, 124]
    assert inside.all()


def test_lift_spreads_a_feature_and_splat_adds_what_meets():
    """c = [4, 10], alpha = [.2, .5, .3]; the middle block meets [1, .5] of another pixel in one cell: [3, 5.5]."""
    features = torch.tensor([[4.0, 10.0], [1.0, 0.5]])
    weights = torch.tensor([0.2, 0.5, 0.3, 1.0])
    blocks = splat(features, weights, SplatIndex.of(torch.tensor([0, 0, 0, 1]), torch.arange(4), pixels=2, cells=4))
    torch.testing.assert_close(blocks[:3], torch.tensor([[0.8, 2.0], [2.0, 5.0], [1.2, 3.0]]))
    torch.testing.assert_close(blocks[:3].sum(0), features[0])
    cell = torch.tensor([0, 94 * 200 + 124, 2, 94 * 200 + 124])
    bev = splat(features, weights, SplatIndex.of(torch.tensor([0, 0, 0, 1]), cell, pixels=2, cells=200 * 200))
    torch.testing.assert_close(bev.view(200, 200, 2)[94, 124], torch.tensor([3.0, 5.5]))
