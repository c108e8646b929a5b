import errno
import multiprocessing
import os
import pickle
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.fault_effects import LostPoints
from fusion_net.common.faults import Fault
from fusion_net.data import disk_cache
from fusion_net.data.augment import Augment
from fusion_net.data.cache_folder import KEPT
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.data.samples import Sample, SampleReader
from tests.fixtures.tiny_tree import write_tree

GRID = BEVGrid(0.0, 64.0, -24.0, 32.0, 0.5)
AUGMENT = Augment(rotation_deg=20.0, scale=0.1, flip_y=True, brightness=0.2)
BOXES = [{"category": "vehicle.car", "center": lambda t: (40 + 6 * t, 25, 1)}]
LOST = [Fault(sensors=["lidar"], effect=LostPoints(fraction=0.5))]


@pytest.fixture
def root(tmp_path):
    return write_tree(tmp_path / "tree", scenes=3, boxes=BOXES)


@pytest.fixture(autouse=True)
def each_line_anew():
    disk_cache.say.cache_clear()


def dataset(root, split="train", cache="disk", **options):
    return NuScenesDataset(str(root), split, grid=GRID, cache=cache, **options)


def files(root, end):
    return sorted(Path(root).glob(f".cache/v1.0-tiny/*/*.{end}"))


def read_all(data):
    return [data[epoch, place] for epoch in range(2) for place in range(len(data))]


def assert_same(one: Sample, other: Sample):
    """To the bit, and with the same layout, on which the result of a product may depend."""
    assert one.token == other.token
    for part, twin in ((one, other), (one.boxes, other.boxes)):
        for field in fields(part):
            array, wanted = getattr(part, field.name), getattr(twin, field.name)
            if isinstance(wanted, np.ndarray):
                assert (array.dtype, array.shape) == (wanted.dtype, wanted.shape), field.name
                assert array.flags.c_contiguous or not wanted.flags.c_contiguous, field.name
                assert array.tobytes() == wanted.tobytes(), field.name
            elif field.name not in ("token", "boxes"):
                assert array is wanted is None


def assert_all_same(data, other):
    for one, twin in zip(read_all(data), read_all(other), strict=True):
        assert_same(one, twin)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"augment": AUGMENT},
        {"augment": Augment(flip_y=True)},
        {"modalities": ["radar"]},
        {"label_stride": None, "image_size": [20, 40]},
        {"faults": LOST, "seed": 3},
    ],
)
def test_what_is_read_from_disk_is_what_the_reader_gives_to_the_bit(root, options):
    plain = dataset(root, cache="none", **options)
    for _ in ("written", "read"):
        assert_all_same(dataset(root, **options), plain)


def test_what_a_tree_lacks_is_kept_as_lacking(root):
    for path in root.glob("samples/*/*"):
        if path.suffix in (".png", ".npy"):
            path.unlink()
        elif path.suffix == ".bin":
            path.write_bytes(b"")
    plain = dataset(root, cache="none")
    assert plain[0].dense_depth is None
    for _ in ("written", "read"):
        assert_all_same(dataset(root), plain)


def test_a_second_run_opens_no_sensor_file(root, monkeypatch):
    read_all(dataset(root))
    monkeypatch.delattr(SampleReader, "read")
    assert len(read_all(dataset(root))) == 12


def test_arrays_of_the_cache_cannot_be_written(root):
    for _ in ("written", "read"):
        with pytest.raises(ValueError, match="read-only"):
            dataset(root)[0].lidar_points[0] = 0


@pytest.mark.parametrize("end", ["data", "index"])
def test_a_file_that_is_cut_short_is_filled_again(root, end):
    read_all(dataset(root))
    (path,), plain = files(root, end), dataset(root, cache="none")
    whole = path.stat().st_size
    os.truncate(path, whole * 2 // 5)
    assert_all_same(dataset(root), plain)
    assert path.stat().st_size >= whole
    assert_all_same(dataset(root), plain)


def test_a_damaged_sample_is_read_again(root, monkeypatch):
    read_all(dataset(root))
    (path,), plain = files(root, "data"), dataset(root, cache="none")
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    assert_all_same(dataset(root), plain)
    monkeypatch.delattr(SampleReader, "read")
    read_all(dataset(root))  # mended


def _fill(root, seed):
    data = dataset(root)
    for place in np.random.default_rng(seed).permutation(len(data)).tolist():
        data[place]


def test_processes_that_fill_one_cache_share_the_work(root):
    fork = multiprocessing.get_context("fork")
    processes = [fork.Process(target=_fill, args=(root, seed)) for seed in range(4)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert [process.exitcode for process in processes] == [0] * 4
    (index,), (data,) = files(root, "index"), files(root, "data")
    entries = np.fromfile(index, disk_cache.ENTRY)
    assert entries["offset"].all()
    assert data.stat().st_size == int((entries["offset"] + entries["size"]).max())
    assert len(set(entries["offset"].tolist())) == len(entries)
    assert int((entries["size"] + 63 & ~np.uint64(63)).sum()) + 64 >= data.stat().st_size  # each is there once
    assert_all_same(dataset(root), dataset(root, cache="none"))


FILL_SLOWLY = """
import sys, time, tests.fusion_net.data.test_disk_cache as test
data, write = test.dataset(sys.argv[1]), test.disk_cache._write
def slow(file, block, offset):  # in two halves
    write(file, block[: len(block) // 2], offset)
    print("half", flush=True)
    time.sleep(0.05)
    write(file, block[len(block) // 2 :], offset + len(block) // 2)
test.disk_cache._write = slow
for place in range(len(data)):
    data[place]
"""


@pytest.mark.parametrize("halves", [1, 6])
def test_a_process_that_is_killed_leaves_what_is_whole(root, halves):
    """The second half of every other write is of an entry in the index."""
    process = subprocess.Popen([sys.executable, "-c", FILL_SLOWLY, str(root)], stdout=subprocess.PIPE, text=True)
    for _ in range(halves):
        assert process.stdout.readline() == "half\n"
    process.send_signal(signal.SIGKILL)
    process.wait()
    entries = np.fromfile(files(root, "index")[0], disk_cache.ENTRY)
    assert (entries["offset"] > 0).sum() <= halves // 2 + 1
    assert_all_same(dataset(root), dataset(root, cache="none"))


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


def test_a_cache_that_may_only_be_read_is_read(root, monkeypatch):
    read_all(dataset(root))
    (path,) = files(root, "data")
    os.truncate(path, path.stat().st_size // 2)
    was, real = path.stat().st_size, os.open

    def read_only(path, flags, *mode):
        if flags & os.O_RDWR:
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return real(path, flags, *mode)

    plain = dataset(root, cache="none")
    monkeypatch.setattr(os, "open", read_only)
    data = dataset(root)
    assert_all_same(data, plain)
    assert not data.decoded(0).lidar_points.flags.writeable
    assert path.stat().st_size == was


@pytest.mark.parametrize("room", [0, 100_000])
def test_on_a_full_disk_the_run_goes_on_uncached(root, monkeypatch, capsys, room):
    real, left = os.pwrite, [room]

    def pwrite(file, data, offset):
        if not left[0]:
            raise OSError(errno.ENOSPC, "No space left on device")
        count = real(file, data[: left[0]], offset)
        left[0] -= count
        return count

    plain, data = dataset(root, cache="none"), dataset(root)
    data[0]
    monkeypatch.setattr(os, "pwrite", pwrite)
    assert_all_same(data, plain)
    (line,) = capsys.readouterr().err.splitlines()
    assert "No space left on device" in line
    monkeypatch.undo()
    assert_all_same(dataset(root), plain)


def test_room_is_left_on_the_disk(root, monkeypatch, capsys):
    monkeypatch.setattr(disk_cache, "ROOM", 2**62)
    dataset(root)[0]
    assert "MiB are free" in capsys.readouterr().err


def test_deleting_the_folder_is_always_safe(root):
    plain, data = dataset(root, cache="none"), dataset(root)
    read_all(data)
    shutil.rmtree(root / ".cache")
    assert_all_same(data, plain)
    assert_all_same(dataset(root), plain)
    assert files(root, "data")


def test_a_process_that_is_spawned_opens_the_cache_itself(root):
    data = dataset(root)
    read_all(data)
    assert_all_same(pickle.loads(pickle.dumps(data)), data)


def test_several_folders_have_a_cache_each(root, tmp_path):
    other = write_tree(tmp_path / "other", scenes=5, keyframes=1)
    (other / "v1.0-tiny/splits.json").write_text('{"tiny_train": ["scene-0003", "scene-0004"]}')
    both = [NuScenesDataset([str(root), str(other)], "train", grid=GRID, cache=c) for c in ("disk", "disk", "none")]
    assert_all_same(both[0], both[2])
    assert_all_same(both[1], both[2])
    assert files(root, "data")
    assert files(other, "data")


@pytest.mark.parametrize("cache", [True, False, "ram"])
def test_another_place_is_refused_with_those_that_there_are(root, cache):
    with pytest.raises(ValueError, match=r"Write one of disk, memory, none"):
        dataset(root, cache=cache)
