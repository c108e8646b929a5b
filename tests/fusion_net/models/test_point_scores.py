"""Class scores at the returns of other sensors: the right pixel, the right cell, and nothing from an absent sensor."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fusion_net.common import geometry
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.models.encoders.point_scores import RADAR_HEIGHTS, point_scores
from tests.fixtures.small_model import GRID, small_batch, small_model

CLASSES, STRIDE, SIZE = 3, 8, (6, 10)


def scores_of(batch, seed=0):
    rng = torch.Generator().manual_seed(seed)
    return torch.rand(batch.size, batch.images.shape[1], *SIZE, CLASSES, generator=rng)


def scored(batch, scores):
    lidar, radar = point_scores(scores, batch, grid=GRID, stride=STRIDE).split(CLASSES + 1, dim=1)
    return {"lidar": lidar, "radar": radar}


def expected_map(batch, scores, points, owner):
    """The mean over points and cameras, one by one, with the reference projection."""
    total, count = np.zeros((batch.size, *GRID.shape, CLASSES)), np.zeros((batch.size, *GRID.shape, 1))
    for point, sample in zip(points.double().numpy(), owner.tolist(), strict=True):
        row, column, inside = GRID.rows_columns(torch.tensor(point[:2]))
        for n in range(scores.shape[1] if inside else 0):
            cam_T_ego = np.linalg.inv(batch.ego_T_cam[sample, n].double().numpy())
            in_camera = geometry.transform(cam_T_ego, point[None, :3])
            pixel, depth = geometry.project(batch.cam_K[sample, n].double().numpy(), in_camera)
            u, v = np.floor(np.nan_to_num(pixel[0], nan=-1) / STRIDE).astype(int)
            if depth[0] > 0 and 0 <= u < SIZE[1] and 0 <= v < SIZE[0]:
                total[sample, row, column] += scores[sample, n, v, u].numpy()
                count[sample, row, column] += 1
    found = np.concatenate([total / np.maximum(count, 1), count > 0], axis=-1)
    return torch.tensor(found).float().permute(0, 3, 1, 2)


@pytest.mark.parametrize("cameras", [1, 2])
def test_a_cell_holds_the_mean_score_of_the_pixels_its_points_fall_on(cameras):
    batch = small_batch(cameras=cameras)
    scores = scores_of(batch)
    found = scored(batch, scores)
    expected = expected_map(batch, scores, batch.lidar_points, batch.lidar_batch)
    assert expected[:, -1].sum() > 100
    torch.testing.assert_close(found["lidar"], expected, rtol=1e-4, atol=1e-5)

    raised = [batch.radar_points[:, :3].clone() for _ in RADAR_HEIGHTS]
    for points, height in zip(raised, RADAR_HEIGHTS, strict=True):
        points[:, 2] = height
    expected = expected_map(batch, scores, torch.cat(raised), batch.radar_batch.repeat(len(RADAR_HEIGHTS)))
    torch.testing.assert_close(found["radar"], expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("name", ["camera", "lidar", "radar"])
def test_an_absent_sensor_gives_zeros(name):
    batch = small_batch(radar=100)
    batch.present[1, MODALITIES.index(name)] = False
    found = scored(batch, scores_of(batch))
    assert found["lidar"][1].any() == (name == "radar")
    assert found["radar"][1].any() == (name == "lidar")
    assert found["lidar"][0].any()
    assert found["radar"][0].any()


@pytest.mark.parametrize("training", [True, False])
@pytest.mark.parametrize("name", ["lidar", "radar"])
def test_nothing_that_an_absent_sensor_holds_gets_through(name, training):
    """Any content, NaN included, of the absent sensor gives the same maps."""
    model = small_model(point_scores=True, names=["camera"]).train(training)
    batch = small_batch()
    absent = batch.present & (torch.arange(3) != MODALITIES.index(name))
    points = getattr(batch, f"{name}_points")
    contents = [points, torch.rand_like(points) * 20, torch.full_like(points, torch.nan), points[:0]]
    owners = [getattr(batch, f"{name}_batch")] * 3 + [getattr(batch, f"{name}_batch")[:0]]
    with torch.no_grad():
        first, *others = (
            model(replace(batch, **{f"{name}_points": p, f"{name}_batch": o}), absent).maps["heatmap"]
            for p, o in zip(contents, owners, strict=True)
        )
    for other in others:
        assert torch.equal(first, other)


def test_returns_change_the_map_of_a_camera_beside_a_lidar():
    model, batch = small_model(point_scores=True).eval(), small_batch()
    moved = replace(batch, lidar_points=batch.lidar_points * torch.tensor([1, -1, 1, 1, 1]))
    with torch.no_grad():
        first, second = (model.encoders["camera"](b).bev for b in (batch, moved))
    assert (first - second).abs().max() > 1e-3


def test_class_scores_learn_nothing_from_the_map():
    model, batch = small_model(point_scores=True, lift_class_scores=False), small_batch()
    encoder = model.encoders["camera"]
    predictions = encoder.perceive(batch)
    predictions.class_logits.retain_grad()
    encoder.lift(predictions, batch).square().sum().backward()
    assert predictions.class_logits.grad is None


def test_no_points_at_all():
    batch = small_batch(lidar=0, radar=0)
    assert not point_scores(scores_of(batch), batch, grid=GRID, stride=STRIDE).any()
