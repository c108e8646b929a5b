"""Frames of a recording: whatever time is shown, what a sensor measured lies where it was measured."""

import numpy as np
import pytest

from fusion_net.common.geometry import from_rpy, invert, transform
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.nuscenes.sensor_files import read_lidar
from fusion_net.viz.rerun_log.readings import Scene, held
from fusion_net.viz.rerun_log.status import SOUND, changes, description
from tests.fixtures.tiny_tree import LANDMARKS, MOUNTS, START, ego_pose, write_tree


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return scene_of(write_tree(tmp_path_factory.mktemp("tree") / "tree", scenes=1, keyframes=3))


def scene_of(root, **options):
    nusc = NuScenes(root)
    return Scene(nusc, nusc.get("scene", "scene-0000"), nusc.split("all"), **options)


def test_every_firing_is_there_at_its_own_time_and_pose(scene):
    assert [reading.stamp for reading in scene.readings] == sorted(reading.stamp for reading in scene.readings)
    assert len(scene.of("LIDAR_TOP")) == len(scene.of("RADAR_FRONT")) == 9  # two sweeps before each keyframe
    assert [reading.keyframe for reading in scene.of("LIDAR_TOP")] == [None, None, 0, None, None, 1, None, None, 2]
    assert [reading.keyframe for reading in scene.of("CAM_BACK")] == [0, 1, 2]
    for reading in scene.readings:
        pose = ego_pose((reading.stamp - START) * 1e-6)
        np.testing.assert_allclose(reading.global_T_sensor, pose @ MOUNTS[reading.channel], atol=1e-6)


def test_keyframes_alone(scene):
    alone = Scene(scene.nusc, scene.record, scene.tokens, sweeps=False)
    assert len(alone.readings) == 3 * len(MOUNTS)
    assert all(reading.keyframe is not None for reading in alone.readings)


def test_a_frame_stays_in_the_world_until_its_next_time_and_is_its_mount_at_its_own():
    stamps = np.array([0, 10, 20, 30, 40])
    poses = np.array([from_rpy(0.1, 0.02 * k, 0.3 * k, (2.0 * k, -k, 0.1)) for k in range(5)])
    mount = from_rpy(0.2, -0.1, 1.0, (1.0, 0.5, 1.5))
    own = np.array([10, 30])
    there = poses[[1, 3]] @ mount
    times, ego_T_frame = held(stamps, poses, own, there)
    assert times.tolist() == [10, 20, 30, 40]
    np.testing.assert_allclose(ego_T_frame[[0, 2]], [mount, mount], atol=1e-12)
    np.testing.assert_allclose(poses[1:] @ ego_T_frame, there[[0, 0, 1, 1]], atol=1e-12)
    assert not np.allclose(ego_T_frame[1], mount)


def test_landmarks_stand_still_at_all_times_though_the_car_drives_on_a_banked_curve(scene):
    stamps, poses = scene.path
    lidar = scene.of("LIDAR_TOP")
    times, ego_T_lidar = held(
        stamps, poses, np.array([r.stamp for r in lidar]), np.array([r.global_T_sensor for r in lidar])
    )
    last = np.searchsorted([r.stamp for r in lidar], times, side="right") - 1
    assert len({*times} - {r.stamp for r in lidar}) > 10  # other sensors fire between the sweeps
    for time, local, which in zip(times, ego_T_lidar, last, strict=True):
        points, _ = read_lidar(scene.nusc.path(lidar[which].record))
        global_T_lidar = poses[stamps == time][0] @ local
        np.testing.assert_allclose(transform(global_T_lidar, points[: len(LANDMARKS), :3]), LANDMARKS, atol=1e-4)


def test_at_a_keyframe_frames_are_those_of_the_reader(scene):
    """``ego_T_cam`` of a sample: through the poses of both times."""
    reading = scene.of("CAM_FRONT")[1]
    ego_T_cam = invert(scene.keyframe_poses[1]) @ reading.global_T_sensor
    reference = ego_pose(1.5)
    np.testing.assert_allclose(ego_T_cam, invert(reference) @ ego_pose(1.48) @ MOUNTS["CAM_FRONT"], atol=1e-6)


def test_a_sensor_that_dies_is_named_at_the_keyframe_and_again_when_it_is_back(tmp_path):
    scene = scene_of(write_tree(tmp_path / "tree", scenes=1, keyframes=3))
    del scene.nusc.keyframes[scene.tokens[1]]["CAM_BACK"]
    found = [(change.keyframe, change.state) for change in changes(scene) if change.channel == "CAM_BACK"]
    assert found == [(0, SOUND), (1, "dead: it gives no data"), (2, SOUND)]
    assert scene.silent("CAM_BACK") == [1]
    assert {c.channel for c in changes(scene) if c.keyframe == 0 and not c.is_fault} == {*MOUNTS}


def test_what_generated_tables_say_of_clock_and_mount_is_told(scene):
    record = scene.nusc.keyframes[scene.tokens[2]]["CAM_FRONT"]
    mount = scene.nusc.get("calibrated_sensor", record["calibrated_sensor_token"])
    wrong = record | {
        "true_timestamp": record["timestamp"] - 50_000,
        "true_translation": [mount["translation"][0] + 0.1, *mount["translation"][1:]],
        "true_rotation": mount["rotation"],
    }
    scene.nusc.keyframes[scene.tokens[2]]["CAM_FRONT"] = wrong
    (change,) = [each for each in changes(scene) if each.keyframe == 2]
    scene.nusc.keyframes[scene.tokens[2]]["CAM_FRONT"] = record
    assert change.state == "its clock is 50 ms ahead; it sits 0.10 m beside its mount"
    assert change.is_fault


def test_the_scene_in_words_has_its_condition_and_each_sensor(scene):
    scene.record["condition"] = {"name": "fog", "severity": 2, "visibility": 61.23456}
    text = description(scene)
    del scene.record["condition"]
    assert "3 keyframes in 1.0 s" in text
    assert "| visibility | 61.23 |" in text
    assert "| LIDAR_TOP | 3 | 6 |" in text
