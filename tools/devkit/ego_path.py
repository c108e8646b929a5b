"""The car's path through a scene, from the ego poses of its records."""

import numpy as np
from nuscenes import NuScenes
from pyquaternion import Quaternion

APART = 0.004
"""Seconds between poses that are of use beside one another: stamps are whole microseconds."""
REACH = 0.12
"""Seconds from the middle to the outermost pose that a velocity may rest on; and beyond the last pose."""


class EgoPath:
    """Positions and headings at the times of some records of one scene."""

    def __init__(self, tree: NuScenes, records: list[dict]) -> None:
        poses = [tree.get("ego_pose", record["ego_pose_token"]) for record in records]
        times = np.array([pose["timestamp"] for pose in poses])
        order = np.argsort(times, kind="stable")
        self._start = times[order[0]]
        self._times = 1e-6 * (times[order] - self._start)
        self._position = np.array([poses[i]["translation"] for i in order], float)
        self._yaw = np.unwrap([Quaternion(poses[i]["rotation"]).yaw_pitch_roll[0] for i in order])
        self._tokens = np.array([poses[i]["token"] for i in order])

    def pose_without(self, record: dict) -> tuple[np.ndarray, float] | None:
        """Position (3,) and heading (rad) at a record's time by the cubic through two other poses on either side (the nearest
        three, shortly before the first or after the last); None where there are not enough."""
        late = self._times - 1e-6 * (record["timestamp"] - self._start)
        usable = self._tokens != record["ego_pose_token"]
        before, after = self._spaced(late, usable & (late <= 0)), self._spaced(late, usable & (late > 0))
        if len(before) >= 2 and len(after) >= 2:
            nodes = [*before[:2], *after[:2]]
        else:
            nodes = self._spaced(late, usable)[:3]
            if len(nodes) < 3 or np.abs(late[nodes]).min() > REACH:
                return None
        weights = _lagrange(late[nodes])
        return weights @ self._position[nodes], float(weights @ self._yaw[nodes])

    def velocity(self, record: dict, arm: np.ndarray) -> np.ndarray | None:
        """Velocity (2,) m/s in ego axes of a point ``arm`` (3,) of the car at a record's time, the turning of the car
        included: the slope of the parabola through the nearest poses."""
        late = self._times - 1e-6 * (record["timestamp"] - self._start)
        nodes = [i for i in self._spaced(late, np.full(len(late), True))[:5] if abs(late[i]) < REACH]
        if len(nodes) < 3:
            return None
        cos, sin = np.cos(self._yaw[nodes]), np.sin(self._yaw[nodes])
        place = self._position[nodes, :2] + np.stack([cos * arm[0] - sin * arm[1], sin * arm[0] + cos * arm[1]], axis=1)
        slope = np.polyfit(late[nodes], place, 2)[1]
        yaw = np.polyfit(late[nodes], self._yaw[nodes], 2)[2]
        return np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]]) @ slope

    def _spaced(self, late: np.ndarray, usable: np.ndarray) -> list[int]:
        """Usable poses, the nearest in time first, no two of nearly the same time."""
        kept: list[int] = []
        for i in sorted(np.flatnonzero(usable), key=lambda i: abs(late[i])):
            if all(abs(late[i] - late[j]) > APART for j in kept):
                kept.append(int(i))
            if len(kept) == 5:
                break
        return kept


def _lagrange(nodes: np.ndarray) -> np.ndarray:
    """Weights (K,) that carry the values at ``nodes`` (K,) to 0."""
    return np.array([np.prod([b / (b - a) for b in nodes if b != a]) for a in nodes])
