"""The detector as a whole: missing sensors, batches, gradients."""

from dataclasses import replace

import pytest
import torch

from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.models.encoders.radar_encoder import RadarEncoder
from fusion_net.models.fusion_net import FusionNet
from tests.fixtures.random_batch import load_model, random_batch
from tests.fixtures.small_model import (
    CHANNELS,
    GRID,
    VIEWS,
    small_batch,
    small_model,
)


def single(batch, i):
    """Sample i of a batch as a batch of one."""
    rows = {f: getattr(batch, f)[i : i + 1] for f in ("images", "cam_K", "ego_T_cam", "present", "lidar_depth")}
    points = {}
    for name in ("lidar", "radar"):
        mine = getattr(batch, f"{name}_batch") == i
        points |= {
            f"{name}_points": getattr(batch, f"{name}_points")[mine],
            f"{name}_batch": torch.zeros(mine.sum()).int(),
        }
    return replace(
        batch, tokens=batch.tokens[i : i + 1], dense_depth=None, class_map=None, targets=None, **rows, **points
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
    for _ in range(15):
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
            encoders=dict(model.encoders) | {"radar": RadarEncoder(grid=GRID, channels=4)},
            fuser=model.fuser,
            decoder=model.decoder,
            head=model.head,
            losses=model.losses,
        )


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
