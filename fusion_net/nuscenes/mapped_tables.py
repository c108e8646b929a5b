"""The large tables of a data set in a form that is mapped instead of parsed: opened at once, and in memory only as far as read.

``ROOT/.cache/VERSION/tables-HASH`` holds the text of each record and where it lies; HASH is of name, size and time of the
JSON files and of the code that checks them, so that what it holds has been checked. Any other such file is stale and deleted.
"""

import hashlib
import json
import mmap
import os
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.array_block import block_parts, read_block
from fusion_net.common.atomic import replacing
from fusion_net.nuscenes.table_fields import FIELDS, Record, Tables
from fusion_net.nuscenes.tables import load_tables, read_json

LARGE = ("sample_data", "ego_pose", "instance", "sample_annotation")
"""Tables that are mapped; the others are small and parsed."""

CHECKSUM = 8
"""Bytes at the end of the file."""
KEPT = 2
"""Files of a version folder that are kept: two working copies of the code may read one data set."""


class MappedTable(Mapping[str, Any]):
    """A table of :func:`map_tables` by token; a record is parsed when it is asked for."""

    def __init__(self, path: Path, name: str) -> None:
        self._path, self._name = path, name
        stat = path.stat()
        arrays = _mapped(path, stat.st_size, stat.st_mtime_ns)
        self._text, self._start = arrays[f"{name}.text"], arrays[f"{name}.start"]
        self._sorted, self._row = arrays[f"{name}.sorted"], arrays[f"{name}.row"]
        self._record = lru_cache(maxsize=4096)(self._parsed)

    def __reduce__(self) -> tuple:
        """A process that is spawned maps the file itself."""
        return MappedTable, (self._path, self._name)

    def __len__(self) -> int:
        return len(self._row)

    def __iter__(self) -> Iterator[str]:
        tokens = np.empty(len(self), self._sorted.dtype)
        tokens[self._row] = self._sorted
        return (token.decode() for token in tokens.tolist())

    def __getitem__(self, token: str) -> Any:
        return self._record(token)

    def values(self):  # type: ignore[override]
        """The records in the order of the table."""
        return (self._at(row) for row in range(len(self)))

    def items(self):  # type: ignore[override]
        """Tokens and records in the order of the table."""
        return zip(self, self.values(), strict=True)

    def _parsed(self, token: str) -> Any:
        wanted = token.encode()
        place = int(np.searchsorted(self._sorted, np.bytes_(wanted)))
        if place == len(self) or self._sorted[place] != wanted:
            raise KeyError(token)
        return self._at(int(self._row[place]))

    def _at(self, row: int) -> Any:
        return json.loads(str(self._text[self._start[row] : self._start[row + 1]].data, "utf-8"))


class View(Mapping[str, Any]):
    """A mapping whose values are made of those of another one when they are asked for."""

    def __init__(self, source: Mapping[str, Any], make: Callable[[Any], Any]) -> None:
        self._source, self._make = source, make

    def __len__(self) -> int:
        return len(self._source)

    def __iter__(self) -> Iterator[str]:
        return iter(self._source)

    def __getitem__(self, token: str) -> Any:
        return self._make(self._source[token])


@dataclass(frozen=True)
class MappedTables:
    """The tables of a data set, the large ones mapped. ``keyframes``: of a sample, the tokens of its keyframes in
    sample_data; ``scenes``: of a scene, the tokens of its records in sample_data and sample_annotation."""

    tables: Tables
    keyframes: MappedTable
    scenes: MappedTable


def map_tables(root: Path, folder: Path) -> MappedTables | None:
    """The tables of a version folder; checked, and written in the form that is mapped, where that is not there yet. None
    where it cannot be written."""
    target = cache_folder(root, folder) / f"tables-{_hash(folder)}"
    with suppress(OSError):  # nobody can write there, or another process was first
        if not _is_whole(target) and _is_writable(target.parent):
            _write(target, load_tables(folder))
            _delete_oldest(target.parent)
    if not _is_whole(target):
        return None
    mapped: dict[str, Any] = {name: MappedTable(target, name) for name in (*LARGE, "keyframes", "scenes")}
    small = [name for name in FIELDS if name not in LARGE]
    parsed = {name: {each["token"]: each for each in read_json(folder / f"{name}.json")} for name in small}
    return MappedTables({name: mapped[name] for name in LARGE} | parsed, mapped["keyframes"], mapped["scenes"])


def cache_folder(root: Path, folder: Path) -> Path:
    """Where what is computed of a version folder of a data set is kept."""
    return root / ".cache" / folder.name


def listed(folder: Path) -> list[str]:
    """Name, size and time of each file in a folder, sorted."""
    try:
        with os.scandir(folder) as entries:
            stats = [(entry.name, entry.stat()) for entry in entries if entry.is_file()]
    except (FileNotFoundError, NotADirectoryError):
        return []
    return sorted(f"{name} {stat.st_size} {stat.st_mtime_ns}" for name, stat in stats)


@cache
def code_hash(*rooms: str) -> str:
    """Hash of the code in some rooms of the package."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted(path for room in rooms for path in (package / room).rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _hash(folder: Path) -> str:
    about = [code_hash("common", "nuscenes"), *listed(folder)]
    return hashlib.sha256("\n".join(about).encode("utf-8", "surrogateescape")).hexdigest()[:16]


@lru_cache(maxsize=64)
def _mapped(path: Path, size: int, changed: int) -> dict[str, NDArray]:
    """The arrays of a file of this size and time of change: pages of an older one may be gone."""
    with path.open("rb") as file:
        return read_block(memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)))[1]


@lru_cache(maxsize=64)
def _is_same(path: Path, size: int, changed: int) -> bool:
    """Whether a file of this size and time of change ends with the checksum of what comes before."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        whole = memoryview(content)
        try:
            return zlib.crc32(whole[:-CHECKSUM]) == int.from_bytes(whole[-CHECKSUM:], "little")
        finally:
            whole.release()


def _is_whole(path: Path) -> bool:
    """Whether the file is there as it was written: what is in the cache may be deleted or damaged, and is made again."""
    try:
        stat = path.stat()
        return stat.st_size > CHECKSUM and _is_same(path, stat.st_size, stat.st_mtime_ns)
    except OSError:
        return False


def _is_writable(folder: Path) -> bool:
    folder.mkdir(parents=True, exist_ok=True)
    return os.access(folder, os.W_OK)


def _write(target: Path, tables: Tables) -> None:
    """Writes the file under a name of this process's own and moves it: another process may do the same."""
    arrays: dict[str, NDArray] = {}
    for name, records in ({name: tables[name] for name in LARGE} | _derived(tables)).items():
        arrays |= _arrays(name, records)
    own = target.with_name(f".{target.name}-{os.getpid()}")
    try:
        with replacing(own) as file:
            checksum = 0
            for part in block_parts("tables", arrays):
                file.write(part)
                checksum = zlib.crc32(part, checksum)
            file.write(checksum.to_bytes(CHECKSUM, "little"))
        own.replace(target)
    finally:
        with suppress(OSError):
            own.unlink(missing_ok=True)


def _delete_oldest(folder: Path) -> None:
    """Leaves the ``KEPT`` files that were written last, and none that is half written."""
    written = sorted(folder.glob("tables-*"), key=lambda path: path.stat().st_mtime)
    for path in [*written[:-KEPT], *folder.glob(".tables-*")]:
        path.unlink(missing_ok=True)


def _derived(tables: Tables) -> dict[str, dict[str, Any]]:
    keyframes: dict[str, list[str]] = {token: [] for token in tables["sample"]}
    scenes: dict[str, dict[str, list[str]]] = defaultdict(lambda: {"sample_data": [], "sample_annotation": []})
    for record in tables["sample_data"].values():
        if record["is_key_frame"]:
            keyframes[record["sample_token"]].append(record["token"])
    for name in ("sample_data", "sample_annotation"):
        for record in tables[name].values():
            scenes[tables["sample"][record["sample_token"]]["scene_token"]][name].append(record["token"])
    return {"keyframes": keyframes, "scenes": {token: scenes[token] for token in tables["scene"]}}


def _arrays(name: str, records: Mapping[str, Record]) -> dict[str, NDArray]:
    texts = [json.dumps(record, separators=(",", ":")).encode() for record in records.values()]
    tokens = np.array([token.encode() for token in records], np.bytes_)
    row = np.argsort(tokens, kind="stable")
    start = np.concatenate([[0], np.cumsum([len(text) for text in texts], dtype=np.int64)])
    text = np.frombuffer(b"".join(texts), np.uint8)
    return {f"{name}.text": text, f"{name}.start": start, f"{name}.sorted": tokens[row], f"{name}.row": row}
