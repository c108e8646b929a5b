"""Where the car was at any time of a scene: the poses of its tables with screw motions between them."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from fusion_net.nuscenes.nuscenes import NuScenes

Array = NDArray[np.float64]

BASELINE = 40_000
"""Least microseconds between the two poses that a motion is taken from: poses of one time tell no speed."""


class EgoPath:
    """The poses of one scene. Between two the car moves on a screw, which holds a steady turn exactly; outside them it goes
    on as it did at the end."""

    def __init__(self, nusc: NuScenes, scene: str) -> None:
        poses = {record["timestamp"]: nusc.global_T_ego(record) for record in nusc.sample_data_of[scene]}
        self._stamps = np.array(sorted(poses))
        self._poses = np.array([poses[stamp] for stamp in self._stamps.tolist()])

    def at(self, stamp: float) -> Array:
        """``global_T_ego`` (4, 4) at a time stamp in us."""
        first, twist = self._motion(stamp)
        elapsed = (stamp - self._stamps[first]) * 1e-6
        return self._poses[first] @ RigidTransform.from_exp_coords(twist * elapsed).as_matrix()

    def twist(self, stamp: float) -> Array:
        """Velocity (6,) of the car in its own axes: turn rate in rad/s, then that of its origin in m/s."""
        return self._motion(stamp)[1]

    def _motion(self, stamp: float) -> tuple[int, Array]:
        """Index of a pose, and the twist (6,) from it to another one: those on either side of the time stamp where they are
        ``BASELINE`` apart."""
        stamps = self._stamps
        second = max(int(np.searchsorted(stamps[:-1], stamp)), 1)
        first = max(int(np.searchsorted(stamps, stamps[min(second, len(stamps) - 1)] - BASELINE, side="right")) - 1, 0)
        second = min(max(second, int(np.searchsorted(stamps, stamps[first] + BASELINE))), len(stamps) - 1)
        if first == second:
            return first, np.zeros(6)
        start, end = RigidTransform.from_matrix(self._poses[[first, second]])
        return first, (start.inv() * end).as_exp_coords() / (stamps[second] - stamps[first]) * 1e6


@lru_cache(maxsize=16)
def ego_path(nusc: NuScenes, scene: str) -> EgoPath:
    """The path of a scene, kept for its next sample."""
    return EgoPath(nusc, scene)
