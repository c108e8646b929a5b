"""What the camera sees, placed on the ground: it follows the calibration exactly."""

from dataclasses import replace

import numpy as np
import torch

from fusion_net.common.geometry import from_yaw, transform
from fusion_net.evaluation.audits import lifted
from tests.fixtures.small_model import camera_encoder, small_batch


def test_it_moves_with_the_mount(monkeypatch):
    monkeypatch.setattr(lifted, "LOWEST_SCORE", 0.0)  # an untrained network is sure of nothing
    camera, batch = camera_encoder().eval(), small_batch(4)
    moved = torch.tensor(from_yaw(np.radians(1.0), (0.0, 0.3, 0.0)), dtype=torch.float32)
    before = lifted.lifted_cells(camera, [batch])
    after = lifted.lifted_cells(camera, [replace(batch, ego_T_cam=moved @ batch.ego_T_cam)])
    for token in batch.tokens:
        assert len(before[token]) == batch.lidar_depth[0].numel()
        np.testing.assert_allclose(
            after[token].center, transform(moved.double().numpy(), before[token].center), atol=0.1
        )


def test_cells_without_a_depth_and_without_an_object_are_left_out():
    batch = small_batch(2)
    assert not any(map(len, lifted.lifted_cells(camera_encoder(depth_source="uniform").eval(), [batch]).values()))
    assert set(lifted.lifted_cells(camera_encoder().eval(), [batch])) == set(batch.tokens)
