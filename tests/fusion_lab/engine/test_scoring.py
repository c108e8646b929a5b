"""What a person would count in a keyframe."""

import numpy as np

from fusion_lab.engine.scoring import pairs
from fusion_net.common.boxes import Boxes


def boxes(*xy):
    count = len(xy)
    center = np.array([[x, y, 0.0] for x, y in xy], float).reshape(count, 3)
    return Boxes.labels(center, np.ones((count, 3)), np.zeros(count), np.zeros((count, 2)), np.zeros(count, np.int64))


def test_the_nearest_are_paired_and_none_twice():
    label, box = pairs(boxes((10, 0), (11, 0)), boxes((10.4, 0), (9.9, 0), (30, 0)))
    assert sorted(zip(label.tolist(), box.tolist(), strict=True)) == [(0, 1), (1, 0)]


def test_beyond_two_metres_nothing_is_found():
    assert len(pairs(boxes((10, 0)), boxes((12.1, 0)))[0]) == 0


def test_nothing_and_nobody():
    for labels, found in ((boxes(), boxes((1, 1))), (boxes((1, 1)), boxes()), (boxes(), boxes())):
        assert [len(rows) for rows in pairs(labels, found)] == [0, 0]
