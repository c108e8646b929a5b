"""Faults of the car that is being recorded: the definitions of ``faults``, applied while rendering.

The sensor fires at its true time from its true mount, and then loses what the fault takes; the tables go on telling the
reported time and mount.
"""

from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from data_gen.rig.mounts import Lidar, Mount
from data_gen.sensors.camera.camera import CameraFrame
from data_gen.sensors.lidar.lidar import LidarSweep
from data_gen.sensors.radar.radar import RadarScan
from fusion_net.common.fault_effects import Rings, smear
from fusion_net.common.faults import FaultPlan, SensorFaults

Points = TypeVar("Points", LidarSweep, RadarScan)


@dataclass(frozen=True)
class SceneFaults:
    """The faults of one scene. ``channels`` to modalities; tokens of the scene and of its samples, in order."""

    plan: FaultPlan
    channels: dict[str, str]
    scene: str
    samples: list[str]

    def on(self, channel: str, keyframe: int) -> SensorFaults:
        """What a channel suffers in the firings of a keyframe."""
        return self.plan.on(channel, self.channels, scene=self.scene, sample=self.samples[keyframe])


def spoil(
    data: CameraFrame | LidarSweep | RadarScan, faults: SensorFaults, *, mount: Mount, stamp: int
) -> CameraFrame | LidarSweep | RadarScan:
    """What is left of a reading. ``mount`` is the reported one, ``stamp`` the reported time in us."""
    if not faults:
        return data
    if isinstance(data, CameraFrame):
        return replace(data, image=smear(data.image, faults.covered(*data.image.shape[:2])))
    if isinstance(data, LidarSweep):
        assert isinstance(mount, Lidar)
        rings = Rings(data.ring, mount.model.beams)
        return select(data, faults.kept(data.points, mount.ego_T_sensor, stamp, rings))
    return select(data, faults.kept(np.stack([data.x, data.y, 0 * data.x], axis=1), mount.ego_T_sensor, stamp))


def select(data: Points, keep: NDArray[np.bool_]) -> Points:
    """The points (P,) to keep of a sweep or scan; what is not a column of its points stays."""
    columns = {field.name: getattr(data, field.name) for field in fields(data)}
    return replace(data, **{n: v[keep] for n, v in columns.items() if n not in ("aimed", "reached")})
