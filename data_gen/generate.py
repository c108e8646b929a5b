"""Fills a folder with a data set: scenes in parallel processes, resumable, then the nuScenes tables.

A scene's rows are written to ``scenes/NAME.json`` when all its files are on disk, so an interrupted run loses at most the
scenes it was at. Tables, splits and the finished manifest come last. Which scenes exist and what they hold depends on the
settings and on the scene's index, never on the number of workers or scenes.
"""

import fcntl
import hashlib
import json
import multiprocessing.connection
import os
import shutil
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import cv2
from beartype import beartype
from tqdm import tqdm

from data_gen import tables
from data_gen.conditions import ConditionMix
from data_gen.episode import Scenario, build_episode
from data_gen.random import stream
from data_gen.rig import Rig
from data_gen.writer import write_json, write_scene

FORMAT = 1
"""Raised when the same settings give other bytes than before: old folders are then not continued."""


@beartype
@dataclass(frozen=True)
class DataConfig:
    """What to generate. ``split_weights`` shares scenes out to splits, evenly along the scene index; ``keyframes`` a scene."""

    name: str
    root: str
    num_scenes: int
    keyframes: int
    split_weights: dict[str, int] = field(default_factory=lambda: {"train": 20, "val": 2, "test": 1})

    def __post_init__(self) -> None:
        if self.num_scenes < 1 or self.keyframes < 1:
            raise ValueError(f"num_scenes={self.num_scenes} and keyframes={self.keyframes} must be at least 1")
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

    def make(self, index: int, split: str) -> None:
        """Renders and writes one scene."""
        name = scene_name(index)
        seed = int(stream(self.seed, "scene", index).integers(2**62))
        duration = 1.0 + self.data.keyframes / self.rig.keyframe_rate
        layout = self.scenario.draw(split, seed=seed)
        scene = build_episode(name=name, layout=layout, seed=seed, duration=duration, condition=self.condition)
        rows = write_scene(
            scene, self.rig, root=Path(self.data.root), dataset=self.data.name, index=index,
            keyframes=self.data.keyframes, seed=seed, layout=layout,
        )  # fmt: skip
        write_json(record_path(Path(self.data.root), index), rows)


def scene_name(index: int) -> str:
    """The nuScenes name of the scene with this index."""
    return f"scene-{index:05d}"


def record_path(root: Path, index: int) -> Path:
    """Where a finished scene's rows lie."""
    return root / "scenes" / f"{scene_name(index)}.json"


def generate(job: Job, *, settings: dict[str, Any], workers: int | None = None) -> dict[str, Any]:
    """Makes every scene that is missing, then the tables. ``settings`` are the resolved ones, for the manifest.

    Returns the manifest. Raises ValueError when the folder holds something else, OSError when the disk does not take it.
    """
    if workers is not None and not (isinstance(workers, int) and workers >= 1):
        raise ValueError(f"workers={workers} is not a number of processes: 1 or more, or null for one a core")
    root = Path(job.data.root)
    manifest = _manifest(job, settings)
    _check_folder(root, manifest)
    make_folders(job)
    with _only_generator(root):
        write_json(root / "manifest.json", manifest)
        splits = job.data.splits()
        missing = [index for index in range(job.data.num_scenes) if not record_path(root, index).exists()]
        started = time.perf_counter()
        _make_all(job, missing, splits, workers or os.cpu_count() or 1)
        seconds = time.perf_counter() - started
        counts = tables.write_tables(
            root, job.data.name, job.rig, [record_path(root, index) for index in range(len(splits))], splits
        )
        manifest |= {"complete": True, "counts": counts}
        write_json(root / "manifest.json", manifest)
    frames = len(missing) * job.data.keyframes
    if frames:
        print(f"{frames} keyframes in {seconds:.0f} s: {frames / seconds:.1f} a second")
    return manifest


def make_folders(job: Job) -> None:
    """The tree that scenes are written into."""
    channels = [f"{kind}/{channel}" for kind in ("samples", "sweeps") for channel in job.rig.sensors]
    for folder in (*channels, "maps", "scenes"):
        (Path(job.data.root) / folder).mkdir(parents=True, exist_ok=True)


def _make_all(job: Job, missing: list[int], splits: list[str], workers: int) -> None:
    bar = tqdm(
        total=len(splits), initial=len(splits) - len(missing), desc=f"data_gen {job.data.name}", unit="scene",
        mininterval=None if os.isatty(2) else 20, ascii=True,
    )  # fmt: skip
    with bar:
        if workers == 1 or len(missing) <= 1:
            for index in missing:
                job.make(index, splits[index])
                bar.update()
            return
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(min(workers, len(missing)), mp_context=context, initializer=_start_worker) as pool:
            futures = [pool.submit(job.make, index, splits[index]) for index in missing]
            try:
                for future in as_completed(futures):
                    future.result()
                    bar.update()
            except BrokenProcessPool as error:
                raise OSError(
                    "a worker process was killed, perhaps for want of memory; finished scenes are kept, and the same"
                    " command goes on (workers=1 takes the least memory)"
                ) from error
            except BaseException:
                pool.shutdown(wait=True, cancel_futures=True)
                raise


def limit_threads() -> None:
    """A worker is one process on one core: libraries must not start threads of their own in it."""
    cv2.setNumThreads(1)


def _start_worker() -> None:
    """One thread, and an end when the parent ends, even if that is killed: orphans would wait for work for ever."""
    limit_threads()
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    multiprocessing.connection.wait([sentinel])
    os._exit(1)


def _manifest(job: Job, settings: dict[str, Any]) -> dict[str, Any]:
    content = {key: value for key, value in settings.items() if key not in ("data", "workers")}
    content["keyframes"], content["split_weights"] = job.data.keyframes, job.data.split_weights
    digest = hashlib.sha256(json.dumps([FORMAT, content], sort_keys=True).encode()).hexdigest()
    return {
        "format": FORMAT, "hash": digest, "complete": False, "name": job.data.name, "num_scenes": job.data.num_scenes,
        "settings": content, "data": asdict(job.data),
    }  # fmt: skip


def _check_folder(root: Path, manifest: dict[str, Any]) -> None:
    if root.exists() and not root.is_dir():
        raise ValueError(f"data.root={root} is a file, not a folder")
    path = root / "manifest.json"
    if not path.exists():
        if root.exists() and any(root.iterdir()):
            raise ValueError(f"data.root={root} holds other files and no manifest; pass data.root=ANOTHER_FOLDER")
        return
    try:
        old = json.loads(path.read_text())
        differs = [] if old["hash"] == manifest["hash"] else _differences(old["settings"], manifest["settings"])
        same_format = old["format"] == FORMAT
    except (json.JSONDecodeError, KeyError, TypeError) as error:
        raise ValueError(f"{path} is damaged ({error}); delete {root} and generate it again") from error
    if not same_format:
        raise ValueError(
            f"{root} was made by format {old['format']} of the generator, this is {FORMAT}; pass data.root=NEW"
        )
    if differs:
        raise ValueError(
            f"{root} was generated with other settings ({', '.join(differs[:3])}); pass data.root=ANOTHER_FOLDER, or"
            f" delete {root}"
        )


def _differences(old: Any, new: Any, path: str = "") -> list[str]:
    """Dotted names of the settings that differ, with both values."""
    if isinstance(old, dict) and isinstance(new, dict):
        return [d for key in sorted({*old, *new}) for d in _differences(old.get(key), new.get(key), f"{path}.{key}")]
    return [] if old == new else [f"{path[1:]}: {old} there, {new} asked for"]


@contextmanager
def _only_generator(root: Path) -> Iterator[None]:
    """One generator a folder: a second one gets an error instead of a mixed tree."""
    with open(root / ".lock", "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ValueError(
                f"another generator is writing to {root}; wait for it or pass data.root=ANOTHER"
            ) from error
        if shutil.disk_usage(root).free < 50 * 2**20:
            raise OSError(f"less than 50 MiB are free on the disk of {root}; scenes already written are kept")
        yield
