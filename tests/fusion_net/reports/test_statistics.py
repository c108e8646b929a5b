"""The statistics page on a hand-made tree whose every figure is known."""

import json
import re

import numpy as np
import pytest

from fusion_net.common.geometry import transform
from fusion_net.nuscenes.datasets import open_datasets, samples_of_split
from fusion_net.reports.dataset.summary import spread, summarize
from fusion_net.reports.dataset.survey import survey
from fusion_net.reports.statistics import write_statistics
from tests.fixtures.tiny_tree import ego_pose, write_tree


def beside(x, y, speed=0.0):
    """A place (x, y) in the ego frame of the first keyframe, from which it drives along global x."""
    start = transform(ego_pose(1.0), np.array([[x, y, 0.5]]))[0]
    return lambda t: start + np.array([speed * (t - 1.0), 0.0, 0.0])


BOXES = [
    {"category": "vehicle.car", "center": beside(12.0, 0.0), "points": 40, "frames": (0,)},
    {"category": "vehicle.car", "center": beside(32.0, 4.0, speed=8.0), "points": 10, "frames": (0, 1)},
    {
        "category": "human.pedestrian.adult",
        "center": beside(-8.0, 6.0),
        "points": 0,
        "frames": (0,),
        "size": [0.6, 0.5, 1.7],
    },
    {"category": "animal", "center": beside(5.0, 5.0), "frames": (0,)},  # no detection class
]


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    root = write_tree(tmp_path_factory.mktemp("statistics") / "tree", scenes=3, keyframes=2, boxes=BOXES)
    path = root / "v1.0-tiny" / "scene.json"
    scenes = json.loads(path.read_text())
    for scene, (name, severity) in zip(scenes, (("clear", 1), ("fog", 1), ("fog", 3)), strict=True):
        scene |= {"layout": "two_way", "condition": {"name": name, "severity": severity, "visibility": 100.0}}
    path.write_text(json.dumps(scenes))
    return root


@pytest.fixture(scope="module")
def found(root):
    return survey(samples_of_split(open_datasets(str(root)), "all"), files=300)


def test_every_box_is_counted_in_its_class_ring_and_condition(found):
    summary = summarize(found)
    assert (summary["scenes"], summary["keyframes"], summary["objects"]) == (3, 6, 3 * 4)
    car = summary["classes"]["car"]
    assert car["objects"] == 3 * 3
    assert car["range"][1] == 3  # at 12 m
    assert sum(car["range"][3:]) + sum(car["range"][2:3]) == 6
    assert car["lidar_points_by_range"][1] == 40
    assert car["lidar_points_by_range"][0] is None
    assert car["moving"] == 1.0  # the lone annotation has no velocity
    assert car["speed"]["p50"] == pytest.approx(8.0)
    assert summary["classes"]["pedestrian"]["range"][0] + summary["classes"]["pedestrian"]["range"][1] == 3
    assert summary["visibility"]["60-80 %"] == 12
    assert [(e["condition"], e["severity"], e["scenes"], e["objects"]) for e in summary["conditions"]] == [
        ("fog", 1, 1, 4),
        ("fog", 3, 1, 4),
        ("clear", 1, 1, 4),
    ]
    assert summary["layouts"] == {"two_way": 3}
    assert summary["classes"]["bus"]["lidar_points"]["mean"] is None


def test_files_are_opened_in_as_many_keyframes_as_asked_for(root, found):
    assert len(found.sensor_data) == 6
    assert found.image_size == (80, 48)
    assert len(survey(samples_of_split(open_datasets(str(root)), "all"), files=2).sensor_data) == 2
    sensor_data = found.sensor_data[0]
    assert sensor_data.radar_returns == [61, 61]  # the landmarks and the mover, each unit
    assert set(sensor_data.rcs.tolist()) == {10.0}
    assert 40 < sensor_data.brightness < 160


def test_the_page_stands_alone_and_the_figures_are_json(root, tmp_path, capsys):
    write_statistics(str(root), out=str(tmp_path), samples=3)
    assert "3 scenes, 6 keyframes, 12 objects" in capsys.readouterr().out
    page = (tmp_path / "statistics.html").read_text()
    sources = re.findall(r'src="([^"]{5})', page)
    assert len(sources) > 12
    assert set(sources) == {"data:"}
    assert "http" not in page
    assert json.loads((tmp_path / "statistics.json").read_text())["sensor_data"]["keyframes"] == 3


def test_a_real_tree_that_states_no_condition_has_a_page_too(tmp_path):
    root = write_tree(tmp_path / "real", scenes=1, keyframes=1)
    write_statistics(str(root), out=str(tmp_path))
    summary = json.loads((tmp_path / "statistics.json").read_text())
    assert summary["objects"] == 0
    assert summary["conditions"][0]["condition"] == "not stated"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"samples": 0}, "samples=0 is not a number of keyframes"),
        ({"root": "nowhere"}, "no data in nowhere"),
        ({"split": "vall"}, "no split 'vall'"),
    ],
)
def test_mistakes_are_named(root, options, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        write_statistics(**{"root": str(root), "out": str(tmp_path / "page")} | options)
    assert not (tmp_path / "page").exists()


def test_a_spread_of_nothing_is_null():
    assert spread([np.nan])["mean"] is None
    assert spread([1.0, np.nan, 3.0])["mean"] == 2.0
