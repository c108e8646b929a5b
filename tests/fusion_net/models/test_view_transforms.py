"""What every view transform does: nothing outside the grid, the calibration it is given, gradients when they are asked for."""

from functools import partial

import pytest
import torch

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.models.blocks.depth_bins import DepthBins
from fusion_net.models.encoders.backward_projection import BackwardProjection
from fusion_net.models.encoders.lift_splat import LiftSplat
from fusion_net.models.encoders.pillar_attention import PillarAttention
from tests.fixtures.tilted_camera import BINS, GRID, HEIGHTS, SIZE, STRIDE, camera

attention = partial(PillarAttention, heights=HEIGHTS, channels=4, heads=2, key_channels=4)
VIEWS = [LiftSplat, partial(BackwardProjection, heights=HEIGHTS), attention]


@pytest.mark.parametrize("view", VIEWS)
def test_nothing_in_the_grid_gives_zeros_and_gradients(view):
    lift = view(grid=BEVGrid(300.0, 304.0, 0.0, 8.0, 0.8), bins=BINS, stride=STRIDE)
    features = torch.randn(1, 1, *SIZE, lift.num_layers, 4, requires_grad=True)
    depth = torch.rand(1, 1, *SIZE, BINS.count, requires_grad=True)
    bev = lift(features, depth, *camera())
    bev.sum().backward()
    assert bev.shape == (1, 4, 10, 5)
    assert not bev.any()
    assert not features.grad.any()


@pytest.mark.parametrize("view", VIEWS)
def test_another_calibration_is_another_geometry(view):
    lift = view(grid=GRID, bins=BINS, stride=STRIDE)
    features, depth = torch.rand(1, 1, *SIZE, lift.num_layers, 4), torch.rand(1, 1, *SIZE, BINS.count)
    cam_K, ego_T_cam = camera()
    first = lift(features, depth, cam_K, ego_T_cam)
    assert not torch.equal(first, lift(features, depth, *camera(yaw=20.5)))
    assert torch.equal(first, lift(features, depth, cam_K, ego_T_cam))


@pytest.mark.parametrize("view", VIEWS)
def test_a_geometry_made_without_gradients_serves_a_backward_pass(view):
    """As an audit asks for one after the drop table, on the same batch."""
    lift = view(grid=GRID, bins=BINS, stride=STRIDE)
    features, depth = torch.rand(1, 1, *SIZE, lift.num_layers, 4), torch.rand(1, 1, *SIZE, BINS.count)
    with torch.inference_mode():
        calibration = camera()
        lift(features, depth, *calibration)
    features.requires_grad_()
    depth.requires_grad_()
    lift(features, depth, *camera()).sum().backward()
    assert features.grad.abs().sum() > 0


@pytest.mark.parametrize("spacing", ["linear", "log"])
def test_bins_place_features_where_they_label_depth(spacing):
    bins = DepthBins(2.0, 58.0, 37, spacing)
    assert bins.index(bins.centers()).tolist() == list(range(37))
    assert bins.index(torch.tensor([0.0, -3.0, 1.99, 2.001, 57.99, 58.01, torch.nan])).tolist() == [
        -1,
        -1,
        -1,
        0,
        36,
        -1,
        -1,
    ]
    with pytest.raises(ValueError, match="low < high"):
        DepthBins(5.0, 2.0, 10, "log")
