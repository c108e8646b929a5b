"""The detector as a whole: masks, missing sensors, batches, gradients."""

from dataclasses import replace
from functools import partial

import pytest
import torch

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.models.bev_decoder import BEVDecoder
from fusion_net.models.camera_encoder import CameraEncoder
from fusion_net.models.center_head import CenterHead
from fusion_net.models.depth_bins import DepthBins
from fusion_net.models.fuser import AverageFuser, ConcatFuser, make_fuser
from fusion_net.models.fusion_net import FusionNet
from fusion_net.models.image_network import ImageNetwork
from fusion_net.models.lidar_encoder import LidarEncoder
from fusion_net.models.lift_splat import BackwardProjection, LiftSplat
from fusion_net.models.losses import WEIGHTS, DetectionLoss
from fusion_net.models.radar_encoder import RASTER_CHANNELS, RadarEncoder, rasterize
from tests.fixtures.random_batch import load_model, random_batch

GRID = BEVGrid(2.0, 27.6, -9.6, 16.0, 0.8)
CLASSES = ["car", "pedestrian"]
BINS = DepthBins(2.0, 40.0, 20, "log")


CHANNELS = 8
backward_projection = partial(BackwardProjection, heights=[0.4, 1.1, 2.0])


def camera_encoder(*, view=backward_projection, stride=8, **changes) -> CameraEncoder:
    settings = {"lift_class_scores": True, "depth_source": "learned"} | changes
    network = ImageNetwork(classes=CLASSES, bins=BINS, stride=stride, widths=[8, 8, 12, 12], features=8)
    view_transform = view(grid=GRID, bins=BINS, stride=stride)
    return CameraEncoder(image_network=network, view_transform=view_transform, channels=CHANNELS, **settings)


def lidar_encoder(**changes) -> LidarEncoder:
    return LidarEncoder(
        **{"grid": GRID, "channels": CHANNELS, "pillar": 0.4, "features": 8, "extra_channels": 0} | changes
    )


def detection_loss() -> DetectionLoss:
    settings = {"depth_supervision": "dense", "object_weight": 4.0, "peak_radius": 3, "box_radius": 1}
    weights = dict.fromkeys(WEIGHTS, 0.4) | {"heatmap": 1.0, "log_variance": 0.1}
    return DetectionLoss(bins=BINS, cell=GRID.cell, weights=weights, **settings)


def small_model(*, fuser="concat", seed=0, names=MODALITIES, **camera) -> FusionNet:
    torch.manual_seed(seed)
    encoders = {
        "camera": camera_encoder(**camera),
        "lidar": lidar_encoder(),
        "radar": RadarEncoder(grid=GRID, channels=CHANNELS),
    }
    return FusionNet(
        grid=GRID,
        bev_channels=CHANNELS,
        encoders=encoders,
        modalities=list(names),
        fuser=make_fuser(fuser, modalities=list(names), channels=CHANNELS),
        decoder=BEVDecoder(channels=CHANNELS, half=12, quarter=12),
        head=CenterHead(
            grid=GRID, classes=CLASSES, channels=CHANNELS, hidden=8, max_boxes=100, min_score=0.0,
            nms_radius=dict.fromkeys(CLASSES, 1.0),
        ),
        losses=detection_loss(),
    )  # fmt: skip


def small_batch(size=3, **options):
    return random_batch(size, grid=GRID, image=(48, 80), classes=2, **{"lidar": 300, "radar": 9} | options)


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


@pytest.mark.parametrize("view", [backward_projection, LiftSplat])
def test_a_batch_is_its_samples(view):
    model, batch = small_model(view=view).eval(), small_batch(cameras=2)
    with torch.no_grad():
        together = model(batch).maps
        for i in range(batch.size):
            for name, alone in model(single(batch, i)).maps.items():
                torch.testing.assert_close(together[name][i : i + 1], alone, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("fuser", ["concat", "average", "channel_weight"])
def test_a_masked_sensor_has_no_effect(fuser):
    """With the LiDAR masked in one sample, any point cloud gives that sample's maps; the other samples do not change."""
    model, batch = small_model(fuser=fuser).eval(), small_batch()
    present = batch.present.clone()
    present[1, MODALITIES.index("lidar")] = False
    other = replace(batch, lidar_points=torch.rand_like(batch.lidar_points) * 20)
    with torch.no_grad():
        full, masked, changed = (model(*x).maps["heatmap"] for x in ((batch,), (batch, present), (other, present)))
    torch.testing.assert_close(masked[1], changed[1])
    torch.testing.assert_close(masked[[0, 2]], full[[0, 2]])
    assert (masked[1] - full[1]).abs().max() > 1e-4


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


@pytest.mark.parametrize("view", [backward_projection, LiftSplat])
def test_detection_losses_reach_the_depth_distribution(view):
    """Without any depth loss, the gradient still reaches the depth distribution through the lift."""
    model, batch = small_model(view=view, names=["camera"]), small_batch()
    outputs = model(batch)
    outputs.image.depth_logits.retain_grad()
    outputs.maps["heatmap"].square().sum().backward()
    assert outputs.image.depth_logits.grad.abs().sum() > 0


def test_a_frozen_camera_keeps_its_weights_and_statistics():
    model, batch = small_model(), small_batch()
    model.encoders["camera"].freeze(True)
    model.train()
    before = {n: x.clone() for n, x in model.encoders["camera"].image_network.backbone.state_dict().items()}
    model.loss(model(batch), batch)["loss"].backward()
    assert all(p.grad is None for p in model.encoders["camera"].image_network.backbone.parameters())
    assert all(
        torch.equal(x, before[n]) for n, x in model.encoders["camera"].image_network.backbone.state_dict().items()
    )
    assert any(p.grad is not None for p in model.encoders["camera"].reduce.parameters())


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


def test_channel_weights_are_a_partition_of_one():
    fuser = AverageFuser(modalities=list(MODALITIES), channels=6, weighted=True)
    torch.nn.init.normal_(fuser.logits)
    present = torch.tensor([[True, True, True], [False, True, False], [False, False, False]])
    weights = fuser.weights(present)
    torch.testing.assert_close(weights[0].sum(0), torch.ones(6))
    assert weights[1, 1].tolist() == [1.0] * 6
    assert not weights[2].any()


def test_absent_differs_from_present_and_empty():
    torch.manual_seed(0)
    fuser = ConcatFuser(modalities=["lidar", "radar"], channels=8).eval()
    bev = {name: torch.zeros(1, 8, 4, 6) for name in ("lidar", "radar")}
    both, one = (fuser(bev, torch.tensor([[True, x]])) for x in (True, False))
    assert (both - one).abs().max() > 1e-4


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


def test_the_shipped_configuration_builds():
    model = load_model(
        fuser="channel_weight", encoders=["camera", "radar"], depth_supervision="lidar", classes=["car", "bus"]
    )
    assert list(model.encoders) == ["camera", "radar"]
    assert sum(p.numel() for p in model.parameters()) < 3e6
