"""Samples from disk are the reader's to the bit, whoever fills the files, damages them or takes the room away."""

import errno
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys

import numpy as np
import pytest

from fusion_net.data import disk_cache
from fusion_net.data.augment import Augment
from fusion_net.data.samples import SampleReader
from tests.fixtures.cached_samples import LOST, assert_all_same, dataset, files, read_all

AUGMENT = Augment(rotation_deg=20.0, scale=0.1, flip_y=True, brightness=0.2)


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
import sys, time
from fusion_net.data import disk_cache
from tests.fixtures.cached_samples import dataset
data, write = dataset(sys.argv[1]), disk_cache._write
def slow(file, block, offset):  # in two halves
    write(file, block[: len(block) // 2], offset)
    print("half", flush=True)
    time.sleep(0.05)
    write(file, block[len(block) // 2 :], offset + len(block) // 2)
disk_cache._write = slow
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


def test_a_process_that_is_spawned_opens_the_cache_itself(root):
    data = dataset(root)
    read_all(data)
    assert_all_same(pickle.loads(pickle.dumps(data)), data)


@pytest.mark.parametrize("cache", [True, False, "ram"])
def test_another_place_is_refused_with_those_that_there_are(root, cache):
    with pytest.raises(ValueError, match=r"Write one of disk, memory, none"):
        dataset(root, cache=cache)
