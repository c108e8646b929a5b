"""Points of the past moved to where their objects are at the reference time, by the velocity that radars measure.

A radar measures the radial part of a velocity: what crosses its line of sight is left behind by the other part.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fusion_net.data.batch import LIDAR_CHANNELS, RADAR_CHANNELS

Points = NDArray[np.float32]

MOVING_SPEED = 1.0
"""Ground speed in m/s above which a radar point is of a moving object."""
REACH = 2.0
"""Metres in the plane within which a LiDAR point belongs to a radar point: about the half of a car."""
AGE_STEP = 0.025
"""Seconds: LiDAR points of one step are matched with radar points at one time, 0.5 m apart at 20 m/s."""
VELOCITY = slice(RADAR_CHANNELS.index("vx"), RADAR_CHANNELS.index("vy") + 1)
RADAR_DT, LIDAR_DT = RADAR_CHANNELS.index("dt"), LIDAR_CHANNELS.index("dt")


def propagate_radar(radar: Points) -> Points:
    """Radar points (R, 7) at the reference time, from where they were measured."""
    moved = radar.copy()
    moved[:, :2] += radar[:, VELOCITY] * radar[:, RADAR_DT, None]
    return moved


def propagate_lidar(lidar: Points, radar: Points) -> Points:
    """LiDAR points (P, 5), those of moving objects moved by the velocity of the radar times their own age.

    ``radar`` (R, 7) are at the reference time. A LiDAR point goes with the radar point that is nearest to it at its own
    time, within ``REACH``: stays with one at rest, moves with one that moves.
    """
    moves = np.hypot(*radar[:, VELOCITY].T) > MOVING_SPEED
    if not moves.any():
        return lidar
    velocity = np.where(moves[:, None], radar[:, VELOCITY], 0)
    moved = lidar.copy()
    step = np.round(lidar[:, LIDAR_DT] / AGE_STEP).astype(int)
    for age in np.unique(step):
        points = np.flatnonzero(step == age)
        then = cKDTree(radar[:, :2] - velocity * (age * AGE_STEP))
        distance, nearest = then.query(lidar[points, :2], distance_upper_bound=REACH)
        points, nearest = points[np.isfinite(distance)], nearest[np.isfinite(distance)]
        moved[points, :2] += velocity[nearest] * lidar[points, LIDAR_DT, None]
    return moved
