"""When the ego waits: before a light, in a queue, to give way."""

import math
from dataclasses import dataclass

import numpy as np

BRAKE = 2.5
"""m/s^2 of an ordinary stop."""


@dataclass(frozen=True)
class Halt:
    """A driver stands from ``start`` to ``end``, seconds of the recording."""

    start: float
    end: float

    def brakes(self, t: float, speed: float) -> bool:
        """Whether somebody at ``speed`` m/s brakes or stands at ``t``: late enough to stand at the start."""
        return self.start - speed / BRAKE <= t < self.end

    def approach_speed(self, lead: float) -> float:
        """The greatest speed in m/s from which ``lead`` seconds before the recording are enough."""
        return BRAKE * max(self.start + lead, 0.0)


NEVER = Halt(math.inf, math.inf)


def choose_halt(rng: np.random.Generator, duration: float, probability: float) -> Halt:
    """None, or with a ``probability`` one that stands throughout, sets off, or halts within the ``duration`` in seconds."""
    if rng.uniform() >= probability:
        return NEVER
    change = rng.uniform(0.1, 0.8) * duration
    return (Halt(-math.inf, math.inf), Halt(-math.inf, change), Halt(change, math.inf))[rng.integers(3)]
