"""How a run spends its steps or minutes: dense camera pretraining first, fusion after, each under a one-cycle rate."""

import math
from dataclasses import dataclass
from typing import Literal

from beartype import beartype

Stage = Literal["camera", "fusion"]


@beartype
@dataclass
class TrainingPlan:
    """Two stages: ``camera_steps`` steps of the camera's dense losses alone, then ``fusion_steps`` of everything.

    Without the first the camera contributes nothing in minutes. Modality dropout begins at the share ``dropout_from`` of
    the fusion stage. With ``max_minutes`` each stage also ends when its share of the minutes (``camera_share`` and the
    rest) is used up; rates anneal by whichever limit is nearer, so a short run is a whole run in small.
    """

    camera_steps: int
    fusion_steps: int
    max_lr: float
    dropout_from: float = 0.5
    warmup: float = 0.15
    max_minutes: float | int | None = None
    camera_share: float = 0.4
    fusion_began: tuple[int, float] | None = None  # step and elapsed seconds at which fusion started

    def __post_init__(self) -> None:
        if self.fusion_steps < 1 or self.camera_steps < 0:
            raise ValueError(
                f"plan: camera_steps={self.camera_steps} must be >= 0 and fusion_steps={self.fusion_steps} >= 1"
            )
        if self.max_minutes is not None and self.max_minutes <= 0:
            raise ValueError(f"plan: max_minutes={self.max_minutes} must be above 0")
        if self.camera_steps == 0 and self.fusion_began is None:
            self.fusion_began = (0, 0.0)

    def position(self, step: int, elapsed: float) -> tuple[Stage, float]:
        """Stage and the share of it that is done (1: over) after ``step`` steps and ``elapsed`` seconds."""
        budget = math.inf if self.max_minutes is None else 60.0 * self.max_minutes
        if self.fusion_began is None:
            share = max(step / self.camera_steps, elapsed / (budget * self.camera_share))
            if share < 1:
                return "camera", share
            self.fusion_began = (step, elapsed)
        first_step, began = self.fusion_began
        share = max((step - first_step) / self.fusion_steps, (elapsed - began) / (budget - began))
        return "fusion", min(share, 1.0)

    def learning_rate(self, share: float) -> float:
        """One-cycle (Smith, 2018): cosine from max_lr / 20 up over ``warmup``, then cosine down to max_lr / 1000."""
        low, high, end = self.max_lr / 20, self.max_lr, self.max_lr / 1000
        if share < self.warmup:
            return high + (low - high) * 0.5 * (1 + math.cos(math.pi * share / self.warmup))
        return end + (high - end) * 0.5 * (1 + math.cos(math.pi * (share - self.warmup) / (1 - self.warmup)))

    @property
    def total_steps(self) -> int:
        """Steps of both stages, when no time limit cuts them."""
        return self.camera_steps + self.fusion_steps
