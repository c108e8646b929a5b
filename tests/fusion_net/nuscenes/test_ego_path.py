import numpy as np
import pytest

from fusion_net.common.geometry import invert
from fusion_net.nuscenes.ego_path import EgoPath
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.tiny_tree import START, ego_pose, write_tree


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return EgoPath(NuScenes(write_tree(tmp_path_factory.mktemp("tree"), scenes=1)), "scene-0000")


@pytest.mark.parametrize("t", [0.8, 0.99, 1.0, 1.12, 1.3, 1.5, 2.0, 2.1])
def test_a_steady_turn_is_followed_between_the_poses_and_beyond_them(path, t):
    """12 m/s at 0.5 rad/s: on straight lines the middle of half a second would lie 19 cm off."""
    pose = path.at(START + t * 1e6)
    np.testing.assert_allclose(pose, ego_pose(t), atol=3e-3)


def test_the_twist_is_the_speed_and_the_turn_rate(path):
    now, later = ego_pose(1.2), ego_pose(1.2001)
    turn, speed = np.split(path.twist(START + 1.2e6), 2)
    np.testing.assert_allclose(np.linalg.norm(speed), 12.0, atol=0.01)
    np.testing.assert_allclose(np.linalg.norm(turn), 0.5, atol=1e-3)
    np.testing.assert_allclose(speed, (invert(now) @ later)[:3, 3] / 1e-4, atol=0.02)


def test_a_scene_of_one_pose_stands_still(tmp_path):
    tree = NuScenes(write_tree(tmp_path, scenes=1, keyframes=1, sweeps=0))
    for record in list(tree.tables["sample_data"].values())[1:]:
        del tree.tables["sample_data"][record["token"]]
    path = EgoPath(tree, "scene-0000")
    np.testing.assert_array_equal(path.at(START), path.at(START + 1e6))
    assert not path.twist(START).any()
