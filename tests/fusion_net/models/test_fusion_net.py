"""The detector as a whole: missing sensors, batches, gradients."""

from dataclasses import replace

import pytest
import torch

from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.models.encoders.radar_encoder import RadarEncoder, radial_velocity
from fusion_net.models.fusion_net import FusionNet
from fusion_net.models.losses import focal_loss
from tests.fixtures.random_batch import load_model, random_batch
from tests.fixtures.small_model import (
    CHANNELS,
    GRID,
    VIEWS,
    single,
    small_batch,
    small_model,
)


@pytest.mark.parametrize("view", VIEWS.values(), ids=VIEWS)
def test_a_batch_is_its_samples(view):
    model, batch = small_model(view=view).eval(), small_batch(cameras=2)
    with torch.no_grad():
        together = model(batch).maps
        for i in range(batch.size):
            for name, alone in model(single(batch, i)).maps.items():
                torch.testing.assert_close(together[name][i : i + 1], alone, rtol=1e-3, atol=1e-4)


def test_absent_from_the_whole_batch_skips_the_encoder():
    model, batch = small_model().eval(), small_batch()
    absent = batch.present.clone()
    absent[:, 0] = False
    model.encoders["camera"].register_forward_hook(lambda *_: pytest.fail("the camera was used"))
    with torch.no_grad():
        outputs = model(batch, absent)
    assert outputs.image is None


@pytest.mark.parametrize("training", [True, False])
def test_no_sensor_at_all(training):
    model, batch = small_model().train(training), small_batch()
    outputs = model(batch, torch.zeros_like(batch.present))
    assert all(x.isfinite().all() for x in outputs.maps.values())
    assert model.loss(outputs, batch)["loss"].isfinite()


@pytest.mark.parametrize("training", [True, False])
def test_empty_clouds(training):
    model, batch = small_model().train(training), small_batch(lidar=0, radar=0)
    outputs = model(batch)
    model.loss(outputs, batch)["loss"].backward()
    assert all(x.isfinite().all() for x in outputs.maps.values())
    assert all(p.grad is None or p.grad.isfinite().all() for p in model.parameters())


def test_nan_points_are_outside():
    model, batch = small_model().eval(), small_batch()
    batch.lidar_points[::7, 0] = torch.nan
    batch.radar_points[::5, 1] = torch.nan
    with torch.no_grad():
        assert model(batch).maps["heatmap"].isfinite().all()


@pytest.mark.parametrize("names", [["lidar"], ["camera", "radar"]])
def test_a_model_of_some_sensors(names):
    model = small_model(names=names)
    assert list(model.encoders) == names
    assert len(model.eval().decode(model(small_batch()))) == 3


def test_one_batch_can_be_learned():
    model, batch = small_model(), small_batch(2)
    optimizer = torch.optim.AdamW(model.parameters(), lr=3e-3)
    losses = []
    for _ in range(25):
        terms = model.loss(model(batch), batch)
        optimizer.zero_grad()
        terms["loss"].backward()
        optimizer.step()
        losses.append(terms["loss"].item())
    assert losses[-1] < 0.6 * losses[0]
    assert model.camera_loss(batch)["loss"].isfinite()


def test_autocast_agrees_roughly_with_float32():
    model, batch = small_model().eval(), small_batch()
    with torch.no_grad():
        exact = model(batch).maps["heatmap"]
        with torch.autocast("cpu", torch.bfloat16):
            rough = model(batch).maps["heatmap"]
    assert rough.dtype == torch.float32
    assert (exact - rough).abs().mean() < 0.05 * exact.std() + 0.02


def test_mismatched_channels_are_reported():
    model = small_model()
    with pytest.raises(ValueError, match="the radar encoder has 4 channels, bev_channels is 8"):
        FusionNet(
            grid=GRID,
            bev_channels=CHANNELS,
            modalities=list(MODALITIES),
            encoders=dict(model.encoders)
            | {"radar": RadarEncoder(grid=GRID, channels=4, raster_channels=["occupancy"])},
            fuser=model.fuser,
            decoder=model.decoder,
            head=model.head,
            losses=model.losses,
            velocity="direct",
        )


def test_the_radar_residual_adds_the_radial_velocity_where_there_is_radar():
    batch = small_batch()
    direct, residual = (small_model(velocity=v).eval() for v in ("direct", "radar_residual"))
    absent = batch.present.clone()
    absent[1, MODALITIES.index("radar")] = False
    with torch.no_grad():
        added = residual(batch, absent).maps["velocity"] - direct(batch, absent).maps["velocity"]
    expected = radial_velocity(replace(batch, present=absent), GRID)
    torch.testing.assert_close(added, expected, rtol=1e-4, atol=1e-5)
    assert expected[0].any()
    assert not expected[1].any()


def test_a_model_without_radar_has_no_radar_residual():
    model, batch = small_model(velocity="radar_residual", names=["lidar"]).eval(), small_batch()
    with torch.no_grad():
        first = model(batch).maps["velocity"]
        second = model(replace(batch, radar_points=batch.radar_points + 1)).maps["velocity"]
    assert torch.equal(first, second)


def test_auxiliary_heads_judge_each_present_sensor_alone_and_only_in_training():
    model, batch = small_model(aux_heatmap=0.5), small_batch()
    present = batch.present.clone()
    present[:, MODALITIES.index("radar")] = False
    present[1, MODALITIES.index("lidar")] = False
    outputs = model(batch, present)
    assert {name: there.tolist() for name, (_, there) in outputs.views.items()} == {
        "camera": [True, True, True],
        "lidar": [True, False, True],
    }
    terms = model.loss(outputs, batch)
    logits, there = outputs.views["lidar"]
    each = [focal_loss(logits[there], batch.targets.heatmap[there])]
    each += [focal_loss(outputs.views["camera"][0], batch.targets.heatmap)]
    torch.testing.assert_close(terms["loss/aux_heatmap"], 0.5 * sum(each) / 2)
    terms["loss/aux_heatmap"].backward()
    assert any(p.grad is not None and p.grad.any() for p in model.encoders["lidar"].parameters())
    assert all(p.grad is None for p in model.head.parameters())
    assert not model.eval()(batch).views
    assert not small_model().views


@pytest.mark.parametrize(
    ("grid", "shape"),
    [
        ("fine", (112, 128)),
        ("front", (84, 96)),
        ("coarse", (28, 32)),
        ("graded", (56, 64)),
        ("lesson", (200, 200)),
        ("lesson_fine", (400, 400)),
        ("lesson_front", (88, 100)),
    ],
)
def test_every_grid_fits_the_pillars(grid, shape):
    assert load_model(f"grid={grid}").grid.shape == shape


@pytest.mark.parametrize("view", ["lift_splat", "backward_projection", "bilinear", "attention"])
def test_every_view_transform_is_a_switch(view):
    model = load_model(f"view_transform={view}", "encoders=[camera]")
    batch = random_batch(1, grid=model.grid, image=(32, 64), lidar=0, radar=0)
    outputs = model(batch)
    model.loss(outputs, batch)["loss"].backward()
    lift = model.encoders["camera"].view_transform
    assert all(p.grad is not None and p.grad.isfinite().all() for p in lift.parameters())


def test_the_shipped_configuration_builds():
    model = load_model(
        "fuser=channel_weight", "encoders=[camera,radar]", "depth_supervision=lidar", "classes=[car,bus]"
    )
    assert list(model.encoders) == ["camera", "radar"]
    assert sum(p.numel() for p in model.parameters()) < 3e6
