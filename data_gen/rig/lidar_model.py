"""The figures of a spinning LiDAR that its maker gives: beams and their timing, range, noise, beam width."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from beartype import beartype
from numpy.typing import NDArray

from fusion_net.common.settings import Number

MOST_BEAMS = 256
"""Rings are written as bytes."""


@beartype
@dataclass(frozen=True, kw_only=True)
class LidarModel:
    """A spinning LiDAR.

    ``elevation_deg`` of every beam, in firing order. ``beams_at_once`` beams fire together, ``firing_interval`` s after those
    before them; the beams of a column take ``column_interval`` s, recharging included. ``max_range`` is the distance in m at
    which a target of 90 % reflectivity is lost half of the time, ``range_noise`` the standard deviation in m of a strong
    return's range, ``divergence`` the full width of a beam in rad.
    """

    name: str
    elevation_deg: list[Number]
    firing_interval: float
    column_interval: float
    beams_at_once: int = 1
    max_range: Number
    range_noise: Number
    divergence: Number

    def __post_init__(self) -> None:
        beams = self.beams
        if not 1 <= beams <= MOST_BEAMS or not all(abs(angle) < 90 for angle in self.elevation_deg):
            self._refuse("elevation_deg", f"is not 1 to {MOST_BEAMS} angles between -90 and 90 degrees")
        if len(set(self.elevation_deg)) < beams:
            self._refuse("elevation_deg", "has an angle twice")
        if self.beams_at_once < 1 or beams % self.beams_at_once:
            self._refuse("beams_at_once", f"does not divide {beams} beams", 1)
        for key, low in (("firing_interval", 1e-9), ("max_range", 1.0), ("range_noise", 0.0), ("divergence", 1e-6)):
            if not low <= getattr(self, key) < math.inf:
                self._refuse(key, f"is less than {low:g} or endless", low)
        shortest = (beams // self.beams_at_once - 1) * self.firing_interval
        if not shortest < self.column_interval < math.inf:
            self._refuse("column_interval", f"s is too short for {beams} beams", shortest + self.firing_interval)

    def _refuse(self, key: str, why: str, nearest: Number | None = None) -> None:
        mend = f"; the nearest that works is lidar.{key}={nearest:g}" if nearest is not None else ""
        raise ValueError(f"lidar.{key}={str(getattr(self, key)).replace(' ', '')} {why}{mend}")

    @property
    def beams(self) -> int:
        """How many there are."""
        return len(self.elevation_deg)

    @cached_property
    def ring(self) -> NDArray[np.uint8]:
        """nuScenes' ring of each beam (B,) in firing order: 0 points down most."""
        return np.argsort(np.argsort(self.elevation_deg)).astype(np.uint8)

    def columns_in(self, seconds: float) -> int:
        """Columns that it fires in so many seconds."""
        return int(seconds / self.column_interval + 0.5)
