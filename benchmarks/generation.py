"""How fast data are generated, and where the time goes: ``python -m benchmarks.generation [rig=NAME ...]``.

Makes the same few scenes in one process and in two, each twice: the first pass compiles and builds every asset, which a
long run does once, the second is timed. Overrides are those of ``python -m data_gen``. Time a core is processor time, which
other programs disturb less than the clock.
"""

import json
import multiprocessing
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hydra import compose, initialize_config_dir

from data_gen import capture, episode
from data_gen.generate import DataConfig, Job, limit_threads, make_folders
from fusion_net.cli import CONFIGS, build

SCENES = 24
STEPS = {
    "simulate": (episode, "record_layout"),
    "traffic": (episode, "populate"),
    "scenery": (episode, "build_world"),
    "scene trees": (episode, "Scene"),
    "camera": (capture, "render_camera"),
    "LiDAR": (capture, "scan_lidar"),
    "radar": (capture, "detect_radars"),
}
"""The function that does each step, by the module that calls it; what is left is files."""


class Stopwatch:
    """Adds up the processor time of every step while scenes are made."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(STEPS, 0.0)
        for step, (module, name) in STEPS.items():
            setattr(module, name, self._timed(step, getattr(module, name)))

    def _timed(self, step: str, function: Callable) -> Callable:
        def timed(*args: Any, **kwargs: Any) -> Any:
            started = time.process_time()
            try:
                return function(*args, **kwargs)
            finally:
                self.seconds[step] += time.process_time() - started

        return timed


def make(root: str, overrides: list[str], indices: range) -> dict[str, Any]:
    """Scenes ``indices`` for the second time: seconds of processor and clock, the split in ms a keyframe, megabytes."""
    limit_threads()
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        cfg = compose("data_gen", overrides=overrides)
    keyframes = int(cfg.data.keyframes)
    parts = {name: build(cfg[name], name) for name in ("rig", "scenario", "condition")}
    jobs = [
        Job(DataConfig("speed", f"{root}/{time_}", SCENES, keyframes), **parts, seed=cfg.seed)
        for time_ in ("warm_up", "timed")
    ]
    for job in jobs:
        make_folders(job)
    started = time.perf_counter()
    jobs[0].make(indices[0], "train")
    first = time.perf_counter() - started
    for index in indices[1:]:
        jobs[0].make(index, "train")
    watch, cpu, clock = Stopwatch(), time.process_time(), time.perf_counter()
    for index in indices:
        jobs[1].make(index, "train")
    cpu, clock = time.process_time() - cpu, time.perf_counter() - clock
    watch.seconds["files"] = cpu - sum(watch.seconds.values())
    frames = len(indices) * keyframes
    split = {step: 1e3 * seconds / frames for step, seconds in watch.seconds.items()}
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {
        "frames": frames, "cpu_s": cpu, "clock_s": clock, "first_scene_s": first, "resident_mb": memory,
        "ms_per_keyframe": split,
    }  # fmt: skip


def main() -> None:
    """Print the table and, last, one JSON object."""
    overrides = sys.argv[1:]
    shares = {1: [range(SCENES)], 2: [range(0, SCENES, 2), range(1, SCENES, 2)]}
    runs = {}
    for workers, parts in shares.items():
        with tempfile.TemporaryDirectory() as folder, multiprocessing.get_context("spawn").Pool(workers) as pool:
            jobs = [(str(Path(folder) / str(n)), overrides, share) for n, share in enumerate(parts)]
            runs[workers] = pool.starmap(make, jobs, chunksize=1)
    one = runs[1][0]
    per_core, per_clock = one["frames"] / one["cpu_s"], one["frames"] / one["clock_s"]
    together = sum(run["frames"] for run in runs[2]) / max(run["clock_s"] for run in runs[2])
    print(f"{one['frames']} keyframes; the very first scene took {one['first_scene_s']:.1f} s")
    print(
        f"keyframes a second: {per_core:.1f} a core-second, {per_clock:.1f} with one process, {together:.1f} with two"
    )
    for step, milliseconds in one["ms_per_keyframe"].items():
        print(f"{step:14}{milliseconds:8.1f} ms a keyframe")
    print(f"resident memory {max(run['resident_mb'] for run in runs[2]):.0f} MB a process")
    figures = {
        "keyframes_per_core_second": per_core, "keyframes_per_second_1": per_clock, "keyframes_per_second_2": together,
        "speedup_2_over_1": together / per_clock, "runs": runs,
    }  # fmt: skip
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
