"""What a rig looks at: the sector of the ground that its sensors cover, and the gaps between them."""

from dataclasses import dataclass

import numpy as np

from data_gen.rig.mounts import Interval
from data_gen.rig.sensor_suite import SensorSuite


@dataclass(frozen=True)
class Sector:
    """A sector of the ground around the ego: directions within ``half`` radians of ``center``, counter-clockwise from
    straight ahead. ``half`` is pi for all round."""

    center: float
    half: float


FRONT = Sector(0.0, float(np.radians(36.0)))
"""The sector of a single front camera of 72 degrees, by which traffic and its surroundings were tuned."""


def sector_covered(rig: SensorSuite) -> Sector:
    """The smallest sector that holds the fields of view of all cameras; of a rig without any, of the LiDARs, or else of the
    radars.

    Where objects are placed depends on it, so it goes by nominal figures: a camera's field of view about its boresight,
    yaws in whole degrees.
    """
    intervals = []
    for mount in (rig.cameras or rig.lidars or rig.radars).values():
        low, high = mount.nominal_azimuth_range_deg
        yaw = round(mount.rotation_deg[2])
        intervals.append((yaw + low, yaw + high))
    blind = max(gaps(intervals), default=(180.0, 180.0), key=lambda gap: gap[1] - gap[0])
    half = 180.0 - (blind[1] - blind[0]) / 2
    center = ((blind[0] + blind[1]) / 2 + 360.0) % 360.0 - 180.0
    return Sector(float(np.radians(center)), float(np.radians(half)))


def gaps(intervals: list[Interval]) -> list[Interval]:
    """What the intervals of azimuth leave of the circle, in degrees counter-clockwise from the first one's start."""
    if not intervals:
        return [(-180.0, 180.0)]
    spans = sorted((low % 360.0, high - low) for low, high in intervals)
    first = spans[0][0]
    reach = max(first, *(start + width - 360.0 for start, width in spans))  # of those that go past the cut
    found = []
    for start, width in [*spans, (first + 360.0, 0.0)]:
        if start > reach:
            found.append((reach, start))
        reach = max(reach, start + width)
    return found
