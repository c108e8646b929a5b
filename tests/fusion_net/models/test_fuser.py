"""Fusers: weights, and what a sensor that is absent may change."""

from dataclasses import replace

import pytest
import torch

from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.models.fuser import AverageFuser, ConcatFuser, CrossAttentionFuser, GatedFuser, make_fuser
from tests.fixtures.small_model import small_batch, small_model

FUSERS = ["concat", "average", "channel_weight", "gated", "cross_attention"]


def made(kind):
    torch.manual_seed(0)
    return make_fuser(kind, modalities=list(MODALITIES), channels=8)


def maps_of(size=2, seed=0):
    rng = torch.Generator().manual_seed(seed)
    return {name: torch.rand(size, 8, 4, 6, generator=rng) for name in MODALITIES}


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
    assert (both - one).abs().max() > 1e-5


@pytest.mark.parametrize("training", [True, False])
@pytest.mark.parametrize("kind", FUSERS)
def test_what_an_absent_sensor_gives_does_not_pass_even_nan(kind, training):
    """Not by way of a batch norm either; and no gradient goes back to it."""
    fuser, present = made(kind).train(training), torch.tensor([[True, True, True], [True, False, True]])
    maps, changed = maps_of(), maps_of()
    changed["lidar"][1] = torch.nan
    changed["lidar"].requires_grad_()
    first, second = fuser(maps, present), fuser(changed, present)
    assert torch.equal(first, second)
    second.square().sum().backward()
    assert not changed["lidar"].grad[1].any()
    assert changed["lidar"].grad[0].any()


@pytest.mark.parametrize("kind", FUSERS)
def test_one_sensor_or_none_gives_finite_maps_and_gradients(kind):
    for sensors in ([True, False, False], [False, False, True], [False, False, False]):
        fuser = made(kind)
        present = torch.tensor([sensors, sensors])
        fused = fuser(maps_of(), present)
        fused.square().sum().backward()
        assert fused.isfinite().all()
        assert fused.shape == (2, 8, 4, 6)
        assert all(p.grad is None or p.grad.isfinite().all() for p in fuser.parameters())
        assert fused.std() > 0 or not any(sensors)


def test_gates_are_between_0_and_1_and_closed_for_the_absent():
    fuser, maps = GatedFuser(modalities=list(MODALITIES), channels=8), list(maps_of().values())
    weights = fuser.weights(maps, torch.tensor([[True, True, True], [True, False, False]]))
    assert weights.shape == (2, 3, 4, 6)
    assert (weights[0] > 0).all()
    assert (weights <= 1).all()
    assert not weights[1, 1:].any()
    assert weights[0].std(dim=(1, 2)).min() > 0  # cell by cell


def test_attention_is_a_partition_of_one_over_the_present():
    fuser, maps = CrossAttentionFuser(modalities=list(MODALITIES), channels=8), list(maps_of(3).values())
    present = torch.tensor([[True, True, True], [False, True, False], [False, False, False]])
    weights = fuser.weights(maps, present)
    assert weights.shape == (3, 3, 4, 4, 6)
    torch.testing.assert_close(weights[0].sum(0), torch.ones(4, 4, 6))
    assert weights[0].std(dim=(2, 3)).min() > 0
    assert (weights[1, 1] == 1).all()
    assert not weights[1, [0, 2]].any()
    assert not weights[2].any()


def test_heads_must_divide_the_channels():
    with pytest.raises(ValueError, match="6 channels do not divide into 4 heads"):
        make_fuser("cross_attention", modalities=["lidar"], channels=6)


@pytest.mark.parametrize("fuser", FUSERS)
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
    assert (masked[1] - full[1]).abs().max() > 1e-5
