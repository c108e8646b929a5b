import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion_net.common.boxes import box_corners
from fusion_net.common.geometry import from_yaw, project, transform
from fusion_net.data.augment import Augment, change_view
from fusion_net.data.samples import SampleReader
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.tiny_tree import write_tree

BOXES = [{"category": "vehicle.car", "center": lambda t: (35 + 6 * t, 12 - t, 1), "yaw": lambda t: 0.8}]
EVERYTHING = Augment(rotation_deg=40.0, scale=0.2, flip_y=True, brightness=0.3, contrast=0.3, saturation=0.5)


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    tree = NuScenes(write_tree(tmp_path_factory.mktemp("tree"), scenes=1, boxes=BOXES))
    return SampleReader().read(tree, "scene-0000-1")


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6))
def test_points_keep_their_pixels_in_every_camera(sample, seed):
    changed = EVERYTHING(sample, np.random.default_rng(seed))
    for camera in range(2):
        pixels = [
            project(s.cam_K[camera], transform(np.linalg.inv(s.ego_T_cam[camera]), s.lidar_points[:, :3]))
            for s in (sample, changed)
        ]
        np.testing.assert_allclose(pixels[1][0], pixels[0][0], rtol=1e-3, atol=1e-2)
        np.testing.assert_allclose(pixels[1][1], pixels[0][1], rtol=1e-4, atol=1e-3)  # camera metres: scale aside
    np.testing.assert_array_equal(changed.lidar_depth, sample.lidar_depth)


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6))
def test_points_keep_their_place_in_the_boxes(sample, seed):
    changed = EVERYTHING(sample, np.random.default_rng(seed))
    new_T_ego = changed.ego_T_cam[0] @ np.linalg.inv(sample.ego_T_cam[0])
    before, after = (box_corners(s.boxes.center, s.boxes.wlh, s.boxes.yaw)[0] for s in (sample, changed))
    moved = transform(new_T_ego, before)
    gap = np.linalg.norm(moved[:, None] - after[None], axis=-1)  # mirrored, left corners become right ones
    assert gap.min(axis=1).max() < 1e-6
    front, rear = after[:4].mean(axis=0), after[4:].mean(axis=0)
    np.testing.assert_allclose(front - rear, moved[:4].mean(axis=0) - moved[4:].mean(axis=0), atol=1e-6)


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6))
def test_a_moving_radar_point_still_ends_where_its_velocity_leads(sample, seed):
    changed = EVERYTHING(sample, np.random.default_rng(seed))
    new_T_ego = changed.ego_T_cam[0] @ np.linalg.inv(sample.ego_T_cam[0])
    for old, new in ((sample.radar_points, changed.radar_points),):
        later = old[:, :3] + np.pad(old[:, 4:6], ((0, 0), (0, 1)))
        np.testing.assert_allclose(new[:, :2] + new[:, 4:6], transform(new_T_ego, later)[:, :2], atol=1e-3)
        np.testing.assert_array_equal(new[:, (3, 6)], old[:, (3, 6)])  # RCS and age are no vector
    later = sample.boxes.center + np.pad(sample.boxes.velocity, ((0, 0), (0, 1)))
    np.testing.assert_allclose(
        changed.boxes.center[:, :2] + changed.boxes.velocity, transform(new_T_ego, later)[:, :2], atol=1e-6
    )


def test_a_quarter_turn_by_hand(sample):
    turned = change_view(sample, from_yaw(np.pi / 2))
    np.testing.assert_allclose(turned.lidar_points[:, 0], -sample.lidar_points[:, 1], atol=1e-5)
    np.testing.assert_allclose(turned.radar_points[:, 5], sample.radar_points[:, 4], atol=1e-5)
    assert turned.boxes.yaw[0] == pytest.approx(sample.boxes.yaw[0] + np.pi / 2)
    mirrored = change_view(sample, np.diag([1.0, -1.0, 1.0, 1.0]))
    assert mirrored.boxes.yaw[0] == pytest.approx(-sample.boxes.yaw[0])
    np.testing.assert_allclose(mirrored.boxes.velocity, sample.boxes.velocity * (1, -1))


def test_scale_grows_sizes_and_velocities(sample):
    scaled = change_view(sample, np.diag([1.1, 1.1, 1.1, 1.0]))
    np.testing.assert_allclose(scaled.boxes.wlh, 1.1 * sample.boxes.wlh)
    np.testing.assert_allclose(scaled.boxes.velocity, 1.1 * sample.boxes.velocity)


def test_the_original_is_left_as_it_was(sample):
    before = sample.lidar_points.copy(), sample.images.copy(), sample.boxes.center.copy()
    EVERYTHING(sample, np.random.default_rng(1))
    for old, new in zip(before, (sample.lidar_points, sample.images, sample.boxes.center), strict=True):
        np.testing.assert_array_equal(old, new)


def test_nothing_asked_for_is_nothing_changed(sample):
    same = Augment()(sample, np.random.default_rng(4))
    np.testing.assert_allclose(same.lidar_points, sample.lidar_points)
    assert same.images is sample.images
    np.testing.assert_allclose(same.ego_T_cam, sample.ego_T_cam)


def test_colours_by_hand(sample):
    assert EVERYTHING(sample, np.random.default_rng(1)).colors.shape == (3, 4)
    grey = Augment(saturation=0.999)
    draws = [grey.random_colors(np.random.default_rng(seed)) for seed in range(20)]
    for colors in draws:  # saturation leaves grey pixels as they are
        np.testing.assert_allclose(colors @ (90, 90, 90, 1), (90, 90, 90))
    contrast = Augment(contrast=0.5).random_colors(np.random.default_rng(2))
    np.testing.assert_allclose(contrast @ (127.5, 127.5, 127.5, 1), (127.5, 127.5, 127.5))


def test_draws_follow_from_the_generator_alone_and_cover_the_range():
    draws = np.stack([EVERYTHING.random_view(np.random.default_rng(seed)) for seed in range(400)])
    np.testing.assert_array_equal(draws[7], EVERYTHING.random_view(np.random.default_rng(7)))
    scale = np.linalg.norm(draws[:, :3, 0], axis=1)
    assert 0.8 <= scale.min() < 0.82 < 1.18 < scale.max() <= 1.2
    mirrored = np.linalg.det(draws[:, :3, :3]) < 0
    assert 0.4 < mirrored.mean() < 0.6


def test_impossible_ranges_are_named():
    with pytest.raises(ValueError, match=r"scale=1\.5 is not within \[0, 1\)"):
        Augment(scale=1.5)
