"""The lesson's figures, made of what the network did."""

import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fusion_lab.engine.state import first_state
from fusion_lab.views import merge_point, paint, pixel_depth, scale, shared_grid
from fusion_lab.views.overlay import on_camera, on_ground
from fusion_lab.views.screen import VIEWS, draw, figure


@pytest.fixture
def answer(lab):
    return lab.answer(replace(first_state(lab.offer), threshold=0.05))


def with_state(answer, **fields):
    return replace(answer, state=replace(answer.state, **fields))


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize(
    "broken", [{}, {"camera": "dead"}, {"lidar": "dead"}, {"camera": "dead", "lidar": "dead", "radar": "dead"}]
)
def test_every_view_says_something_whatever_is_broken(lab, view, broken):
    screen = draw(lab, replace(first_state(lab.offer), view=view, **broken))
    assert screen.panel
    assert "nan" not in screen.panel
    assert screen.camera.file[:2] == screen.ground.file[:2] == b"\xff\xd8"


def test_without_an_offset_no_point_is_mispainted_and_with_one_some_are(answer):
    def mispainted(offset):
        return int(re.search(r"<strong>(\d+)</strong>", paint.content(with_state(answer, offset=offset)).panel)[1])

    assert mispainted(0.0) == 0
    off, _ = paint._pixels(answer, np.array([[12.0, 0.5, 1.0]]), 0.5)
    exact, _ = paint._pixels(answer, np.array([[12.0, 0.5, 1.0]]), 0.0)
    focal = answer.sample.cam_K[0][0, 0]
    assert abs(off[0, 0] - exact[0, 0]) == pytest.approx(focal * np.tan(np.radians(0.5)), rel=0.1)


@given(st.floats(0.0, 4.0), st.integers(0, 100))
def test_a_sharpened_distribution_is_one_and_keeps_its_order(power, seed):
    logits = torch.randn(20, generator=torch.Generator().manual_seed(seed))
    sharp = pixel_depth.sharpened(logits, power)
    assert float(sharp.sum()) == pytest.approx(1.0, abs=1e-5)
    order = logits.argsort()
    assert (sharp[order].diff() >= -1e-7).all()


def test_no_confidence_is_flat_and_power_one_is_what_the_network_says():
    logits = torch.tensor([0.0, 1.0, 3.0])
    torch.testing.assert_close(pixel_depth.sharpened(logits, 0.0), torch.full((3,), 1 / 3))
    torch.testing.assert_close(pixel_depth.sharpened(logits, 1.0), logits.softmax(0))


def test_the_lessons_person_and_sign_fill_the_same_pixels(answer):
    panel = scale.content(with_state(answer, metres=30.0)).panel
    assert panel.count("= 50.0") == 2


def test_the_grid_shows_the_maps_of_the_sensors_that_are_there(lab, answer):
    camera, lidar = (shared_grid.content(with_state(answer, layer=name)).picture for name in ("camera", "lidar"))
    assert camera[..., 0].any()
    assert lidar[..., 1].any()
    assert (camera != lidar).any()
    dead = lab.answer(replace(answer.state, lidar="dead"))
    assert "no map" in shared_grid.content(dead).panel


def test_what_is_handed_over_shrinks_and_what_was_computed_grows_from_early_to_late(answer):
    ms, kilobytes = merge_point.milliseconds(answer), merge_point.sizes(answer)
    assert ms["early"] < ms["mid"] < ms["late"]
    assert sum(kilobytes["late"].values()) < sum(kilobytes["mid"].values())
    assert kilobytes["early"]["camera"] * 1e3 == answer.sample.images.nbytes


def test_every_box_lies_on_the_ground_and_says_what_it_is(answer):
    drawn = on_ground(answer)
    assert drawn.count('<g class="label"') == len(answer.sample.boxes)
    assert drawn.count('<g class="found"') == len(answer.shown)
    assert drawn.count("<title>detection: ") == len(answer.shown)
    assert on_camera(answer).count("<title>label: ") <= len(answer.sample.boxes)


@pytest.mark.parametrize(
    ("now", "plain", "good", "words"),
    [
        (0.5, 0.7, 1, 'class="worse">\N{MINUS SIGN}0.20'),
        (3.0, 1.0, -1, 'class="worse">+2.00'),
        (0.7, 0.5, 1, 'class="better">+0.20'),
        (0.5, 0.501, 1, "0.50</b>"),
    ],
)
def test_a_figure_says_whether_its_change_is_for_the_worse(now, plain, good, words):
    assert words in figure("x", now, plain, "{:.2f}", good=good)


def test_a_figure_that_is_not_defined_is_none():
    assert "<b>none</b>" in figure("x", float("nan"), 0.5, "{:.2f}", good=1)
