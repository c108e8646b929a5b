import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion_net.common import geometry as g

angle = st.floats(-3.0, 3.0)


@given(angle, st.floats(-1.4, 1.4), angle)
def test_inverse_undoes_a_pose(roll, pitch, yaw):
    a_T_b = g.from_rpy(roll, pitch, yaw, (3.0, -2.0, 1.0))
    assert g.invert(a_T_b) @ a_T_b == pytest.approx(np.eye(4), abs=1e-12)


@given(angle, st.floats(-1.4, 1.4), angle)
def test_quaternion_round_trip(roll, pitch, yaw):
    a_T_b = g.from_rpy(roll, pitch, yaw, (3.0, -2.0, 1.0))
    assert g.from_quaternion(g.to_quaternion(a_T_b), a_T_b[:3, 3]) == pytest.approx(a_T_b, abs=1e-12)


def test_yaw_is_counter_clockwise_and_positive_pitch_looks_down():
    assert g.transform(g.from_yaw(np.pi / 2), [[1.0, 0.0, 0.0]]) == pytest.approx(np.array([[0.0, 1.0, 0.0]]))
    assert g.transform(g.from_rpy(0, 0.1, 0), [[1.0, 0.0, 0.0]])[0, 2] < 0


@given(angle)
def test_turning_vectors_is_the_pose_without_its_place_and_its_heading_comes_back(yaw):
    vectors = np.array([[1.0, 0.0, 0.0], [2.0, -3.0, 0.5]])
    assert g.rotate_yaw(vectors, yaw) == pytest.approx(g.transform(g.from_yaw(yaw), vectors))
    assert g.rotate_yaw(vectors, np.array([np.pi / 2, 0.0])) == pytest.approx(np.array([[0.0, 1, 0], [2, -3, 0.5]]))
    assert g.yaw_of(g.from_yaw(yaw)) == pytest.approx(yaw)


@given(st.floats(0.5, 80), st.floats(-5, 5), st.floats(-3, 3))
def test_unproject_undoes_project(z, x, y):
    cam_K = np.array([[220.0, 0, 163], [0, 210.0, 44], [0, 0, 1]])
    point = np.array([[x, y, z]])
    pixel, depth = g.project(cam_K, point)
    assert g.unproject(cam_K, pixel, depth) == pytest.approx(point, abs=1e-9)


def test_behind_the_camera_projects_nowhere():
    pixel, depth = g.project(np.eye(3), [[1.0, 1.0, -2.0], [1.0, 1.0, 0.0]])
    assert np.isnan(pixel).all()
    assert depth.tolist() == [-2.0, 0.0]


@given(st.floats(-50, 50))
def test_wrapped_angles_are_in_range_and_equal_up_to_turns(a):
    wrapped = g.wrap_angle(a)
    assert -np.pi <= wrapped < np.pi
    assert np.cos(wrapped - a) == pytest.approx(1.0)
