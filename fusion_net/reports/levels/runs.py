"""The runs of the three levels of fusion: which there are, of which seed, and the cells of each."""

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from torch import Tensor

from fusion_net.reports.ablation.jobs import Job, find_jobs
from fusion_net.runs.run_dir import load_config

LEVELS = ("early", "mid", "late")
"""From the first merging point to the last."""


@dataclass(frozen=True)
class LevelRun:
    """A job of the sweep, with the level that its name tells and the folder of its run, which may be gone."""

    level: str
    job: Job
    folder: Path

    @property
    def is_here(self) -> bool:
        """Whether its weights are."""
        return (self.folder / "checkpoints" / "best.ckpt").exists()


def find_levels(folder: Path, committed: Path) -> list[LevelRun]:
    """Every job of ``folder`` and of ``committed``, level by level; the variant of each is its level alone, so that jobs which
    were started by hand count with those of the sweep. ValueError for a job whose name tells no level, or a seed twice."""
    runs = [_level_run(job, folder) for job in find_jobs(folder, committed)]
    seen: dict[tuple[str, int], str] = {}
    for run in runs:
        key = (run.level, run.job.seed)
        if key in seen:
            raise ValueError(
                f"{folder}: {seen[key]} and {run.job.name} are both {run.level} with seed {key[1]}; move one away"
            )
        seen[key] = run.job.name
    return sorted(runs, key=lambda run: (LEVELS.index(run.level), run.job.seed))


def gaps(runs: Sequence[LevelRun]) -> list[str]:
    """Levels without any job, and jobs without a result, a line each."""
    absent = [level for level in LEVELS if not any(run.level == level for run in runs)]
    lines = [f"{level}: no run; python train.py -m +sweep=levels makes it" for level in absent]
    return lines + [
        f"{run.level}, seed {run.job.seed}: {run.job.name}: {run.job.why}" for run in runs if run.job.result is None
    ]


def weights_hash(weights: Mapping[str, Tensor]) -> str:
    """Of a model's weights: the cells of a run that was trained again are not its own."""
    digest = hashlib.sha256()
    for name, value in weights.items():
        digest.update(name.encode())
        digest.update(value.detach().float().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()[:16]


def _level_run(job: Job, folder: Path) -> LevelRun:
    words = re.split(r"[^a-z]+", job.name.lower())
    level = next((level for level in LEVELS if level in words), None)
    if level is None:
        raise ValueError(f"{folder / job.name}: its name tells none of {', '.join(LEVELS)}; move it away or rename it")
    has_settings = job.result is None and (folder / job.name / "config.yaml").exists()
    seed = load_config(folder / job.name).seed if has_settings else job.seed
    return LevelRun(level, replace(job, overrides=(level, f"seed={seed}")), folder / job.name)
