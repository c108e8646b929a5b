"""What a folder of generated data says of itself, and whether a generator may write into it."""

import hashlib
import json
import re
import shlex
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fusion_net.common.atomic import LOCK, only_writer
from fusion_net.common.nuscenes_format import MANIFEST_FILE
from fusion_net.common.settings import differences

FORMAT = 3
"""Raised when the same settings give other bytes than before: old folders are then not continued."""
OWN = {LOCK, f"{MANIFEST_FILE}.part"}
"""What lies in a folder in which a generator stopped before it wrote the manifest."""
ROOM = 50 * 2**20
"""Bytes that must be free before anything is written."""


def make_manifest(settings: dict[str, Any], **about: Any) -> dict[str, Any]:
    """The manifest of a data set that is not finished. ``settings`` are those that its bytes depend on: their hash names
    it, and all its shards. ``about`` is whatever else to keep: nothing that tells one folder of these settings from
    another."""
    digest = hashlib.sha256(json.dumps([FORMAT, settings], sort_keys=True).encode()).hexdigest()
    return {"format": FORMAT, "hash": digest, "complete": False, **about, "settings": settings}


def without_place(command: list[str]) -> str:
    """A command line without the folder and the number of processes, on which no byte of the data depends."""
    return shlex.join(word for word in command if not re.match(r"\+*(data\.root|workers)=", word))


def check_folder(root: Path, manifest: dict[str, Any]) -> None:
    """ValueError when ``root`` holds anything but a part of the data set of this manifest."""
    if root.exists() and not root.is_dir():
        raise ValueError(f"data.root={root} is a file, not a folder")
    path = root / MANIFEST_FILE
    if not path.exists():
        if root.exists() and any(root.glob("shard-*-of-*")):
            raise ValueError(f"data.root={root} holds shards; pass shard=NUMBER/COUNT or data.root=ANOTHER_FOLDER")
        if root.exists() and {path.name for path in root.iterdir()} - OWN:
            raise ValueError(f"data.root={root} holds other files and no manifest; pass data.root=ANOTHER_FOLDER")
        return
    try:
        old = json.loads(path.read_bytes())
        is_ours = old["format"] == FORMAT
        is_other = is_ours and old["hash"] != manifest["hash"]
        differs = differences(old["settings"], manifest["settings"]) if is_other else []
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path} is damaged ({error}); delete {root} and generate it again") from error
    if not is_ours:
        raise ValueError(
            f"{root} was made by format {old['format']} of the generator, this is {FORMAT}; pass data.root=ANOTHER_FOLDER"
        )
    if differs:
        raise ValueError(
            f"{root} was generated with other settings ({', '.join(differs[:3])}); pass data.root=ANOTHER_FOLDER, or"
            f" delete {root}"
        )


def check_parent(parent: Path, shard: Path, manifest: dict[str, Any]) -> None:
    """ValueError when ``parent`` holds a data set that is not in shards, or shards that ``shard`` is none of."""
    if (parent / MANIFEST_FILE).exists():
        raise ValueError(f"data.root={parent} holds a data set that is not in shards; pass data.root=ANOTHER_FOLDER")
    count = shard.name.rpartition("-")[2]
    for other in sorted(parent.glob("shard-*-of-*")):
        if not other.name.endswith(f"-of-{count}"):
            raise ValueError(f"{other} is none of {count} shards; pass data.root=ANOTHER_FOLDER")
        if other != shard and (other / MANIFEST_FILE).exists():
            check_folder(other, manifest)


@contextmanager
def only_generator(root: Path) -> Iterator[None]:
    """The folder, made if need be, for one generator: a second one gets an error instead of a mixed tree."""
    try:
        root.mkdir(parents=True, exist_ok=True)
        (root / LOCK).touch()
    except OSError as error:
        raise OSError(f"cannot write to data.root={root} ({error.strerror}); pass data.root=ANOTHER_FOLDER") from error
    with only_writer(root, f"another generator is writing to {root}; wait for it or pass data.root=ANOTHER_FOLDER"):
        if shutil.disk_usage(root).free < ROOM:
            raise OSError(
                f"less than {ROOM // 2**20} MiB are free on the disk of {root}; scenes already written are kept: make room"
                " and give the same command again"
            )
        yield
