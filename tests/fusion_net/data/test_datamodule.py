import os
import signal

import numpy as np
import pytest
import torch

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.data.augment import Augment
from fusion_net.data.datamodule import NuScenesDataset, StepSampler, make_loader, train_loader, trim_memory
from tests.fixtures.real_tree import edit
from tests.fixtures.tiny_tree import write_tree

GRID = BEVGrid(0.0, 64.0, -24.0, 32.0, 0.5)
AUGMENT = Augment(rotation_deg=20.0, scale=0.1, flip_y=True, brightness=0.2)
BOXES = [
    {"category": "vehicle.car", "center": lambda t: (40 + 6 * t, 25, 1)},
    {"category": "vehicle.truck", "center": lambda t: (200, 25, 1)},
]


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    return str(write_tree(tmp_path_factory.mktemp("tree"), scenes=3, boxes=BOXES))


def dataset(root, **options):
    return NuScenesDataset(root, "train", grid=GRID, classes=["car", "truck"], **options)


def assert_same(one, other):
    for name in ("images", "cam_K", "ego_T_cam", "lidar_points", "radar_points", "present", "lidar_depth", "class_map"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    np.testing.assert_array_equal(one.boxes.center, other.boxes.center)


def test_a_batch_has_the_contracts_shapes_and_types(root):
    data = dataset(root)
    batch = data.collate([data[i] for i in range(4)])
    assert batch.tokens == [token for _, token in data.index[:4]]
    assert batch.images.shape == (4, 2, 3, 48, 80)
    assert batch.images.dtype == torch.uint8
    assert batch.images.is_contiguous()
    assert batch.cam_K.shape == (4, 2, 3, 3)
    assert batch.ego_T_cam.dtype == torch.float32
    assert batch.lidar_points.shape == (4 * 60, 5)
    assert batch.lidar_batch.tolist() == [i for i in range(4) for _ in range(60)]
    assert batch.radar_points.dtype == torch.float32
    assert len(batch.radar_batch) == len(batch.radar_points)
    assert batch.lidar_depth.shape == batch.dense_depth.shape == batch.class_map.shape == (4, 2, 6, 10)
    assert batch.targets.heatmap.shape == (4, 2, *GRID.shape)
    assert batch.targets.mask.sum() == sum(len(boxes) for boxes in batch.boxes) > 0
    assert batch.to("cpu").size == 4


def test_batched_equals_single(root):
    data = dataset(root)
    together = data.collate([data[i] for i in range(3)])
    for index in range(3):
        alone = data.collate([data[index]])
        np.testing.assert_array_equal(together.images[index], alone.images[0])
        np.testing.assert_array_equal(together.lidar_points[together.lidar_batch == index], alone.lidar_points)
        np.testing.assert_array_equal(together.radar_points[together.radar_batch == index], alone.radar_points)
        np.testing.assert_array_equal(together.targets.heatmap[index], alone.targets.heatmap[0])


def test_boxes_off_the_grid_are_left_out_after_the_augmentation(root):
    for data in (dataset(root), dataset(root, augment=AUGMENT)):
        for epoch in range(5):
            boxes = data[epoch, 2].boxes
            assert (boxes.label == 0).all()
            assert GRID.contains(boxes.center).all()


def test_augmentation_follows_from_seed_epoch_and_place_alone(root):
    one, other = dataset(root, augment=AUGMENT), dataset(root, augment=AUGMENT)
    one[2, 0], one[0, 3]
    assert_same(one[2, 1], other[2, 1])
    keys = ((0, (2, 1)), (0, (3, 1)), (1, (2, 1)))
    points = [dataset(root, augment=AUGMENT, seed=seed)[key].lidar_points for seed, key in keys]
    assert not np.allclose(points[0], points[1])
    assert not np.allclose(points[0], points[2])


def test_the_cache_changes_nothing_but_the_time(root):
    plain, cached = dataset(root, augment=AUGMENT), dataset(root, augment=AUGMENT, cache="memory")
    for epoch in range(3):
        assert_same(plain[epoch, 1], cached[epoch, 1])


def test_a_steps_batch_follows_from_seed_and_step():
    sampler = StepSampler(range(9), batch_size=4, steps=5, seed=3)
    steps = list(sampler)
    assert [len(keys) for keys in steps] == [4] * 5 == [4] * len(sampler)
    assert [{epoch for epoch, _ in keys} for keys in steps] == [{0}, {0}, {1}, {1}, {2}]
    for first in (0, 2):  # an epoch shows no sample twice
        assert len({place for keys in steps[first : first + 2] for _, place in keys}) == 8
    assert [place for _, place in steps[0]] != [place for _, place in steps[2]]
    assert list(StepSampler(range(9), batch_size=4, steps=5, first=3, seed=3)) == steps[3:]
    assert list(StepSampler(range(9), batch_size=4, steps=5, seed=4)) != steps


@pytest.mark.parametrize("workers", [0, 1])
def test_the_loader_gives_the_same_with_and_without_a_worker(root, workers):
    data = dataset(root, augment=AUGMENT)
    sampler = StepSampler(range(len(data)), batch_size=4, steps=3)
    batches = list(train_loader(data, sampler, workers))
    assert len(batches) == 3
    for step, batch in enumerate(batches):
        expected = data.collate([data[key] for key in sampler.keys(step)])
        np.testing.assert_array_equal(batch.lidar_points, expected.lidar_points)
        np.testing.assert_array_equal(batch.targets.heatmap, expected.targets.heatmap)
        assert batch.tokens == expected.tokens
    assert [batch.size for batch in make_loader(data, 4)] == [4, 2]


def test_a_loader_process_needs_no_shared_memory(root, monkeypatch):
    """Docker gives 64 MB of it. A batch that found no room was lost and waited for without end."""

    def full(storage, *_):
        raise RuntimeError("unable to allocate shared memory(shm): No space left on device")

    for share in ("_share_fd_cpu_", "_share_filename_cpu_"):
        monkeypatch.setattr(torch.UntypedStorage, share, full)  # the process that is forked has it too
    data = dataset(root)
    batch = next(iter(train_loader(data, StepSampler(range(len(data)), batch_size=4, steps=1), 1)))
    assert batch.images.shape[0] == 4
    batch.images[0] = 7  # the memory is its own


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_are_the_training_processs_to_answer(root, number):
    data = dataset(root)
    batches = iter(train_loader(data, StepSampler(range(len(data)), batch_size=2, steps=6), 1))
    next(batches)
    os.kill(batches._workers[0].pid, number)
    assert len(list(batches)) == 5


def test_two_splits_share_a_tree_that_is_open(root):
    train = dataset(root)
    val = NuScenesDataset(root, "val", grid=GRID, datasets=train.datasets)
    assert val.datasets[0] is train.datasets[0]
    assert val.index[0][0] is train.index[0][0]


def test_samples_without_points_images_or_objects_make_a_batch(root, tmp_path):
    empty = write_tree(tmp_path, scenes=2, keyframes=1)
    edit(empty, "sample_data", lambda record: "LIDAR" in record["token"])
    edit(empty, "calibrated_sensor", lambda mount: mount.update(height=48, width=80))
    for path in empty.glob("*/LIDAR_TOP/*"):
        path.unlink() if path.suffix == ".npy" else path.write_bytes(b"")
    data = NuScenesDataset(str(empty), "train", grid=GRID)
    batch = data.collate([data[0], data[0]])
    assert not batch.present.any()
    assert batch.lidar_points.shape == (0, 5)
    assert batch.radar_points.shape == (0, 7)
    assert batch.boxes[0].center.shape == (0, 3)
    assert not batch.targets.heatmap.any()
    no_camera = NuScenesDataset(root, "train", grid=GRID, modalities=["lidar"])
    assert no_camera.collate([no_camera[0]]).images.shape[:2] == (1, 0)


def test_a_mistyped_option_is_named(root):
    with pytest.raises(TypeError, match="radar_sweep"):
        dataset(root, radar_sweep=3)


def test_several_folders_are_one_dataset(root, tmp_path):
    other = write_tree(tmp_path, scenes=5, keyframes=1)  # train: scenes 0 to 3, of which 2 and 3 are new
    (other / "v1.0-tiny/splits.json").write_text('{"tiny_train": ["scene-0003", "scene-0004"]}')
    data = NuScenesDataset([root, str(other)], "train", grid=GRID)
    assert len(data) == 6 + 2
    assert data[7].token == "scene-0004-0"


def test_trimming_memory_is_harmless_and_gives_memory_back():
    junk = [np.ones(60_000 + 7 * i, np.uint8) for i in range(2000)]
    keep = junk[::50]
    del junk
    before = _resident()
    trim_memory()
    assert _resident() <= before
    assert len(keep) == 40


def _resident() -> int:
    with open("/proc/self/statm") as statm:
        return int(statm.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
