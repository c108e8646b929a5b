"""What a scene's sensors gave and where they stood then, in the order of time.

Every sensor has a clock and a pose of the car of its own, so a frame that is shown at another time than its own must be held
where it was in the world: :func:`held`.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.geometry import invert
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.nuscenes.table_fields import Record

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]


@dataclass(frozen=True)
class Reading:
    """One file of one sensor."""

    record: Record
    channel: str
    modality: str
    keyframe: int | None  # number of the keyframe in the scene, from 0; None: a sweep between keyframes
    global_T_ego: Array  # (4, 4) when it was taken
    ego_T_sensor: Array  # (4, 4)

    @property
    def stamp(self) -> int:
        """Time in us by the sensor's own clock."""
        return self.record["timestamp"]

    @property
    def global_T_sensor(self) -> Array:
        """Where (4, 4) the sensor was."""
        return self.global_T_ego @ self.ego_T_sensor


@dataclass(frozen=True)
class Scene:
    """A scene of a data set: its keyframes in order, and all readings by time. ``sweeps`` False: those of keyframes alone."""

    nusc: NuScenes
    record: Record
    tokens: list[str]  # of the keyframes
    sweeps: bool = True

    @cached_property
    def readings(self) -> list[Reading]:
        """All that the sensors gave."""
        nusc, number = self.nusc, {token: place for place, token in enumerate(self.tokens)}
        found = []
        for record in nusc.sample_data_of[self.record["token"]]:
            if record["is_key_frame"] or self.sweeps:
                channel = nusc.channel(record)
                keyframe = number.get(record["sample_token"]) if record["is_key_frame"] else None
                pose, mount = nusc.global_T_ego(record), nusc.ego_T_sensor(record)
                found.append(Reading(record, channel, nusc.modalities[channel], keyframe, pose, mount))
        return sorted(found, key=lambda reading: reading.stamp)

    @cached_property
    def channels(self) -> list[str]:
        """The channels of the data set, those that are dead in this scene included."""
        return list(self.nusc.modalities)

    def of(self, channel: str) -> list[Reading]:
        """The readings of one channel."""
        return [reading for reading in self.readings if reading.channel == channel]

    @cached_property
    def keyframe_stamps(self) -> Stamps:
        """(K,) reference times of the keyframes, us."""
        return np.array([self.nusc.reference(token)["timestamp"] for token in self.tokens], np.int64)

    @cached_property
    def keyframe_poses(self) -> Array:
        """(K, 4, 4) ``global_T_ego`` at the reference times."""
        return np.array([self.nusc.global_T_ego(self.nusc.reference(token)) for token in self.tokens])

    @cached_property
    def path(self) -> tuple[Stamps, Array]:
        """Every time (T,) in us at which a sensor fired, and ``global_T_ego`` (T, 4, 4) then."""
        poses = {reading.stamp: reading.global_T_ego for reading in self.readings}
        return np.array(list(poses), np.int64), np.array(list(poses.values()))

    def silent(self, channel: str) -> list[int]:
        """Numbers of the keyframes at which a channel gave nothing."""
        return [k for k, token in enumerate(self.tokens) if channel not in self.nusc.keyframes[token]]


def held(stamps: Stamps, global_T_ego: Array, own_stamps: Stamps, global_T_frame: Array) -> tuple[Stamps, Array]:
    """Where a frame that was at ``global_T_frame`` (N, 4, 4) at its own times (N,) is to be drawn in the ego frame at any time:
    it stays in the world where it last was, while the car drives on.

    ``stamps`` (T,) and ``global_T_ego`` (T, 4, 4): the car. Returns those stamps from the frame's first on, and
    ``ego_T_frame`` at each. At the frame's own times that is its mount.
    """
    last = np.searchsorted(own_stamps, stamps, side="right") - 1
    begun = last >= 0
    return stamps[begun], invert(global_T_ego[begun]) @ global_T_frame[last[begun]]
