"""The detector on a grid whose cells grow with the distance: what holds in equal cells holds here, in metres."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion_net.common import geometry
from fusion_net.common.bev_grid import BEVGrid, GradedGrid
from fusion_net.common.boxes import Boxes
from fusion_net.data.targets import center_targets, gaussian_radius
from fusion_net.models.blocks.depth_bins import DepthBins
from fusion_net.models.center_head import CenterHead
from fusion_net.models.encoders.backward_projection import BackwardProjection
from fusion_net.models.encoders.lidar_encoder import LidarEncoder
from fusion_net.models.encoders.lift_splat import LiftSplat
from fusion_net.models.encoders.radar_encoder import RASTER_CHANNELS, rasterize
from fusion_net.models.encoders.view_transforms import ego_points
from fusion_net.models.losses import WEIGHTS, DetectionLoss, center_nll
from tests.fixtures.random_batch import load_model, random_batch
from tests.fixtures.small_model import single

GRADED = GradedGrid(0.0, 40.0, -12.0, 20.0, 0.4, 40, 50)
UNIFORM = BEVGrid(0.0, 40.0, -12.0, 20.0, 0.8)
AS_UNIFORM = GradedGrid(0.0, 40.0, -12.0, 20.0, 0.8, 40, 50)
BINS = DepthBins(2.0, 40.0, 60, "linear")
both = pytest.mark.parametrize("grid", [GRADED, UNIFORM], ids=["graded", "uniform"])


def boxes(*rows, wlh=(1.9, 4.6, 1.5)) -> Boxes:
    """Standing boxes of rows x, y, yaw, label."""
    table = np.array(rows, float).reshape(-1, 4)
    center = np.column_stack([table[:, :2], np.full(len(table), 0.8)])
    velocity = np.tile([3.0, -1.0], (len(table), 1))
    return Boxes.labels(center, np.tile(wlh, (len(table), 1)), table[:, 2], velocity, table[:, 3].astype(int))


def head(grid) -> CenterHead:
    names = ["car", "pedestrian"]
    return CenterHead(
        grid=grid, classes=names, channels=4, hidden=4, heading="sincos", max_boxes=20, min_score=0.3,
        nms_radius=dict.fromkeys(names, 1.0), variance_penalty=0.0,
    )  # fmt: skip


def perfect_maps(targets) -> dict[str, torch.Tensor]:
    """What a network would say that has learned these targets by heart."""
    names = ("offset", "height", "size", "rot", "velocity")
    maps = {name: getattr(targets, name).clone() for name in names}
    maps["log_variance"] = torch.zeros_like(maps["offset"])
    return maps | {"heatmap": targets.heatmap.clamp(1e-4, 1 - 1e-4).logit()}


@both
@settings(max_examples=40)
@given(x=st.floats(0.1, 39.9), y=st.floats(-11.9, 19.9), yaw=st.floats(-3.1, 3.1))
def test_a_car_anywhere_comes_back_from_its_targets(grid, x, y, yaw):
    car = boxes((x, y, yaw, 0))
    found = head(grid).decode(perfect_maps(center_targets([car], grid=grid, num_classes=2)))[0]
    assert len(found) == 1
    np.testing.assert_allclose(found.center, car.center, atol=1e-4)
    np.testing.assert_allclose(found.wlh, car.wlh, rtol=1e-5)
    np.testing.assert_allclose(np.exp(1j * found.yaw), np.exp(1j * car.yaw), atol=1e-5)
    np.testing.assert_allclose(found.velocity, car.velocity)


def test_targets_and_losses_of_as_many_cells_as_fit_are_those_of_the_uniform_grid_to_the_bit():
    rng = np.random.default_rng(0)
    cars = boxes(*np.column_stack([rng.uniform([0, -12, -3], [40, 20, 3], (30, 3)), rng.integers(0, 2, 30)]))
    made, expected = (center_targets([cars], grid=grid, num_classes=2) for grid in (AS_UNIFORM, UNIFORM))
    assert all(torch.equal(value, getattr(expected, name)) for name, value in vars(made).items())
    maps = {name: torch.randn_like(value) for name, value in perfect_maps(made).items()}
    losses = [loss(grid).box_terms(maps, made) for grid in (AS_UNIFORM, UNIFORM)]
    assert all(torch.equal(value, losses[1][name]) for name, value in losses[0].items())


def loss(grid) -> DetectionLoss:
    return DetectionLoss(
        bins=BINS, grid=grid, classes=["car", "pedestrian"], depth_supervision="none",
        weights=dict.fromkeys(WEIGHTS, 1.0), object_weight=1.0, peak_radius=3, box_radius=1,
    )  # fmt: skip


@both
@pytest.mark.parametrize("place", [(1.0, 0.3), (38.0, 0.2), (30.0, 18.0)])
def test_offsets_that_point_to_the_centre_from_every_cell_cost_nothing(grid, place):
    made = center_targets([boxes((*place, 0.4, 0))], grid=grid, num_classes=2)
    maps = perfect_maps(made)
    maps["offset"] = (torch.tensor(place) - grid.centers()).permute(2, 0, 1)[None].float()
    assert loss(grid).box_terms(maps, made)["loss/offset"] == pytest.approx(0.0, abs=1e-5)
    maps["log_variance"][:] = 0.0
    for ahead in (0, 2):  # of the object's own cell: the peak whose variance is learned
        row, column = (int(i) for i in made.mask[0].nonzero()[0])
        maps["heatmap"][0, 0, row, min(column + ahead, grid.shape[1] - 1)] = 20.0 + ahead
        assert center_nll(maps, made, grid=grid, radius=3) == pytest.approx(0.0, abs=1e-8)
        maps["heatmap"][0, 0] = -20.0


def test_a_gaussian_is_round_in_metres():
    """Its radii in cells are those of the body in the cells of its place, which far ahead are longer than wide."""
    reach = gaussian_radius(np.array([16.0]), np.array([6.0]), 0.1)[0]
    extents = []
    for place in ((10.0, 0.3), (36.0, 0.3)):
        large = boxes((*place, 0.0, 0), wlh=(6.0, 16.0, 3.0))
        heat = center_targets([large], grid=GRADED, num_classes=1, min_radius=1).heatmap[0, 0]
        row, column, _ = GRADED.rows_columns(torch.tensor(place))
        extents.append((int((heat[:, column] > 0).sum()), int((heat[row] > 0).sum())))
        sizes = GRADED.y_axis.size(row), GRADED.x_axis.size(column)
        assert extents[-1] == tuple(2 * int(reach / size) + 1 for size in sizes)
    assert extents[1][1] < extents[0][1] <= extents[0][0] == extents[1][0]


def test_pillars_and_raster_know_the_place_within_a_cell():
    encoder = LidarEncoder(grid=GRADED, channels=4, pillar=0.2, features=4)
    assert encoder.pillars.shape == (80, 100)
    xy = torch.rand(2000, 2, generator=torch.Generator().manual_seed(0)) * torch.tensor([40.0, 32.0])
    points = torch.cat([xy - torch.tensor([0.0, 12.0]), torch.rand(2000, 5)], dim=1)
    row, column, _ = encoder.pillars.rows_columns(points[:, :2])
    one = torch.zeros(len(points), dtype=torch.int64)
    decorated = encoder._decorate(points[:, :5], row, column, one, torch.tensor([len(points)]))
    place = torch.stack([encoder.pillars.x_axis.to_cells(points[:, 0]) - column - 0.5,
                         encoder.pillars.y_axis.to_cells(points[:, 1]) - row - 0.5], dim=1)  # fmt: skip
    torch.testing.assert_close(decorated[:, -2:], place, rtol=0, atol=0.01)  # of metres there, of cells here
    assert decorated[:, -2:].abs().max() < 0.51
    detections = torch.cat([points[:1], points[:1]])
    image = rasterize(detections, torch.tensor([0, 0]), 1, GRADED)[0]
    row, column, _ = GRADED.rows_columns(points[0, :2])
    dx, dy = (image[RASTER_CHANNELS.index(name), row, column] for name in ("dx", "dy"))
    center = torch.stack([column + 0.5 + dx, row + 0.5 + dy])
    back = torch.stack([GRADED.x_axis.to_metres(center[0]), GRADED.y_axis.to_metres(center[1])])
    torch.testing.assert_close(back, points[0, :2], rtol=0, atol=1e-4)


def camera() -> tuple[torch.Tensor, torch.Tensor]:
    """cam_K (1, 1, 3, 3) and ego_T_cam (1, 1, 4, 4) of a turned, tilted, rolled camera beside the car's axis."""
    body = geometry.from_rpy(*np.deg2rad([3.0, 4.0, 10.0]), [1.5, -0.6, 1.6])
    optical = geometry.rigid([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0, 0, 0])
    cam_K = np.array([[70.0, 0, 43.0], [0, 74.0, 21.0], [0, 0, 1]])
    return torch.tensor(cam_K)[None, None].float(), torch.tensor(body @ optical)[None, None].float()


@both
@pytest.mark.parametrize("bilinear", [False, True])
def test_a_splat_loses_nothing_on_the_grid_and_falls_where_its_point_is(grid, bilinear):
    (cam_K, ego_T_cam), size = camera(), (6, 11)
    lift = LiftSplat(grid=grid, bins=BINS, stride=8, bilinear=bilinear)
    points = ego_points(BINS.centers().expand(1, 1, *size, -1), cam_K, ego_T_cam, 8)[0, 0, ..., :2]
    for u, v, depth in ((5, 3, 4), (5, 3, 50), (8, 2, 30)):
        features, probability = torch.zeros(1, 1, *size, 1, 1), torch.zeros(1, 1, *size, BINS.count)
        features[0, 0, v, u], probability[0, 0, v, u, depth] = 1.0, 1.0
        bev = lift(features, probability, cam_K, ego_T_cam)[0, 0]
        assert bev.sum() == pytest.approx(1.0)
        place = points[v, u, depth]
        if bilinear:
            rows, columns = (torch.arange(n) + 0.5 for n in grid.shape)
            row, column = (bev.sum(dim=1) * rows).sum(), (bev.sum(dim=0) * columns).sum()
            mean = torch.stack([grid.x_axis.to_metres(column), grid.y_axis.to_metres(row)])
            torch.testing.assert_close(mean, place, rtol=0, atol=1e-3)
        else:
            row, column, _ = grid.rows_columns(place)
            assert bev[row, column] == pytest.approx(1.0)
    everything = lift(torch.ones(1, 1, *size, 1, 1), torch.ones(1, 1, *size, BINS.count), cam_K, ego_T_cam)
    inside = grid.rows_columns(points)[2].sum()
    edge = 0.15 if bilinear else 0.0  # shares of what lies within half a cell of the border, or beyond it, go astray
    assert everything.sum() == pytest.approx(float(inside), rel=edge + 1e-6)


@both
def test_a_cell_looks_at_its_own_ground(grid):
    """A pixel whose depth is that of a point fills the cells around that point, wherever it lies."""
    (cam_K, ego_T_cam), size = camera(), (6, 11)
    lift = BackwardProjection(grid=grid, bins=BINS, stride=8, heights=[0.4])
    expected = torch.cat([grid.centers(), torch.full((*grid.shape, 1), 0.4)], dim=-1).reshape(-1, 3)
    torch.testing.assert_close(lift.points, expected)
    bev = lift(torch.ones(1, 1, *size, 1, 1), torch.ones(1, 1, *size, BINS.count), cam_K, ego_T_cam)
    assert 0 < (bev > 0).float().mean() < 1


@pytest.mark.parametrize("view", ["lift_splat", "backward_projection", "attention"])
def test_a_batch_is_its_samples(view):
    model = load_model("grid=graded", f"view_transform={view}").eval()
    batch = random_batch(2, grid=model.grid, image=(32, 64), lidar=400, radar=40)
    with torch.no_grad():
        together = model(batch).maps
        for i in range(batch.size):
            for name, alone in model(single(batch, i)).maps.items():
                torch.testing.assert_close(together[name][i : i + 1], alone, rtol=1e-3, atol=1e-4)


def test_points_and_detections_mirror_with_the_car():
    """What augmentation relies on: features of a mirrored scene lie in the mirrored rows."""
    grid = GradedGrid(0.0, 40.0, -16.0, 16.0, 0.4, 40, 50)
    batch = random_batch(1, grid=grid, image=(32, 64), lidar=10, radar=200)
    turned = batch.radar_points * torch.tensor([1, -1, 1, 1, 1, -1, 1.0])
    plain, mirrored = (rasterize(p, batch.radar_batch, 1, grid) for p in (batch.radar_points, turned))
    signs = torch.tensor([-1.0 if name in ("vy", "dy") else 1.0 for name in RASTER_CHANNELS])
    torch.testing.assert_close(mirrored.flip(2) * signs[:, None, None], plain, rtol=0, atol=1e-4)


def test_the_gradient_reaches_every_part():
    model = load_model("grid=graded")
    batch = random_batch(2, grid=model.grid, image=(32, 64), lidar=400, radar=40)
    batch = replace(
        batch, targets=center_targets([boxes((9.0, 1.0, 0.1, 0)), Boxes.empty()], grid=model.grid, num_classes=10)
    )
    model.loss(model(batch), batch)["loss"].backward()
    assert all(p.grad is not None and p.grad.isfinite().all() for p in model.parameters())
