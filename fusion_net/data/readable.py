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
from fusion_net.nuscenes.tables import manifest, repair_advice


def refuse_missing_files(samples: Sequence[tuple[NuScenes, str]], reader: SampleReader) -> None:
    """ValueError when files are missing that ``reader`` opens for these samples (data set, token). Each folder is listed once;
    a list of a folder costs far less than a look at each of its files."""
    wanted: dict[NuScenes, dict[str, dict[str, str]]] = defaultdict(lambda: defaultdict(dict))
    for nusc, token in samples:
        for channel, past in reader.channels_of(nusc).items():
            for record in nusc.keyframe_and_sweeps(token, channel, past):
                wanted[nusc][channel][record["filename"]] = record["token"]
    for nusc, files_of in wanted.items():
        listed: dict[str, set[str]] = {}
        missing = {channel: _missing(nusc.root, files, listed) for channel, files in files_of.items()}
        if any(missing.values()):
            raise ValueError(_message(nusc, files_of, missing))


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


def _message(nusc: NuScenes, files_of: dict[str, dict[str, str]], missing: dict[str, list[str]]) -> str:
    """Counts by modality, by channel where some are there; the first file and its record; what to do."""
    channels_of: dict[str, list[str]] = defaultdict(list)
    for channel in files_of:
        channels_of[nusc.modalities[channel]].append(channel)
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
    advice = repair_advice(nusc.root) if manifest(nusc.root) else is_there
    record = f"{nusc.folder / 'sample_data.json'}: the record {files_of[channel][first]!r}"
    return f"{nusc.root}: {'; '.join(counts)}; {record} has filename={first!r}: {advice}"


def refuse_mixed_image_sizes(reader: SampleReader, samples: Sequence[tuple[NuScenes, str]]) -> None:
    """ValueError when data sets read together give unlike numbers or sizes of images, which no batch can hold."""
    first = {nusc.fingerprint or str(nusc.root): (nusc, token) for nusc, token in reversed(samples)}
    if len(first) == 1:
        return
    found = {nusc.root: reader.read(nusc, token).images.shape[:3] for nusc, token in reversed(first.values())}
    (one, shape), *others = found.items()
    for other, unlike in others:
        if shape != unlike:
            both = ((one, shape), (other, unlike))
            said = [f"{root} has {n} of {width}x{height}" for root, (n, height, width) in both]
            raise ValueError(
                f"images that no batch can hold: {', '.join(said)}; choose the same for both with dataset.train.cameras"
                " and dataset.train.image_size, or use one of the folders"
            )
