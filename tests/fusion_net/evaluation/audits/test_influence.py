"""What a network listens to: nothing of a sensor whose map it throws away."""

import pytest
import torch

from fusion_net.evaluation.audits.influence import influence
from tests.fixtures.small_model import small_batch, small_model


def test_a_sensor_whose_map_the_fuser_throws_away_has_no_share():
    model, batch = small_model().eval(), small_batch()
    columns = model.bev_channels
    with torch.no_grad():
        model.fuser.mix.weight[:, :columns] = 0.0  # the camera comes first
    before = [weight.clone() for weight in model.parameters()]
    heard = influence(model, [batch])
    assert heard["camera"]["share"] == heard["camera"]["gradient"] == 0.0
    assert heard["camera"]["activation"] > 0
    assert heard["lidar"]["share"] > 0
    assert sum(each["share"] for each in heard.values()) == pytest.approx(1.0)
    assert all(torch.equal(a, b) for a, b in zip(before, model.parameters(), strict=True))
    assert all(weight.grad is None for weight in model.parameters())
    assert not any(encoder._forward_hooks for encoder in model.encoders.values())


def test_a_sensor_that_is_absent_adds_nothing():
    model, batch = small_model(names=("lidar", "radar")).eval(), small_batch()
    batch.present[:, 2] = False
    heard = influence(model, [batch])
    assert heard["radar"] == {"activation": 0.0, "gradient": 0.0, "share": 0.0}
    assert heard["lidar"]["share"] == 1.0
