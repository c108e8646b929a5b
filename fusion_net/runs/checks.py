"""What a command can be refused for before torch and Lightning are imported, which takes many times as long as all of this."""

import math
from contextlib import AbstractContextManager
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from fusion_net.common.atomic import LOCK, only_writer
from fusion_net.common.checks import check_names, check_not_negative, check_probabilities
from fusion_net.common.cli.processes import is_first
from fusion_net.nuscenes.absent import check_data
from fusion_net.runs.run_dir import load_config, refuse_folder, run_folder
from fusion_net.runs.sources import shipped_path, source_of

LEAST = {
    "batch_size": 1, "validate_every": 1, "save_every": 1, "camera_steps": 0, "camera_only_steps": 0, "fusion_steps": 1
}  # fmt: skip
"""Of settings of the trainer that count something."""
ACCELERATORS = ("cpu", "gpu", "auto")


def check_training(cfg: DictConfig) -> None:
    """ValueError for settings of ``train.py`` that no run can have, a folder that is taken, and data that is not there."""
    if not 0 <= cfg.seed < 2**32:
        raise ValueError(f"seed={cfg.seed} is not within 0 and 2**32 - 1")
    for name, least in LEAST.items():
        if cfg.trainer[name] < least:
            raise ValueError(f"trainer.{name}={cfg.trainer[name]} must be at least {least}")
    check_names("trainer.accelerator", [str(cfg.trainer.accelerator)], ACCELERATORS)
    minutes = cfg.trainer.max_minutes
    if minutes is not None and not (isinstance(minutes, int | float) and minutes > 0):
        raise ValueError(f"trainer.max_minutes={minutes} is no number of minutes above 0; null sets no limit")
    if cfg.trainer.max_lr <= 0:
        raise ValueError(f"trainer.max_lr={cfg.trainer.max_lr} must be above 0")
    check_not_negative(**{f"trainer.{name}": cfg.trainer[name] for name in ("weight_decay", "gradient_clip")})
    fractions = {f"trainer.{name}": cfg.trainer[name] for name in ("ema_decay", "dropout_from")}
    check_probabilities(modality_dropout=cfg.modality_dropout, **fractions)
    if cfg.painting != "learned" and OmegaConf.select(cfg, "model.encoders.camera.painting") is None:
        raise ValueError(f"painting={cfg.painting}: this model paints no points; add model=early")
    if cfg.dataset.workers < 0:
        raise ValueError(f"dataset.workers={cfg.dataset.workers} is not a number of processes; 0 reads in this one")
    if "detectors" in cfg.model:
        check_late(cfg.late)
    folder = run_folder(cfg.name)
    if is_first():  # the others of a run find its folder open
        if (folder / LOCK).exists():
            with only_training(folder):
                pass
        refuse_folder(folder, resume=cfg.resume, overwrite=cfg.overwrite)
    if cfg.init is not None:
        check_init(cfg.init)
    check_data(cfg.data.root)


def only_training(folder: Path) -> AbstractContextManager[None]:
    """The run's folder for this process. ValueError while another one trains there."""
    return only_writer(folder, f"another training is writing to {folder}; wait for it, stop it, or pass name=ANOTHER")


def check_init(name: str) -> Path:
    """The file that ``init=NAME`` begins with. ValueError when there is none."""
    try:
        return shipped_path(str(name))
    except FileNotFoundError as error:
        raise ValueError(f"init={name}: {error}") from error


def check_evaluation(cfg: DictConfig) -> None:
    """ValueError for settings of ``eval.py`` that no evaluation can have; FileNotFoundError where there is nothing to score."""
    check_counts(cfg)
    check_names("accelerator", [str(cfg.accelerator)], ACCELERATORS)
    if cfg.audit_gate is not None and not 0 < cfg.audit_gate < math.inf:
        raise ValueError(f"audit_gate={cfg.audit_gate} must be a finite number of metres above 0; try audit_gate=2")
    if cfg.ship and not cfg.ship.endswith(".pt"):
        raise ValueError(f"ship={cfg.ship} is no file of weights; end it with .pt")
    check_late(cfg.late)
    check_detector(cfg)


def check_late(late: DictConfig) -> None:
    """ValueError for a rule of late fusion that there is not, and for what is no probability. None is as it was trained."""
    chosen = {key: late[key] for key in ("association", "merge", "score") if late[key] is not None}
    if chosen:
        from fusion_net.models.late.fuse import ASSOCIATIONS
        from fusion_net.models.late.merging import MERGES
        from fusion_net.models.late.scores import SCORES

        known = {"association": ASSOCIATIONS, "merge": MERGES, "score": SCORES}
        for key, name in chosen.items():
            check_names(f"late.{key}", [str(name)], known[key])
    for key, where in (("gate", "above 0 and below 1"), ("min_probability", "from 0 to 1")):
        value = 0.5 if late[key] is None else late[key]
        is_inside = isinstance(value, int | float) and (0 < value < 1 or (key == "min_probability" and value in (0, 1)))
        if not is_inside or isinstance(value, bool):
            raise ValueError(f"late.{key}={value} is a probability: give a number {where}")


def check_counts(cfg: DictConfig) -> None:
    """ValueError for batches or resamples of nothing."""
    for name in ("batch_size", "bootstrap"):
        if cfg[name] < 1:
            raise ValueError(f"{name}={cfg[name]} must be at least 1")


def check_detector(cfg: DictConfig) -> None:
    """ValueError or FileNotFoundError where ``run`` and ``checkpoint`` name no detector, or where the data that is shown to it
    is not there: ``data.root``, or what the run was trained on. Shipped weights say the latter only to torch."""
    source_of(cfg)
    root = cfg.data.root
    if root is None and not OmegaConf.is_missing(cfg, "run"):
        root = OmegaConf.select(load_config(Path(cfg.run)), "data.root")
    if root is not None:
        check_data(root)
