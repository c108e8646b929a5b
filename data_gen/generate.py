"""Fills a folder with a data set: scenes in parallel processes, resumable, then the nuScenes tables.

A scene's rows are written to ``scenes/NAME.json`` when all its files are on disk, so an interrupted run loses at most the
scenes it was at. Tables, splits and the finished manifest come last. Which scenes exist and what they hold depends on the
settings and on the scene's index, never on the number of workers, shards or scenes.
"""

import errno
import json
import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from beartype import beartype

from data_gen.episode import Scenario, build_episode
from data_gen.jobs.jit import compilation_announced
from data_gen.jobs.manifest import check_folder, check_parent, make_manifest, only_generator
from data_gen.jobs.progress import Progress
from data_gen.jobs.shard import Shard
from data_gen.jobs.workers import run_parallel
from data_gen.recording import tables
from data_gen.recording.record import record_scene
from data_gen.recording.tokens import SCENE_US
from data_gen.rig.coverage import sector_covered
from data_gen.rig.rig import Rig
from data_gen.scene.conditions import ConditionMix
from data_gen.scene.scene import Scene
from fusion_net.common.atomic import write_json
from fusion_net.common.faults import Fault, FaultPlan
from fusion_net.common.nuscenes_format import FILE_SUFFIX, MANIFEST_FILE, MAPS, SAMPLES, SWEEPS
from fusion_net.common.random import stream


@beartype
@dataclass(frozen=True)
class DataConfig:
    """What to generate: ``keyframes`` per scene. ``split_weights`` distributes scenes over splits, evenly along the index."""

    name: str
    root: str
    num_scenes: int
    keyframes: int
    split_weights: dict[str, int] = field(default_factory=lambda: {"train": 20, "val": 2, "test": 1})

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[\w.-]+", self.name):
            raise ValueError(f"name={self.name!r} is part of file names: write letters, digits, '_', '-' and '.'")
        if not self.root:
            raise ValueError("root='' names no folder")
        for key in ("num_scenes", "keyframes"):
            if getattr(self, key) < 1:
                raise ValueError(f"{key}={getattr(self, key)} must be at least 1")
        if min(self.split_weights.values(), default=0) < 0 or not any(self.split_weights.values()):
            raise ValueError(f"split_weights {self.split_weights} are negative or all zero")

    def splits(self) -> list[str]:
        """The split of every scene, by smooth weighted round robin: a longer data set begins like a shorter one."""
        credit = dict.fromkeys(self.split_weights, 0)
        chosen = []
        for _ in range(self.num_scenes):
            for name, weight in self.split_weights.items():
                credit[name] += weight
            best = max(credit, key=lambda name: credit[name])
            credit[best] -= sum(self.split_weights.values())
            chosen.append(best)
        return chosen


@dataclass(frozen=True)
class Job:
    """All that a worker needs to make scenes."""

    data: DataConfig
    rig: Rig
    scenario: Scenario
    condition: ConditionMix
    seed: int
    faults: list[Fault] = field(default_factory=list)

    def __post_init__(self) -> None:
        seconds, most = self.rig.duration(self.data.keyframes), SCENE_US * 1e-6
        if seconds > most:
            raise ValueError(f"keyframes={self.data.keyframes} last {seconds:.0f} s; a scene has time for {most:.0f} s")
        beams = {channel: lidar.model.beams for channel, lidar in self.rig.lidars.items()}
        FaultPlan(self.faults).check(self.rig.modalities, beams)

    def make(self, index: int, split: str) -> None:
        """Renders and writes one scene."""
        seed, layout = self.scene_seed(index), self.layout(index, split)
        rows = record_scene(
            self.scene(index, split), self.rig, root=Path(self.data.root), dataset=self.data.name, index=index,
            keyframes=self.data.keyframes, seed=seed, layout=layout, faults=FaultPlan(self.faults, self.seed),
        )  # fmt: skip
        write_json(record_path(Path(self.data.root), index), rows)

    def scene_seed(self, index: int) -> int:
        """What all random values of a scene follow from."""
        return int(stream(self.seed, "scene", index).integers(2**62))

    def layout(self, index: int, split: str) -> str:
        """The layout of a scene."""
        return self.scenario.sample_layout(split, seed=self.scene_seed(index))

    def scene(self, index: int, split: str) -> Scene:
        """A scene, built and not yet measured."""
        return build_episode(
            name=scene_name(index),
            layout=self.layout(index, split),
            seed=self.scene_seed(index),
            duration=self.rig.duration(self.data.keyframes),
            scenario=self.scenario,
            condition=self.condition,
            view=sector_covered(self.rig),
        )


def scene_name(index: int) -> str:
    """The nuScenes name of the scene with this index."""
    return f"scene-{index:05d}"


def record_path(root: Path, index: int) -> Path:
    """Where a finished scene's rows lie."""
    return root / "scenes" / f"{scene_name(index)}.json"


def generate(
    job: Job, *, settings: dict[str, Any], workers: int | None = None, shard: Shard | None = None, command: str = ""
) -> dict[str, Any]:
    """Makes every scene that is missing, then the tables; of a shard, its own scenes in its own folder. ``settings`` are the
    resolved ones, for the manifest, and ``command``, but for ``data.root``, is what to type again if it is interrupted.

    Returns the manifest. Raises ValueError when the folder holds something else, OSError when the disk does not take it.
    """
    if workers is not None and not (isinstance(workers, int) and workers >= 1):
        raise ValueError(f"workers={workers} is not a number of processes: 1 or more, or null for one a core")
    parent, splits = Path(job.data.root), dict(enumerate(job.data.splits()))
    if shard is not None:
        splits = {index: splits[index] for index in shard.scenes(job.data.num_scenes)}
        job = replace(job, data=replace(job.data, root=str(shard.folder(parent))))
    root, manifest = Path(job.data.root), _manifest(job, settings, shard, command)
    if shard is not None:
        check_parent(parent, root, manifest)
    check_folder(root, manifest)
    with only_generator(root), _disk_named(root):
        write_json(root / MANIFEST_FILE, manifest)
        make_folders(job)
        on_disk = _sensor_files(job)
        missing = [index for index in splits if not _is_finished(record_path(root, index), on_disk)]
        started = time.perf_counter()
        _make_all(job, missing, splits, workers or os.cpu_count() or 1)
        seconds = time.perf_counter() - started
        records = {record_path(root, index): split for index, split in splits.items()}
        manifest |= {"complete": True, "counts": tables.write_tables(root, job.data.name, job.rig, records)}
        write_json(root / MANIFEST_FILE, manifest)
    frames = len(missing) * job.data.keyframes
    if frames:
        print(f"{frames} keyframes in {seconds:.0f} s: {frames / seconds:.1f} a second")
    return manifest


def make_folders(job: Job) -> None:
    """The tree that scenes are written into."""
    for folder in (*_sensor_folders(job), MAPS, "scenes"):
        (Path(job.data.root) / folder).mkdir(parents=True, exist_ok=True)


def _make_all(job: Job, missing: list[int], splits: dict[int, str], workers: int) -> None:
    title = f"data_gen {Path(job.data.root).name}"
    progress = Progress(title, total=len(splits), done=len(splits) - len(missing), unit="scene")
    scenes = [(index, splits[index]) for index in missing]
    with progress, compilation_announced(progress.say):
        if workers > 1 and len(scenes) > 1:
            run_parallel(job.make, scenes, workers=min(workers, len(scenes) - 1), done=progress.update)
            return
        for scene in scenes:
            job.make(*scene)
            progress.update()


def _manifest(job: Job, settings: dict[str, Any], shard: Shard | None, command: str) -> dict[str, Any]:
    content = {key: value for key, value in settings.items() if key not in ("data", "workers", "shard")}
    content |= {name: getattr(job.data, name) for name in ("name", "keyframes", "split_weights")}
    part = asdict(shard) if shard else None
    data = {name: value for name, value in asdict(job.data).items() if name != "root"}
    return make_manifest(content, data=data, shard=part, command=command)


def _sensor_files(job: Job) -> set[str]:
    """Sensor files that are on disk, as the tables name them, without those that are cut to nothing (an empty LiDAR file is
    an empty cloud)."""
    root, may_be_empty = Path(job.data.root), FILE_SUFFIX["lidar"]
    return {
        f"{folder}/{entry.name}"
        for folder in _sensor_folders(job)
        for entry in os.scandir(root / folder)
        if entry.stat().st_size or entry.name.endswith(may_be_empty)
    }


def _sensor_folders(job: Job) -> list[str]:
    return [f"{kind}/{channel}" for kind in (SAMPLES, SWEEPS) for channel in job.rig.sensors]


def _is_finished(record: Path, on_disk: set[str]) -> bool:
    """Whether a scene's record is there and whole, and its sensor files too: after a power cut a file can be shorter than
    what was written, and files get deleted."""
    try:
        rows = json.loads(record.read_bytes())
    except (FileNotFoundError, ValueError):
        return False
    return bool(rows) and all(row["filename"] in on_disk for row in rows["sample_data"])


@contextmanager
def _disk_named(root: Path) -> Iterator[None]:
    """A full disk is said to be one, with what to do about it."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise OSError(
            f"the disk of {root} is full ({error}); finished scenes are kept: make room and give the same command again"
        ) from error
