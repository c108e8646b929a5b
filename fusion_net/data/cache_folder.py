"""Where the decoded samples of a data set lie, and when they are still those that its files give.

``ROOT/.cache/VERSION/DATA/SPLIT-READER.{data,index}``. DATA is a hash of the tables and of name, size and time of each
file that is read: a folder of another one is stale and deleted. READER is a hash of the reader's settings, of the code that
reads and of the libraries that decode: several may lie beside each other.
"""

import hashlib
import json
import os
import shutil
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import cache
from importlib.metadata import version
from pathlib import Path

import fusion_net
from fusion_net.data.disk_cache import DiskCache, say
from fusion_net.data.samples import Sample, SampleReader
from fusion_net.nuscenes.nuscenes import NuScenes

LAYOUT = 1
"""Raised when :mod:`packing` or :mod:`disk_cache` write otherwise."""
FOLDER = ".cache"
KEPT = 4
"""Caches of a split that are kept, the last used ones: sweeps over readers do not fill the disk."""
CACHES = ("disk", "memory", "none")
"""Where decoded samples are kept: beside the data, in each process that reads them, or nowhere."""
CODE = ("common", "data", "nuscenes")
"""Rooms of the package that a decoded sample depends on."""


def check_cache(cache: str | bool) -> None:
    """ValueError when it is none of ``CACHES``."""
    if cache not in CACHES:
        raise ValueError(f"dataset.cache={str(cache).lower()}: decoded samples are kept on {CACHES[0]}, in {CACHES[1]} or {CACHES[2]}; write one of these")


class SampleCache:
    """The decoded samples of an index of (data set, token), by their places in it. ``cache``: one of ``CACHES``."""

    def __init__(self, cache: str, index: Sequence[tuple[NuScenes, str]], split: str, reader: SampleReader) -> None:
        self._in_memory: dict[int, Sample] | None = None if cache == "none" else {}
        self._on_disk: dict[int, tuple[DiskCache, int]] = {}
        places: dict[NuScenes, list[int]] = defaultdict(list)
        for place, (nusc, _) in enumerate(index if cache == "disk" else ()):
            places[nusc].append(place)
        for nusc, own in places.items():
            disk = open_cache(nusc, [index[place][1] for place in own], split, reader)
            if disk is not None:
                self._on_disk |= {place: (disk, number) for number, place in enumerate(own)}

    def get(self, place: int) -> Sample | None:
        """The sample at a place, if it is kept."""
        if place in self._on_disk:
            disk, number = self._on_disk[place]
            return disk.get(number)
        return self._in_memory.get(place) if self._in_memory is not None else None

    def put(self, place: int, sample: Sample) -> Sample:
        """Keeps a sample, and returns it as it will be read."""
        if place in self._on_disk:
            disk, number = self._on_disk[place]
            return disk.put(number, sample)
        if self._in_memory is not None:
            self._in_memory[place] = sample
        return sample


def open_cache(nusc: NuScenes, tokens: Sequence[str], split: str, reader: SampleReader) -> DiskCache | None:
    """The cache of these samples of a data set. None, and a line on stderr, where none can be written or read."""
    base = nusc.root / FOLDER / nusc.folder.name
    try:
        folder = base / data_hash(nusc, reader)
        _delete_stale(base, folder.name)
        name = "".join(letter if letter.isalnum() or letter in "_-" else "_" for letter in split)[:60]
        stem = folder / f"{name}-{reader_hash(reader, tokens)}"
        _delete_oldest(folder, name, stem.name)
        return DiskCache(stem, len(tokens))
    except OSError as error:
        say(f"{base} cannot be used ({error.strerror or error}): decoded samples stay in memory; dataset.cache=none keeps none")
        return None


def data_hash(nusc: NuScenes, reader: SampleReader) -> str:
    """Of a data set's manifest, and of name, size and time of its tables and of the files in its channels' folders."""
    digest = hashlib.sha256(nusc.fingerprint.encode())
    folders = [nusc.folder]
    for channel in sorted(nusc.modalities):
        folders += [nusc.root / kind / channel for kind in ("samples", "sweeps")]
    for folder in folders:
        digest.update(f"{folder.relative_to(nusc.root)}\n".encode())
        digest.update("\n".join(sorted(_files(folder))).encode("utf-8", "surrogateescape"))
    return digest.hexdigest()[:16]


def reader_hash(reader: SampleReader, tokens: Sequence[str]) -> str:
    """Of what the decoded samples of a data set depend on beside its files. The seed counts where there are faults."""
    if not reader.faults:
        reader = replace(reader, fault_seed=0)
    settings = asdict(reader) | {"faults": [repr(fault) for fault in reader.faults]}
    about = [LAYOUT, settings, _code(), [version(name) for name in ("numpy", "scipy", "opencv-python-headless")]]
    digest = hashlib.sha256(json.dumps(about, sort_keys=True).encode())
    digest.update("\n".join(tokens).encode())
    return digest.hexdigest()[:16]


def _files(folder: Path) -> list[str]:
    try:
        with os.scandir(folder) as entries:
            stats = [(entry.name, entry.stat()) for entry in entries if entry.is_file()]
    except (FileNotFoundError, NotADirectoryError):
        return []
    return [f"{name} {stat.st_size} {stat.st_mtime_ns}" for name, stat in stats]


@cache
def _code() -> str:
    """Hash of the code of the rooms that samples come from."""
    package = Path(fusion_net.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(path for room in CODE for path in (package / room).rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _delete_stale(base: Path, current: str) -> None:
    for folder in base.iterdir() if base.is_dir() else ():
        if folder.name != current:
            shutil.rmtree(folder, ignore_errors=True)


def _delete_oldest(folder: Path, split: str, current: str) -> None:
    """Leaves ``KEPT`` caches of a split, ``current`` among them."""
    others = [path for path in folder.glob(f"{split}-*.index") if path.stem != current]
    for path in sorted(others, key=_used, reverse=True)[KEPT - 1 :]:
        for file in (path, path.with_suffix(".data")):
            file.unlink(missing_ok=True)


def _used(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except FileNotFoundError:  # another process deletes too
        return 0.0
