"""The end of a training step: validation, checkpoints, interruption. Here alone is a run's state whole."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import lightning.pytorch as pl
import torch
from lightning.pytorch.callbacks import WeightAveraging
from lightning.pytorch.plugins.io import TorchCheckpointIO
from torch.optim.swa_utils import get_ema_multi_avg_fn

from fusion_net.common.atomic import replacing
from fusion_net.common.boxes import Boxes
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.batch import Batch
from fusion_net.evaluation.scoring import GroundTruth, score
from fusion_net.training.callbacks import MetricsCSV, PlanCallback
from fusion_net.training.interruption import Interruption
from fusion_net.training.validation_pictures import ValidationPictures


class AveragedWeights(WeightAveraging):
    """Exponential moving average of weights and batch norm statistics with ``decay`` per step, taken every ``every`` steps.
    A copy of the model holds it, and that copy is what is validated, so the weights in training are never exchanged for it.
    """

    def __init__(self, *, decay: float, every: int = 4) -> None:
        super().__init__(multi_avg_fn=get_ema_multi_avg_fn(decay**every), use_buffers=True)
        self.every = every

    def should_update(self, step_idx: int | None = None, epoch_idx: int | None = None) -> bool:
        """After the first step and every ``every``-th from there."""
        return step_idx is not None and step_idx % self.every == 0

    def on_validation_epoch_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Exchanges nothing."""

    def on_validation_epoch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Exchanges nothing back."""

    @property
    def model(self) -> Any:
        """The copy of the detector that holds the average."""
        assert self._average_model is not None
        return self._average_model.module.model


class AtomicCheckpointIO(TorchCheckpointIO):
    """Writes beside the old checkpoint and then takes its place: Lightning's own goes by way of /tmp, which is a plain
    copy where that is another file system."""

    def save_checkpoint(self, checkpoint: dict[str, Any], path: Any, storage_options: Any | None = None) -> None:
        """Writes ``checkpoint`` to ``path``."""
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        with replacing(Path(path)) as file:
            torch.save(checkpoint, file)


class StepEnd(pl.Callback):
    """What follows a training step, in this order: validation where it is due, ``best.ckpt``, ``last.ckpt``, the end.

    Checkpoints are written here and nowhere else, never after an exception: inside a step batch norm may have counted the
    batch and the optimizer may have moved half of the weights. A resumed run repeats the steps since ``last.ckpt``, bit
    for bit. An interruption that comes during validation leaves a checkpoint that says so, and the validation is run again.
    Comes last in the list of callbacks, so that the others have seen the step. Of several processes the first one validates
    while the others wait for its result; all of them take the same decisions. ``subsets``: of sensors, which are validated;
    the first one's mAP chooses ``best.ckpt``.
    """

    def __init__(
        self,
        folder: Path,
        *,
        batches: Iterable[Batch],
        truth: GroundTruth,
        validate_every: int,
        save_every: int,
        plan: PlanCallback,
        average: AveragedWeights,
        metrics: MetricsCSV,
        interruption: Interruption,
        pictures: ValidationPictures,
        subsets: Sequence[Sequence[str]],
    ) -> None:
        self.last, self.best = folder / "last.ckpt", folder / "best.ckpt"
        self.batches, self.truth = batches, truth
        self.validate_every, self.save_every = validate_every, save_every
        self.plan, self.average, self.metrics, self.interruption = plan, average, metrics, interruption
        self.pictures, self.subsets = pictures, subsets
        self._must_validate, self._best_map = False, -1.0

    def on_train_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Goes on with the end of the step that a resumed run was interrupted in, or ends at once what was over."""
        if self._must_validate or self.plan.is_over:
            self._finish(trainer)

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx) -> None:
        """Ends a step. Before the fusion stage there are no boxes to score."""
        is_due = pl_module.stage == "fusion" and trainer.global_step % self.validate_every == 0
        self._must_validate = is_due or self.plan.is_over
        self._finish(trainer)

    def _finish(self, trainer: pl.Trainer) -> None:
        if self._must_validate:
            self._validate(trainer)
        trainer.should_stop = self.plan.is_over and not self._must_validate
        is_interrupted = trainer.strategy.reduce_boolean_decision(self.interruption.requested, all=False)
        if trainer.should_stop or is_interrupted or trainer.global_step % self.save_every == 0:
            trainer.save_checkpoint(self.last)
        if is_interrupted and not trainer.should_stop:
            raise KeyboardInterrupt
        self.plan.restart_clock()

    def _validate(self, trainer: pl.Trainer) -> None:
        mean_ap = trainer.strategy.broadcast(self._score(trainer) if trainer.is_global_zero else None)
        if mean_ap is None:
            return
        self._must_validate = False
        if mean_ap >= self._best_map:  # of equals the one that was trained longer
            self._best_map = mean_ap
            trainer.save_checkpoint(self.best)

    def _score(self, trainer: pl.Trainer) -> float | None:
        """The mAP, with all values noted and pictures drawn; None if interrupted."""
        found = self._detect(trainer)
        if found is None:
            return None
        scored, *others = [score(self.truth, [boxes[token] for token in self.truth.tokens]) for boxes in found]
        values = {"mAP": scored.mAP, "NDS": scored.NDS}
        values |= {f"AP_{name}": ap for name, ap in zip(scored.classes, scored.class_ap.tolist(), strict=True)}
        for subset, other in zip(self.subsets[1:], others, strict=True):
            values[f"mAP_{'_'.join(subset)}"] = other.mAP
        self._note(trainer, {f"val/{name}": value for name, value in values.items()})
        with trainer.precision_plugin.val_step_context():
            self.pictures.write(self.average.model, trainer)
        return float(scored.mAP)

    @torch.no_grad()
    def _detect(self, trainer: pl.Trainer) -> list[dict[str, Boxes]] | None:
        """Of each subset boxes by token, found by the averaged weights with those of its sensors that are there; None if
        interrupted."""
        model, device = self.average.model.eval(), trainer.strategy.root_device
        found: list[dict[str, Boxes]] = [{} for _ in self.subsets]
        for batch in self.batches:
            batch = batch.to(device)
            for boxes, subset in zip(found, self.subsets, strict=True):
                if self.interruption.requested:
                    return None
                chosen = torch.tensor([name in subset for name in MODALITIES], device=device)
                with trainer.precision_plugin.val_step_context():
                    boxes.update(zip(batch.tokens, model.decode(model(batch, batch.present & chosen)), strict=True))
        return found

    def _note(self, trainer: pl.Trainer, values: Mapping[str, float]) -> None:
        self.metrics.write(trainer.global_step, values)
        for logger in trainer.loggers:
            logger.log_metrics(dict(values), step=trainer.global_step)
        print(f"step {trainer.global_step}: val mAP {values['val/mAP']:.3f} NDS {values['val/NDS']:.3f}", flush=True)

    def state_dict(self) -> dict[str, Any]:
        """Whether the step's validation is still to come, and the best score so far."""
        return {"must_validate": self._must_validate, "best_map": self._best_map}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """As in the interrupted run."""
        self._must_validate, self._best_map = state_dict["must_validate"], state_dict["best_map"]
