"""Decoding: maps of known objects come back as boxes."""

import numpy as np
import pytest
import torch

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.models.blocks.heading import is_forwards
from fusion_net.models.center_head import HEADINGS, CenterHead, regressions

GRID = BEVGrid(4.0, 44.0, -12.0, 20.0, 0.8)
CLASSES = ["truck", "pedestrian"]
NMS_RADIUS = {"truck": 3.5, "pedestrian": 0.4}


def head(**options) -> CenterHead:
    settings = {"classes": CLASSES, "heading": "axis", "max_boxes": 100, "min_score": 0.0, "nms_radius": NMS_RADIUS}
    settings["variance_penalty"] = 0.0
    return CenterHead(grid=GRID, channels=4, hidden=4, **settings | options)


def perfect_maps(centers, labels, logits, *, yaw=0.7):
    """Maps with one peak an object, as a perfect network would make them; the heading in both ways."""
    maps = {"heatmap": torch.full((1, 2, *GRID.shape), -9.0)}
    for name, channels in (regressions("axis") | HEADINGS["sincos"]).items():
        maps[name] = torch.zeros(1, channels, *GRID.shape)
    for center, label, logit in zip(torch.tensor(centers), labels, logits, strict=True):
        row, column, _ = GRID.rows_columns(center[:2])
        maps["heatmap"][0, label, row, column] = logit
        maps["offset"][0, :, row, column] = center[:2] - GRID.centers()[row, column]
        maps["height"][0, 0, row, column] = center[2]
        maps["size"][0, :, row, column] = torch.tensor([1.9, 4.6, 1.5]).log()
        maps["rot"][0, :, row, column] = rot = torch.tensor([np.sin(yaw), np.cos(yaw)]).float()
        maps["axis"][0, :, row, column] = torch.tensor([np.sin(2 * yaw), np.cos(2 * yaw)]).float()
        maps["direction"][0, 0, row, column] = 1.0 if is_forwards(rot) else -1.0
        maps["velocity"][0, :, row, column] = torch.tensor([3.0, -1.0])
        maps["log_variance"][0, :, row, column] = torch.tensor([-2.0, 1.0])
    return maps


def test_boxes_come_back():
    centers, labels = [[10.3, -7.1, 0.9], [40.2, 19.3, 1.4], [22.0, 3.3, 0.8]], [0, 1, 0]
    boxes = head(min_score=0.1).decode(perfect_maps(centers, labels, [4.0, 3.0, 2.0], yaw=-2.5))[0]
    np.testing.assert_allclose(boxes.center, centers, atol=1e-5)
    assert boxes.label.tolist() == labels
    np.testing.assert_allclose(boxes.wlh, np.tile([1.9, 4.6, 1.5], (3, 1)), rtol=1e-5)
    np.testing.assert_allclose(boxes.yaw, -2.5, atol=1e-6)
    np.testing.assert_allclose(boxes.velocity, np.tile([3.0, -1.0], (3, 1)))
    np.testing.assert_allclose(boxes.log_variance, np.tile([-2.0, 1.0], (3, 1)))
    np.testing.assert_allclose(boxes.score, 1 / (1 + np.exp([-4.0, -3.0, -2.0])), rtol=1e-6)


@pytest.mark.parametrize("heading", HEADINGS)
@pytest.mark.parametrize("yaw", np.linspace(-3.1, 3.1, 12))
def test_every_heading_comes_back(heading, yaw):
    boxes = head(heading=heading, min_score=0.1).decode(perfect_maps([[10.3, -7.1, 0.9]], [0], [4.0], yaw=yaw))[0]
    assert np.exp(1j * boxes.yaw[0]) == pytest.approx(np.exp(1j * yaw), abs=1e-5)


def test_a_wrong_direction_turns_a_box_round():
    maps = perfect_maps([[10.3, -7.1, 0.9]], [0], [4.0], yaw=0.7)
    maps["direction"] *= -1
    assert np.exp(1j * head().decode(maps)[0].yaw[0]) == pytest.approx(-np.exp(0.7j), abs=1e-5)


def test_circle_nms_is_per_class_and_by_radius():
    """2.4 m apart: one truck (3.5 m), but two pedestrians (0.4 m)."""
    places = [[20.0, 0.0, 1.0], [20.0, 2.4, 1.0]]
    assert len(head(min_score=0.1).decode(perfect_maps(places, [0, 0], [3.0, 2.0]))[0]) == 1
    assert len(head(min_score=0.1).decode(perfect_maps(places, [1, 1], [3.0, 2.0]))[0]) == 2
    assert len(head(min_score=0.1).decode(perfect_maps(places, [0, 1], [3.0, 2.0]))[0]) == 2


def test_a_suppressed_box_suppresses_no_other():
    """A chain of trucks 3 m apart: the second falls to the first, the third stands."""
    places = [[20.0, 0.0, 1.0], [20.0, 3.0, 1.0], [20.0, 6.0, 1.0]]
    boxes = head(min_score=0.1).decode(perfect_maps(places, [0, 0, 0], [3.0, 2.0, 1.0]))[0]
    np.testing.assert_allclose(boxes.center[:, 1], [0.0, 6.0], atol=1e-5)


def test_best_first_and_capped():
    maps = {"heatmap": torch.randn(2, 2, *GRID.shape)}
    for name, channels in regressions("axis").items():
        maps[name] = torch.randn(2, channels, *GRID.shape)
    for boxes in head(max_boxes=30).decode(maps):
        assert 0 < len(boxes) <= 30
        assert (np.diff(boxes.score) <= 0).all()


def test_a_variance_penalty_prefers_the_better_placed_of_two():
    """Score times exp(-k sigma); at k = 0 the scores are those of the heat map."""
    maps = perfect_maps([[10.0, 0.0, 1.0], [30.0, 0.0, 1.0]], [0, 0], [2.0, 1.9])
    row, column, _ = GRID.rows_columns(torch.tensor([10.0, 0.0]))
    maps["log_variance"][0, :, row, column] = 2 * torch.tensor(1.5).log()
    plain, penal = (head(min_score=0.1, variance_penalty=k).decode(maps)[0] for k in (0.0, 0.4))
    np.testing.assert_allclose(plain.center[:, 0], [10.0, 30.0], atol=1e-4)
    np.testing.assert_allclose(penal.center[:, 0], [30.0, 10.0], atol=1e-4)
    assert penal.score[1] == pytest.approx(plain.score[0] * np.exp(-0.4 * 1.5), rel=1e-5)
    with pytest.raises(ValueError, match=r"variance_penalty=-1\.0 must be"):
        head(variance_penalty=-1.0)


def test_empty_maps_and_nan_logits_give_no_boxes():
    maps = perfect_maps([], [], [])
    maps["heatmap"][:] = -torch.inf
    assert len(head().decode(maps)[0]) == 0
    maps["heatmap"][:] = torch.nan
    assert len(head().decode(maps)[0]) == 0


def test_an_untrained_head_starts_at_the_prior():
    maps = head()(torch.zeros(2, 4, *GRID.shape))
    assert maps["heatmap"].sigmoid().mean().item() == pytest.approx(0.1, abs=0.02)


def test_unknown_class_is_named():
    with pytest.raises(ValueError, match="lorry"):
        head(classes=["lorry"])


def test_a_class_without_nms_radius_is_named():
    with pytest.raises(ValueError, match="nms_radius has no value for pedestrian"):
        head(nms_radius={"truck": 3.5})
