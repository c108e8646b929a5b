"""A body moves along its axis; a radar measures the part of it along the ray."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fusion_net.common.boxes import Boxes
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.models.blocks.doppler import with_doppler_speed
from tests.fixtures.small_model import small_batch, small_model


def car(*, x=20.0, y=5.0, yaw=0.3, velocity=(0.0, 0.0)) -> Boxes:
    """One box of 2 x 5 m."""
    return Boxes.labels(
        np.array([[x, y, 1.0]]), np.array([[2.0, 5.0, 1.5]]), np.array([yaw]), np.array([velocity]), np.array([0])
    )


def measured(places, velocity) -> np.ndarray:
    """Detections (R, 7) at places (R, 2), of bodies with one velocity, as a radar at the origin sees them."""
    places = np.asarray(places, float)
    ray = places / np.linalg.norm(places, axis=1, keepdims=True)
    radial = (ray @ np.asarray(velocity, float))[:, None] * ray
    zeros = np.zeros((len(places), 1))
    return np.hstack([places, zeros, zeros, radial, zeros]).astype(np.float32)


@given(
    speed=st.floats(-30, 30), yaw=st.floats(-3.1, 3.1), x=st.floats(5, 50), y=st.floats(-20, 20), turned=st.booleans()
)
def test_the_whole_velocity_follows_from_its_radial_part_and_the_axis(speed, yaw, x, y, turned):
    axis = np.array([np.cos(yaw), np.sin(yaw)])
    box = car(x=x, y=y, yaw=yaw + np.pi * turned, velocity=(1.0, 1.0))  # which end is in front does not matter
    place = np.array([[x, y]])
    found = with_doppler_speed(box, measured(place, speed * axis)).velocity[0]
    if abs(axis @ place[0]) / np.hypot(x, y) >= 0.5:
        assert found == pytest.approx(speed * axis, abs=2e-4 * max(1, abs(speed)))
    else:  # it crosses the ray, which tells hardly anything
        assert found.tolist() == [1.0, 1.0]


@pytest.mark.parametrize(
    ("speed", "is_turned"), [(-8.0, True), (-0.6, True), (-0.4, False), (0.0, False), (8.0, False)]
)
def test_a_box_that_would_drive_backwards_is_turned_round(speed, is_turned):
    yaw = 0.3
    velocity = speed * np.array([np.cos(yaw), np.sin(yaw)])
    found = with_doppler_speed(car(yaw=yaw), measured([[20.0, 5.0]], velocity))
    assert np.cos(found.yaw[0] - yaw) == pytest.approx(-1.0 if is_turned else 1.0)
    assert abs(found.yaw[0]) <= np.pi
    assert found.velocity[0] == pytest.approx(velocity, abs=1e-4)


def test_most_detections_decide():
    """A car that passes within the margin of a parked one does not set it in motion, nor does the road below stop it."""
    box = car(yaw=0.0, velocity=(2.0, 0.0))
    moving = measured([[19, 5], [20, 5], [21, 5]], [10.0, 0.0])
    standing = measured([[19, 4], [20, 4], [21, 4], [22, 4]], [0.0, 0.0])
    assert with_doppler_speed(box, np.vstack([moving, standing[:2]])).velocity[0] == pytest.approx(
        [10.0, 0.0], abs=1e-4
    )
    assert with_doppler_speed(box, np.vstack([moving, standing])).velocity[0] == pytest.approx([0.0, 0.0], abs=1e-4)


def test_without_detections_on_it_a_box_keeps_its_velocity():
    box = car(velocity=(3.0, 1.0))
    for detections in (measured(np.zeros((0, 2)), [0, 0]), measured([[40.0, -10.0]], [5.0, 0.0])):
        assert with_doppler_speed(box, detections).velocity.tolist() == [[3.0, 1.0]]
    assert len(with_doppler_speed(Boxes.empty(), measured([[20.0, 5.0]], [5.0, 0.0]))) == 0


def test_the_model_uses_the_detections_of_samples_that_have_a_radar_and_no_other():
    batch = small_batch()
    plain, doppler = (small_model(doppler_speed=on).eval() for on in (False, True))
    present = batch.present.clone()
    present[1, MODALITIES.index("radar")] = False
    with torch.no_grad():
        outputs = doppler(batch, present)
        kept, found = plain.decode(plain(batch, present)), doppler.decode(outputs)
    assert len(outputs.detections[1]) == 0
    assert np.array_equal(kept[1].velocity, found[1].velocity)
    assert not np.array_equal(kept[0].velocity, found[0].velocity)
    for a, b in zip(kept, found, strict=True):  # nothing else changes
        assert np.array_equal(a.center, b.center)
        assert np.array_equal(a.score, b.score)
    for b, (boxes, seen) in enumerate(zip(kept, outputs.detections, strict=True)):  # a batch is its samples one by one
        assert np.array_equal(with_doppler_speed(boxes, seen).velocity, found[b].velocity)


def test_training_needs_no_detections_beside_the_maps():
    model = small_model(doppler_speed=True).train()
    batch = small_batch()
    assert model(batch).detections == ()
    assert model.eval()(
        replace(batch, radar_points=batch.radar_points[:0], radar_batch=batch.radar_batch[:0])
    ).detections
