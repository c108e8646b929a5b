"""The folder of one run: its settings and surroundings, written once and never overwritten unasked. Its checkpoints are read
in :mod:`fusion_net.runs.checkpoints`, so that what is said of a folder needs no torch."""

import difflib
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from yaml import YAMLError

from fusion_net.common.atomic import replacing
from fusion_net.common.cli.command_line import command_line, job_number, job_overrides
from fusion_net.common.settings import differences
from fusion_net.reports.run_result import RESULT
from fusion_net.runs.environment import environment

LONGEST_NAME = 200
"""Bytes of a folder's name; file systems take 255."""
MOST_NAMED = 4
"""Runs that a message names."""
ABOUT_THE_FOLDER = ("name", "resume", "overwrite", "skip_finished", "evaluate")
"""Settings that say what to do with a run's folder, and not what the run is."""
NONFINITE = "nonfinite_batch.pt"
"""The batch whose loss was not finite, in the folder of the run that it ended."""
FREE_ON_RESUME = (
    "data.", "dataset.train.root", "dataset.val.root", "dataset.train.version", "dataset.val.version", "dataset.workers",
    "dataset.cache", "dataset.train.cache", "dataset.val.cache", "trainer.max_minutes", "trainer.save_every",
    "trainer.accelerator", "trainer.devices", "trainer.batch_size", "trainer.strategy", "trainer.threads",
)  # fmt: skip
"""Settings that may change from an interruption to its resumption: where the same data lies, and how fast the run is. Devices
and the samples of each may change while a step's samples stay."""


def run_folder(name: str) -> Path:
    """``runs/NAME``. ValueError when that would not be a folder of its own below ``runs/``; NAME may hold folders: a/b."""
    text, runs = str(name), Path("runs")
    parts = text.split("/")
    if not all(part.strip() and part not in (".", "..") and part.isprintable() for part in parts) or parts[0] == "runs":
        raise ValueError(f"name={text!r} is not a folder below runs/; write name=mine, or name=study/mine")
    if any(len(part.encode()) > LONGEST_NAME for part in parts):
        raise ValueError(f"name={text[:20]}... is longer than {LONGEST_NAME} bytes; write a shorter one")
    for end in range(1, len(parts)):
        if (around := runs.joinpath(*parts[:end]) / "config.yaml").exists():
            raise ValueError(f"name={text} lies within the run {around.parent}; pass name=ANOTHER")
    return runs / text


def open_run(
    folder: Path,
    cfg: DictConfig,
    *,
    resume: bool,
    overwrite: bool,
    data: Mapping[str, str] | None = None,
    devices: int = 1,
) -> Path:
    """Creates ``folder`` with config.yaml and env.json. ValueError when it exists and neither flag is set.

    ``data``: fingerprints of the data sets that the run is trained on, and the command that makes each. ``devices``:
    how many there are, each of which takes ``trainer.batch_size`` samples a step. With ``resume``, a run that was interrupted
    before its first checkpoint starts again.
    """
    goes_on = resume and (folder / "checkpoints" / "last.ckpt").exists()
    data = data or {}
    refuse_folder(folder, resume=resume, overwrite=overwrite)
    if resume:
        _refuse_other_settings(folder, cfg)
        _refuse_other_samples(folder, cfg, devices)
        refuse_other_data(folder, [*data])
    if not goes_on:
        for old in ("metrics.csv", "checkpoints/last.ckpt", "checkpoints/best.ckpt", RESULT, NONFINITE):
            (folder / old).unlink(missing_ok=True)
    (folder / "checkpoints").mkdir(parents=True, exist_ok=True)
    _write(folder / "config.yaml", OmegaConf.to_yaml(cfg, resolve=True))
    job = {"overrides": job_overrides(), "job": job_number(), "devices": devices}
    _write_surroundings(folder, environment() | job | {"data": [*data], "made_by": dict(data)})
    return folder


def refuse_folder(folder: Path, *, resume: bool, overwrite: bool) -> None:
    """ValueError where a run cannot begin in this folder, or not be resumed there."""
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder} is a file, not a run's folder; pass name=ANOTHER")
    is_there = (folder / "config.yaml").exists()
    if resume and not is_there:
        raise ValueError(f"nothing to resume: there is no run {folder}; drop resume=true to start it")
    if is_there and not resume and not overwrite:
        raise ValueError(
            f"{folder} exists; pass name=ANOTHER, resume=true to go on, or overwrite=true to start it again; its scores:"
            f" {command_line('eval.py', run=folder)}"
        )


def mark_finished(folder: Path, *, steps: int, planned: int) -> None:
    """Notes in env.json that the run is over, and after how many of its planned steps."""
    _write_surroundings(folder, surroundings(folder) | {"finished": True, "steps": steps, "planned_steps": planned})


def cut_short(record: Mapping[str, Any]) -> str:
    """What to say beside the scores of a run that a time limit ended before its plan did, by its ``steps`` and
    ``planned_steps``; "" for others."""
    steps, planned = record.get("steps") or 0, record.get("planned_steps") or 0
    if steps >= planned:
        return ""
    return f"cut short: trainer.max_minutes ended the run after {steps} of its {planned} steps."


def is_finished(folder: Path, cfg: DictConfig) -> bool:
    """Whether a run with the settings ``cfg`` is over. ValueError when the folder holds one with others."""
    if not (folder / "config.yaml").exists():
        return False
    ours, theirs = (_settings(each) for each in (cfg, load_config(folder)))
    if differs := differences(theirs, ours):
        raise ValueError(f"{folder} is a run with other settings ({', '.join(differs[:3])}); move it away or delete it")
    return bool(surroundings(folder).get("finished"))


def refuse_other_data(folder: Path, data: Sequence[str]) -> None:
    """ValueError when the run was trained on data of other settings than those with these fingerprints."""
    trained = surroundings(folder).get("data", [])
    if trained and trained != list(data):
        hashes = [", ".join(each[:12] or "none" for each in both) for both in (trained, data)]
        raise ValueError(
            f"the data is no longer that which {folder} was trained on (manifest {hashes[0]}, now {hashes[1]});"
            " bring back that data, or score other data with eval.py data.root=DIR"
        )


def load_config(folder: Path) -> DictConfig:
    """The settings a run was trained with. FileNotFoundError when there is no such run."""
    path = folder / "config.yaml"
    if not path.exists():
        raise FileNotFoundError(f"no run at {folder}; {_instead(folder)}")
    try:
        loaded = OmegaConf.load(path)
    except (YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is damaged ({error}); train the run again") from error
    if not isinstance(loaded, DictConfig) or not loaded:
        raise ValueError(f"{path} holds no settings; train the run again")
    return OmegaConf.create(renewed(_literal(OmegaConf.to_container(loaded, resolve=False))))


def _instead(folder: Path) -> str:
    """What may be meant by a folder that is no run's, or how to make it one."""
    runs = Path("runs")
    if jobs := sorted(path.parent.name for path in folder.glob("*/config.yaml")):
        named = ", ".join(jobs[:MOST_NAMED]) + ", ..." * (len(jobs) > MOST_NAMED)
        return f"it holds {len(jobs)} run{'s' * (len(jobs) > 1)}: {named}"
    is_below = folder.parts[:1] == runs.parts
    if not is_below and (runs / folder / "config.yaml").exists():
        return f"it is {runs / folder}"
    beside = sorted(folder.parent.glob("*/config.yaml")) or sorted(runs.glob("*/config.yaml"))
    near = {path.parent.name: path.parent for path in beside}
    alike = difflib.get_close_matches(folder.name, near, n=1)
    names = [name if path.parent == folder.parent else str(path) for name, path in near.items()]
    known = f"did you mean {near[alike[0]]}? Or " if alike else f"there are {', '.join(names)}; " if names else ""
    name = folder.relative_to(runs).as_posix() if is_below else folder.name
    return f"{known}train it: {command_line('train.py', name=name if name.strip('.') else 'mine')}"


def _literal(value: Any) -> Any:
    """Settings that were resolved when they were written, so that OmegaConf looks up nothing in them again."""
    if isinstance(value, dict):
        return {key: _literal(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_literal(each) for each in value]
    return re.sub(r"(\\*)\$\{", r"\1\1\\${", value) if isinstance(value, str) else value


def renewed(settings: Any) -> Any:
    """Settings of a run or of shipped weights as they are called now: losses were given the side of a cell, now the grid."""
    if not isinstance(settings, dict):
        return settings
    settings = {key: renewed(value) for key, value in settings.items()}
    losses = settings.get("losses")
    if "grid" in settings and isinstance(losses, dict) and "cell" in losses:
        losses["grid"] = settings["grid"]
        del losses["cell"]
    return settings


def surroundings(folder: Path) -> dict[str, Any]:
    """The run's env.json; {} where there is none."""
    path = folder / "env.json"
    if not path.exists():
        return {}
    try:
        return dict(json.loads(path.read_bytes()))
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path} is damaged ({error}); delete it, or train the run again") from error


def _write_surroundings(folder: Path, values: dict[str, Any]) -> None:
    _write(folder / "env.json", json.dumps(values, indent=1) + "\n")


def _write(path: Path, text: str) -> None:
    with replacing(path) as file:
        file.write(text.encode())


def _settings(cfg: DictConfig) -> dict[str, Any]:
    """What a run's result depends on: its settings without those that say how to treat a folder that exists, and how
    much of the training is watched."""
    settings: Any = OmegaConf.to_container(cfg, resolve=True)
    settings.get("trainer", {}).pop("drop_table_at_validation", None)
    return {key: value for key, value in settings.items() if key not in ABOUT_THE_FOLDER}


def _refuse_other_settings(folder: Path, cfg: DictConfig) -> None:
    """ValueError where ``cfg`` would train the run in ``folder`` otherwise than it was begun."""
    changes = differences(_settings(load_config(folder)), _settings(cfg))
    changes = [change for change in changes if not change.startswith(FREE_ON_RESUME)]
    if changes:
        raise ValueError(
            f"{folder} was begun with other settings ({'; '.join(changes[:3])}); resume with the same, or pass name=ANOTHER"
        )


def _refuse_other_samples(folder: Path, cfg: DictConfig, devices: int) -> None:
    """ValueError where a step would take another number of samples than before: ``trainer.batch_size`` is of each device."""
    before = load_config(folder).trainer
    count = surroundings(folder).get("devices") or before.get("devices", 1)
    count = devices if count == -1 else count  # all that there were: older runs do not say how many
    samples = count * before.batch_size
    if devices * cfg.trainer.batch_size == samples:
        return
    size, rest = divmod(samples, devices)
    same = f"trainer.devices={count} trainer.batch_size={before.batch_size}" if rest else f"trainer.batch_size={size}"
    raise ValueError(
        f"{folder} takes {samples} samples a step, trainer.batch_size={cfg.trainer.batch_size} on {devices} device(s) is"
        f" {devices * cfg.trainer.batch_size}; write {same}"
    )
