"""The detector as a whole: masks, missing sensors, batches, gradients."""

from dataclasses import replace

import pytest
import torch

from benchmarks.model_step import load_model, random_batch
from fusion_net.common.bev_grid import BEVGrid
from fusion_net.data.batch import MODALITIES
from fusion_net.models.bev_decoder import BEVDecoder
from fusion_net.models.camera_encoder import CameraEncoder
from fusion_net.models.center_head import CenterHead
from fusion_net.models.depth_bins import DepthBins
from fusion_net.models.fuser import AverageFuser, ConcatFuser, make_fuser
from fusion_net.models.fusion_net import FusionNet
from fusion_net.models.lidar_encoder import LidarEncoder
from fusion_net.models.lift_splat import LiftSplat, PullLift
from fusion_net.models.losses import DetectionLoss
from fusion_net.models.radar_encoder import RASTER_CHANNELS, RadarEncoder, rasterize

GRID = BEVGrid(2.0, 27.6, -9.6, 16.0, 0.8)
CLASSES = ["car", "pedestrian"]
BINS = DepthBins(2.0, 40.0, 20, "log")


def small_model(*, view=PullLift, fuser="concat", seed=0, names=MODALITIES, **camera) -> FusionNet:
    torch.manual_seed(seed)
    encoders = {
        "camera": CameraEncoder(
            view=view(grid=GRID, bins=BINS), classes=CLASSES, channels=8, widths=[8, 8, 12, 12], features=8, **camera
        ),
        "lidar": LidarEncoder(grid=GRID, channels=8, features=8),
        "radar": RadarEncoder(grid=GRID, channels=8),
    }
    return FusionNet(
        grid=GRID,
        encoders=encoders,
        modalities=list(names),
        fuser=make_fuser(fuser, modalities=list(names), channels=dict.fromkeys(MODALITIES, 8), outputs=12),
        decoder=BEVDecoder(inputs=12, half=12, quarter=12, outputs=12),
        head=CenterHead(grid=GRID, classes=CLASSES, inputs=12, hidden=8),
        losses=DetectionLoss(bins=BINS, cell=GRID.cell),
    )


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


@pytest.mark.parametrize("view", [PullLift, LiftSplat])
def test_a_batch_is_its_samples(view):
    model, batch = small_model(view=view).eval(), small_batch(cameras=2)
    with torch.no_grad():
        together = model(batch).maps
        for i in range(batch.size):
            for name, alone in model(single(batch, i)).maps.items():
                torch.testing.assert_close(together[name][i : i + 1], alone, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("fuser", ["concat", "average", "channel_weight"])
def test_a_masked_sensor_cannot_be_felt(fuser):
    """With the LiDAR masked in one sample, any cloud gives that sample's maps; the other samples do not notice."""
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
    model.encoders["camera"].register_forward_hook(lambda *_: pytest.fail("the camera was asked"))
    with torch.no_grad():
        outputs = model(batch, absent)
    assert outputs.camera is None


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


@pytest.mark.parametrize("view", [PullLift, LiftSplat])
def test_detection_teaches_depth(view):
    """Without any depth loss, the gradient still reaches the depth distribution through the lift."""
    model, batch = small_model(view=view, names=["camera"]), small_batch()
    outputs = model(batch)
    outputs.camera.depth_logits.retain_grad()
    outputs.maps["heatmap"].square().sum().backward()
    assert outputs.camera.depth_logits.grad.abs().sum() > 0


def test_frozen_camera_keeps_its_trunk_and_statistics():
    model, batch = small_model(), small_batch()
    model.encoders["camera"].freeze(True)
    model.train()
    before = {n: x.clone() for n, x in model.encoders["camera"].trunk.state_dict().items()}
    model.loss(model(batch), batch)["loss"].backward()
    assert all(p.grad is None for p in model.encoders["camera"].trunk.parameters())
    assert all(torch.equal(x, before[n]) for n, x in model.encoders["camera"].trunk.state_dict().items())
    assert any(p.grad is not None for p in model.encoders["camera"].reduce.parameters())


@pytest.mark.parametrize("source", ["learned", "uniform", "lidar", "oracle"])
def test_depth_sources_run(source):
    outputs = small_model(depth_source=source).eval()(small_batch())
    assert outputs.maps["heatmap"].isfinite().all()


def test_camera_at_stride_four():
    view = PullLift(grid=GRID, bins=BINS, stride=4)
    encoder = CameraEncoder(view=view, classes=CLASSES, channels=8, widths=[8, 8, 12, 12], features=8)
    bev, seen = encoder(small_batch())
    assert seen.depth_logits.shape == (3, 1, 20, 12, 20)
    assert bev.shape == (3, 8, *GRID.shape)


@pytest.mark.parametrize("names", [["lidar"], ["camera", "radar"]])
def test_a_model_of_some_sensors(names):
    model = small_model(names=names)
    assert list(model.encoders) == names
    assert len(model.eval().decode(model(small_batch()))) == 3


def test_one_batch_can_be_learnt():
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
    fuser = AverageFuser(channels=dict.fromkeys(MODALITIES, 4), outputs=6, weighted=True)
    torch.nn.init.normal_(fuser.logits)
    present = torch.tensor([[True, True, True], [False, True, False], [False, False, False]])
    weights = fuser.weights(present)
    torch.testing.assert_close(weights[0].sum(0), torch.ones(6))
    assert weights[1, 1].tolist() == [1.0] * 6
    assert not weights[2].any()


def test_absent_differs_from_present_and_empty():
    fuser = ConcatFuser(channels={"lidar": 2, "radar": 2}, outputs=5).eval()
    bev = {"lidar": torch.zeros(1, 2, 4, 6), "radar": torch.zeros(1, 2, 4, 6)}
    both, one = (fuser(bev, torch.tensor([[True, x]])) for x in (True, False))
    assert (both - one).abs().max() > 1e-4


def test_mismatched_channels_are_reported():
    model = small_model()
    with pytest.raises(ValueError, match="radar encoder makes 8 channels"):
        FusionNet(
            grid=GRID,
            encoders=dict(model.encoders),
            fuser=ConcatFuser(channels={"camera": 8, "lidar": 8, "radar": 4}),
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
    encoder, batch = LidarEncoder(grid=GRID, channels=8, features=8).eval(), small_batch()
    order = torch.randperm(len(batch.lidar_points))
    shuffled = replace(batch, lidar_points=batch.lidar_points[order], lidar_batch=batch.lidar_batch[order])
    torch.testing.assert_close(encoder(batch), encoder(shuffled), rtol=1e-4, atol=1e-5)


def test_an_impossible_pillar_names_the_nearest():
    with pytest.raises(ValueError, match=r"use 0\.4"):
        LidarEncoder(grid=GRID, pillar=0.45)


def test_the_shipped_configuration_builds():
    model = load_model(
        fuser="channel_weight", encoders=["camera", "radar"], depth_supervision="lidar", classes=["car", "bus"]
    )
    assert list(model.encoders) == ["camera", "radar"]
    assert sum(p.numel() for p in model.parameters()) < 3e6
