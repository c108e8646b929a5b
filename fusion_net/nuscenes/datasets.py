"""Several nuScenes data sets read as one: folders named in a list, or the shards in one folder."""

import re
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from fusion_net.common.nuscenes_format import MANIFEST_FILE
from fusion_net.nuscenes.absent import check_data
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.nuscenes.tables import versions

SHARD = re.compile(r"shard-(\d+)-of-(\d+)")
"""Name of a generated shard's folder: its number, from 1, and how many there are."""


def open_datasets(root: str | Sequence[str], version: str | None = None, *, mapped: bool = False) -> list[NuScenes]:
    """The data sets of a folder or of a list of folders, each a data set itself or a folder of shards. ``version`` names the
    folder of tables; in a list it chooses where there are several. ValueError when shards do not belong together; missing ones
    are named on stderr. ``mapped`` as in :class:`NuScenes`."""
    check_data(root)
    folders = [Path(folder) for folder in ([root] if isinstance(root, str) else root)]
    has_choice = [len(folders) == 1 or len(versions(folder)) > 1 for folder in folders]
    return [
        nusc
        for folder, own in zip(folders, has_choice, strict=True)
        for nusc in _open(folder, version if own else None, mapped)
    ]


def samples_of_split(
    datasets: Sequence[NuScenes], name: str, *, scenes: int | None = None
) -> list[tuple[NuScenes, str]]:
    """Samples of a split, data set by data set, but shards beside each other in the order of their scenes: as if they were one
    data set. A data set without the split (a small shard) adds none, unless all lack it. ``scenes``: only so many of each data
    set, the first ones."""
    if scenes is not None and scenes < 1:
        raise ValueError(f"scenes={scenes} leaves nothing of the split {name!r}; give at least 1, or null for all")
    having = [nusc for nusc in datasets if nusc.split_name(name) is not None] or datasets
    samples = [(nusc, token) for nusc in having for token in nusc.split(name)]
    if not samples:
        raise ValueError(f"the split {name!r} of {', '.join(str(nusc.root) for nusc in datasets)} has no samples")
    _refuse_twice(samples)
    rank: dict[Path, int] = {}
    for nusc in having:
        rank.setdefault(_whole(nusc), len(rank))
    samples.sort(key=lambda each: (rank[_whole(each[0])], _scene_of_shard(*each)))
    if scenes is None:
        return samples
    kept: dict[Path, dict[str, None]] = {}
    for nusc, token in samples:
        own = kept.setdefault(_whole(nusc), {})
        if len(own) < scenes:
            own[nusc.scene(token)["token"]] = None
    if max(map(len, kept.values())) < scenes:
        have = ", ".join(f"{root} has {len(own)}" for root, own in kept.items())
        raise ValueError(f"scenes={scenes}: of the split {name!r} {have}; give fewer, or null for all")
    return [(nusc, token) for nusc, token in samples if nusc.scene(token)["token"] in kept[_whole(nusc)]]


def sample_of_split(datasets: Sequence[NuScenes], name: str, number: int) -> tuple[NuScenes, str]:
    """The sample with this number of a split, from 0. ValueError when there is none."""
    samples = samples_of_split(datasets, name)
    if not 0 <= number < len(samples):
        raise ValueError(f"sample={number}: split {name} has samples 0 to {len(samples) - 1}")
    return samples[number]


def _open(folder: Path, version: str | None, mapped: bool) -> list[NuScenes]:
    found = {path: match for path in sorted(folder.glob("shard-*")) if (match := SHARD.fullmatch(path.name))}
    if not found or (folder / MANIFEST_FILE).exists():
        return [NuScenes(folder, version, mapped=mapped)]
    counts = sorted({int(match[2]) for match in found.values()})
    if len(counts) > 1:
        raise ValueError(f"{folder} holds shards of {counts[0]} and of {counts[1]}: move one kind to another folder")
    datasets = [NuScenes(path, version, mapped=mapped) for path in found]
    for nusc in datasets:
        if nusc.fingerprint != datasets[0].fingerprint:
            hashes = f"manifest {datasets[0].fingerprint[:12]} and {nusc.fingerprint[:12]}"
            raise ValueError(f"{datasets[0].root} and {nusc.root} were generated with other settings ({hashes})")
    missing = sorted({*range(1, counts[0] + 1)} - {int(match[1]) for match in found.values()})
    if missing:
        some = f"{', '.join(map(str, missing[:5]))}{', ...' if len(missing) > 5 else ''}"
        _warn(f"{folder}: {len(found)} of {counts[0]} shards are there; missing: {some}")
    return datasets


def _refuse_twice(samples: list[tuple[NuScenes, str]]) -> None:
    owner: dict[str, NuScenes] = {}
    for nusc, token in samples:
        if token in owner:
            raise ValueError(
                f"{owner[token].root} and {nusc.root} hold the same samples, of {nusc.scene(token)['name']}: leave one out"
                + ", or generate it under a name of its own (data.name=NAME)" * bool(nusc.fingerprint)
            )
        owner[token] = nusc


def _whole(nusc: NuScenes) -> Path:
    """The folder of the whole data set, also for one of its shards."""
    return nusc.root.parent if SHARD.fullmatch(nusc.root.name) else nusc.root


def _scene_of_shard(nusc: NuScenes, token: str) -> str:
    """Name of a sample's scene in a shard; the same for all samples of another data set, whose order is its own."""
    return nusc.scene(token)["name"] if SHARD.fullmatch(nusc.root.name) else ""


@cache
def _warn(line: str) -> None:
    """Prints a warning, once in a process."""
    print(f"warning: {line}", file=sys.stderr)
