"""Lightning's trainer as a run needs it: devices, number format and callbacks."""

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
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.evaluation.drop_table import SUBSETS
from fusion_net.evaluation.scoring import ground_truth
from fusion_net.models.precision import device_of, resolve
from fusion_net.training.callbacks import LOG_EVERY, MetricsCSV, PlanCallback
from fusion_net.training.interruption import Interruption
from fusion_net.training.plan import TrainingPlan
from fusion_net.training.progress import TerminalProgress
from fusion_net.training.step_end import AtomicCheckpointIO, AveragedWeights, StepEnd
from fusion_net.training.threads import ThreadWatch
from fusion_net.training.validation_pictures import ValidationPictures


def _devices(settings: DictConfig) -> dict[str, Any]:
    """Where and in which number format Lightning's trainer computes. ValueError when the machine has no such device."""
    accelerator, devices, strategy = settings.accelerator, settings.devices, settings.strategy
    if devices < -1 or devices == 0:
        raise ValueError(f"trainer.devices={devices} is not a number of devices; -1 takes every one that there is")
    device = device_of(accelerator, setting="trainer.accelerator")
    if accelerator == "auto":
        accelerator = "gpu" if device == "cuda" else "cpu"
    if devices == -1:
        devices = torch.cuda.device_count() if device == "cuda" else 1
    check_names("strategy of trainer.strategy", [strategy], ["auto", *StrategyRegistry.available_strategies()])
    if strategy == "auto" and devices > 1:
        strategy = "ddp"
    if strategy == "ddp" and HydraConfig.initialized() and HydraConfig.get().mode == RunMode.MULTIRUN:
        raise ValueError(
            "trainer.strategy=ddp starts the command once a device, which a sweep (-m) cannot be; use ddp_spawn"
        )
    if strategy in ("ddp", "ddp_spawn", "ddp_fork", "ddp_notebook"):
        strategy += "_find_unused_parameters_true"  # no stage trains every part of the network
    number_format = resolve(settings.precision, device)
    return {
        "accelerator": accelerator,
        "devices": devices,
        "strategy": strategy,
        "precision": "bf16-mixed" if number_format == "bf16" else "32-true",
        "use_distributed_sampler": False,  # StepSampler divides the batches
    }


def lightning_trainer(
    cfg: DictConfig,
    plan: TrainingPlan,
    folder: Path,
    val_set: NuScenesDataset,
    val_batches: DataLoader,
    first_step: int,
) -> pl.Trainer:
    """A trainer that follows ``plan`` from ``first_step`` on and writes what a run's folder holds: metrics, TensorBoard,
    checkpoints, validations and pictures. ValueError when the machine has no such device."""
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
