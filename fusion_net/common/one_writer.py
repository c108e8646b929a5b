"""A folder that one process at a time writes to."""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LOCK = ".lock"
"""The file in the folder whose lock its writer holds. It stays there; the lock ends with the process, however that ends."""


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
