"""Which folder a cache lies in, how many are kept, and what becomes of one that is copied, deleted or cannot be made."""

import shutil
import time

import numpy as np

from fusion_net.data.cache_folder import KEPT
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.data.samples import SampleReader
from tests.fixtures.cached_samples import GRID, LOST, assert_all_same, dataset, files, read_all
from tests.fixtures.tiny_tree import write_tree


def test_other_files_or_settings_have_another_cache(root):
    read_all(dataset(root))
    (first,) = files(root, "data")
    assert dataset(root, radar_sweeps=0)[0].radar_points.shape != dataset(root)[0].radar_points.shape
    assert len(files(root, "data")) == 2
    dataset(root, seed=5)[0]  # without faults a seed changes nothing that is kept
    assert len(files(root, "data")) == 2
    spoilt = [dataset(root, faults=LOST, seed=seed)[0].lidar_points for seed in (5, 6)]
    assert not np.array_equal(*spoilt)
    assert len(files(root, "data")) == 4
    path = next(root.glob("samples/LIDAR_TOP/scene-0000*.bin"))
    path.write_bytes(path.read_bytes()[:-60])
    path.with_name(path.name.removesuffix(".pcd.bin") + ".time.npy").unlink()
    assert_all_same(dataset(root), dataset(root, cache="none"))
    assert len(files(root, "data")) == 1
    assert not first.exists()


def test_few_caches_are_kept_and_the_one_in_use_among_them(root):
    for sweeps in range(KEPT + 2):
        data = dataset(root, radar_sweeps=sweeps)
        data[0]
        time.sleep(0.02)
    assert len(files(root, "index")) == len(files(root, "data")) == KEPT
    data[1]
    again = dataset(root, radar_sweeps=KEPT + 1)
    assert again._decoded.get(1) is not None


def test_a_copy_of_a_tree_takes_its_cache_along(root, tmp_path, monkeypatch):
    read_all(dataset(root))
    shutil.copytree(root, tmp_path / "copy")
    monkeypatch.delattr(SampleReader, "read")
    read_all(dataset(tmp_path / "copy"))


def test_where_no_folder_can_be_made_samples_stay_in_memory(root, capsys):
    (root / ".cache").write_text("")
    data = dataset(root)
    assert_all_same(data, dataset(root, cache="none"))
    assert data.decoded(0) is data.decoded(0)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert "decoded samples are kept in memory" in lines[0]


def test_deleting_the_folder_is_always_safe(root):
    plain, data = dataset(root, cache="none"), dataset(root)
    read_all(data)
    shutil.rmtree(root / ".cache")
    assert_all_same(data, plain)
    assert_all_same(dataset(root), plain)
    assert files(root, "data")


def test_several_folders_have_a_cache_each(root, tmp_path):
    other = write_tree(tmp_path / "other", scenes=5, keyframes=1)
    (other / "v1.0-tiny/splits.json").write_text('{"tiny_train": ["scene-0003", "scene-0004"]}')
    both = [NuScenesDataset([str(root), str(other)], "train", grid=GRID, cache=c) for c in ("disk", "disk", "none")]
    assert_all_same(both[0], both[2])
    assert_all_same(both[1], both[2])
    assert files(root, "data")
    assert files(other, "data")
