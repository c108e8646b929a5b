from dataclasses import replace

import pytest
import torch

from fusion_net.models.encoders.image_network import normalized
from tests.fixtures.random_batch import load_model, random_batch


@pytest.fixture
def network():
    torch.manual_seed(1)
    return load_model().encoders["camera"].image_network.train()


@pytest.fixture
def batch():
    return random_batch(3, grid=load_model().grid)


def test_a_colour_matrix_acts_on_rgb_before_normalization(batch):
    twice = torch.tensor([[2.0, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 10]]).expand(3, 3, 4)
    wanted = (batch.images.float() * 2 + torch.tensor([0.0, 0, 10]).view(3, 1, 1)).clamp(0, 255)
    torch.testing.assert_close(normalized(batch.images, twice), normalized(wanted))


def test_a_frozen_network_looks_at_a_sample_once_and_at_its_calibration_each_time(network, batch):
    network.freeze(True)
    seen = []
    network.backbone.register_forward_hook(lambda *_: seen.append(1))
    first = network(batch)
    again = network(replace(batch, images=torch.zeros_like(batch.images), colors=torch.ones(3, 3, 4)))
    assert len(seen) == 1
    assert torch.equal(first.features, again.features)
    assert torch.equal(first.depth_logits, again.depth_logits)
    mirrored = batch.ego_T_cam.clone()
    mirrored[:, :, 1] *= -1
    assert not torch.equal(network(replace(batch, ego_T_cam=mirrored)).depth_logits, first.depth_logits)
    assert torch.equal(network(batch).depth_logits, first.depth_logits)


def test_kept_features_are_those_of_the_images_in_any_order_of_the_samples(network, batch):
    network.freeze(True)
    direct = network(batch).features
    swapped = replace(batch, tokens=batch.tokens[::-1])
    assert torch.equal(network(swapped).features, direct.flip(0))


def test_thawing_forgets_and_evaluation_looks_again(network, batch):
    network.freeze(True)
    before, other = network(batch).features, replace(batch, images=255 - batch.images)
    network.eval()
    assert not torch.equal(network(other).features, before)
    network.train()
    network.freeze(False)
    network.freeze(True)
    assert not torch.equal(network(other).features, before)
