"""What a command can be refused for before torch and Lightning are imported, which takes many times as long as all of this."""

import math
import os
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from fusion_net.nuscenes.tables import refuse_no_data
from fusion_net.runs.run_dir import refuse_folder, run_folder
from fusion_net.runs.sources import shipped_path, source_of

RANKS = ("RANK", "LOCAL_RANK", "NODE_RANK")
"""Variables with which torchrun and Lightning number the processes of one run."""


def check_training(cfg: DictConfig) -> None:
    """ValueError for settings of ``train.py`` that no run can have, a folder that is taken, and data that is not there."""
    if not 0 <= cfg.seed < 2**32:
        raise ValueError(f"seed={cfg.seed} is not within 0 and 2**32 - 1")
    for name in ("batch_size", "validate_every", "save_every"):
        if cfg.trainer[name] < 1:
            raise ValueError(f"trainer.{name}={cfg.trainer[name]} must be at least 1")
    if cfg.painting != "learned" and OmegaConf.select(cfg, "model.encoders.camera.painting") is None:
        raise ValueError(f"painting={cfg.painting}: this model paints no points; add model=early")
    if cfg.dataset.workers < 0:
        raise ValueError(f"dataset.workers={cfg.dataset.workers} is not a number of processes; 0 reads in this one")
    folder = run_folder(cfg.name)
    if not any(int(os.environ.get(name, 0)) for name in RANKS):  # the others of a run find its folder open
        refuse_folder(folder, resume=cfg.resume, overwrite=cfg.overwrite)
    if cfg.init is not None:
        check_init(cfg.init)
    _check_data(cfg)


def check_init(name: str) -> Path:
    """The file that ``init=NAME`` begins with. ValueError when there is none."""
    try:
        return shipped_path(name)
    except FileNotFoundError as error:
        raise ValueError(f"init={name}: {error}") from error


def check_evaluation(cfg: DictConfig) -> None:
    """ValueError for settings of ``eval.py`` that no evaluation can have; FileNotFoundError where there is nothing to score."""
    check_counts(cfg)
    if not 0 < cfg.audit_gate < math.inf:
        raise ValueError(f"audit_gate={cfg.audit_gate} must be a finite number of metres above 0; try audit_gate=2")
    if cfg.ship and not cfg.ship.endswith(".pt"):
        raise ValueError(f"ship={cfg.ship} is no file of weights; end it with .pt")
    source_of(cfg)
    _check_data(cfg)


def check_counts(cfg: DictConfig) -> None:
    """ValueError for batches or resamples of nothing."""
    for name in ("batch_size", "bootstrap"):
        if cfg[name] < 1:
            raise ValueError(f"{name}={cfg[name]} must be at least 1")


def _check_data(cfg: DictConfig) -> None:
    root = cfg.data.root
    for folder in [root] if isinstance(root, str) else root or []:
        refuse_no_data(Path(folder))
