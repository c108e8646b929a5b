"""The sensor frames of a sample as the car receives them: which records, of what age, from which mount, with active faults.

The reference is the ego frame at the time of the LIDAR_TOP keyframe. A sensor frame of another time is taken there through
the ego poses of both times: sensor -> ego then -> global -> ego at the reference.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.faults import FaultPlan, SensorFaults
from fusion_net.common.geometry import invert
from fusion_net.nuscenes.ego_path import ego_path
from fusion_net.nuscenes.nuscenes import NuScenes, Record

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SensorFrame:
    """What one sensor measured at one time. ``record`` names the files that hold its data."""

    record: Record
    stamp: int  # us: when the car assumes it was taken
    age: float  # seconds from then to the reference time
    reported_mount: Array  # (4, 4) ego_T_sensor of the tables
    mount: Array  # (4, 4): does to these data what the reported one does to those of a sensor that has moved
    ego_T_sensor: Array  # (4, 4) from the sensor, at that time, to the ego frame at the reference time
    faults: SensorFaults


class SampleContext:
    """A sample's reference time and ego frame, and its sensor frames."""

    def __init__(self, nusc: NuScenes, token: str, plan: FaultPlan, *, motion_compensation: bool) -> None:
        self.nusc, self.token, self.plan, self.motion_compensation = nusc, token, plan, motion_compensation
        self.reference = nusc.reference(token)
        self.ego_T_global = invert(nusc.global_T_ego(self.reference))
        self.scene = nusc.get("sample", token)["scene_token"]

    def sensor_frames(self, channel: str, past: int = 0) -> list[SensorFrame]:
        """The channel's keyframe and up to ``past`` sweeps before it, newest first; [] if the sensor is dead: the tables
        have no keyframe of it, or a fault takes it."""
        found: dict[str, SensorFrame] = {}
        for place, record in enumerate(self.nusc.keyframe_and_sweeps(self.token, channel, past)):
            frame = self._sensor_frame(channel, record)
            if frame is not None:
                found.setdefault(frame.record["token"], frame)
            elif place == 0:
                return []
        return list(found.values())

    def _sensor_frame(self, channel: str, record: Record) -> SensorFrame | None:
        faults = self._faults(channel, record["sample_token"])
        if faults.dead:
            return None
        source, stamp = self._source(record, faults)
        reported = self.nusc.ego_T_sensor(record)
        true = faults.true_mount(reported)
        mount = reported if true is reported else reported @ invert(true) @ reported
        ego_T_sensor = mount
        if self.motion_compensation:
            same = stamp == record["timestamp"]
            pose = self.nusc.global_T_ego(record) if same else ego_path(self.nusc, self.scene).at(stamp)
            ego_T_sensor = self.ego_T_global @ pose @ mount
        age = (self.reference["timestamp"] - stamp) * 1e-6
        return SensorFrame(source, stamp, age, reported, mount, ego_T_sensor, faults)

    def _faults(self, channel: str, sample: str) -> SensorFaults:
        if not self.plan.faults:
            return SensorFaults()
        return self.plan.on(channel, self.nusc.modalities, scene=self.scene, sample=sample)

    def _source(self, record: Record, faults: SensorFaults) -> tuple[Record, int]:
        """The record whose data are delivered instead of those of ``record``, and the time stamp that the car assumes.

        A clock that is ``error`` s ahead gives, under a stamp, what was measured ``error`` s before it: of the recorded frames
        the nearest to that, stamped with the error that is left. A stale frame then is an earlier one under that stamp.
        """
        first = self.nusc.get("sample", self.nusc.get("scene", self.scene)["first_sample_token"])["timestamp"]
        error = round(faults.clock_error((record["timestamp"] - first) * 1e-6) * 1e6)
        source = self._nearest(record, record["timestamp"] - error) if error else record
        stamp = source["timestamp"] + error
        for _ in range(faults.late_firings):
            source = self._neighbour(source, "prev") or source
        return source, stamp

    def _nearest(self, record: Record, stamp: int) -> Record:
        """The channel's record nearest to a time, starting from ``record``."""
        way = "prev" if stamp < record["timestamp"] else "next"
        while other := self._neighbour(record, way):
            if abs(other["timestamp"] - stamp) >= abs(record["timestamp"] - stamp):
                break
            record = other
        return record

    def _neighbour(self, record: Record, way: str) -> Record | None:
        """The channel's record before or after one, if there is one."""
        token = record.get(way)
        return self.nusc.get("sample_data", token) if token else None
