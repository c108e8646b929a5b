"""Early fusion: what is painted, what an absent sensor may not do, and who learns what."""

from dataclasses import replace

import pytest
import torch

from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.models.encoders.painting import paint_points, with_background
from tests.fixtures.random_batch import load_model, random_batch
from tests.fixtures.small_model import CLASSES, small_batch, small_early_model

CAMERA, LIDAR, RADAR = range(3)
COLUMNS = slice(5, None)


def without(batch, *sensors, sample=slice(None)):
    present = batch.present.clone()
    present[sample, list(sensors)] = False
    return present


def maps(model, batch, present=None):
    with torch.no_grad():
        return model(batch, present).maps


def assert_same(first, second):
    assert all(torch.equal(first[name], second[name]) for name in first)


def painted(model, batch):
    """Points as the LiDAR's encoder gets them."""
    with torch.no_grad():
        return model.encoders["lidar"].painter(batch)[0]


def test_the_lidars_encoder_gets_the_scores_of_the_image_network():
    model, batch = small_early_model().eval(), small_batch(cameras=2)
    with torch.no_grad():
        logits = model.image_network(batch).class_logits
    expected = paint_points(
        batch.lidar_points,
        with_background(logits.permute(0, 1, 3, 4, 2).sigmoid()),
        batch.cam_K,
        batch.ego_T_cam.double().inverse().float(),
        sample=batch.lidar_batch,
        stride=8,
    )
    found = painted(model, batch)
    assert torch.equal(found, expected)
    assert torch.equal(found[:, :5], batch.lidar_points)
    assert found.shape[1] == 5 + len(CLASSES) + 2
    seen = found[:, -1] == 0
    assert 0.1 < seen.float().mean() < 1
    model.encoders["lidar"].lidar.register_forward_hook(lambda *_: pytest.fail("it was shown points without paint"))
    maps(model, batch)


def test_the_oracle_paints_the_class_that_the_image_shows():
    model, batch = small_early_model(painting="oracle").eval(), small_batch(cameras=1)
    assert model.image_network is None
    found = painted(model, batch)[:, COLUMNS]
    assert found.unique().tolist() == [0.0, 1.0]
    assert (found.sum(dim=1) == 1).all()  # a class, the background, or the flag
    empty = replace(batch, class_map=torch.full_like(batch.class_map, -1))
    nothing = painted(model, empty)[:, COLUMNS]
    assert not nothing[:, : len(CLASSES)].any()
    assert torch.equal(nothing[:, -1], found[:, -1])
    with pytest.raises(ValueError, match="painting=oracle needs the class images of generated data"):
        model(replace(batch, class_map=None))


@pytest.mark.parametrize("painting", ["learned", "oracle"])
def test_an_absent_camera_paints_nothing_and_says_so(painting):
    model, batch = small_early_model(painting=painting).eval(), small_batch()
    present = without(batch, CAMERA, sample=1)
    other = small_batch(seed=5)
    batch = replace(batch, present=present)
    changed = {name: getattr(batch, name).clone() for name in ("images", "cam_K", "ego_T_cam", "class_map")}
    for name, values in changed.items():
        values[1] = 2 * getattr(other, name)[1]
    found, again = painted(model, batch), painted(model, replace(batch, **changed))
    mine = batch.lidar_batch == 1
    assert not found[mine, 5:-1].any()
    assert (found[mine, -1] == 1).all()
    assert found[~mine, 5:-1].any()
    assert torch.equal(found, again)
    for sensors in ((CAMERA,), (CAMERA, RADAR)):
        none = replace(batch, present=without(batch, *sensors))
        assert_same(maps(model, none), maps(model, replace(none, **changed)))


def test_without_the_camera_in_the_whole_batch_the_image_network_rests():
    model, batch = small_early_model().eval(), small_batch()
    model.image_network.register_forward_hook(lambda *_: pytest.fail("the camera was used"))
    with torch.no_grad():
        assert model(batch, without(batch, CAMERA)).image is None
        assert model(batch, without(batch, LIDAR)).image is None


def test_the_camera_has_no_way_past_the_lidar():
    """Camera and radar are the radar alone, and the camera alone says the same of every scene."""
    model, batch, other = small_early_model().eval(), small_batch(), small_batch(seed=5)
    assert_same(maps(model, batch, without(batch, LIDAR)), maps(model, batch, without(batch, CAMERA, LIDAR)))
    moved = replace(batch, lidar_points=other.lidar_points, images=other.images)
    assert_same(maps(model, batch, without(batch, LIDAR)), maps(model, moved, without(batch, LIDAR)))
    alone = without(batch, LIDAR, RADAR)
    assert_same(maps(model, batch, alone), maps(model, other, alone))
    assert len(model.decode(model(batch, alone))) == batch.size


def test_points_of_an_absent_lidar_change_nothing():
    model, batch = small_early_model().eval(), small_batch()
    present, mine = without(batch, LIDAR, sample=1), batch.lidar_batch == 1
    moved = replace(batch, lidar_points=torch.where(mine[:, None], 0.5 * batch.lidar_points, batch.lidar_points))
    torch.testing.assert_close(maps(model, batch, present), maps(model, moved, present), rtol=0, atol=1e-6)


def test_the_camera_matters_where_there_is_a_lidar():
    model, batch = small_early_model().eval(), small_batch()
    with torch.no_grad():
        seen, unseen, inverted = (
            model.encoders["lidar"](each).bev
            for each in (
                batch,
                replace(batch, present=without(batch, CAMERA)),
                replace(batch, images=255 - batch.images),
            )
        )
    assert (seen - unseen).abs().max() > 1e-3
    assert not torch.equal(seen, inverted)


def test_a_batch_is_its_samples():
    model, batch = small_early_model().eval(), small_batch(cameras=2)
    batch = replace(batch, present=without(batch, CAMERA, sample=2))
    together = maps(model, batch)
    for i in range(batch.size):
        mine = {name: getattr(batch, f"{name}_batch") == i for name in ("lidar", "radar")}
        parts = {f"{n}_points": getattr(batch, f"{n}_points")[own] for n, own in mine.items()}
        parts |= {f"{n}_batch": torch.zeros(int(own.sum()), dtype=torch.long) for n, own in mine.items()}
        parts |= {name: getattr(batch, name)[i : i + 1] for name in ("images", "cam_K", "ego_T_cam", "present")}
        for name, alone in maps(model, replace(batch, tokens=batch.tokens[i : i + 1], **parts)).items():
            torch.testing.assert_close(together[name][i : i + 1], alone, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("training", [True, False])
def test_empty_clouds_and_no_sensor_at_all(training):
    model, batch = small_early_model().train(training), small_batch(lidar=0, radar=0)
    for present in (None, torch.zeros_like(batch.present)):
        outputs = model(batch, present)
        assert all(x.isfinite().all() for x in outputs.maps.values())
        assert model.loss(outputs, batch)["loss"].isfinite()


def test_the_image_network_learns_from_its_dense_losses_alone():
    model, batch = small_early_model(), small_batch()
    model.losses.total(model.losses.box_terms(model(batch).maps, batch.targets))["loss"].backward()
    assert all(p.grad is None for p in model.image_network.parameters())
    assert all(p.grad is not None for p in model.encoders["lidar"].lidar.parameters())
    terms = model.loss(model(batch), batch)
    assert {"loss/classes", "loss/depth"} <= terms.keys()
    terms["loss"].backward()
    assert any(p.grad is not None and p.grad.any() for p in model.image_network.parameters())


def test_frozen_it_paints_in_training_what_it_paints_in_use():
    model, batch = small_early_model(), small_batch()
    model.image_network.freeze(True)
    before = {name: value.clone() for name, value in model.image_network.state_dict().items()}
    outputs = model.train()(batch)
    terms = model.loss(outputs, batch)
    assert not {"loss/classes", "loss/depth"} & terms.keys()
    terms["loss"].backward()
    assert all(torch.equal(value, before[name]) for name, value in model.image_network.state_dict().items())
    torch.testing.assert_close(painted(model, batch), painted(model.eval(), batch))


@pytest.mark.parametrize(("names", "lacking"), [(["lidar", "radar"], "no camera"), (["camera", "radar"], "no lidar")])
def test_painting_needs_camera_and_lidar(names, lacking):
    with pytest.raises(ValueError, match=rf"but encoders=.* has {lacking}; add it, or take model=mid"):
        small_early_model(names=names)


@pytest.mark.parametrize("fuser", ["concat", "average", "channel_weight", "gated", "cross_attention"])
def test_the_shipped_configuration_is_early_fusion_of_any_classes_with_any_fuser(fuser):
    model = load_model("model=early", f"fuser={fuser}", "classes=[car,bus]")
    assert list(model.encoders) == ["lidar", "radar"]
    assert model.built.all()
    batch = random_batch(1, grid=model.grid, image=(32, 64), lidar=50, radar=5, classes=2)
    assert model.loss(model(batch), batch)["loss"].isfinite()
    assert not any("view_transform" in name for name, _ in model.named_modules())
    assert list(load_model("model=early", "encoders=[camera,lidar]").encoders) == ["lidar"]
    assert MODALITIES[:2] == ("camera", "lidar")
