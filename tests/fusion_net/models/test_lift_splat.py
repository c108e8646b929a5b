"""Where lifted features land, and what cells, height bands and shares keep of them."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion_net.common import geometry
from fusion_net.common.bev_grid import BEVGrid
from fusion_net.models.encoders.lift_splat import LiftSplat
from fusion_net.models.encoders.view_transforms import ego_points
from tests.fixtures.tilted_camera import BINS, GRID, SIZE, STRIDE, camera, layered


def test_lift_splat_conserves_features_that_stay_in_the_grid():
    wide = BEVGrid(-80.0, 80.0, -80.0, 80.0, 0.8)
    features = torch.randn(1, 1, *SIZE, 5)
    depth = torch.rand(1, 1, *SIZE, BINS.count).softmax(-1)
    bev = layered(LiftSplat(grid=wide, bins=BINS, stride=STRIDE), features, depth, *camera())
    torch.testing.assert_close(bev.sum((0, 2, 3)), features.sum((0, 1, 2, 3)), rtol=1e-4, atol=1e-4)


def test_lift_splat_equals_the_naive_splat():
    cam_K, ego_T_cam = camera()
    features, depth = torch.randn(1, 1, *SIZE, 5), torch.rand(1, 1, *SIZE, BINS.count)
    bev = layered(LiftSplat(grid=GRID, bins=BINS, stride=STRIDE), features, depth, cam_K, ego_T_cam)
    points = ego_points(BINS.centers().expand(1, 1, *SIZE, -1), cam_K, ego_T_cam, STRIDE)
    row, column, inside = GRID.rows_columns(points[..., :2])
    expected = torch.zeros(*GRID.shape, 5)
    lifted = depth[..., None] * features[..., None, :]
    expected.index_put_((row[inside], column[inside]), lifted[inside], accumulate=True)
    torch.testing.assert_close(bev[0].permute(1, 2, 0), expected, rtol=1e-4, atol=1e-5)


def test_height_bands_keep_height_and_lose_nothing():
    """A point's feature is in the band of its own height; the bands together are the plain splat."""
    cam_K, ego_T_cam = camera()
    features, depth = torch.randn(1, 1, *SIZE, 5), torch.rand(1, 1, *SIZE, BINS.count)
    options = {"grid": GRID, "bins": BINS, "stride": STRIDE}
    plain = layered(LiftSplat(**options), features, depth, cam_K, ego_T_cam)
    bands = layered(LiftSplat(**options, height_edges=[0.0, 1.5]), features, depth, cam_K, ego_T_cam).unflatten(
        1, (3, 5)
    )
    torch.testing.assert_close(bands.sum(1), plain, rtol=1e-4, atol=1e-5)
    points = ego_points(BINS.centers().expand(1, 1, *SIZE, -1), cam_K, ego_T_cam, STRIDE)
    row, column, inside = GRID.rows_columns(points[..., :2])
    middle = inside & (points[..., 2] >= 0.0) & (points[..., 2] < 1.5)
    expected = torch.zeros(*GRID.shape, 5)
    lifted = depth[..., None] * features[..., None, :]
    expected.index_put_((row[middle], column[middle]), lifted[middle], accumulate=True)
    torch.testing.assert_close(bands[0, 1].permute(1, 2, 0), expected, rtol=1e-4, atol=1e-5)


def test_height_edges_rise():
    with pytest.raises(ValueError, match="height_edges must rise"):
        LiftSplat(grid=GRID, bins=BINS, stride=STRIDE, height_edges=[1.0, 0.5])


def test_a_bilinear_splat_keeps_the_place_within_the_cell():
    """Divided among four cells, a feature's centre of mass is where its point is, and nothing is lost inside the grid."""
    cam_K, ego_T_cam = camera()
    features, probability = torch.zeros(1, 1, *SIZE, 1), torch.zeros(1, 1, *SIZE, BINS.count)
    features[0, 0, 3, 5], probability[0, 0, 3, 5, 70] = 1.0, 1.0
    lift = LiftSplat(grid=GRID, bins=BINS, stride=STRIDE, bilinear=True)
    bev = layered(lift, features, probability, cam_K, ego_T_cam)[0, 0]
    point = ego_points(BINS.centers().expand(1, 1, *SIZE, -1), cam_K, ego_T_cam, STRIDE)[0, 0, 3, 5, 70, :2]
    assert bev.sum() == pytest.approx(1.0)
    assert (bev > 0).sum() == 4
    torch.testing.assert_close((GRID.centers() * bev[..., None]).sum((0, 1)), point, rtol=0, atol=1e-4)


def test_a_normalized_cell_is_a_mean_if_it_is_not_nearly_empty():
    cam_K, ego_T_cam = camera()
    depth = 9 * torch.rand(1, 1, *SIZE, BINS.count)
    lift = LiftSplat(grid=GRID, bins=BINS, stride=STRIDE, normalize=True)
    bev = layered(lift, torch.ones(1, 1, *SIZE, 1), depth, cam_K, ego_T_cam)[0, 0]
    weight = layered(
        LiftSplat(grid=GRID, bins=BINS, stride=STRIDE), torch.ones(1, 1, *SIZE, 1), depth, cam_K, ego_T_cam
    )[0, 0]
    assert (bev <= 1).all()
    assert (bev[weight > 5] > 0.95).all()
    assert (bev[weight == 0] == 0).all()


@settings(max_examples=25)
@given(st.floats(5, 38), st.floats(-0.25, 0.25), st.floats(-30, 30), st.floats(-6, 10), st.floats(-5, 5))
def test_a_point_of_known_depth_lands_in_its_own_cell(ahead, aside, yaw, pitch, roll):
    """Project a point with the reference pinhole, give its pixel cell the depth, find the feature within half a cell."""
    cam_K, ego_T_cam = camera(yaw=yaw, pitch=pitch, roll=roll)
    in_camera = np.array([[aside * ahead, 0.1 * ahead, ahead]])
    pixel, depth = geometry.project(cam_K[0, 0].double().numpy(), in_camera)
    column, row = np.floor(pixel[0] / STRIDE).astype(int)
    center = (np.array([column, row]) + 0.5) * STRIDE
    on_ray = geometry.unproject(cam_K[0, 0].double().numpy(), center[None], depth)
    truth = geometry.transform(ego_T_cam[0, 0].double().numpy(), on_ray)[0]
    if not GRID.contains(truth[None, :2])[0]:
        return
    features, probability = torch.zeros(1, 1, *SIZE, 1), torch.zeros(1, 1, *SIZE, BINS.count)
    features[0, 0, row, column] = 1.0
    probability[0, 0, row, column, BINS.index(torch.tensor(ahead))] = 1.0
    bev = layered(LiftSplat(grid=GRID, bins=BINS, stride=STRIDE), features, probability, cam_K, ego_T_cam)[0, 0]
    if bev.sum() == 0:  # on the rim: half a bin further is outside
        return
    hit = GRID.centers()[bev.bool()][0].numpy()
    assert np.abs(hit - truth[:2]).max() <= GRID.cell / 2 + 0.25 / 2 + 1e-3
