"""How a run spends its steps or minutes: the weak sensor first, then all of them, each stage under a one-cycle rate.

``camera``: the camera's dense losses alone, without which it contributes nothing in minutes. ``alone``: the whole network
with the camera as its only sensor, so that decoder and head learn to read it before a stronger one does the work for it.
``fusion``: everything.
"""

import math
from dataclasses import dataclass, field
from typing import Literal

from beartype import beartype

Stage = Literal["camera", "alone", "fusion"]
STAGES: tuple[Stage, ...] = ("camera", "alone", "fusion")


@beartype
@dataclass
class TrainingPlan:
    """Steps of each stage, and the share of ``max_minutes`` (if set) after which it ends anyway.

    Rates anneal by whichever limit is nearer, so a short run is a whole run in small; a stage that ends early leaves its
    time to the next.
    """

    steps: dict[str, int]
    max_lr: float
    warmup: float = 0.15
    max_minutes: float | int | None = None
    time_shares: dict[str, float] = field(default_factory=lambda: {"camera": 0.18, "alone": 0.05, "fusion": 0.77})
    began: list[list[float]] = field(default_factory=lambda: [[0.0, 0.0]])  # (step, seconds) of each stage begun so far

    def __post_init__(self) -> None:
        if unknown := set(self.steps) ^ set(STAGES):
            raise ValueError(f"plan: steps need exactly {', '.join(STAGES)}; check {', '.join(sorted(unknown))}")
        if self.steps["fusion"] < 1 or min(self.steps.values()) < 0:
            raise ValueError(f"plan: steps {self.steps} must not be negative, and fusion at least 1")
        if self.max_minutes is not None and self.max_minutes <= 0:
            raise ValueError(f"plan: max_minutes={self.max_minutes} must be above 0")

    def position(self, step: int, elapsed: float) -> tuple[Stage, float]:
        """Stage and the share of it that is done (1: over) after ``step`` steps and ``elapsed`` seconds."""
        while True:
            stage = STAGES[len(self.began) - 1]
            first_step, first_second = self.began[-1]
            done = (step - first_step) / self.steps[stage] if self.steps[stage] else 1.0
            if self.max_minutes is not None:
                ahead = STAGES[STAGES.index(stage) :]
                fair = self.time_shares[stage] / sum(self.time_shares[s] for s in ahead if self.steps[s])
                left = 60.0 * self.max_minutes - first_second
                done = max(done, (elapsed - first_second) / max(left * fair, 1e-9))
            if done < 1 or stage == STAGES[-1]:
                return stage, min(done, 1.0)
            self.began.append([float(step), elapsed])

    def learning_rate(self, share: float) -> float:
        """One-cycle (Smith, 2018): cosine from max_lr / 20 up over ``warmup``, then cosine down to max_lr / 1000."""
        low, high, end = self.max_lr / 20, self.max_lr, self.max_lr / 1000
        if share < self.warmup:
            return high + (low - high) * 0.5 * (1 + math.cos(math.pi * share / self.warmup))
        return end + (high - end) * 0.5 * (1 + math.cos(math.pi * (share - self.warmup) / (1 - self.warmup)))

    @property
    def total_steps(self) -> int:
        """Steps of all stages, when no time limit cuts them."""
        return sum(self.steps.values())
