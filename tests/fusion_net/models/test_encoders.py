"""Camera, LiDAR and radar encoders: what reaches the map and what does not."""

from dataclasses import replace
from functools import partial

import pytest
import torch

from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.models.blocks.depth_bins import DepthBins
from fusion_net.models.encoders.lift_splat import LiftSplat
from fusion_net.models.encoders.radar_encoder import RASTER_CHANNELS, RadarEncoder, radial_velocity, rasterize
from tests.fixtures.small_model import (
    CHANNELS,
    GRID,
    VIEWS,
    camera_encoder,
    lidar_encoder,
    small_batch,
    small_model,
)


def test_camera_at_stride_four():
    encoded = camera_encoder(stride=4)(small_batch())
    assert encoded.image.depth_logits.shape == (3, 1, 20, 12, 20)
    assert encoded.bev.shape == (3, CHANNELS, *GRID.shape)


def test_perceive_and_lift_make_the_map():
    encoder, batch = camera_encoder().eval(), small_batch()
    with torch.no_grad():
        assert torch.equal(encoder.lift(encoder.perceive(batch), batch), encoder(batch).bev)


def test_every_encoder_returns_a_map_of_the_same_shape():
    model, batch = small_model().eval(), small_batch()
    with torch.no_grad():
        shapes = {name: encoder(batch).bev.shape for name, encoder in model.encoders.items()}
    assert shapes == dict.fromkeys(MODALITIES, (batch.size, CHANNELS, *GRID.shape))


def test_predictions_and_lift_must_agree_on_depth():
    other = partial(LiftSplat, grid=GRID, bins=DepthBins(2.0, 40.0, 21, "log"), stride=8)
    with pytest.raises(ValueError, match=r"the image network has bins=.*count=20.*, the view transform .*count=21"):
        camera_encoder(view=lambda **_: other())


def test_raster_channels_mean_what_they_say():
    points = torch.tensor([[5.0, 3.3, 0.5, 10.0, 3.0, 4.0, 0.1], [5.1, 3.5, 0.5, -20.0, -3.0, 0.0, 0.3]])
    image = rasterize(points, torch.tensor([1, 1]), 2, GRID)
    row, column, _ = GRID.rows_columns(points[0, :2])
    cell = dict(zip(RASTER_CHANNELS, image[1, :, row, column].tolist(), strict=True))
    assert cell["occupancy"] == 1
    expected = {"rcs": -0.5, "rcs_max": 1.0, "vx": 0.0, "vy": 0.2, "speed": 0.4, "speed_max": 0.5, "age": 2.0}
    assert {name: cell[name] for name in expected} == pytest.approx(expected, abs=1e-6)
    center = GRID.centers()[row, column]
    assert cell["dx"] * GRID.cell == pytest.approx(5.05 - center[0].item(), abs=1e-5)
    assert image[0].abs().sum() == 0
    assert (image[1] != 0).any(0).sum() == 1


@pytest.mark.parametrize(("kept", "column"), [(("occupancy", "vx", "vy"), 3), (("occupancy", "rcs", "rcs_max"), 4)])
def test_what_a_left_out_channel_holds_does_not_reach_the_map(kept, column):
    encoder, batch = RadarEncoder(grid=GRID, channels=CHANNELS, raster_channels=list(kept)).eval(), small_batch()
    changed = batch.radar_points.clone()
    changed[:, column] += 3.0
    everything = RadarEncoder(grid=GRID, channels=CHANNELS, raster_channels=list(RASTER_CHANNELS)).eval()
    for radar, is_same in ((encoder, True), (everything, False)):
        with torch.no_grad():
            first, second = radar(batch).bev, radar(replace(batch, radar_points=changed)).bev
        assert torch.equal(first, second) == is_same


@pytest.mark.parametrize(
    ("names", "message"),
    [(["rsc"], "no channel 'rsc'; choose from occupancy"), ([], "each once"), (["vx", "vx"], "each once")],
)
def test_wrong_radar_channels_are_named(names, message):
    with pytest.raises(ValueError, match=message):
        RadarEncoder(grid=GRID, channels=CHANNELS, raster_channels=names)


def test_the_radial_velocity_is_known_around_a_detection_and_nowhere_else():
    batch = small_batch(1, radar=0)
    points = torch.tensor([[10.1, 3.3, 0.5, 0.0, 4.0, -1.0, 0.1]])
    batch = replace(batch, radar_points=points, radar_batch=torch.zeros(1).int())
    velocity = radial_velocity(batch, GRID)
    row, column, _ = GRID.rows_columns(points[0, :2])
    around = torch.zeros(GRID.shape, dtype=torch.bool)
    around[row - 2 : row + 3, column - 2 : column + 3] = True
    torch.testing.assert_close(velocity[0, :, around], torch.tensor([[4.0], [-1.0]]).expand(2, 25))
    assert not velocity[0, :, ~around].any()


@pytest.mark.parametrize("value", [99.0, torch.nan])
def test_an_absent_radar_has_no_radial_velocity(value):
    batch = small_batch()
    batch.radar_points[batch.radar_batch == 1] = value
    batch.present[1, MODALITIES.index("radar")] = False
    velocity = radial_velocity(batch, GRID)
    assert velocity[0].any()
    assert not velocity[1].any()


def test_lidar_ignores_the_order_of_points():
    encoder, batch = lidar_encoder().eval(), small_batch()
    order = torch.randperm(len(batch.lidar_points))
    shuffled = replace(batch, lidar_points=batch.lidar_points[order], lidar_batch=batch.lidar_batch[order])
    torch.testing.assert_close(encoder(batch).bev, encoder(shuffled).bev, rtol=1e-4, atol=1e-5)


def test_extra_columns_of_a_point_reach_the_map():
    encoder, batch = lidar_encoder(extra_channels=3).eval(), small_batch()
    painted = torch.cat([batch.lidar_points, torch.zeros(len(batch.lidar_points), 3)], dim=1)
    plain = encoder.encode(painted, batch.lidar_batch, batch.size)
    painted[:, -1] = 1.0
    assert (encoder.encode(painted, batch.lidar_batch, batch.size) - plain).abs().max() > 1e-3


def test_an_impossible_pillar_names_the_nearest():
    with pytest.raises(ValueError, match=r"use 0\.4"):
        lidar_encoder(pillar=0.45)


def test_a_pillar_is_half_a_cell_unless_told_otherwise():
    encoder = lidar_encoder(pillar=None)
    assert encoder.pillars.cell == encoder.grid.cell / 2


@pytest.mark.parametrize("source", ["learned", "uniform", "lidar", "oracle"])
def test_depth_sources_run(source):
    outputs = small_model(depth_source=source).eval()(small_batch())
    assert outputs.maps["heatmap"].isfinite().all()


def test_an_absent_lidar_gives_no_depth():
    """``depth_source=lidar``: where the LiDAR is absent, its depth has no effect on the map, as if there were no returns."""
    model, batch = small_model(depth_source="lidar", names=["camera", "lidar"]).eval(), small_batch()
    present = batch.present.clone()
    present[1, MODALITIES.index("lidar")] = False
    lidar_depth = batch.lidar_depth.clone()
    lidar_depth[1] = 0.0
    with torch.no_grad():
        with_depth, without = (
            model(replace(batch, lidar_depth=d), present).maps for d in (batch.lidar_depth, lidar_depth)
        )
        everything = model(batch).maps
    for name in with_depth:
        torch.testing.assert_close(with_depth[name], without[name], rtol=0, atol=0)
    torch.testing.assert_close(with_depth["heatmap"][0], everything["heatmap"][0])


def test_a_camera_alone_is_given_no_depth_by_the_lidar_of_the_data():
    """A model without a LiDAR does not read the batch's by way of ``depth_source=lidar``."""
    model, batch = small_model(depth_source="lidar", names=["camera"]).eval(), small_batch()
    with torch.no_grad():
        with_returns = model(batch).maps
        without = model(replace(batch, lidar_depth=torch.zeros_like(batch.lidar_depth))).maps
    for name in with_returns:
        assert torch.equal(with_returns[name], without[name])


def test_the_lidar_may_teach_depth_where_it_is_absent_as_an_input():
    model, batch = small_model(depth_source="lidar", depth_supervision="lidar"), small_batch()
    absent = batch.present & (torch.arange(3) != MODALITIES.index("lidar"))
    assert model.loss(model(batch, absent), batch)["loss/depth"] > 0


@pytest.mark.parametrize("view", [VIEWS[name] for name in VIEWS if name != "bilinear"])
def test_detection_losses_reach_the_depth_distribution(view):
    """Without any depth loss, the gradient still reaches the depth distribution through the lift."""
    model, batch = small_model(view=view, names=["camera"]), small_batch()
    outputs = model(batch)
    outputs.image.depth_logits.retain_grad()
    outputs.maps["heatmap"].square().sum().backward()
    assert outputs.image.depth_logits.grad.abs().sum() > 0


def test_a_frozen_camera_keeps_its_weights_and_statistics():
    model, batch = small_model(), small_batch()
    model.image_network.freeze(True)
    model.train()
    before = {n: x.clone() for n, x in model.encoders["camera"].image_network.backbone.state_dict().items()}
    model.loss(model(batch), batch)["loss"].backward()
    assert all(p.grad is None for p in model.encoders["camera"].image_network.backbone.parameters())
    assert all(
        torch.equal(x, before[n]) for n, x in model.encoders["camera"].image_network.backbone.state_dict().items()
    )
    assert any(p.grad is not None for p in model.encoders["camera"].to_layers.parameters())
