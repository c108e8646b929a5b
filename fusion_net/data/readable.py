"""What is checked before the first sample is read: files that the tables name and that are not there, images that no batch
can hold.

A sensor is dead where the tables have no record of it. A record without its file is an archive that was not extracted.
"""

import os
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from fusion_net.data.samples import SampleReader
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.nuscenes.tables import manifest, mend


def refuse_missing_files(samples: Sequence[tuple[NuScenes, str]], reader: SampleReader) -> None:
    """ValueError when files are missing that ``reader`` opens for these samples (tree, token). Each folder is listed once;
    a list of a folder costs far less than a look at each of its files."""
    wanted: dict[NuScenes, dict[str, dict[str, str]]] = defaultdict(lambda: defaultdict(dict))
    for tree, token in samples:
        for channel, past in reader.channels_of(tree).items():
            for record in tree.firings(token, channel, past):
                wanted[tree][channel][record["filename"]] = record["token"]
    for tree, files_of in wanted.items():
        listed: dict[str, set[str]] = {}
        missing = {channel: _missing(tree.root, files, listed) for channel, files in files_of.items()}
        if any(missing.values()):
            raise ValueError(_message(tree, files_of, missing))


def _missing(root: Path, files: dict[str, str], listed: dict[str, set[str]]) -> list[str]:
    """Of file names to the tokens of their records, the names that are not there. ``listed``: what each folder holds."""
    missing = []
    for filename in files:
        folder, _, name = filename.rpartition("/")
        if folder not in listed:
            listed[folder] = _files_in(root / folder)
        if name not in listed[folder]:
            missing.append(filename)
    return missing


def _files_in(folder: Path) -> set[str]:
    try:
        with os.scandir(folder) as entries:
            return {entry.name for entry in entries if entry.is_file()}
    except (FileNotFoundError, NotADirectoryError):
        return set()


def _message(tree: NuScenes, files_of: dict[str, dict[str, str]], missing: dict[str, list[str]]) -> str:
    """Counts by modality, by channel where some are there; the first file and its record; what to do."""
    channels_of: dict[str, list[str]] = defaultdict(list)
    for channel in files_of:
        channels_of[tree.modalities[channel]].append(channel)
    counts = []
    for modality, channels in channels_of.items():
        lost, total = (sum(len(files[channel]) for channel in channels) for files in (missing, files_of))
        some = ", ".join(f"{c} {len(missing[c])} of {len(files_of[c])}" for c in channels if missing[c])
        if lost:
            counts.append(
                f"none of {total} {modality} files exists" if lost == total else
                f"{lost} of {total} {modality} files are missing ({some})"
            )  # fmt: skip
    channel, first = next((channel, names[0]) for channel, names in missing.items() if names)
    folders = sorted({f"{name.split('/')[0]}/" for names in missing.values() for name in names})
    is_there = f"{'are' if len(folders) > 1 else 'is'} {' and '.join(folders)} extracted?"
    advice = mend(tree.root) if manifest(tree.root) else is_there
    record = f"{tree.folder / 'sample_data.json'}: the record {files_of[channel][first]!r}"
    return f"{tree.root}: {'; '.join(counts)}; {record} has filename={first!r}: {advice}"


def refuse_unlike_images(reader: SampleReader, samples: Sequence[tuple[NuScenes, str]]) -> None:
    """ValueError when data sets read together give unlike numbers or sizes of images, which no batch can hold."""
    first = {tree.fingerprint or str(tree.root): (tree, token) for tree, token in reversed(samples)}
    if len(first) == 1:
        return
    found = {tree.root: reader.read(tree, token).images.shape[:3] for tree, token in reversed(first.values())}
    (one, shape), *others = found.items()
    for other, unlike in others:
        if shape != unlike:
            both = ((one, shape), (other, unlike))
            said = [f"{root} has {n} of {width}x{height}" for root, (n, height, width) in both]
            raise ValueError(
                f"images that no batch can hold: {', '.join(said)}; choose the same for both with dataset.train.cameras"
                " and dataset.train.image_size, or use one of the folders"
            )
