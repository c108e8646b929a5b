import json
import shutil

import numpy as np
import pytest

from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.tiny_tree import ego_pose, write_tree

CAR, PERSON = "vehicle.car", "human.pedestrian.adult"


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    boxes = [
        {"category": CAR, "center": lambda t: (40 + 3 * t * t, 10 - t, 1), "attribute": "vehicle.moving"},
        {"category": PERSON, "center": lambda t: (30, 4, 1), "frames": [1], "size": [0.5, 0.6, 1.8]},
        {"category": CAR, "center": lambda t: (50 + t, 4, 1), "frames": [0, 4]},  # 2 s apart: one-sided limit is 1.5
        {"category": CAR, "center": lambda t: (60 + t, 4, 1), "frames": [0, 2, 4]},
        {"category": "movable_object.debris", "center": lambda t: (30, 4, 1)},
        {"category": CAR, "center": lambda t: (20, 4, 1), "yaw": lambda t: -2.5, "points": 0},
    ]
    return NuScenes(write_tree(tmp_path_factory.mktemp("tree"), scenes=3, keyframes=5, boxes=boxes))


def test_splits_are_samples_by_scene_and_time_and_short_names_resolve(tree):
    assert tree.split("tiny_train") == [f"scene-{s:04d}-{k}" for s in (0, 1) for k in range(5)]
    assert tree.split("val") == tree.split("tiny_val") == [f"scene-0002-{k}" for k in range(5)]
    assert len(tree.split("all")) == 15
    assert tree.scene("scene-0002-3")["name"] == "scene-0002"
    with pytest.raises(ValueError, match=r"no split 'valid'; there are tiny_train, tiny_val, all"):
        tree.split("valid")


def test_velocity_is_the_difference_of_the_neighbours_and_one_sided_at_the_ends(tree):
    velocity = [tree.annotations(f"scene-0000-{k}", ["car"]).boxes.velocity[0] for k in range(5)]
    time = 1.0 + 0.5 * np.arange(5)
    x = 40 + 3 * time**2
    expected = [(x[1] - x[0]) / 0.5, *(x[2:] - x[:-2]), (x[4] - x[3]) / 0.5]
    np.testing.assert_allclose(velocity, np.stack([expected, np.full(5, -1.0)], axis=1), atol=1e-6)


def test_velocity_is_unknown_for_a_lone_annotation_and_over_a_long_gap(tree):
    assert np.isnan(tree.annotations("scene-0000-1", ["pedestrian"]).boxes.velocity).all()
    assert np.isnan(tree.annotations("scene-0000-0", ["car"]).boxes.velocity[1]).all()  # 2.0 s, one-sided
    np.testing.assert_allclose(tree.annotations("scene-0000-2", ["car"]).boxes.velocity[1], (1, 0), atol=1e-6)  # 2.0 s


def test_labels_index_the_given_classes_and_other_categories_are_left_out(tree):
    found = tree.annotations("scene-0001-1", ["truck", "pedestrian", "car"])
    assert found.boxes.label.tolist() == [2, 1, 2]
    assert found.attribute.tolist() == ["vehicle.moving", "", ""]
    assert found.visibility.tolist() == [3, 3, 3]
    assert found.num_pts.tolist() == [5, 5, 0]
    assert len(tree.annotations("scene-0001-1", ["bus"])) == 0
    np.testing.assert_allclose(found.boxes.wlh[1], (0.5, 0.6, 1.8))
    assert found.boxes.yaw[2] == pytest.approx(-2.5)


def test_poses_are_those_written(tree):
    record = tree.keyframes["scene-0001-2"]["CAM_FRONT"]
    np.testing.assert_allclose(tree.global_T_ego(record), ego_pose(2.0 - 0.02), atol=1e-9)


def test_firings_go_back_over_keyframes_and_end_at_the_scene(tree):
    stamps = [record["timestamp"] for record in tree.keyframe_and_sweeps("scene-0001-1", "RADAR_FRONT", 9)]
    assert (np.diff(stamps) < 0).all()
    assert len(stamps) == 6
    assert len(tree.keyframe_and_sweeps("scene-0001-1", "RADAR_FRONT", 2)) == 3
    assert tree.keyframe_and_sweeps("scene-0001-1", "RADAR_BACK", 2) == []


def test_missing_folder_names_the_command(tmp_path):
    with pytest.raises(ValueError, match=r"no data in .*nano.*python -m data_gen data=nano"):
        NuScenes(tmp_path / "nano")


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda root: (root / "manifest.json").write_text('{"complete": false}'), "is half generated"),
        (lambda root: (root / "manifest.json").write_text('{"compl'), r"manifest.json is damaged or cut short"),
        (lambda root: (root / "v1.0-tiny").rename(root / "tables"), r"needs a folder v1.0-\* of tables and has none"),
        (lambda root: shutil.copytree(root / "v1.0-tiny", root / "v1.0-mini"), r"versions v1.0-mini, v1.0-tiny"),
        (lambda root: (root / "v1.0-tiny/ego_pose.json").unlink(), r"v1.0-tiny lacks ego_pose.json"),
        (lambda root: (root / "v1.0-tiny/sample.json").write_text('{"a": 1}'), "sample.json is not a nuScenes table"),
        (
            lambda root: (root / "v1.0-tiny/calibrated_sensor.json").write_text("[]"),
            r"sample_data.json: the record .*'calib",
        ),
        (lambda root: _cut(root / "v1.0-tiny/sample_data.json"), r"sample_data.json is damaged or cut short"),
    ],
)
def test_a_spoilt_tree_gives_one_line_that_names_the_file(tmp_path, spoil, message):
    root = write_tree(tmp_path, scenes=1, keyframes=1)
    spoil(root)
    with pytest.raises(ValueError, match=message) as error:
        NuScenes(root)
    assert "\n" not in str(error.value)


def test_split_of_an_unknown_scene_is_named(tmp_path):
    root = write_tree(tmp_path, scenes=1, keyframes=1)
    (root / "v1.0-tiny/splits.json").write_text(json.dumps({"tiny_val": ["scene-0007"]}))
    with pytest.raises(ValueError, match=r"scene.json lacks 'scene-0007'"):
        NuScenes(root).split("val")


def _cut(path):
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
