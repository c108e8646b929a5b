"""From a composed config to a finished run folder."""

import logging
import signal
import warnings
from pathlib import Path
from typing import Any

import lightning.pytorch as pl
from lightning.pytorch.callbacks import EMAWeightAveraging, ModelCheckpoint
from lightning.pytorch.loggers import TensorBoardLogger
from omegaconf import DictConfig

from fusion_net.cli import build
from fusion_net.command_line import command_line
from fusion_net.data.datamodule import EpochSampler, NuScenesDataset, make_loader
from fusion_net.evaluation.scoring import ground_truth
from fusion_net.run_dir import mark_finished, open_run, resume_step, run_folder
from fusion_net.training.callbacks import MetricsCSV, PlanCallback, TerminalProgress
from fusion_net.training.module import DetectorModule
from fusion_net.training.plan import TrainingPlan
from fusion_net.training.precision import resolve


def fit(cfg: DictConfig) -> Path:
    """Trains what the config describes; returns the run's folder. Mistakes in it raise ValueError before anything is
    written; Ctrl-C keeps ``checkpoints/last.ckpt``."""
    if not 0 <= cfg.seed < 2**32:
        raise ValueError(f"seed={cfg.seed} is not within 0 and 2**32 - 1")
    pl.seed_everything(cfg.seed, verbose=False)
    settings = cfg.trainer
    for name in ("batch_size", "validate_every", "save_every"):
        if settings[name] < 1:
            raise ValueError(f"trainer.{name}={settings[name]} must be at least 1")
    if settings.workers < 0:
        raise ValueError(f"trainer.workers={settings.workers} is not a number of processes; 0 reads in this one")
    model = build(cfg.model, "model")
    train_set: NuScenesDataset = build(cfg.reader.train, "reader.train")
    val_set: NuScenesDataset = build(cfg.reader.val, "reader.val")
    if len(train_set) < settings.batch_size:
        root = cfg.data.root if isinstance(cfg.data.root, str) else cfg.data.root[0]
        raise ValueError(
            f"{cfg.data.root} has {len(train_set)} training samples, fewer than trainer.batch_size={settings.batch_size};"
            f" generate more: {command_line('-m data_gen', data=cfg.data.name, data__root=root)}"
        )
    if not train_set.has_labels():
        raise ValueError(
            f"no labelled object of {cfg.data.root} lies on the grid ({_extent(cfg.grid)}): the rig cannot see it"
        )
    plan = _plan(cfg)
    module = DetectorModule(
        model,
        modality_dropout=cfg.modality_dropout if len(cfg.encoders) > 1 else 0.0,
        dropout_from=settings.dropout_from,
        freeze_camera=settings.freeze_camera,
        weight_decay=settings.weight_decay,
        max_lr=settings.max_lr,
        seed=cfg.seed,
        truth=ground_truth(val_set),
    )
    folder = run_folder(cfg.name)
    trainer = _trainer(cfg, plan, folder)
    batches = make_loader(
        train_set, batch_size=settings.batch_size, shuffle=True, num_workers=settings.workers, drop_last=True
    )
    last = folder / "checkpoints" / "last.ckpt"
    if cfg.resume and last.exists():
        epoch, seen = divmod(resume_step(model, last), len(batches))
        sampler = batches.sampler
        assert isinstance(sampler, EpochSampler)
        sampler.go_on(epoch, seen * settings.batch_size)
    open_run(folder, cfg, data=train_set.fingerprint, resume=cfg.resume, overwrite=cfg.overwrite)
    parameters = sum(p.numel() for p in model.parameters()) / 1e6
    print(f"{folder}: {parameters:.2f} M parameters, {len(train_set)} training and {len(val_set)} validation samples")
    try:
        trainer.fit(
            module, batches, make_loader(val_set, batch_size=settings.batch_size),
            ckpt_path=last if cfg.resume else None, weights_only=True,
        )  # fmt: skip
    except SystemExit:  # Lightning's answer to Ctrl-C, once last.ckpt is written; it leaves the signal ignored
        signal.signal(signal.SIGINT, signal.default_int_handler)
        raise KeyboardInterrupt("add resume=true to the same command to go on") from None
    if module.validated_at != trainer.global_step:  # a time limit ended the run between two validations
        trainer.validate(module, make_loader(val_set, batch_size=settings.batch_size), verbose=False)
        best: Any = trainer.checkpoint_callbacks[0]
        if best.best_model_score is None or trainer.callback_metrics["val/mAP"] >= best.best_model_score:
            trainer.save_checkpoint(folder / "checkpoints" / "best.ckpt")
    trainer.save_checkpoint(last)
    mark_finished(folder)
    return folder


def _extent(grid: DictConfig) -> str:
    return f"x {grid.x_min} to {grid.x_max} m, y {grid.y_min} to {grid.y_max} m"


def _plan(cfg: DictConfig) -> TrainingPlan:
    """The configured stages; without a camera, or with nothing else, its own fall away."""
    settings = cfg.trainer
    steps = {
        "camera": settings.camera_steps if "camera" in cfg.encoders else 0,
        "alone": settings.alone_steps if "camera" in cfg.encoders and len(cfg.encoders) > 1 else 0,
        "fusion": settings.fusion_steps,
    }
    return TrainingPlan(steps=steps, max_lr=settings.max_lr, max_minutes=settings.max_minutes)


def _trainer(cfg: DictConfig, plan: TrainingPlan, folder: Path) -> pl.Trainer:
    for name in ("lightning.pytorch", "lightning.fabric"):
        logging.getLogger(name).setLevel(logging.ERROR)  # adverts and hardware notes
    warnings.filterwarnings("ignore", module=r"lightning\..*")
    settings = cfg.trainer
    best = ModelCheckpoint(
        folder / "checkpoints", filename="best", monitor="val/mAP", mode="max", enable_version_counter=False
    )
    last = ModelCheckpoint(
        folder / "checkpoints", filename="last", every_n_train_steps=settings.save_every, save_on_exception=True,
        enable_version_counter=False,
    )  # fmt: skip
    return pl.Trainer(
        accelerator="cpu",
        devices=1,
        precision="bf16-mixed" if resolve(settings.precision) == "bf16" else "32-true",
        max_steps=plan.total_steps,
        max_epochs=-1,
        gradient_clip_val=settings.gradient_clip,
        val_check_interval=settings.validate_every,
        check_val_every_n_epoch=None,
        num_sanity_val_steps=0,
        logger=TensorBoardLogger(folder, name="tb", version=""),
        log_every_n_steps=20,
        enable_progress_bar=False,
        enable_model_summary=False,
        callbacks=[
            PlanCallback(plan, seed=cfg.seed),
            EMAWeightAveraging(decay=settings.ema_decay, use_buffers=True),
            TerminalProgress(plan.total_steps),
            MetricsCSV(folder / "metrics.csv"),
            best,
            last,
        ],
    )
