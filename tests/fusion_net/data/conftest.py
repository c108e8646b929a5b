"""What several files of tests read."""

import pytest

from fusion_net.data import disk_cache
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.tiny_tree import write_tree

BOXES = [{"category": "vehicle.car", "center": lambda t: (40 + 6 * t, 25, 1)}]


@pytest.fixture
def root(tmp_path):
    """Of a tree that no test has read; the cache says all its lines anew."""
    disk_cache.say.cache_clear()
    return write_tree(tmp_path / "tree", scenes=3, boxes=BOXES)


@pytest.fixture
def own_tree(tmp_path):
    """A tree that a test may spoil."""
    return NuScenes(write_tree(tmp_path, scenes=1, keyframes=2))
