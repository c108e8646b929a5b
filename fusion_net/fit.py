"""From a composed config to a finished run folder."""

import copy
import logging
import warnings
from pathlib import Path
from typing import Any

import lightning.pytorch as pl
import torch
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from lightning.pytorch.loggers import TensorBoardLogger
from lightning.pytorch.strategies import StrategyRegistry
from omegaconf import DictConfig
from torch.utils.data import DataLoader

from fusion_net.common.checks import check_names
from fusion_net.common.cli.command import build
from fusion_net.common.cli.command_line import command_line
from fusion_net.data.batch import Batch
from fusion_net.data.datamodule import NuScenesDataset, StepSampler, keep_memory, make_loader, train_loader
from fusion_net.evaluate import evaluate_finished
from fusion_net.evaluation.drop_table import SUBSETS
from fusion_net.evaluation.scoring import ground_truth
from fusion_net.models.fusion_net import FusionNet
from fusion_net.models.precision import autocast, resolve
from fusion_net.runs.checkpoints import resume_step
from fusion_net.runs.checks import check_training
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
from fusion_net.training.callbacks import LOG_EVERY, MetricsCSV, PlanCallback
from fusion_net.training.interruption import Interruption, handlers_restored
from fusion_net.training.module import DetectorModule
from fusion_net.training.plan import TrainingPlan
from fusion_net.training.progress import TerminalProgress
from fusion_net.training.step_end import AtomicCheckpointIO, AveragedWeights, StepEnd
from fusion_net.training.threads import ThreadWatch, set_threads
from fusion_net.training.validation_pictures import ValidationPictures


def fit(cfg: DictConfig) -> Path:
    """Trains what the config describes; returns the run's folder. Mistakes in it, and data that cannot be read or does not
    suit the model, raise before anything is written. Ctrl-C and SIGTERM let the step end first and write
    ``checkpoints/last.ckpt``, from which ``resume=true`` goes on as if nothing had been, to the bit."""
    check_training(cfg)
    cfg = with_detectors(cfg)
    pl.seed_everything(cfg.seed, verbose=False)
    keep_memory()
    settings = cfg.trainer
    set_threads(settings.threads)
    model = build(cfg.model, "model")
    if cfg.init is not None:
        initialise(model, cfg.init)
    if is_late(cfg):
        take_weights(model, cfg)
    train_set, val_set = _datasets(cfg)
    places, _ = held_out(train_set, cfg.late.calibration_scenes) if is_late(cfg) else (list(range(len(train_set))), [])
    plan = _plan(cfg, model)
    folder = run_folder(cfg.name)
    module = DetectorModule(
        model,
        modality_dropout=cfg.modality_dropout if len(cfg.encoders) > 1 else 0.0,
        dropout_from=settings.dropout_from,
        freeze_camera=settings.freeze_camera,
        weight_decay=settings.weight_decay,
        max_lr=settings.max_lr,
        seed=cfg.seed,
        nonfinite_file=folder / NONFINITE,
    )
    last = folder / "checkpoints" / "last.ckpt"
    first_step = resume_step(model, last) if cfg.resume and last.exists() else 0
    val_batches = make_loader(val_set, settings.batch_size)
    trainer = _trainer(cfg, plan, folder, val_set, val_batches, first_step)
    ranks = trainer.num_devices * trainer.num_nodes
    if len(places) < settings.batch_size * ranks:
        raise ValueError(
            f"{len(places)} training samples are fewer than trainer.batch_size={settings.batch_size} on each of {ranks}"
            " devices; take a smaller batch or more data"
        )
    sampler = StepSampler(
        places,
        batch_size=settings.batch_size * ranks,
        steps=plan.total_steps,
        first=first_step,
        seed=train_set.seed,
        ranks=ranks,
    )
    batches = train_loader(train_set, sampler, cfg.dataset.workers)
    if trainer.is_global_zero:  # the other processes of a run find it tried and its folder open
        with autocast(settings.precision):
            keys = sampler.keys(0)[: settings.batch_size]
            _try(model, train_set.collate([train_set[key] for key in keys]), next(iter(val_batches)))
        open_run(folder, cfg, data=train_set.made_by, resume=cfg.resume, overwrite=cfg.overwrite)
        parameters = sum(p.numel() for p in model.parameters()) / 1e6
        print(f"{folder}: {parameters:.2f} M parameters, {len(places)} training and {len(val_set)} validation samples")
    try:
        with handlers_restored():
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
    if trainer.is_global_zero:
        if is_late(cfg):
            calibrate_checkpoints([folder / "checkpoints" / f"{name}.ckpt" for name in ("best", "last")], cfg)
        mark_finished(folder, steps=trainer.global_step, planned=plan.total_steps)
        if cfg.evaluate:
            evaluate_finished(folder)
        else:
            print(f"done; score it with: {command_line('eval.py', run=folder)}")
    return folder


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


def _devices(settings: DictConfig) -> dict[str, Any]:
    """Where and in which number format Lightning's trainer computes. ValueError when the machine has no such device."""
    accelerator, devices, strategy = settings.accelerator, settings.devices, settings.strategy
    if devices < -1 or devices == 0:
        raise ValueError(f"trainer.devices={devices} is not a number of devices; -1 takes every one that there is")
    if accelerator not in ("cpu", "gpu", "auto"):
        raise ValueError(f"trainer.accelerator={accelerator}; there are cpu, gpu, auto")
    if accelerator == "auto":
        accelerator = "gpu" if torch.cuda.is_available() else "cpu"
    if accelerator == "gpu" and not torch.cuda.is_available():
        raise ValueError("trainer.accelerator=gpu: there is no GPU here; pass trainer.accelerator=cpu")
    if devices == -1:
        devices = torch.cuda.device_count() if accelerator == "gpu" else 1
    check_names("strategy of trainer.strategy", [strategy], ["auto", *StrategyRegistry.available_strategies()])
    if strategy == "auto" and devices > 1:
        strategy = "ddp"
    if strategy == "ddp" and HydraConfig.initialized() and HydraConfig.get().mode == RunMode.MULTIRUN:
        raise ValueError(
            "trainer.strategy=ddp starts the command once a device, which a sweep (-m) cannot be; use ddp_spawn"
        )
    if strategy in ("ddp", "ddp_spawn", "ddp_fork", "ddp_notebook"):
        strategy += "_find_unused_parameters_true"  # no stage trains every part of the network
    number_format = resolve(settings.precision, "cuda" if accelerator == "gpu" else "cpu")
    return {
        "accelerator": accelerator,
        "devices": devices,
        "strategy": strategy,
        "precision": "bf16-mixed" if number_format == "bf16" else "32-true",
        "use_distributed_sampler": False,  # StepSampler divides the batches
    }


def _trainer(
    cfg: DictConfig,
    plan: TrainingPlan,
    folder: Path,
    val_set: NuScenesDataset,
    val_batches: DataLoader,
    first_step: int,
) -> pl.Trainer:
    for name in ("lightning.pytorch", "lightning.fabric"):
        logging.getLogger(name).setLevel(logging.ERROR)  # adverts and hardware notes
    warnings.filterwarnings("ignore", module=r"lightning\..*")
    settings = cfg.trainer
    plan_callback, metrics = PlanCallback(plan, seed=cfg.seed), MetricsCSV(folder / "metrics.csv")
    average = AveragedWeights(decay=settings.ema_decay)
    interruption = Interruption()
    progress = TerminalProgress(plan_callback, validate_every=settings.validate_every, val_batches=len(val_batches))
    watch = [ThreadWatch(metrics)] if settings.threads == "auto" else []
    step_end = StepEnd(
        folder / "checkpoints",
        batches=val_batches,
        truth=ground_truth(val_set),
        validate_every=settings.validate_every,
        save_every=settings.save_every,
        plan=plan_callback,
        average=average,
        metrics=metrics,
        interruption=interruption,
        pictures=ValidationPictures(val_set),
        subsets=SUBSETS if settings.drop_table_at_validation else SUBSETS[:1],
    )
    return pl.Trainer(
        **_devices(settings),
        max_steps=-1,  # the plan says when it is over
        max_epochs=-1,
        gradient_clip_val=settings.gradient_clip,
        num_sanity_val_steps=0,
        logger=TensorBoardLogger(folder, name="tb", version="", purge_step=first_step),
        log_every_n_steps=LOG_EVERY,
        enable_checkpointing=False,  # StepEnd writes them
        enable_progress_bar=False,
        enable_model_summary=False,
        plugins=[AtomicCheckpointIO()],
        callbacks=[plan_callback, average, progress, metrics, *watch, interruption, step_end],
    )
