import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_gen.road.track import Track


def test_a_constant_speed_is_exact_between_records_and_beyond():
    times = np.array([0.0, 0.4, 1.0])
    velocity = np.array([20.0, -3.0, 0.0])
    track = Track(times, times[:, None] * velocity, np.zeros(3), np.tile(velocity, (3, 1)))
    at = np.array([-0.5, 0.05, 0.7, 1.0, 2.0])
    position, _, speed = track.at(at)
    assert position == pytest.approx(at[:, None] * velocity)
    assert speed == pytest.approx(np.tile(velocity, (5, 1)))


def test_velocity_is_the_derivative_of_position():
    times = np.linspace(0, 2, 9)
    path = np.stack([10 * np.sin(times), 5 * np.cos(times), 0 * times], axis=1)
    rate = np.stack([10 * np.cos(times), -5 * np.sin(times), 0 * times], axis=1)
    track = Track(times, path, np.unwrap(np.arctan2(rate[:, 1], rate[:, 0])), rate)
    t, h = np.linspace(0.1, 1.9, 40), 1e-5
    slope = (track.at(t + h)[0] - track.at(t - h)[0]) / (2 * h)
    assert track.at(t)[2] == pytest.approx(slope, abs=1e-4)
    assert np.abs(track.at(t)[0][:, 0] - 10 * np.sin(t)).max() < 1e-3


@given(st.floats(-5, 5), st.floats(-3, 3))
def test_a_body_at_rest_stays(t, yaw):
    position, heading, velocity = Track.static((3.0, -2.0, 0.5), yaw).at(t)
    assert position.tolist() == [3.0, -2.0, 0.5]
    assert heading == yaw
    assert not velocity.any()


def test_pose_maps_the_forward_axis_along_the_heading():
    track = Track.static((1.0, 2.0, 0.0), np.pi / 2)
    assert track.pose(7.0) @ [2.0, 0.5, 0.0, 1.0] == pytest.approx([0.5, 4.0, 0.0, 1.0])
