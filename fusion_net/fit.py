"""From a composed config to a finished run folder."""

import copy
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import lightning.pytorch as pl
import torch
from omegaconf import DictConfig
from torch.utils.data import DataLoader

from fusion_net.common.cli.command import build
from fusion_net.common.cli.command_line import command_line
from fusion_net.common.cli.processes import interrupts_held
from fusion_net.data.batch import Batch
from fusion_net.data.datamodule import NuScenesDataset, StepSampler, keep_memory, make_loader, train_loader
from fusion_net.evaluate import evaluate_finished
from fusion_net.models.fusion_net import FusionNet
from fusion_net.models.precision import autocast
from fusion_net.runs.checkpoints import resume_step
from fusion_net.runs.checks import check_training, only_training
from fusion_net.runs.late import (
    calibrate_checkpoints,
    chosen_detectors,
    held_out,
    is_late,
    take_weights,
    with_detectors,
)
from fusion_net.runs.run_dir import NONFINITE, mark_finished, open_run, run_folder
from fusion_net.runs.trained import initialise
from fusion_net.training.interruption import handlers_restored
from fusion_net.training.module import DetectorModule
from fusion_net.training.plan import TrainingPlan
from fusion_net.training.threads import set_threads
from fusion_net.training.trainer import lightning_trainer


def fit(cfg: DictConfig) -> Path:
    """Trains what the config describes; returns the run's folder. Mistakes in it, and data that cannot be read or does not
    suit the model, raise before anything is written. Ctrl-C and SIGTERM let the step end first and write
    ``checkpoints/last.ckpt``, from which ``resume=true`` goes on as if nothing had been, to the bit."""
    check_training(cfg)
    cfg = with_detectors(cfg)
    pl.seed_everything(cfg.seed, verbose=False)
    keep_memory()
    set_threads(cfg.trainer.threads)
    model = _model(cfg)
    train_set, val_set = _datasets(cfg)
    plan = _plan(cfg, model)
    folder = run_folder(cfg.name)
    module = _module(cfg, model, folder)
    last = folder / "checkpoints" / "last.ckpt"
    first_step = resume_step(model, last) if cfg.resume and last.exists() else 0
    val_batches = make_loader(val_set, cfg.trainer.batch_size)
    trainer = lightning_trainer(cfg, plan, folder, val_set, val_batches, first_step)
    sampler = _sampler(cfg, train_set, plan, first_step, ranks=trainer.num_devices * trainer.num_nodes)
    with ExitStack() as until_done:
        with _advice_to_resume(skip_finished=cfg.skip_finished):
            if trainer.is_global_zero:  # the other processes of a run find it tried and its folder open
                with autocast(cfg.trainer.precision):
                    keys = sampler.keys(0)[: cfg.trainer.batch_size]
                    _try(model, train_set.collate([train_set[key] for key in keys]), next(iter(val_batches)))
                until_done.enter_context(only_training(folder))
                made_by, devices = train_set.made_by, sampler.ranks
                open_run(folder, cfg, data=made_by, resume=cfg.resume, overwrite=cfg.overwrite, devices=devices)
                parameters, samples = sum(p.numel() for p in model.parameters()) / 1e6, len(sampler.places)
                print(
                    f"{folder}: {parameters:.2f} M parameters, {samples} training and {len(val_set)} validation samples"
                )
            batches = train_loader(train_set, sampler, cfg.dataset.workers)
            _train(trainer, module, batches, resume_from=last if first_step else None)
        if trainer.is_global_zero:
            if is_late(cfg):
                calibrate_checkpoints([folder / "checkpoints" / f"{name}.ckpt" for name in ("best", "last")], cfg)
            mark_finished(folder, steps=trainer.global_step, planned=plan.total_steps)
            if cfg.evaluate:
                evaluate_finished(folder)
            else:
                print(f"done; score it with: {command_line('eval.py', run=folder)}")
    return folder


def _model(cfg: DictConfig) -> Any:
    """The configured model, of any level of fusion, with the weights that it is to begin with."""
    model = build(cfg.model, "model")
    if cfg.init is not None:
        initialise(model, cfg.init)
    if is_late(cfg):
        take_weights(model, cfg)
    return model


def _module(cfg: DictConfig, model: FusionNet, folder: Path) -> DetectorModule:
    settings = cfg.trainer
    return DetectorModule(
        model,
        modality_dropout=cfg.modality_dropout if len(cfg.encoders) > 1 else 0.0,
        dropout_from=settings.dropout_from,
        freeze_camera=settings.freeze_camera,
        weight_decay=settings.weight_decay,
        max_lr=settings.max_lr,
        seed=cfg.seed,
        nonfinite_file=folder / NONFINITE,
    )


def _sampler(
    cfg: DictConfig, train_set: NuScenesDataset, plan: TrainingPlan, first_step: int, *, ranks: int
) -> StepSampler:
    """The samples of every step, without those that late fusion is calibrated on. ValueError where they are too few."""
    batch_size = cfg.trainer.batch_size
    places = held_out(train_set, cfg.late.calibration_scenes)[0] if is_late(cfg) else list(range(len(train_set)))
    if len(places) < batch_size * ranks:
        raise ValueError(
            f"{len(places)} training samples are fewer than trainer.batch_size={batch_size} on each of {ranks}"
            " devices; take a smaller batch or more data"
        )
    return StepSampler(
        places,
        batch_size=batch_size * ranks,
        steps=plan.total_steps,
        first=first_step,
        seed=train_set.seed,
        ranks=ranks,
    )


@contextmanager
def _advice_to_resume(*, skip_finished: bool) -> Iterator[None]:
    """Ctrl-C, from the opening of the folder on, says how to go on."""
    try:
        yield
    except KeyboardInterrupt:
        how = "the same command goes on" if skip_finished else "add resume=true to the same command to go on"
        raise KeyboardInterrupt(how) from None


def _train(trainer: pl.Trainer, module: DetectorModule, batches: DataLoader, *, resume_from: Path | None) -> None:
    """To the end of the plan. ChildProcessError says how to go on."""
    try:
        with handlers_restored(), interrupts_held():
            trainer.fit(module, batches, ckpt_path=resume_from, weights_only=True)
    except SystemExit:  # what Lightning makes of Ctrl-C, once it has killed the other processes
        getattr(trainer.strategy.launcher, "procs", []).clear()  # its watch over them would now kill this one, too
        raise KeyboardInterrupt from None
    except RuntimeError as error:
        if "DataLoader worker" not in str(error):
            raise
        raise ChildProcessError(
            f"a loader process died ({error}); add resume=true to the same command to go on, with fewer dataset.workers"
            " if memory ran out"
        ) from error


def _datasets(cfg: DictConfig) -> tuple[NuScenesDataset, NuScenesDataset]:
    """Training and validation samples. ValueError when there is nothing to learn from."""
    train_set: NuScenesDataset = build(cfg.dataset.train)
    train, val, settings = cfg.dataset.train, cfg.dataset.val, cfg.trainer
    same = (val.root, val.version) == (train.root, train.version)
    val_set: NuScenesDataset = build(val, datasets=train_set.datasets if same else None)
    if len(train_set) < settings.batch_size:
        raise ValueError(
            f"{cfg.data.root} has {len(train_set)} training samples, fewer than trainer.batch_size={settings.batch_size};"
            " take a smaller batch or more data"
        )
    if not train_set.has_labels():
        raise ValueError(f"nothing to train on in {cfg.data.root}: {train_set.why_no_labels()}")
    return train_set, val_set


@torch.no_grad()
def _try(model: FusionNet, train_batch: Batch, val_batch: Batch) -> None:
    """Shows a copy of the model one batch of each kind: what does not fit together is found before a run's folder is there,
    and not at the first validation, many minutes later."""
    trial = copy.deepcopy(model)
    if trial.image_network is not None:
        trial.camera_loss(train_batch)
    trial.loss(trial(train_batch), train_batch)
    trial.eval()
    trial.decode(trial(val_batch))


def _plan(cfg: DictConfig, model: FusionNet) -> TrainingPlan:
    """The configured stages. The camera's fall away where no image network is to be trained, and where the camera's is not
    one of several maps."""
    settings = cfg.trainer
    learning = [name for name in model.encoders if name not in chosen_detectors(cfg.get("late"))]
    sees_alone = "camera" in learning and len(learning) > 1
    steps = {
        "camera": settings.camera_steps if model.image_network is not None else 0,
        "camera_only": settings.camera_only_steps if sees_alone else 0,
        "fusion": settings.fusion_steps if learning else 1,  # late fusion of given detectors: there is nothing to learn
    }
    return TrainingPlan(
        steps=steps,
        max_lr=float(settings.max_lr),
        warmup_fraction=settings.warmup_fraction,
        stage_fractions={name: float(fraction) for name, fraction in settings.stage_fractions.items()},
        max_minutes=settings.max_minutes,
    )
