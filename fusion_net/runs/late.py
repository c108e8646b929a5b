"""What runs of ``model=late`` need beside those of other models: detectors of other runs, scenes kept from training, and the
calibration on them."""

import copy
import inspect
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from omegaconf import DictConfig, OmegaConf, open_dict
from torch import Tensor
from torch.utils.data import DataLoader, Subset

from fusion_net.common.atomic import replacing
from fusion_net.common.cli.command import build
from fusion_net.common.cli.command_line import command_line, job_overrides
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.evaluation.late_calibration import calibrate
from fusion_net.models.late.late_fusion import LateFusion, one_sensor
from fusion_net.models.precision import autocast
from fusion_net.models.weights_file import fit_weights
from fusion_net.runs.checkpoints import model_weights, read_checkpoint
from fusion_net.runs.sources import names_weights
from fusion_net.runs.trained import Trained, shipped, trained_run

FITTED = ("calibration.", "prior")
"""Where the calibration is among the weights."""
READING = {
    "camera": ("cameras", "image_size"),
    "lidar": ("lidar_sweeps", "propagate_lidar", "motion_compensation"),
    "radar": ("radar_sweeps", "motion_compensation"),
}
"""Settings of ``dataset.train`` that say what a detector of each sensor gets to see."""


def is_late(cfg: DictConfig) -> bool:
    """Whether the settings of a run are of late fusion."""
    return "detectors" in cfg.model


def chosen_detectors(late: DictConfig | None) -> dict[str, str]:
    """The detectors of other runs that ``late.detectors`` names, by sensor. ValueError where it names none by a sensor."""
    if late is None:
        return {}
    detectors = late.get("detectors") if isinstance(late, DictConfig) else late
    if not isinstance(detectors, DictConfig):
        raise ValueError(
            f"late.detectors={detectors} is not one detector a sensor; write late.detectors.camera=runs/NAME"
        )
    chosen = {str(name): source for name, source in detectors.items() if source is not None}
    for name, source in chosen.items():
        if not isinstance(source, str):
            raise ValueError(f"late.detectors.{name}={source} is not a run or a file of weights; write runs/NAME")
    return chosen


def with_detectors(cfg: DictConfig) -> DictConfig:
    """The settings with the model of each detector that ``late.detectors`` names written out, so that nothing but weights is
    needed from the other run, and its later fate is of no concern. ValueError where one does not suit these settings."""
    if not is_late(cfg):
        unread = [text for text in job_overrides() if text.startswith("late.")]
        unread += [f"late.detectors.{name}={source}" for name, source in chosen_detectors(cfg.get("late")).items()]
        if unread:
            raise ValueError(f"{unread[0]}: this model is no late fusion and reads none of late.*; add model=late")
        return cfg
    chosen = chosen_detectors(cfg.late)
    if not chosen:
        return cfg
    cfg = copy.deepcopy(cfg)
    with open_dict(cfg):
        for name, source in chosen.items():
            cfg.model.detectors[name] = _part(name, source, cfg)[0]
    return cfg


def take_weights(model: LateFusion, cfg: DictConfig) -> None:
    """Loads the weights of the detectors that ``late.detectors`` names."""
    for name, source in chosen_detectors(cfg.late).items():
        fit_weights(model.detectors[name], _part(name, source, cfg)[1], Path(source))


def _part(name: str, source: str, cfg: DictConfig) -> tuple[dict[str, Any], Mapping[str, Tensor]]:
    """Settings and weights of one sensor's detector in another run, or in a file of weights."""
    where = f"late.detectors.{name}={source}"
    if name not in cfg.encoders:
        raise ValueError(f"{where}: this model has no {name}; its sensors are {', '.join(cfg.encoders)}")
    try:
        trained = shipped(source) if names_weights(source) else trained_run(Path(source), "best")
    except (ValueError, FileNotFoundError) as error:
        raise ValueError(f"{where}: {error}") from error
    _check_same(where, trained.cfg, cfg, name)
    model: Any = OmegaConf.to_container(trained.cfg.model, resolve=True)
    if is_late(trained.cfg):
        if name not in trained.cfg.encoders:
            raise ValueError(f"{where}: it has no detector of the {name}; it has {', '.join(trained.cfg.encoders)}")
        prefix = f"detectors.{name}."
        weights = {key.removeprefix(prefix): x for key, x in trained.weights.items() if key.startswith(prefix)}
        return model["detectors"].get(name) or _alone(model, name), weights
    if list(trained.cfg.encoders) != [name]:
        train = command_line("train.py", name=f"{name}_alone", encoders=[name])
        raise ValueError(
            f"{where}: it fuses {', '.join(trained.cfg.encoders)} in one network; a detector of the {name} alone: {train}"
        )
    return model, trained.weights


def _alone(model: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Of a late model's settings those of the detector of one sensor."""
    parts = {key: model[key] for key in inspect.signature(one_sensor).parameters if key in model}
    target = f"{one_sensor.__module__}.{one_sensor.__qualname__}"
    return parts | {"_target_": target, "name": name, "encoders": {name: model["encoders"][name]}}


def _check_same(where: str, theirs: DictConfig, ours: DictConfig, name: str) -> None:
    """ValueError unless a detector speaks of the same classes and grid, and is shown what it has learned to read."""
    train = command_line("train.py", name=f"{name}_alone", encoders=[name])
    for key in ("classes", "grid"):
        there, here = (OmegaConf.to_container(each[key], resolve=True) for each in (theirs, ours))
        if isinstance(there, dict) and isinstance(here, dict):  # what differs is enough
            there, here = ({k: v for k, v in a.items() if b.get(k) != v} for a, b in ((there, here), (here, there)))
        if there != here:
            raise ValueError(
                f"{where}: {key} of that detector: {there}, of this model: {here}; train one like it: {train}"
            )
    for key in READING[name]:
        there, here = (each.dataset.train.get(key) for each in (theirs, ours))
        if there != here and key in theirs.dataset.train:
            raise ValueError(f"{where} was trained with dataset.train.{key}={there}, here it is {here}; write the same")


def held_out(dataset: NuScenesDataset, scenes: int) -> tuple[list[int], list[int]]:
    """Places of the samples to learn from, and of those of ``scenes`` scenes, spread evenly over the split, that are kept from
    training. ValueError where that leaves nothing of either."""
    scene_of = [nusc.scene(token)["token"] for nusc, token in dataset.index]
    every = list(dict.fromkeys(scene_of))
    if not 1 <= scenes < len(every):
        raise ValueError(
            f"late.calibration_scenes={scenes}: of {len(every)} training scenes between 1 and {len(every) - 1} can be kept"
        )
    kept = {every[(2 * k + 1) * len(every) // (2 * scenes)] for k in range(scenes)}
    learn, calibration = ([i for i, s in enumerate(scene_of) if (s in kept) == is_kept] for is_kept in (False, True))
    return learn, calibration


def calibration_batches(cfg: DictConfig) -> DataLoader:
    """The training scenes of a run that were kept from training, as they are: neither augmented nor with faults."""
    settings = cfg.dataset.val.copy()
    settings.root, settings.version, settings.split = (
        cfg.dataset.train.root,
        cfg.data.get("version"),
        cfg.dataset.train.split,
    )
    if "scenes" in cfg.dataset.train:
        settings.scenes = cfg.dataset.train.scenes
    dataset: NuScenesDataset = build(settings)
    _, places = held_out(dataset, cfg.late.calibration_scenes)
    return DataLoader(Subset(dataset, places), batch_size=cfg.trainer.batch_size, collate_fn=dataset.collate)


def calibrated(cfg: DictConfig, weights: Mapping[str, Tensor], batches: DataLoader) -> dict[str, Tensor]:
    """The weights of a late model with its calibration fitted anew."""
    model: LateFusion = build(cfg.model, "model")
    model.load_state_dict(dict(weights))
    with autocast(cfg.trainer.precision):
        calibrate(model.eval(), batches)
    return model.state_dict()


def calibrate_checkpoints(checkpoints: Sequence[Path], cfg: DictConfig) -> None:
    """Fits the calibration of each checkpoint of a late run and writes it into it."""
    batches = calibration_batches(cfg)
    fitted: dict[int, dict[str, Tensor]] = {}  # by step: the best checkpoint is mostly the last
    for path in checkpoints:
        state = read_checkpoint(path)
        step = state["global_step"]
        if step not in fitted:
            fitted[step] = calibrated(cfg, model_weights(state), batches)
        state["state_dict"] |= {f"model.{key}": x for key, x in fitted[step].items() if key.startswith(FITTED)}
        with replacing(path) as file:
            torch.save(state, file)


def adapted(trained: Trained, late: DictConfig) -> tuple[Trained, dict[str, str]]:
    """A trained late model as the ``late`` settings of ``eval.py`` want it, and what they change, by key. Other detectors are
    calibrated on the scenes that the run kept from training. ValueError where the model is of no late fusion."""
    chosen = {f"detectors.{name}": source for name, source in chosen_detectors(late).items()}
    switches = {str(k): v for k, v in late.items() if k not in ("detectors", "calibrate") and v is not None}
    if not chosen and not switches and not late.calibrate:
        return trained, {}
    if not is_late(trained.cfg):
        key = "calibrate" if late.calibrate else next(iter(chosen | switches))
        raise ValueError(
            f"late.{key}: {trained.source} is no late fusion; train one: {command_line('train.py', experiment='late')}"
        )
    own = trained.cfg.copy()
    with open_dict(own):
        for name in own.late.detectors:  # those of its training are in its weights
            own.late.detectors[name] = late.detectors[name]
        for key, value in switches.items():
            own.late[key] = own.model[key] = value
    cfg = with_detectors(own)
    weights = dict(trained.weights)
    for name in chosen_detectors(late):
        weights = {key: x for key, x in weights.items() if not key.startswith(f"detectors.{name}.")}
        weights |= {f"detectors.{name}.{key}": x for key, x in _part(name, late.detectors[name], cfg)[1].items()}
    if late.calibrate and not chosen and not trained.is_shipped:
        calibrate_checkpoints([trained.source], trained.cfg)
        weights = dict(model_weights(read_checkpoint(trained.source)))
    elif chosen or late.calibrate:
        weights = calibrated(cfg, weights, calibration_batches(cfg))
    return replace(trained, cfg=cfg, weights=weights), {k: str(v) for k, v in (chosen | switches).items()}
