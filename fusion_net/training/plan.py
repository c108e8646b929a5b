"""The stages of a training run: the weak sensor first, then all of them, each stage under a one-cycle learning rate.

``camera``: the camera's dense losses alone, without which it contributes nothing in minutes. ``camera_only``: the whole
network with the camera as its only sensor, so that decoder and head learn to read it before a stronger one does the work.
``fusion``: everything.
"""

import math
from dataclasses import dataclass, field
from typing import Literal

from beartype import beartype

Stage = Literal["camera", "camera_only", "fusion"]
STAGES: tuple[Stage, ...] = ("camera", "camera_only", "fusion")


@beartype
@dataclass
class TrainingPlan:
    """Steps of each stage, and the fraction of ``max_minutes`` (if set) after which it ends anyway.

    Rates anneal by whichever limit is nearer, so a short run is a whole run in small; a stage that ends early leaves its
    time to the next.
    """

    steps: dict[str, int]
    max_lr: float
    warmup_fraction: float | int
    stage_fractions: dict[str, float]
    max_minutes: float | int | None = None
    stage_starts: list[list[float]] = field(
        default_factory=lambda: [[0.0, 0.0]]
    )  # (step, seconds) of each stage so far

    def __post_init__(self) -> None:
        if unknown := set(self.steps) ^ set(STAGES):
            raise ValueError(f"trainer: steps need exactly {', '.join(STAGES)}; check {', '.join(sorted(unknown))}")
        if self.steps["fusion"] < 1 or min(self.steps.values()) < 0:
            raise ValueError(f"trainer: steps {self.steps} must not be negative, and fusion at least 1")
        if unknown := set(self.stage_fractions) ^ set(STAGES):
            raise ValueError(
                f"trainer: stage_fractions need exactly {', '.join(STAGES)}; check {', '.join(sorted(unknown))}"
            )
        if min(self.stage_fractions.values()) < 0 or not self.stage_fractions["fusion"]:
            raise ValueError(
                f"trainer: stage_fractions {self.stage_fractions} must not be negative, and fusion above 0"
            )
        if not 0 <= self.warmup_fraction < 1:
            raise ValueError(f"trainer: warmup_fraction={self.warmup_fraction} must be at least 0 and below 1")
        if self.max_minutes is not None and self.max_minutes <= 0:
            raise ValueError(f"trainer: max_minutes={self.max_minutes} must be above 0")

    def position(self, step: int, elapsed: float) -> tuple[Stage, float]:
        """Stage and the fraction of it that is done (1: over) after ``step`` steps and ``elapsed`` seconds."""
        while True:
            stage = STAGES[len(self.stage_starts) - 1]
            first_step, first_second = self.stage_starts[-1]
            done = (step - first_step) / self.steps[stage] if self.steps[stage] else 1.0
            done = max(done, (elapsed - first_second) / self.seconds(stage, first_second))
            if done < 1 or stage == STAGES[-1]:
                return stage, min(done, 1.0)
            self.stage_starts.append([float(step), elapsed])

    def seconds(self, stage: Stage, begun: float) -> float:
        """After how many seconds a stage that began at second ``begun`` ends anyway; infinity without a time limit."""
        if self.max_minutes is None:
            return math.inf
        ahead = STAGES[STAGES.index(stage) :]
        fraction = self.stage_fractions[stage] / sum(self.stage_fractions[s] for s in ahead if self.steps[s])
        return max((60.0 * self.max_minutes - begun) * fraction, 1e-9)

    def learning_rate(self, progress: float) -> float:
        """One-cycle (Smith, 2018): cosine from max_lr / 20 up over ``warmup_fraction``, then cosine down to max_lr / 1000."""
        low, high, end = self.max_lr / 20, self.max_lr, self.max_lr / 1000
        if progress < self.warmup_fraction:
            return high + (low - high) * 0.5 * (1 + math.cos(math.pi * progress / self.warmup_fraction))
        annealed = (progress - self.warmup_fraction) / (1 - self.warmup_fraction)
        return end + (high - end) * 0.5 * (1 + math.cos(math.pi * annealed))

    @property
    def total_steps(self) -> int:
        """Steps of all stages, when no time limit cuts them."""
        return sum(self.steps.values())
