"""How long a run will take at the speed that it has, and how much of its plan a time limit leaves."""

import copy
import math
import statistics
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import NamedTuple

import torch

from fusion_net.data.batch import Batch
from fusion_net.models.fusion_net import FusionNet
from fusion_net.training.plan import STAGES, Stage, TrainingPlan

STARTING, STEADY = 10, 30
"""Steps of a stage that are slower than the rest (kernels are made, samples decoded first), and those that its speed is of."""
VALIDATION_COST = 0.5
"""Time for a batch in validation, in fusion steps, until one was seen: there is no backward pass."""


class Outlook(NamedTuple):
    """The step that a run will end at, the seconds until then, and the validations among them."""

    last_step: int
    seconds: float
    validations: int


def outlook(
    plan: TrainingPlan,
    pace: Mapping[Stage, float],
    *,
    step: int,
    elapsed: float,
    validate_every: int,
    validation: float,
) -> Outlook:
    """What is ahead after ``step`` steps and ``elapsed`` seconds of ``plan``, at ``pace`` seconds a step in each stage still
    to come and ``validation`` seconds for each validation."""
    stage_step, stage_second = plan.stage_starts[-1]
    end, clock = step, elapsed
    fusion_from = end
    for stage in STAGES[len(plan.stage_starts) - 1 :]:
        fusion_from = end
        left = max(stage_step + plan.steps[stage] - end, 0)
        if left:
            in_time = (stage_second + plan.seconds(stage, stage_second) - clock) / pace[stage]
            left = min(left, max(math.ceil(in_time), 0)) if math.isfinite(in_time) else left
        end, clock = int(end + left), clock + left * (pace[stage] if left else 0.0)
        stage_step, stage_second = end, clock
    validations = end // validate_every - fusion_from // validate_every + (end % validate_every > 0)
    return Outlook(end, clock - elapsed + validations * validation, validations)


class StepTimes:
    """The speed of the stage that runs: the median over its last ``STEADY`` steps, without its first ``STARTING``."""

    def __init__(self) -> None:
        self.stage: Stage | None = None
        self._seen = 0
        self._seconds: deque[float] = deque(maxlen=STEADY)

    def add(self, stage: Stage, seconds: float) -> None:
        """Notes a step."""
        if stage != self.stage:
            self.stage, self._seen = stage, 0
            self._seconds.clear()
        self._seen += 1
        if self._seen > STARTING:
            self._seconds.append(seconds)

    @property
    def median(self) -> float | None:
        """Seconds a step; None until the speed is known."""
        return statistics.median(self._seconds) if len(self._seconds) == STEADY else None


def fusion_surplus(
    model: FusionNet,
    batch: Batch,
    *,
    freeze_camera: bool,
    context: Callable[[], AbstractContextManager],
    repeats: int = 3,
) -> float:
    """Seconds that forward and backward pass of the whole network take longer than those of the camera's dense losses.

    Tried on a copy of the model, which is left as it is. ``context``: the trainer's, of its number format.
    """
    camera, whole = copy.deepcopy(model), copy.deepcopy(model)
    if freeze_camera and whole.image_network is not None:
        whole.image_network.freeze(True)

    def seconds(loss: Callable[[], torch.Tensor]) -> float:
        times = []
        for _ in range(1 + repeats):  # the first makes kernels
            started = time.perf_counter()
            with context():
                value = loss()
            value.backward()
            if value.is_cuda:
                torch.cuda.synchronize()
            times.append(time.perf_counter() - started)
        return statistics.median(times[1:])

    fusion = seconds(lambda: whole.loss(whole(batch), batch)["loss"])
    return fusion - seconds(lambda: camera.camera_loss(batch)["loss"])
