"""A capture event: what one sensor is asked to measure, the same for cameras, LiDARs and radars."""

from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from data_gen.rig.mounts import Mount
from fusion_net.common.faults import SensorFaults

MountT = TypeVar("MountT", bound=Mount)


@dataclass(frozen=True, kw_only=True)
class CaptureEvent(Generic[MountT]):
    """One measurement of one sensor: when and from where it is made, and what the car assumes about both.

    The car takes the sensor to have measured at ``time`` from where ``mount`` says, and compensates its own motion
    accordingly; in truth it measures at ``true_time`` from ``ego_T_sensor``. Times are seconds of the episode; a LiDAR's is
    the end of its turn. ``rng`` feeds what is new in every measurement, ``lens_seed`` stands for what stays on a camera's lens
    throughout the scene, drops and dirt: equal streams and seeds give equal data.
    """

    mount: MountT
    time: float
    true_time: float
    ego_T_sensor: NDArray[np.float64]  # (4, 4)
    rng: np.random.Generator
    lens_seed: int = 0
    faults: SensorFaults = field(default_factory=SensorFaults)
    channel: str = ""
    keyframe: int = 0
    """Index of the keyframe that it belongs to or comes before."""
    is_keyframe: bool = True

    @classmethod
    def nominal(cls, mount: MountT, time: float, rng: np.random.Generator, **others: Any) -> "CaptureEvent[MountT]":
        """An event with the nominal clock and mount, but for ``others``, fields by name."""
        values: dict[str, Any] = {"true_time": time, "ego_T_sensor": mount.ego_T_sensor} | others
        return cls(mount=mount, time=time, rng=rng, **values)
