"""Painted points: what a loop over points and cameras gives, and the right pixel whatever moved between the sensors' times."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion_net.common.geometry import from_rpy, invert, project, rigid, transform
from fusion_net.data.samples import SampleReader
from fusion_net.models.encoders.painting import paint_points, with_background
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.tiny_tree import AGE, CAM_K, HEIGHT, LANDMARKS, MOUNTS, WIDTH, ego_pose, write_tree

OPTICAL = rigid([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], np.zeros(3))
K = np.array([[30.0, 0.5, 21.0], [0, 31.0, 13.0], [0, 0, 1]])
CLASSES, ROWS, COLUMNS, STRIDE = 3, 6, 11, 4


def one_by_one(points, scores, cam_K, cam_T_ego, sample, stride):
    """The lesson's loop, for several cameras."""
    painted = []
    for point, b in zip(points, sample, strict=True):
        views = []
        for n in range(scores.shape[1]):
            p = cam_T_ego[b, n] @ [*point[:3], 1.0]
            if not p[2] > 0:  # behind the camera, or not a number
                continue
            u, v, w = cam_K[b, n] @ p[:3]
            column, row = np.floor(u / w / stride), np.floor(v / w / stride)
            if 0 <= column < scores.shape[3] and 0 <= row < scores.shape[2]:
                views.append(scores[b, n, int(row), int(column)])
        mean = np.mean(views, axis=0) if views else np.zeros(scores.shape[-1])
        painted.append([*point, *mean, float(not views)])
    return np.array(painted).reshape(len(points), points.shape[1] + scores.shape[-1] + 1)


def world(seed, *, samples=2, cameras=2, points=60):
    """Points all around, cameras that look ahead and aside, one of them mirrored as an augmentation does it."""
    rng = np.random.default_rng(seed)
    xyz = np.hstack([rng.uniform(-15, 15, (points, 2)), rng.uniform(-2, 4, (points, 1)), rng.random((points, 2))])
    xyz[: points // 10, 0] = np.nan
    ego_T_cam = [
        from_rpy(*rng.normal(0, 0.05, 2), rng.uniform(-0.8, 0.8), rng.normal(0, 1, 3)) @ OPTICAL
        for _ in range(samples * cameras)
    ]
    ego_T_cam[0] = np.diag([1.1, -1.1, 1.1, 1]) @ ego_T_cam[0]
    cam_T_ego = np.linalg.inv(np.reshape(ego_T_cam, (samples, cameras, 4, 4)))
    scores = rng.random((samples, cameras, ROWS, COLUMNS, CLASSES))
    cam_K = np.broadcast_to(K, (samples, cameras, 3, 3)).copy()
    return xyz, scores, cam_K, cam_T_ego, rng.integers(0, samples, points)


def painted(xyz, scores, cam_K, cam_T_ego, sample, **options):
    arrays = (torch.tensor(x) for x in (xyz, scores, cam_K, cam_T_ego))
    return paint_points(*arrays, sample=torch.tensor(sample), stride=STRIDE, **options)


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), samples=st.integers(1, 3), cameras=st.integers(0, 3), points=st.integers(0, 60))
def test_painting_all_at_once_is_painting_one_by_one(seed, samples, cameras, points):
    arrays = world(seed, samples=max(samples, 1), cameras=max(cameras, 1), points=points)
    xyz, scores, cam_K, cam_T_ego, sample = arrays
    scores, cam_K, cam_T_ego = (x[:, :cameras] for x in (scores, cam_K, cam_T_ego))
    found = painted(xyz, scores, cam_K, cam_T_ego, sample)
    expected = one_by_one(xyz, scores, cam_K, cam_T_ego, sample, STRIDE)
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-12)


def test_every_kind_of_point_is_among_those_of_the_loop():
    """Seen by none, by one and by two cameras; so that the test above says something."""
    xyz, scores, cam_K, cam_T_ego, sample = world(1, points=400)
    ones = np.ones_like(scores[..., :1])
    alone = [painted(xyz, ones[:, [n]], cam_K[:, [n]], cam_T_ego[:, [n]], sample)[:, -1] == 0 for n in (0, 1)]
    seen_by = sum(each.int() for each in alone)
    assert all((seen_by == count).sum() > 10 for count in (0, 1, 2))


AHEAD = invert(OPTICAL)[None, None]
"""One camera at the origin that looks along x."""


def at_origin(points, scores, cam_T_ego=AHEAD, **options):
    cam_K = np.broadcast_to(K, (1, cam_T_ego.shape[1], 3, 3)).copy()
    arrays = (torch.tensor(np.asarray(x, float)) for x in (points, scores, cam_K, cam_T_ego))
    return paint_points(*arrays, stride=STRIDE, **options)


def test_scores_without_a_matrix_for_each_camera_are_refused():
    with pytest.raises(ValueError, match=r"unequal samples and cameras: \(1, 2\), \(1, 1\), \(1, 1\)$"):
        at_origin([[6.0, 0.0, 0.0]], np.zeros((1, 2, ROWS, COLUMNS, CLASSES)))


def test_a_point_behind_the_camera_is_not_painted_though_its_line_crosses_the_picture():
    scores = np.ones((1, 1, ROWS, COLUMNS, CLASSES))
    found = at_origin([[6.0, 0.4, -0.2], [-6.0, -0.4, 0.2], [0.0, 0.0, 0.0]], scores)  # the second projects to the same
    assert found[:, 3:].tolist() == [[1, 1, 1, 0], [0, 0, 0, 1], [0, 0, 0, 1]]


def test_two_cameras_that_see_a_point_are_averaged_and_a_dead_one_is_not_asked():
    scores = np.zeros((1, 2, ROWS, COLUMNS, CLASSES))
    scores[0, 0], scores[0, 1] = (0.8, 0.1, 0.0), (0.4, 0.3, 0.2)
    both = np.concatenate([AHEAD, AHEAD], axis=1)
    assert at_origin([[6.0, 0.0, 0.0]], scores, both)[0, 3:].tolist() == pytest.approx([0.6, 0.2, 0.1, 0.0])
    for alive, expected in (([True, False], [0.8, 0.1, 0.0, 0.0]), ([False, False], [0.0, 0.0, 0.0, 1.0])):
        scores[0, [not each for each in alive]] = np.nan
        found = at_origin([[6.0, 0.0, 0.0]], scores, both, alive=torch.tensor([alive]))
        assert found[0, 3:].tolist() == pytest.approx(expected)


def test_the_picture_ends_at_its_edges():
    """Truncation in place of floor would also paint what lies up to a pixel beside the left and upper edge."""
    scores = np.ones((1, 1, ROWS, COLUMNS, 1))
    pixels = np.array([(0.01, 0.01), (-0.01, 5), (5, -0.01), (43.99, 23.99), (44.01, 5), (5, 24.01)])
    points = 7.0 * np.hstack([pixels, np.ones((6, 1))]) @ np.linalg.inv(K).T @ OPTICAL[:3, :3].T
    assert at_origin(points, scores)[:, -1].tolist() == [0, 1, 1, 0, 1, 1]


def test_what_no_class_claims_is_background():
    scores = torch.tensor([[0.0, 0.0], [1.0, 0.3], [0.5, 0.5]])
    assert with_background(scores)[:, -1].tolist() == [1.0, 0.0, 0.25]
    assert torch.equal(with_background(scores)[:, :2], scores)


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    return NuScenes(write_tree(tmp_path_factory.mktemp("tree"), scenes=1))


@pytest.mark.parametrize("motion_compensation", [True, False])
def test_standing_points_get_the_pixel_of_the_cameras_own_time_wherever_the_car_was(tree, motion_compensation):
    """LiDAR sweeps of 0, 50 and 100 ms before the reference, cameras of 20 and 30 ms: the car drives 12 m/s and turns. The
    scores of a pixel are its coordinates. Without the car's motion points of the wrong time are painted with other pixels."""
    sample = SampleReader(lidar_sweeps=2, motion_compensation=motion_compensation).read(tree, "scene-0000-1")
    v, u = np.meshgrid(np.arange(HEIGHT), np.arange(WIDTH), indexing="ij")
    scores = np.broadcast_to(np.stack([u, v], axis=-1).astype(float), (1, 2, HEIGHT, WIDTH, 2)).copy()
    cam_T_ego = np.linalg.inv(sample.ego_T_cam)
    wrong = 0
    for n, channel in enumerate(("CAM_FRONT", "CAM_BACK")):
        camera = (torch.tensor(x[None, [n]]) for x in (sample.cam_K, cam_T_ego))
        points = torch.tensor(sample.lidar_points.astype(float))
        found = paint_points(points, torch.tensor(scores[:, [n]]), *camera).numpy()
        in_camera = transform(invert(ego_pose(1.5 - AGE[channel]) @ MOUNTS[channel]), np.tile(LANDMARKS, (3, 1)))
        true, depth = project(CAM_K, in_camera)
        shown = (depth > 0) & (true >= 0).all(axis=1) & (true < (WIDTH, HEIGHT)).all(axis=1)
        clear = np.abs(true - np.round(true)).min(axis=1) > 0.02  # float32 points may fall on either side of an edge
        right = (found[:, 5:7] == np.floor(true)).all(axis=1) & (found[:, 7] == 0)
        assert shown.sum() >= 15 or channel == "CAM_BACK"
        wrong += (shown & clear & ~right).sum()
        if motion_compensation:
            assert (found[~shown & clear, 7] == 1).all()
    assert wrong == 0 if motion_compensation else wrong > 10
