"""Fusers: weights, and what a sensor that is absent may change."""

from dataclasses import replace

import pytest
import torch

from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.models.fuser import AverageFuser, ConcatFuser
from tests.fixtures.small_model import (
    small_batch,
    small_model,
)


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
