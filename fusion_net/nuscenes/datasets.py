"""Several nuScenes trees read as one data set: folders named in a list, or the shards in one folder."""

import re
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from fusion_net.common.nuscenes_format import MANIFEST_FILE
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.nuscenes.tables import versions

SHARD = re.compile(r"shard-(\d+)-of-(\d+)")
"""Name of a generated shard's folder: its number, from 1, and how many there are."""


def open_datasets(root: str | Sequence[str], version: str | None = None) -> list[NuScenes]:
    """The trees of a folder or of a list of folders, each a tree itself or a folder of shards. ``version`` names the folder
    of tables; in a list it chooses where there are several. ValueError when shards do not belong together; missing ones
    are named on stderr."""
    folders = [Path(folder) for folder in ([root] if isinstance(root, str) else root)]
    if not folders:
        raise ValueError("data.root=[] names no folder of data")
    has_choice = [len(folders) == 1 or len(versions(folder)) > 1 for folder in folders]
    return [
        tree
        for folder, own in zip(folders, has_choice, strict=True)
        for tree in _open(folder, version if own else None)
    ]


def split_of(trees: Sequence[NuScenes], name: str) -> list[tuple[NuScenes, str]]:
    """Samples of a split, tree by tree, but shards beside each other in the order of their scenes: as if they were one
    tree. A tree without the split (a small shard) adds none, unless all lack it."""
    having = [tree for tree in trees if tree.split_name(name) is not None] or trees
    samples = [(tree, token) for tree in having for token in tree.split(name)]
    if not samples:
        raise ValueError(f"the split {name!r} of {', '.join(str(tree.root) for tree in trees)} has no samples")
    _refuse_twice(samples)
    rank: dict[Path, int] = {}
    for tree in having:
        rank.setdefault(_whole(tree), len(rank))
    return sorted(samples, key=lambda each: (rank[_whole(each[0])], _scene_of_shard(*each)))


def _open(folder: Path, version: str | None) -> list[NuScenes]:
    found = {path: match for path in sorted(folder.glob("shard-*")) if (match := SHARD.fullmatch(path.name))}
    if not found or (folder / MANIFEST_FILE).exists():
        return [NuScenes(folder, version)]
    counts = sorted({int(match[2]) for match in found.values()})
    if len(counts) > 1:
        raise ValueError(f"{folder} holds shards of {counts[0]} and of {counts[1]}: move one kind to another folder")
    trees = [NuScenes(path, version) for path in found]
    for tree in trees:
        if tree.fingerprint != trees[0].fingerprint:
            hashes = f"manifest {trees[0].fingerprint[:12]} and {tree.fingerprint[:12]}"
            raise ValueError(f"{trees[0].root} and {tree.root} were generated with other settings ({hashes})")
    missing = sorted({*range(1, counts[0] + 1)} - {int(match[1]) for match in found.values()})
    if missing:
        some = f"{', '.join(map(str, missing[:5]))}{', ...' if len(missing) > 5 else ''}"
        _warn(f"{folder}: {len(found)} of {counts[0]} shards are there; missing: {some}")
    return trees


def _refuse_twice(samples: list[tuple[NuScenes, str]]) -> None:
    owner: dict[str, NuScenes] = {}
    for tree, token in samples:
        if token in owner:
            raise ValueError(
                f"{owner[token].root} and {tree.root} hold the same samples, of {tree.scene(token)['name']}: leave one out"
                + ", or generate it under a name of its own (data.name=NAME)" * bool(tree.fingerprint)
            )
        owner[token] = tree


def _whole(tree: NuScenes) -> Path:
    """The folder of the data set that a tree is, or is a shard of."""
    return tree.root.parent if SHARD.fullmatch(tree.root.name) else tree.root


def _scene_of_shard(tree: NuScenes, token: str) -> str:
    """Name of a sample's scene in a shard; the same for all samples of another tree, whose order is its own."""
    return tree.scene(token)["name"] if SHARD.fullmatch(tree.root.name) else ""


@cache
def _warn(line: str) -> None:
    """Prints a warning, once in a process."""
    print(f"warning: {line}", file=sys.stderr)
