import numpy as np
import pytest

from fusion_net.common.geometry import invert, project, transform
from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.data.samples import SampleReader
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.tiny_tree import (
    CAM_K,
    HEIGHT,
    LANDMARKS,
    MOUNTS,
    MOVER_START,
    MOVER_VELOCITY,
    WIDTH,
    ego_pose,
    write_detections,
    write_tree,
)  # fmt: skip

TOKEN = "scene-0000-1"
T_KEY = 1.5


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    return NuScenes(write_tree(tmp_path_factory.mktemp("tree"), scenes=1, boxes=BOXES))


BOXES = [
    {"category": "vehicle.car", "center": lambda t: (30 + 6 * t, 12, 1), "yaw": lambda t: 0.4},
    {"category": "vehicle.truck", "center": lambda t: (50, 14, 1.5), "size": [2.5, 8.0, 3.0]},
    {"category": "vehicle.car", "center": lambda t: (60, 12, 1), "points": 0},
]


def in_ego(points, t=T_KEY):
    return transform(invert(ego_pose(t)), points)


@pytest.mark.parametrize("sweeps", [0, 2, 4])
def test_static_points_of_every_lidar_sweep_fall_on_the_same_ego_coordinates(tree, sweeps):
    points = SampleReader(lidar_sweeps=sweeps).read(tree, TOKEN).lidar_points
    scans = points.reshape(sweeps + 1, len(LANDMARKS), 5)  # own car and NaN are gone
    np.testing.assert_allclose(scans[..., :3], np.broadcast_to(in_ego(LANDMARKS), scans[..., :3].shape), atol=2e-4)


def test_without_compensation_a_sweep_is_displaced_by_the_ego_motion_and_by_the_mount_alone(tree):
    points = SampleReader(lidar_sweeps=2, motion_compensation=False).read(tree, TOKEN).lidar_points.reshape(3, -1, 5)
    for scan, age in zip(points, (0.0, 0.05, 0.1), strict=True):
        np.testing.assert_allclose(scan[:, :3], in_ego(LANDMARKS, T_KEY - age), atol=2e-4)
    assert np.linalg.norm(points[2, :, :2] - points[0, :, :2], axis=1).min() > 0.3


def test_lidar_intensity_is_a_share_and_dt_counts_from_the_reference_back(tree):
    points = SampleReader(lidar_sweeps=1).read(tree, TOKEN).lidar_points.reshape(2, -1, 5)
    np.testing.assert_allclose(points[..., 3], 0.2, atol=1e-6)
    np.testing.assert_allclose(points[..., 4].mean(axis=1), (0.025, 0.075), atol=1e-6)


def test_static_points_of_all_radars_and_sweeps_fall_on_the_same_ego_coordinates(tree):
    radar = SampleReader(radar_sweeps=2).read(tree, TOKEN).radar_points.reshape(6, -1, 7)
    for scan in radar[:, :-1]:
        np.testing.assert_allclose(scan[:, :3], in_ego(LANDMARKS), atol=2e-4)
    ages = np.add.outer((0.01, 0.04), (0.0, 0.05, 0.1)).ravel()  # phase of each radar, then its firings
    np.testing.assert_allclose(radar[:, 0, 6], ages, atol=1e-6)
    np.testing.assert_allclose(radar[:, :, 3], 10.0)


def test_radar_velocity_is_a_vector_turned_into_reference_axes_and_not_moved(tree):
    radar = SampleReader(radar_sweeps=2).read(tree, TOKEN).radar_points.reshape(6, -1, 7)
    expected = ego_pose(T_KEY)[:3, :3].T @ MOVER_VELOCITY
    np.testing.assert_allclose(radar[:, -1, 4:6], np.broadcast_to(expected[:2], (6, 2)), atol=0.02)  # the mounts lean
    assert np.abs(radar[:, :-1, 4:6]).max() < 1e-5


def test_propagation_brings_a_moving_point_of_any_age_to_where_it_is_at_the_reference(tree):
    moved = SampleReader(radar_sweeps=2).read(tree, TOKEN).radar_points.reshape(6, -1, 7)[:, -1]
    now = in_ego((MOVER_START + MOVER_VELOCITY * T_KEY)[None])[0]
    np.testing.assert_allclose(moved[:, :2], np.broadcast_to(now[:2], (6, 2)), atol=0.01)
    left = SampleReader(radar_sweeps=2, propagate_radar=False).read(tree, TOKEN).radar_points.reshape(6, -1, 7)[:, -1]
    distance = np.linalg.norm(moved[:, :2] - left[:, :2], axis=1)
    np.testing.assert_allclose(distance, 20 * left[:, 6], atol=0.01)
    np.testing.assert_allclose(np.linalg.norm(left[:, :2] - now[:2], axis=1), 20 * left[:, 6], atol=0.02)


def test_a_radar_point_at_20_metres_a_second_moves_one_metre_in_50_ms(own_tree):
    record = own_tree.keyframe_and_sweeps(TOKEN, "RADAR_FRONT", 0)[0]
    record["timestamp"] = own_tree.reference(TOKEN)["timestamp"] - 50_000
    write_detections(own_tree.path(record), x=[30.0], y=[2.0], vx_comp=[20.0], vy_comp=[0.0])
    x = [
        SampleReader(radar_sweeps=0, propagate_radar=move).read(own_tree, TOKEN).radar_points[0, :2]
        for move in (True, False)
    ]
    assert np.linalg.norm(x[0] - x[1]) == pytest.approx(1.0, abs=1e-3)


def test_the_camera_sees_a_landmark_where_it_was_at_the_exposure(tree):
    sample = SampleReader(radar_sweeps=0).read(tree, TOKEN)
    for camera, (channel, age) in enumerate({"CAM_FRONT": 0.02, "CAM_BACK": 0.03}.items()):
        cam_T_ego = invert(sample.ego_T_cam[camera])
        true, _ = project(CAM_K, transform(invert(ego_pose(T_KEY - age) @ MOUNTS[channel]), LANDMARKS))
        pixels, _ = project(sample.cam_K[camera], transform(cam_T_ego, sample.lidar_points[:, :3]))
        np.testing.assert_allclose(pixels, true, atol=0.05, rtol=1e-4)


def test_lidar_depth_holds_the_nearest_point_of_a_cell(tree):
    sample = SampleReader(label_stride=16).read(tree, TOKEN)
    camera_points = transform(invert(ego_pose(T_KEY - 0.02) @ MOUNTS["CAM_FRONT"]), LANDMARKS)
    pixels, depth = project(CAM_K, camera_points)
    expected = np.zeros((3, 5))
    for (u, v), z in sorted(zip(pixels.tolist(), depth.tolist(), strict=True), key=lambda p: -p[1]):
        if z > 0 and 0 <= u < WIDTH and 0 <= v < HEIGHT:
            expected[int(v // 16), int(u // 16)] = z  # far ones first, so near ones stay
    assert (expected > 0).sum() >= 3
    np.testing.assert_allclose(sample.lidar_depth[0], expected, atol=1e-3)


def test_dense_labels_take_the_nearest_pixel_of_a_cell_and_the_nearest_object(tree):
    sample = SampleReader(classes=["bicycle", "car"]).read(tree, TOKEN)
    assert sample.dense_depth[0, 0, 0] == 6.0
    assert (sample.dense_depth[0, :3].ravel()[1:] == 10.0).all()
    assert (sample.dense_depth[0, 3:] == 0).all()
    assert sample.class_map[0, 0, 0] == 0
    assert (sample.class_map[0].ravel()[1:] == -1).all()
    ten = SampleReader().read(tree, TOKEN)
    assert ten.class_map[0, 0, 0] == CLASSES.index("bicycle")
    assert SampleReader(classes=["truck"]).read(tree, TOKEN).class_map[0, 0, 0] == 0  # behind, but the one asked for


def test_side_files_absent_as_in_real_data_leave_those_labels_out(own_tree):
    for side_file in own_tree.root.glob("samples/CAM_*/*.png"):
        side_file.unlink()
    sample = SampleReader().read(own_tree, TOKEN)
    assert sample.dense_depth is None
    assert sample.class_map is None
    assert sample.lidar_depth.any()


def test_an_image_that_the_stride_does_not_divide_is_fitted_to_it(tree):
    sample = SampleReader(label_stride=7).read(tree, TOKEN)
    assert sample.images.shape == (2, 42, 77, 3)
    assert sample.lidar_depth.shape == sample.dense_depth.shape == (2, 6, 11)
    with pytest.raises(ValueError, match="label_stride=0: use 1"):
        SampleReader(label_stride=0)
    with pytest.raises(ValueError, match="label_stride=64 is larger than the image of 48x80"):
        SampleReader(label_stride=64).read(tree, TOKEN)


def test_image_size_keeps_landmarks_on_their_picture(tree):
    whole = SampleReader().read(tree, TOKEN)
    fitted = SampleReader(image_size=[16, 40]).read(tree, TOKEN)
    assert fitted.images.shape == (2, 16, 40, 3)
    assert fitted.lidar_depth.shape == fitted.dense_depth.shape == (2, 2, 5)
    points = transform(invert(whole.ego_T_cam[0]), whole.lidar_points[:, :3])
    before, after = (project(s.cam_K[0], points)[0] for s in (whole, fitted))
    np.testing.assert_allclose(after, before / 2 - (0, 8), atol=1e-6)
    np.testing.assert_allclose(fitted.images[0, 5, 7], whole.images[0, 26:28, 14:16].mean(axis=(0, 1)), atol=2)
    with pytest.raises(ValueError, match=r"at most \[24, 40\]"):
        SampleReader(image_size=[32, 40]).read(tree, TOKEN)


def test_boxes_are_in_the_reference_frame_and_have_a_point(tree):
    boxes = SampleReader(classes=["truck", "car"]).read(tree, TOKEN).boxes
    np.testing.assert_allclose(boxes.center, in_ego([[39, 12, 1], [50, 14, 1.5]]), atol=1e-9)
    assert boxes.label.tolist() == [1, 0]
    heading = ego_pose(T_KEY)[:3, :3].T @ (np.cos(0.4), np.sin(0.4), 0)
    assert boxes.yaw[0] == pytest.approx(np.arctan2(heading[1], heading[0]))
    np.testing.assert_allclose(boxes.velocity[0], (ego_pose(T_KEY)[:3, :3].T @ (6, 0, 0))[:2], atol=1e-4)


def test_a_dead_sensor_is_empty_and_not_present(own_tree):
    whole = SampleReader().read(own_tree, TOKEN)
    assert whole.present.tolist() == [True, True, True]
    for channel in ("CAM_FRONT", "CAM_BACK", "RADAR_FRONT", "RADAR_FRONT_LEFT"):
        del own_tree.keyframes[TOKEN][channel]
    own_tree.path(own_tree.reference(TOKEN)).write_bytes(b"")  # a dead LiDAR still has its record
    time = own_tree.path(own_tree.reference(TOKEN))
    np.save(time.with_name(time.name.removesuffix(".pcd.bin") + ".time.npy"), np.zeros(0, np.float32))
    sample = SampleReader().read(own_tree, TOKEN)
    assert sample.present.tolist() == [False, False, False]
    assert sample.lidar_points.shape == (0, 5)
    assert sample.radar_points.shape == (0, 7)
    assert not sample.images.any()
    assert sample.images.shape == whole.images.shape
    np.testing.assert_array_equal(sample.cam_K, whole.cam_K)
    assert not sample.lidar_depth.any()
    assert (sample.class_map == -1).all()


def test_one_dead_camera_or_radar_leaves_the_modality_present(own_tree):
    del own_tree.keyframes[TOKEN]["CAM_BACK"]
    del own_tree.keyframes[TOKEN]["RADAR_FRONT"]
    sample = SampleReader(radar_sweeps=0).read(own_tree, TOKEN)
    assert sample.present.all()
    assert sample.images[0].any()
    assert not sample.images[1].any()
    assert len(sample.radar_points) == len(LANDMARKS) + 1


def test_a_radar_that_sees_nothing_is_present(own_tree):
    for channel in ("RADAR_FRONT", "RADAR_FRONT_LEFT"):
        for record in own_tree.keyframe_and_sweeps(TOKEN, channel, 9):
            write_detections(own_tree.path(record), x=[np.nan])
    sample = SampleReader().read(own_tree, TOKEN)
    assert sample.radar_points.shape == (0, 7)
    assert sample.present.all()


def test_modalities_left_out_are_not_given_but_lidar_depth_is(tree):
    camera = SampleReader(modalities=["camera"]).read(tree, TOKEN)
    assert camera.present.tolist() == [True, False, False]
    assert len(camera.lidar_points) == len(camera.radar_points) == 0
    assert camera.lidar_depth.any()
    radar = SampleReader(modalities=["radar"]).read(tree, TOKEN)
    assert radar.present.tolist() == [False, False, True]
    assert radar.images.shape[0] == 0
    assert SampleReader(label_stride=None).read(tree, TOKEN).lidar_depth.size == 0


@pytest.mark.parametrize(("field", "value"), [("invalid_state", 4), ("dyn_prop", 7), ("ambig_state", 1)])
def test_all_radar_points_are_kept_unless_nuscenes_filter_is_asked_for(own_tree, field, value):
    path = own_tree.path(own_tree.keyframes[TOKEN]["RADAR_FRONT"])
    write_detections(path, **{"x": [10.0, 20.0, 30.0], field: [value, 3 if field == "ambig_state" else 0, value]})
    del own_tree.keyframes[TOKEN]["RADAR_FRONT_LEFT"]
    kept, filtered = (
        SampleReader(radar_sweeps=0, radar_default_filter=f).read(own_tree, TOKEN).radar_points for f in (False, True)
    )
    assert len(kept) == 3
    np.testing.assert_allclose(filtered, kept[1:2])


def test_wrong_settings_name_the_valid_values(tree):
    with pytest.raises(ValueError, match=r"'van' is unknown or there twice; choose from car, truck"):
        SampleReader(classes=["car", "van"])
    with pytest.raises(ValueError, match="radar_sweeps=-1"):
        SampleReader(radar_sweeps=-1)
    with pytest.raises(ValueError, match="no keyframe of CAM_SIDE; it has CAM_BACK, CAM_FRONT"):
        SampleReader(cameras=["CAM_SIDE"]).read(tree, TOKEN)
