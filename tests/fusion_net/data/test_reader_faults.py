"""What the reader makes of faults on clean data."""

import numpy as np
import pytest

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.fault_effects import BlockedLens, Clock, Dead, LostPoints, LostSector, Mismount, Stale
from fusion_net.common.faults import Fault
from fusion_net.common.geometry import invert, transform, yaw_of
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.data.samples import SampleReader
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.tiny_tree import LANDMARKS, ego_pose, write_tree

TOKEN, T_KEY = "scene-0000-1", 1.5
GRID = BEVGrid(0.0, 64.0, -24.0, 32.0, 0.5)


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    return NuScenes(write_tree(tmp_path_factory.mktemp("tree"), scenes=1, sweeps=4))


def read(tree, *faults, token=TOKEN, **options):
    return SampleReader(faults=list(faults), **options).read(tree, token)


def assert_same(one, other):
    for name in ("images", "ego_T_cam", "lidar_points", "radar_points", "present", "lidar_depth"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def test_no_fault_and_a_fault_of_nothing_change_nothing(tree):
    clean = read(tree)
    for effect in (Stale(firings=0), Clock(), Mismount(), LostPoints(fraction=0.0), BlockedLens(fraction=0.0)):
        sensors = {LostPoints: ["lidar", "radar"], BlockedLens: ["camera"]}.get(
            type(effect), ["camera", "lidar", "radar"]
        )
        spoiled = read(tree, Fault(sensors=sensors, effect=effect))
        np.testing.assert_allclose(spoiled.ego_T_cam, clean.ego_T_cam, atol=1e-12)
        np.testing.assert_allclose(spoiled.lidar_points, clean.lidar_points, atol=1e-5)
        np.testing.assert_allclose(spoiled.radar_points, clean.radar_points, atol=1e-5)
        np.testing.assert_array_equal(spoiled.images, clean.images)
    assert_same(read(tree, Fault(sensors=["lidar"], effect=Dead(), probability=0.0)), clean)


def test_a_dead_modality_is_not_present_and_a_dead_unit_is_black_or_silent(tree):
    assert read(tree, Fault(sensors=["camera"], effect=Dead())).present.tolist() == [False, True, True]
    sample = read(tree, Fault(sensors=["CAM_BACK", "RADAR_FRONT"], effect=Dead()), radar_sweeps=0)
    assert sample.present.all()
    assert sample.images[0].any()
    assert not sample.images[1].any()
    assert len(sample.radar_points) == len(LANDMARKS) + 1
    lidar = read(tree, Fault(sensors=["lidar"], effect=Dead()), lidar_sweeps=2)
    assert lidar.present.tolist() == [True, False, True]
    assert lidar.lidar_points.shape == (0, 5)
    assert not lidar.lidar_depth.any()


def test_a_mount_that_moved_shifts_points_the_other_way_in_every_sweep(tree):
    clean = read(tree, lidar_sweeps=2)
    moved = read(tree, Fault(sensors=["lidar"], effect=Mismount(translation=[0, 0.3, 0])), lidar_sweeps=2)
    shift = (moved.lidar_points - clean.lidar_points)[:, :3].reshape(3, len(LANDMARKS), 3)
    for age, scan in zip((0.0, 0.05, 0.1), shift, strict=True):
        then = invert(ego_pose(T_KEY)) @ ego_pose(T_KEY - age)
        np.testing.assert_allclose(scan, np.broadcast_to(then[:3, :3] @ (0, -0.3, 0), scan.shape), atol=2e-4)


def test_a_camera_that_looks_left_is_believed_to_look_right(tree):
    clean, turned = read(tree), read(tree, Fault(sensors=["CAM_FRONT"], effect=Mismount(rotation_deg=[0, 0, 2.0])))
    ego_T_ego = turned.ego_T_cam[0] @ invert(clean.ego_T_cam[0])
    assert np.degrees(yaw_of(ego_T_ego)) == pytest.approx(-2.0, abs=0.01)
    np.testing.assert_allclose(turned.ego_T_cam[0, :3, 3], clean.ego_T_cam[0, :3, 3], atol=0.1)
    np.testing.assert_array_equal(turned.ego_T_cam[1], clean.ego_T_cam[1])


def test_a_clock_50_ms_ahead_gives_the_sweep_before_at_the_pose_of_now(tree):
    late = read(tree, Fault(sensors=["lidar"], effect=Clock(offset=0.05)))
    expected = transform(invert(ego_pose(T_KEY - 0.05)), LANDMARKS)
    np.testing.assert_allclose(late.lidar_points[:, :3], expected, atol=2e-3)


def test_without_sweeps_a_clock_moves_the_data_by_the_ego_motion_alone(tree):
    """A camera fires 20 ms before the keyframe; 30 ms ahead, its picture is taken to be of 10 ms after it."""
    ahead = read(tree, Fault(sensors=["CAM_FRONT"], effect=Clock(offset=0.03)))
    clean = read(tree)
    as_if = invert(ego_pose(T_KEY)) @ ego_pose(T_KEY + 0.01) @ invert(ego_pose(T_KEY - 0.02)) @ ego_pose(T_KEY)
    np.testing.assert_allclose(ahead.ego_T_cam[0], as_if @ clean.ego_T_cam[0], atol=3e-3)
    np.testing.assert_array_equal(ahead.images, clean.images)


def test_past_sweeps_of_a_clock_that_is_ahead_are_not_given_twice(tree):
    """Four sweeps of 50 ms before each keyframe: the oldest firing has no older one to stand in for it."""
    late = read(tree, Fault(sensors=["lidar"], effect=Clock(offset=0.05)), lidar_sweeps=4).lidar_points
    scans = late.reshape(-1, len(LANDMARKS), 5)
    assert len({round(float(scan[0, 4]), 3) for scan in scans}) == len(scans) == 4


def test_a_stale_frame_is_the_firing_before_at_the_pose_of_this_one(tree):
    stale = read(tree, Fault(sensors=["lidar"], effect=Stale()))
    np.testing.assert_allclose(
        stale.lidar_points[:, :3], transform(invert(ego_pose(T_KEY - 0.05)), LANDMARKS), atol=2e-4
    )
    np.testing.assert_allclose(stale.lidar_points[:, 4], read(tree).lidar_points[:, 4])
    first = read(tree, Fault(sensors=["CAM_FRONT"], effect=Stale()), token="scene-0000-0")
    np.testing.assert_array_equal(first.images, read(tree, token="scene-0000-0").images)  # there is none before


def test_a_sector_is_counted_from_straight_ahead_to_the_left(tree):
    clean = read(tree).lidar_points
    gone = read(tree, Fault(sensors=["lidar"], effect=LostSector(width_deg=60, center_deg=-70))).lidar_points
    azimuth = np.degrees(np.arctan2(clean[:, 1], clean[:, 0] - 0.9))
    outside = np.abs(azimuth + 70) > 30
    assert 0 < outside.sum() < len(clean)
    assert abs(len(gone) - outside.sum()) <= 1  # the mount leans a little
    assert np.isin(gone[:, 0], clean[outside, 0]).mean() > 0.95


def test_a_tree_that_does_not_say_has_nuscenes_32_beams(tree):
    record = tree.reference("scene-0000-1")
    assert "beams" not in tree.get("calibrated_sensor", record["calibrated_sensor_token"])
    assert tree.beams == {"LIDAR_TOP": 32}


def test_mud_covers_its_share_and_only_the_image(tree):
    clean, muddy = read(tree), read(tree, Fault(sensors=["CAM_BACK"], effect=BlockedLens(fraction=0.4)))
    covered = (muddy.images != clean.images).any(axis=-1)
    assert not covered[0].any()
    assert covered[1].mean() == pytest.approx(0.4, abs=0.01)
    np.testing.assert_array_equal(muddy.dense_depth, clean.dense_depth)
    fitted = read(tree, Fault(sensors=["CAM_BACK"], effect=BlockedLens(fraction=0.4)), image_size=[16, 40])
    assert fitted.images.shape == (2, 16, 40, 3)


def test_a_dataset_spoils_the_same_with_and_without_its_cache(tmp_path):
    root = str(write_tree(tmp_path, scenes=3))
    faults = [
        Fault(sensors=["camera"], effect=Dead(), probability=0.5, per="sample"),
        Fault(sensors=["lidar"], effect=Mismount(rotation_deg=[1, 1, 1], random=True), per="sample"),
        Fault(sensors=["lidar", "radar"], effect=LostPoints(fraction=0.5)),
    ]
    plain, cached, other = (
        NuScenesDataset(root, "train", grid=GRID, faults=faults, cache=cache, seed=seed)
        for cache, seed in (("none", 3), ("memory", 3), ("none", 4))
    )
    for key in ((0, 1), (1, 1), (1, 2), (0, 2)):
        assert_same(plain[key], cached[key])
    assert len({plain[k].images.any(axis=(1, 2, 3)).tobytes() for k in range(6)}) > 1
    assert not np.array_equal(plain[1].lidar_points, other[1].lidar_points)


def test_a_dataset_without_a_named_channel_says_what_it_has(tmp_path):
    root = str(write_tree(tmp_path, scenes=2, keyframes=1))
    with pytest.raises(ValueError, match=r"no sensor 'CAM_SIDE'; there are camera, lidar, radar, CAM_FRONT, CAM_BACK"):
        NuScenesDataset(root, "train", grid=GRID, faults=[Fault(sensors=["CAM_SIDE"], effect=Dead())])
