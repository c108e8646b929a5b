"""How everything moves around one moment, from poses a little before and after it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_gen.scene.scene import Scene

Array = NDArray[np.float64]

_STEP = 0.05


class Motion(NamedTuple):
    """Of all actors and, last, so that WORLD (-1) finds it, the world, in the global frame; SI units."""

    position: Array  # (A + 1, 3)
    yaw: Array  # (A + 1,)
    velocity: Array  # (A + 1, 3)
    acceleration: Array  # (A + 1, 3)
    yaw_rate: Array  # (A + 1,)


def motion_at(scene: Scene, t: float) -> Motion:
    """The motion at time ``t`` by central differences over 0.1 s."""
    (before, left), (now, yaw), (after, right) = (scene.poses(t + step) for step in (-_STEP, 0.0, _STEP))
    return Motion(
        now, yaw, (after - before) / (2 * _STEP), (after - 2 * now + before) / _STEP**2, (right - left) / (2 * _STEP)
    )
