"""The sparse product against the outer product it replaces, and the geometry of both view transforms."""

from functools import partial

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion_net.common import geometry
from fusion_net.common.bev_grid import BEVGrid
from fusion_net.models.blocks.depth_bins import DepthBins
from fusion_net.models.blocks.splat import SplatIndex, splat
from fusion_net.models.encoders.backward_projection import BackwardProjection
from fusion_net.models.encoders.lift_splat import LiftSplat
from fusion_net.models.encoders.pillar_attention import PillarAttention, segment_softmax
from fusion_net.models.encoders.view_transforms import ego_points

GRID = BEVGrid(2.0, 42.0, -12.0, 20.0, 0.8)  # neither square nor centred
BINS = DepthBins(2.0, 42.0, 160, "linear")
SIZE, STRIDE = (6, 11), 8
HEIGHTS = [0.4, 1.1, 2.0]
attention = partial(PillarAttention, heights=HEIGHTS, channels=4, heads=2, key_channels=4)
VIEWS = [LiftSplat, partial(BackwardProjection, heights=HEIGHTS), attention]


def camera(*, yaw: float = 20.0, pitch: float = 4.0, roll: float = 3.0) -> tuple[torch.Tensor, torch.Tensor]:
    """cam_K (1, 1, 3, 3) and ego_T_cam (1, 1, 4, 4) of a turned, tilted, rolled camera beside the car's axis."""
    body = geometry.from_rpy(*np.deg2rad([roll, pitch, yaw]), [1.5, -0.6, 1.6])
    optical = geometry.rigid([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0, 0, 0])
    cam_K = np.array([[70.0, 0, 43.0], [0, 74.0, 21.0], [0, 0, 1]])
    return torch.tensor(cam_K)[None, None].float(), torch.tensor(body @ optical)[None, None].float()


def layered(lift, features, *others):
    """Maps (B, layers * C, Y, X) of the layers apart, from features (B, N, h, w, C) that all layers share."""
    apart = torch.eye(lift.num_layers)[:, :, None] * features[..., None, None, :]
    return lift(apart.flatten(-2), *others)


def test_layers_are_summed_as_a_1x1_convolution_of_their_maps_would():
    lift = BackwardProjection(grid=GRID, bins=BINS, stride=STRIDE, heights=HEIGHTS)
    features, depth = torch.randn(1, 1, *SIZE, 5), torch.rand(1, 1, *SIZE, BINS.count)
    kernel = torch.randn(3, 5, 4)  # layer, in, out
    maps = layered(lift, features, depth, *camera()).unflatten(1, (3, 5))
    ours = lift(torch.einsum("...i,lio->...lo", features, kernel), depth, *camera())
    torch.testing.assert_close(ours, torch.einsum("bliyx,lio->boyx", maps, kernel), rtol=1e-4, atol=1e-4)


def naive(features, weights, pixel, cell, cells):
    """Outer product and scatter-add."""
    lifted = weights[:, None] * features[pixel]
    return features.new_zeros(cells, features.shape[1]).index_add(0, cell, lifted)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 40), st.integers(1, 9), st.integers(1, 7), st.integers(1, 6), st.integers(0, 1000))
def test_splat_equals_the_outer_product_in_value_and_gradients(entries, pixels, cells, channels, seed):
    rng = torch.Generator().manual_seed(seed)
    features = torch.randn(pixels, channels, generator=rng, dtype=torch.float64, requires_grad=True)
    weights = torch.rand(entries, generator=rng, dtype=torch.float64, requires_grad=True)
    pixel = torch.randint(0, pixels, (entries,), generator=rng)
    cell = torch.randint(0, cells, (entries,), generator=rng)
    grad = torch.randn(cells, channels, generator=rng, dtype=torch.float64)
    ours = splat(features, weights, SplatIndex.of(pixel, cell, pixels=pixels, cells=cells))
    theirs = naive(features, weights, pixel, cell, cells)
    torch.testing.assert_close(ours, theirs)
    for a, b in zip(
        torch.autograd.grad(ours, [features, weights], grad),
        torch.autograd.grad(theirs, [features, weights], grad),
        strict=True,
    ):
        torch.testing.assert_close(a, b)


def test_splat_gradcheck():
    rng = torch.Generator().manual_seed(3)
    features = torch.randn(5, 3, generator=rng, dtype=torch.float64, requires_grad=True)
    weights = torch.rand(17, generator=rng, dtype=torch.float64, requires_grad=True)
    index = SplatIndex.of(
        torch.randint(0, 5, (17,), generator=rng), torch.randint(0, 4, (17,), generator=rng), pixels=5, cells=4
    )
    assert torch.autograd.gradcheck(lambda f, w: splat(f, w, index), (features, weights))


def test_published_pooling_example():
    """The unit test of BEVDet's pooling operator: outputs sum to 4.4, gradients as published."""
    depth = torch.tensor([0.3, 0.4, 0.2, 0.1, 0.7, 0.6, 0.8, 0.9], requires_grad=True)  # (D = 2, h = 2, w = 2)
    features = torch.ones(4, 2, requires_grad=True)
    entry, pixel, cell = (torch.tensor(x) for x in ([0, 4, 1, 6], [0, 0, 1, 2], [0, 0, 1, 1]))
    out = splat(features, depth[entry], SplatIndex.of(pixel, cell, pixels=4, cells=2))
    out.sum().backward()
    assert out.sum().item() == pytest.approx(4.4)
    assert depth.grad.tolist() == [2, 2, 0, 0, 2, 0, 2, 0]
    torch.testing.assert_close(features.grad[:, 0], torch.tensor([1.0, 0.4, 0.8, 0.0]))


def test_splat_ignores_autocast():
    features, weights = torch.full((1, 1), 1.0), torch.full((300,), 1.0)
    index = SplatIndex.of(torch.zeros(300), torch.zeros(300), pixels=1, cells=1)
    with torch.autocast("cpu", torch.bfloat16):
        assert splat(features.bfloat16(), weights, index).item() == 300.0  # bfloat16 would stop counting at 256


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


@settings(max_examples=25, deadline=None)
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
