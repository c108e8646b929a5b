"""The training step: which losses in which stage, which sensors each sample keeps."""

from dataclasses import replace
from pathlib import Path

import lightning.pytorch as pl
import torch

from fusion_net.common.cli.processes import release_interrupts
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.batch import Batch
from fusion_net.models.fusion_net import FusionNet
from fusion_net.training.diagnostics import gradient_norms, save_nonfinite
from fusion_net.training.modality_dropout import sample_present
from fusion_net.training.optimizer import make_optimizer
from fusion_net.training.plan import Stage


class DetectorModule(pl.LightningModule):
    """Wraps a detector (``forward``, ``loss``, and ``camera_loss`` where there is an image network) for Lightning.

    ``modality_dropout`` acts from the fraction ``dropout_from`` of the fusion stage; ``freeze_camera`` lets the camera's
    image plane rest in it. ``scalars`` has the last step's losses and fractions of samples that kept each sensor, by name;
    at the steps that are logged also the learning rate and the norms of the gradient. A batch whose loss is not finite is
    written to ``nonfinite_file``.
    """

    def __init__(
        self,
        model: FusionNet,
        *,
        modality_dropout: float,
        dropout_from: float,
        freeze_camera: bool,
        weight_decay: float,
        max_lr: float,
        seed: int,
        nonfinite_file: Path,
    ) -> None:
        super().__init__()
        if not 0 <= modality_dropout <= 1:
            raise ValueError(f"modality_dropout={modality_dropout} is a probability: between 0 and 1")
        self.model = model
        self.modality_dropout, self.dropout_from, self.freeze_camera = modality_dropout, dropout_from, freeze_camera
        self.weight_decay, self.max_lr, self.seed = weight_decay, max_lr, seed
        self.nonfinite_file = nonfinite_file
        self.stage: Stage = "fusion"
        self.progress = 0.0
        self.scalars: dict[str, torch.Tensor] = {}

    def configure_callbacks(self) -> list[pl.Callback]:
        """No callbacks; it is Lightning's first call after it has started the other processes."""
        release_interrupts()
        return []

    def enter(self, stage: Stage, progress: float) -> None:
        """Told before each step where the plan is."""
        network = self.model.image_network
        frozen = stage != "camera" and self.freeze_camera
        if network is not None and network.frozen != frozen:
            network.freeze(frozen)
        self.stage, self.progress = stage, progress

    def training_step(self, batch: Batch, batch_idx: int) -> torch.Tensor:
        """The loss of one batch. ValueError when it is not finite, with the batch saved."""
        kept: dict[str, torch.Tensor] = {}
        present = batch.present
        if self.stage == "camera":
            losses = self.model.camera_loss(batch)
        else:
            present = self._present(batch)
            losses = self.model.loss(self.model(batch, present), batch)
            kept = {f"kept_{m}": p for m, p in zip(MODALITIES, present.float().mean(dim=0), strict=True)}
        if not torch.isfinite(losses["loss"]):
            seen, step = replace(batch, present=present), self.global_step
            save_nonfinite(self.nonfinite_file, seen, losses, self.model, step=step, stage=self.stage)
            terms = ", ".join(f"{name} {float(value):.3g}" for name, value in losses.items())
            raise ValueError(
                f"the loss is not finite at step {step}: {terms}; the batch (samples {', '.join(batch.tokens)})"
                f" is saved in {self.nonfinite_file}; lower trainer.max_lr, or look for broken values in these samples"
            )
        self.scalars = {f"train/{name}": value.detach() for name, value in (kept | losses).items()}
        self.log_dict(self.scalars, batch_size=batch.size)
        return losses["loss"]

    def on_before_optimizer_step(self, optimizer: torch.optim.Optimizer) -> None:
        """Notes the learning rate and, before it is clipped, the gradient's norm, in all and by part."""
        if (self.global_step + 1) % self.trainer.log_every_n_steps:  # type: ignore[attr-defined]
            return
        norms = {f"train/gradient_norm_{part}": norm for part, norm in gradient_norms(self.model).items()}
        watched = {"train/learning_rate": torch.tensor(optimizer.param_groups[0]["lr"])} | norms
        self.scalars |= watched
        self.log_dict(watched)

    def _present(self, batch: Batch) -> torch.Tensor:
        if self.stage == "camera_only":
            return torch.tensor([name == "camera" for name in MODALITIES], device=batch.present.device) & batch.present
        probability = self.modality_dropout if self.progress >= self.dropout_from else 0.0
        rank = self.global_rank  # of several devices each samples for itself
        key = (self.seed, self.global_step, rank) if rank else (self.seed, self.global_step)
        generator = torch.Generator().manual_seed(abs(hash(key)))
        sampled = sample_present(batch.size, probability, generator).to(batch.present.device)
        kept = batch.present & sampled
        return torch.where(
            kept.any(dim=1, keepdim=True), kept, batch.present
        )  # a dead sensor is never all that is left

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Muon and AdamW under one rate, which the plan sets at each step."""
        return make_optimizer(
            self.model, outputs=self.model.output_layers(), lr=self.max_lr, weight_decay=self.weight_decay
        )
