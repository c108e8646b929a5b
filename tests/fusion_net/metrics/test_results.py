"""The result file: what is written is what is read, and what the format asks for is there."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion_net.common.boxes import Boxes
from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.metrics.results import ATTRIBUTES, MOVING_SPEED, attributes_of, predicted, read_results, write_results

CAR_AND_CONE = ["car", "traffic_cone"]


def boxes(n, seed=0, classes=CLASSES):
    rng = np.random.default_rng(seed)
    return Boxes(
        rng.uniform(-50, 50, (n, 3)), rng.uniform(0.3, 6, (n, 3)), rng.uniform(-np.pi, np.pi, n), rng.normal(0, 5, (n, 2)),
        rng.integers(0, len(classes), n), rng.uniform(0.01, 1, n), np.zeros((n, 2)),
    )  # fmt: skip


@settings(max_examples=20)
@given(st.lists(st.integers(0, 6), min_size=1, max_size=4), st.integers(0, 1000))
def test_round_trip(tmp_path_factory, sizes, seed):
    path = tmp_path_factory.mktemp("results") / "results_nusc.json"
    tokens = [f"token{i}" for i in range(len(sizes))]
    found = predicted([boxes(n, seed + i) for i, n in enumerate(sizes)], CLASSES)
    write_results(path, found, tokens=tokens, classes=CLASSES)
    read = read_results(path, tokens=tokens, classes=CLASSES)
    for name in ("center", "wlh", "velocity", "label", "score"):
        np.testing.assert_array_equal(getattr(read.boxes, name), getattr(found.boxes, name))
    np.testing.assert_allclose(np.cos(read.boxes.yaw - found.boxes.yaw), 1)
    np.testing.assert_array_equal(read.sample, found.sample)
    np.testing.assert_array_equal(read.attribute, found.attribute)


def test_format(tmp_path):
    found = boxes(3, classes=CAR_AND_CONE)
    found = replace(found, velocity=np.full((3, 2), np.nan))
    table = predicted([Boxes.empty(), found], CAR_AND_CONE)
    write_results(tmp_path / "r.json", table, tokens=["a", "b"], classes=CAR_AND_CONE, sensors=("camera", "radar"))
    text = (tmp_path / "r.json").read_text()
    assert "NaN" not in text
    written = json.loads(text)
    assert written["results"]["a"] == []  # a sample without boxes is a key all the same
    assert written["meta"] == {
        "use_camera": True, "use_lidar": False, "use_radar": True, "use_map": False, "use_external": False
    }  # fmt: skip
    for box in written["results"]["b"]:
        assert box["sample_token"] == "b"
        assert "num_pts" not in box  # the devkit would drop a box that says 0
        assert box["detection_name"] in CAR_AND_CONE
        assert np.hypot(*np.array(box["rotation"])[[0, 3]]) == pytest.approx(1)


def test_only_the_best_500_are_kept_in_their_order():
    many = boxes(700)
    kept = predicted([many], CLASSES).boxes
    assert len(kept) == 500
    assert kept.score.min() >= np.sort(many.score)[200]
    np.testing.assert_array_equal(kept.score, many.score[np.isin(many.score, kept.score)])


def test_attribute_follows_from_speed():
    speed = np.repeat([0.0, MOVING_SPEED + 0.01, np.nan], len(CLASSES))
    label = np.tile(np.arange(len(CLASSES)), 3)
    given = Boxes.labels(np.zeros((30, 3)), np.ones((30, 3)), np.zeros(30), np.column_stack([speed, 0 * speed]), label)
    moving, standing = np.array([ATTRIBUTES[name] for name in CLASSES]).T
    np.testing.assert_array_equal(attributes_of(given, CLASSES), [*standing, *moving, *standing])
    assert attributes_of(Boxes.empty(), CLASSES).shape == (0,)


def test_another_split_and_a_damaged_file_are_refused(tmp_path):
    path = tmp_path / "r.json"
    write_results(path, predicted([Boxes.empty()], CLASSES), tokens=["a"], classes=CLASSES)
    with pytest.raises(ValueError, match=r"lacks 1 of 2 samples.*'b'"):
        read_results(path, tokens=["a", "b"], classes=CLASSES)
    path.write_text(path.read_text()[:-5])
    with pytest.raises(ValueError, match="not a nuScenes result file"):
        read_results(path, tokens=["a"], classes=CLASSES)
