"""What a cell reads from the pixels that see it: interpolated, weighed by depth, or chosen by attention."""

import numpy as np
import pytest
import torch

from fusion_net.common import geometry
from fusion_net.models.blocks.depth_bins import DepthBins
from fusion_net.models.encoders.backward_projection import BackwardProjection
from fusion_net.models.encoders.pillar_attention import PillarAttention, segment_softmax
from tests.fixtures.tilted_camera import BINS, GRID, HEIGHTS, SIZE, STRIDE, camera, layered


def test_layers_are_summed_as_a_1x1_convolution_of_their_maps_would():
    lift = BackwardProjection(grid=GRID, bins=BINS, stride=STRIDE, heights=HEIGHTS)
    features, depth = torch.randn(1, 1, *SIZE, 5), torch.rand(1, 1, *SIZE, BINS.count)
    kernel = torch.randn(3, 5, 4)  # layer, in, out
    maps = layered(lift, features, depth, *camera()).unflatten(1, (3, 5))
    ours = lift(torch.einsum("...i,lio->...lo", features, kernel), depth, *camera())
    torch.testing.assert_close(ours, torch.einsum("bliyx,lio->boyx", maps, kernel), rtol=1e-4, atol=1e-4)


def test_without_depth_a_cell_is_the_mean_over_the_cameras_that_see_it():
    one, two = camera(), camera(yaw=25)
    both = [torch.cat(pair, dim=1) for pair in zip(one, two, strict=True)]
    lift = BackwardProjection(grid=GRID, bins=BINS, stride=STRIDE, heights=HEIGHTS, depth_weighted=False)
    ones, flat = torch.ones(1, 2, *SIZE, 1), torch.rand(1, 2, *SIZE, BINS.count)
    seen = layered(lift, ones, flat, *both)
    torch.testing.assert_close(seen, seen.round(), rtol=0, atol=1e-5)
    assert 0 < seen.mean() < 1
    assert torch.equal(seen, layered(lift, ones, torch.zeros_like(flat), *both))
    features = torch.stack([torch.full((1, *SIZE, 1), value) for value in (1.0, 3.0)], dim=1)
    values = layered(lift, features, flat, *both)
    assert (values - 2).abs().min() < 1e-5  # seen by both


def test_attention_chooses_among_the_heights_of_a_cell():
    """Untrained, the mean over the visible heights; with a query for the key of one pixel feature, that feature."""
    cam_K, ego_T_cam = camera()
    features = torch.rand(1, 1, *SIZE, 2)
    depth = torch.ones(1, 1, *SIZE, BINS.count)
    lift = PillarAttention(grid=GRID, bins=BINS, stride=STRIDE, heights=HEIGHTS, channels=2, heads=1, key_channels=4)
    options = {"grid": GRID, "bins": BINS, "stride": STRIDE, "heights": HEIGHTS}
    with_ones = torch.cat([features, torch.ones_like(features[..., :1])], -1)
    layers = layered(BackwardProjection(**options), with_ones, depth, cam_K, ego_T_cam)
    layers = layers.unflatten(1, (3, 3))
    seen = layers[:, :, 2:].sum(1).clamp(min=1)
    torch.testing.assert_close(
        layered(lift, features, depth, cam_K, ego_T_cam), layers[:, :, :2].sum(1) / seen, rtol=1e-4, atol=1e-5
    )
    with torch.no_grad():
        lift.key.zero_()[0, 0, 0] = 1.0
        lift.cell_query[:, 0, 0] = 1e4
        chosen = layered(lift, features, depth, cam_K, ego_T_cam)[:, 0]
    torch.testing.assert_close(chosen, layers[:, :, 0].amax(1), rtol=1e-2, atol=1e-2)


def test_segment_softmax_by_hand():
    logits = torch.tensor([[0.0], [2.0], [500.0], [500.0]], requires_grad=True)
    weights = segment_softmax(logits, torch.tensor([2, 2, 0, 0]), 4)
    torch.testing.assert_close(weights[:2], logits[:2].softmax(0))
    assert weights[2:].flatten().tolist() == [0.5, 0.5]
    weights[0].sum().backward()
    assert logits.grad.isfinite().all()


def test_backward_projection_reads_the_pixel_where_a_cell_is_visible():
    """A feature that is the pixel's own coordinates, interpolated, gives back the projection of each cell's point."""
    cam_K, ego_T_cam = camera()
    lift = BackwardProjection(grid=GRID, bins=BINS, stride=STRIDE, heights=[0.4, 1.1])
    v, u = torch.meshgrid(torch.arange(SIZE[0]), torch.arange(SIZE[1]), indexing="ij")
    features = torch.stack([(u + 0.5) * STRIDE, (v + 0.5) * STRIDE, torch.ones_like(u)], -1)[None, None].float()
    flat = torch.ones(1, 1, *SIZE, BINS.count)
    bev = layered(lift, features, flat, cam_K, ego_T_cam)[0].view(2, 3, *GRID.shape)
    for layer, height in enumerate((0.4, 1.1)):
        points = np.concatenate([GRID.centers().numpy(), np.full((*GRID.shape, 1), height)], -1).reshape(-1, 3)
        cam_T_ego = geometry.invert(ego_T_cam[0, 0].double().numpy())
        pixel, depth = geometry.project(cam_K[0, 0].double().numpy(), geometry.transform(cam_T_ego, points))
        u, v = pixel.T
        inner = (u > 4) & (u < 84) & (v > 4) & (v < 44) & (depth > 2) & (depth < 41)
        ours = bev[layer].flatten(1).T.numpy()
        assert inner.sum() > 200
        np.testing.assert_allclose(ours[inner, 2], 1.0, atol=1e-4)
        np.testing.assert_allclose(ours[inner, :2], pixel[inner], atol=0.02)
        assert not ours[~((u > 0) & (u < 88) & (v > 0) & (v < 48))].any()


def test_backward_projection_weighs_by_the_interpolated_depth():
    cam_K, ego_T_cam = camera(yaw=0, pitch=0, roll=0)
    bins = DepthBins(2.0, 42.0, 20, "linear")  # 2 m
    probability = torch.zeros(1, 1, *SIZE, 20)
    probability[..., 10] = 1.0  # centre at 23 m along z, so 24.5 m in the ego frame
    lift = BackwardProjection(grid=GRID, bins=bins, stride=STRIDE, heights=[1.1])
    bev = layered(lift, torch.ones(1, 1, *SIZE, 1), probability, cam_K, ego_T_cam)
    row = int(GRID.rows_columns(torch.tensor([24.0, -0.6]))[0])
    x = GRID.centers()[row, :, 0]
    expected = (1 - (x - 24.5).abs() / 2).clamp(min=0)
    torch.testing.assert_close(bev[0, 0, row], expected, atol=1e-4, rtol=0)


def test_a_cell_is_seen_at_one_height_at_least():
    with pytest.raises(ValueError, match=r"heights=\[\]: a cell is seen at one height at least"):
        BackwardProjection(grid=GRID, bins=BINS, stride=STRIDE, heights=[])
