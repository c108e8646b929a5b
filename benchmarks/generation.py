"""How fast data are generated, where the time goes, and whether a worker's memory stays flat.

    python -m benchmarks.generation [data=surround condition=mixed ...]     speed; without data= of nano and of surround
    python -m benchmarks.generation before=COMMIT [data=nano ...]           the same scenes by that commit and by this tree
    python -m benchmarks.generation memory=500                              one worker, 500 small scenes

Speed: the same few scenes in one process and in two, each twice: the first pass compiles and builds every asset, which a
long run does once, the second is timed. Other arguments are overrides of ``python -m data_gen``. Time a core is processor
time, which other programs disturb less than the clock. ``before`` makes scenes of all eight conditions in two processes, by
turns with the code of that commit (a git worktree in a temporary folder) and of this tree, and compares the sensor files.
"""

import json
import multiprocessing
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hydra import compose, initialize_config_dir

from data_gen import episode
from data_gen.generate import DataConfig, Job, make_folders
from data_gen.jobs.workers import limit_threads
from data_gen.scene import scene
from data_gen.sensors.camera import camera
from data_gen.sensors.lidar import lidar
from data_gen.sensors.radar import radar
from fusion_net.common.cli.command import CONFIGS, build

DATA = {"nano": 24, "surround": 8}
"""Data sets and how many scenes of each are timed."""
CONDITIONS = ("clear", "night", "glare", "rain", "fog", "dusk", "spray", "dusk_glare_spray")
SMALL = [
    "data=nano", "data.keyframes=1", "rig.cameras.CAM_FRONT.width=64", "rig.cameras.CAM_FRONT.height=32",
    "rig.cameras.CAM_FRONT.principal=[32.0,16.0]", "rig.lidars.LIDAR_TOP.columns=217",
]  # fmt: skip
"""The scenes that show the memory: all that differs between scenes, few rays."""
REPORT_EVERY = 50
MODES = ("before", "half", "into", "memory")
"""Arguments that are no overrides; ``half`` and ``into`` are for the processes of ``before`` alone."""
STEPS = {
    "simulate": (episode, "record_layout"),
    "traffic": (episode, "populate"),
    "scenery": (episode, "build_world"),
    "scene trees": (episode, "Scene"),
    "camera": (camera, "sense"),
    "LiDAR": (lidar, "sense"),
    "radar": (radar, "sense_batch"),
}
"""The function that does each step, in the module through which it is called; what is left is files."""
RAYS = {
    "world": ("meet_world", "blocked_by_world"),
    "bodies": ("meet_bodies", "blocked_by_bodies"),
}
"""The loops of ``scene`` in which embree casts rays: through the static world, little else, which is the least that a keyframe
could take; and through bodies, into whose frames they are moved there. Older commits lack them."""


class Stopwatch:
    """Adds up the processor time of every step while scenes are made."""

    def __init__(self) -> None:
        self.seconds, self.rays = dict.fromkeys(STEPS, 0.0), dict.fromkeys(RAYS, 0.0)
        for step, (module, name) in STEPS.items():
            setattr(module, name, self._timed(self.seconds, step, getattr(module, name)))
        for kind, names in RAYS.items():
            for name in filter(scene.__dict__.__contains__, names):
                setattr(scene, name, self._timed(self.rays, kind, getattr(scene, name)))

    def _timed(self, seconds: dict[str, float], step: str, function: Callable) -> Callable:
        def timed(*args: Any, **kwargs: Any) -> Any:
            started = time.process_time()
            try:
                return function(*args, **kwargs)
            finally:
                seconds[step] += time.process_time() - started

        return timed


def prepared(root: str, overrides: list[str], scenes: int) -> Job:
    """A job with its folders made."""
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        cfg = compose("data_gen", overrides=overrides)
    parts = {name: build(cfg[name], name) for name in ("rig", "scenario", "condition")}
    job = Job(DataConfig("speed", root, scenes, int(cfg.data.keyframes)), **parts, seed=cfg.seed)
    make_folders(job)
    return job


def make(root: str, overrides: list[str], indices: range) -> dict[str, Any]:
    """Scenes ``indices`` for the second time: seconds of processor and clock, the split in ms a keyframe, megabytes."""
    limit_threads()
    jobs = [prepared(f"{root}/{pass_}", overrides, indices.stop) for pass_ in ("warm_up", "timed")]
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
    frames = len(indices) * jobs[1].data.keyframes
    split, rays = (
        {step: 1e3 * seconds / frames for step, seconds in spent.items()} for spent in (watch.seconds, watch.rays)
    )
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {
        "frames": frames, "cpu_s": cpu, "clock_s": clock, "first_scene_s": first, "peak_mb": memory,
        "ms_per_keyframe": split, "rays_ms": rays,
    }  # fmt: skip


def speed(name: str, overrides: list[str]) -> dict[str, Any]:
    """Prints the table of one data set; returns its figures."""
    scenes = DATA.get(name, DATA["surround"])
    shares, runs = {1: [range(scenes)], 2: [range(0, scenes, 2), range(1, scenes, 2)]}, {}
    for workers, parts in shares.items():
        with tempfile.TemporaryDirectory() as folder, multiprocessing.get_context("spawn").Pool(workers) as pool:
            jobs = [(str(Path(folder) / str(n)), overrides, share) for n, share in enumerate(parts)]
            runs[workers] = pool.starmap(make, jobs, chunksize=1)
    one = runs[1][0]
    per_core, per_clock = one["frames"] / one["cpu_s"], one["frames"] / one["clock_s"]
    together = sum(run["frames"] for run in runs[2]) / max(run["clock_s"] for run in runs[2])
    print(f"{name}: {one['frames']} keyframes; the very first scene took {one['first_scene_s']:.1f} s")
    print(
        f"keyframes a second: {per_core:.1f} a core-second, {per_clock:.1f} with one process, {together:.1f} with two"
    )
    for step, milliseconds in one["ms_per_keyframe"].items():
        print(f"{step:14}{milliseconds:8.1f} ms a keyframe")
    print(f"of that rays: {_rays(one['rays_ms'])}")
    print(f"peak memory {max(run['peak_mb'] for run in runs[2]):.0f} MB a process\n")
    return {
        "keyframes_per_core_second": per_core, "keyframes_per_second_1": per_clock, "keyframes_per_second_2": together,
        "speedup_2_over_1": together / per_clock, "runs": runs,
    }  # fmt: skip


def _rays(rays_ms: dict[str, float]) -> str:
    return ", ".join(f"{milliseconds:.1f} ms a keyframe through {kind}" for kind, milliseconds in rays_ms.items())


def compare(commit: str, sets: dict[str, list[str]]) -> dict[str, Any]:
    """Prints, for each data set, keyframes a second and the split of the time of ``commit`` and of this tree, and how many
    sensor files are equal; returns the figures."""
    project, results = Path(__file__).resolve().parents[1], {}
    with tempfile.TemporaryDirectory() as folder:
        old = Path(folder) / "tree"
        git = ["git", "-C", str(project), "worktree"]
        subprocess.run([*git, "add", "--detach", str(old), commit], check=True, capture_output=True)
        try:
            for name, overrides in sets.items():
                trees = {"before": old, "after": project}
                runs = {when: _two(tree, f"{folder}/{name}-{when}", overrides) for when, tree in trees.items()}
                results[name] = _print_compared(name, runs, *(Path(folder) / f"{name}-{when}" for when in trees))
        finally:
            subprocess.run([*git, "remove", "--force", str(old)], check=True)
    return results


def _two(tree: Path, folder: str, overrides: list[str]) -> dict[str, Any]:
    """What two processes with the code of ``tree`` made, each half of the conditions: keyframes a second, the split."""
    command, env = [sys.executable, str(Path(__file__).resolve())], os.environ | {"PYTHONPATH": str(tree)}
    halves = [
        subprocess.Popen([*command, f"half={half}", f"into={folder}", *overrides], env=env, cwd=tree, stdout=subprocess.PIPE)
        for half in (0, 1)
    ]  # fmt: skip
    out = [half.communicate()[0] for half in halves]
    if any(half.returncode for half in halves):
        raise SystemExit(f"scenes could not be made with the code in {tree}: see above")
    made = [json.loads(text.splitlines()[-1]) for text in out]
    parts = [part for half in made for part in half]
    mean = {
        key: {step: sum(part[key][step] for part in parts) / len(parts) for step in parts[0][key]}
        for key in ("ms_per_keyframe", "rays_ms")
    }
    speeds = [sum(part["frames"] for part in half) / sum(part["clock_s"] for part in half) for half in made]
    return {"keyframes_per_second_2": sum(speeds), **mean}


def _half(which: int, folder: str, overrides: list[str]) -> list[dict[str, Any]]:
    """Scenes of every other condition."""
    scenes = range(DATA["nano" if "data=nano" in overrides else "surround"] // len(CONDITIONS))
    return [
        make(f"{folder}/{condition}", [*overrides, f"condition={condition}"], scenes)
        for condition in CONDITIONS[which::2]
    ]


def _print_compared(name: str, runs: dict[str, dict[str, Any]], before: Path, after: Path) -> dict[str, Any]:
    files = {path.relative_to(after) for path in after.glob("*/timed/s*/*/*")}
    unequal = sorted(
        str(path)
        for path in files
        if not (before / path).exists() or (before / path).read_bytes() != (after / path).read_bytes()
    )
    speeds = " -> ".join(f"{run['keyframes_per_second_2']:.1f}" for run in runs.values())
    print(f"{name}: keyframes a second, two processes: {speeds}")
    old, new = (run["ms_per_keyframe"] for run in runs.values())
    for step in new:
        print(f"{step:14}{old[step]:8.1f} ->{new[step]:8.1f} ms a keyframe")
    print(f"{'all':14}{sum(old.values()):8.1f} ->{sum(new.values()):8.1f} ms a keyframe")
    print(f"of that rays: {_rays(runs['after']['rays_ms'])}")
    print(
        f"sensor files: {len(files)}, of them equal {len(files) - len(unequal)}; not: {', '.join(unequal[:20]) or 'none'}\n"
    )
    return {**runs, "files": len(files), "unequal": unequal}


def memory(scenes: int, overrides: list[str]) -> dict[str, Any]:
    """Makes small scenes one after the other and prints the resident size now and then; returns it in MB by scene."""
    limit_threads()
    resident = {}
    with tempfile.TemporaryDirectory() as folder:
        job = prepared(folder, [*SMALL, *overrides], scenes)
        for index in range(scenes):
            job.make(index, "train")
            if (index + 1) % REPORT_EVERY == 0:
                resident[index + 1] = round(_resident_mb(), 1)
                print(f"{index + 1:6} scenes{resident[index + 1]:8.1f} MB", flush=True)
    late = {n: mb for n, mb in resident.items() if n >= scenes // 2}
    growth = (late[max(late)] - late[min(late)]) / max(max(late) - min(late), 1) * 100 if late else float("nan")
    print(f"{growth:.1f} MB more every 100 scenes, over the second half")
    return {"resident_mb": resident, "growth_mb_per_100_scenes": growth}


def _resident_mb() -> float:
    """Resident size now; where there is no /proc, its peak so far."""
    pages = Path("/proc/self/statm")
    if pages.exists():
        return int(pages.read_text(encoding="utf-8").split()[1]) * resource.getpagesize() / 2**20
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main(arguments: list[str]) -> None:
    """Print the tables and, last, one JSON object."""
    modes = {key: value for key, _, value in (a.partition("=") for a in arguments) if key in MODES}
    overrides = [argument for argument in arguments if argument.partition("=")[0] not in MODES]
    if "memory" in modes:
        print(json.dumps(memory(int(modes["memory"]), overrides)))
        return
    if "half" in modes:
        print(json.dumps(_half(int(modes["half"]), modes["into"], overrides)))
        return
    named = [argument.removeprefix("data=") for argument in arguments if argument.startswith("data=")]
    sets = {name: [f"data={name}", *(o for o in overrides if not o.startswith("data="))] for name in named or DATA}
    if "before" in modes:
        print(json.dumps(compare(modes["before"], sets)))
        return
    print(json.dumps({name: speed(name, given) for name, given in sets.items()}))


if __name__ == "__main__":
    main(sys.argv[1:])
