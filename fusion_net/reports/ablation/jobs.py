"""The jobs of a sweep: what lies in runs/sweeps/NAME, what is committed in docs/results/runs/NAME, and what is missing."""

import difflib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf

from fusion_net.common.cli.command_line import command_line, job_folder
from fusion_net.common.cli.config_files import CONFIGS
from fusion_net.reports.run_result import RESULT, read_result, write_result


@dataclass(frozen=True)
class Job:
    """A job by its folder's name. ``overrides``: what sets it apart, in the order of the sweep. Without a result, ``why``."""

    name: str
    overrides: tuple[str, ...]
    place: int  # in the sweep
    result: dict[str, Any] | None = None
    why: str = ""

    @property
    def seed(self) -> int:
        """Its seed; 1 is the default's."""
        own = [text.partition("=")[2] for text in self.overrides if text.startswith("seed=")]
        return int(own[0]) if own else int(self.result["seed"]) if self.result else 1

    @property
    def variant(self) -> tuple[str, ...]:
        """What it has in common with the other seeds."""
        return tuple(text for text in self.overrides if not text.startswith("seed="))


def committed_in(results: Path | None, folder: Path) -> Path | None:
    """Where the results of a sweep's folder are committed; None where those in the folder alone count."""
    return None if results is None else results / folder.name


def find_jobs(folder: Path, committed: Path | None) -> list[Job]:
    """Every job that either folder knows of, in the order of the sweep: with a result, begun or asked for. A job in both is
    taken from ``folder`` if its result there can be read; one whose result is damaged, and not committed, has none and says
    why. FileNotFoundError when there is no job."""
    jobs = {job.name: job for job in _asked_for(folder)}
    for path in sorted(committed.glob("*.json") if committed else ()):
        jobs[path.stem] = _scored(path.stem, path, around={})
    for path in sorted(folder.glob("*/config.yaml")):
        job = _begun(path.parent)
        if job.result is not None or job.name not in jobs or jobs[job.name].result is None:
            jobs[job.name] = job
    if not jobs:
        places = " or ".join(str(place) for place in (folder, committed) if place)
        raise FileNotFoundError(f"no job of a sweep in {places}; {_instead(folder, committed)}")
    return sorted(jobs.values(), key=lambda job: (job.place, job.name))


def _instead(folder: Path, committed: Path | None) -> str:
    """The sweep that may be meant by a folder without jobs, or how to run one."""
    others = {path.parents[1].name for path in folder.parent.glob("*/*/config.yaml")}
    others |= {path.parent.name for path in (committed.parent.glob("*/*.json") if committed else ())}
    alike = difflib.get_close_matches(folder.name, sorted(others), n=1)
    known = f"did you mean {folder.parent / alike[0]}? Or " if alike else ""
    sweeps = [path.stem for path in sorted((CONFIGS / "sweep").glob("*.yaml"))]
    meant = next(iter(difflib.get_close_matches(folder.name, sweeps, n=1)), "NAME")
    of_all = f", NAME one of {', '.join(sweeps)}" if meant == "NAME" else ""
    return f"{known}run one: {command_line(f'train.py -m +sweep={meant}')}{of_all}"


def collect(jobs: list[Job], committed: Path) -> list[str]:
    """Writes the results that there are to ``committed``, one file a job; names of those that are new or have changed."""
    written = []
    for job in jobs:
        path = committed / f"{job.name}.json"
        if job.result is not None and not (path.exists() and _scored(job.name, path, around={}).result == job.result):
            write_result(path, job.result)
            written.append(job.name)
    return written


def _begun(folder: Path) -> Job:
    """A job by the folder of its run."""
    path = folder / "env.json"
    around = json.loads(path.read_bytes()) if path.exists() else {}
    if (folder / RESULT).exists():
        return _scored(folder.name, folder / RESULT, around=around)
    if around.get("finished"):
        why = f"not scored; {command_line('eval.py', run=folder)}"
    elif (folder / "checkpoints/last.ckpt").exists():
        why = "not finished"
    else:
        why = "failed, or ended before its first checkpoint"
    return Job(folder.name, tuple(around.get("overrides") or [folder.name]), _place(around), why=why)


def _scored(name: str, path: Path, *, around: dict[str, Any]) -> Job:
    """A job by the file of its result; where that is damaged, by what its run noted down ``around`` it."""
    try:
        result = read_result(path)
    except ValueError as error:
        return Job(name, tuple(around.get("overrides") or [name]), _place(around), why=str(error))
    return Job(name, tuple(result.get("overrides") or [name]), _place(result), result)


def _place(record: dict[str, Any]) -> int:
    place = record.get("job")
    return 1_000_000 if place is None else int(place)


def _asked_for(folder: Path) -> list[Job]:
    """The jobs of the last command of the sweep, as Hydra noted it down before the first of them."""
    path = folder / "multirun.yaml"
    if not path.exists():
        return []
    noted = OmegaConf.load(path).hydra
    params = [f"{key}={value}" for key, value in (noted.sweeper.get("params") or {}).items()]
    overrides = OverridesParser.create().parse_overrides([*params, *noted.overrides.task])
    left_out = set(noted.job.config.override_dirname.exclude_keys)
    jobs = []
    for place, texts in enumerate(BasicSweeper.split_arguments(overrides, None)[0]):
        kept = [text for text in texts if text.split("=", 1)[0].lstrip("+~") not in left_out]
        jobs.append(Job(job_folder(kept), tuple(kept), place, why="not begun"))
    return jobs
