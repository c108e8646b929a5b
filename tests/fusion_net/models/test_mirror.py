"""Seen once more in the mirror: the mean of both answers is that of the mirrored scene, mirrored."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.models.blocks.heading import axis_of, is_forwards, yaw_of
from fusion_net.models.blocks.mirror import mean_maps, mirrored, mirrored_maps
from fusion_net.models.fusion_net import look_mirrored
from tests.fixtures import small_model as small


@pytest.fixture
def even_grid(monkeypatch):
    """As wide to the left as to the right."""
    monkeypatch.setattr(small, "GRID", BEVGrid(2.0, 27.6, -12.8, 12.8, 0.8))


def answer(model, batch):
    with torch.no_grad():
        return model(batch).maps


@pytest.mark.parametrize("heading", ["axis", "sincos"])
def test_the_answer_to_the_mirrored_scene_is_the_mirrored_answer(even_grid, heading):
    model, batch = small.small_model(heading=heading).eval(), small.small_batch()
    alone = mirrored_maps(answer(model, mirrored(batch)))
    assert (alone["heatmap"] - answer(model, batch)["heatmap"]).abs().max() > 1e-3  # the network itself has two sides
    look_mirrored(model)
    one, other = answer(model, batch), mirrored_maps(answer(model, mirrored(batch)))
    for name in one:
        torch.testing.assert_close(other[name], one[name], atol=1e-4, rtol=1e-4, msg=name)


def test_learning_sees_no_mirror(even_grid):
    torch.manual_seed(0)
    model, batch = small.small_model(), small.small_batch()
    before = model(batch).maps["heatmap"]
    look_mirrored(model)
    torch.testing.assert_close(model(batch).maps["heatmap"], before)


def test_all_detectors_of_late_fusion_look_twice(even_grid):
    model = small.small_late()
    look_mirrored(model)
    assert all(detector.mirror_test for detector in model.detectors.values())


def test_a_grid_with_two_sides_is_refused():
    with pytest.raises(ValueError, match="not as wide to the left as to the right"):
        look_mirrored(small.small_model())


@given(yaw=st.floats(-3.1, 3.1))
def test_a_heading_is_mirrored(yaw):
    rot = torch.tensor([[math.sin(yaw), math.cos(yaw)]])
    sincos = {"rot": rot[..., None, None].clone()}
    axis = {
        "axis": axis_of(rot)[..., None, None],
        "direction": torch.where(is_forwards(rot), 2.0, -2.0)[:, None, None, None],
    }
    sine, cosine = mirrored_maps(sincos)["rot"].flatten()
    assert math.atan2(sine, cosine) == pytest.approx(-yaw, abs=1e-5)
    turned = mirrored_maps(axis)
    found = yaw_of(turned["axis"][0, :, 0, 0], turned["direction"][0, 0, 0, 0])
    assert math.cos(float(found) + yaw) == pytest.approx(1, abs=1e-5)


def test_of_opposite_headings_the_surer_one_is_taken_and_of_near_ones_the_mean():
    rot = torch.tensor([[0.0, 0.9], [0.0, 0.9]])[..., None, None]  # sin, cos of two samples
    other = torch.tensor([[0.1, -0.3], [0.4, 0.5]])[..., None, None]
    mean = mean_maps({"rot": rot}, {"rot": other})["rot"][..., 0, 0]
    torch.testing.assert_close(mean, torch.tensor([[0.0, 0.9], [0.2, 0.7]]))
