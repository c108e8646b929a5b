"""From a composed config to a finished run folder."""

import copy
import logging
import warnings
from collections.abc import Iterable
from pathlib import Path

import lightning.pytorch as pl
import torch
from lightning.pytorch.loggers import TensorBoardLogger
from omegaconf import DictConfig

from fusion_net.common.cli.command import build
from fusion_net.data.batch import Batch
from fusion_net.data.datamodule import NuScenesDataset, StepSampler, make_loader, train_loader
from fusion_net.evaluation.scoring import ground_truth
from fusion_net.models.fusion_net import FusionNet
from fusion_net.models.precision import autocast, resolve
from fusion_net.run_dir import mark_finished, open_run, resume_step, run_folder
from fusion_net.training.callbacks import MetricsCSV, PlanCallback, TerminalProgress
from fusion_net.training.interruption import Interruption
from fusion_net.training.module import DetectorModule
from fusion_net.training.plan import TrainingPlan
from fusion_net.training.step_end import AtomicCheckpointIO, AveragedWeights, StepEnd


def fit(cfg: DictConfig) -> Path:
    """Trains what the config describes; returns the run's folder. Mistakes in it, and data that cannot be read or does not
    suit the model, raise before anything is written. Ctrl-C and SIGTERM let the step end first and write
    ``checkpoints/last.ckpt``, from which ``resume=true`` goes on as if nothing had been, to the bit."""
    if not 0 <= cfg.seed < 2**32:
        raise ValueError(f"seed={cfg.seed} is not within 0 and 2**32 - 1")
    pl.seed_everything(cfg.seed, verbose=False)
    settings = cfg.trainer
    for name in ("batch_size", "validate_every", "save_every"):
        if settings[name] < 1:
            raise ValueError(f"trainer.{name}={settings[name]} must be at least 1")
    if cfg.dataset.workers < 0:
        raise ValueError(f"dataset.workers={cfg.dataset.workers} is not a number of processes; 0 reads in this one")
    model = build(cfg.model, "model")
    train_set, val_set = _datasets(cfg)
    plan = _plan(cfg)
    module = DetectorModule(
        model,
        modality_dropout=cfg.modality_dropout if len(cfg.encoders) > 1 else 0.0,
        dropout_from=settings.dropout_from,
        freeze_camera=settings.freeze_camera,
        weight_decay=settings.weight_decay,
        max_lr=settings.max_lr,
        seed=cfg.seed,
    )
    folder = run_folder(cfg.name)
    last = folder / "checkpoints" / "last.ckpt"
    first_step = resume_step(model, last) if cfg.resume and last.exists() else 0
    sampler = StepSampler(
        len(train_set), batch_size=settings.batch_size, steps=plan.total_steps, first=first_step, seed=train_set.seed
    )
    batches, val_batches = (
        train_loader(train_set, sampler, cfg.dataset.workers),
        make_loader(val_set, settings.batch_size),
    )
    trainer = _trainer(cfg, plan, folder, val_set, val_batches, first_step)
    with autocast(settings.precision):
        _try(model, train_set.collate([train_set[key] for key in sampler.keys(0)]), next(iter(val_batches)))
    open_run(folder, cfg, data=train_set.fingerprint, resume=cfg.resume, overwrite=cfg.overwrite)
    parameters = sum(p.numel() for p in model.parameters()) / 1e6
    print(f"{folder}: {parameters:.2f} M parameters, {len(train_set)} training and {len(val_set)} validation samples")
    try:
        trainer.fit(module, batches, ckpt_path=last if first_step else None, weights_only=True)
    except (KeyboardInterrupt, SystemExit):  # the latter is what Lightning makes of the former
        raise KeyboardInterrupt("add resume=true to the same command to go on") from None
    except RuntimeError as error:
        if "DataLoader worker" not in str(error):
            raise
        raise ChildProcessError(
            f"a loader process died ({error}); add resume=true to the same command to go on, with fewer dataset.workers"
            " if memory ran out"
        ) from error
    mark_finished(folder)
    return folder


def _datasets(cfg: DictConfig) -> tuple[NuScenesDataset, NuScenesDataset]:
    """Training and validation samples. ValueError when there is nothing to learn from."""
    train_set: NuScenesDataset = build(cfg.dataset.train, "dataset.train")
    train, val, settings = cfg.dataset.train, cfg.dataset.val, cfg.trainer
    same = (val.root, val.version) == (train.root, train.version)
    val_set: NuScenesDataset = build(val, "dataset.val", datasets=train_set.datasets if same else None)
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
    if "camera" in trial.encoders:
        trial.camera_loss(train_batch)
    trial.loss(trial(train_batch), train_batch)
    trial.eval()
    trial.decode(trial(val_batch))


def _plan(cfg: DictConfig) -> TrainingPlan:
    """The configured stages; without a camera, or with nothing else, its own fall away."""
    settings = cfg.trainer
    steps = {
        "camera": settings.camera_steps if "camera" in cfg.encoders else 0,
        "alone": settings.alone_steps if "camera" in cfg.encoders and len(cfg.encoders) > 1 else 0,
        "fusion": settings.fusion_steps,
    }
    return TrainingPlan(steps=steps, max_lr=settings.max_lr, max_minutes=settings.max_minutes)


def _trainer(
    cfg: DictConfig,
    plan: TrainingPlan,
    folder: Path,
    val_set: NuScenesDataset,
    val_batches: Iterable[Batch],
    first_step: int,
) -> pl.Trainer:
    for name in ("lightning.pytorch", "lightning.fabric"):
        logging.getLogger(name).setLevel(logging.ERROR)  # adverts and hardware notes
    warnings.filterwarnings("ignore", module=r"lightning\..*")
    settings = cfg.trainer
    course, metrics = PlanCallback(plan, seed=cfg.seed), MetricsCSV(folder / "metrics.csv")
    average = AveragedWeights(decay=settings.ema_decay, use_buffers=True)
    interruption = Interruption()
    step_end = StepEnd(
        folder / "checkpoints",
        batches=val_batches,
        truth=ground_truth(val_set),
        validate_every=settings.validate_every,
        save_every=settings.save_every,
        plan=course,
        average=average,
        metrics=metrics,
        interruption=interruption,
    )
    return pl.Trainer(
        accelerator="cpu",
        devices=1,
        precision="bf16-mixed" if resolve(settings.precision) == "bf16" else "32-true",
        max_steps=-1,  # the plan says when it is over
        max_epochs=-1,
        gradient_clip_val=settings.gradient_clip,
        num_sanity_val_steps=0,
        logger=TensorBoardLogger(folder, name="tb", version="", purge_step=first_step),
        log_every_n_steps=20,
        enable_checkpointing=False,  # StepEnd writes them
        enable_progress_bar=False,
        enable_model_summary=False,
        plugins=[AtomicCheckpointIO()],
        callbacks=[course, average, TerminalProgress(plan.total_steps), metrics, interruption, step_end],
    )
