import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion_net.common.geometry import from_rpy, unproject
from fusion_net.data.depth_labels import class_map, dense_depth, lidar_depth

CAM_K = np.array([[40.0, 0, 21], [0, 44.0, 13], [0, 0, 1]])
SIZE = {"height": 24, "width": 40, "stride": 8}


def depth_of(camera_points):
    return lidar_depth(np.asarray(camera_points, np.float32).reshape(-1, 3), np.eye(4), CAM_K, **SIZE)


def test_a_point_behind_the_camera_whose_mirror_image_is_in_the_picture_is_no_depth():
    assert depth_of([[1.0, 0.5, 10.0]])[1, 3] == 10.0
    assert not depth_of([[-1.0, -0.5, -10.0]]).any()
    assert not depth_of([]).any()


@settings(max_examples=50)
@given(seed=st.integers(0, 10**6))
def test_each_point_counts_in_the_cell_of_its_pixel(seed):
    rng = np.random.default_rng(seed)
    pixels, depth = rng.uniform((-8, -8), (48, 32), (200, 2)), rng.uniform(1, 60, 200)  # some just off the left and top
    expected = np.full((3, 5), np.inf)
    for (u, v), z in zip(pixels, depth, strict=True):
        if 0 <= u < 40 and 0 <= v < 24:
            expected[int(v // 8), int(u // 8)] = min(expected[int(v // 8), int(u // 8)], z)
    expected[np.isinf(expected)] = 0
    cam_T_ego = from_rpy(0.1, -0.2, 0.4, (1.0, -2.0, 0.5))
    ego_points = (unproject(CAM_K, pixels, depth) - cam_T_ego[:3, 3]) @ cam_T_ego[:3, :3]
    found = lidar_depth(ego_points, cam_T_ego, CAM_K, **SIZE)
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_dense_depth_ignores_sky_unless_all_is_sky():
    image = np.zeros((4, 6), np.uint16)
    image[1, 1], image[0, 1], image[3, 5] = 512, 65_535, 256
    np.testing.assert_allclose(dense_depth(image, 2), [[2.0, 0, 0], [0, 0, 1.0]])


def test_a_label_beyond_the_depth_images_reach_still_counts():
    classes, depth = np.zeros((2, 4), np.uint8), np.full((2, 4), 700, np.uint16)
    classes[0, 3], depth[0, 3] = 5, 0
    label_of = np.full(256, -1)
    label_of[5] = 2
    np.testing.assert_array_equal(class_map(classes, depth, label_of, 2), [[-1, 2]])
