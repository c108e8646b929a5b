"""What happens around the training steps: rates and stages, metrics.csv, memory."""

import csv
import math
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import lightning.pytorch as pl
import torch
from lightning.pytorch.utilities import rank_zero_only
from torch import Tensor

from fusion_net.data.datamodule import trim_memory
from fusion_net.training.plan import Stage, TrainingPlan

LOG_EVERY = 20
"""Steps from one row of losses to the next, in metrics.csv and TensorBoard alike."""


class PlanCallback(pl.Callback):
    """Moves the module through its plan: stage, learning rate, end. Its clock survives a resume.

    It also seeds torch from (seed, step) before each step, which makes a resumed run equal to an uninterrupted one.
    """

    def __init__(self, plan: TrainingPlan, *, seed: int) -> None:
        self.plan, self.seed = plan, seed
        self.elapsed, self._tick = 0.0, math.nan
        self.is_over = False

    def on_train_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Starts the clock."""
        self.restart_clock()
        self.is_over = self._position(trainer)[1] >= 1

    def on_train_batch_start(self, trainer, pl_module, batch, batch_idx) -> None:
        """Sets stage, progress, learning rate and random state of this step."""
        stage, progress = self._position(trainer)
        pl_module.enter(stage, progress)
        for group in trainer.optimizers[0].param_groups:
            group["lr"] = self.plan.learning_rate(progress) * group.get("lr_scale", 1.0)
        torch.manual_seed(hash((self.seed, trainer.global_step)))

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx) -> None:
        """Notes whether this was the last step. Gives fragmented heap back every 50 steps: point clouds of varying length
        otherwise grow the process to many GB."""
        self.is_over = self._position(trainer)[1] >= 1
        if trainer.global_step % 50 == 0:
            trim_memory()

    def restart_clock(self) -> None:
        """Time since the last step does not count: validation, checkpoints."""
        self._tick = time.perf_counter()

    def _position(self, trainer: pl.Trainer) -> tuple[Stage, float]:
        """Stage and progress at this step and time. Several processes go by the clock of the first."""
        now = time.perf_counter()
        self.elapsed, self._tick = self.elapsed + now - self._tick, now
        if self.plan.max_minutes is not None:
            self.elapsed = trainer.strategy.broadcast(self.elapsed)
        return self.plan.position(trainer.global_step, self.elapsed)

    def state_dict(self) -> dict[str, Any]:
        """Clock and stage, for the checkpoint."""
        return {"elapsed": self.elapsed, "stage_starts": self.plan.stage_starts}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Clock and stage of the interrupted run."""
        self.elapsed = state_dict["elapsed"]
        self.plan.stage_starts = [list(pair) for pair in state_dict["stage_starts"]]


class MetricsCSV(pl.Callback):
    """Appends scalars to metrics.csv as (step, name, value) rows; a resumed run goes on in the same file, from the row
    that its checkpoint was written after.

    Lightning's own CSV logger starts the file again on resume.
    """

    def __init__(self, path: Path, *, every: int = LOG_EVERY) -> None:
        self.path, self.every = path, every

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx) -> None:
        """Writes the step's losses, rate and gradient norms."""
        if trainer.global_step % self.every == 0:
            self.write(trainer.global_step, pl_module.scalars)

    @rank_zero_only
    def write(self, step: int, scalars: Mapping[str, float | Tensor]) -> None:
        """Appends a step's scalars; of several processes the first one does."""
        is_new = not self.path.exists() or not self.path.stat().st_size  # a resumed run may have cut off every row
        with self.path.open("a", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            if is_new:
                writer.writerow(["step", "name", "value"])
            writer.writerows([step, name, f"{float(value):.6g}"] for name, value in scalars.items())

    def state_dict(self) -> dict[str, Any]:
        """How long the file is, for the checkpoint."""
        return {"bytes": self.path.stat().st_size if self.path.exists() else 0}

    @rank_zero_only
    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Cuts off the rows of steps that were taken after the checkpoint: they are taken again."""
        if self.path.exists() and self.path.stat().st_size > state_dict["bytes"]:
            os.truncate(self.path, state_dict["bytes"])
