"""Decoded samples of one split on disk, shared by every process that reads them, and filled by whichever decodes first.

Two files: ``NAME.data`` holds blocks one after the other (:mod:`fusion_net.data.packing`), ``NAME.index`` says of each
sample where its block lies and what its checksum is. A block is appended under a lock and then entered; one that is cut
short, whatever stopped its writer, is never entered or fails its checksum, and is written again. What was read stays
readable when the files are deleted.
"""

import fcntl
import mmap
import os
import sys
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.array_block import aligned
from fusion_net.data.packing import pack, unpack
from fusion_net.data.samples import Sample

ENTRY = np.dtype([("offset", "<u8"), ("size", "<u8"), ("checksum", "<u8")])
"""Of the index. ``offset`` 0: not there yet (the data file begins with ``MAGIC``)."""
MAGIC = b"decoded samples\n".ljust(64, b"\0")
ROOM = 2**30
"""Bytes that are left free on the disk, for checkpoints."""
PATIENCE = 0.2
"""Seconds to wait for another writer; then the sample stays uncached until it is read again."""


class DiskCache:
    """The decoded samples of ``length`` places in the files ``stem.data`` and ``stem.index``. OSError when these can be
    neither written nor read."""

    def __init__(self, stem: Path, length: int) -> None:
        self.stem, self.length = stem, length
        self._writable, self._index_file, self._data_file = True, -1, -1
        self._open()

    def __getstate__(self) -> tuple[Path, int]:
        """A process that is spawned opens the files itself."""
        return self.stem, self.length

    def __setstate__(self, state: tuple[Path, int]) -> None:
        self.__init__(*state)  # type: ignore[misc]

    def __del__(self) -> None:
        for file in (self._index_file, self._data_file):
            if file >= 0:
                os.close(file)

    def get(self, place: int) -> Sample | None:
        """The sample at a place; None where it is not there, or not whole. Its arrays are read-only."""
        block = self._block(place)
        return None if block is None else unpack(block)

    def put(self, place: int, sample: Sample) -> Sample:
        """Keeps a sample, if there is room, and returns it as :meth:`get` would."""
        block = pack(sample)
        if self._writable:
            try:
                self._append(place, block)
            except OSError as error:
                self._writable = False
                say(
                    f"{self.stem.parent} takes no more decoded samples ({error.strerror or error}); the others are not cached"
                )
        return unpack(block)

    def _open(self) -> None:
        try:
            self.stem.parent.mkdir(parents=True, exist_ok=True)
            self._index_file, self._data_file = (
                self._descriptor(end, os.O_RDWR | os.O_CREAT) for end in ("index", "data")
            )
            with self._lock():
                if os.fstat(self._index_file).st_size != self.length * ENTRY.itemsize:
                    os.ftruncate(self._index_file, 0)
                    os.ftruncate(self._index_file, self.length * ENTRY.itemsize)
                if os.fstat(self._data_file).st_size < len(MAGIC):
                    os.pwrite(self._data_file, MAGIC, 0)
            os.utime(self.stem.with_suffix(".index"))  # in use: see cache_folder
        except OSError:
            self._writable = False
            self._index_file, self._data_file = (self._descriptor(end, os.O_RDONLY) for end in ("index", "data"))
            if os.fstat(self._index_file).st_size != self.length * ENTRY.itemsize:
                raise
        shared = mmap.mmap(self._index_file, self.length * ENTRY.itemsize, access=mmap.ACCESS_READ)
        self._entries: NDArray = np.frombuffer(shared, ENTRY)
        self._data: memoryview | bytes = b""
        self._is_whole = np.zeros(self.length, bool)

    def _descriptor(self, end: str, flags: int) -> int:
        return os.open(self.stem.with_suffix(f".{end}"), flags | os.O_CLOEXEC, 0o666)

    def _block(self, place: int) -> memoryview | None:
        offset, size, checksum = (int(value) for value in self._entries[place])
        if offset == 0:
            return None
        if offset + size > len(self._data):
            there = os.fstat(self._data_file).st_size
            if offset + size > there:
                return None
            self._data = memoryview(mmap.mmap(self._data_file, there, access=mmap.ACCESS_READ))
        block = memoryview(self._data)[offset : offset + size]
        if not self._is_whole[place]:
            if zlib.crc32(block) != checksum:
                return None
            self._is_whole[place] = True
        return block

    def _append(self, place: int, block: bytes) -> None:
        with self._lock():
            if self._block(place) is not None:  # another process was first
                return
            end = aligned(os.fstat(self._data_file).st_size)
            disk = os.fstatvfs(self._data_file)
            if disk.f_bavail * disk.f_frsize < ROOM + len(block):
                raise OSError(f"less than {ROOM // 2**20} MiB are free")
            try:
                _write(self._data_file, block, end)
            except OSError:
                os.ftruncate(self._data_file, end)
                raise
            _write(
                self._index_file,
                np.array((end, len(block), zlib.crc32(block)), ENTRY).tobytes(),
                place * ENTRY.itemsize,
            )

    @contextmanager
    def _lock(self) -> Iterator[None]:
        """Makes this process the only writer. OSError when another one does not end."""
        deadline = time.monotonic() + PATIENCE
        while True:
            try:
                fcntl.lockf(self._index_file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except (BlockingIOError, PermissionError):
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.001)
        try:
            yield
        finally:
            fcntl.lockf(self._index_file, fcntl.LOCK_UN)


def _write(file: int, data: bytes, offset: int) -> None:
    """Writes all of ``data``; OSError when the disk takes a part only."""
    view = memoryview(data)
    while view:
        count = os.pwrite(file, view, offset)
        view, offset = view[count:], offset + count


@cache
def say(line: str) -> None:
    """Prints a line on stderr, once in a process."""
    print(line, file=sys.stderr)
