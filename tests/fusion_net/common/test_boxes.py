import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion_net.common.boxes import Boxes, box_corners, points_in_box
from fusion_net.common.nuscenes_format import CATEGORY_TO_CLASS, CLASSES


def test_every_class_has_a_category():
    assert set(CATEGORY_TO_CLASS.values()) == set(CLASSES)


def test_length_lies_along_the_heading():
    corners = box_corners(np.array([[10.0, 5.0, 1.0]]), np.array([[2.0, 6.0, 1.5]]), np.array([np.pi / 2]))[0]
    assert np.ptp(corners, axis=0) == pytest.approx([2.0, 6.0, 1.5])
    assert corners[:4, 1] == pytest.approx(8.0)  # the front face points to +y
    assert corners.mean(axis=0) == pytest.approx([10.0, 5.0, 1.0])


@given(st.floats(-3, 3), st.floats(-0.49, 0.49), st.floats(-0.49, 0.49), st.floats(-0.49, 0.49))
def test_what_is_inside_stays_inside_however_the_box_turns(yaw, along, across, up):
    center, wlh = np.array([4.0, -7.0, 0.8]), np.array([1.9, 4.5, 1.6])
    c, s = np.cos(yaw), np.sin(yaw)
    local = np.array([along * wlh[1], across * wlh[0]])
    point = center + np.array([c * local[0] - s * local[1], s * local[0] + c * local[1], up * wlh[2]])
    outside = center + np.array([c * wlh[1] * 0.6, s * wlh[1] * 0.6, 0.0])
    assert points_in_box(np.stack([point, outside]), center, wlh, yaw).tolist() == [True, False]


def test_indexing_keeps_fields_together():
    boxes = Boxes.labels(np.eye(3), np.ones((3, 3)), np.arange(3.0), np.zeros((3, 2)), np.arange(3))
    kept = boxes[np.array([True, False, True])]
    assert len(kept) == 2
    assert kept.label.tolist() == [0, 2]
    assert len(Boxes.empty()) == 0
