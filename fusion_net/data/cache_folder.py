"""Where the decoded samples of a data set are kept, and when they are still those that its files give.

On disk: ``ROOT/.cache/VERSION/FILES/SPLIT-READER.{data,index}``. FILES is a hash of name, size and time of the tables and of
every file of a sensor: a folder of another one is stale and deleted. READER is a hash of the reader's settings, of the code
that reads and of the libraries that decode: several lie beside each other.
"""

import hashlib
import json
import shutil
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path

from fusion_net.data.disk_cache import DiskCache, say
from fusion_net.data.samples import Sample, SampleReader
from fusion_net.nuscenes.mapped_tables import cache_folder, code_hash
from fusion_net.nuscenes.nuscenes import NuScenes

CACHES = ("disk", "memory", "none")
"""Where decoded samples are kept: beside the data, in each process that reads them, or nowhere."""
LAYOUT = 1
"""Raised when :mod:`packing` or :mod:`disk_cache` write otherwise."""
KEPT = 4
"""Caches of a split that are kept, the last used ones: sweeps over readers do not fill the disk."""
CODE = ("common", "data", "nuscenes")
"""Rooms of the package that a decoded sample depends on."""
LIBRARIES = ("numpy", "opencv-python-headless", "scipy")


def check_cache(cache: str | bool) -> None:
    """ValueError when it is none of ``CACHES``."""
    if cache not in CACHES:
        raise ValueError(
            f"cache={str(cache).lower()}: where are decoded samples kept? Write one of {', '.join(CACHES)}"
        )


class SampleCache:
    """The decoded samples of an index of (data set, token), by their places in it. ``cache``: one of ``CACHES``. Files are
    opened, and made, when the first sample is read."""

    def __init__(self, cache: str, index: Sequence[tuple[NuScenes, str]], split: str, reader: SampleReader) -> None:
        self._in_memory: dict[int, Sample] | None = None if cache == "none" else {}
        self._places: list[tuple[int, int]] = []
        parts: dict[NuScenes, list[str]] = defaultdict(list)
        for nusc, token in index:
            parts[nusc].append(token)
            self._places.append((list(parts).index(nusc), len(parts[nusc]) - 1))
        self._parts = [
            CachePart(nusc, tokens, split, reader, is_used=cache == "disk") for nusc, tokens in parts.items()
        ]

    @property
    def new(self) -> list[tuple[NuScenes, str]]:
        """The samples of the data sets of which no cache is there yet."""
        return [(part.nusc, token) for part in self._parts if not part.is_there for token in part.tokens]

    def get(self, place: int) -> Sample | None:
        """The sample at a place, if it is kept."""
        number, row = self._places[place]
        disk = self._parts[number].disk
        return disk.get(row) if disk else self._in_memory.get(place) if self._in_memory is not None else None

    def put(self, place: int, sample: Sample) -> Sample:
        """Keeps a sample, and returns it as it will be read."""
        number, row = self._places[place]
        if disk := self._parts[number].disk:
            return disk.put(row, sample)
        if self._in_memory is not None:
            self._in_memory[place] = sample
        return sample


class CachePart:
    """The cache on disk of the samples ``tokens`` of one data set."""

    def __init__(self, nusc: NuScenes, tokens: list[str], split: str, reader: SampleReader, *, is_used: bool) -> None:
        self.nusc, self.tokens, self._is_used = nusc, tokens, is_used
        self._disk: DiskCache | None = None
        if is_used:
            name = "".join(letter if letter.isalnum() or letter in "_-" else "_" for letter in split)[:60]
            folder = cache_folder(nusc.root, nusc.folder) / nusc.files_hash
            self._split, self._stem = name, folder / f"{name}-{reader_hash(reader, tokens)}"

    @property
    def is_there(self) -> bool:
        """Whether these very files were read before."""
        return self._is_used and self._stem.with_suffix(".index").exists()

    @property
    def disk(self) -> DiskCache | None:
        """The files, opened with the first use. None where they are not used or, with a line on stderr, cannot be."""
        if self._disk is None and self._is_used:
            try:
                _delete_stale(self._stem.parent)
                self._disk = DiskCache(self._stem, len(self.tokens))
                _delete_oldest(self._stem.parent, self._split)
            except OSError as error:
                self._is_used = False
                folder = cache_folder(self.nusc.root, self.nusc.folder)
                say(f"{folder} cannot be used ({error.strerror or error}): decoded samples are kept in memory")
        return self._disk


def reader_hash(reader: SampleReader, tokens: Sequence[str]) -> str:
    """Of what the decoded samples of a data set depend on beside its files. The seed counts where there are faults."""
    if not reader.faults:
        reader = replace(reader, fault_seed=0)
    settings = asdict(reader) | {"faults": [repr(fault) for fault in reader.faults]}
    about = [LAYOUT, settings, code_hash(*CODE), [version(name) for name in LIBRARIES]]
    digest = hashlib.sha256(json.dumps(about, sort_keys=True).encode())
    digest.update("\n".join(tokens).encode())
    return digest.hexdigest()[:16]


def _delete_stale(current: Path) -> None:
    for folder in current.parent.iterdir() if current.parent.is_dir() else ():
        if folder != current and folder.is_dir():
            shutil.rmtree(folder, ignore_errors=True)


def _delete_oldest(folder: Path, split: str) -> None:
    """Leaves the ``KEPT`` caches of a split that were used last."""
    for path in sorted(folder.glob(f"{split}-*.index"), key=_used, reverse=True)[KEPT:]:
        for file in (path, path.with_suffix(".data")):
            file.unlink(missing_ok=True)


def _used(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except FileNotFoundError:  # another process deletes too
        return 0.0
