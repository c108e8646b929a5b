"""Files that the tables name and that are not there: counted before the first is read.

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
