"""Files that are whole or not there at all, and folders that one process at a time writes to, whenever it is killed."""

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

LOCK = ".lock"
"""The file in the folder whose lock its writer holds. It stays there; the lock ends with the process, however that ends."""


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """A file to write that takes the place of ``path`` once it is whole and on the disk. Until then, and after an
    exception, what ``path`` held before stays."""
    part = path.with_name(f"{path.name}.part")
    try:
        with part.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def write_json(path: Path, value: Any) -> None:
    """Writes compact JSON as a whole or not at all."""
    with replacing(path) as file:
        file.write(json.dumps(value, separators=(",", ":")).encode())


@contextmanager
def only_writer(folder: Path, busy: str) -> Iterator[None]:
    """The folder, made if need be, for this process alone. ValueError(busy) while another one has it."""
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / LOCK, "w", encoding="utf-8") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ValueError(busy) from error
        try:
            yield
        finally:
            fcntl.flock(lock, fcntl.LOCK_UN)  # a forked process may still hold the file open
